"""Ctrl-C, SIGTERM and SIGHUP are answered when nothing is half done."""

import signal
import threading

import pytest

from sb3_piano.interrupts import ctrl_c_deferred, ended_as_by_ctrl_c, stop_on_signal


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_first_signal_is_a_request_and_the_second_raises(ctrl_c, number):
    former = signal.getsignal(number)
    with stop_on_signal() as request, stop_on_signal() as inner:
        assert inner is request
        signal.raise_signal(number)
        assert request.made
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(number)
    assert signal.getsignal(number) is former


def test_a_closed_terminal_is_a_request_however_often_it_tells_and_ignored_by_nohup():
    with stop_on_signal() as request:
        signal.raise_signal(signal.SIGHUP)
        signal.raise_signal(signal.SIGHUP)
        assert request.made
    with pytest.raises(KeyboardInterrupt), ended_as_by_ctrl_c():
        signal.raise_signal(signal.SIGHUP)
    former = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as nohup does
    try:
        with ended_as_by_ctrl_c(), stop_on_signal() as request:
            signal.raise_signal(signal.SIGHUP)
        assert not request.made
    finally:
        signal.signal(signal.SIGHUP, former)


def test_ctrl_c_is_put_off_to_the_end_of_a_block_or_ignored(ctrl_c):
    done = []

    def work():
        with ctrl_c_deferred():
            signal.raise_signal(signal.SIGINT)
            done.append("all of it")

    with pytest.raises(KeyboardInterrupt):
        work()
    assert done == ["all of it"]


def test_outside_the_main_thread_nothing_is_changed(ctrl_c):
    seen = []

    def work():
        with ctrl_c_deferred(), stop_on_signal() as inner:
            seen.append(inner)

    with stop_on_signal() as request:
        thread = threading.Thread(target=work)
        thread.start()
        thread.join()
        signal.raise_signal(signal.SIGINT)
        assert request.made
    assert seen[0] is not request
    assert not seen[0].made
