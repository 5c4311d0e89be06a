"""Pivots and centers led along tables: pendulums, energy, float32, archive, playback, statics."""

import math
import tomllib

import numpy as np
import pytest
from drives import BLADE, errors_of, example, two_sprockets

from warpchain import Record, load_drive, read_archive, simulate, write_archive
from warpchain.drive.examples import drive_path
from warpchain.results.scene import parts_at, pose_at_frame
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
    drive = led(shaken(), damping=0.05, stiffness=2.0).with_values({"run.integrator": integrator})
    row = simulate(drive, duration=0.19, window=(0.03, 0.18), precision=precision).metrics.to_pylist()[0]
    assert abs(row["pendulum.pivot_work"]) > 0.05 and row["pendulum.damping_loss"] > 1e-4
    assert abs(row["energy_residual"]) < (1e-4 if precision == "float64" else 1e-3) * row["pendulum.pivot_work"]


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
    assert table.farthest == pytest.approx(0.05 * math.hypot(max(map(abs, table.x)), max(table.y)))
    last = len(time) - 1
    (line,) = [part.points for part in parts_at(drive, pose_at_frame(back, last)) if part.kind == "arm"]
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
        assert np.abs(seated.min(axis=1) - drive.pitch_radius(1)).max() < 3e-4
        arm = run.position[0] - run.sprocket_center[0, 1]
        on = np.hypot(*arm.T) < drive.pitch_radius(1) + 1e-3
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
    with pytest.raises(Exception, match='row 1: "time,speed" is no head; the columns must be time, then x or x_mm'):
        load_drive(tmp_path / "drive.toml")
