"""Moving sprockets and balance wheels against closed forms: vibration, momentum, the tensioner, energy."""

import numpy as np
import pytest
from drives import two_sprockets
from layouts import Placed, drive_of
from raw import chain, momenta, polygon, run, state, struck_sprocket

from warpchain import Record, read_archive, simulate, write_archive
from warpchain.assembly.arm_balance import chain_path
from warpchain.assembly.summary import derived_quantities, report
from warpchain.assembly.timestep import automatic_step, step_limit
from warpchain.kernels.physics.mount import FREE
from warpchain.model import single_chain

WHEEL = {"mass": 5.0, "radius": 0.1, "phase": 0.3}
ELASTIC = {"kind": "elastic", "stiffness": [2e7, 3e7], "damping": [2e3, 1e3], "preload": [5e3, 0.0]}
SLIDER = {"kind": "slider", "direction": [1.0, 0.2], "stiffness": 1e6, "damping": 3e3, "preload": 8e3}
MOVING = {"kind": "prescribed", "direction": [0.0, 2.0], "offset": 1e-4, "amplitude": 1e-3, "frequency": 30.0,
          "phase": 0.4}  # fmt: skip


def apart(step, steps, integrator, every=1):
    """A ring of rollers at rest and, far from it, a sprocket that no roller touches."""
    ring, _ = polygon(12, 0.1)
    wheel = {"teeth": 12, "stiffness": 1e8, "center": (10.0, 0.0), "inertia": 1.0}
    return chain(ring, 0 * ring, mass=1.0, pitch=0.1, stiffness=1e6, sprockets=[wheel], step=step, steps=steps,
                 integrator=integrator, frame_interval=every)  # fmt: skip


def on_springs(packed, *, mass, stiffness=(0.0, 0.0), damping=(0.0, 0.0), preload=(0.0, 0.0), gravity=(0.0, 0.0)):
    row = packed.mounts[0]
    row["active"], row["moves"], row["home"], row["mass"] = 1, FREE, packed.bodies[0]["center"], mass
    row["inverse_mass"], row["inertia"] = np.eye(2) / mass, 1.0 / packed.motions[0]["inverse_inertia"]
    row["stiffness"], row["damping"] = np.diag(stiffness), np.diag(damping)
    row["preload"], row["gravity"] = preload, gravity
    return row


@pytest.mark.parametrize(("integrator", "tolerance"), [("leapfrog", 4e-3), ("rk4", 1e-6)])
def test_free_vibration_of_a_mount_has_its_frequency_and_decay(integrator, tolerance):
    # x(t) = x_s (1 - e^(-zeta w t) (cos w_d t + zeta w / w_d sin w_d t)), x_s = (preload + M g) / k, on both axes;
    # leapfrog's damper lags half a step, which turns the phase by zeta w h / 2 = 3e-4 of a radian a radian, 19 in all
    mass, stiffness, damping = 20.0, np.array([2e6, 5e6]), np.array([600.0, 900.0])
    preload, gravity = np.array([4e3, 1e3]), np.array([0.0, -9.81])
    packed = apart(4e-5, 1500, integrator)
    on_springs(packed, mass=mass, stiffness=stiffness, damping=damping, preload=preload, gravity=gravity)
    _, frames = run(packed)
    time = 4e-5 * np.arange(1501)[:, None]
    rest = (preload + mass * gravity) / stiffness
    decay, omega = damping / (2 * mass), np.sqrt(stiffness / mass - (damping / (2 * mass)) ** 2)
    expected = rest * (1 - np.exp(-decay * time) * (np.cos(omega * time) + decay / omega * np.sin(omega * time)))
    travel = frames[:, -2:] - (10.0, 0.0)
    assert (omega * time[-1]).min() > 3 * 2 * np.pi  # three periods and more
    np.testing.assert_allclose(travel, expected, rtol=0, atol=tolerance * np.abs(rest).max())


@pytest.mark.parametrize("turning", [0.0, 30.0])
def test_free_eccentric_wheel_turns_about_its_center_of_mass(turning):
    # no springs, no gravity: the center of mass m_b / (m_s + m_b) of the arm away moves straight on, and the spin
    # about it is constant: exact for rk4 but for h^4
    packed = apart(1e-4, 4000, "rk4", every=4000)
    row = on_springs(packed, mass=8.0)
    row["wheel"][0], row["inertia"] = 3.0 * 0.2, 1.0 + 3.0 * 0.2**2
    packed.bodies[0]["speed"], packed.bodies[0]["velocity"] = turning, (0.3, -0.1)
    engine, _ = run(packed)
    body = engine.state.bodies.numpy()[0]
    arm = 0.6 / 8.0
    mass_center = body["center"] + arm * np.array([np.cos(body["angle"]), np.sin(body["angle"])])
    start = np.array([10.0 + arm, 0.0]) + 0.4 * (np.array([0.3, -0.1]) + arm * turning * np.array([0.0, 1.0]))
    assert body["speed"] == pytest.approx(turning, abs=1e-8)
    assert body["angle"] == pytest.approx(0.4 * turning, abs=1e-8)
    np.testing.assert_allclose(mass_center, start, atol=1e-8)


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_momentum_of_chain_and_free_sprocket_is_conserved(precision):
    # nothing holds sprocket or chain: sum of momenta, and sum m r x v + M c x V + J omega, over 10,000 steps of
    # contacts. Exact but for round-off in float64; float32 rounds forces of 1e4 N to 1e-3 N
    own = 15.0
    packed = struck_sprocket(step=5e-6, steps=10_000, precision=precision)
    on_springs(packed, mass=own)
    packed.bodies[0]["velocity"] = (-0.5, 0.2)
    before = momenta(packed.roller_rows(0)[:4], packed.bodies[0], own)
    engine, _ = run(packed)
    body = engine.state.bodies.numpy()[0]
    assert engine.sums()["contact"][0]["impacts"] > 10
    assert np.linalg.norm(body["velocity"] - packed.bodies[0]["velocity"]) > 0.1
    found = momenta(state(engine), body, own)
    np.testing.assert_allclose(found, before, atol=1e-10 if precision == "float64" else 1e-4)


CASES = {
    "wheel": {"sprockets.driven.balance_wheel": WHEEL},
    "elastic": {"sprockets.driven.mount": ELASTIC, "sprockets.driven.mass": 20.0},
    "slider": {"sprockets.driven.mount": SLIDER, "sprockets.driven.mass": 20.0},
    "prescribed": {"sprockets.driven.mount": MOVING, "sprockets.driven.balance_wheel": WHEEL},
    "elastic driver with wheel": {
        "sprockets.driver.mount": ELASTIC | {"preload": [-5e3, 0.0]},
        "sprockets.driver.mass": 20.0,
        "sprockets.driver.balance_wheel": WHEEL,
        "sprockets.driver.prescribed.harmonics": [{"order": 2.0, "amplitude": 0.05, "phase": 0.1}],
    },
    "elastic with wheel": {
        "sprockets.driven.mount": ELASTIC,
        "sprockets.driven.mass": 20.0,
        "sprockets.driven.balance_wheel": WHEEL,
    },
}


@pytest.mark.usefixtures("device")
def test_float32_follows_a_moving_sprocket():
    # centers are float64 at both precisions; what differs is the rounding of the contact forces on them
    drive = two_sprockets(duration=0.01, gravity=-9.81).with_values(CASES["elastic with wheel"])
    exact, single = simulate(drive)[0], simulate(drive, precision="float32")[0]
    travel = np.abs(exact.sprocket_center[-1, 1] - exact.sprocket_center[0, 1]).max()
    assert travel > 2e-5
    assert np.abs(single.sprocket_center - exact.sprocket_center).max() < 2e-7  # recorded in float32: 1 m to 6e-8 m
    assert np.abs(single.tension - exact.tension).max() < 2e-3 * exact.tension.mean()
    residuals = [
        abs(simulate(drive, precision=precision, duration=0.1).metrics["energy_residual_relative"][0].as_py())
        for precision in ("float64", "float32")
    ]
    assert residuals[1] < max(2 * residuals[0], 2e-6)  # energies rounded to 6e-8 of themselves, some tens of terms


@pytest.mark.parametrize("case", CASES)
@pytest.mark.usefixtures("device")
def test_energy_closes_with_moving_sprockets(case):
    # spring, preload, kinetic energy and gravity of sprocket and wheel, the damper, and the work of what prescribes:
    # dissipation at the mean of the speeds around a step leaves some 1e-6, of contacts that begin and end within one
    drives = [
        two_sprockets(step=step, duration=0.1, gravity=-9.81, integrator=integrator).with_values(CASES[case])
        for step, integrator in ((8e-6, "leapfrog"), (4e-6, "leapfrog"), (4e-6, "rk4"))
    ]
    for row in simulate(drives, record=Record(variants="none")).metrics.to_pylist():
        assert abs(row["energy_residual_relative"]) < 1e-5


@pytest.mark.usefixtures("device")
def test_prescribed_center_moves_as_told_and_takes_the_chain_along():
    # c(t) = c_0 + d (offset + A sin(2 pi f t + phase)), d made a unit vector; rollers start with the center's velocity
    drive = two_sprockets(duration=0.05, gravity=-9.81).with_values(
        {"sprockets.driven.mount": MOVING, "sprockets.driven.balance_wheel": WHEEL}
    )
    for integrator in ("leapfrog", "rk4"):
        trajectory = simulate(drive.with_values({"run.integrator": integrator}))[0]
        along = 1e-4 + 1e-3 * np.sin(2 * np.pi * 30.0 * trajectory.time + 0.4)
        np.testing.assert_allclose(trajectory.sprocket_center[:, 1, 1], along, atol=1e-15)
        np.testing.assert_allclose(trajectory.sprocket_center[:, 1, 0], drive.sprockets[1].center[0], atol=1e-15)
        seated = np.hypot(*(trajectory.position - trajectory.sprocket_center[:, None, 1]).transpose(2, 0, 1))
        assert (
            np.abs(seated.min(axis=1) - single_chain(drive).pitch_radius(1)).max() < 3e-4
        )  # the chain stays in its gaps
        rate = 2 * np.pi * 30.0 * 1e-3 * np.cos(0.4)
        arm = trajectory.position[0] - trajectory.sprocket_center[0, 1]
        on = np.hypot(*arm.T) < single_chain(drive).pitch_radius(1) + 1e-3
        spin = trajectory.sprocket_speed[0, 1] * np.stack([-arm[on, 1], arm[on, 0]], axis=1)
        # settling has moved rollers by micrometres since velocities were given
        np.testing.assert_allclose(trajectory.velocity[0, on] - spin, [[0.0, rate]] * int(on.sum()), atol=1e-2)


def tensioner(pitch=0.05, preload=3e3):
    """Driver and driven sprocket at rest; a sliding one presses on the lower strand from below, without a spring."""
    ends = [Placed(16, (0.0, 0.0), speed=0.0, pitch=0.05), Placed(16, (1.1, 0.0), pitch=0.05)]
    drive = drive_of([ends[0], Placed(12, (0.5, -0.11), "cw", pitch=0.05), ends[1]], 60, gravity=(0.0, 0.0))
    slider = {"kind": "slider", "direction": [0.0, 1.0], "stiffness": 0.0, "damping": 4e3, "preload": preload}
    parts = {
        "chain": {"pitch": pitch, "roller_mass": 1.0, "stiffness": 5e7, "damping": 2e4, "roller_radius": 0.015},
        "sprockets.0": {"name": "driver"},
        "sprockets.1": {"name": "idler", "mass": 4.0, "inertia": 0.05, "load": {"viscous": 20.0}, "mount": slider},
        "sprockets.2": {"name": "driven", "inertia": 0.3, "load": {"viscous": 100.0}},
        "contact.sprocket": {"seat_angle": 118.0, "clearance": 1e-4, "impact_speed_floor": 0.05, "stiffness": 2e8},
        "run": {"duration": 1.0, "step": 8e-6, "sample_rate": 100.0},
    }
    return drive.with_values({f"{part}.{name}": value for part, of in parts.items() for name, value in of.items()})


@pytest.mark.usefixtures("device")
def test_tensioner_holds_its_preload_while_the_chain_lengthens():
    # at rest the links on both sides pull the slider's sprocket with the preload, whatever the chain's length: strands
    # of tension T that fall away at angles a and b give T (sin a + sin b) = preload. On a fixed center, links longer by
    # 0.4 % would go slack by k p 0.4 % = 10 kN. Tolerance: the last ringing of 0.02 mm of the idler
    places = []
    drives = [tensioner(), tensioner(pitch=0.0502)]
    result = simulate(drives, record=Record(rate=100.0), window=(0.8, 1.0))
    for v, drive in enumerate(drives):
        last, center = result[v], result[v].sprocket_center[-1, 1]
        beside = (
            np.hypot(*(last.position[-1] - center).T) < single_chain(drive).pitch_radius(1) + 0.6 * drive.chain.pitch
        )
        inside = np.flatnonzero(beside)
        first, after = inside.min(), inside.max()
        assert len(inside) == after - first + 1
        link = np.roll(last.position[-1], -1, axis=0) - last.position[-1]
        pull = last.tension[-1][:, None] * link / np.hypot(*link.T)[:, None]
        np.testing.assert_allclose((pull[after] - pull[first - 1])[1], -3e3, rtol=0.02)
        path = chain_path(single_chain(drive.with_values({"sprockets.idler.center": center.tolist()})))
        a, b = (path.strand_end[k] - path.strand_start[k] for k in (0, 1))
        fall = b[1] / np.hypot(*b) - a[1] / np.hypot(*a)
        row = result.metrics.to_pylist()[v]
        # tangents of pitch circles stand in for the polygon of links
        assert -fall * row["idler->driven.tension_mean"] == pytest.approx(3e3, rel=0.05)
        places.append(center[1])
        assert row["idler.mount_force_mean"] == pytest.approx(3e3, rel=0.01)
        assert row["idler.travel_y_mean"] == pytest.approx(center[1] + 0.11, abs=1e-4)
    assert places[1] - places[0] > 0.015


def balance_shaft():
    """A crank of 40 teeth and, in elastic bearings, a balance shaft of 20 with an eccentric mass."""
    shaft = {"name": "shaft", "mass": 30.0, "inertia": 0.02, "balance_wheel": {"mass": 2.0, "radius": 0.05}}
    shaft["mount"] = {"kind": "elastic", "stiffness": [4e7, 4e7], "damping": [1e3, 1e3]}
    values = {
        "chain.stiffness": 2e6, "chain.damping": 20.0, "contact.sprocket.stiffness": 2e7, "run.duration": 1.2,
        "run.step": "auto", "run.sample_rate": 2000.0, "sprockets.0.name": "crank",
    }  # fmt: skip
    drive = drive_of([Placed(40, (0.0, 0.0), speed=40.0), Placed(20, (0.4433, 0.0))], 100)
    return drive.with_values(values | {f"sprockets.1.{name}": value for name, value in shaft.items()})


@pytest.mark.usefixtures("device")
def test_balance_shaft_at_twice_the_cranks_speed_excites_the_second_order():
    # forced vibration of mass M on springs: amplitude m_b r_b w^2 / |k - M w^2 + i c w| at w = 2 Omega, on both axes, a
    # circle. The chain's two strands stiffen x by 2 k / 35 links, 0.3 %, and shake it at other orders
    drive = balance_shaft()
    crank, shaft = 40.0, drive.sprockets[1]
    trajectory = simulate(drive, record=Record(rate=2000.0, channels=("sprocket_center",)))[0]
    late = trajectory.time > 1.2 - 4 * 2 * np.pi / crank  # four turns of the crank
    travel = (trajectory.sprocket_center[:, 1] - shaft.center)[late]
    turns = crank * trajectory.time[late]
    order = {h: 2 * np.abs((travel * np.exp(-1j * h * turns)[:, None]).mean(axis=0)) for h in (1, 2, 3, 4)}
    omega = 2 * crank
    expected = 2.0 * 0.05 * omega**2 / abs(4e7 - 32.0 * omega**2 + 1j * 1e3 * omega)
    np.testing.assert_allclose(order[2], expected, rtol=0.02)
    assert max(order[h].max() for h in (1, 3, 4)) < 0.1 * expected


def test_time_step_limit_counts_springs_and_dampers_of_mounts():
    # one degree of freedom, leapfrog with the damper half a step late: stable where w^2 h^2 + 2 h c / M < 4
    drive = two_sprockets(damping=0.0)
    mass, stiffness, damping = 1e-3, 4e9, 5e2
    mount = {"kind": "slider", "direction": [1.0, 0.0], "stiffness": stiffness, "damping": damping}
    light = drive.with_values({"sprockets.driven.mount": mount, "sprockets.driven.mass": mass})
    h = step_limit(light)
    square = (4 * 5e7 + 2e8) / 1.0 + (stiffness + 0.5 * 20 * 2e8) / mass
    assert h * h * square + 2 * h * damping / mass == pytest.approx(4.0)
    assert automatic_step(light) == pytest.approx(0.6 * h)
    for factor, stable in ((0.999, True), (1.02, False)):
        own = 4.0 / (damping / mass + np.sqrt((damping / mass) ** 2 + 4 * stiffness / mass))
        packed = apart(factor * own, 60, "leapfrog", every=60)
        on_springs(packed, mass=mass, stiffness=(stiffness,) * 2, damping=(damping,) * 2, preload=(1.0, 0.0))
        _, frames = run(packed)
        assert bool(np.abs(frames[-1, -2] - 10.0) < 1e-6) is stable


def test_check_tells_mounts_and_wheels():
    drive = balance_shaft()
    values = derived_quantities(drive)
    (shaft,) = values["mounts"]
    assert shaft["frequencies"] == pytest.approx([np.sqrt(4e7 / 32.0) / (2 * np.pi)] * 2)
    ratio = np.sin(np.pi / 20) / np.sin(np.pi / 40)  # of the pitch radii: 40 teeth against 20
    assert shaft["wheel_force"] == pytest.approx(2.0 * 0.05 * (40.0 * ratio) ** 2)
    assert "shaft     elastic        32 kg  177.9 Hz, 177.9 Hz" in report(values)
    assert "moving centers" not in report(derived_quantities(two_sprockets()))


def test_archive_keeps_moving_centers_and_tables(tmp_path):
    table = {"time": [0.0, 0.01], "torque": [200.0, 400.0], "interpolation": "cubic"}
    drive = two_sprockets(duration=0.005).with_values(
        CASES["elastic with wheel"] | {"sprockets.driven.load.table": table}
    )
    run = simulate(drive)
    back = read_archive(write_archive(run, tmp_path / "a.mcap"))
    assert back.drives == (drive,)
    assert np.ptp(back[0].sprocket_center[:, 1], axis=0).min() > 1e-6
    np.testing.assert_array_equal(back[0].sprocket_center, run[0].sprocket_center)


@pytest.mark.usefixtures("device")
def test_center_that_runs_away_ends_the_variant_as_diverged():
    # a preload that pulls the sprocket out of its chain at once: the rollers stay where they were
    drive = two_sprockets(duration=0.05).with_values(
        {"sprockets.driven.mount": SLIDER | {"preload": 1e12}, "sprockets.driven.mass": 1.0}
    )
    row = simulate(drive, record=Record(variants="none")).metrics.to_pylist()[0]
    assert row["diverged"]
