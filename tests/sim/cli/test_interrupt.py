"""Ctrl-C is noted wherever it arrives, also where Python drops exceptions."""

import signal
import threading

import pytest

from sim.interrupt import NotedInterrupt


def press():
    signal.raise_signal(signal.SIGINT)


class Dropped:
    def __del__(self):
        press()  # an exception raised here would be printed and forgotten


def test_the_first_is_noted_even_in_a_finaliser_and_the_second_raises(capsys):
    before = signal.getsignal(signal.SIGINT)
    with NotedInterrupt() as interrupt:
        assert not interrupt.is_set
        thing = Dropped()
        del thing
        assert interrupt.is_set
        assert "Ctrl-C again" in capsys.readouterr().err
        with pytest.raises(KeyboardInterrupt):
            press()
    assert signal.getsignal(signal.SIGINT) is before


def test_a_request_to_end_is_noted_like_a_ctrl_c():
    before = signal.getsignal(signal.SIGTERM)
    with NotedInterrupt() as interrupt:
        signal.raise_signal(signal.SIGTERM)
        assert interrupt.is_set
    assert signal.getsignal(signal.SIGTERM) is before


def test_outside_the_main_thread_it_leaves_signals_alone():
    seen = []

    def body():
        with NotedInterrupt() as interrupt:
            seen.append(interrupt.is_set)

    before = signal.getsignal(signal.SIGINT)
    thread = threading.Thread(target=body)
    thread.start()
    thread.join()
    assert seen == [False]
    assert signal.getsignal(signal.SIGINT) is before
