"""Breathing: how far along its way the organ is at a time."""

from __future__ import annotations

import math

EXPONENT = 6
"""The exponent 2 n of the waveform. Lujan et al. (Medical Physics 26(5), 1999) take n = 3 for a liver: it rests at
exhale for longer than it stays at inhale."""
REST_SHARE = 0.02
"""A gated probe senses while the organ is within this share of its way from rest."""


def inhaled_share(time_s: float, breath_s: float) -> float:
    """How far the organ is from its rest at exhale, as a share of its way to full inhale.

    That is cos(pi t / T)^6, the waveform of Lujan et al. with rest at exhale; a breath begins at full inhale.

    Args:
        time_s: Time [s].
        breath_s: Seconds of a breath, T.
    """
    return math.cos(math.pi * time_s / breath_s) ** EXPONENT


def wait_for_rest_s(time_s: float, breath_s: float) -> float:
    """How long a probe waits until the organ rests at exhale [s]; 0 where it rests already.

    Args:
        time_s: Time [s].
        breath_s: Seconds of a breath.
    """
    # The organ rests where |cos| is below the sixth root of the share, about the middle of each breath.
    half_rest = math.asin(REST_SHARE ** (1.0 / EXPONENT)) / math.pi
    phase = (time_s / breath_s) % 1.0
    begin = 0.5 - half_rest
    if begin <= phase <= 0.5 + half_rest:
        return 0.0
    return ((begin - phase) % 1.0) * breath_s
