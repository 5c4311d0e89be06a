"""Shafts, gears, couplings and motors beside a chain at rest, or turned by one, against closed forms."""

import math
import tomllib

import numpy as np
import pytest
from drives import STARTING, assert_alone_as_in_a_crowd, example, periods, ran, swing, two_sprockets, with_parts
from parts import coupling, gears, shaft

from warpchain import Drive, Record, dumps_drive, simulate
from warpchain.model import Model


def test_two_inertias_swing_on_a_coupling(device):
    # sqrt(k (1/Ja + 1/Jb)); leapfrog's own error is (w h)^2 / 24 = 3e-7 of it, frames find a crossing to 1e-6
    drive = with_parts(swing(), duration=0.06)
    run, row = ran(drive)
    omega = math.sqrt(3e5 * (1.0 / 0.5 + 1.0 / 0.3))
    found = periods(run[0].time, run[0].coupling_twist[:, 0])
    assert len(found) > 8
    assert found.mean() == pytest.approx(2.0 * math.pi / omega, rel=1e-5)
    assert row["link.twist_max"] == pytest.approx(2.0 / omega, rel=1e-3)
    assert abs(row["energy_residual"]) < 1e-6  # of 1 J


def test_lash_lengthens_the_period(device):
    # with the speed u = w A where the spring begins, A its greatest twist beyond the lash: 2 pi/w + 4 b/(w A)
    lash = 2e-3
    run, row = ran(with_parts(swing(lash=lash), duration=0.12))
    omega, speed = math.sqrt(3e5 * (1.0 / 0.5 + 1.0 / 0.3)), 2.0
    found = periods(run[0].time[200:], run[0].coupling_twist[200:, 0])
    assert len(found) > 4
    assert found.mean() == pytest.approx(2.0 * math.pi / omega + 4.0 * lash / speed, rel=1e-4)
    assert row["link.twist_max"] == pytest.approx(lash + speed / omega, rel=1e-3)
    assert row["link.torque_max"] == pytest.approx(3e5 * speed / omega, rel=1e-3)


def test_damper_of_a_coupling_takes_what_the_swing_loses(device):
    # the swing's energy is J u^2 / 2 of the reduced inertia; rk4 closes the balance to round-off of its order
    drive = with_parts(swing(damping=40.0), duration=0.1, integrator="rk4", step=5e-6)
    _, row = ran(drive)
    reduced, left = 1.0 / (1.0 / 0.5 + 1.0 / 0.3), math.exp(-40.0 * (1.0 / 0.5 + 1.0 / 0.3) * 0.1)
    assert row["link.damping_loss"] == pytest.approx(0.5 * reduced * 4.0 * (1.0 - left), rel=1e-3)
    assert abs(row["energy_residual"]) < 1e-6 * row["link.damping_loss"]


def motored(motor, **values):
    """A motor on a shaft of its own, beside a chain at rest."""
    return with_parts(shaft("free", inertia=0.5, motor=motor), **values)


def test_a_constant_moment_starts_an_inertia(device):
    # w = M t / J; leapfrog has it exactly
    run, row = ran(motored({"torque": 20.0}, duration=0.02))
    assert run[0].shaft_speed[:, 0] == pytest.approx(20.0 * run[0].time / 0.5, abs=1e-12)
    assert run[0].shaft_angle[:, 0] == pytest.approx(20.0 * run[0].time ** 2 / 1.0, rel=1e-4, abs=1e-8)
    assert row["free.motor_work"] == pytest.approx(0.5 * 0.5 * (20.0 * 0.02 / 0.5) ** 2, rel=1e-9)
    assert abs(row["energy_residual_relative"]) < 1e-9


@pytest.mark.parametrize(("integrator", "error"), [("leapfrog", 2e-6), ("rk4", 1e-10)])
def test_a_moment_against_a_viscous_load(device, integrator, error):
    # w = (M/c) (1 - exp(-c t/J)); leapfrog's drag is half a step late, c h / 2J = 4e-5 of the drag at first order
    text = shaft("free", inertia=0.5, motor={"torque": 20.0}, load={"viscous": 20.0})
    run, row = ran(with_parts(text, duration=0.05, integrator=integrator))
    expected = (1.0 - np.exp(-20.0 * run[0].time / 0.5)) * 20.0 / 20.0
    assert np.abs(run[0].shaft_speed[:, 0] - expected).max() < 50.0 * error
    assert row["output_work"] > 0.0
    assert abs(row["energy_residual_relative"]) < 1e-4 if integrator == "leapfrog" else 1e-9


def test_power_limits_the_moment(device):
    # from P / M on at constant power: w^2 = (P/M)^2 + 2 P (t - t1) / J
    run, _ = ran(motored({"torque": 20.0, "power": 10.0}, duration=0.05))
    start = 0.5 / 20.0 * 0.5
    after = run[0].time > start
    expected = np.sqrt(0.25 + 2.0 * 10.0 / 0.5 * (run[0].time[after] - start))
    assert run[0].shaft_speed[after, 0] == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize(
    ("table", "expected"),
    [
        ({"speed": [0.0, 1.0], "torque": [20.0, 0.0]}, lambda t: 1.0 - np.exp(-20.0 * t / 0.5)),
        ({"time": [0.0, 0.05], "torque": [0.0, 20.0]}, lambda t: 0.5 * 20.0 / 0.05 * t**2 / 0.5),
        ({"angle": [0.0, math.tau], "torque": [20.0, 20.0]}, lambda t: 20.0 * t / 0.5),
    ],
)
def test_tables_of_a_motor(device, table, expected):
    # linear tables, whose equations have closed solutions; the torque is half a step late over speed
    run, _ = ran(motored({"table": table}, duration=0.05))
    assert run[0].shaft_speed[:, 0] == pytest.approx(expected(run[0].time), abs=2e-4)


GEARED = (
    shaft("first", inertia=0.5, motor={"torque": 20.0})
    + shaft("second", inertia=0.9, load={"viscous": 3.0})
    + gears("pair", ["first", "second"], [20, 50])
)
ONE = shaft("first", inertia=0.644, motor={"torque": 20.0}, load={"viscous": 0.48})


def test_a_governor_keeps_a_speed(device):
    # T (1 + (w0 - w) / B) against b w: w goes to T (1 + w0 / B) / (b + T / B) as exp(-(b + T / B) t / J), once the
    # factor is below `most`; T over the angle, as of a rider's legs
    table = {"angle": [0.0, math.tau], "torque": [20.0, 20.0]}
    governor = {"speed": 6.0, "band": 3.0, "most": 2.0}
    load = {"viscous": 1.5}
    drive = with_parts(
        shaft("crank", inertia=0.4, motor={"table": table, "governor": governor}, load=load, initial_speed=4.0),
        duration=0.15,
    )
    run, row = ran(drive)
    end, rate = 20.0 * 3.0 / (1.5 + 20.0 / 3.0), (1.5 + 20.0 / 3.0) / 0.4
    assert run[0].shaft_speed[:, 0] == pytest.approx(end + (4.0 - end) * np.exp(-rate * run[0].time), rel=1e-5)
    assert abs(row["energy_residual_relative"]) < 1e-5
    # the factor is 2 below 3 rad/s, and 0 above 9: as by a constant moment, and by none
    for speed, factor in ((1.0, 2.0), (9.5, 0.0)):
        values = {"shafts.crank.initial_speed": speed, "shafts.crank.load": None, "run.duration": 0.005}
        run, _ = ran(drive.with_values(values))
        rise = factor * 20.0 / 0.4 * run[0].time
        assert run[0].shaft_speed[:, 0] == pytest.approx(speed + rise, rel=1e-9)


def test_a_geared_inertia_is_that_times_the_ratio_squared(device):
    # rho = -0.4: 0.5 + 0.16 * 0.9 = 0.644 and 0.16 * 3 = 0.48, to round-off
    geared, row = ran(with_parts(GEARED, duration=0.03))
    alone, other = ran(with_parts(ONE, duration=0.03))
    assert geared[0].shaft_speed[:, 0] == pytest.approx(alone[0].shaft_speed[:, 0], rel=1e-12)
    assert geared[0].shaft_speed[:, 1] == pytest.approx(-0.4 * alone[0].shaft_speed[:, 0], rel=1e-12)
    assert row["first.motor_work"] == pytest.approx(other["first.motor_work"], rel=1e-12)
    # the teeth pass on what speeds up the second shaft and its load: J2 alpha2 + c omega2
    speed = np.asarray(alone[0].shaft_speed[:, 0], float)
    passed = (0.9 * 0.4 * (20.0 - 0.48 * speed) / 0.644 + 3.0 * 0.4 * speed).max()
    assert row["pair.tooth_force_max"] == pytest.approx(passed / (0.1 * math.cos(math.radians(20.0))), rel=1e-4)
    assert row["pair.torque_mean"] < 0.0


def test_two_stages_turn_in_the_product_of_their_ratios(device):
    # z1 z3 / (z2 z4), backward twice: forward
    more = shaft("third", inertia=0.2) + gears("next", ["second", "third"], [17, 34])
    run, _ = ran(with_parts(GEARED + more, duration=0.01))
    speed = np.asarray(run[0].shaft_speed, float)
    assert speed[:, 2] == pytest.approx(speed[:, 0] * 20.0 * 17.0 / (50.0 * 34.0), rel=1e-12)


def test_a_prescribed_shaft_leads_its_train(device):
    motion = {"speed": 8.0, "ramp_time": 0.01, "harmonics": [{"order": 2.0, "amplitude": 0.1}]}
    pair = gears("pair", ["led", "follows"], [30, 20], internal=True)
    text = shaft("led", prescribed=motion) + shaft("follows", inertia=0.2) + pair
    run, row = ran(with_parts(text, duration=0.02))
    assert abs(row["energy_residual"]) < 1e-12  # nothing works: what leads both has no inertia to lead
    speed = np.asarray(run[0].shaft_speed, float)
    assert speed[-1, 0] > 6.0
    assert speed[:, 1] == pytest.approx(1.5 * speed[:, 0], rel=1e-12)


def test_a_sprocket_on_a_shaft_turns_as_one_with_it(device):
    # shaft and sprocket are one inertia of their sum: 0.5 + 1.5 = 2, bitwise, as are their moments
    alone = two_sprockets(torque=100.0, load_ramp=0.01, inertia=2.0, duration=0.01, settle="false")
    changed = alone.with_values(
        {"sprockets.driven.load": None, "sprockets.driven.inertia": 0.5, "sprockets.driven.shaft": "output"}
        | {"shafts": [{"name": "output", "inertia": 1.5, "load": {"torque": 100.0, "ramp_time": 0.01}}]}
    )
    first, row = ran(alone)
    second, other = ran(changed)
    assert second[0].sprocket_speed[:, 1] == pytest.approx(first[0].sprocket_speed[:, 1], rel=1e-9)
    assert (second[0].shaft_speed[:, 0] == second[0].sprocket_speed[:, 1]).all()
    for name in ("output_work", "input_work", "energy_residual", "tension_max"):
        assert other[name] == pytest.approx(row[name], rel=1e-6, abs=1e-9)


def conveyor(**values):
    """The first part of the conveyor's start."""

    return example("conveyor").with_values({"run.duration": 0.06, "run.settle": False} | values)


def test_a_variant_has_the_same_bits_alone_and_in_a_crowd():
    drives = [conveyor(**{"shafts.motor.motor.table.factor": factor}) for factor in (1.0, 0.8, 1.2)]
    drives.append(conveyor(**{"couplings.coupling.lash": 0.0}))
    crowd = assert_alone_as_in_a_crowd(drives, record=Record(rate=2e3), device="cpu", limits=STARTING)
    speeds = [float(crowd[v].shaft_speed[-1, 0]) for v in range(3)]
    assert speeds[1] < speeds[0] < speeds[2]


@pytest.mark.parametrize(("precision", "most"), [("float64", 2e-4), ("float32", 1e-3)])
def test_energy_of_a_started_conveyor(device, precision, most):
    # motor, gears, chain, contacts, friction, play and damper of the coupling, drum: all of the balance
    run = simulate(conveyor(), record=Record("none"), precision=precision, limits=STARTING)
    (row,) = run.metrics.to_pylist()
    assert abs(row["energy_residual_relative"]) < most
    assert row["coupling.damping_loss"] > 0.0 and row["motor.motor_work"] > row["output_work"]
    assert row["input_work"] == pytest.approx(row["motor.motor_work"], rel=1e-12)


def test_a_coupling_leads_its_shaft_where_the_other_is_prescribed(device):
    # the work of what prescribes the governor comes in through the coupling, and is all that comes in
    text = shaft("led", prescribed={"speed": 3.0}) + shaft("pulled", inertia=0.2, initial_speed=0.0)
    text += coupling("soft", ["led", "pulled"], 500.0, damping=2.0)
    _, row = ran(with_parts(text, duration=0.05, integrator="rk4", step=5e-6))
    assert row["input_work"] > 0.0
    assert abs(row["energy_residual"]) < 1e-6 * row["input_work"]


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_a_prescribed_motion_goes_back_and_forth(device, precision):
    # speeds of a triangle, their integral; backward beyond the start, where a table over angle goes on by its period
    time, speed = np.array([0.0, 0.04, 0.12, 0.16]), np.array([0.0, 4.0, -6.0, 0.0])
    load = {"angle": (0.0, 2.0, math.tau), "torque": (20.0, 80.0, 20.0)}
    changes = {"sprockets.driver.prescribed": {"table": {"time": tuple(time), "speed": tuple(speed)}}}
    drive = two_sprockets(damping=5e3).with_values(changes | {"sprockets.driven.load": {"table": load}})
    run = simulate(drive, device=device, precision=precision, duration=0.16, window=(0.0, 0.16))
    seen, row = run[0], run.metrics.to_pylist()[0]
    fine = np.linspace(0.0, 0.16, 160_001)
    turned = np.concatenate([[0.0], np.cumsum(np.interp(0.5 * (fine[1:] + fine[:-1]), time, speed)) * 1e-6])
    expected = np.interp(seen.time, fine, turned)
    assert expected.min() < -0.05 < 0.1 < expected.max()
    angle = seen.sprocket_angle - seen.sprocket_angle[0]
    assert angle[:, 0] == pytest.approx(expected, abs=1e-6)
    assert angle[:, 1] == pytest.approx(expected, abs=0.05)  # it swings on the chain
    assert abs(row["energy_residual_relative"]) < 1e-3
    assert row["driver.slips"] == row["driven.slips"] == 0


def test_a_drive_coasts_down(device):
    # nothing drives: what the flywheel loses goes into the load and the losses, all of it
    text = dumps_drive(two_sprockets(torque=0.0, viscous=40.0, duration=0.2))
    values = tomllib.loads(text + shaft("flywheel", inertia=20.0, initial_speed=10.0))
    del values["sprockets"][0]["prescribed"]
    values["sprockets"][0]["shaft"] = "flywheel"
    drive = Drive(**values)
    assert Model(drive).driver_speed == 10.0
    run, row = ran(drive, rate=2e3)
    speed = np.asarray(run[0].shaft_speed[:, 0], float)
    assert speed[0] == pytest.approx(10.0, rel=1e-6) and speed[-1] < 8.0
    assert (run[0].sprocket_speed[:, 0] == run[0].shaft_speed[:, 0]).all()
    assert row["input_work"] == 0.0
    assert row["energy_change"] == pytest.approx(-row["output_work"], rel=0.1)
    assert abs(row["energy_residual_relative"]) < 1e-3
