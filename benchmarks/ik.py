"""Inverse kinematics against mink called plainly and SciPy's least squares with restarts, in one run.

    .venv/bin/python -m benchmarks.ik [--poses 200]

Two sets of poses: tips of random collision-free configurations of the default arm, reachable by construction, and
poses of the liver, both without a stand-off. All methods are held to 1 mm and 1 degree with free roll; `solved` is
within tolerance and limits, `free` is solved without a forbidden contact. Restarts go on until a solution is found;
neither mink nor SciPy looks at contacts.

    .venv/bin/python -m benchmarks.ik --effort liver sphere

solves every pose of a scenario, stand-off included, twice with different sets of starts, and tries those called
unreachable again from 60 configurations drawn at random.

    .venv/bin/python -m benchmarks.ik --seeds liver

studies a scenario with three seeds, and tells what of it they do not share.
"""

from __future__ import annotations

from argparse import ArgumentParser, RawDescriptionHelpFormatter
from itertools import combinations
from time import perf_counter, process_time

import mink
import mujoco
import numpy as np
from scipy.optimize import least_squares
from threadpoolctl import threadpool_limits

from sim.episode.scenario import SCENARIOS
from sim.reach.reachability import study_reach
from sim.reach.workcell import Workcell, build_workcell
from sim.world.ik.damped_least_squares import AXIS_WEIGHT_M
from sim.world.ik.kinematics import Kinematics
from sim.world.ik.result import IkResult
from sim.world.ik.search import IkSearch
from sim.world.ik.settings import IkSettings
from sim.world.scene.named_arms import named_arm

POSITION_TOLERANCE_M, ANGLE_TOLERANCE_RAD = 1e-3, np.deg2rad(1.0)
MINK_STEPS, N_RESTARTS = 100, 20


def main() -> None:
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--poses", type=int, default=200)
    parser.add_argument("--effort", nargs="+", default=(), metavar="SCENARIO")
    parser.add_argument("--seeds", nargs="+", default=(), metavar="SCENARIO")
    arguments = parser.parse_args()
    with threadpool_limits(1):
        for scenario in arguments.effort:
            study_effort(scenario)
        for scenario in arguments.seeds:
            compare_seeds(scenario)
        if arguments.effort or arguments.seeds:
            return
        workcell = build_workcell(SCENARIOS["liver"], named_arm("default"))
        print("| poses | method | solved | free | ms a pose |\n|---|---|---|---|---|")
        run(workcell, "made by free configurations", *made_poses(workcell, arguments.poses))
        run(workcell, "liver", *liver_poses(workcell, arguments.poses))


def study_effort(scenario: str) -> None:
    """Whether a study depends on its starts, and what a stronger search still finds."""
    workcell = build_workcell(SCENARIOS[scenario], named_arm("default"))
    positions_m, normals = workcell.workspace.positions_m, workcell.workspace.normals
    searches = [workcell.make_search(IkSettings(start_seed=seed)) for seed in (0, 1)]
    start_s, start_cpu_s = perf_counter(), process_time()
    answers = searches[0].search(positions_m, normals)
    taken_s, taken_cpu_s = perf_counter() - start_s, process_time() - start_cpu_s
    other = searches[1].search(positions_m, normals)
    n_poses = len(positions_m)
    print(f"{scenario}: {answers.is_reached.mean():.2%} of {n_poses} poses reached,", end=" ")
    print(f"{n_poses / taken_s:.0f} a second on one core ({n_poses / taken_cpu_s:.0f} a second of CPU time)")
    print(f"  two sets of starts agree on {np.mean(answers.is_reached == other.is_reached):.2%}")
    rows = np.flatnonzero(~answers.is_reached)
    found = sum(found_at_random(searches[0], positions_m[row], normals[row]) for row in rows)
    print(
        f"  60 random starts find {found} of the {len(rows)} unreachable: {found / n_poses:.2%} of all",
        flush=True,
    )


def compare_seeds(scenario: str) -> None:
    """What studies of a scenario with the seeds 0, 1 and 2 share, and what not."""
    workcell = build_workcell(SCENARIOS[scenario], named_arm("default"))
    searches = [workcell.make_search(IkSettings(start_seed=seed)) for seed in range(3)]
    studies = [study_reach(search, workcell.workspace) for search in searches]
    is_reached = np.array([study.is_reached for study in studies])
    same = (is_reached == is_reached[0]).all(axis=0)
    print(f"{scenario}: three seeds agree about {same.sum()} of {len(same)} poses;", end=" ")
    print(f"regions {[int(study.region.max()) + 1 for study in studies]}, ", end="")
    print(f"median scores {[round(float(np.nanmedian(study.score)), 2) for study in studies]}")
    for first, second in combinations(range(3), 2):
        both = is_reached[first] & is_reached[second]
        apart = np.abs(studies[first].score - studies[second].score)[both]
        print(
            f"  seeds {first} and {second}: the score of {np.mean(apart > 0.1):.1%} differs by more than 0.1"
        )


def found_at_random(search: IkSearch, position_m, normal) -> bool:
    starts = np.random.default_rng(7).uniform(*search.chain.search_range(), (60, search.chain.n_joints))
    return search.is_reached_from(starts, position_m, normal)


def made_poses(workcell: Workcell, count: int):
    search, rng, q = workcell.make_search(), np.random.default_rng(0), np.empty((0, 7))
    while len(q) < count:
        drawn = rng.uniform(*search.chain.search_range(), (4 * count, 7))
        q = np.vstack([q, drawn[search.meter.measure(search.chain.full(drawn)).is_free]])
        state = search.chain.forward(q)
        q = q[workcell.clearance.probe_distances(state.tips_m, state.R_world_tip)[0] >= 0.0]
    state = search.chain.forward(q[:count])
    return state.tips_m, state.beams


def liver_poses(workcell: Workcell, count: int):
    chosen = np.random.default_rng(1).permutation(workcell.workspace.n_poses)[:count]
    return workcell.workspace.positions_m[chosen], workcell.workspace.normals[chosen]


def run(workcell: Workcell, name: str, positions_m, normals) -> None:
    settings = IkSettings(
        position_tolerance_m=POSITION_TOLERANCE_M,
        angle_tolerance_rad=ANGLE_TOLERANCE_RAD,
        standoff_m=0.0,
    )
    search = workcell.make_search(settings)
    kinematics = Kinematics(workcell.scene, workcell.clearance, settings)
    plain = PlainMink(workcell)
    one_by_one = {
        "search and mink, one by one": lambda p, n: answer_of(kinematics.solve(p, n)),
        "mink from home": lambda p, n: plain.solve(p, n, n_restarts=0),
        f"mink, {N_RESTARTS} random restarts": lambda p, n: plain.solve(p, n, n_restarts=N_RESTARTS),
        f"SciPy, {N_RESTARTS} random restarts": lambda p, n: scipy_solve(search, p, n),
    }
    start_s = perf_counter()
    answers = search.search(positions_m, normals)
    batch_s = perf_counter() - start_s
    rows = {"search, all poses together": ([answer_of(each) for each in answers.results], batch_s)}
    for method, solve in one_by_one.items():
        start_s = perf_counter()
        found = [solve(p, n) for p, n in zip(positions_m, normals, strict=True)]
        rows[method] = found, perf_counter() - start_s
    for method, (found, taken_s) in rows.items():
        is_solved = [q is not None for q in found]
        is_free = [q is not None and kinematics.collision(q) is None for q in found]
        ms = 1e3 * taken_s / len(found)
        print(
            f"| {name} | {method} | {np.mean(is_solved):.1%} | {np.mean(is_free):.1%} | {ms:.2f} |",
            flush=True,
        )


def answer_of(result: IkResult):
    """The joints of an answer; None where the pose is not reached."""
    return result.q if result.is_reached else None


class PlainMink:
    """mink as its examples use it: a frame task with free roll, the joint limits, no step cap."""

    def __init__(self, workcell: Workcell) -> None:
        scene = workcell.scene
        self.configuration, self.home_q = mink.Configuration(scene.model), scene.home_q
        self.frame = mink.FrameTask(
            scene.tip_site, "site", position_cost=1.0, orientation_cost=[0.3, 0.3, 0.0], lm_damping=1e-6
        )
        self.limits = [mink.ConfigurationLimit(scene.model)]
        self.range = scene.model.jnt_range.T
        self.tip = scene.model.site(scene.tip_site).id

    def solve(self, position_m, normal, *, n_restarts: int):
        rng = np.random.default_rng(0)
        for q in [self.home_q, *rng.uniform(*self.range, (n_restarts, len(self.home_q)))]:
            self.configuration.update(q)
            self.frame.set_target(target(position_m, normal))
            for _ in range(MINK_STEPS):
                data = self.configuration.data
                beam = data.site_xmat[self.tip].reshape(3, 3)[:, 2]
                if is_within(data.site_xpos[self.tip], beam, position_m, normal):
                    return self.configuration.q.copy()
                try:
                    step = mink.solve_ik(
                        self.configuration, [self.frame], 1.0, "daqp", damping=1e-8, limits=self.limits
                    )
                except mink.exceptions.MinkError:
                    break
                self.configuration.integrate_inplace(step, 1.0)
        return None


def scipy_solve(search: IkSearch, position_m, normal):
    chain, rng = search.chain, np.random.default_rng(0)

    def residual(q):
        state = chain.forward(q[None])
        return np.concatenate([state.tips_m[0] - position_m, AXIS_WEIGHT_M * (state.beams[0] - normal)])

    for q_start in [chain.home, *rng.uniform(chain.low, chain.high, (N_RESTARTS, chain.n_joints))]:
        q = least_squares(residual, q_start, bounds=(chain.low, chain.high), max_nfev=100).x
        state = chain.forward(q[None])
        if is_within(state.tips_m[0], state.beams[0], position_m, normal):
            return chain.full(q)
    return None


def is_within(tip_m, beam, position_m, normal) -> bool:
    angle_rad = np.arctan2(np.linalg.norm(np.cross(beam, normal)), beam @ normal)
    return bool(
        np.linalg.norm(tip_m - position_m) <= POSITION_TOLERANCE_M and angle_rad <= ANGLE_TOLERANCE_RAD
    )


def target(position_m, normal) -> mink.SE3:
    matrix = np.empty(9)
    quaternion = np.empty(4)
    mujoco.mju_quatZ2Vec(quaternion, np.ascontiguousarray(normal))
    mujoco.mju_quat2Mat(matrix, quaternion)
    return mink.SE3.from_rotation_and_translation(mink.SO3.from_matrix(matrix.reshape(3, 3)), position_m)


if __name__ == "__main__":
    main()
