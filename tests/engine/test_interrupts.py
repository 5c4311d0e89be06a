"""Ctrl-C as a request: heard between parts of work, also by what runs within, and at once the second time."""

import signal
import threading

import pytest

from warpchain.progress import interruptible, look_for_stop


@pytest.fixture(autouse=True)
def handler():
    """Python's own handler, whatever ran before."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    assert signal.signal(signal.SIGINT, before) is signal.default_int_handler


def test_a_request_is_heard_within_and_around():
    with interruptible() as stop:
        with interruptible() as inner:
            look_for_stop()
            signal.raise_signal(signal.SIGINT)
            assert stop.asked and inner.asked
        with pytest.raises(KeyboardInterrupt):
            look_for_stop()
    look_for_stop()


def test_work_within_ends_alone_where_it_asks_itself():
    with interruptible() as stop, interruptible() as inner:
        inner.ask()
        assert inner.asked and not stop.asked
        look_for_stop()


def test_a_second_one_interrupts_at_once():
    with pytest.raises(KeyboardInterrupt), interruptible() as stop:
        signal.raise_signal(signal.SIGINT)
        assert stop.asked
        signal.raise_signal(signal.SIGINT)


def test_threads_hear_it_and_leave_signals_alone():
    heard = []

    def work():
        with interruptible() as stop:
            heard.append((signal.getsignal(signal.SIGINT), stop.asked))

    with interruptible() as stop:
        signal.raise_signal(signal.SIGINT)
        thread = threading.Thread(target=work)
        thread.start()
        thread.join()
        assert heard == [(stop, True)]


def test_a_signal_that_a_shell_has_ignored_stays_so():
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with interruptible() as stop:
        signal.raise_signal(signal.SIGINT)
        assert not stop.asked
    signal.signal(signal.SIGINT, signal.default_int_handler)
