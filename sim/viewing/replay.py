"""A replay as text: what happened in a run, from its recorded states."""

from __future__ import annotations

import numpy as np

from sim.record.recording import Recording, set_state

AGREEMENT_M = 1e-6
"""Recorded tips and those of the recorded states agree to this, unless something was changed since."""


def replay_table(recording: Recording) -> str:
    """A table with a line per action: states, times, ways, and whether the states put the tip where it was recorded."""
    data = recording.scene.new_data()
    lines = [f"{'step':>5} {'states':>7} {'motion [s]':>10} {'tip [m]':>8} {'tip to pose [mm]':>17}  states"]
    for index, (step, motion) in enumerate(recording.motions.items()):
        worst_m = 0.0
        for state, tip_m in zip(motion.states, motion.tips_m, strict=True):
            set_state(recording.scene, data, state)
            worst_m = max(worst_m, float(np.linalg.norm(data.site(recording.scene.tip_site).xpos - tip_m)))
        agreement = "as recorded" if worst_m < AGREEMENT_M else f"off by up to {worst_m * 1e3:.3g} mm"
        gap = "–"
        if index < len(recording.sensed_m):
            # The pose lies in the organ, wherever that truly was.
            pose_m = recording.T_world_rest_sensed(step) @ np.append(recording.sensed_m[index], 1.0)
            gap_m = np.linalg.norm(motion.tips_m[-1] - pose_m[:3])
            gap = f"{gap_m * 1e3:.3f}"
        numbers = (
            f"{step:>5} {len(motion.states):>7} {motion.motion_s:>10.2f} {motion.tip_path_m:>8.3f} {gap:>17}"
        )
        lines.append(f"{numbers}  {agreement}")
    n, total = len(recording.motions), f"procedure {recording.duration_s:.1f} s"
    # A sweep's readings are within its motion.
    if recording.sensing_s > 0.0:
        total += f", of which sensing {n * recording.sensing_s:.1f} s"
    return "\n".join([*lines, f"{n} actions, {total}"])
