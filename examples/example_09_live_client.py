"""A probe of your own: a client of `sounding serve`, which goes where it is sent and reports what it sees there."""

import json
import sys
from typing import Any

import numpy as np
import pyigtl


def main() -> None:
    port, n_actions = (int(sys.argv[1]) if sys.argv[1:] else 18944), 4
    client = pyigtl.OpenIGTLinkClient(port=port)
    rng, lesion_ras_mm = np.random.default_rng(0), None
    decision = decided(client, 0)  # after more actions where a session goes on
    for _ in range(n_actions):
        T_ras_tip = received(client, "SoundingProposed").matrix  # RAS, millimetres
        # Your arm would bring the probe there now. This one is there already, and sees a cone of points.
        depth_mm = 100.0 * rng.random(800) ** (1 / 3)
        aside = rng.uniform(-0.2, 0.2, (800, 2)) * depth_mm[:, None]
        seen_ras_mm = np.column_stack([aside, depth_mm]) @ T_ras_tip[:3, :3].T + T_ras_tip[:3, 3]
        if lesion_ras_mm is None:  # your sensor would find it; here it lies 40 mm below the first contact
            lesion_ras_mm = T_ras_tip[:3, 3] + 40.0 * T_ras_tip[:3, 2]
        is_tumour = np.linalg.norm(seen_ras_mm - lesion_ras_mm, axis=1) < 12.0
        groups = ["tumour" if each else "free" for each in is_tumour]
        client.send_message(pyigtl.TransformMessage(T_ras_tip, device_name="Tip"))
        client.send_message(pyigtl.PointMessage(seen_ras_mm, groups=groups, device_name="Points"))
        pose, sure, n = decision["pose"], decision["confidence"], decision["sensed"] + 1
        print(f"action {n}: pose {pose}, {is_tumour.sum()} points of tumour, sure {sure:.0%}")
        decision = decided(client, n)
    print(f"{decision['sensed']} actions are in the map")
    client.stop()


def decided(client: pyigtl.OpenIGTLinkClient, n_sensed: int) -> dict:
    """What the planner decided after so many actions, or more."""
    while True:
        decision = json.loads(received(client, "SoundingDecision").string)
        if decision["sensed"] >= n_sensed:
            return decision


def received(client: pyigtl.OpenIGTLinkClient, name: str) -> Any:
    """The next message of a name."""
    message = client.wait_for_message(name, timeout=60)
    if message is None:
        raise SystemExit(f"no {name} came for a minute: is `sounding serve` listening on port {client.port}?")
    return message


if __name__ == "__main__":
    main()
