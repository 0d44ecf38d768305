"""A question of reachability: from where does the arm reach how much of the liver's surface?"""

from dataclasses import replace

import sounding


def main() -> None:
    liver = replace(sounding.load_scenario("liver"), n_poses=300)  # a coarse sample of its 5000 poses
    print(f"{'base above the table':>20} {'reached':>8} {'in one piece':>13}")
    for height_m in (0.0, 0.2):
        summary = sounding.reach_study(
            liver,
            sounding.named_arm("default", base_m=(0.0, 0.0, height_m)),
            f"renders/reach/{height_m * 1e3:.0f}-mm",
            overwrite=True,
        )
        height = f"{height_m * 1e3:.0f} mm"
        print(f"{height:>20} {summary['reached_fraction']:>8.1%} {summary['largest_region_fraction']:>13.1%}")


if __name__ == "__main__":
    main()
