"""The block kernel against the CPU kernel on cooperative fibers."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
import warp as wp
from blocks import (
    EVERY,
    LONG,
    MOVING_TRAINS,
    RUBBING,
    THOROUGH,
    TRAINS_RK4,
    USUAL,
    assert_steps_of_the_cpu,
    bending,
    equal_sprockets,
    kind_of,
    led_elsewhere,
    long_chains,
    marine,
    moving_sprockets,
    pack_for,
    run_blocks,
    shape_of,
    sharing,
    some_of,
    together,
    trains_rk4,
    ways,
)
from layouts import winding
from raw import stepped

from warpchain.engine.arrays import device_values
from warpchain.engine.pack import pack
from warpchain.kernels.gpu.block_kinds import BlockShape
from warpchain.kernels.gpu.shared_memory import block_memory, strand_words
from warpchain.results.schedule import Schedule

FOREVER = 10**8


@pytest.mark.parametrize(**together(USUAL, LONG, THOROUGH))
def test_block_kernel_takes_the_steps_of_the_cpu_kernel(fibers, drives, many, precision, family):
    assert_steps_of_the_cpu(drives, many, precision, family)


ALONE = ways(
    EVERY,
    [(marine, False, "float64"), (equal_sprockets, True, "float32")],
    [(long_chains, False, "float64")],
)


@pytest.mark.parametrize(**ALONE)
def test_a_kernel_of_its_own_takes_the_steps_of_the_cpu_kernel(fibers, drives, many, precision):
    assert_steps_of_the_cpu(drives, many, precision)


BARE = [
    (equal_sprockets, 1, "float32"),
    (equal_sprockets, 8, "float64"),
    (marine, 8, "float32"),
    (led_elsewhere, 1, "float64"),
]


@pytest.mark.parametrize(
    ("drives", "each", "precision"),  # alone, and with others on its multiprocessor
    some_of(list(product([equal_sprockets, marine, led_elsewhere], [1, 8], ["float64", "float32"])), [], BARE),
)
def test_bare_block_kernel_takes_the_steps_of_the_cpu_kernel(fibers, drives, each, precision):
    variants = drives()
    shape = shape_of(variants, each)
    assert shape.body_warp == (each == 1)
    packed = pack(variants, [Schedule(drive.run.step, 2000, FOREVER, FOREVER, 0) for drive in variants])
    packed = packed.at_precision(precision)
    serial, none = stepped(packed, 700)
    state, _ = run_blocks(packed, kind_of(packed, shape, measuring=False), [700], [0, 1], none)
    # rollers came to other seats, and others to sprockets, on the way; round-off, which contacts amplify
    assert (serial.state.seat.numpy() != packed.seat).any()
    tolerance = 1e-9 if precision == "float64" else 3e-4
    np.testing.assert_allclose(state.rollers.numpy(), serial.state.rollers.numpy(), atol=tolerance, rtol=tolerance)
    np.testing.assert_array_equal(state.seat.numpy(), serial.state.seat.numpy())
    for name in ("angle", "speed"):
        mine = device_values(state.bodies, "state", "bodies", packed.real)[name]
        np.testing.assert_allclose(mine, serial.bodies()[name], atol=tolerance, rtol=tolerance)


@pytest.mark.long
def test_rows_beyond_shared_memory(fibers):
    variants = long_chains()
    packed = pack(variants, [Schedule(drive.run.step, 100, 11, 90, 0) for drive in variants])
    kind = kind_of(packed, BlockShape(64, 16))
    assert "rows" not in block_memory(kind).shared
    serial, none = stepped(packed, 101)
    state, sums = run_blocks(packed, kind, [64, 37], [0, 1], none)
    # the same functions in the same order: round-off, which contacts amplify
    np.testing.assert_allclose(state.rollers.numpy(), serial.state.rollers.numpy(), atol=1e-9, rtol=1e-9)
    theirs = serial.sums()["chain"]
    np.testing.assert_allclose(sums["chain"]["tension"], theirs["tension"], rtol=1e-9)


@pytest.mark.long
def test_how_many_rollers_a_thread_might_have_does_not_matter(fibers):
    """Of twelve links a thread two numbers tell the strands, of six one; a thread's links are the same six."""
    drives, kind, frame = sharing(RUBBING, True, "float64")
    variants = drives[bending]
    schedules = [Schedule(drive.run.step, 300, 11, 300, 0) for drive in variants]
    packed = replace(pack_for(variants, schedules, "float64"), frame=frame)
    none = wp.zeros(1, dtype=packed.real, device="cpu")
    kinds = [replace(kind, shape=BlockShape(32, per)) for per in (6, 12)]
    assert kinds[0] == kind
    few, many = (run_blocks(packed, each, [301], [0, 1], none) for each in kinds)
    assert [strand_words(each) for each in kinds] == [1, 2]
    for name in ("chain", "strand", "sprocket", "tension_counts"):
        mine, theirs = (sums[name] for _, sums in (few, many))
        np.testing.assert_array_equal(mine, theirs, err_msg=name)
    assert (few[1]["strand"]["samples"] > 0).all()


@pytest.mark.long
@pytest.mark.parametrize(
    ("drives", "many", "family"), [(moving_sprockets, True, MOVING_TRAINS), (trains_rk4, False, TRAINS_RK4)]
)
def test_metrics_from_the_first_step(fibers, drives, many, family):
    of_family, kind, frame = sharing(family, many, "float64")
    variants = of_family[drives]
    packed = pack_for(variants, [Schedule(drive.run.step, 64, 0, 64, 0) for drive in variants], "float64")
    serial, none = stepped(packed, 65)
    _, sums = run_blocks(replace(packed, frame=frame), kind, [65], [0, 1], none)
    for name in ("chain", "strand", "sprocket", "contact"):
        for field in (theirs := serial.sums()[name]).dtype.names:
            ours, scale = sums[name][field], np.abs(theirs[field]).max()
            # added up in another order, and tensions are small differences of lengths times a large stiffness
            atol = max(1e-9 * scale, 1e-11)
            np.testing.assert_allclose(ours, theirs[field], rtol=1e-9, atol=atol, err_msg=f"{name}.{field}")


@pytest.mark.long
def test_a_block_finds_the_crossing_nearest_the_strand(fibers):
    """The window's first look finds strands' middles 85 links behind, as where the chain has moved on before it."""
    drive = winding(400.0)
    packed = pack([drive], [Schedule(drive.run.step, 2, 0, 2, 0)])
    packed.strands["middle"] = (packed.strands["middle"] + 85) % drive.chain.links
    serial, none = stepped(packed, 3)
    _, sums = run_blocks(packed, kind_of(packed, BlockShape(32, 5)), [3], [0], none)
    for found in (sums["strand"], serial.sums()["strand"]):
        # the other crossing is 0.14 m away; a chain that has just been laid out lies within 3 mm of its line
        assert np.abs(found["displacement"] / found["samples"]).max() < 0.003
