"""A run read back from its folder: its options, curves, map and what became of each tumour."""

import json

import numpy as np

import sounding


def main() -> None:
    summary = sounding.run_episode(
        scenario="spheres", arm="none", steps=15, seed=2, out="renders/read-a-run", overwrite=True, report=False,
        show_progress=False,
    )  # fmt: skip
    run = sounding.load_run(summary["folder"])
    print(f"planner {run.options['planner']}, seed {run.options['seed']}, {run.n_steps} actions")
    print("AUPRC by action:", np.array2string(run.numbers("auprc")[::5], precision=3))
    assert run.field is not None
    probability = 1.0 / (1.0 + np.exp(-run.field.log_odds[run.field.is_inside]))
    print(f"the map calls {np.mean(probability > 0.5):.2%} of the organ likely tumour")
    for tumour in json.loads((run.folder / "findings.json").read_text())["tumours"]:
        found = "found" if tumour["is_found"] else "missed"
        print(f"tumour {tumour['tumour']}: {found}, {tumour['sensed_fraction']:.0%} of it sensed")


if __name__ == "__main__":
    main()
