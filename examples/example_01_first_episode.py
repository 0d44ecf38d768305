"""A first episode: the planner looks for one hidden sphere, and the run's folder shows what it did."""

import sounding


def main() -> None:
    summary = sounding.run_episode(
        scenario="sphere",  # the paper's synthetic organ with one tumour
        planner="find-and-outline",
        arm="none",  # a free-flying probe; leave it out for the embedded 7-joint arm
        steps=12,
        seed=1,
        out="renders/first-episode",
        overwrite=True,
        show_progress=False,
    )
    print(f"sensing actions        {summary['n_sensings']:>5}")
    print(f"tumour sensed          {summary['sensed_fraction']:>5.0%}")
    print(f"actions until 95 %     {summary['sensings_to_95']:>5}")
    print(f"AUPRC of the map       {summary['auprc']:>5.3f}")
    print(f"open {summary['folder']}/report.html in a browser")


if __name__ == "__main__":
    main()
