"""`sounding episode`: run one episode and write its folder."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from sim.running.config import EpisodeConfig
from sim.running.fields import read_config, without_options_of

from .terminal import INTERRUPTED, aligned_lines, given_word, in_flags, note, parse, wrapped

ROWS = (
    ("sensing actions", "n_sensings", "{}"),
    ("actions until 95 % of the tumour was sensed", "sensings_to_95", "{}"),
    ("tumour sensed", "sensed_fraction", "{:.1%}"),
    ("tumour that could be sensed at all", "attainable_fraction", "{:.1%}"),
    ("organ that lies in some pose's cone", "visible_fraction", "{:.1%}"),
    ("AUPRC of the map", "auprc", "{:.3f}"),
    ("Dice at probability 0.5", "dice", "{:.3f}"),
    ("log loss", "log_loss", "{:.4f}"),
    ("calibration error", "expected_calibration_error", "{:.4f}"),
    ("confidence of the planner that nothing is left", "confidence", "{:.1%}"),
    ("poses skipped, out of the arm's reach", "n_skipped_poses", "{}"),
    ("modelled time of the procedure [s]", "procedure_s", "{:.1f}"),
    ("way of the tip [m]", "tip_path_m", "{:.2f}"),
    ("readings on the way", "n_readings", "{}"),
    ("times the probe was lifted off", "n_lift_offs", "{}"),
    ("way of the tip in contact [m]", "contact_path_m", "{:.2f}"),
    ("share of the sliding within 20 % of the force", "force_in_band", "{:.1%}"),
    ("time in all [s]", "wall_s", "{:.1f}"),
)

SOMETIMES = ("confidence", "n_readings", "n_lift_offs", "contact_path_m", "force_in_band")
"""Rows that are left out where there is nothing to tell."""

TARGET_ROWS = (
    ("{}: actions until 95 % was sensed", "target_sensings_to_95", "{}"),
    ("{}: sensed", "target_sensed_fraction", "{:.1%}"),
    ("{}: AUPRC of their map", "target_auprc", "{:.3f}"),
    ("{}: Dice at probability 0.5", "target_dice", "{:.3f}"),
)
"""Rows about a second class, whose name the labels begin with."""

MOST_LESIONS = 12
"""Tumours that are told one by one; findings.json has all."""

Options = EpisodeConfig
EXAMPLES = """
sounding episode                                          # 30 actions on the embedded liver
sounding episode --scenario sphere --planner random --arm none --steps 5
sounding episode --organ liver.nii.gz --tumour-label 2    # a patient's label volume
sounding episode --organ liver.stl --tumour tumour.stl --frames each
sounding episode --until-confident 0.95 --steps 200       # stop when nothing is left to find
sounding episode --miss-cost 100 --steps 200              # stop when a missed lesion is not worth more actions
sounding episode --motion servo --steps 5                 # with the arm's motion simulated
sounding episode --config renders/first/config.json --seed 1
"""
"""What the help begins with."""


def parse_options(arguments: Sequence[str], prog: str) -> EpisodeConfig:
    """The options that the command line gives; where --config names an earlier run, the others are those of that run.

    Raises:
        UsageError: The file of the earlier run cannot be used.
    """
    # Read first: options on the line need not go together without those of the file.
    path = given_word(arguments, "config")
    default = None
    if path is not None:
        anew = [name for name in ("planner", "sensor", "map") if given_word(arguments, name) is not None]
        default = without_options_of(read_config(Path(path)), anew)
    return parse(EpisodeConfig, arguments, prog=prog, examples=EXAMPLES, default=default)


def run(options: EpisodeConfig) -> int:
    """Run the episode, print its results, and return the exit code."""
    # Imported here, since they import MuJoCo, which takes a second that --help need not wait for.
    from sim.running.config_file import recorded_config
    from sim.running.output import output_of
    from sim.running.parts import make_parts
    from sim.running.run_episode import record_episode

    parts = make_parts(options)
    try:
        summary = record_episode(parts, output_of(options, parts, recorded_config(options)), notify=note)
    except KeyboardInterrupt:
        print(
            "sounding: interrupted; the run folder holds what was done, marked unfinished.", file=sys.stderr
        )
        return INTERRUPTED
    print(episode_table(summary))
    if parts.until_confident is not None:
        print(wrapped(excluded_text(summary)))
    if options.output.report:
        print(f"open {summary['folder']}/report.html in a browser")
    return 0


def excluded_text(summary: Mapping[str, Any]) -> str:
    """What a confidence that nothing is left does not speak of."""
    unseen = 1.0 - summary["visible_fraction"]
    text = (
        "No pose's cone reaches"
        if summary["arm"] == "none"
        else "No cone of a pose that may be reached holds"
    )
    return (
        f"The confidence is {summary['confidence']:.3f}. {text} {unseen:.1%} of the organ, and the confidence says "
        "nothing of what hides there (label 4 in map_labels.nii.gz)."
    )


def episode_table(summary: Mapping[str, Any]) -> str:
    """What an episode found and its figures as an aligned table, ending with the folder that holds them."""
    name = summary.get("target_name")
    rows = [row for row in ROWS if row[1] not in SOMETIMES or summary.get(row[1]) is not None]
    if name is not None:
        rows[-1:-1] = [(label.format(name), key, form) for label, key, form in TARGET_ROWS]
    return "\n".join([_account(summary), *aligned_lines(rows, summary), f"written to {summary['folder']}"])


def _account(summary: Mapping[str, Any]) -> str:
    """What was run and what was found, tumour by tumour, why it ended and what the numbers below mean."""
    from sim.findings.account import read_account

    told = read_account(Path(summary["folder"]), summary)
    head = (
        f"{summary['scenario']}, planner {summary['planner']}, arm {summary['arm']}, "
        f"{'probe ' + summary['probe'] + ', ' if 'probe' in summary else ''}seed {summary['seed']}"
    )
    cells = [(each.name, each.size, each.found, each.sensed) for each in told.lesions[:MOST_LESIONS]]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    lines = ["  " + "   ".join(map(str.ljust, row, widths)).rstrip() for row in cells]
    if len(told.lesions) > MOST_LESIONS:
        lines.append(f"  and {len(told.lesions) - MOST_LESIONS} more, in findings.json")
    prose = [wrapped(in_flags(text)) for text in (told.ended, told.limit, told.meaning) if text]
    return "\n".join([head, "-" * len(head), *told.found, *lines, "", *prose, ""])
