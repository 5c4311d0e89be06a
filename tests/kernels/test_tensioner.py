"""The tensioner's physics against closed forms, on the numbers of the model's section on bodies."""

import math

import numpy as np
import pytest
import warp as wp
from own_kernels import kernel
from scipy.integrate import quad
from tensioner_rig import MODULUS, RELIEF, VENT, loaded, looked, moved, still, tensioner

from warpchain.kernels.physics.body import pose_with_heading
from warpchain.kernels.physics.tensioner import extension_and_rate, plunger_arm, tensioner_push
from warpchain.kernels.structs import Pose, Tensioner, TensionerState

PRESSURES = np.geomspace(1e3, 1e8, 40)
N = 1.4


def phi(p, t):
    """int dP/E."""
    air = t.air_share / (1.0 - t.air_share)
    return (p / MODULUS - air * (t.ambient / p) ** (1.0 / N)) / (1.0 + air)


def modulus(p, t):
    """E(P)."""
    air = t.air_share / (1.0 - t.air_share)
    soft = air * MODULUS / N * t.ambient ** (1.0 / N) * p ** (-1.0 - 1.0 / N)
    return MODULUS * (1.0 + air) / (1.0 + soft)


def sine(amplitude, frequency, cycles, steps):
    """Places of a sine from 0 on, and the time between them."""
    return amplitude * np.sin(2.0 * np.pi * np.arange(cycles * steps + 1) / steps), 1.0 / (frequency * steps)


# ---- the oil ----


@pytest.mark.parametrize("air", [0.0, 0.01, 0.1])
def test_compression_and_bulk_modulus_are_those_of_oil_with_air(air):
    t = tensioner(air=air)
    found = looked(t, PRESSURES)
    assert found[0] == pytest.approx(phi(PRESSURES, t), abs=1e-14)  # round-off of z^7
    assert found[2] == pytest.approx(modulus(PRESSURES, t), rel=1e-13)


@pytest.mark.parametrize("air", [0.0, 0.01])
def test_energy_of_the_oil_is_the_integral_over_its_compression(air):
    t = tensioner(air=air)

    def power(y):  # over y = ln p
        p = math.exp(y)
        return (p - t.ambient) * math.exp(-phi(p, t)) * p / modulus(p, t)

    wanted = [quad(power, math.log(t.ambient), math.log(p), epsrel=1e-13, limit=200)[0] for p in PRESSURES]
    # eight points of Gauss: exact up to z^15, u is about z^14; far below P_0 it is about z^-10, which is no power
    assert looked(t, PRESSURES)[1] == pytest.approx(np.array(wanted), rel=1e-6, abs=1e-9)
    assert looked(t, PRESSURES[4:])[1] == pytest.approx(np.array(wanted[4:]), rel=1e-8, abs=1e-9)


def test_the_pressure_is_found_from_any_other_one():
    t = tensioner()
    pairs = np.array([(p, near) for p in PRESSURES for near in PRESSURES])
    found = looked(t, pairs[:, 0], pairs[:, 1])[6]
    # the last step of Newton is below 1e-6 of z: its square, some tens of times over for the curve and P = z^7
    assert found == pytest.approx(pairs[:, 0], rel=1e-10)


@pytest.mark.parametrize("air", [0.0, 0.02])
def test_closed_in_it_is_a_spring_that_gives_back_what_it_took(air):
    t = still(5e5, air=air, leak=0.0, stiffness=0.0, preload=0.0)
    turn = 2.0 * np.pi * np.arange(4001) / 4000
    places = 1e-5 * np.cos(turn) - 1e-5
    got = moved(t, places, 1e-5)
    volume = 1e-6 + t.area * places
    # the mass V exp(phi) stays: where P is, phi is where it was and what ln V has changed since
    wanted = phi(5e5, t) - np.log(volume / volume[0])
    assert phi(got["pressure"], t) == pytest.approx(wanted, abs=1e-13)
    work = np.concatenate([[0.0], np.cumsum(-0.5 * (got["force"][1:] + got["force"][:-1]) * np.diff(places))])
    size = np.ptp(got["energy"])
    assert got["energy"] - got["energy"][0] == pytest.approx(work, abs=1e-5 * size)  # trapezoids of 4000: h^2
    assert got["energy"][-1] == pytest.approx(got["energy"][0], abs=1e-12 * size)


def test_it_boils_at_the_vapor_pressure_and_keeps_its_oil():
    t = still(3e5, leak=0.0, floor=0.02 ** (1 / 7))
    places = np.concatenate([np.linspace(0.0, 3e-3, 301), np.linspace(3e-3, 0.0, 301)])
    got = moved(t, places, 1e-5)
    assert got["pressure"].min() == pytest.approx(2e3, rel=1e-12)
    assert (got["pressure"] < 2.001e3).sum() > 300
    assert got["mass"] == pytest.approx(got["mass"][0], rel=1e-14)
    assert got["pressure"][-1] == pytest.approx(3e5, rel=1e-9)
    slack = (got["pressure"] < 2.001e3)[:300]  # out: at a constant pressure energy grows evenly
    growth = np.diff(got["energy"][:301])[slack]
    spring = 0.5 * 3500.0 * np.diff(places[:301] ** 2)[slack] - 90.0 * 1e-5
    assert growth[1:] == pytest.approx((1e5 - 2e3) * t.area * 1e-5 + spring[1:], rel=1e-9)


# ---- the flows ----


def test_the_valve_opens_lifts_and_passes_no_more_than_its_hole():
    t = tensioner()
    drops = np.array([0.0, 4e4, 0.0751 / t.check.hole_area, 7e4, 0.1499 / t.check.hole_area, 1e5, 2.9e5])
    found = looked(t, 3e5 - drops)
    lift = np.clip((drops * t.check.hole_area - 0.075) / 75.0, 0.0, 1e-3)
    assert found[5] == pytest.approx(lift, abs=1e-16)
    curtain = np.pi * lift * (6e-3 + lift * math.sqrt(2.0))  # 45 degrees: tan = 1, sin / cos^2 = sqrt(2)
    assert curtain[-1] / t.check.hole_area == pytest.approx(15.1, abs=0.05)  # at full lift: 15 holes
    with np.errstate(divide="ignore"):
        area = 1.0 / np.sqrt(1.0 / (0.2 * curtain) ** 2 + 1.0 / t.check.hole_area**2)
    assert found[3] == pytest.approx(area * np.sqrt(2.0 * drops / 800.0), rel=1e-12)
    assert (found[3] <= t.check.hole_area * np.sqrt(2.0 * drops / 800.0)).all()


def test_below_five_kilopascal_the_valve_is_laminar():
    t = tensioner(**{"check.preload": 0.0, "check.compliance": 1e6})  # wide open at any drop
    drops = np.array([10.0, 1e3, 4999.0, 5e3, 2e4])
    flow = looked(t, 3e5 - drops)[3]
    assert flow[:3] / drops[:3] == pytest.approx(flow[3] / 5e3, rel=1e-9)
    assert flow[4] == pytest.approx(2.0 * flow[3], rel=1e-12)  # a root: four times the drop


@pytest.mark.parametrize("valve", [{}, {"check.preload": 0.0, "check.compliance": 1e6}, {"check.preload": 0.0}])
def test_the_valve_s_slope_is_the_derivative_of_its_flow(valve):
    t = tensioner(**valve)
    at = 3e5 - np.array([1e3, 4e3, 6e3, 3e4, 6e4, 8e4, 1.5e5])
    ahead, behind = looked(t, at + 0.1)[3], looked(t, at - 0.1)[3]
    # differences over 0.2 Pa round at 1e-16 of the flow each
    assert looked(t, at)[4] == pytest.approx((ahead - behind) / 0.2, rel=1e-6, abs=1e-16)


@pytest.mark.parametrize(("drag", "tolerance"), [(0.0, 1e-6), (None, 1e-6)])
def test_leak_down_under_a_constant_load(drag, tolerance):
    values = {"stiffness": 0.0, "preload": 90.0} | ({"drag": drag} if drag is not None else {})
    t = tensioner(**values)
    h = 1e-5
    got = loaded(t, np.full(6000, 1000.0), h)
    rate = (got["x"][-1] - got["x"][-1001]) / (1000 * h)
    # (P - P_0) A = F - F_spring, A x' = -G (P - P_0) - drag x'; the swing of the start is gone by e^-20
    assert rate == pytest.approx(-t.leak * (1000.0 - 90.0) / (t.area * (t.area + t.drag)), rel=tolerance)
    # what the plunger drags back in makes up 0.6 % of it: 2 h / d
    assert rate == pytest.approx(-t.leak * 910.0 / t.area**2, rel=0.0063 if drag is None else 1e-6)


def test_it_damps_by_a_square_over_g_inwards_and_hardly_outwards():
    t = tensioner(stiffness=0.0, drag=0.0)
    h, speed = 1e-5, 0.01
    inwards = moved(t, -speed * h * np.arange(4001), h)["force"][-1] - 90.0
    assert inwards == pytest.approx(t.area**2 / t.leak * speed, rel=1e-4)  # 156 N; the start is gone by e^-20
    outwards = moved(t, speed * h * np.arange(4001), h)["force"]
    resting = 90.0 + (t.rest - t.ambient) * t.area
    assert 0.0 < resting - outwards[-1] < 0.01 * inwards  # 0.7 N: the valve opens by another 3 kPa


@pytest.mark.parametrize("air", [0.0, 0.001])
@pytest.mark.parametrize("cycles", [0.1, 1.0, 10.0])
def test_small_motion_is_a_maxwell_element(air, cycles):
    t = still(1e5, air=air, stiffness=0.0, volume=1e-6)
    spring = modulus(1e5, t) * t.area**2 / t.volume
    relaxation = t.volume / (modulus(1e5, t) * t.leak)
    omega, steps = cycles / relaxation, 4000
    amplitude = 1.0 / (spring / t.area)  # of 1 Pa at most: 1e-5 of P_0
    places, h = sine(amplitude, omega / (2.0 * np.pi), 12, steps)
    force = moved(t, places, h)["force"][-steps:] - 90.0
    angle = 2.0 * np.pi * np.arange(1, steps + 1) / steps
    complex_stiffness = 2.0 * np.mean(force * np.exp(-1j * angle)) * 1j / amplitude
    wanted = -spring * 1j * cycles / (1.0 + 1j * cycles)
    # flows at the step's end: a phase of omega h / 2 = pi / 4000; the start's transient is below e^-7 at 10
    assert abs(complex_stiffness - wanted) < 2e-3 * abs(wanted)


@pytest.mark.parametrize("h", [1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-1])
def test_the_pressure_falls_evenly_at_any_step(h):
    """Pressed in at once and held: P falls to where the valve feeds the leak, without swinging past it."""
    t = tensioner()
    places = np.full(2001, -1e-5)
    places[0] = 0.0
    pressure = moved(t, places, h)["pressure"][1:]
    assert pressure[0] > t.rest
    assert (np.diff(pressure) <= 1e-4).all()  # what Newton's method leaves: 1e-9 of P at most
    assert (pressure >= t.rest - 1e-4).all()


def test_the_pressure_after_a_given_time_comes_nearer_with_the_step():
    """First order: the error halves with the step."""
    t, after = tensioner(), []
    for steps in (100, 200, 400, 800, 1600):
        places = np.full(steps + 1, -1e-5)
        places[0] = 0.0
        after.append(moved(t, places, 1e-3 / steps)["pressure"][-1])
    errors = np.diff(after)
    assert errors[:-1] / errors[1:] == pytest.approx(2.0, abs=0.1)


def relief_flow(pressure, t):
    """Of a disk over a hole of 2 mm, by hand: set at 5 bar, 20 N/mm, C_d = 0.6 of the gap, at most 0.3 mm."""
    hole = math.pi * 1e-3**2
    lift = np.clip((pressure - 5e5) * hole / 2e4, 0.0, 3e-4)
    curtain = 0.6 * math.pi * 2e-3 * lift
    with np.errstate(divide="ignore"):
        area = 1.0 / np.sqrt(1.0 / curtain**2 + 1.0 / hole**2)
    return area * np.sqrt(2.0 * (pressure - t.ambient) / t.density)


@pytest.mark.parametrize("speed", [0.002, 0.05, 0.5])
def test_a_relief_valve_lets_out_what_the_plunger_displaces(speed):
    """Pressed in at a constant speed until P stays: A v = Q_leak + Q_relief; shut below 5 bar, at 0.5 m/s wide open."""
    way, h = speed * 2e-6 * np.arange(30001), 2e-6
    t = tensioner(drag=0.0, bottom=-1.0, volume=1e-6 + 2.1e-4 * way[-1], **RELIEF)
    got = moved(t, -way, h)
    pressure, flow = got["pressure"][-1], got["relieved"][-1] / h
    assert flow == pytest.approx(relief_flow(pressure, t), rel=1e-9, abs=1e-16)
    assert (flow > 0.0) == (pressure > 5e5) == (speed > 0.002)
    assert (pressure > 5e5 + 3e-4 * 2e4 / t.relief.hole_area) == (speed == 0.5)
    # nothing is stored once P stays, as it does after some V / (E G) of up to 1 ms
    assert got["leaked"][-1] / h + flow == pytest.approx(t.area * speed, rel=1e-4)


def test_a_vent_passes_its_jet_and_nothing_in():
    t, h = tensioner(**VENT), 1e-5
    area = 0.6 * math.pi * 1e-4**2
    drops = np.array([1e3, 1e5, 1e7])
    large = [still(1e5 + drop, leak=0.0, volume=1e3, **VENT) for drop in drops]  # P stays
    vented = np.array([moved(t, [0.0, 0.0], h)["vented"][1] for t in large])
    limit = np.maximum(drops, 5e3)
    assert vented / h == pytest.approx(area * np.sqrt(2.0 * limit / t.density) * drops / limit, rel=1e-9)
    out = moved(t, 1e-3 * np.arange(11), 1e-3)  # pulled out by 1 m/s: below the ambient pressure
    assert out["pressure"][-1] < 1e5 and out["vented"][-1] == 0.0


DRY = {"drained": 1.0, "rest": 1e5}
"""A chamber full of air, at the pressure of the air around."""


def filling_flow(t):
    """Q_cv into air [m^3/s]: the ball lifted by its drop of P_s - P_0, or all the way, and the hole in series."""
    drop = t.supply - t.ambient
    lift = min((drop * t.check.hole_area - t.check.preload) * t.check.compliance, t.check.lift_max)
    curtain = 0.2 * math.pi * lift * (6e-3 + lift * math.sqrt(2.0))
    return math.sqrt(2.0 * drop / t.density / (1.0 / curtain**2 + 1.0 / t.check.hole_area**2))


@pytest.mark.parametrize("drained", [1.0, 0.5])
def test_a_drained_chamber_fills_at_the_flow_of_its_valve(drained):
    """A still plunger: P_0 until drained V_0 / Q_cv(P_0), and the pressure at rest soon after."""
    t = tensioner(**DRY | {"drained": drained})
    time, h = drained * 1e-6 / filling_flow(t), 1e-6
    got = moved(t, np.zeros(200_001), h)
    assert time < 0.12
    found = got["filling"].sum()
    # the step in which it fills counts whole; at its end P is above P_0
    assert found == pytest.approx(time, abs=2.0 * h + 1e-6 * time * (drained == 1.0))
    empty = got["unfilled"] > 0.0
    assert (got["pressure"][empty] == 1e5).all() and (got["leaked"][empty] == 0.0).all()
    assert (np.diff(empty[1:].astype(int)) <= 0).all() and not empty[-1]
    assert got["pressure"][-1] == pytest.approx(250824.87602763646, rel=1e-6)


def test_a_drained_tensioner_is_its_spring():
    """Air passes freely in and out, and takes no energy: the force is the spring's, to the bit, while it fills."""
    places, h = sine(2e-4, 100.0, 1, 2000)
    got = moved(tensioner(**DRY), places, h)
    empty = np.flatnonzero(got["unfilled"])
    assert len(empty) > 100
    assert got["force"][empty] == pytest.approx(90.0 - 3500.0 * places[empty], rel=1e-14)
    assert got["valve_loss"][empty] == pytest.approx(got["work"][empty])


def test_oil_that_fills_a_drained_chamber_is_conserved_and_balanced():
    t = tensioner(**DRY)
    places, h = sine(2e-4, 100.0, 20, 2000)
    got = moved(t, places, h)
    assert got["unfilled"][1] == 1.0 and got["unfilled"][-1] == 0.0 and got["pressure"].max() > 2e6
    density = np.exp(phi(got["pressure"], t))
    gained = np.cumsum(density * (got["supplied"] - got["leaked"]))
    assert got["mass"] - got["mass"][0] == pytest.approx(gained, abs=1e-12 * got["mass"][-1])
    work = -np.sum(0.5 * (got["force"][1:] + got["force"][:-1]) * np.diff(places))
    left = work + got["work"].sum() - (got["energy"][-1] - got["energy"][0])
    # of the second order in the step, but for the one step in which it fills
    assert abs(left - got["leak_loss"].sum() - got["valve_loss"].sum()) < 1e-4 * work


def test_at_rest_it_stays():
    got = moved(tensioner(), np.zeros(1001), 1e-4)
    assert got["pressure"] == pytest.approx(got["pressure"][0], rel=1e-10)
    assert got["supplied"][1:] == pytest.approx(got["leaked"][1:], rel=1e-7)  # a flow of 3.9e-7 by 5 Pa of 5e4


@pytest.mark.parametrize("outlets", [{}, RELIEF | VENT])
def test_oil_is_conserved(outlets):
    t = tensioner(floor=0.2 ** (1 / 7), **outlets)
    places, h = sine(4e-4, 400.0, 5, 1000)
    got = moved(t, places, h)
    assert got["pressure"].min() == pytest.approx(2e4, rel=1e-12)  # it boils in every cycle
    density = np.exp(phi(got["pressure"], t))
    gained = np.cumsum(density * (got["supplied"] - got["leaked"] - got["relieved"] - got["vented"]))
    assert got["mass"] - got["mass"][0] == pytest.approx(gained, abs=1e-13 * got["mass"][0])
    # while there is no vapor, the mass is V exp(phi)
    full = got["pressure"] > 2.001e4
    filled = (1e-6 + t.area * places) * density
    assert got["mass"][full] == pytest.approx(filled[full], rel=1e-12)
    assert (got["mass"][~full] < filled[~full]).all()


# ---- energy ----


def balance(t, steps, frequency=100.0):
    """What work, supply, storage and losses of two cycles leave over, as a part of the work."""
    places, h = sine(2e-4, frequency, 2, steps)
    got = moved(t, places, h)
    work = -np.sum(0.5 * (got["force"][1:] + got["force"][:-1]) * np.diff(places))
    left = work + got["work"].sum() - (got["energy"][-1] - got["energy"][0])
    return (left - got["leak_loss"].sum() - got["valve_loss"].sum()) / work


@pytest.mark.parametrize("values", [{}, {"air": 0.05}, {"floor": 0.5 ** (1 / 7), "supply": 1.6e5}, RELIEF, VENT])
def test_work_and_supply_are_stored_or_lost(values):
    # flows happen between a step's two forces: what is left over is of the second order in the step
    coarse, fine = balance(tensioner(**values), 1000), balance(tensioner(**values), 4000)
    assert abs(coarse) < 1e-5
    assert abs(fine) < 0.2 * abs(coarse)


def test_losses_are_not_negative_but_for_what_the_plunger_drags():
    places, h = sine(2e-4, 100.0, 3, 2000)
    got = moved(tensioner(drag=0.0), places, h)
    assert (got["leak_loss"] >= 0.0).all() and (got["valve_loss"] >= 0.0).all()
    loss = got["leak_loss"].sum()
    assert loss == pytest.approx(moved(tensioner(), places, h)["leak_loss"].sum(), rel=0.01)  # 2 h / d = 0.6 %


# ---- spring, ratchet, body ----


def test_a_spring_pushes_and_never_pulls():
    t = Tensioner()
    t.direction, t.stiffness, t.preload, t.damping = wp.vec2d(1.0, 0.0), 1000.0, 20.0, 5.0
    places = np.array([0.0, 5e-3, 1e-2, 3e-2, 2.9e-2, 1e-2])
    got = moved(t, places, 1e-2)
    rate = np.diff(places, prepend=0.0) / 1e-2
    assert got["force"] == pytest.approx(np.maximum(0.0, np.maximum(20.0 - 1000.0 * places, 0.0) - 5.0 * rate))
    assert got["force"][3] == 0.0 and got["pressure"][0] == 0.0


@pytest.mark.parametrize("drag_out", [0.1, 1.0, 10.0])
def test_oil_never_pulls(drag_out):
    got = moved(tensioner(preload=10.0), 1e-3 * drag_out * np.linspace(0.0, 1.0, 201), 1e-5)
    assert (got["force"] >= 0.0).all()


@pytest.mark.parametrize("hydraulic", [0, 1])
def test_a_ratchet_lets_it_back_by_no_more_than_its_backlash(hydraulic):
    """Pushed out by 2.3 a and let go it comes back by 0.3 a + s, and by what the load presses the stop in."""
    pitch, backlash, push = 1e-3, 2e-4, 2e3
    t = tensioner(hydraulic=hydraulic, leak=1e-9, ratchet_pitch=pitch, backlash=backlash, stop_damping=2e3)
    got = loaded(t, np.full(20000, push), 1e-5, x=2.3 * pitch)
    others = 90.0 - 3500.0 * got["x"][-1] + (got["pressure"][-1] - t.ambient) * t.area  # spring and oil
    back = 0.3 * pitch + backlash + (push - others) / t.stop_stiffness
    assert got["x"][0] - got["x"][-1] == pytest.approx(back, abs=1e-8)


def test_a_ratchet_gets_no_tooth_further_than_it_was_pushed():
    pitch, backlash = 1e-3, 2e-4
    t = tensioner(hydraulic=0, ratchet_pitch=pitch, backlash=backlash)
    places = np.concatenate([np.linspace(0.0, 2.3e-3, 231), np.linspace(2.3e-3, 1.75e-3, 56)])
    got = moved(t, places, 1e-2)
    below = np.where(np.arange(287) < 231, 0.0, 2.0 * pitch - backlash - places)  # on the way out no stop
    assert got["force"] == pytest.approx(90.0 - 3500.0 * places + 1e7 * np.maximum(below, 0.0), abs=1e-6)
    assert got["force"][-1] > 500.0


def test_without_a_ratchet_it_stands_on_the_bottom_of_its_chamber():
    t = tensioner(leak=1e-8, stop_damping=2e3)
    got = loaded(t, np.full(20000, 3e3), 1e-5)
    spring = 90.0 - 3500.0 * got["x"][-1]
    assert got["x"][-1] == pytest.approx(-4.5e-3 - (3e3 - spring) / 1e7, abs=5e-5)
    assert np.abs(np.diff(got["x"][-1000:])).max() < 1e-9


@kernel
def touch(t: Tensioner, angle: wp.float64, out: wp.array[wp.vec2d]):
    body = Pose()
    body.center = wp.vec2d(wp.float64(1.0), wp.float64(2.0))
    body.velocity = wp.vec2d(wp.float64(0.1), wp.float64(0.2))
    body.speed = wp.float64(3.0)
    body = pose_with_heading(body, wp.cos(angle), wp.sin(angle))
    push = tensioner_push(body, True, TensionerState(), t)
    out[0] = plunger_arm(body, t)
    x, rate = extension_and_rate(body, t)
    out[1] = push.thrust
    out[2] = wp.vec2d(push.moment, rate)
    out[3] = wp.vec2d(push.extension, x)


def test_the_touched_point_moves_with_its_body_and_is_pushed():
    angle, point = 0.4, np.array([0.3, -0.1])
    t = Tensioner()  # a spring that pushes with 10 N wherever it is
    t.point, t.home, t.direction, t.preload = wp.vec2d(*point), wp.vec2d(1.2, 1.9), wp.vec2d(0.6, 0.8), 10.0
    out = wp.zeros(4, dtype=wp.vec2d, device="cpu")
    wp.launch(touch, dim=1, inputs=[t, angle, out], device="cpu")
    arm, force, (moment, rate), x = out.numpy()
    turned = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]) @ point
    assert arm == pytest.approx(turned)
    velocity = np.array([0.1, 0.2]) + 3.0 * np.array([-turned[1], turned[0]])
    assert rate == pytest.approx(velocity @ [0.6, 0.8])
    assert force == pytest.approx([6.0, 8.0])
    assert moment == pytest.approx(turned[0] * 8.0 - turned[1] * 6.0)
    assert x == pytest.approx([(np.array([1.0, 2.0]) + turned - [1.2, 1.9]) @ [0.6, 0.8]] * 2)
