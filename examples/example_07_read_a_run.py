"""A run read back from its folder: its options, its curves, its map, and what became of each tumour."""

import json

import numpy as np

import sounding


def main() -> None:
    summary = sounding.run_episode(
        scenario="spheres",
        arm="none",
        steps=12,
        seed=2,
        out="renders/read-a-run",
        overwrite=True,
        report=False,
        show_progress=False,
    )
    run = sounding.load_run(summary["folder"])
    print(
        f"{run.options['planner']} on {run.scenario['name']}, seed {run.options['seed']}: {run.n_steps} actions"
    )

    print("\naction   sensed   AUPRC")
    sensed, auprc = run.numbers("sensed_fraction"), run.numbers("auprc")
    for step in range(2, run.n_steps, 3):
        print(f"{step + 1:>6} {sensed[step]:>8.0%} {auprc[step]:>7.3f}")

    assert run.field is not None, "the run kept a map"
    p = 1.0 / (1.0 + np.exp(-run.field.log_odds[run.field.is_inside]))
    print(f"\ntumour is likely in {np.mean(p > 0.5):.2%} of the organ")

    print("\ntumour   found   sensed   error of its centre")
    for row in json.loads((run.folder / "findings.json").read_text())["tumours"]:
        error = f"{row['centroid_error_m'] * 1e3:.1f} mm" if row["is_found"] else "-"
        print(
            f"{row['tumour']:>6} {'yes' if row['is_found'] else 'no':>7} {row['sensed_fraction']:>8.0%} {error:>21}"
        )


if __name__ == "__main__":
    main()
