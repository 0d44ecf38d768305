"""A sensor of one's own: the exact cone, read by somebody who misses a share of the tumour's points.

From the command line, beside this file:

    sounding episode --sensor example_03_own_sensor:Forgetful --sensor-option miss_rate=0.3
"""

from dataclasses import dataclass, field, replace

import numpy as np

import sounding


@dataclass(frozen=True, kw_only=True)
class Forgetful(sounding.Sensor):
    """The paper's exact sensor, with tumour points called free at a rate."""

    miss_rate: float = 0.2
    exact: sounding.ConeSensor = field(default_factory=sounding.ConeSensor)

    def sense(self, state: sounding.SceneState, rng: np.random.Generator) -> sounding.Reading:
        """The reading where the probe is now; all randomness comes from `rng`."""
        reading = self.exact.sense(state, rng)
        is_missed = rng.random(len(reading.points_m)) < self.miss_rate
        return replace(reading, is_occupied=reading.is_occupied & ~is_missed)


def main() -> None:
    for miss_rate in (0.0, 0.5):
        summary = sounding.run_episode(
            scenario="spheres", sensor=Forgetful(miss_rate=miss_rate), arm="none", steps=8, seed=1, report=False,
            out="renders/own-sensor", overwrite=True, show_progress=False,
        )  # fmt: skip
        print(f"{miss_rate:.0%} of the tumour's points missed: AUPRC {summary['auprc']:.3f}")


if __name__ == "__main__":
    main()
