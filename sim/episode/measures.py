"""The measures of episodes."""

from __future__ import annotations

SENSED_GOAL = 0.95
"""The paper's measure of detection: the tumours count as detected when this share of their points was sensed."""
ACTION_SECONDS = ("plan_s", "ik_s", "move_s", "sense_s", "update_s")
"""Columns of the computing time of an action, which differs from run to run."""
