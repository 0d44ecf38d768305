"""The trace of a sweep: only what was gone on the organ, in order, with the flights between two slides left out."""

from __future__ import annotations

import numpy as np

from sim.colours import trace_rgb
from sim.episode.moving.motion import Motion, Phase
from sim.episode.sweeping.contact_trace import trace_of, traces_of


def motion_of(phases: list[int]) -> Motion:
    """A motion along x, one state a second and a millimetre."""
    n = len(phases)
    tips_m = np.zeros((n, 3))
    tips_m[:, 0] = 1e-3 * np.arange(n)
    return Motion(
        time_s=np.arange(n, dtype=np.float64), states=np.zeros((n, 7)), tips_m=tips_m,
        phases=np.array(phases, dtype=np.int8), joint_travel_rad=None,
    )  # fmt: skip


def test_pieces_lie_on_the_organ_and_leave_flights_out() -> None:
    slide, flight = int(Phase.SWEEP), int(Phase.TRANSFER)
    trace = trace_of(motion_of([flight, slide, slide, slide, flight, flight, slide, slide, flight]))
    ways_mm = (1e3 * trace.pieces_m[:, :, 0]).round().astype(int).tolist()
    assert ways_mm == [[1, 2], [2, 3], [6, 7]]
    assert trace.end_s.tolist() == [2.0, 3.0, 7.0]


def test_a_long_slide_is_told_in_pieces_that_reach_its_end() -> None:
    trace = trace_of(motion_of([int(Phase.SWEEP)] * 1001), n_pieces=40)
    assert 35 <= len(trace.pieces_m) <= 41
    np.testing.assert_array_equal(trace.pieces_m[1:, 0], trace.pieces_m[:-1, 1])
    assert trace.pieces_m[-1, 1, 0] == 1.0
    assert np.diff(trace.end_s).min() > 0.0


def test_many_actions_are_told_in_few_pieces_each_to_their_ends() -> None:
    traces = traces_of([motion_of([int(Phase.SWEEP)] * 100)] * 300)
    assert sum(len(trace.pieces_m) for trace in traces) <= 1500
    assert {trace.pieces_m[-1, 1, 0] for trace in traces} == {0.099}


def test_a_flight_has_no_trace() -> None:
    assert len(trace_of(motion_of([0, 1, 1, 2, 3])).pieces_m) == 0


def test_the_colours_of_a_trace_brighten_all_the_way() -> None:
    # Relative luminance by the weights of ITU-R BT.709, which tells the colours apart without their hue.
    luminance = [np.dot(trace_rgb(share), (0.2126, 0.7152, 0.0722)) for share in np.linspace(0.0, 1.0, 21)]
    assert np.diff(luminance).min() > 0.0
