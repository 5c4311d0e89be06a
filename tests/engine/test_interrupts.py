"""Ctrl-C as a request: heard between parts of work, also by what runs within, and at once the second time."""

import signal
import threading

import pytest

from warpchain.progress import interruptible_work, raise_if_stopped


@pytest.fixture(autouse=True)
def handler():
    """Python's own handler, whatever ran before."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    assert signal.signal(signal.SIGINT, before) is signal.default_int_handler


def test_a_request_is_heard_within_and_around():
    with interruptible_work() as stop:
        with interruptible_work() as inner:
            raise_if_stopped()
            signal.raise_signal(signal.SIGINT)
            assert stop.is_asked and inner.is_asked
        with pytest.raises(KeyboardInterrupt):
            raise_if_stopped()
    raise_if_stopped()


def test_work_within_ends_alone_where_it_asks_itself():
    with interruptible_work() as stop, interruptible_work() as inner:
        inner.ask_to_stop()
        assert inner.is_asked and not stop.is_asked
        raise_if_stopped()


def test_a_second_one_interrupts_at_once():
    with pytest.raises(KeyboardInterrupt), interruptible_work() as stop:
        signal.raise_signal(signal.SIGINT)
        assert stop.is_asked
        signal.raise_signal(signal.SIGINT)


def test_threads_hear_it_and_leave_signals_alone():
    heard = []

    def work():
        with interruptible_work() as stop:
            heard.append((signal.getsignal(signal.SIGINT), stop.is_asked))

    with interruptible_work() as stop:
        signal.raise_signal(signal.SIGINT)
        thread = threading.Thread(target=work)
        thread.start()
        thread.join()
        assert heard == [(stop, True)]


def test_a_signal_that_a_shell_has_ignored_stays_so():
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with interruptible_work() as stop:
        signal.raise_signal(signal.SIGINT)
        assert not stop.is_asked
    signal.signal(signal.SIGINT, signal.default_int_handler)
