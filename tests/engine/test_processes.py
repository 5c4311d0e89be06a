"""Work in processes of its own: whose answers, in which order, and what comes of errors."""

import os
from functools import partial

import pytest

from warpchain.engine import process_pool
from warpchain.engine.process_pool import map_in_processes
from warpchain.errors import SimulationError


@pytest.fixture
def at_once(monkeypatch):
    """Processes start for a single thing."""
    monkeypatch.setattr(process_pool, "FEWEST_THINGS", 1)


def test_answers_come_in_order_and_errors_are_answers(at_once):
    done = []
    answers = map_in_processes(partial(divmod, 7), [3, 0, 2], 2, "dividing", lambda *told: done.append(told))
    assert answers[0] == (2, 1)
    assert isinstance(answers[1], ZeroDivisionError)
    assert answers[2] == (3, 1)
    assert done == [("dividing", k, 3) for k in (1, 2, 3)]


def test_many_things_go_to_others_and_few_stay_here():
    """A process's environment has the variable that this one's lacks."""
    assert map_in_processes(os.getenv, ["CUDA_VISIBLE_DEVICES"] * 3, 2) == [os.getenv("CUDA_VISIBLE_DEVICES")] * 3
    many = ["OPENBLAS_NUM_THREADS", "CUDA_VISIBLE_DEVICES"] * process_pool.FEWEST_THINGS
    assert map_in_processes(os.getenv, many, 2) == ["1", ""] * process_pool.FEWEST_THINGS


def test_a_process_that_dies_is_told_in_one_line(at_once):
    with pytest.raises(SimulationError, match=r"^a process ended before its work \(exit status 3\)$"):
        map_in_processes(os._exit, [3, 3], 2)
