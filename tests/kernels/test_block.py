"""The block kernel: against the CPU kernel on cooperative fibers, and compiled for CUDA where there is no GPU."""

import json
from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np
import pytest
import warp as wp
from drives import timing, two_sprockets

from warpchain import Drive, load_drive
from warpchain.assembly.timestep import step_limit
from warpchain.drive.examples import drive_path
from warpchain.drive.stack import stacks_of
from warpchain.engine.arrays import NOTES, empty_sums, empty_tallies, upload_ensemble, upload_state
from warpchain.engine.block_shape import BlockShape, block_shape, room_for
from warpchain.engine.buckets import curved
from warpchain.engine.cpu import CpuEngine
from warpchain.engine.pack import pack
from warpchain.engine.settling import cushion, elastic, quickened
from warpchain.engine.states import GROUPS, Keeper, States
from warpchain.kernels.gpu.block import block_kernel
from warpchain.kernels.gpu.block_kind import DECLARED, BlockKind
from warpchain.kernels.gpu.block_observe import collect
from warpchain.kernels.gpu.block_relax import block_relax_kernel
from warpchain.kernels.gpu.exchange import room
from warpchain.kernels.relaxation import Settling
from warpchain.kernels.tension_bins import BINS
from warpchain.results.channels import FRAME, NAMES, Sizes, frame_of, frame_width
from warpchain.results.schedule import Schedule

FOREVER = 10**8
OTHER_TEETH = {
    "chain.worn_links": [{"link": 3, "elongation": 1e-3}],
    "contact.sprocket.law": "kelvin-voigt",
    "contact.sprocket.profile": "iso606",
    "contact.sprocket.gap": "maximum",
    "contact.sprocket.clearance": None,
    "contact.sprocket.seat_angle": None,
}


@pytest.fixture
def fibers():
    """Blocks of several threads on the CPU, for one test."""
    before = wp.config.enable_cpu_blocks
    wp.config.enable_cpu_blocks = True
    yield
    wp.config.enable_cpu_blocks = before


def marine():
    drive = load_drive(drive_path("marine"))
    return [drive, drive.with_values({"sprockets.camshaft.load.torque": 5e3, "run.step": 8e-6})]


def equal_sprockets():
    return [two_sprockets(), two_sprockets(teeth=24, links=64, torque=100.0).with_values(OTHER_TEETH)]


def long_chains():
    return [two_sprockets(links=320, span=150.0), two_sprockets(links=340, span=160.0)]


def unusual_contacts():
    table = {"time": [0.0, 5e-4, 2e-3], "torque": [0.0, 500.0, 100.0]}
    drives = [
        {
            "contact.sprocket.profile": "iso606",
            "contact.sprocket.gap": "maximum",
            "contact.sprocket.clearance": None,
            "contact.sprocket.seat_angle": None,
            "contact.sprocket.law": "kelvin-voigt",
            "sprockets.driven.load.table": table,
        },
        {
            "contact.sprocket.law": "flores",
            "contact.sprocket.exponent": 1.5,
            "contact.sprocket.stiffness": 1e10,
            "chain.worn_links": [{"link": 7, "elongation": 2e-3}],
            "chain.elongation": 1e-4,
        },
    ]
    return [two_sprockets().with_values(values) for values in drives]


def moving_sprockets():
    springs = {"kind": "elastic", "stiffness": [1e6, 1e6], "damping": [1e3, 1e3], "preload": [2e3, -500.0]}
    slider = {"kind": "slider", "direction": [1.0, 0.2], "stiffness": 1e5, "damping": 200.0, "preload": 1e3}
    shaken = {"kind": "prescribed", "direction": [0.0, 1.0], "amplitude": 1e-4, "frequency": 40.0}
    wheel = {"mass": 2.0, "radius": 0.05, "phase": 0.3}
    drives = [
        {"sprockets.driven.mount": springs, "sprockets.driven.mass": 30.0, "sprockets.driven.balance_wheel": wheel},
        {"sprockets.driven.mount": slider, "sprockets.driven.mass": 30.0, "sprockets.driver.mount": shaken},
    ]
    return [two_sprockets().with_values(values) for values in drives]


def large(packed, shape, blocks):
    """What `upload_state` is to keep in global memory for such blocks."""
    of = room_of(packed, shape)
    return blocks * of.values, blocks * of.integers, blocks * of.part_values


def room_of(packed, shape):
    """What such a block shares."""
    return room(kind_of(packed, shape))


def kind_of(packed, shape, measuring=True):
    """The kind of the block kernel, with metrics or without, for an ensemble of like drives."""
    return BlockKind(
        packed.real,
        shape.threads,
        shape.per,
        int(packed.drives["sprockets"][0]),
        int(packed.drives["guides"][0]),
        moving=bool(packed.mounts["active"].any()),
        measuring=measuring,
        rk4=bool(packed.drives["integrator"].any()),
        bending=bool(packed.joints["rubs"].any()),
        sliding=bool(packed.slides.any()),
        uneven=bool(packed.links["uneven"].any()),
        crewed=shape.crewed,
        roomy=not measuring and shape.roomy,
        arms=int(packed.drives["arms"][0]),
        tensioners=int(packed.drives["tensioners"][0]),
        profiles=bool(packed.drives["pieces"].any()),
        curved=bool(curved(packed).any()),
        linear=bool(packed.linear.all()),
    )


def rk4():
    drives = [*equal_sprockets()[:1], *moving_sprockets()[1:]]
    return [drive.with_values({"run.integrator": "rk4"}) for drive in drives]


def rk4_on_guide_bar():
    return [drive.with_values({"run.integrator": "rk4"}) for drive in marine()]


BENDING = {"chain.joint": {"friction": 0.1, "pin_radius": 0.02}}
STRIBECK = {"chain.joint": {"friction": 0.08, "static_friction": 0.12, "stribeck_speed": 0.02, "pin_radius": 0.02}}


def bending():
    first, second = marine()
    return [first.with_values(BENDING), second.with_values(STRIBECK)]


def bending_rk4():
    return [drive.with_values({"run.integrator": "rk4"}) for drive in bending()]


RUBS = {"contact.sprocket.friction": 0.1, "contact.guide.friction": 0.2}
RUBS |= {"contact.sprocket.static_friction": 0.15, "contact.sprocket.stribeck_speed": 0.1}
"""Friction at teeth and guide-bars."""


def rubbing():
    """On a bar that rollers of its ends are pressed on and others have missed, and one that all have; tight chains."""
    drives = []
    for drive, deep in zip(marine(), (0.02, 0.05), strict=True):
        bar = {f"guides.0.{end}.0": getattr(drive.guides[0], end)[0] + deep for end in ("start", "end")}
        tight = {"chain.elongation": -2e-4, "sprockets.crankshaft.prescribed.ramp_time": 0.0}
        drives.append(drive.with_values(RUBS | bar | tight))
    return drives


def uneven():
    first, second = marine()
    outer = {"elongation": 1e-3, "stiffness": 1.2e9, "damping": 2e4}
    return [first.with_values(BENDING | {"chain.play": 2e-5}), second.with_values({"chain.outer": outer})]


def arms():
    """An arm with a hydraulic tensioner, and one with a spring, ratchet and damper against its stop."""
    latched = {
        "tensioners.0.kind": "spring", "tensioners.0.chamber": None, "tensioners.0.valve": None,
        "tensioners.0.oil": None, "tensioners.0.ratchet": {"pitch": 1e-3, "backlash": 2e-4},
        "tensioners.0.spring.damping": 50.0, "arms.0.damping": 1e-3, "arms.0.stiffness": 2.0,
        "arms.0.stops": [-12.0, -0.1],
    }  # fmt: skip
    return [timing(), timing().with_values(latched)]


def arms_rk4():
    return [drive.with_values({"run.integrator": "rk4"}) for drive in arms()]


def pushed_slider():
    """A sprocket on a slide with a tensioner on it, and another drive whose slide a spring pushes."""
    mount = {"kind": "slider", "direction": [1.0, 0.0], "stiffness": 1e5, "damping": 200.0, "preload": 0.0}
    oil = timing().tensioners[0].model_dump() | {"name": "plunger", "on": "driven", "direction": [1.0, 0.0]}
    push = {"name": "plunger", "on": "driven", "at": [0.0, 0.0], "direction": [1.0, 0.0], "kind": "spring"}
    push |= {"spring": {"stiffness": 1e4, "preload": 2e3, "damping": 100.0}, "plunger": {"mass": 0.5}}
    base = two_sprockets().with_values({"sprockets.driven.mount": mount, "sprockets.driven.mass": 30.0})
    return [Drive(**base.model_dump(exclude_none=True) | {"tensioners": [one]}) for one in (oil, push)]


def rubbing_rk4():
    return [drive.with_values({"run.integrator": "rk4"}) for drive in rubbing()]


def rubbing_on_moving_sprockets():
    teeth = {key: value for key, value in RUBS.items() if "sprocket" in key} | {"chain.elongation": -2e-4}
    return [drive.with_values(teeth) for drive in moving_sprockets()]


def run_blocks(packed, shape, blocks, order, frames, measuring=True):
    """The ensemble on blocks of fibers: its state, its sums, and its frames."""
    ensemble, state = upload_ensemble(packed, "cpu"), upload_state(packed, "cpu", large(packed, shape, len(order)))
    sums, tallies = empty_sums(packed, "cpu"), empty_tallies(packed, "cpu")
    threads = shape.threads
    kernel = block_kernel(kind_of(packed, shape, measuring), 4, packed.frame)
    turn = wp.array(order, dtype=wp.int32, device="cpu")
    for block in blocks:
        inputs = [ensemble, state, sums, tallies, frames, turn, block, 0]
        wp.launch(kernel, dim=len(order) * threads, inputs=inputs, block_dim=threads, device="cpu")
    wp.launch(collect, dim=packed.variants, inputs=[ensemble.drives, tallies, sums], device="cpu")
    return state, sums


def flat(rows):
    """The fields of structured rows by name, those of nested ones among them."""
    found = {}
    for name in rows.dtype.names:
        found |= flat(rows[name]) if rows.dtype[name].names else {name: rows[name]}
    return found


def joint_powers(packed, drive, frames):
    """Friction power of each joint, of 16 frames of a drive."""
    found = packed.frame.split(frames.reshape(16, -1), Sizes.of(drive))
    return found["joint_friction_power"]


@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("many", [False, True], ids=["few", "many"])
@pytest.mark.parametrize(
    "drives",
    [
        marine,
        equal_sprockets,
        moving_sprockets,
        long_chains,
        unusual_contacts,
        rk4,
        rk4_on_guide_bar,
        rubbing,
        rubbing_rk4,
        bending,
        bending_rk4,
        rubbing_on_moving_sprockets,
        uneven,
        arms,
        arms_rk4,
        pushed_slider,
    ],
)
def test_block_kernel_takes_the_steps_of_the_cpu_kernel(fibers, drives, many, precision):
    variants = drives()
    shape = block_shape(int(room_for(np.array([drive.chain.links for drive in variants])).max()), 100 if many else 1)
    schedules = [Schedule(drive.run.step, 300, 111, 290, 20) for drive in variants]
    packed = pack(variants, schedules).at_precision(precision)
    bends = bool(packed.joints["rubs"].any())
    packed = replace(packed, frame=frame_of(NAMES if bends else ()))
    widths = [frame_width(drive, packed.frame) * 16 for drive in variants]
    packed.drives["first_value"] = [0, widths[0]]
    serial = CpuEngine(packed, 1)
    theirs = serial.frame_buffer(sum(widths))
    for future in serial.advance(301, theirs):
        future.result()
    serial.close()
    ours = serial.frame_buffer(sum(widths))
    ours.fill_(np.nan)
    state, sums = run_blocks(packed, shape, [301], [1, 0], ours)  # the launch's order of variants does not matter
    assert state.progress.numpy()["step"].tolist() == [301, 301]
    assert state.progress.numpy()["diverged"].tolist() == [0, 0]
    # the same functions in the same order; moments are added up in another: round-off, which contacts amplify
    tolerance = 1e-9 if precision == "float64" else 3e-4
    close = partial(np.testing.assert_allclose, atol=tolerance, rtol=tolerance)
    close(state.rollers.numpy(), serial.state.rollers.numpy())
    np.testing.assert_array_equal(state.seat.numpy(), serial.state.seat.numpy())
    for name in ("angle", "speed", "center", "velocity"):
        close(state.bodies.numpy()[name], serial.state.bodies.numpy()[name])
    # forces are differences of positions times stiffness: relative to the largest there is
    close(ours.numpy(), theirs.numpy(), atol=(1e-9 if precision == "float64" else 5e-3) * theirs.numpy().max())
    if bends:
        powers = [joint_powers(packed, variants[0], frames.numpy()[: widths[0]]) for frames in (ours, theirs)]
        close(*powers, atol=(1e-9 if precision == "float64" else 5e-3) * powers[1].max())
        assert powers[1].max() > 0.0
    summed = serial.sums()
    assert packed.slides.all() == (summed["contact"]["friction"] > 0.0).any()
    for name in ("chain", "strand", "sprocket", "mount", "contact", "slip", "arm", "tensioner", *NOTES):
        mine, theirs_ = flat(getattr(sums, name).numpy()), flat(summed[name])
        for field in mine:
            scale = np.abs(theirs_[field][np.isfinite(theirs_[field])]).max(initial=0.0)
            exact = 1.2e-7 if (name, field) == ("chain", "friction") else 1e-9  # of couples that are kept as float32
            loose = exact if precision == "float64" else 1e-2
            close(mine[field], theirs_[field], rtol=loose, atol=loose * scale, err_msg=f"{name}.{field}")
    # 7 looks at each link (steps 111, 128 to 288); round-off may take a tension over the edge of its bin to the next
    mine, theirs_ = (each.reshape(-1, BINS) for each in (sums.tension_counts.numpy(), summed["tension_counts"]))
    assert mine.sum() == theirs_.sum() == 7 * sum(drive.chain.links for drive in variants)
    np.testing.assert_array_equal(mine.sum(axis=1), theirs_.sum(axis=1))
    moved = np.abs(np.cumsum(mine - theirs_, axis=1)).sum()
    assert moved <= (2 if precision == "float64" else 0.05 * mine.sum()), moved


@pytest.mark.parametrize(
    ("drives", "each", "precision"),  # alone, so few that there is room for two contacts at once, many
    [*product([equal_sprockets], [1, 8, 100], ["float64", "float32"]), (marine, 1, "float64"), (marine, 8, "float32")],
)
def test_bare_block_kernel_takes_the_steps_of_the_cpu_kernel(fibers, drives, each, precision):
    variants = drives()
    shape = block_shape(int(room_for(np.array([drive.chain.links for drive in variants])).max()), each)
    assert shape.crewed == (each == 1) and shape.roomy == (each == 8)
    packed = pack(variants, [Schedule(drive.run.step, 2000, FOREVER, FOREVER, 0) for drive in variants])
    packed = packed.at_precision(precision)
    serial = CpuEngine(packed, 1)
    none = serial.frame_buffer(0)
    for future in serial.advance(700, none):
        future.result()
    serial.close()
    state, _ = run_blocks(packed, shape, [700], [0, 1], none, measuring=False)
    # rollers came to other seats, and others to sprockets, on the way; round-off, which contacts amplify
    assert (serial.state.seat.numpy() != packed.seat).any()
    tolerance = 1e-9 if precision == "float64" else 3e-4
    np.testing.assert_allclose(state.rollers.numpy(), serial.state.rollers.numpy(), atol=tolerance, rtol=tolerance)
    np.testing.assert_array_equal(state.seat.numpy(), serial.state.seat.numpy())
    for name in ("angle", "speed"):
        mine, theirs = (each.bodies.numpy()[name] for each in (state, serial.state))
        np.testing.assert_allclose(mine, theirs, atol=tolerance, rtol=tolerance)


def test_rows_beyond_shared_memory(fibers):
    variants = long_chains()
    shape = BlockShape(64, 16)
    packed = pack(variants, [Schedule(drive.run.step, 100, 11, 90, 0) for drive in variants])
    assert not room_of(packed, shape).shares_rows
    serial = CpuEngine(packed, 1)
    none = serial.frame_buffer(0)
    for future in serial.advance(101, none):
        future.result()
    serial.close()
    state, sums = run_blocks(packed, shape, [64, 37], [0, 1], none)
    # the same functions in the same order: round-off, which contacts amplify
    np.testing.assert_allclose(state.rollers.numpy(), serial.state.rollers.numpy(), atol=1e-9, rtol=1e-9)
    theirs = serial.sums()["chain"]
    np.testing.assert_allclose(sums.chain.numpy()["tension"], theirs["tension"], rtol=1e-9)


@pytest.mark.parametrize("drives", [equal_sprockets, rk4])
def test_metrics_from_the_first_step(fibers, drives):
    variants = drives()[:1]
    packed = pack(variants, [Schedule(drive.run.step, 64, 0, 64, 0) for drive in variants])
    serial = CpuEngine(packed, 1)
    none = serial.frame_buffer(0)
    for future in serial.advance(65, none):
        future.result()
    serial.close()
    _, sums = run_blocks(packed, BlockShape(32, 2), [65], [0], none)
    for name in ("chain", "strand", "sprocket", "contact"):
        for field in (theirs := serial.sums()[name]).dtype.names:
            ours, scale = getattr(sums, name).numpy()[field], np.abs(theirs[field]).max()
            # added up in another order, and tensions are small differences of lengths times a large stiffness
            atol = max(1e-9 * scale, 1e-11)
            np.testing.assert_allclose(ours, theirs[field], rtol=1e-9, atol=atol, err_msg=f"{name}.{field}")


@pytest.mark.parametrize(
    ("form", "blocks"), [((640, 1, 3, 1, True, True), 1), ((768, 1, 2, 0), 1), ((192, 1, 31, 0, False, True), 4)]
)
def test_blocks_ask_for_no_more_shared_memory_than_there_is(tmp_path, form, blocks):
    kernel = block_kernel(BlockKind(wp.float64, *form), blocks, FRAME)  # ptxas refuses what asks for more than 48 KiB
    wp.compile_aot_module(kernel.module, device=None, arch=90, module_dir=str(tmp_path), use_ptx=False)
    assert [path for path in tmp_path.iterdir() if path.suffix == ".cubin"]


def test_what_a_kernel_cannot_declare_is_asked_for_at_launch(tmp_path):
    # 1,024 rollers at float64: 6 rows of 8 bytes and an integer of 4, which no kernel may declare
    kind = BlockKind(wp.float64, 256, 4, 2, 0, shared_bytes=232_448)
    *starts, end = room(kind).asked
    assert room(kind).shares_rows and end >= 1024 * 52 and all(start % 16 == 0 for start in starts)
    assert room(replace(kind, shared_bytes=DECLARED)).asked == (None,) * 5
    module = block_kernel(kind, 2, FRAME).module
    wp.compile_aot_module(module, device=None, arch=90, module_dir=str(tmp_path), use_ptx=False)
    asked = json.loads(next(path for path in tmp_path.iterdir() if path.suffix == ".meta").read_text())
    assert all(bytes_ >= end for name, bytes_ in asked.items() if name.endswith("forward_smem_bytes"))


@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("drives", [equal_sprockets, rk4, moving_sprockets, arms, arms_rk4, pushed_slider])
def test_where_launches_end_does_not_matter(fibers, drives, precision):
    variants = drives()[:1]
    schedules = [Schedule(drive.run.step, 2100, 1000, 2100, 0) for drive in variants]
    packed = pack(variants, schedules).at_precision(precision)
    none = wp.zeros(1, dtype=packed.real, device="cpu")
    shape = BlockShape(32, -(-variants[0].chain.links // 32))
    once = run_blocks(packed, shape, [2101], [0], none)
    twice = run_blocks(packed, shape, [1024, 1024, 53], [0], none)
    for name in ("rollers", "bodies", "tensioners"):
        np.testing.assert_array_equal(getattr(once[0], name).numpy(), getattr(twice[0], name).numpy(), err_msg=name)
    for name in ("chain", "strand", "sprocket", "mount", "contact", "arm", "tensioner"):
        mine, theirs = getattr(once[1], name).numpy(), getattr(twice[1], name).numpy()
        np.testing.assert_array_equal(mine, theirs, err_msg=name)


FORMS = {
    "many": lambda real: block_kernel(BlockKind(real, 32, 4, 2, 1, measuring=True), 16, FRAME),
    "moving": lambda real: block_kernel(BlockKind(real, 128, 1, 2, 1, moving=True, measuring=True), 4, FRAME),
    "few": lambda real: block_kernel(BlockKind(real, 128, 1, 2, 1, measuring=True), 4, FRAME),
    "rk4": lambda real: block_kernel(BlockKind(real, 128, 1, 2, 1, measuring=True, rk4=True), 4, FRAME),
    "bending": lambda real: block_kernel(
        BlockKind(real, 32, 4, 2, 1, measuring=True, bending=True), 8, frame_of(NAMES)
    ),
    "rubbing": lambda real: block_kernel(
        BlockKind(real, 32, 4, 2, 1, moving=True, measuring=True, sliding=True), 12, FRAME
    ),
    "relax": lambda real: block_relax_kernel(BlockKind(real, 128, 1, 2, 1), 4),
}
ARCHITECTURES = {75: ("many", "moving"), 80: ("many", "moving"), 90: tuple(FORMS)}
"""Each form for the newest; for the older ones, those that use the most of what differs."""


@pytest.mark.parametrize(("arch", "form"), [(arch, form) for arch, forms in ARCHITECTURES.items() for form in forms])
@pytest.mark.parametrize("real", [wp.float64, wp.float32], ids=["float64", "float32"])
def test_block_kernel_compiles_for_cuda_without_a_gpu(tmp_path, real, arch, form):
    wp.compile_aot_module(FORMS[form](real).module, device=None, arch=arch, module_dir=str(tmp_path))
    assert [path for path in tmp_path.iterdir() if path.suffix in (".cubin", ".ptx")]


def test_blocks_settle_to_the_equilibrium_of_the_cpu(fibers):
    drive = two_sprockets().with_values({"run.gravity": [0.0, -9.81]})
    packed = pack([drive], [Schedule(drive.run.step, 10, 0, 10, 0)])
    still = elastic(packed)
    start = np.zeros(1, dtype=Settling.numpy_dtype())
    start["step"], start["tolerance"], start["limit"] = 0.7 * step_limit(drive), 1e-3, 100_000
    serial = CpuEngine(still, 1)
    serial.start_settling(start)
    for future in serial.settle(100_000):
        future.result()
    serial.close()
    settling = wp.array(start, dtype=Settling, device="cpu")
    ensemble, state, tallies = (
        upload_ensemble(still, "cpu"),
        upload_state(still, "cpu", (0, 0, 0)),
        empty_tallies(still, "cpu"),
    )
    order = wp.zeros(1, dtype=wp.int32, device="cpu")
    threads = 32 * -(-drive.chain.links // 32)
    kernel = block_relax_kernel(BlockKind(wp.float64, threads, 1, 2, 0), 4)
    for _ in range(40):
        inputs = [ensemble, state, tallies, settling, order, 1000]
        wp.launch(kernel, dim=threads, inputs=inputs, block_dim=threads, device="cpu")
    ours, theirs = settling.numpy(), serial.settling()
    assert ours["settled"][0] == theirs["settled"][0] == 1
    assert ours["residual"][0] < 1e-3
    # the same steps until round-off has a peak of kinetic energy seen a look earlier or later
    assert abs(int(ours["steps"][0]) - int(theirs["steps"][0])) <= 0.2 * theirs["steps"][0]
    np.testing.assert_allclose(
        state.rollers.numpy()[: 2 * drive.chain.links], serial.rollers()[: 2 * drive.chain.links], atol=1e-5
    )


def test_block_kernel_settles_an_arm(fibers):
    # as the CPU does: rollers and the arm at rest, whose residual is below the tolerance
    drive = timing()
    packed = elastic(pack([drive], [Schedule(1e-6, 10, 1, 10, 0)]))
    cushion(packed)
    quickened(packed, stacks_of([drive]))
    start = np.zeros(1, dtype=Settling.numpy_dtype())
    start["step"], start["tolerance"], start["limit"] = 0.7 * step_limit(drive), 1e-3, 20_000
    serial = CpuEngine(packed, 1)
    serial.start_settling(start)
    for future in serial.settle(20_000):
        future.result()
    ensemble, state = upload_ensemble(packed, "cpu"), upload_state(packed, "cpu", (1, 1, 1))
    settling, tallies = wp.array(start, dtype=Settling, device="cpu"), empty_tallies(packed, "cpu")
    order = wp.zeros(1, dtype=wp.int32, device="cpu")
    kind = BlockKind(wp.float64, 128, 1, 3, 2, arms=1, tensioners=1, profiles=True)
    inputs = [ensemble, state, tallies, settling, order, 20_000]
    wp.launch(block_relax_kernel(kind, 4), dim=128, inputs=inputs, block_dim=128, device="cpu")
    ours, theirs = settling.numpy(), serial.settling()
    assert ours["settled"][0] == theirs["settled"][0] == 1
    assert abs(int(ours["steps"][0]) - int(theirs["steps"][0])) <= 0.2 * theirs["steps"][0]
    # within what the tolerance leaves: micrometers
    np.testing.assert_allclose(state.bodies.numpy()["angle"], serial.bodies()["angle"], atol=1e-4)


class Blocks:
    """Blocks of fibers as an engine whose states can be kept (`engine.states`)."""

    def __init__(self, packed, shape):
        self.packed, self.shape = packed, shape
        self.ensemble, self.state = upload_ensemble(packed, "cpu"), upload_state(packed, "cpu", large(packed, shape, 2))
        self.sums, self.tallies = empty_sums(packed, "cpu"), empty_tallies(packed, "cpu")

    def single_engines(self):
        return [(self, 0)]

    def held(self):
        return {"state": self.state, "sums": self.sums, "tallies": self.tallies}

    def fetch(self, array):
        return array.numpy().copy()

    def put(self, array, values):
        array.numpy()[...] = values

    def advance(self, steps):
        kernel = block_kernel(kind_of(self.packed, self.shape), 4, self.packed.frame)
        none = wp.empty(1, dtype=self.packed.real, device="cpu")
        order = wp.array([0, 1], dtype=wp.int32, device="cpu")
        inputs = [self.ensemble, self.state, self.sums, self.tallies, none, order, steps, 0]
        wp.launch(kernel, dim=2 * self.shape.threads, inputs=inputs, block_dim=self.shape.threads, device="cpu")


@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("drives", [marine, bending_rk4, arms])
def test_a_longer_run_goes_on_with_the_bits_of_one_run(fibers, drives, precision):
    """A window of 320 steps from step 33 that becomes 640: kept at step 352, and so on from there."""
    variants = drives()
    shape = block_shape(int(room_for(np.array([drive.chain.links for drive in variants])).max()), False)
    short, long = (
        [Schedule(drive.run.step, 33 + steps, 33, 33 + steps, 0) for drive in variants] for steps in (320, 640)
    )

    def engine(schedules):
        return Blocks(pack(variants, schedules).at_precision(precision), shape)

    def kept(of, schedules, states, upto):
        keeper = Keeper(states, variants, schedules, precision)
        settled, left = np.zeros(2, dtype=Settling.numpy_dtype()), np.zeros(2)
        keeper.prepare(of.packed, settled, left)
        keeper.restore(of)
        of.advance(upto)
        keeper.take(of, of.state.progress.numpy())
        return states

    first = kept(engine(short), short, States(), 352)
    whole, on = engine(long), engine(long)
    at_once = kept(whole, long, States(), 672)
    gone_on = kept(on, long, States(begin=first.kept), 320)
    assert gone_on.used == [True, True]
    assert [one.data for one in gone_on.kept] == [one.data for one in at_once.kept]
    for each in (whole, on):
        each.advance(2)
    for group in whole.held():
        for name in GROUPS[group]:
            mine, theirs = (getattr(of.held()[group], name).numpy().tobytes() for of in (on, whole))
            assert mine == theirs, f"{group}.{name}"
