"""What diverges stays within bounds: no index comes from a number that is none, and neighbors do not notice."""

import numpy as np
import pytest
import warp as wp
from blocks import light_wheels, run_blocks, sharing, unusual_contacts
from drives import two_sprockets
from own_kernels import kernel

from warpchain import Record, load_drive, simulate
from warpchain.drive.examples import drive_path
from warpchain.engine.pack import pack
from warpchain.kernels.physics.motion import table_integral
from warpchain.kernels.physics.tooth import nearest_seat
from warpchain.kernels.structs import Tabulated
from warpchain.results.schedule import Schedule

ODD = [np.nan, np.inf, -np.inf, 1e308, -1e308, 1e-320, 0.0]


@kernel
def seats(points: wp.array[wp.vec2d], heading: wp.vec2d, teeth: int, out: wp.array[int]):
    i = wp.tid()
    out[i] = nearest_seat(points[i], heading[0], heading[1], teeth)


@kernel
def cells(at: wp.array[wp.float64], table: Tabulated, values: wp.array[wp.float64], out: wp.array[wp.float64]):
    value, integral = table_integral(at[wp.tid()], table, values)
    out[wp.tid()] = value


def test_a_seat_is_a_seat_whatever_comes_in():
    points = np.array([(x, y) for x in ODD for y in ODD])
    for heading in ((1.0, 0.0), (np.nan, np.nan), (np.inf, 0.0)):
        for teeth in (5, 57):
            out = wp.full(len(points), -7, dtype=int, device="cpu")
            inputs = [wp.array(points, dtype=wp.vec2d, device="cpu"), wp.vec2d(*heading), teeth, out]
            wp.launch(seats, dim=len(points), inputs=inputs, device="cpu")
            assert ((out.numpy() >= 0) & (out.numpy() < teeth)).all()


@pytest.mark.parametrize("repeats", [0, 1])
def test_a_table_is_read_within_its_cells_whatever_comes_in(repeats):
    # the only cell's values; what stood beside it would show
    table = Tabulated()
    table.cells, table.first, table.repeats, table.spacing = 1, 5, repeats, 1.0
    beside = np.full(5, 1e300)
    values = wp.array(
        np.concatenate([beside, [3.0, 0.0, 0.0, 0.0, 0.0], [3.0], beside]), dtype=wp.float64, device="cpu"
    )
    out = wp.zeros(len(ODD), dtype=wp.float64, device="cpu")
    at = wp.array(np.array(ODD), dtype=wp.float64, device="cpu")
    wp.launch(cells, dim=len(ODD), inputs=[at, table, values, out], device="cpu")
    found = out.numpy()
    assert (np.isnan(found) | (found == 3.0)).all()


def mad(count, seed=0):
    """Copies of a drive that loads and contacts of absurd size tear apart, each in its own way."""
    rng = np.random.default_rng(seed)
    drive = two_sprockets(settle="false", duration=2e-3)
    for _ in range(count):
        values = {
            "sprockets.driven.load.viscous": 10.0 ** rng.uniform(5, 9),
            "sprockets.driven.load.quadratic": 10.0 ** rng.uniform(2, 9),
            "sprockets.driven.inertia": 10.0 ** rng.uniform(-3, -1),
            "contact.sprocket.impact_speed_floor": 10.0 ** rng.uniform(-9, -2),
        }
        yield drive.with_values(values)


def between(sound, others):
    """Variants with `sound` before, between and after them, and the places of the sound ones."""
    drives = [drive for other in others for drive in (sound, other)] + [sound]
    return drives, range(0, len(drives), 2)


@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("integrator", ["leapfrog", "rk4"])
def test_diverging_variants_stop_and_leave_their_neighbors_alone(precision, integrator):
    sound = two_sprockets(settle="false", duration=2e-3)
    drives, places = between(sound, mad(12))
    drives = [drive.with_values({"run.integrator": integrator}) for drive in drives]
    record = Record(rate=5e3)
    run = simulate(drives, precision=precision, record=record, device="cpu", workers=2)
    alone = simulate(drives[0], precision=precision, record=record, device="cpu", workers=1)
    diverged = np.array(run.metrics["diverged"])
    assert diverged[1::2].sum() >= 8 and not diverged[::2].any()
    for v in places:
        for name, values in run[v].channels().items():
            np.testing.assert_array_equal(values, alone[0].channels()[name], err_msg=f"{v} {name}")


@pytest.mark.usefixtures("fibers")
@pytest.mark.parametrize("precision", [pytest.param("float64", marks=pytest.mark.thorough), "float32"])
def test_diverging_blocks_stop_and_leave_their_neighbors_alone(precision):
    drives, places = between(two_sprockets(settle="false"), mad(12))
    packed = pack(drives, [Schedule(5e-6, 400, 11, 390, 0)] * len(drives)).at_precision(precision)
    none = wp.zeros(1, dtype=packed.real, device="cpu")
    _, kind, _ = sharing((light_wheels, unusual_contacts), True, precision)
    state, sums = run_blocks(packed, kind, [401], [*range(len(drives))], none)
    diverged = state.progress.numpy()["diverged"]
    assert diverged[1::2].sum() >= 8 and not diverged[::2].any()
    n = 6 * drives[0].chain.links
    rows = state.rollers.numpy().reshape(-1, n)
    for v in places:
        np.testing.assert_array_equal(rows[v], rows[0])
        assert sums["chain"][v] == sums["chain"][0]


def test_a_sprocket_that_is_no_number_ends_its_variant():
    # an explicit viscous moment far beyond J / h: the angle overflows, and no roller feels it
    drive = load_drive(drive_path("engine")).with_values({"sprockets.exhaust cam.load.viscous": 1e5})
    run = simulate(drive, duration=0.02, record=Record(variants="none"), device="cpu")
    assert run.metrics["diverged"][0].as_py()
