"""Speeds and torques as tables: the grid and its integral, run-up and coast-down, angle, files, and their errors."""

import numpy as np
import pytest
import warp as wp
from drives import errors_of, marine_values, put, two_sprockets
from own_kernels import kernel
from scipy.interpolate import PchipInterpolator

from warpchain import Record, load_drive, loads_drive, simulate
from warpchain.assembly.table_cells import TableCells, hermite, table_cells, table_slopes
from warpchain.drive import SpeedTable, TorqueTable, dumps_drive
from warpchain.errors import DriveError
from warpchain.kernels import structs
from warpchain.kernels.physics.motion import table_integral, table_slope
from warpchain.model import single_chain

TURN = 2 * np.pi


@kernel
def look(
    x: wp.array[wp.float64],
    table: structs.Tabulated,
    values: wp.array[wp.float64],
    out: wp.array[wp.vec3d],
):
    i = wp.tid()
    value, integral = table_integral(x[i], table, values)
    slope = table_slope(x[i], table, values)
    out[i] = wp.vec3d(value, integral, slope)


def on_device(cells: TableCells, x):
    """(values, integrals, slopes) of a table at x, as a kernel finds them."""
    row = np.zeros(1, dtype=structs.Tabulated.numpy_dtype())
    cells.fill(row[0], 0)
    table = structs.Tabulated()
    for name in row.dtype.names:
        setattr(table, name, row[name][0].item())
    out = wp.zeros(len(x), dtype=wp.vec3d, device="cpu")
    arrays = [wp.array(v, dtype=wp.float64, device="cpu") for v in (np.asarray(x, float), cells.values())]
    wp.launch(look, dim=len(x), inputs=[arrays[0], table, arrays[1], out], device="cpu")
    return out.numpy().T


@pytest.mark.parametrize("interpolation", ["linear", "cubic"])
@pytest.mark.parametrize("time", [(0.0, 0.5, 1.0, 1.5, 2.0), (0.25, 0.5, 0.75, 2.0, 3.5), (-1.0, 0.0, 0.3, 1.7, 2.0)])
def test_table_over_time_is_its_rows_interpolation_and_integral(time, interpolation):
    # these rows are on a common grid, so the kernel's cubics are numpy's lines or scipy's PCHIP themselves
    speed = (3.0, 4.0, 4.0, 1.0, 7.0)
    cells = table_cells(SpeedTable(time=time, speed=speed, interpolation=interpolation, factor=2.0), 1.0)
    x = np.linspace(time[0] - 1.0, time[-1] + 1.0, 701)
    value, integral, slope = on_device(cells, x)
    held = np.clip(x, time[0], time[-1])
    exact = PchipInterpolator(time, speed)
    expected = exact(held) if interpolation == "cubic" else np.interp(held, time, speed)
    np.testing.assert_allclose(value, 2.0 * expected, atol=1e-12)
    # the integral from 0: its derivative is the value, by Simpson's rule exact for cubics inside a cell
    fine = np.unique(np.concatenate([np.linspace(0.0, t, 2) for t in x] + [np.array(time)]))
    middle = 0.5 * (fine[1:] + fine[:-1])
    f = lambda t: on_device(cells, t)[0]  # noqa: E731
    parts = np.diff(fine) / 6.0 * (f(fine[:-1]) + 4.0 * f(middle) + f(fine[1:]))
    total = np.append(0.0, np.cumsum(parts))
    total -= np.interp(0.0, fine, total)
    np.testing.assert_allclose(integral, np.interp(x, fine, total), atol=1e-12)
    inside = np.abs(x[:, None] - np.array(time)).min(axis=1) > 1e-9
    outside = (x < time[0]) | (x > time[-1])
    if interpolation == "cubic":
        np.testing.assert_allclose(slope[inside & ~outside], 2.0 * exact.derivative()(x[inside & ~outside]), atol=1e-10)
    assert (slope[outside] == 0.0).all()


def test_rows_without_a_common_grid_are_met_within_a_fine_one():
    # grid points at 1/64 of the smallest distance: a kink of slope change s is cut by at most s d / 4
    time = (0.0, 1.0, 1.0 + np.sqrt(2.0), 4.0)
    cells = table_cells(TorqueTable(time=time, torque=(0.0, 5.0, -1.0, 2.0)), 1.0)
    x = np.linspace(0.0, 4.0, 1001)
    apart = np.abs(on_device(cells, x)[0] - np.interp(x, time, (0.0, 5.0, -1.0, 2.0))).max()
    assert cells.spacing <= 1.0 / 64
    assert 0.0 < apart <= (5.0 + 6.0 / np.sqrt(2.0)) * cells.spacing / 4.0


@pytest.mark.parametrize("interpolation", ["linear", "cubic"])
def test_torque_over_angle_goes_round(interpolation):
    # 0..720 degrees of a four-stroke engine's crank; here over a camshaft that turns half as fast
    angle = np.radians([0.0, 180.0, 240.0, 360.0, 720.0])
    torque = (10.0, 300.0, -50.0, 20.0, 10.0)
    table = TorqueTable(angle=angle, torque=torque, interpolation=interpolation, shaft="crank")
    x = np.linspace(-7.0, 7.0, 501)
    value = on_device(table_cells(table, 0.5), x)[0]
    round_once = np.mod(2.0 * x, 2 * TURN)
    rows = [
        np.concatenate([angle[:-1] - 2 * TURN, angle, angle[1:] + 2 * TURN]),
        np.array(torque[:-1] + torque + torque[1:]),
    ]
    smooth = PchipInterpolator(*rows)(round_once)
    np.testing.assert_allclose(value, smooth if interpolation == "cubic" else np.interp(round_once, *rows), atol=1e-9)


@pytest.mark.parametrize("interpolation", ["linear", "cubic"])
def test_speed_over_angle_becomes_the_same_speed_over_time(interpolation):
    # d phi / dt = Omega(phi): the kernel's phi(t) is the exact integral of its speed, and its speed that of the table
    # at phi; a revolution takes the integral of d phi / Omega, and phi comes round exactly
    angle = np.linspace(-np.pi, np.pi, 13)
    speed = 10.0 + 2.0 * np.cos(2 * angle) + np.sin(angle)
    speed[-1] = speed[0]
    table = SpeedTable(angle=angle, speed=speed, interpolation=interpolation)
    cells = table_cells(table, 1.0)
    period = cells.spacing * len(cells.coefficients)
    x = np.linspace(0.0, 3 * period, 1000)
    value, phi, _ = on_device(cells, x)
    omega = lambda a: hermite(angle, speed, table_slopes(table), np.mod(a + np.pi, TURN) - np.pi)[0]  # noqa: E731
    tolerance = 1e-5 if interpolation == "cubic" else 1e-3  # rows, where slope or curvature jump, are inside cells
    np.testing.assert_allclose(value, omega(phi), rtol=tolerance)
    assert on_device(cells, [period, 2 * period])[1] == pytest.approx([TURN, 2 * TURN], rel=1e-14)
    fine = np.linspace(0.0, TURN, 200_001)
    assert period == pytest.approx(np.trapezoid(1.0 / omega(fine), fine), rel=1e-8)


def run_up(time, speed, **values):
    drive = two_sprockets(speed=0.0, torque=50.0, duration=0.3, gravity=-9.81)
    return drive.with_values({"sprockets.driver.prescribed.table": {"time": time, "speed": speed}} | values)


@pytest.mark.parametrize("integrator", ["leapfrog", "rk4"])
def test_run_up_and_coast_down_turn_by_the_exact_integral(integrator):
    # trapezoid of a speed: theta = w integral of Omega; the chain follows the driver
    time, speed = (0.0, 0.1, 0.2, 0.25), (0.0, 12.0, 12.0, 2.0)
    trajectory = simulate(run_up(time, speed, **{"run.integrator": integrator}), record=Record(rate=2000.0))[0]
    t = trajectory.time
    expected = np.interp(t, time, speed)
    steps = np.append(0.0, np.cumsum(np.diff(t) * 0.5 * (expected[1:] + expected[:-1])))  # frames are on all rows
    np.testing.assert_allclose(trajectory.sprocket_speed[:, 0], expected, atol=1e-12)
    np.testing.assert_allclose(trajectory.sprocket_angle[:, 0] - trajectory.sprocket_angle[0, 0], steps, atol=1e-12)
    turned = trajectory.sprocket_angle - trajectory.sprocket_angle[0]
    assert np.abs(turned[:, 1] - turned[:, 0]).max() < 0.05  # it swings on the chain, an eighth of a tooth


def test_chain_starts_at_the_tables_first_speed():
    drive = run_up((0.0, 1.0), (6.0, 12.0))
    trajectory = simulate(drive, duration=1e-4)[0]
    assert trajectory.sprocket_speed[0] == pytest.approx([6.0, 6.0], rel=1e-3)
    assert np.hypot(*trajectory.velocity[0].T).mean() == pytest.approx(
        6.0 * single_chain(drive).pitch_radius(0), rel=0.02
    )


def test_load_table_is_the_load():
    # a torque tabulated over time, and one over angle that is a cosine, against the load's own keys
    base = two_sprockets(torque=0.0, duration=0.05)
    angle = np.linspace(0.0, TURN, 721)
    cosine = np.cos(3 * angle)
    cosine[-1] = cosine[0]
    one = base.with_values({"sprockets.driven.load.table": {"time": [0.0, 9.0], "torque": [300.0, 300.0]}})
    wave = {"angle": angle, "torque": cosine, "interpolation": "cubic", "factor": 80.0}
    two = base.with_values({"sprockets.driven.load.torque": 300.0, "sprockets.driven.load.table": wave})
    plain = base.with_values({"sprockets.driven.load.torque": 300.0})
    harmonic = plain.with_values({"sprockets.driven.load.harmonics": [{"order": 3.0, "amplitude": 80.0}]})
    table, constant, angular, order = (simulate(d)[0].sprocket_speed[:, 1] for d in (one, plain, two, harmonic))
    np.testing.assert_array_equal(table, constant)
    # PCHIP is flat at the rows of extremes: off by up to 80 N m 9e-4 / 8 there, over 2 kg m^2 and 0.05 s
    assert np.abs(order - constant).max() > 0.1
    np.testing.assert_allclose(angular, order, atol=1e-3)


def test_engine_orders_count_a_shafts_revolutions_by_teeth():
    base = two_sprockets(duration=0.02)
    own = base.with_values({"sprockets.driven.load.harmonics": [{"order": 4.0, "amplitude": 80.0}]})
    engine = [{"order": 2.0, "amplitude": 80.0, "shaft": "driver"}]
    values = {"sprockets.driver.teeth": 10, "sprockets.driven.teeth": 20, "chain.links": 55}
    by_shaft = base.with_values(values | {"sprockets.driven.load.harmonics": engine})
    own = own.with_values(values | {"sprockets.driven.load.harmonics.0.order": 4.0})
    from warpchain.engine.pack import pack
    from warpchain.results.schedule import Schedule

    schedule = Schedule(5e-6, 10, 0, 10, 0)
    # crank of 10 teeth, camshaft of 20: it turns half as fast, so order 2 of the crank is 4 a turn of its own
    np.testing.assert_array_equal(pack([by_shaft], [schedule]).harmonics, pack([own], [schedule]).harmonics)


CSV = "# measured\ntime,speed_rpm\n0,0\n\n0.1, 60\n0.2,60\n"


def with_csv(folder, text=CSV, table='{ file = "speed.csv" }', part="prescribed"):
    drive = dumps_drive(two_sprockets())
    (folder / "speed.csv").write_text(text)
    path = folder / "drive.toml"
    old = "prescribed = { speed = 10.0, ramp_time = 0.0 }"
    if part == "load":
        path.write_text(drive.replace("load = { torque", f"load = {{ table = {table}, torque"))
    else:
        assert old in drive
        path.write_text(drive.replace(old, f"prescribed = {{ table = {table} }}"))
    return path


def test_csv_file_is_read_beside_the_drive_and_stays_with_it(tmp_path):
    drive = load_drive(with_csv(tmp_path))
    table = drive.sprockets[0].prescribed.table
    assert table.time == (0.0, 0.1, 0.2)
    assert table.speed == pytest.approx((0.0, TURN, TURN))
    assert loads_drive(dumps_drive(drive)) == drive
    assert drive.sprockets[0].prescribed.top_speed == pytest.approx(TURN)
    faster = drive.with_values({"sprockets.driver.prescribed.table.factor": 2.0})
    assert faster.sprockets[0].prescribed.top_speed == pytest.approx(2 * TURN)
    back = faster.with_values({"sprockets.driver.prescribed.speed": 3.0})
    assert back.sprockets[0].prescribed.table is None
    degrees = "angle_deg,torque\n0,1\n360,5\n720,1\n"
    load = load_drive(with_csv(tmp_path, degrees, '{ file = "speed.csv", shaft = "driver" }', "load")).sprockets[1].load
    assert load.table.revolutions == 2


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "must have a line of names and lines of numbers below it, of two columns at least"),
        ("0,1\n1,2\n", "line 1: numbers begin, and no line of names"),
        ("time,speed,torque\n0,1,2\n", 'line 1: column #3, "torque", is not known; must be speed over time or angle;'),
        ("time,speed\n0,1\n", "has 1 rows of numbers; must have 2 to 1000000"),
        ("time,speed\n0,1\n# here\n1;2\n", 'line 4: "1;2" is not a finite number'),
        ("time,speed\n0,1\n1,fast\n", 'line 3: "fast" is not a finite number'),
        ("time,speed\n0,1\n1,nan\n", 'line 3: column "speed" has no number; each line must have one'),
        ("time,speed\n0,1\n2,1\n1,1\n", "line 4: time = 1 must be above that of the row before"),
    ],
)
def test_bad_csv_names_file_and_row(tmp_path, text, problem):
    path = with_csv(tmp_path, text)
    with pytest.raises(DriveError) as caught:
        load_drive(path)
    (line,) = caught.value.errors
    assert line.startswith(f'{path}: sprockets.driver.prescribed.table.file = "speed.csv": {problem}')


def test_missing_csv_and_file_outside_a_drive_file(tmp_path):
    path = with_csv(tmp_path)
    (tmp_path / "speed.csv").unlink()
    with pytest.raises(DriveError, match=r'table\.file = "speed\.csv": cannot be read: no such file or directory$'):
        load_drive(path)
    with pytest.raises(DriveError, match=r"prescribed\.table\.file = .*: only drive files name a file"):
        loads_drive(path.read_text())
    both = with_csv(tmp_path, table='{ file = "speed.csv", time = [0, 1] }')
    with pytest.raises(DriveError, match=r'"speed\.csv": not together with time; the file has that column$'):
        load_drive(both)


PLACE = "sprockets/0/prescribed"
START = "sprockets.crankshaft.prescribed.table"
RULES = [
    ({"speed": [1, 2]}, f"{START}.time: missing; must be a list of numbers, or give angle or file instead"),
    ({"time": [0, 1], "angle": [0, 1], "speed": [1, 2]}, f"{START}.angle = [0.0, 1.0]: not together with time; give"),
    ({"time": [0, 1], "speed": [1, 2], "shaft": "camshaft"}, f'{START}.shaft = "camshaft": only together with angle'),
    ({"time": [0, 1], "speed": [1, 2, 3]}, f"{START}.speed = [1.0, 2.0, 3.0]: must have as many elements as time, 2"),
    ({"time": [0, 1, 1], "speed": [1, 2, 3]}, f"{START}.time.2 = 1.0: must be above the element before, 1"),
    ({"time": [0, 1], "speed": [0, -2]}, f"{START}.speed = [0.0, -2.0]: must have a positive element; forward is"),
    ({"time": [0], "speed": [1]}, f"{START}.time = [0]: must be a list of at least 2 finite numbers"),
    ({"time": [0, 1], "speed": "ab"}, f'{START}.speed = "ab": must be a list of at least 2 finite numbers'),
    ({"time": [0, 1], "speed": [1, 2], "interpolation": "x"}, f'{START}.interpolation = "x": must be "linear" '),
    ({"time": [0, 1], "speed": [1, 2], "factor": 0}, f"{START}.factor = 0.0: must be a positive number"),
    ({"angle": [0, 3], "speed": [1, 1]}, f"{START}.angle.1 = 3.0: must be a whole number of revolutions after"),
    ({"angle": [0, TURN], "speed": [1, 2]}, f"{START}.speed.1 = 2.0: must repeat the first element, 1"),
    ({"angle": [0, TURN], "speed": [0, 0]}, f"{START}.speed.0 = 0.0: must be above 0 over angle"),
    (
        {"angle": [0, TURN], "speed": [1, 1], "shaft": "camshat"},
        f'{START}.shaft = "camshat": must be the name of a sprocket; did you mean camshaft?',
    ),
]  # fmt: skip


@pytest.mark.parametrize(("table", "start"), RULES)
def test_rules_of_tables(table, start):
    values = marine_values()
    put(values, PLACE, {"table": table})
    assert errors_of(values)[0].startswith(start), errors_of(values)


def test_speed_and_table_exclude_each_other():
    values = marine_values()
    put(values, f"{PLACE}/table", {"time": [0, 1], "speed": [1, 2]})
    put(values, f"{PLACE}/ramp_time", 0.1)
    assert errors_of(values) == (
        "sprockets.crankshaft.prescribed.speed = 9.53: not together with table; give one of the two",
        "sprockets.crankshaft.prescribed.ramp_time = 0.1: not together with table",
    )
