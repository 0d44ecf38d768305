"""A question of reachability: how much of the liver's surface does an arm reach from two places of its base?"""

from dataclasses import replace

import sounding
from sim.episode.scenario import SCENARIOS


def main() -> None:
    scenario = replace(SCENARIOS["liver"], n_poses=300)
    for base_m in ((0.0, 0.0, 0.0), (0.0, 0.0, 0.2)):
        summary = sounding.reach_study(
            scenario,
            sounding.named_arm("default", base_m=base_m),
            f"renders/reach-{base_m[2]:g}",
            overwrite=True,
        )
        print(f"base {base_m[2] * 1e3:.0f} mm above the table: {summary['reached_fraction']:.1%} reached, "
              f"{summary['n_regions']} connected regions")  # fmt: skip


if __name__ == "__main__":
    main()
