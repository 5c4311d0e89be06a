"""Sprockets on arms and bearings that rub: pendulums, spin-down, levers, balance, energy, bits alone and in a crowd."""

import math

import numpy as np
import pytest
import raw
from drives import assert_alone_as_in_a_crowd, example
from scipy.optimize import brentq

from warpchain import Record, assemble, read_archive, simulate
from warpchain.assembly.arm_balance import RestingArm, chain_path, path_tension
from warpchain.assembly.path import path_at
from warpchain.assembly.potential import Potential
from warpchain.assembly.statics import _Solver, at_rest, load_moments
from warpchain.modal.small_motion import drive_motion
from warpchain.model import single_chain
from warpchain.results.outlines import arm_outline
from warpchain.view.rerun import view

TEETH, PITCH, RING, INERTIA = 20, 0.05, 20.0, 3.0  # a ring of 20 rollers of 1 kg on all teeth of a wheel
G, DEPTH, ARM, MOMENT = 9.81, 0.3, 4.0, 1.5  # the wheel's center below the pivot; the arm's inertia, weight's moment


def ring(*, steps, step, center=(0.0, 0.0), angle=0.0, window=None, arms=(), gravity=G, **sprocket):
    """A ring of rollers around a wheel at `center`, turned by `angle` about the origin; the engine after its run."""
    position, radius = raw.polygon(TEETH, PITCH)
    c, s = math.cos(angle), math.sin(angle)
    place = np.array([[c, -s], [s, c]]) @ center
    wheel = {"teeth": TEETH, "stiffness": 2e8, "inertia": INERTIA, "restitution": 0.5, "center": place} | sprocket
    spin = wheel.get("speed", 0.0)
    velocity = spin * np.stack([-position[:, 1], position[:, 0]], axis=1)
    packed = raw.chain(
        place + position, velocity, mass=1.0, pitch=PITCH, stiffness=5e7, damping=500.0, sprockets=[wheel],
        gravity=(0.0, -gravity), arms=arms, step=step, steps=steps, window=window,
    )  # fmt: skip
    engine, _ = raw.run(packed)
    return engine, radius


def pendulum(amplitude, *, steps, step, bearing=0.0, window=None):
    """The ring's wheel on an arm that is let go at `amplitude` [rad]."""
    arm = {"pivot": (0.0, 0.0), "inertia": ARM, "mass_moment": (0.0, -MOMENT), "angle": amplitude}
    hub = {"arm": 1, "lever": (0.0, -DEPTH), "bearing": bearing, "inertia": 1.0 / (1.0 / INERTIA + 1.0 / ARM) / step}
    place = {"center": (0.0, -DEPTH), "angle": amplitude}
    return ring(steps=steps, step=step, arms=[arm], hub=hub, window=window, **place)[0]


@pytest.mark.parametrize("bearing, turning", [(0.0, 0.0), (100.0, 1.0)])
def test_pendulum_with_a_free_and_with_a_locked_wheel(bearing, turning):
    # w^2 = (m g l + 20 m_r g d) / (I + 20 m_r d^2), and J + 20 m_r R^2 more below where the wheel cannot turn; period
    # 2 pi / w (1 + a^2 / 16). After a quarter of it the arm hangs straight: to 2e-3 of the amplitude, as the ring
    # gives way on its seats by w^2 over the contacts' 1e4 rad/s squared, and a bristle by as much as it needs to hold
    amplitude, radius = 0.05, PITCH / (2.0 * math.sin(math.pi / TEETH))
    inertia = ARM + RING * DEPTH**2 + turning * (INERTIA + RING * radius**2)
    omega = math.sqrt((MOMENT + RING * DEPTH) * G / inertia)
    steps = 30_000
    step = 0.5 * math.pi / omega * (1.0 + amplitude**2 / 16.0) / steps
    engine = pendulum(amplitude, steps=steps, step=step, bearing=bearing)
    wheel, arm = engine.bodies()
    assert abs(arm["angle"]) < 2e-3 * amplitude
    assert arm["speed"] == pytest.approx(-omega * amplitude, rel=2e-3)
    assert wheel["speed"] == pytest.approx(turning * arm["speed"], abs=2e-3 * omega * amplitude)
    expected = DEPTH * np.array([math.sin(arm["angle"]), -math.cos(arm["angle"])])
    assert wheel["center"] == pytest.approx(expected, abs=1e-12)


def test_a_bearing_slows_its_wheel_evenly_and_then_holds_it():
    # |F| is the ring's weight: w = w_0 - mu r_b 20 m_r g t / (J + 20 m_r R^2), to 1 %, as the ring first falls into its
    # seats; then it stands, without any creep
    radius, speed, bearing = PITCH / (2.0 * math.sin(math.pi / TEETH)), 2.0, 0.01
    slowing = bearing * RING * G / (INERTIA + RING * radius**2)
    step = 2e-5
    hub = {"bearing": bearing, "inertia": INERTIA / step}
    for part in (0.5, 1.5):
        steps = round(part * speed / slowing / step)
        engine, _ = ring(steps=steps, step=step, speed=speed, hub=hub, window=(steps // 5, steps))
        body = engine.bodies()[0]
        expected = speed * max(1.0 - part, 0.0)
        assert body["speed"] == pytest.approx(expected, abs=0.01 * speed if part < 1.0 else 1e-9)
        chain, mount, contact = (engine.sums()[name][0] for name in ("chain", "mount", "contact"))
        lost = chain["energy_start"] - chain["energy_end"]
        assert mount["friction"] == pytest.approx(lost - chain["dissipated"] - contact["dissipated"], rel=1e-4)
        assert mount["friction"] > 0.9 * lost


def test_energy_of_a_pendulum_whose_bearing_slides():
    # kinetic, elastic, weight; what the ring's links, contacts and the bearing take: 1e-6 of what goes to and fro
    engine = pendulum(0.3, steps=100_000, step=1e-5, bearing=0.01, window=(0, 100_000))
    chain, mount, contact = (engine.sums()[name][0] for name in ("chain", "mount", "contact"))
    lost = chain["energy_start"] - chain["energy_end"]
    taken = chain["dissipated"] + contact["dissipated"] + mount["friction"]
    assert mount["friction"] > 1e-2
    assert abs(lost - taken) < 1e-6 * (MOMENT + RING * DEPTH) * G


BARE = {"chain.joint": None, "contact.sprocket.friction": 0.0, "sprockets.idler.bearing": None}


def swing(**values):
    """The example, without friction."""
    return example("swing_idler").with_values(BARE | values)


def test_the_spring_s_moment_is_twice_the_tension_times_sine_and_lever():
    # 2 T sin(beta / 2), along the bisector of the two strands: towards the sprocket's center from mid-wrap; weightless
    drive = swing(**{"run.gravity": [0.0, 0.0]})
    path, arm = chain_path(single_chain(drive)), drive.arms[0]
    middle = path.arrival_angle[1] + drive.sprockets[1].sign * 0.5 * path.wrap_angle[1]
    force = -2.0 * path_tension(single_chain(drive), path) * math.sin(0.5 * path.wrap_angle[1])
    angle = float(path.arm_angle[0])
    x, y = path.center[1] - arm.pivot
    moment = force * (x * math.sin(middle) - y * math.cos(middle))
    spring = arm.stiffness * (angle - arm.free_angle_rad)
    assert path_tension(single_chain(drive), path) > 50.0
    assert moment == pytest.approx(spring, rel=1e-9)
    assert RestingArm(single_chain(drive), 0).moment(angle) == pytest.approx(-moment, rel=1e-9)
    c, s = math.cos(angle), math.sin(angle)
    lever = np.subtract(drive.sprockets[1].center, arm.pivot)
    assert path.center[1] == pytest.approx(arm.pivot + np.array([[c, -s], [s, c]]) @ lever, rel=1e-12)


def test_statics_settling_and_assembly_agree():
    # to 0.6 degrees: settling holds the sprockets, statics lets them turn and takes the mean over a pitch
    drive = swing()
    steady, laid = at_rest(single_chain(drive)), assemble(drive)
    assert steady.failure is None
    run = simulate(drive.with_values({"run.duration": 1e-4, "sprockets.gearbox.prescribed.speed": 0.0}),
                   record=Record(rate=1e5))  # fmt: skip
    assert float(run[0].arm_angle[0, 0]) == pytest.approx(steady.arm_angle[0], abs=1e-2)
    assert run[0].sprocket_center[0, 1] == pytest.approx(steady.center[1], abs=2e-3)
    assert laid.arm_angle[0] == pytest.approx(steady.arm_angle[0], abs=1e-2)
    assert run[0].arm_moment[0, 0] == pytest.approx(
        -RestingArm(single_chain(drive), 0).moment(float(run[0].arm_angle[0, 0])), rel=0.02
    )


def test_derivatives_by_an_arm_that_carries_a_sprocket():
    # gradient and Hessian by the arm's angle, its sprocket's center on the circle; and the kernels' stiffness about it
    drive = swing()
    (found,) = drive_motion(drive).parts
    potential = Potential(single_chain(drive), 0.0, load_moments(single_chain(drive), 0.0), hanging=True)
    angles = found.state.bodies[0, :, 2]
    x = np.concatenate([found.state.position[0].ravel(), found.state.bodies[0, :3, :2].ravel(), angles])
    solver = _Solver([potential], [assemble(drive)])
    solver._move_levers(x)
    reach, d = single_chain(drive).arm_lever(0), 1e-7

    def moved(by):
        other = x.copy()
        other[-1] += by / reach
        potential.move_carried(other)
        solver._move_levers(other)
        terms = potential.terms(other)
        return terms.energy, terms.gradient_of_coordinates(solver.maps, solver.count)

    (up, above), (down, below) = moved(d), moved(-d)
    solver._move_levers(x)
    terms = potential.terms(x)
    hessian = terms.hessian(solver.maps, solver.count).toarray()
    scale = np.abs(hessian[-1]).max()
    assert (
        abs((up - down) / (2 * d) - terms.gradient_of_coordinates(solver.maps, solver.count)[-1])
        < 1e-3 * drive.chain.stiffness * d
    )
    assert np.abs((above - below) / (2 * d) - hessian[-1]).max() < 1e-4 * scale
    assert np.count_nonzero(hessian[-1]) > 2  # rollers press on the idler
    n = 2 * drive.chain.links
    at = n + found.at.owner.tolist().index(3)
    kernels = found.stiffness.toarray()[at, :n] * 1.0 / reach
    assert np.abs(kernels - hessian[-1, :n]).max() < 1e-4 * scale


def slide(pivot=None):
    """The idler on a slide that a spring holds, or on a lever to a far pivot whose torsion spring is as stiff there."""
    at_once = {"sprockets.gearbox.prescribed.ramp_time": 0.0, "sprockets.auger.load.ramp_time": 0.0}
    bare = {
        "run.gravity": [0.0, 0.0],
        "run.settle": False,
        "run.step": 4e-6,
        "sprockets.idler.mount": {"kind": "fixed"},
    }
    base = swing(**at_once, **bare).with_values({"arms": []})
    raised = lambda y: base.with_values({"sprockets.idler.center": [0.189, y]})  # noqa: E731
    height = brentq(lambda y: path_at(single_chain(raised(y)), []).nominal_strain + 2e-4, -0.06, 0.0)
    stiffness = 2e4
    if pivot is None:
        mount = {"kind": "slider", "direction": [0.0, 1.0], "stiffness": stiffness, "damping": 0.0}
        return raised(height).with_values({"sprockets.idler.mount": mount})
    arm = {"name": "lever", "pivot": [0.189 - pivot, height], "mass": 1e-9, "center": [0.189, height]}
    arm |= {"inertia": 1e-9 * pivot**2, "stiffness": stiffness * pivot**2}
    return raised(height).with_values({"arms": [arm], "sprockets.idler.mount": {"kind": "arm", "arm": "lever"}})


def test_on_a_long_lever_a_sprocket_moves_as_on_a_slide():
    # across the line it is off by y^2 / 2 L, along it by what the chain makes of that: half with twice the lever, to
    # 5 %, until rollers that strike a little later make more of it
    run = simulate([slide(), slide(0.5), slide(1.0)], record=Record(rate=5000.0), duration=0.012)
    line, *levers = (np.array(run[v].sprocket_center[:, 1]) for v in range(3))
    travel = line[:, 1] - line[0, 1]
    assert np.ptp(travel) > 1e-4
    for lever, center in zip((0.5, 1.0), levers, strict=True):
        assert line[:, 0] - center[:, 0] == pytest.approx(travel**2 / (2.0 * lever), rel=1e-3, abs=1e-12)
    off = [np.abs(center[:, 1] - line[:, 1]).max() for center in levers]
    assert 1e-10 < off[0] < 1e-8
    assert off[0] / off[1] == pytest.approx(2.0, rel=0.05)


def test_a_published_derailleur_stands_as_published():
    # its 120 links put the cage where it is drawn, to 0.1 degrees: places are given to 0.01 mm, over a lever of 0.1 m,
    # and the tension is what a spring of 5 N m gives by both jockeys' bisectors, less the weight
    drive = example("derailleur").with_values({"sprockets.cog.load": None})
    path = chain_path(single_chain(drive))
    assert abs(np.degrees(path.arm_angle[0])) < 0.1
    moment = 0.0
    for s in (1, 2):
        middle = path.arrival_angle[s] + drive.sprockets[s].sign * 0.5 * path.wrap_angle[s]
        force = -2.0 * path_tension(single_chain(drive), path) * math.sin(0.5 * path.wrap_angle[s])
        x, y = path.center[s] - drive.arms[0].pivot
        moment += force * (x * math.sin(middle) - y * math.cos(middle))
        moment -= 9.81 * drive.sprockets[s].mass * x
    moment -= 9.81 * 0.1577 * -0.0064
    assert moment == pytest.approx(0.573 * math.radians(500.0), rel=2e-3)


@pytest.mark.usefixtures("device")
def test_energy_of_a_drive_with_an_idler_on_an_arm():
    # all of it: chain, contacts, friction of joints, teeth and the bearing, the arm's spring, damper and weight
    drive = example("swing_idler")
    row = simulate(drive, record=Record("none"), duration=0.3, window=(0.2, 0.3)).metrics.to_pylist()[0]
    assert abs(row["energy_residual_relative"]) < 1e-5
    assert row["idler.bearing_friction"] > 0.0 and row["swing arm.damping_loss"] > 0.0
    # the arm's moment is the lever's times the hub's force, as the arm stands in the mean
    angle, arm = row["swing arm.angle_mean"], drive.arms[0]
    dx, dy = np.subtract(drive.sprockets[1].center, arm.pivot)
    x, y = dx * math.cos(angle) - dy * math.sin(angle), dx * math.sin(angle) + dy * math.cos(angle)
    moment = x * row["idler.hub_force_y_mean"] - y * row["idler.hub_force_x_mean"]
    assert row["swing arm.moment_mean"] == pytest.approx(moment, rel=0.01)


def test_the_same_bits_alone_and_in_a_crowd():
    drive = example("swing_idler")
    drives = [drive.with_values({"arms.0.stiffness": k}) for k in (30.0, 40.0, 50.0)]
    assert_alone_as_in_a_crowd(drives, ("position", "arm_angle"), record=Record(rate=5000.0), duration=5e-3)


def test_an_idler_on_a_shaft_turns_with_its_inertia():
    """As one that has both inertias itself, to rounding: the shaft stands between the sprockets and the arm."""
    idler = example("swing_idler").with_values({"run.duration": 2e-3, "run.settle": False})
    own = idler.sprockets[1].inertia
    shaft = {"shafts": [{"name": "on it", "inertia": 2.0 * own}], "sprockets.idler.shaft": "on it"}
    heavy, tied = idler.with_values({"sprockets.idler.inertia": 3.0 * own}), idler.with_values(shaft)
    one, other = (simulate(drive, record=Record([0]), device="cpu")[0] for drive in (heavy, tied))
    np.testing.assert_allclose(other.sprocket_speed, one.sprocket_speed, rtol=1e-7)
    np.testing.assert_allclose(other.arm_angle, one.arm_angle, rtol=1e-9)
    assert np.ptp(other.arm_angle) > 1e-6


def test_archive_and_playback_hold_the_arm_and_its_sprocket(tmp_path):
    drive = example("swing_idler")
    run = simulate(drive, record=Record(rate=5000.0), duration=4e-3, archive=tmp_path / "a.mcap")
    back = read_archive(tmp_path / "a.mcap")[0]
    assert back.drive == drive
    for name in ("sprocket_center", "arm_angle", "arm_moment"):
        assert (np.asarray(getattr(back, name)) == np.asarray(getattr(run[0], name))).all(), name
    center, angle = np.asarray(back.sprocket_center[:, 1]), np.asarray(back.arm_angle[:, 0])
    x, y = np.subtract(drive.sprockets[1].center, drive.arms[0].pivot)
    cosine, sine = np.cos(angle), np.sin(angle)
    turned = drive.arms[0].pivot + np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=1)
    assert center == pytest.approx(turned, abs=1e-12)
    (line,) = arm_outline(single_chain(drive), 0)
    assert line.tolist() == [list(drive.arms[0].pivot), list(drive.sprockets[1].center)]
    view(run, save=tmp_path / "a.rrd")
    assert (tmp_path / "a.rrd").stat().st_size > 10_000
