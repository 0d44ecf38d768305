"""A campaign: planners compared on equal seeds. Called again it goes on where it stopped."""

import sounding


def main() -> None:
    study = sounding.make_study(
        "two-planners",
        scenario="sphere",
        planner=["find-and-outline", "random"],
        arm="none",
        motion="none",
        seed="0:6",
        steps=60,
        until_sensed=0.95,
    )
    done = sounding.run_trials(study, "renders/two-planners", jobs=2)
    print(f"{done.n_done} trials, {done.n_failed} failed")
    print(sounding.compare([done.folder]).text)


if __name__ == "__main__":
    main()
