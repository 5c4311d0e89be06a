"""Modes of whole drives: against closed forms, and against runs in time."""

import numpy as np
import pytest
from drives import two_sprockets

from warpchain import load_drive
from warpchain.assembly.timestep import step_limit
from warpchain.drive.examples import drive_path
from warpchain.engine.cpu import CpuEngine
from warpchain.errors import SimulationError
from warpchain.modal.modes import modes, modes_of, system


def swung(found, result, chosen, cycles=2.5):
    """Frequencies [Hz] that a run shows when the standing drive is kicked along one mode at a time."""
    longest = cycles / result.frequency[chosen].min()
    step = 0.9 * step_limit(found.drive)
    packed = found.packed.taken([0] * len(chosen))
    packed.drives["step"], packed.drives["steps"] = step, 2**30
    packed.drives["window_start"] = packed.drives["window_end"] = 2**30
    vectors = []
    for v, k in enumerate(chosen):
        shape, bodies = result.shape[k].real, result.bodies[k].real
        size = 1e-8 * 2 * np.pi * result.frequency[k] / np.abs(shape).max()
        packed.rows(v)[2:4] = size * shape.T
        mine = slice(v * bodies.shape[0], (v + 1) * bodies.shape[0])
        packed.bodies["velocity"][mine], packed.bodies["speed"][mine] = size * bodies[:, :2], size * bodies[:, 2]
        vectors.append(shape.T / size)
    engine = CpuEngine(packed, 1)
    frames = engine.frame_buffer(1)
    rows = engine.state.rollers.numpy().reshape(len(chosen), 6, -1)
    start, every = rows[:, :2].copy(), int(1.0 / (40.0 * result.frequency[chosen].max() * step))
    times, found_at = [], []
    for n in range(int(longest / (every * step)) + 1):
        times.append(n * every * step)
        found_at.append([(vector * (row[:2] - at)).sum() for vector, row, at in zip(vectors, rows, start, strict=True)])
        for future in engine.advance(every, frames):
            future.result()
    engine.close()
    assert not engine.progress()["diverged"].any()
    times, signals = np.array(times), np.array(found_at).T
    return np.array([crossing_frequency(times, signal) for signal in signals])


def crossing_frequency(times, signal):
    """Frequency by the upward crossings of zero, the first at t = 0."""
    up = np.flatnonzero((signal[1:-1] <= 0.0) & (signal[2:] > 0.0)) + 1
    at = times[up] - signal[up] * (times[up + 1] - times[up]) / (signal[up + 1] - signal[up])
    return len(at) / at[-1]


@pytest.mark.parametrize(
    ("name", "chosen"), [("marine", [0, 4, 10, 16]), ("engine", [0, 6, 11, 18]), ("industrial", [0, 5, 12])]
)
def test_a_kicked_drive_swings_as_its_modes(name, chosen):
    """Within the 2 % that are asked for; a mode of 35 % damping turns its phase a little from one cycle to the next."""
    found = system(load_drive(drive_path(name)))
    result = modes_of(found, 20)
    damped = result.frequency * np.sqrt(1.0 - result.damping_ratio**2)
    assert np.allclose(swung(found, result, chosen), damped[chosen], rtol=0.02)


def test_a_driven_sprocket_between_two_strands():
    """R sqrt(k_1 + k_2) / (2 pi sqrt J), the strands' links in series with the seated rollers at both of their ends.

    From the roller seated last, the arc is a ladder of seats kappa and links k, whose stiffness without its first seat
    is (-kappa + sqrt(kappa^2 + 4 k kappa)) / 2. Without clearance a seat is a spring kappa in any direction. The chain's
    1 % of the sprocket's inertia, of which a third or so swings along, is what the sprocket lacks.
    """
    teeth, k, kappa, inertia = 40, 5e7, 2e8, 2000.0
    drive = two_sprockets(
        teeth=teeth, links=80, span=20.04, stiffness=k, contact=kappa, torque=0.0, inertia=inertia, clearance=0.0
    )
    result = modes(drive, 30)
    turning = [m for m in range(len(result)) if result.participation[m, 3] > 0.5]
    arc = 0.5 * (-kappa + np.sqrt(kappa**2 + 4.0 * k * kappa)) + kappa
    strand = 1.0 / (20.0 / k + 2.0 / arc)
    expected = drive.pitch_radius(1) * np.sqrt(2.0 * strand / inertia) / (2.0 * np.pi)
    assert result.frequency[turning[0]] == pytest.approx(expected, rel=0.01)


def test_shares_sum_to_one_and_shapes_are_of_unit_modal_mass():
    result = modes(two_sprockets(links=58, span=19.03, gravity=-9.81), 6)
    assert np.allclose(result.participation.sum(axis=1), 1.0)
    rollers = (np.abs(result.shape) ** 2).sum(axis=(1, 2))
    assert np.allclose(rollers + 2.0 * np.abs(result.bodies[:, 1, 2]) ** 2, 1.0)
    assert result.names[0].rpartition(" ")[0] in result.parts


def test_a_chain_without_tension_has_motions_that_nothing_restores():
    result = modes(two_sprockets(links=58, span=18.9, torque=0.0), 6)
    assert result.zeros > 0
    assert len(result) == 6
    assert result.frequency.min() > 0.1


def test_a_drive_that_does_not_settle_is_refused_in_one_line():
    with pytest.raises(SimulationError, match="does not settle") as caught:
        modes(two_sprockets(links=58, span=19.03, torque=1e6))
    assert "\n" not in str(caught.value)
