"""What the elastic organ costs, and what MuJoCo's flex makes of the same contact.

    .venv/bin/python -m benchmarks.tissue [--flex]

Presses the embedded liver at places all over its upper side: seconds to build, milliseconds a press, and milliseconds
for the points of a reading and of a lattice, forwards and backwards. With --flex, a block of 120 x 120 x 80 mm, bonded
to its base, is pressed in by 10 mm in MuJoCo with a face of 4 mm radius, and its force held against F = 2 E* a d.
Times are of the processor, on one core.
"""

from __future__ import annotations

from argparse import ArgumentParser, RawDescriptionHelpFormatter
from time import process_time

import numpy as np
from threadpoolctl import threadpool_limits

from sim.episode.scenario_file import load_scenario
from sim.episode.setup import build_setup
from sim.world.tissue.elastic_organ import build_elastic_organ
from sim.world.tissue.settings import ElasticSettings

DEPTH_M, FACE_M, MODULUS_PA = 0.010, 0.004, 5000.0
N_PLACES = 40


def main() -> None:
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--flex", action="store_true")
    with threadpool_limits(1):
        if parser.parse_args().flex:
            flex()
        else:
            liver()


def liver() -> None:
    setup = build_setup(load_scenario("liver"))
    workspace, rng = setup.workspace, np.random.default_rng(1000)
    poses = rng.choice(workspace.n_poses, N_PLACES, replace=False)
    print(
        "| cells of | unknowns | build s | press ms | depth at 0.3 N mm | force at 10 mm N |\n|---|---|---|---|---|---|"
    )
    for size_m in (None, 0.010, 0.008):
        build_s, organ = timed(
            lambda size_m=size_m: build_elastic_organ(setup.organ, tissue=settings(size_m))
        )
        times, depths, forces = [], [], []
        for pose in poses:
            at = workspace.positions_m[pose], workspace.normals[pose]
            time_s, pressed = timed(
                lambda at=at, organ=organ: organ.press(*at, depth_m=DEPTH_M, face_radius_m=FACE_M)
            )
            times.append(time_s)
            forces.append(pressed.force_n)
            depths.append(0.3 * pressed.compliance_m_per_n)
        print(
            f"| {1e3 * organ.lattice.size_m:.1f} mm | {3 * len(organ.lattice.nodes)} | {build_s:.2f} "
            f"| {1e3 * np.median(times):.1f} | {spread(depths, 1e3)} | {spread(forces, 1.0)} |",
            flush=True,
        )
    organ = build_elastic_organ(setup.organ)
    pressed = organ.press(workspace.positions_m[poses[0]], workspace.normals[poses[0]], depth_m=DEPTH_M)
    print("\n| points | where they go ms | where they came from ms |\n|---|---|---|")
    for n in (2000, 60_000):
        points = setup.organ.sample_inside(n, rng)
        there = min(timed(lambda points=points: pressed.displacement_m(points))[0] for _ in range(5))
        back = min(timed(lambda points=points: pressed.rest_of(points))[0] for _ in range(5))
        print(f"| {n} | {1e3 * there:.1f} | {1e3 * back:.1f} |", flush=True)


def settings(size_m: float | None) -> ElasticSettings:
    return ElasticSettings(youngs_modulus_pa=MODULUS_PA, element_size_m=size_m)


def spread(values, scale: float) -> str:
    low, middle, high = scale * np.percentile(values, [0, 50, 100])
    return f"{middle:.2f} ({low:.2f}-{high:.2f})"


def timed(work):
    """Seconds of the processor, and what the work returned."""
    start = process_time()
    result = work()
    return process_time() - start, result


FLEX = """
<mujoco>
  <option timestep="0.002" integrator="discrete" solver="CG" gravity="0 0 0"/>
  <size memory="300M"/>
  <worldbody>
    <flexcomp name="organ" type="grid" count="13 13 9" spacing="0.01 0.01 0.01" pos="0 0 0.04" dim="3" dof="{dof}"
              cellcount="{cells}" mass="1.15" radius="0.0005">
      <contact selfcollide="none" solref="0.01 1"/>
      <elasticity young="5000" poisson="0.45" damping="0.05"/>
      <pin gridrange="0 0 0 {last}"/>
    </flexcomp>
    <body pos="0 0 0.0905">
      <joint name="z" type="slide" axis="0 0 1" damping="5"/>
      <geom type="cylinder" size="0.004 0.01" mass="0.1"/>
    </body>
  </worldbody>
  <actuator><position joint="z" kp="2000" kv="60"/></actuator>
</mujoco>
"""


def flex() -> None:
    import mujoco

    law_n_per_m = 2 * MODULUS_PA / (1 - 0.45**2) * FACE_M
    print(
        "| flex | steps until still | ms a step | ms a contact | force over 2 E* a d |\n|---|---|---|---|---|"
    )
    for name, dof, cells, last in (
        ("trilinear, one cell", "trilinear", "1 1 1", "1 1 0"),
        ("trilinear, 6 x 6 x 4 cells", "trilinear", "6 6 4", "6 6 0"),
        ("quadratic, 3 x 3 x 2 cells", "quadratic", "3 3 2", "6 6 0"),
        ("full, 13 x 13 x 9 vertices", "full", "1 1 1", "12 12 0"),
    ):
        model = mujoco.MjModel.from_xml_string(FLEX.format(dof=dof, cells=cells, last=last))
        data, forces, start = mujoco.MjData(model), [0.0] * 50, process_time()
        for step in range(1500):
            data.ctrl[0] = -0.0105 * min(1.0, step / 200)
            mujoco.mj_step(model, data)
            forces.append(-data.actuator_force[0])
            if step > 300 and abs(forces[-1] - forces[-50]) < 0.005 * abs(forces[-1]):
                break
        time_s = process_time() - start
        law_n = law_n_per_m * -data.qpos[model.jnt("z").qposadr[0]]
        print(
            f"| {name} | {step + 1} | {1e3 * time_s / (step + 1):.2f} | {1e3 * time_s:.0f} | {forces[-1] / law_n:.2f} |"
        )


if __name__ == "__main__":
    main()
