"""Time of B-mode planes on one core, with the share of each step, of an action, and of PyMUST on the same scatterers.

    .venv/bin/python -m benchmarks.ultrasound_speed [--planes 200]

A plane has 192 lines of 1,024 samples and becomes a picture of 512 x 512. An action sweeps 16 planes. PyMUST, where it
is installed (the extra `pymust`), computes one line of some of the same scatterers; its time grows in proportion to
their number and to that of the lines, by which the ratio is reckoned. Times are those of the processor, which are the
clock's on a machine that does nothing else; the clock's are told beside.
"""

from __future__ import annotations

from argparse import ArgumentParser, RawDescriptionHelpFormatter
from collections import defaultdict
from time import perf_counter, process_time

import numpy as np
from threadpoolctl import threadpool_limits

from sim.episode.positioner import FreePositioner
from sim.episode.scenario_file import load_scenario
from sim.episode.setup import build_setup
from sim.episode.truth import make_truth
from sim.extras import EXTRAS, missing_text
from sim.world.sensing.sensor import SceneState
from sim.world.sensing.ultrasound import imager as imager_module
from sim.world.sensing.ultrasound.convex_array import ConvexArray
from sim.world.sensing.ultrasound.imager import Imager
from sim.world.sensing.ultrasound.scattering import scatterers_in
from sim.world.sensing.ultrasound.settings import Settings
from sim.world.sensing.ultrasound.tables import Tables
from sim.world.sensing.ultrasound.ultrasound_sensor import UltrasoundSensor

STEPS = {
    "trace_lines": "lines through the tissue",
    "gather_scatterers": "scatterers",
    "spread_across": "beam and noise",
    "spread_along": "pulse",
    "compress": "compensation and logarithm",
    "draw_fan": "scan conversion",
}
N_SAME = 2000
"""Scatterers that PyMUST is given."""
SEED = 1003


def main() -> None:
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--planes", type=int, default=200)
    n_planes = parser.parse_args().planes
    with threadpool_limits(limits=1):
        state, rng = state_over_liver(), np.random.default_rng(0)
        sensor = UltrasoundSensor()
        start_s = perf_counter()
        sensor.sense(state, rng)
        print(f"first action, with the tissue cut and the loops loaded: {perf_counter() - start_s:.2f} s")
        actions_s = [timed(lambda: sensor.sense(state, rng)) for _ in range(max(n_planes // 16, 3))]
        print(f"an action of 16 planes: {told(actions_s, 's', 3)}")
        plane_s, n_used = time_planes(sensor, state, n_planes)
        compare(plane_s, n_used)


def state_over_liver() -> SceneState:
    """A probe on the liver, over its tumours."""
    setup = build_setup(load_scenario("liver"))
    truth = make_truth(setup, np.random.default_rng(SEED))
    data = truth.scene.new_data()
    FreePositioner(truth.scene, setup.workspace).place(
        data, len(setup.workspace.normals) // 2, is_lifted=False
    )
    return SceneState(truth.scene, data)


def timed(work) -> tuple[float, float]:
    """Seconds of the processor and of the clock."""
    start_s, clock_s = process_time(), perf_counter()
    work()
    return process_time() - start_s, perf_counter() - clock_s


def told(times: list[tuple[float, float]], unit: str, digits: int) -> str:
    """The median time of the processor, and that of the clock."""
    own, clock = np.median(times, axis=0) * (1e3 if unit == "ms" else 1.0)
    return f"{own:.{digits}f} {unit} ({clock:.{digits}f} {unit} by the clock)"


def time_planes(sensor: UltrasoundSensor, state: SceneState, n_planes: int) -> tuple[float, int]:
    """Print the time of a plane and of its steps; its median [s] and the number of scatterers."""
    from sim.world.sensing.ultrasound.ultrasound_sensor import _grid

    grid = _grid(state.scene.anatomy, sensor.tissues, sensor.tissue_spacing_m)
    imager, poses = Imager(ConvexArray()), sensor.plane_poses(state)
    seconds, counts = defaultdict(list), []

    def clocked(name, loop):
        def run(*arguments):
            start_s = process_time()
            result = loop(*arguments)
            seconds[name].append(process_time() - start_s)
            if name == "gather_scatterers":
                counts.append(result)
            return result

        return run

    own = {name: getattr(imager_module, name) for name in STEPS}
    imager.plane(grid, poses[0])
    try:
        for name, loop in own.items():
            setattr(imager_module, name, clocked(name, loop))
        whole = [timed(lambda i=i: imager.plane(grid, poses[i % len(poses)], i)) for i in range(n_planes)]
    finally:
        for name, loop in own.items():
            setattr(imager_module, name, loop)
    median_s = float(np.median(whole, axis=0)[0])
    print(f"a plane: {told(whole, 'ms', 1)}; {np.mean(counts):,.0f} scatterers")
    parts = {text: float(np.median(seconds[name])) for name, text in STEPS.items()}
    parts["arrays between them"] = median_s - sum(parts.values())
    for text, part_s in parts.items():
        print(f"    {text:<28}{part_s * 1e3:6.1f} ms  {part_s / median_s:4.0%}")
    return median_s, int(np.mean(counts))


def compare(plane_s: float, n_used: int) -> None:
    """Print how long PyMUST takes over the same."""
    if not EXTRAS["pymust"].is_installed:
        print(f"PyMUST is left out: {missing_text('pymust', 'it')}")
        return
    from .pymust_array import MustArray

    array, cube_m = ConvexArray(), Tables.of(ConvexArray(), Settings()).cube_m
    places, _ = scatterers_in(np.array([-10, 0, 50]), np.array([10, 3, 70]), seed=0)
    must, given_m = MustArray(array), places.reshape(-1, 3)[:N_SAME][:, [0, 2]] * cube_m
    must.echoes(given_m[:10], 0.0)
    line_s = min(timed(lambda: must.echoes(given_m, 0.0))[0] for _ in range(3))
    whole_s = line_s * n_used / N_SAME * array.n_lines
    print(
        f"PyMUST: {line_s:.2f} s a line of {N_SAME:,} scatterers, so {whole_s / 3600.0:.1f} h a plane, "
        f"{whole_s / plane_s:,.0f} times as long"
    )


if __name__ == "__main__":
    main()
