"""Valve trains: energy, torque and float of cams and followers against closed forms."""

import math

import numpy as np
import pytest
from drives import ran, with_parts
from parts import gears, part, shaft

from warpchain import simulate

MASS, PRELOAD, STIFFNESS, LIFT, FLANK = 0.11, 177.0, 24.5e3, 0.0092, math.radians(60.0)


def group(on, shape="polynomial"):
    """Eight valves."""
    profile = {"shape": shape, "lift": LIFT, "rise": 60.0, "fall": 60.0}
    spring = {"preload": PRELOAD, "stiffness": STIFFNESS}
    phases = [0.0, 90.0, 180.0, 270.0]
    return part("valves", "valves", on=on, number=2, phases=phases, mass=MASS, spring=spring, profile=profile)


def cams(keys, shape="polynomial", **values):
    """Eight valves on a camshaft beside a chain at rest."""
    return with_parts(shaft("camshaft", **keys) + group("camshaft", shape), **values)


def free(speed):
    """Keys of a camshaft that nothing drives."""
    return {"inertia": 1.0e-3, "initial_speed": speed}


def polynomial(phi):
    """Lift and its derivatives of one valve, 4-5-6-7, at angles from where its cam begins [m]."""
    phi = np.mod(phi, math.tau)
    s, way = np.where(phi < FLANK, phi / FLANK, 2.0 - phi / FLANK), np.where(phi < FLANK, 1.0, -1.0)
    s = np.maximum(s, 0.0)
    lift = s**4 * (35.0 - 84.0 * s + 70.0 * s**2 - 20.0 * s**3)
    slope = 140.0 * s**3 * (1.0 - s) ** 3
    bend = 420.0 * s**2 * (1.0 - s) ** 2 * (1.0 - 2.0 * s)
    return LIFT * lift, LIFT * way * slope / FLANK, LIFT * bend / FLANK**2


@pytest.mark.parametrize(
    ("speed", "shape", "integrator", "turn"),
    [
        (250.0, "cycloid", "leapfrog", 1e-3),
        (400.0, "cosine", "leapfrog", 1e-3),
        (1200.0, "polynomial", "leapfrog", 1e-3),
        (1200.0, "polynomial", "rk4", 4e-3),
    ],
)
def test_a_free_camshaft_keeps_its_energy(speed, shape, integrator, turn):
    # 100 turns: J_e w^2 / 2 + sum (F_0 + k l / 2) l stays; a step turns it by `turn` [rad] at most
    turns, step = math.tau * 100.0 / speed, min(5e-6, turn / speed)
    drive = cams(free(speed), shape, duration=turns, step=step, integrator=integrator)
    row = ran(drive, rate=100.0)[1]
    assert abs(row["energy_change"]) < 1e-6 * 0.5 * 1e-3 * speed**2
    assert row["camshaft.speed_max"] > 1.01 * row["camshaft.speed_min"]
    assert row["camshaft.speed_mean"] == pytest.approx(speed, rel=0.05)


def test_its_speed_follows_the_energy(device):
    # w^2 (J + sum m l'^2) = 2 (E - V) at every angle, whatever came before
    drive = cams(free(300.0), duration=0.05)
    run, _ = ran(drive)
    angle, speed = np.asarray(run[0].shaft_angle)[:, 0], np.asarray(run[0].shaft_speed)[:, 0]
    inertia, energy = 1.0e-3, 0.0
    for phase in (0.0, 0.25, 0.5, 0.75):
        lift, slope, _ = polynomial(angle - phase * math.tau)
        inertia = inertia + 2.0 * MASS * slope**2
        energy = energy + 2.0 * (PRELOAD + 0.5 * STIFFNESS * lift) * lift
    total = 0.5 * inertia * speed**2 + energy
    assert total == pytest.approx(np.full_like(total, total[0]), rel=2e-5)  # of rows of half a degree


@pytest.mark.parametrize(("speed", "rows"), [(60.0, None), (300.0, None), (300.0, 360)])
def test_orders_of_the_torque(speed, rows):
    # against an FFT of the formula sum (F_0 + k l + m w^2 l'') l'; rows of half a degree leave 1e-7 of it, those of a
    # table of whole degrees 2^4 times as much, as orders of cubic splines are of fourth order
    duration, rate = math.tau / speed, 2.0**14 * speed / math.tau
    drive = cams({"prescribed": {"speed": speed}}, duration=1.001 * duration, step=1.0 / rate / 8.0)
    if rows is not None:
        angle = np.linspace(0.0, math.tau, rows + 1)
        table = {"angle": angle.tolist(), "lift": polynomial(angle)[0].tolist()}
        drive = drive.with_values({"valves.valves.profile": None, "valves.valves.table": table})
    run, row = ran(drive, rate=rate)
    torque = np.asarray(run[0].valve_torque)[: 2**14, 0]
    phi, formula = math.tau * np.arange(2**14) / 2.0**14, 0.0
    for phase in (0.0, 0.25, 0.5, 0.75):
        lift, slope, bend = polynomial(phi - phase * math.tau)
        formula = formula + 2.0 * (PRELOAD + STIFFNESS * lift + MASS * speed**2 * bend) * slope
    expected = np.abs(np.fft.rfft(formula))[:33] / 2**13
    found = np.abs(np.fft.rfft(torque))[:33] / 2**13
    assert found == pytest.approx(expected, abs=(1e-7 if rows is None else 1.6e-6) * expected.max())
    assert (np.flatnonzero(expected > 1e-6 * expected.max()) % 4 == 0).all()  # four cams a quarter turn apart
    assert row["valves.cam_torque_max"] == pytest.approx(formula.max(), rel=1e-3)


@pytest.mark.parametrize(("share", "floats"), [(0.995, False), (1.005, True)])
def test_the_speed_at_which_followers_lift_off(share, floats):
    # F_0 + k l + m w^2 l'' = 0 first at the least sqrt((F_0 + k l) / (-m l'')); rows of half a degree know it to 1e-3
    lift, _, bend = polynomial(np.linspace(0.0, 2.0 * FLANK, 100_001))
    limit = math.sqrt(((PRELOAD + STIFFNESS * lift)[bend < 0.0] / (-MASS * bend[bend < 0.0])).min())
    speed = share * limit
    drive = cams({"prescribed": {"speed": speed}}, duration=0.03)
    assert drive.valves[0].float_speed == pytest.approx(limit, rel=1e-3)
    run, row = ran(drive)
    least = (PRELOAD + STIFFNESS * lift + MASS * speed**2 * bend).min()
    assert row["valves.cam_force_min"] == pytest.approx(least, abs=3.0)
    assert (row["valves.valve_float"] > 0.0) == floats
    assert ("lift off" in row["reason"]) == floats


def test_geared_valves_are_those_of_one_shaft():
    # a geared inertia is rho^2 J without the gear, valves included: to round-off
    geared = with_parts(
        shaft("idler", inertia=4.0e-3, initial_speed=150.0)
        + shaft("camshaft", inertia=1.0e-3)
        + gears("pair", ["idler", "camshaft"], [40, 20], module=0.002)
        + group("camshaft"),
        duration=0.02,
    )
    alone = cams({"inertia": 2.0e-3, "initial_speed": 300.0}, duration=0.02)
    run, row = ran(geared, rate=1e5)
    mine = np.abs(np.asarray(run[0].shaft_speed)[:, 1])
    assert mine == pytest.approx(np.asarray(ran(alone, rate=1e5)[0][0].shaft_speed)[:, 0], rel=1e-11)
    # the gear passes on what turns the camshaft beside its valves, J w' + their torque; frames know w' to 2e-3
    turned, torque = np.gradient(mine, run[0].time), np.asarray(run[0].valve_torque)[:, 0]
    force = np.abs(1.0e-3 * turned + torque)[2:-2] / (0.02 * math.cos(math.radians(20.0)))
    assert row["pair.tooth_force_mean"] == pytest.approx(force.mean(), rel=5e-3)
    assert abs(row["energy_residual"]) < 1e-6 * 0.5 * 2e-3 * 300.0**2


def test_valves_turn_on_with_the_drive():
    # `run.phase` of half a tooth turns a camshaft of 20 teeth on by 9 degrees: as if its cams began 9 degrees sooner
    drive = with_parts(group("driven"), duration=0.002)
    rows = [
        ran(drive.with_values(values), rate=1e5)[0][0].valve_torque[0, 0]
        for values in ({"run.phase": 0.5}, {"valves.valves.phase": -9.0})
    ]
    assert rows[0] == pytest.approx(rows[1], rel=1e-12)
    assert abs(rows[0]) > 1.0


def test_unlike_valves_together():
    # whatever else is in the ensemble, a variant has the same bits
    drive = cams(free(300.0), duration=0.004)
    more = [
        {"valves.valves.profile.lift": 0.008, "valves.valves.spring.preload": 200.0},
        {"valves.valves.profile.rise": 70.0},
        {"valves.valves.phase": 10.0, "valves.valves.number": 1},
    ]
    drives = [drive, *(drive.with_values(values) for values in more)]
    together = simulate(drives, device="cpu").metrics
    for v, alone in enumerate(drives):
        own = simulate(alone, device="cpu").metrics
        for name in ("camshaft.speed_min", "valves.cam_torque_max", "valves.cam_force_min"):
            assert own[name][0].as_py() == together[name][v].as_py()
