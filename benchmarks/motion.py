"""Motion between random poses of a scenario: how many straight transfers collide, and what paths in their place cost.

Servos go through the poses twice: sent to a depth, and until they press with a force.

.venv/bin/python -m benchmarks.motion --scenario liver --poses 100
"""

import argparse
from itertools import pairwise
from time import process_time

import numpy as np
from threadpoolctl import threadpool_limits

from mapping import MapSettings
from sim.episode.moving.arm_motion import make_motion_model
from sim.episode.scenario_file import load_scenario
from sim.episode.setup import Setup, build_setup
from sim.world.motion.path_check import PathCheck
from sim.world.motion.settings import MotionKind, ServoSettings
from sim.world.scene.arm import ArmModel


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenario", default="liver")
    parser.add_argument("--poses", type=int, default=100)
    parser.add_argument("--servo-poses", type=int, default=15)
    parser.add_argument("--press-n", type=float, default=1.0)
    options = parser.parse_args()
    with threadpool_limits(limits=1):
        setup = build_setup(load_scenario(options.scenario), ArmModel(), MapSettings())
        rng = np.random.default_rng(0)
        poses = rng.permutation(setup.workspace.n_poses)[: options.poses].tolist()
        poses = [pose for pose in poses if setup.positioner.reach(pose).is_reached]
        search = setup.positioner.search
        check = PathCheck(setup.scene, search.chain, search.meter, search.clearance)
        lifted = [setup.positioner.reach(pose).q_standoff[search.chain.columns] for pose in poses]
        n_hit = sum(not check.is_free(np.stack(pair)) for pair in pairwise(lifted))
        print(f"{options.scenario}: {len(poses)} reached poses, straight transfers that collide: {n_hit}")
        for kind in ("none", "kinematic", "servo"):
            report(setup, kind, poses[: options.servo_poses] if kind == "servo" else poses)
        report(setup, "servo", poses[: options.servo_poses], ServoSettings(press_n=options.press_n))


def report(setup: Setup, kind: MotionKind, poses: list[int], servo: ServoSettings | None = None) -> None:
    """Move through the poses, and print what it took."""
    motion_model, data = make_motion_model(setup, kind, servo=servo), setup.scene.new_data()
    took_s, motions = [], []
    for pose in poses:
        start_s = process_time()
        motions.append(motion_model.move(data, pose))
        took_s.append(process_time() - start_s)
    median_ms, mean_ms, worst_ms = 1e3 * np.array([np.median(took_s), np.mean(took_s), max(took_s)])
    done = [motion for motion in motions if motion.is_done]
    name = "press" if servo else kind
    print(
        f"{name:9}: {len(done)} of {len(poses)} done; CPU {median_ms:.0f} ms median, {mean_ms:.0f} mean, "
        f"{worst_ms:.0f} worst; motion {np.mean([motion.motion_s for motion in done]):.2f} s mean"
    )
    if kind == "servo":
        error_mm = 1e3 * max(motion.tracking_error_m for motion in done)
        forces_n = [motion.contact_force_n for motion in done]
        peak_n = max(motion.peak_force_n for motion in done)
        print(f"           tracking error at sensing at most {error_mm:.3f} mm;", end=" ")
        print(f"force {min(forces_n):.3f} to {max(forces_n):.3f} N, peak {peak_n:.2f} N")


if __name__ == "__main__":
    main()
