"""Modes of many drives at once: each as alone, in processes too; what is refused; studies."""

import numpy as np
import pytest
from drives import example, of_long, two_sprockets

from warpchain import modes
from warpchain.assembly import assemble, statics
from warpchain.engine import process_pool
from warpchain.errors import DriveError, SimulationError, WarpchainError
from warpchain.modal.eigenmodes import Modes
from warpchain.model import single_chain


@pytest.fixture
def at_once(monkeypatch):
    """Processes start for a single drive."""
    monkeypatch.setattr(process_pool, "FEWEST_THINGS", 1)


def taut(**options):
    """Two sprockets whose strands differ by the load."""
    return two_sprockets(**({"links": 58, "span": 19.03, "torque": 100.0} | options))


@pytest.mark.parametrize("workers", of_long(1, 2))
def test_each_of_many_is_as_alone(at_once, workers):
    """Drives of two kinds, running. Operations are the same; BLAS on another number of threads sums in another order,
    which moves an eigenvalue by rounding."""
    drives = [taut(inertia=1.0 + k) for k in range(3)] + [taut(teeth=18, links=56)]
    told = []
    found = modes(drives, 4, 5.0, workers=workers, progress=lambda *what: told.append(what))
    assert told == [("modes", k, 4) for k in (1, 2, 3, 4)]
    for drive, own in zip(drives, found, strict=True):
        alone = modes(drive, 4, 5.0)
        assert isinstance(own, Modes)
        assert own.drive is drive
        assert own.names == alone.names
        assert own.eigenvalue == pytest.approx(alone.eigenvalue, rel=1e-12)
        assert np.abs(own.shape) == pytest.approx(np.abs(alone.shape), abs=1e-9)


def test_what_one_drive_is_refused_for_costs_the_others_nothing(at_once):
    found = modes([taut(torque=1e6), taut(), taut(span=30.0)], 3, workers=2)
    assert isinstance(found[0], SimulationError)
    assert isinstance(found[1], Modes)
    assert isinstance(found[2], DriveError)
    assert all("\n" not in str(error) for error in found if isinstance(error, WarpchainError))


def test_no_drives_have_no_modes():
    assert modes([]) == []


def test_what_is_no_drive_is_refused():
    with pytest.raises(SimulationError, match="drives = 'car': must be"):
        modes("car")


@pytest.mark.parametrize("name", ["marine", "car"])
def test_the_search_for_rest_ends_at_rounding(name, monkeypatch):
    """Forces of 1e5 N are known to 1e-16 of the links' stiffness times places of 1 m: what is left of them cannot be
    less than some 1e-11. From 1e-6 of the largest, Newton's method with a shift that falls by 0.15 a step is whole
    after 8 steps, and each whole step squares what is left: it ends in a few more, not in the 400 that are allowed."""
    drive, steps = example(name), []
    solve = statics._Solver._solve
    monkeypatch.setattr(statics._Solver, "_solve", lambda *given: steps.append(1) or solve(*given))
    potentials, found = statics.equilibrium([single_chain(drive)], [0.0], [assemble(drive)])
    solver = statics._Solver(potentials, [assemble(drive)])
    all_steps = len(steps)
    assert solver.settle(found[0], statics._FINEST)[1] < 1e-10
    assert len(steps) - all_steps < 16
    assert all_steps < 120
