"""Runs at steps of up to 0.6 of their limit against those at a sixteenth of it: damping, light wheels, quantiles."""

import numpy as np
import pytest
from drives import STARTING, example, two_sprockets
from scipy.optimize import least_squares

from warpchain import Record, simulate
from warpchain.assembly.timestep import resolve_step, step_limit

PITCH, MASS = 0.0127, 0.0088
OWN = {
    "chain.pitch": PITCH, "chain.roller_radius": 0.004255, "contact.sprocket.restitution_means": "rebound",
    "contact.sprocket.seat_angle": None, "sprockets.driven.center": [26.5 * 1.004 * PITCH, 0.0],
}  # fmt: skip


def pair(step, **values):
    """Two 19-tooth sprockets on 72 links of 1.2e7 N/m, contacts of 2.4e7 N/m that return 0.3; limit 22 us."""
    base = two_sprockets(teeth=19, links=72, stiffness=1.2e7, contact=2.4e7, damping=30.0, torque=2.0, restitution=0.3,
                         clearance=5e-5, mass=MASS, **values)  # fmt: skip
    return base.with_values(OWN | {"run.step": step})


def test_a_free_decay_is_that_of_the_law_at_any_step():
    # the first sprocket is held, the second let go under 2 N m: an independent Jacobian with contacts at their speed
    # floor gives zeta = 1.4717e-3 at 25.0749 Hz
    drives = [pair(step, speed=0.0, inertia=0.05, duration=1.0) for step in (1e-6, 2e-6, 4e-6, 8e-6)]
    run = simulate(drives, record=Record(rate=2000.0), device="cpu")
    for v in range(len(drives)):
        time, angle = run[v].time, run[v].sprocket_angle[:, 1]

        def misses(p, time=time, angle=angle):
            wave = np.exp(-p[0] * p[1] * time) * np.exp(1j * p[1] * time)
            rows = np.stack([wave.real, wave.imag, np.ones_like(time)], axis=1)
            return rows @ np.linalg.lstsq(rows, angle, rcond=None)[0] - angle

        zeta, omega = least_squares(misses, [1e-3, 2.0 * np.pi * 25.0], x_scale=[1e-3, 100.0]).x
        assert zeta == pytest.approx(1.4717e-3, rel=5e-3)
        assert omega / (2.0 * np.pi) == pytest.approx(25.0749, rel=1e-4)


def test_a_wheel_of_one_rollers_inertia_ripples_the_same_at_any_step():
    # J = m R^2: nine seated rollers can answer nine times what the wheel itself resists an acceleration with
    radius = PITCH / (2.0 * np.sin(np.pi / 19))
    light = {"speed": 258.0, "ramp": 0.02, "load_ramp": 0.02, "inertia": MASS * radius**2, "duration": 0.2}
    steps = 5e-7, 2e-6, 8e-6
    run = simulate([pair(step, **light) for step in steps], record=Record("none"), window=(0.1, 0.2), device="cpu")
    rows = run.metrics.to_pylist()
    ripple = [row["driven.speed_std"] for row in rows]
    for row in rows:
        assert row["driven.speed_mean"] == pytest.approx(258.0, rel=3e-4)  # by a tooth more or less
        assert abs(row["energy_residual_relative"]) < 1e-2
    assert ripple[1:] == pytest.approx([ripple[0]] * 2, rel=0.1)


def starts(integrator="leapfrog"):
    """Wheels of z m R^2 / J from 0.2 to 10 that start towards 20 rad/s; seats have c h / (2 m) above 10."""
    radius = PITCH / (2.0 * np.sin(np.pi / 19))
    slow = {"speed": 20.0, "ramp": 0.04, "load_ramp": 0.02, "viscous": 0.02, "floor": 0.005, "duration": 0.02}
    return [
        pair("auto", inertia=19 * MASS * radius**2 / g, integrator=integrator, **slow) for g in (0.2, 1.0, 3.0, 10.0)
    ]


@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("integrator", ["leapfrog", "rk4"])
def test_a_wheel_that_starts_slowly_gains_no_energy(integrator, precision):
    # -0.6 and -1.2 of the first two were contacts to take the acceleration of the step before; with rk4 -0.07 and -0.6
    # of the last two were dampers bounded by the roller's mass alone
    run = simulate(starts(integrator), record=Record("none"), window=(0.0, 0.02), device="cpu", precision=precision)
    for row in run.metrics.to_pylist():
        assert abs(row["energy_residual_relative"]) < 5e-4


def test_a_start_of_three_chains_on_a_shaft_gains_no_energy():
    # none of the wheels on the idler's shaft would gain energy by itself: -5e-2 were they not taken together
    drive = example("v6").with_values({"run.duration": 0.01})
    run = simulate(drive, record=Record("none"), window=(0.0, 0.01), device="cpu", limits=STARTING)
    assert abs(run.metrics.to_pylist()[0]["energy_residual_relative"]) < 1e-5


@pytest.mark.parametrize(("name", "duration"), [("v6", 0.05), ("balance_shafts", 0.05), ("motorcycle_drivetrain", 0.1)])
def test_blows_on_bodies_that_give_way_gain_no_energy(name, duration):
    # rollers at full speed: dampers that remembered their force, not their speed, gained all that there is
    run = simulate(example(name), duration=duration, record=Record("none"), device="cpu", limits=STARTING)
    assert abs(run.metrics.to_pylist()[0]["energy_residual_relative"]) < 1e-3


def test_a_slow_start_has_the_same_bits_beside_drives_that_are_not_slow():
    slow, fast = starts()[1], two_sprockets(duration=0.02)
    options = {"record": Record("none"), "window": (0.0, 0.02), "device": "cpu", "limits": STARTING}
    both = simulate([fast, slow], **options).metrics.to_pylist()
    for drive, row in zip((fast, slow), both, strict=True):
        alone = simulate(drive, **options).metrics.to_pylist()[0]
        assert {k: v for k, v in alone.items() if k != "variant"}.items() <= row.items()


@pytest.mark.parametrize(("name", "duration"), [("industrial", 0.4), ("engine", 0.2)])
def test_an_example_has_the_results_of_a_quarter_of_its_step(name, duration):
    drive = example(name).with_values({"run.duration": duration})
    step = float(resolve_step(drive))
    run = simulate(
        [drive.with_values({"run.step": h}) for h in (step, step / 4.0)], record=Record("none"), device="cpu"
    )
    coarse, fine = run.metrics.to_pylist()
    for name in ("tension_mean", "tension_q999"):
        assert coarse[name] == pytest.approx(fine[name], rel=1e-2), name
    # single blows that take less than three steps are not that sure
    assert coarse["tension_max"] == pytest.approx(fine["tension_max"], rel=4e-2)


def test_what_sticks_on_a_guide_and_in_joints_stays_for_a_million_steps():
    # a strand on a guide-bar, tilted so that it would slide down: at first it swings, then friction holds it. Half of
    # the steps later no roller has moved by more than what is left of the swing, and friction on the bar is the same
    bar = {"name": "bar", "start": [0.3, 0.152], "end": [0.7, 0.152], "end_radius": 0.05}
    rubs = {"restitution": 0.5, "impact_speed_floor": 0.02, "stiffness": 1e6, "friction": 0.3}
    drive = two_sprockets(speed=0.0, settle="false", step=2e-5, duration=20.0, torque=300.0).with_values(
        {"contact.guide": rubs, "guides": (bar,), "chain.joint": {"friction": 0.3, "pin_radius": 0.008},
         "contact.sprocket.friction": 0.3, "run.gravity": [9.81, -9.81]}
    )  # fmt: skip
    run = simulate(drive, record=Record(rate=0.1), window=(19.0, 20.0), device="cpu", limits=STARTING)[0]
    assert np.abs(run.position[-1] - run.position[1]).max() < 1e-9
    held = []
    for n in (1, 2):
        ahead = np.roll(run.position[n], -1, axis=0) - run.position[n]
        pull = run.tension[n][:, None] * ahead / np.linalg.norm(ahead, axis=1)[:, None]
        along = (pull - np.roll(pull, 1, axis=0))[:, 0] + 9.81 * drive.chain.roller_mass
        held.append(-along[run.guide_force[n] > 0.0].sum())
    assert 5.0 < abs(held[0]) <= 0.3 * run.guide_force[1].sum()
    assert held[1] == pytest.approx(held[0], rel=1e-6)


def test_an_arm_of_little_inertia_runs_to_near_the_limit_of_its_step():
    # 0.003 of the car's shoe: one seated roller's inertia about the pivot is some hundred times as much
    car = example("car")
    light = car.with_values({"arms.arm.inertia": 0.003 * car.arms[0].inertia, "run.duration": 0.06})
    steps = [part * float(step_limit(light)) for part in (0.9, 0.15)]
    run = simulate([light.with_values({"run.step": h}) for h in steps], record=Record("none"), device="cpu",
                   limits=STARTING)  # fmt: skip
    coarse, fine = run.metrics.to_pylist()
    assert coarse["status"] == fine["status"] == "ok"
    assert coarse["tension_mean"] == pytest.approx(fine["tension_mean"], rel=5e-3)
    assert coarse["arm.angle_std"] == pytest.approx(fine["arm.angle_std"], rel=3e-2)
    assert coarse["tension_q999"] == pytest.approx(fine["tension_q999"], rel=4e-2)
