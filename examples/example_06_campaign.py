"""A campaign: planners compared on equal seeds. Called again it goes on where it stopped."""

import sounding


def main() -> None:
    study = sounding.make_study(
        "two-planners",
        scenario="sphere",
        planner=["find-and-outline", "random"],  # every list is an axis: each combination is run
        arm="none",
        motion="none",  # the probe jumps, and the time of its way is estimated
        seed="0:4",  # quick; it takes a hundred seeds to tell planners apart that are nearly as good
        steps=40,
        until_sensed=0.95,
        map="when-needed",  # random looks at no map, so none is kept for it
    )
    done = sounding.run_trials(study, "renders/two-planners", jobs=2)
    print(f"{done.n_done} trials in {done.folder}, {done.n_failed} failed\n")
    print(sounding.compare([done.folder]).text)


if __name__ == "__main__":
    main()
