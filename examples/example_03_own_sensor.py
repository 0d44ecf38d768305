"""A sensor of one's own: the exact cone, read by somebody who misses a share of the tumour's points.

From the command line, in the folder of this file:

    .venv/bin/sounding episode --sensor example_03_own_sensor:Forgetful --sensor-option miss_rate=0.3
"""

from dataclasses import dataclass, field, replace

import numpy as np

import sounding


@dataclass(frozen=True, kw_only=True)
class Forgetful(sounding.Sensor):
    """The paper's exact sensor, but that it calls tumour points free at a rate."""

    miss_rate: float = 0.2
    exact: sounding.ConeSensor = field(default_factory=sounding.ConeSensor)

    def sense(self, state: sounding.SceneState, rng: np.random.Generator) -> sounding.Reading:
        """The reading where the probe is now; all randomness comes from `rng`."""
        reading = self.exact.sense(state, rng)
        is_missed = rng.random(len(reading.points_m)) < self.miss_rate
        return replace(reading, is_occupied=reading.is_occupied & ~is_missed)


def main() -> None:
    # What all seeds and sensors share is built once; `run_episode` does so by itself, and writes a folder besides.
    setup = sounding.build_setup(sounding.load_scenario("spheres"))
    planner = sounding.make_planner("random")  # looks at no reading, so that all sensors see the same places
    print(f"{'points missed':>13} {'AUPRC':>7} {'log loss':>9}")
    for miss_rate in (0.0, 0.3, 0.6):
        episode = sounding.Episode(setup, planner, sensor=Forgetful(miss_rate=miss_rate), seed=1)
        for _ in episode.steps(20):
            pass  # each step tells of one action: pose, reading, scores
        scores = episode.metrics()
        assert scores is not None, "a map was kept"
        print(f"{miss_rate:>13.0%} {scores.auprc:>7.3f} {scores.log_loss:>9.4f}")


if __name__ == "__main__":
    main()
