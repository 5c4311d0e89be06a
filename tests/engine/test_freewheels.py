"""Freewheels, backstops, brakes and centrifugal clutches: couplings that bear one sense, or what a speed allows."""

import math

import numpy as np
import pytest
from drives import STARTING, assert_alone_as_in_a_crowd, ran, with_parts
from parts import coupling, gears, shaft

from warpchain import Record
from warpchain.drive.laws import kelvin_voigt_rebound

FIRST, SECOND = 0.5, 0.3
"""Inertias of the two shafts [kg m^2]."""
REDUCED = 1.0 / (1.0 / FIRST + 1.0 / SECOND)
STIFF, DAMPED = {"stiffness": 3e4, "damping": 40.0}, 40.0 / (2.0 * math.sqrt(3e4 * REDUCED))
"""A coupling, and its damping ratio between the two."""


def two_shafts(link, first, second, more="", **values):
    """Two shafts with a coupling between them, beside a chain at rest."""
    shafts = shaft("a", inertia=FIRST, **first) + shaft("b", inertia=SECOND, **second)
    return with_parts(shafts + more + coupling("link", ["a", "b"], **link), **values)


def on_ground(link, **values):
    """A shaft with what is between it and the ground, beside a chain at rest."""
    duration = values.pop("duration")
    return with_parts(
        shaft("b", inertia=SECOND, **values) + coupling("link", ["ground", "b"], **link), duration=duration
    )


def speeds(run):
    """Speeds of the shafts."""
    return np.asarray(run[0].shaft_speed, float).T


def test_a_freewheel_is_overrun(device):
    # a is slowed down at T / Ja, while b runs on: no moment between them; leapfrog has that exactly
    drive = two_shafts(
        STIFF | {"freewheel": True},
        {"initial_speed": 10.0, "load": {"torque": 20.0}},
        {"initial_speed": 10.0},
        duration=0.1,
    )
    run, row = ran(drive)
    a, b = speeds(run)
    assert a == pytest.approx(10.0 - 20.0 * run[0].time / FIRST, rel=1e-9)
    assert b == pytest.approx(np.full_like(b, 10.0), rel=1e-12)
    assert (row["link.torque_min"], row["link.torque_max"]) == (0.0, 0.0)
    assert row["link.damping_loss"] == 0.0
    assert abs(row["energy_residual_relative"]) < 1e-9


@pytest.mark.parametrize("damping", [0.0, 10.0, 40.0])
def test_locking_gains_no_energy(device, damping):
    # a hits b at 6 rad/s: they part at e 6 rad/s, e that of a spring and a damper that only push (Kelvin and Voigt)
    link = STIFF | {"damping": damping, "freewheel": True}
    values = {"duration": 0.02, "step": 5e-7}  # half a step of the damper's first power is left out
    run, row = ran(two_shafts(link, {"initial_speed": 10.0}, {"initial_speed": 4.0}, **values))
    a, b = speeds(run)
    e = kelvin_voigt_rebound(damping / (2.0 * math.sqrt(3e4 * REDUCED)))
    assert b[-1] - a[-1] == pytest.approx(6.0 * e, rel=2e-3)
    assert FIRST * a + SECOND * b == pytest.approx(np.full_like(a, 10.0 * FIRST + 4.0 * SECOND), rel=1e-9)
    energy = 0.5 * (FIRST * a**2 + SECOND * b**2)
    assert (energy <= energy[0] * (1.0 + 1e-9)).all()
    assert row["link.damping_loss"] == pytest.approx(0.5 * REDUCED * 36.0 * (1.0 - e * e), rel=5e-3, abs=1e-3)
    assert row["link.torque_min"] >= 0.0
    assert abs(row["energy_residual_relative"]) < 1e-4


def test_a_freewheel_locks_where_it_is_driven(device):
    # a catches up at 5 Ja / T = 25 ms, then both gain T / (Ja + Jb), b by the moment Jb T / (Ja + Jb)
    run, row = ran(
        two_shafts(
            STIFF | {"freewheel": True},
            {"initial_speed": 0.0, "motor": {"torque": 100.0}},
            {"initial_speed": 5.0},
            duration=0.2,
        )
    )
    a, b = speeds(run)
    time, early = run[0].time, run[0].time < 0.025
    assert a[early] == pytest.approx(100.0 * time[early] / FIRST, rel=1e-9, abs=1e-9)
    assert b[early] == pytest.approx(np.full(early.sum(), 5.0), rel=1e-12)
    assert (a[-1], b[-1]) == pytest.approx((5.0 + 100.0 * 0.175 / (FIRST + SECOND),) * 2, rel=1e-3)
    assert run[0].coupling_torque[-1, 0] == pytest.approx(100.0 * SECOND / (FIRST + SECOND), rel=1e-3)
    assert abs(row["energy_residual_relative"]) < 1e-5


def test_a_freewheel_drives_forward_whatever_the_gears(device):
    # b turns the other way by the gear that c sees: the same moments and speeds, mirrored
    geared = gears("mesh", ["b", "c"], [20, 20]) + shaft("c", inertia=0.1)
    ratios = {"time": [0.0, 1.0], "ratio": [-2.0, -2.0]}
    link = STIFF | {"freewheel": True, "ratios": ratios}
    run, row = ran(two_shafts(link, {"initial_speed": 10.0}, {"initial_speed": 6.0}, geared, duration=0.05))
    a, b, _ = speeds(run)
    assert (a[0], b[0]) == (10.0, -6.0)
    assert (a[-1], b[-1]) == (10.0, -6.0)  # b overruns: 10 rad/s drive it at 5
    run, row = ran(two_shafts(link, {"initial_speed": 14.0}, {"initial_speed": 6.0}, geared, duration=0.05))
    a, b, _ = speeds(run)
    assert row["link.torque_max"] > 10.0 and row["link.torque_min"] >= 0.0
    assert a[-1] + 2.0 * b[-1] < 0.0


def test_a_backstop_holds_a_load(device):
    # the load stops b at 4 Jb / T = 24 ms and cannot turn it back: the backstop bears T, twisted by T / k
    run, row = ran(on_ground(STIFF | {"freewheel": True}, initial_speed=4.0, load={"torque": 50.0}, duration=0.2))
    (b,), time = speeds(run), run[0].time
    early = time < 0.0239
    assert b[early] == pytest.approx(4.0 - 50.0 * time[early] / SECOND, rel=1e-9)
    assert run[0].coupling_torque[early, 0] == pytest.approx(np.zeros(early.sum()), abs=1e-12)
    assert b[-1] == pytest.approx(0.0, abs=1e-3)
    assert run[0].coupling_torque[-1, 0] == pytest.approx(50.0, rel=1e-3)
    assert run[0].coupling_twist[-1, 0] == pytest.approx(50.0 / 3e4, rel=1e-3)
    assert abs(row["energy_residual_relative"]) < 1e-5


@pytest.mark.parametrize("integrator", ["leapfrog", "rk4"])
def test_a_brake_takes_the_energy(device, integrator):
    # C stops b at 10 Jb / C = 60 ms and then holds it; what slips takes Jb w^2 / 2 but for C^2 / 2k as the spring
    # is wound up, in the damper, and as much that it stores, which the damper takes at last
    drive = on_ground(STIFF | {"clutch": {"torque": 50.0}}, initial_speed=10.0, duration=0.2)
    run, row = ran(drive.with_values({"run.integrator": integrator}))
    (b,), time = speeds(run), run[0].time
    early = (time > 0.001) & (time < 0.059)
    assert np.diff(b[early]) / np.diff(time[early]) == pytest.approx(np.full(early.sum() - 1, -50.0 / SECOND), rel=1e-6)
    assert b[-1] == pytest.approx(0.0, abs=1e-3)
    assert row["link.slip_loss"] == pytest.approx(15.0 - 50.0**2 / 3e4, rel=1e-6)
    assert row["link.slip_loss"] + row["link.damping_loss"] == pytest.approx(15.0, rel=1e-5)
    assert abs(row["energy_residual_relative"]) < 1e-5


def test_a_brake_over_time(device):
    # let in from 20 to 40 ms: w = w0 - int C dt / Jb
    table = {"time": [0.0, 0.02, 0.04, 0.1], "torque": [0.0, 0.0, 60.0, 60.0]}
    run, row = ran(on_ground(STIFF | {"clutch": {"table": table}}, initial_speed=20.0, duration=0.08))
    (b,), time = speeds(run), run[0].time
    fine = np.linspace(0.0, 0.08, 8001)
    taken = np.concatenate(
        [[0.0], np.cumsum(np.diff(fine) * np.interp(0.5 * (fine[1:] + fine[:-1]), table["time"], table["torque"]))]
    )
    assert b == pytest.approx(20.0 - np.interp(time, fine, taken) / SECOND, rel=1e-4)
    assert abs(row["energy_residual_relative"]) < 1e-4


def test_a_brake_over_speed(device):
    # C = c w slows b down as w0 exp(-c t / Jb); the spring is wound up within 0.1 ms
    table = {"speed": [0.0, 100.0], "torque": [0.0, 200.0]}
    run, row = ran(
        on_ground({"stiffness": 1e6, "damping": 40.0, "clutch": {"table": table}}, initial_speed=20.0, duration=0.2)
    )
    (b,), time = speeds(run), run[0].time
    assert b == pytest.approx(20.0 * np.exp(-2.0 * time / SECOND), rel=2e-3)
    assert row["link.slip_loss"] == pytest.approx(0.5 * SECOND * (400.0 - b[-1] ** 2), rel=2e-3)
    assert abs(row["energy_residual_relative"]) < 1e-4


def test_a_centrifugal_clutch_engages_by_its_speed(device):
    # C = c (w_a - 40 rad/s): a falls to that as exp(-c t / Ja), and gives b what it has lost
    table = {"speed": [0.0, 40.0, 140.0], "torque": [0.0, 0.0, 200.0]}
    link = {"stiffness": 1e6, "damping": 40.0, "clutch": {"table": table}}
    run, row = ran(two_shafts(link, {"initial_speed": 60.0}, {"initial_speed": 0.0}, duration=0.1))
    a, b = speeds(run)
    assert a == pytest.approx(40.0 + 20.0 * np.exp(-2.0 * run[0].time / FIRST), rel=1e-3)
    assert FIRST * a + SECOND * b == pytest.approx(np.full_like(a, 60.0 * FIRST), rel=1e-9)
    lost = 0.5 * FIRST * (3600.0 - a[-1] ** 2) - 0.5 * SECOND * b[-1] ** 2
    assert row["link.slip_loss"] == pytest.approx(lost, rel=2e-3)
    assert abs(row["energy_residual_relative"]) < 1e-5
    # below its speed it passes nothing on
    run, row = ran(two_shafts(link, {"initial_speed": 39.0}, {"initial_speed": 0.0}, duration=0.02))
    assert speeds(run)[1].max() == 0.0


def test_a_clutch_takes_half_of_what_it_evens_out(device):
    # J w^2 / 2 of the reduced inertia, whatever the clutch bears
    for torque in (30.0, 90.0):
        link = STIFF | {"clutch": {"torque": torque}}
        run, row = ran(two_shafts(link, {"initial_speed": 10.0}, {"initial_speed": 0.0}, duration=0.5))
        lost = row["link.slip_loss"] + row["link.damping_loss"]
        assert lost == pytest.approx(0.5 * REDUCED * 100.0, rel=1e-3)
        assert abs(row["energy_residual_relative"]) < 1e-5


def mixed():
    """Drives of one kind with and without what is one-way, slips by its speed, or is on the ground."""
    plain = two_shafts(
        STIFF | {"clutch": {"torque": 60.0}}, {"initial_speed": 10.0}, {"initial_speed": 1.0}, duration=0.02
    )
    table = {"speed": [0.0, 20.0], "torque": [0.0, 100.0]}
    changes = (
        {"couplings.link.freewheel": True, "couplings.link.clutch": None},
        {"couplings.link.freewheel": True, "shafts.b.initial_speed": 12.0},
        {"couplings.link.clutch": {"table": table}},
        {"couplings.link.between": ["ground", "a"]},
        {"couplings.link.between": ["ground", "b"], "couplings.link.freewheel": True, "shafts.b.load": {"torque": 9.0}},
    )
    return [plain, *(plain.with_values(values) for values in changes)]


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_bits_alone_and_in_a_crowd(device, precision):
    options = {"record": Record(rate=2e3), "limits": STARTING, "precision": precision}
    crowd = assert_alone_as_in_a_crowd(mixed(), **options)
    ends = [tuple(crowd[v].shaft_speed[-1].tolist()) for v in range(6)]
    assert len(set(ends)) == 6
