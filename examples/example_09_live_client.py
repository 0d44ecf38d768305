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
    for action in range(n_actions):
        decision = decided(client, action)
        proposed: Any = client.wait_for_message("SoundingProposed", timeout=60)
        T_ras_tip = proposed.matrix  # RAS, millimetres
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
        sure = f"{decision['confidence']:.0%}"
        print(
            f"action {action + 1}: pose {decision['pose']}, {is_tumour.sum()} points of tumour, sure {sure}"
        )
    print(f"{decided(client, n_actions)['sensed']} actions are in the map")
    client.stop()


def decided(client: pyigtl.OpenIGTLinkClient, n_sensed: int) -> dict:
    """What the planner decided after so many actions."""
    while True:
        message: Any = client.wait_for_message("SoundingDecision", timeout=60)
        if (decision := json.loads(message.string))["sensed"] == n_sensed:
            return decision


if __name__ == "__main__":
    main()
