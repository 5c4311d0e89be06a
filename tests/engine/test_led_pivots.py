"""Pivots and centers led along tables: pendulums, energy, float32, archive, playback, statics."""

import math
import tomllib

import numpy as np
import pytest
from drives import BLADE, errors_of, example, two_sprockets
from scipy.integrate import cumulative_simpson, solve_ivp

from warpchain import Record, load_drive, read_archive, simulate, write_archive
from warpchain.drive.examples import drive_path
from warpchain.model import single_chain
from warpchain.results.channels import CHANNEL_NAMES
from warpchain.results.housing import housing_loads
from warpchain.results.outlines import guide_arm_tensioner_parts, pose_at_frame
from warpchain.view.rerun import view

G, MASS, LENGTH, INERTIA = 9.81, 2.0, 0.3, 0.25
HANGING = {"name": "pendulum", "pivot": [0.5, -1.0], "mass": MASS, "center": [0.5, -1.0 - LENGTH], "inertia": INERTIA}


def led(table, **arm):
    """Two sprockets with their chain at rest, and beside them a pendulum whose pivot a table leads."""
    still = {"run.gravity": [0.0, -G], "run.step": 2e-5, "sprockets.driver.prescribed.speed": 0.0}
    return two_sprockets().with_values(still | {"arms": [HANGING | {"pivot_table": table} | arm]})


def accelerated(a, duration, rows=401):
    """x = a t^2 / 2."""
    time = np.linspace(0.0, duration, rows)
    return {"time": time.tolist(), "x": (0.5 * a * time**2).tolist()}


def shaken():
    """A pivot that goes 20 mm to and fro and 5 mm up and down."""
    time = np.linspace(0.0, 0.2, 81)
    x, y = 0.02 * np.sin(60.0 * time), 5e-3 * (1.0 - np.cos(90.0 * time))
    return {"time": time.tolist(), "x": x.tolist(), "y": y.tolist()}


@pytest.mark.usefixtures("device")
@pytest.mark.parametrize("integrator", ["leapfrog", "rk4"])
def test_a_pendulum_swings_about_atan_of_a_over_g(integrator):
    # let go as it hangs it swings to 2 atan(a / g) and back, in 2 pi sqrt(I / (m l sqrt(g^2 + a^2))) (1 + A^2 / 16 +
    # 11 A^4 / 3072) of its amplitude A = atan(a / g); a spline through a parabola's rows is that
    a = 4.0
    lean = math.atan2(-a, G)
    omega = math.sqrt(MASS * LENGTH * math.hypot(G, a) / INERTIA)
    period = 2.0 * math.pi / omega * (1.0 + lean**2 / 16.0 + 11.0 * lean**4 / 3072.0)
    drive = led(accelerated(a, 1.3 * period)).with_values({"run.integrator": integrator})
    run = simulate(drive, duration=period, record=Record(rate=1000.0))[0]
    angle, time = np.asarray(run.arm_angle[:, 0]), np.asarray(run.time)
    assert angle.min() == pytest.approx(2.0 * lean, rel=1e-4)
    assert time[angle.argmin()] == pytest.approx(0.5 * period, abs=1.5e-3)
    assert angle[-1] == pytest.approx(0.0, abs=2e-4)


@pytest.mark.usefixtures("device")
@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("integrator", ["leapfrog", "rk4"])
def test_the_work_of_what_leads_a_pivot_closes_the_energy(integrator, precision):
    # weight, swing and translation are the pendulum's only; the chain is at rest
    # links' dampers count at speeds half a step late: 2e-4 of the work at 20 us, a quarter of that at 10
    drive = led(shaken(), damping=0.05, stiffness=2.0).with_values({"run.integrator": integrator, "run.step": 1e-5})
    row = simulate(drive, duration=0.19, window=(0.03, 0.18), precision=precision).metrics.to_pylist()[0]
    assert abs(row["pendulum.pivot_work"]) > 0.05 and row["pendulum.damping_loss"] > 1e-4
    assert abs(row["energy_residual"]) < (1e-4 if precision == "float64" else 1e-3) * row["pendulum.pivot_work"]


LOWER = {"name": "lower", "arm": "pendulum", "pivot": [0.5, -1.35], "mass": 1.0, "center": [0.58, -1.5]}
LOWER |= {"inertia": 0.04, "stiffness": 1.5, "damping": 0.01}


COILS = (
    {"at": [0.5, -1.2], "anchor": [0.7, -1.1], "stiffness": 200.0, "free_length": 0.2},
    {"at": [0.55, -1.45], "anchor": [0.45, -1.25], "stiffness": 100.0, "free_length": 0.25, "damping": 0.5},
)
"""Coil springs of two arms: to what leads the pivot of the first, and between both."""


def two_arms(coils=()):
    """That pendulum with another one on it, shaken, with coil springs or without."""
    drive = led(shaken(), damping=0.05, stiffness=2.0)
    arms = [drive.arms[0].model_dump(exclude_none=True), LOWER]
    springs = [{"spring": coil} for coil in coils] or [{}, {}]
    return drive.with_values({"arms": [arm | spring for arm, spring in zip(arms, springs, strict=True)]})


def left(v):
    """`v` turned by +90 degrees."""
    return np.array([-v[1], v[0]])


def turned(v, angle):
    """`v` turned by an angle [rad]."""
    return np.cos(angle) * np.asarray(v) + np.sin(angle) * left(v)


def coil_moment(arm, angle, speed):
    """Moment of an arm's coil spring about its pivot: of a force along the line from its anchor to its other end."""
    if arm.spring is None:
        return 0.0
    end = turned(np.subtract(arm.spring.at, arm.pivot), angle)
    way = end - np.subtract(arm.spring.anchor, arm.pivot)
    length = np.hypot(*way)
    rate = speed * left(end) @ way / length
    tension = arm.spring.stiffness * (length - arm.spring.free_length) + arm.spring.damping * rate
    return -tension * left(end) @ way / length


def newton_euler(drive, time, state):
    """Accelerations (2,) of two arms and forces (4,) at their pivots, from the six equations of two bodies: m a and
    I_c alpha of each, about its center of mass, with the forces as unknowns. Coil springs act at the pivots, as their
    forces and moments.
    """
    upper, lower = drive.arms
    (a1, a2, w1, w2), gravity = state, np.asarray(drive.run.gravity)
    table = upper.pivot_table
    led_by = np.array([table.displacement_along(axis).spline(time, 2) for axis in "xy"])
    r1, r2 = (turned(np.subtract(arm.center, arm.pivot), angle) for arm, angle in ((upper, a1), (lower, a2)))
    d = turned(np.subtract(lower.pivot, upper.pivot), a1)
    joint = lower.stiffness * (a2 - a1 - lower.free_angle_rad) + lower.damping * (w2 - w1)
    ground = upper.stiffness * (a1 - upper.free_angle_rad) + upper.damping * w1
    joint, ground = joint - coil_moment(lower, a2 - a1, w2 - w1), ground - coil_moment(upper, a1, w1)
    matrix, right = np.zeros((6, 6)), np.zeros(6)  # alpha_1, alpha_2, F_1 on the upper arm, F_2 on the lower one
    matrix[0:2, 0], matrix[0:2, 2:4], matrix[0:2, 4:6] = upper.mass * left(r1), -np.eye(2), np.eye(2)
    right[0:2] = upper.mass * (gravity - led_by + w1 * w1 * r1)
    matrix[2:4, 0], matrix[2:4, 1], matrix[2:4, 4:6] = lower.mass * left(d), lower.mass * left(r2), -np.eye(2)
    right[2:4] = lower.mass * (gravity - led_by + w1 * w1 * d + w2 * w2 * r2)
    matrix[4, 0], matrix[4, 2:4] = upper.inertia - upper.mass * r1 @ r1, left(r1)  # - r_1 x F_1 is -left(r_1).F_1
    matrix[4, 4:6], right[4] = left(d - r1), joint - ground
    matrix[5, 1], matrix[5, 4:6] = lower.inertia - lower.mass * r2 @ r2, left(r2)
    right[5] = -joint
    found = np.linalg.solve(matrix, right)
    return found[:2], found[2:]


@pytest.mark.usefixtures("device")
@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize(("integrator", "coils"), [("leapfrog", ()), ("rk4", ()), ("leapfrog", COILS), ("rk4", COILS)])
def test_what_leads_a_pivot_holds_the_arm_on_the_arm_too(integrator, coils, precision):
    """Against two bodies by Newton and Euler (scipy): angles, the pivot's force frame by frame, its work; and energy.

    Leapfrog has 5e-5 of the work in h^2 at this step, by links' dampers; runge-kutta 3e-6. The force is that of second
    differences of recorded angles, 0.2 ms apart.
    """
    drive = two_arms(coils).with_values({"run.integrator": integrator, "run.step": 1e-5})
    exact = precision == "float64"
    record = Record(rate=5000.0, channels=CHANNEL_NAMES)
    run = simulate(drive, duration=0.18, window=(0.03, 0.18), precision=precision, record=record)
    row, time = run.metrics.to_pylist()[0], np.asarray(run[0].time)
    angles = np.asarray(run[0].arm_angle, dtype=float)
    motion = solve_ivp(
        lambda t, y: np.append(y[2:], newton_euler(drive, t, y)[0]), (0.0, time[-1]), [*angles[0], 0.0, 0.0],
        t_eval=time, rtol=1e-9, atol=1e-10, max_step=2.5e-3,
    ).y.T  # fmt: skip
    force = np.array([newton_euler(drive, t, y)[1][:2] for t, y in zip(time, motion, strict=True)])
    assert np.ptp(motion[:, 1]) > 0.1
    np.testing.assert_allclose(angles, motion[:, :2], atol=2e-6 if exact else 2e-5)
    table = drive.arms[0].pivot_table
    speed = np.stack([table.displacement_along(axis).spline(time, 1) for axis in "xy"], axis=1)
    done = cumulative_simpson((force * speed).sum(axis=1), x=time, initial=0.0)
    work = done[-1] - done[time >= 0.03 - 1e-9][0]
    assert row["pendulum.pivot_work"] == pytest.approx(work, rel=1e-4 if exact else 1e-3)
    assert abs(row["energy_residual"]) < (1e-4 if exact else 1e-3) * abs(work)
    if exact:
        loads = {load.name: load.force for load in housing_loads(run[0])}
        held = loads["pivot pendulum"] + loads.get("spring pendulum", 0.0)
        np.testing.assert_allclose(-held[5:-5], force[5:-5], atol=2e-3 * np.abs(force).max())
        if coils:
            drawn, end = np.subtract(coils[0]["at"], coils[0]["anchor"]), turned([0.0, -0.2], angles[-1, 0])
            assert np.hypot(*drawn) == pytest.approx(math.sqrt(0.05))
            way = end - [0.2, -0.1]
            pull = 200.0 * (np.hypot(*way) - 0.2)
            assert loads["spring pendulum"][-1] == pytest.approx(pull * way / np.hypot(*way), rel=1e-9)


def idler(**values):
    """The example, its arm's pivot shaken a little."""
    table = shaken() | {"factor": 0.05}
    return example("swing_idler").with_values({"arms.0.pivot_table": table} | values)


@pytest.mark.usefixtures("device")
def test_energy_of_a_drive_whose_arm_s_pivot_is_led():
    row = simulate(idler(), record=Record("none"), duration=0.15, window=(0.02, 0.15)).metrics.to_pylist()[0]
    assert abs(row["energy_residual_relative"]) < 1e-5
    assert abs(row["swing arm.pivot_work"]) > 1e-3


def test_a_carried_sprocket_goes_with_the_pivot_and_stands_in_pictures(tmp_path):
    drive = idler()
    run = simulate(drive, record=Record(rate=2000.0), duration=0.02)
    back = read_archive(write_archive(run, tmp_path / "a.mcap"))[0]
    assert back.drive == drive
    arm, table = drive.arms[0], drive.arms[0].pivot_table
    time, angle = np.asarray(back.time), np.asarray(back.arm_angle[:, 0])
    # between rows, 2.5 ms apart, the spline is off the sine by (0.15)^4 / 384 of it
    moved = 0.05 * np.stack([0.02 * np.sin(60.0 * time), 5e-3 * (1.0 - np.cos(90.0 * time))], axis=1)
    x, y = np.subtract(drive.sprockets[1].center, arm.pivot)
    lever = np.stack([np.cos(angle) * x - np.sin(angle) * y, np.sin(angle) * x + np.cos(angle) * y], axis=1)
    assert np.asarray(back.sprocket_center[:, 1]) == pytest.approx(arm.pivot + moved + lever, abs=1e-7)
    assert table.largest_displacement == pytest.approx(0.05 * math.hypot(max(map(abs, table.x)), max(table.y)))
    last = len(time) - 1
    (line,) = [
        part.points
        for part in guide_arm_tensioner_parts(single_chain(drive), pose_at_frame(back, last))
        if part.kind == "arm"
    ]
    assert line[1] == pytest.approx(np.asarray(back.sprocket_center[last, 1]), abs=1e-9)
    view(run, save=tmp_path / "a.rrd")
    assert (tmp_path / "a.rrd").stat().st_size > 10_000


@pytest.mark.usefixtures("device")
def test_a_center_goes_along_a_table_and_starts_with_its_speed():
    time = np.linspace(0.0, 0.05, 51)
    table = {"time": time.tolist(), "y": (1e-3 * np.sin(200.0 * time)).tolist()}
    drive = two_sprockets(duration=0.03).with_values({"sprockets.driven.mount": {"kind": "prescribed", "table": table}})
    for integrator in ("leapfrog", "rk4"):
        result = simulate(drive.with_values({"run.integrator": integrator}))
        run, row = result[0], result.metrics.to_pylist()[0]
        along = 1e-3 * np.sin(200.0 * run.time)
        assert run.sprocket_center[:, 1, 1] == pytest.approx(along, abs=1e-8)  # a spline's (0.2)^4 / 384 of it
        assert (run.sprocket_center[:, 1, 0] == drive.sprockets[1].center[0]).all()
        assert abs(row["energy_residual_relative"]) < 1e-4
        seated = np.hypot(*(run.position - run.sprocket_center[:, None, 1]).transpose(2, 0, 1))
        assert np.abs(seated.min(axis=1) - single_chain(drive).pitch_radius(1)).max() < 3e-4
        arm = run.position[0] - run.sprocket_center[0, 1]
        on = np.hypot(*arm.T) < single_chain(drive).pitch_radius(1) + 1e-3
        # as settling has moved rollers by micrometres since velocities were given
        assert run.velocity[0, on, 1] - run.sprocket_speed[0, 1] * arm[on, 0] == pytest.approx(0.2, abs=1e-2)


def test_float32_follows_a_led_pivot():
    exact, single = (simulate(idler(), duration=0.02, precision=p)[0] for p in ("float64", "float32"))
    assert np.abs(single.arm_angle - exact.arm_angle).max() < 1e-5
    assert single.tension.mean() == pytest.approx(exact.tension.mean(), rel=1e-3)  # as the package promises


WRONG = {
    "early": ({"time": [-0.1, 0.1], "x": [0.0, 1e-3]}, "time.0 = -0.1: must be at least 0, when the run begins"),
    "back": ({"time": [0.0, 0.0], "x": [0.0, 1e-3]}, "time.1 = 0.0: must be above the element before, 0"),
    "away": ({"time": [0.0, 0.1], "x": [1e-3, 0.0]}, "x.0 = 0.001: must be 0: it begins where it is drawn"),
    "none": ({"time": [0.0, 0.1]}, "x: missing; must be a list of numbers, or give y instead"),
    "short": ({"time": [0.0, 0.1], "y": [0.0, 0.1, 0.2]}, "y = [0.0, 0.1, 0.2]: must have as many elements as time, 2"),
}


@pytest.mark.parametrize("case", WRONG)
def test_tables_of_places_that_are_refused(case):
    table, text = WRONG[case]
    values = two_sprockets().model_dump(exclude_none=True)
    assert errors_of(values | {"arms": [HANGING | {"pivot_table": table}]}) == (f"arms.pendulum.pivot_table.{text}",)
    values["sprockets"][1]["mount"] = {"kind": "prescribed", "table": table}
    assert errors_of(values) == (f"sprockets.driven.mount.table.{text}",)


def test_a_center_is_led_by_a_line_or_a_table_alone():
    values = two_sprockets().model_dump(exclude_none=True)
    values["sprockets"][1]["mount"] = {"kind": "prescribed"}
    (error,) = errors_of(values)
    assert error.startswith("sprockets.driven.mount.direction: missing; ") and error.endswith("or give table instead")
    table = {"time": [0.0, 0.1], "x": [0.0, 1e-3]}
    values["sprockets"][1]["mount"] = {"kind": "prescribed", "table": table, "amplitude": 1e-3}
    assert errors_of(values) == ("sprockets.driven.mount.amplitude = 0.001: not together with table",)


def test_a_plunger_with_mass_is_refused_on_a_led_pivot():
    values = tomllib.loads(BLADE)
    values["arms"][0]["pivot_table"] = {"time": [0.0, 0.1], "x": [0.0, 1e-3]}
    text = 'must be 0 on "tensioner arm", whose pivot is led; its mass would not go along'
    assert errors_of(values) == (f"tensioners.chain tensioner.plunger.mass = 0.033: {text}",)


def test_tables_of_places_come_from_files(tmp_path):
    (tmp_path / "axle.csv").write_text("time,x_mm,y_mm\n0,0,0\n0.1,1,-2\n")
    text = (drive_path("swing_idler")).read_text().replace(
        "pivot = [0.05, -0.11]", 'pivot = [0.05, -0.11]\npivot_table = { file = "axle.csv", factor = 0.5 }'
    )  # fmt: skip
    (tmp_path / "drive.toml").write_text(text)
    table = load_drive(tmp_path / "drive.toml").arms[0].pivot_table
    assert (table.time, table.x, table.y, table.factor) == ((0.0, 0.1), (0.0, 1e-3), (0.0, -2e-3), 0.5)
    (tmp_path / "axle.csv").write_text("time,speed\n0,0\n1,1\n")
    with pytest.raises(Exception, match='line 1: column #2, "speed", is not known; must be x or y over time; say'):
        load_drive(tmp_path / "drive.toml")
