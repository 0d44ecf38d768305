"""Rates and latencies of `sounding serve` in a process of its own, as a client on loopback sees them.

    .venv/bin/python -m benchmarks.live [--scenario liver sphere] [--steps 20] [--seed 0]

The client is another process. It senses the truth of a seed from each proposed pose, as a simulated one would,
sends the tip's pose and the reading, and waits for the next proposal. A latency runs from the last byte of the reading
that is sent to the first pose that follows from it, which comes ahead of the decision with its confidence. The rate is
that of the poses that arrive while the map learns. The processor time is all that the server spends on an action, which
other work on the machine hardly changes.
Each run has a fresh folder in the system's own for temporary files.
"""

from __future__ import annotations

import json
import os
import re
import socket
import subprocess
import sys
import tempfile
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from pathlib import Path
from time import perf_counter

import numpy as np
import pyigtl

from sim.episode.setup import Setup, build_setup
from sim.live.igtl.messages import DECISION, POINTS, PROPOSED, TIP
from sim.live.igtl.wire import WireSettings, receive
from sim.live.patient_frame import PatientFrame
from sim.live.simulated_probe import SimulatedProbe
from sim.running.fields import config_of
from sim.running.parts import EpisodeParts, make_parts

COARSE = "liver at 6 mm"
"""The liver with a lattice of 6 mm in place of 3 mm."""
COARSE_FILE = "cone_half_angle_rad = 0.2618\ncone_depth_m = 0.13\nscore_spacing_m = 0.006\n"


def main() -> None:
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--scenario", nargs="+", default=["liver", COARSE, "sphere"])
    parser.add_argument("--steps", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    print(
        "| scenario | reading to next pose [ms] | 95 % | to its decision [ms] | of which planning "
        "| processor time [ms] | poses arrive [Hz] | longest gap [ms] |\n|---|---|---|---|---|---|---|---|"
    )
    for scenario in arguments.scenario:
        with tempfile.TemporaryDirectory() as folder:
            print(row(scenario, Path(folder), arguments.seed, arguments.steps), flush=True)


def row(name: str, folder: Path, seed: int, n_steps: int) -> str:
    """A line of the table."""
    scenario = name
    if name == COARSE:
        (folder / "coarse.toml").write_text(COARSE_FILE)
        scenario = str(folder / "coarse.toml")
    parts = make_parts(config_of(scenario=scenario, arm="none", motion="none", seed=seed))
    setup = build_setup(parts.scenario, None, parts.map_settings)
    command = [sys.executable, "-m", "sim.cli", "serve", "--scenario", scenario, "--port", "0"]
    command += ["--seed", str(seed), "--out", str(folder / "session")]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        port = next(int(found[1]) for line in process.stdout if (found := re.search(r":(\d+) \(Open", line)))
        latency_s, decided_s, plan_s, gaps_s, cpu_s = measured(port, process.pid, parts, setup, n_steps)
    finally:
        process.kill()
        process.wait()
    median, most = (1e3 * np.quantile(latency_s, q) for q in (0.5, 0.95))
    decided = 1e3 * np.median(decided_s)
    cells = (
        median,
        most,
        decided,
        1e3 * np.median(plan_s),
        1e3 * cpu_s,
        1.0 / gaps_s.mean(),
        1e3 * gaps_s.max(),
    )
    return f"| {name} | {' | '.join(f'{each:.0f}' for each in cells)} |"


def processor_s(pid: int) -> float:
    """Processor time of a process so far [s], as Linux tells it."""
    words = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


def measured(
    port: int, pid: int, parts: EpisodeParts, setup: Setup, n_steps: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, float]:
    """Latencies of poses and decisions, planning times, gaps between poses, and processor time of an action [s]."""
    probe = SimulatedProbe(setup, parts.sensor, seed=parts.seed)
    frame, connection = PatientFrame(setup.T_world_organ), socket.create_connection(("127.0.0.1", port))
    connection.settimeout(0.2)
    latency_s, decided_s, plan_s, arrived_s = [], [], [], []
    gaps_s: list[float] = []
    sent_s, T_tip = 0.0, np.eye(4)
    n_sensed, begun_s, new_s = 0, 0.0, None
    while n_sensed <= n_steps:
        raw = receive(connection, WireSettings())
        now_s = perf_counter()
        if raw is None:
            continue
        if raw.device == PROPOSED:
            T_new = unpacked(raw).matrix
            if new_s is None and not np.array_equal(T_new, T_tip):
                new_s = now_s
            T_tip = T_new
            arrived_s.append(now_s)
        if raw.device != DECISION or (decision := json.loads(unpacked(raw).string))["sensed"] != n_sensed:
            continue
        begun_s = begun_s or processor_s(pid)
        # The proposal is sent just before the decision that tells of it.
        if n_sensed:
            decided_s.append(now_s - sent_s)
            # A pose that is proposed twice is not seen to be new.
            latency_s.append((now_s if new_s is None else new_s) - sent_s)
            plan_s.append(decision["plan_s"])
            gaps_s += np.diff(arrived_s).tolist()
        connection.sendall(sensed_bytes(probe, frame, T_tip))
        sent_s, arrived_s, new_s = perf_counter(), [], None
        n_sensed += 1
    connection.close()
    cpu_s = (processor_s(pid) - begun_s) / n_steps
    return np.array(latency_s), np.array(decided_s), np.array(plan_s), np.array(gaps_s), cpu_s


def sensed_bytes(probe: SimulatedProbe, frame: PatientFrame, T_tip: np.ndarray) -> bytes:
    """What a sensor sends that looked from a pose of the patient's frame [mm], shape (4, 4)."""
    reading = probe.sense(frame.pose_world_m(T_tip))
    groups = np.where(reading.is_occupied, "tumour", "free").tolist()
    points_mm = frame.points_ras_mm(reading.points_m)
    messages = [
        pyigtl.TransformMessage(T_tip, device_name=TIP),
        pyigtl.PointMessage(points_mm, groups=groups, device_name=POINTS),
    ]
    return b"".join(each.pack() for each in messages)


def unpacked(raw):
    """A message as pyigtl has it."""
    message = pyigtl.messages.MessageBase.create_message(raw.kind)
    fields = {"header_version": raw.version, "message_type": raw.kind, "device_name": raw.device}
    message.unpack(fields | {"timestamp": raw.stamp_s or 0.0}, raw.body)
    return message


if __name__ == "__main__":
    main()
