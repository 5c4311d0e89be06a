"""Gearboxes and clutches: couplings whose ratio changes in mid-run and that slip, against closed forms."""

import math

import numpy as np
import pytest
from drives import STARTING, assert_alone_as_in_a_crowd, ran, with_parts
from parts import coupling, shaft

from warpchain import Record, simulate
from warpchain.engine.checkpoint import States, VariantState

FIRST, SECOND = 0.5, 0.3
"""Inertias of the two shafts [kg m^2]."""


MOTORED = {"motor": {"torque": 90.0}, "initial_speed": 8.0}
"""A shaft that turns and is turned on."""


def two_shafts(link, first=None, second=None, **values):
    """Two shafts with a coupling between them, beside a chain at rest; the first turns at 10 rad/s unless it says."""
    first, second = first or {"initial_speed": 10.0}, second or {"initial_speed": 0.0}
    shafts = shaft("a", inertia=FIRST, **first) + shaft("b", inertia=SECOND, **second)
    return with_parts(shafts + coupling("link", ["a", "b"], **link), **values)


def speeds(run):
    """Speeds of both shafts."""
    return np.asarray(run[0].shaft_speed, float).T


CLUTCH = {"stiffness": 3e4, "damping": 5.0, "clutch": {"torque": 50.0}}


def test_a_clutch_slips_until_both_turn_alike(device):
    # c w = 50 N m from the start, so M = 50 N m until w - M (1/Ja + 1/Jb) t = 0 at 37.5 ms: leapfrog has that exactly
    run, row = ran(two_shafts(CLUTCH, duration=0.3))
    a, b = speeds(run)
    time = run[0].time
    slipping = time < 0.037
    assert a[slipping] == pytest.approx(10.0 - 50.0 * time[slipping] / FIRST, rel=1e-9)
    assert b[slipping] == pytest.approx(50.0 * time[slipping] / SECOND, rel=1e-9, abs=1e-9)
    assert (row["link.torque_max"], row["link.twist_max"]) == pytest.approx((50.0, 50.0 / 3e4), rel=1e-9)
    # then it sticks: both at the speed that the momentum gives, Ja w / (Ja + Jb), once 10 / s of swing have died away
    common, reduced = 10.0 * FIRST / (FIRST + SECOND), FIRST * SECOND / (FIRST + SECOND)
    assert (a[-1], b[-1]) == pytest.approx((common, common), rel=0.02)
    assert FIRST * a + SECOND * b == pytest.approx(np.full_like(a, 10.0 * FIRST), rel=1e-9)
    # what slips takes all of Jr w^2 / 2 but the spring's k d^2 / 2, which the swing's damper takes
    stored = 50.0**2 / (2.0 * 3e4)
    assert row["link.slip_loss"] == pytest.approx(0.5 * reduced * 100.0 - stored, rel=5e-3)
    assert abs(row["energy_residual_relative"]) < 1e-5


def test_a_clutch_bears_what_its_table_says(device):
    # let in against a shaft that stands: the torque is the table's as long as it slips, as the step's start has it
    table = {"time": [0.0, 0.005, 0.01, 0.02], "torque": [0.0, 0.0, 40.0, 10.0]}
    drive = two_shafts(CLUTCH | {"clutch": {"table": table}}, second={"prescribed": {"speed": 0.0}}, duration=0.02)
    run, row = ran(drive)
    expected = np.interp(run[0].time, table["time"], table["torque"])
    assert run[0].coupling_torque[:, 0] == pytest.approx(expected, abs=40.0 / 0.005 * 2e-6)
    work = np.trapezoid(expected * speeds(run)[0], run[0].time)
    assert row["link.slip_loss"] + row["link.damping_loss"] == pytest.approx(work, rel=1e-3)
    assert abs(row["energy_residual_relative"]) < 1e-4


def test_two_inertias_swing_over_a_gear(device):
    # sqrt(k (1/Ja + i^2/Jb)); leapfrog and the frames find crossings to 1e-5, as without a gear
    gear = {"stiffness": 3e5, "ratios": {"time": [0.0, 1.0], "ratio": [-2.5, -2.5]}}
    run, row = ran(two_shafts(gear, duration=0.06))
    time, twist = run[0].time, np.asarray(run[0].coupling_twist[:, 0], float)
    at = np.flatnonzero((twist[:-1] < 0.0) & (twist[1:] >= 0.0))
    crossing = time[at] - twist[at] * (time[at + 1] - time[at]) / (twist[at + 1] - twist[at])
    omega = math.sqrt(3e5 * (1.0 / FIRST + 6.25 / SECOND))
    assert len(at) > 20
    assert np.diff(crossing).mean() == pytest.approx(math.tau / omega, rel=1e-5)
    assert row["link.twist_max"] == pytest.approx(10.0 / omega, rel=2e-3)
    assert abs(row["energy_residual"]) < 1e-4 * 25.0


def change(ratio, **more):
    """A coupling whose gear opens at 40 ms and another one engages at 50 ms."""
    ratios = {"time": [0.0, 0.04, 0.05], "ratio": [-2.0, 0.0, ratio]}
    return {"stiffness": 3e4, "damping": 80.0, "ratios": ratios} | more


def test_a_gear_change(device):
    # accelerated by T, both as one: M = T / (1 + i^2 Ja/Jb) twists the spring, whose energy is lost as the gear opens
    drive = two_shafts(change(-1.5), first=MOTORED | {"initial_speed": 0.0}, duration=0.1)
    run, row = ran(drive)
    a, b = speeds(run)
    time, torque = run[0].time, run[0].coupling_torque[:, 0]
    passed = 90.0 / (1.0 + 4.0 * FIRST / SECOND)
    assert torque[time < 0.04][-1] == pytest.approx(passed, rel=1e-6)
    assert row["link.slip_loss"] == pytest.approx(passed**2 / (2.0 * 3e4), rel=1e-6)
    between = (time > 0.0401) & (time < 0.0499)
    assert (torque[between] == 0.0).all() and (run[0].coupling_twist[between, 0] == 0.0).all()
    assert np.ptp(b[between]) == 0.0
    assert np.diff(a[between]) == pytest.approx(90.0 * 1e-4 / FIRST, rel=1e-9)
    # i Ja wa + Jb wb grows by i T dt alone in the new gear, whatever the engagement costs, and then wa = i wb
    kept = -1.5 * FIRST * a + SECOND * b
    at = time > 0.0501
    assert kept[at] - kept[at][0] == pytest.approx(-1.5 * 90.0 * (time[at] - time[at][0]), rel=1e-9, abs=1e-9)
    assert a[-1] == pytest.approx(-1.5 * b[-1], rel=1e-6)
    # engaging two that turn by e' apart takes Jr e'^2 / 2, 1 / Jr = 1/Ja + i^2/Jb, half a step of its power left out
    i = np.flatnonzero(between)[-1]
    apart, reduced = a[i] + 90.0 * 1e-4 / FIRST + 1.5 * b[i], 1.0 / (1.0 / FIRST + 2.25 / SECOND)
    assert row["link.damping_loss"] > 0.5 * reduced * apart**2
    assert abs(row["energy_residual_relative"]) < 1e-3


@pytest.mark.parametrize("integrator", ["leapfrog", "rk4"])
def test_a_change_under_a_slipping_clutch(device, integrator):
    # the moment never exceeds what the clutch bears, and the balance closes with what engaging and slipping cost
    both = change(-0.5, lash=0.01, clutch={"torque": 60.0})
    drive = two_shafts(both, first=MOTORED, duration=0.15, integrator=integrator)
    run, row = ran(drive)
    a, b = speeds(run)
    assert max(row["link.torque_max"], -row["link.torque_min"]) <= 60.0 * (1.0 + 1e-12)
    assert row["link.slip_loss"] > 1.0
    kept = -0.5 * FIRST * a + SECOND * b
    at = run[0].time > 0.0501
    assert kept[at] - kept[at][0] == pytest.approx(-45.0 * (run[0].time[at] - run[0].time[at][0]), rel=1e-6, abs=1e-6)
    assert abs(row["energy_residual_relative"]) < 1e-4


def changes():
    """Gear changes that are unlike each other."""
    drives = [two_shafts(change(r, lash=0.01), first=MOTORED, duration=0.06) for r in (-1.5, 1.2)]
    clutch = {"couplings.link.clutch": {"torque": 60.0}}
    return [*drives, drives[0].with_values(clutch), drives[0].with_values({"couplings.link.ratios": None} | clutch)]


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_bits_alone_and_in_a_crowd(device, precision):
    options = {"record": Record(rate=2e3), "limits": STARTING, "precision": precision}
    crowd = assert_alone_as_in_a_crowd(changes(), **options)
    ends = [tuple(crowd[v].shaft_speed[-1].tolist()) for v in range(4)]
    assert len(set(ends)) == 4


def test_a_longer_run_goes_on_in_the_gear_that_is_in(device):
    # kept after the change: ratio, twist and slip are of the state
    step = 2.0**-18
    drives = [drive.with_values({"run.step": step}) for drive in changes()]
    same = {"step": None, "record": Record("none"), "limits": STARTING}
    short, on = States(), States()
    start, end = 8192 * step, 14000 * step  # the change is at 10486 and 13107
    simulate(drives, duration=end, window=(start, end), states=short, **same)
    on = States(begin=[VariantState.from_bytes(kept.to_bytes()) for kept in short.kept])
    longer = {"duration": 2.0 * end, "window": (start, 2.0 * end - start)}
    gone_on = simulate(drives, states=on, **longer, **same)
    assert on.used == [True] * 4
    whole = simulate(drives, **longer, **same)
    assert gone_on.metrics.to_pylist() == whole.metrics.to_pylist()
