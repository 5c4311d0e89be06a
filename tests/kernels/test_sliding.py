"""Friction of rollers on guide-bars and teeth: rest, momenta, energy, the load along an arc, light partners."""

import numpy as np
import pytest
import raw
from drives import assert_same_frames, two_sprockets

from warpchain import Record, simulate
from warpchain.engine.struct_rows import tooth_effective_mass
from warpchain.model import single_chain

LINKS, PITCH, MASS, WEIGHT, RADIUS, CONTACT = 10, 0.05, 0.5, 9.81, 0.015, 1e6


def on_bar(mu, *, speed, steps, step=5e-5, **options):
    """A straight chain that glides along a guide-bar, pressed on it by its weight; its last link as long as all."""
    position = np.stack([PITCH * np.arange(LINKS), np.full(LINKS, RADIUS - MASS * WEIGHT / CONTACT)], axis=1)
    bar = {"start": (-10.0, 0.0), "end": (10.0, 0.0), "roller_radius": RADIUS, "stiffness": CONTACT, "friction": mu}
    packed = raw.chain(
        position, np.tile((speed, 0.0), (LINKS, 1)), mass=MASS, pitch=PITCH, stiffness=1e6, gravity=(0.0, -WEIGHT),
        guides=[bar], step=step, steps=steps, window=(0, steps), **options,
    )  # fmt: skip
    packed.lengths[-1] = (LINKS - 1) * PITCH
    return packed


@pytest.mark.parametrize("integrator", ["leapfrog", "rk4"])
def test_a_chain_on_a_guide_bar_slows_down_evenly_and_stops(integrator):
    # N = m g, so v = v0 - mu g t, exactly in both schemes; it stops after v0 / (mu g) = 2039 steps. Leapfrog's
    # velocities are half a step behind
    mu, speed, step = 0.2, 0.2, 5e-5
    engine, _ = raw.run(on_bar(mu, speed=speed, steps=1000, integrator=integrator))
    time = 1000 * step - (0.5 * step if integrator == "leapfrog" else 0.0)
    np.testing.assert_allclose(raw.state(engine)[2], speed - mu * WEIGHT * time, rtol=1e-9)
    engine, _ = raw.run(on_bar(mu, speed=speed, steps=2500, integrator=integrator))
    # below 2 mu g h it sticks, and what the bristle held decays by more than a half each two steps
    assert np.abs(raw.state(engine)[2]).max() < 1e-12
    sums = engine.sums()["contact"][0]
    # to what is dissipated, the last few steps add some (mu g h / v0)^2 = 2e-7, rk4's quadrature over them more
    lost = 0.5 * LINKS * MASS * speed**2
    assert sums["friction"] == pytest.approx(lost, rel=1e-3 if integrator == "rk4" else 1e-6)
    assert sums["dissipated"] == pytest.approx(0.0, abs=1e-9 * lost)


def test_energy_lost_is_what_friction_took_where_speeds_change_fast():
    # a step takes 2 % of the speed away: with the speed before it alone the power would be 1 % too large; the mean of
    # before and after is exact for the chain, which loses and keeps kinetic energy only. Of the first, half step, the
    # mean is a quarter of a step off: (1/4) (0.02)^2 of 50 steps' work, 2e-6
    packed = on_bar(0.2, speed=0.2, steps=25, step=2e-3)
    for rows in (packed.chains["stiffness"], packed.chains["outer_stiffness"], packed.guides["law"]["stiffness"]):
        rows[:] = 1e3
    packed.roller_rows(0)[1] = RADIUS - MASS * WEIGHT / 1e3
    engine, _ = raw.run(packed)
    sums = engine.sums()
    lost = sums["chain"][0]["energy_start"] - sums["chain"][0]["energy_end"]
    assert lost > 0.5 * 0.5 * LINKS * MASS * 0.2**2
    assert sums["contact"][0]["friction"] == pytest.approx(lost, rel=5e-4)


@pytest.mark.parametrize(("integrator", "mu"), [("leapfrog", 0.0), ("leapfrog", 0.3), ("rk4", 0.3)])
def test_angular_momentum_of_a_chain_and_a_free_sprocket(integrator, mu):
    # no gravity, no load: sum m r x v + J omega about the fixed center; leapfrog keeps it to rounding, rk4 to its
    # fourth order
    contact = {"friction": mu, "effective_mass": 0.5}
    packed = raw.struck_sprocket(step=2e-6, steps=20_000, integrator=integrator, **contact)
    before = raw.momenta(packed.roller_rows(0)[:4], packed.bodies[0])[2]
    engine, _ = raw.run(packed)
    after = raw.momenta(raw.state(engine), engine.state.bodies.numpy()[0])[2]
    sums = engine.sums()["contact"][0]
    assert sums["impacts"] > 10 and sums["dissipated"] > 0.0
    assert sums["friction"] > 0.01 * sums["dissipated"] if mu else sums["friction"] == 0.0
    assert after == pytest.approx(before, rel=1e-12 if integrator == "leapfrog" else 1e-7)


GUIDE = {"law": "lankarani-nikravesh", "restitution": 0.3, "impact_speed_floor": 0.02, "stiffness": 1e7}


def guided(mu, **options):
    """Two sprockets whose pulling strand a bar presses down, long enough for both its ends to lie on the strand."""
    drive = two_sprockets(**{"links": 80, "span": 30.003, "damping": 2e4, "speed": 6.0, "torque": 400.0} | options)
    bar = {"name": "bar", "start": [1.0, 0.158], "end": [0.5, 0.158], "end_radius": 0.3}
    return drive.with_values({"contact.guide": GUIDE | {"friction": mu}, "guides": [bar]})


@pytest.mark.usefixtures("device")
@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("integrator", ["leapfrog", "rk4"])
def test_the_energy_balance_has_friction_in_it(integrator, precision):
    # as small as without: some 1e-4 of the turnover at this step, from contacts that begin and end within one
    values = {"run.integrator": integrator, "run.step": 2e-6}
    bare = guided(0.0, duration=0.1).with_values(values)
    rubs = guided(0.2, duration=0.1).with_values(values | {"contact.sprocket.friction": 0.3})
    bare, rows = simulate([bare, rubs], record=Record(variants="none"), precision=precision).metrics.to_pylist()
    gone = {name: rows[f"{name}.friction"] for name in ("driver", "driven", "bar")}
    assert min(gone.values()) > 0.0 and bare["bar.friction"] is None
    assert sum(gone.values()) > 0.01 * abs(rows["input_work"])  # a hundred times the residual
    assert abs(rows["energy_residual_relative"]) < 2.0 * abs(bare["energy_residual_relative"]) + 1e-4


def test_no_friction_is_bitwise_the_drive_without():
    drive = two_sprockets(duration=2e-3)
    zero = {"contact.sprocket.friction": 0.0}
    bare, none = (simulate(d, device="cpu") for d in (drive, drive.with_values(zero)))
    assert_same_frames(bare[0], none[0])
    assert bare.metrics.equals(none.metrics)


def test_friction_power_of_a_guide_bar_is_the_tension_it_takes_times_the_chain_speed():
    # (T_out - T_in) v in the mean over whole tooth passings, after the start has died away; slowly, since transverse
    # waves carry power of their own past the bar: 2 % at 1.5 rad/s, up to 10 % at 6
    drive = guided(0.15, speed=1.5, duration=1.0, ramp=0.1)
    passing = 2 * np.pi / 20 / 1.5
    window = (1.0 - 3 * passing, 1.0)
    run = simulate(drive, device="cpu", record=Record(rate=4000.0), window=window)
    values, seen = run.metrics.to_pylist()[0], run[0].time >= window[0]
    x, y = np.moveaxis(0.5 * (run[0].position + np.roll(run[0].position, -1, axis=1)), -1, 0)
    tension, upper = run[0].tension, y > 0.1
    before, after = (tension[(seen[:, None]) & upper & (x > a) & (x < b)].mean() for a, b in ((1.15, 1.3), (0.2, 0.35)))
    power = values["bar.friction"] / (window[1] - window[0])
    assert power > 4.0 and values["bar.missed"] == 0
    assert (after - before) * 1.5 * single_chain(drive).pitch_radius(0) == pytest.approx(power, rel=0.03)


def arc_ratio(mu):
    """Tension ratio a tooth on the locked driver while the load grows, so that rollers slide outward on the flanks."""
    teeth, half_seat = 20, np.radians(100.0) / 2
    drive = two_sprockets(
        teeth=teeth, links=60, span=20.0 * (1 + 1e-6), torque=400.0, speed=0.0, damping=2e3, stiffness=5e6, contact=5e8,
        clearance=0.0, duration=0.5, seat_angle=100.0, restitution=0.1, inertia=1.0, mass=1.0, floor=0.5, step=2e-6,
        viscous=300.0, load_ramp=0.5,
    )  # fmt: skip
    drive = drive.with_values({"contact.sprocket.friction": mu} if mu else {})
    trajectory = simulate(drive, record=Record(rate=200.0))[0]
    phi = np.pi / 2 - half_seat - np.pi / teeth
    tension = trajectory.tension[-20:].mean(axis=0)
    force = trajectory.sprocket_force[-20:].mean(axis=0)
    on_driver = np.hypot(*trajectory.position[-1].T) < single_chain(drive).pitch_radius(0) * 1.02
    loaded = np.flatnonzero(on_driver & (force > 0.02 * force.max()))
    before, after = tension[loaded - 1], tension[loaded]
    low, high = np.minimum(before, after), np.maximum(before, after)
    ratios = (low / high)[high > 0.2 * tension.max()]
    assert len(ratios) >= 2
    return np.median(ratios), phi, 2 * np.pi / teeth


@pytest.mark.usefixtures("device")
@pytest.mark.parametrize("mu", [0.0, 0.1])
def test_friction_turns_the_pressure_angle_of_a_seated_arc(mu):
    # T_{i+1} / T_i = sin(phi') / sin(phi' + 2 pi / z): the contact force leans against the sliding by atan(mu), and
    # phi' = phi - atan(mu), as rollers are pulled out of their seats
    ratio, phi, alpha = arc_ratio(mu)
    leaning = phi - np.arctan(mu)
    assert ratio == pytest.approx(np.sin(leaning) / np.sin(leaning + alpha), rel=0.03)


@pytest.mark.parametrize("inertia", [1e-5, 2.0])
@pytest.mark.parametrize("mounted", [False, True])
def test_all_teeth_at_once_reverse_no_sliding(inertia, mounted):
    # z contacts anywhere along any direction: no mode of their sliding is stiffer than that of one on m_e
    values = {"sprockets.driven.inertia": inertia}
    if mounted:
        springs = {"kind": "elastic", "stiffness": [1e6, 1e6], "damping": [0.0, 0.0]}
        values |= {"sprockets.driven.mount": springs, "sprockets.driven.mass": 0.2}
        values |= {"sprockets.driven.balance_wheel": {"mass": 0.1, "radius": 0.05, "phase": 0.3}}
    drive = two_sprockets().with_values(values)
    effective_mass, rng = tooth_effective_mass(single_chain(drive), 1), np.random.default_rng(1)
    wheel, mass = (0.1 * 0.05, 0.3) if mounted else (0.0, np.inf)
    whole = inertia + (0.1 * 0.05**2 if mounted else 0.0)
    for _ in range(50):
        place, along, heading = rng.uniform(0, 2 * np.pi, (3, 20))
        arm = (single_chain(drive).pitch_radius(1) + single_chain(drive).engagement(1)) * np.array(
            [np.cos(place), np.sin(place)]
        )
        t = np.array([np.cos(along), np.sin(along)])
        rows = np.column_stack([*t, arm[0] * t[1] - arm[1] * t[0]])  # sliding speed of (vx, vy, omega)
        if mounted:
            q = wheel * np.array([-np.sin(heading[0]), np.cos(heading[0])])
            mobility = rows @ np.linalg.inv(np.array([[mass, 0, q[0]], [0, mass, q[1]], [*q, whole]])) @ rows.T
        else:
            mobility = np.outer(rows[:, 2], rows[:, 2]) / whole
        most = np.linalg.eigvalsh(np.eye(20) / drive.chain.mass + mobility).max()
        assert effective_mass * most <= 1 + 1e-9
    driver = tooth_effective_mass(single_chain(drive), 0)
    assert driver == pytest.approx(drive.chain.mass, rel=1e-15)  # which is led: nothing gives way
