"""The block kernel on cooperative fibers: launches that end anywhere, runs that go on, settling."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
import raw
import warp as wp
from blocks import (
    ARMS_RK4,
    MOVING_TRAINS,
    OF_THREE_RK4,
    PUSHED,
    PUSHED_TRAINS,
    TENSIONED,
    arms,
    arms_rk4,
    bending_rk4,
    equal_sprockets,
    folded,
    kind_of,
    large,
    marine,
    moving_sprockets,
    oiled,
    on_fibers,
    pack_for,
    pushed_slider,
    rk4,
    run_blocks,
    shape_of,
    sharing,
    some_of,
)
from drives import timing, two_sprockets

from warpchain import load_drive
from warpchain.assembly.timestep import step_limit
from warpchain.drive.examples import drive_path
from warpchain.engine.arrays import (
    ARRAYS,
    assign_values,
    device_values,
    empty_sums,
    empty_tallies,
    upload_ensemble,
    upload_state,
)
from warpchain.engine.checkpoint import StateKeeper, States, latest_stop_step
from warpchain.engine.pack import pack
from warpchain.engine.settling import damp_arm_contacts, lighten_arms, settling_ensemble
from warpchain.kernels.gpu.block import block_kernel
from warpchain.kernels.gpu.block_kinds import BlockKind, BlockShape, Parts
from warpchain.kernels.gpu.relax import block_relax_kernel
from warpchain.kernels.relaxation import Settling
from warpchain.model import single_chain
from warpchain.model.stacks import stacks_of_drives
from warpchain.results.schedule import Schedule


@pytest.mark.parametrize(
    ("drives", "many", "precision", "family"),
    some_of(
        [
            *product([equal_sprockets, rk4, arms, pushed_slider], [True], ["float64", "float32"], [()]),
            (pushed_slider, True, "float32", PUSHED_TRAINS),
            *product([arms_rk4], [True], ["float64", "float32"], [ARMS_RK4, OF_THREE_RK4]),
            *product([moving_sprockets], [False, True], ["float64", "float32"], [(), MOVING_TRAINS]),
            (moving_sprockets, False, "float64", PUSHED),
        ],
        [
            (equal_sprockets, True, "float32", ()),
            (arms_rk4, True, "float32", OF_THREE_RK4),
            (moving_sprockets, True, "float64", MOVING_TRAINS),
        ],
        [
            (arms_rk4, True, "float64", ARMS_RK4),
            (moving_sprockets, False, "float64", PUSHED),
            (pushed_slider, True, "float32", PUSHED_TRAINS),
        ],
    ),
)
def test_where_launches_end_does_not_matter(fibers, drives, many, precision, family):
    of_family, kind, frame = sharing(family or (drives,), many, precision)
    variants = of_family[drives]
    schedules = [Schedule(drive.run.step, 2100, 1000, 2100, 0, sample_interval=64) for drive in variants]
    packed = replace(pack_for(variants, schedules, precision), frame=frame)
    none = wp.zeros(1, dtype=packed.real, device="cpu")
    once = run_blocks(packed, kind, [2101], [0], none)
    twice = run_blocks(packed, kind, [1056, 992, 53], [0], none)  # no look where the second begins
    cut = run_blocks(packed, kind, [1037, 3, 1061], [0], none)  # where bodies are not looked at either
    for name in ("rollers", "bodies", "tensioners"):
        for other in (twice, cut):
            np.testing.assert_array_equal(getattr(once[0], name).numpy(), getattr(other[0], name).numpy(), err_msg=name)
    for name in ("chain", "strand", "sprocket", "mount", "contact", "arm", "tensioner"):
        mine, theirs = once[1][name], twice[1][name]
        np.testing.assert_array_equal(mine, theirs, err_msg=name)


@pytest.mark.parametrize(
    ("measuring", "precision"),
    some_of([*product([True, False], ["float64", "float32"])], [(True, "float32")], [(False, "float64")]),
)
def test_variants_abreast_in_a_block_are_what_they_are_by_themselves(fibers, measuring, precision):
    # four that differ, two to a block; they share memory that each has a part of, and wait for each other
    heavy = [drive.with_values({"run.gravity": [0.0, -9.81]}) for drive in equal_sprockets()]
    variants = [*equal_sprockets(), *heavy]
    packed = pack(variants, [Schedule(drive.run.step, 300, 111, 290, 0) for drive in variants]).at_precision(precision)
    none = wp.zeros(1, dtype=packed.real, device="cpu")
    shapes = (replace(shape_of(variants, 100), variants_per_block=each) for each in (1, 2))
    kinds = (kind_of(packed, shape, measuring) for shape in shapes)
    alone, together = (run_blocks(packed, kind, [301], [3, 0, 2, 1], none) for kind in kinds)
    for name in ("rollers", "bodies", "seat", "impact_speed"):
        np.testing.assert_array_equal(getattr(alone[0], name).numpy(), getattr(together[0], name).numpy(), err_msg=name)
    for name in ("chain", "strand", "sprocket", "contact", "tension_counts"):
        np.testing.assert_array_equal(alone[1][name], together[1][name], err_msg=name)
    rollers, n = together[0].rollers.numpy(), variants[0].chain.links
    first, third = packed.first_roller_value(0), packed.first_roller_value(2)
    assert (rollers[first : first + n] != rollers[third : third + n]).any()


@pytest.mark.parametrize(
    ("measuring", "precision"),
    some_of([*product([True, False], ["float64", "float32"])], [(True, "float64")], [(False, "float32")]),
)
def test_oil_on_a_warp_of_its_own_is_what_it_is_on_a_body_s_thread(fibers, measuring, precision):
    # five variants of two tensioners each, three to a block, which end at other steps: the last block has two
    drives = oiled()
    schedules = [
        Schedule(of.run.step, end, 111, end - 10, 0) for of, end in zip(drives, (300, 264, 300, 288, 231), strict=True)
    ]
    packed = pack(drives, schedules).at_precision(precision)
    none = wp.zeros(1, dtype=packed.real, device="cpu")
    shape = shape_of(drives, 100)
    kinds = (kind_of(packed, of, measuring) for of in (shape, replace(shape, variants_per_block=3)))
    apart, shared = (run_blocks(packed, kind, [150, 151], [3, 0, 2, 4, 1], none) for kind in kinds)
    for name in ("rollers", "bodies", "tensioners", "meters"):
        np.testing.assert_array_equal(getattr(apart[0], name).numpy(), getattr(shared[0], name).numpy(), err_msg=name)
    for name in ("chain", "arm", "tensioner"):
        np.testing.assert_array_equal(apart[1][name], shared[1][name], err_msg=name)
    assert (np.abs(shared[0].tensioners.numpy()["growth"]) > 0.0).all()


def settled(drive, threads, parts, steps=(20_000,), **more):
    """The ensemble of a drive, the CPU's engine, and the state of a block of fibers, at rest; to a tolerance of 1e-3.

    Both take as many steps, until round-off has a peak of kinetic energy seen a look earlier or later.
    """
    packed = settling_ensemble(pack([drive], [Schedule(1e-6, 10, 1, 10, 0)]))
    if drive.arms:
        damp_arm_contacts(packed)
        lighten_arms(packed, stacks_of_drives([single_chain(drive)]))
    serial, start = raw.settling(packed, 0.7 * step_limit(drive, held=bool(drive.arms)), 1e-3, sum(steps))
    ensemble, state = upload_ensemble(packed, "cpu", blocks=True), upload_state(packed, "cpu", (1, 1))
    settling, tallies = wp.array(start, dtype=Settling, device="cpu"), empty_tallies(packed, "cpu")
    order = wp.zeros(1, dtype=wp.int32, device="cpu")
    kernel = on_fibers(block_relax_kernel(BlockKind(wp.float64, BlockShape(threads, 1), parts, **more), 4))
    for count in steps:
        inputs = [ensemble, state, tallies, settling, order, count]
        wp.launch(kernel, dim=threads, inputs=inputs, block_dim=threads, device="cpu")
    ours, theirs = settling.numpy()[0], serial.settling_states()[0]
    assert ours["settled"] == theirs["settled"] == 1 and ours["residual"] < 1e-3
    assert abs(int(ours["steps"]) - int(theirs["steps"])) <= 0.2 * theirs["steps"]
    return packed, serial, state


@pytest.mark.long
def test_blocks_settle_to_the_equilibrium_of_the_cpu(fibers):
    drive = two_sprockets().with_values({"run.gravity": [0.0, -9.81]})
    _, serial, state = settled(drive, 64, Parts(2, 0), [1000] * 40)
    first = slice(2 * drive.chain.links)
    np.testing.assert_allclose(state.rollers.numpy()[first], serial.rollers()[first], atol=1e-5)


@pytest.mark.long
def test_block_kernel_settles_an_arm(fibers):
    # as the CPU does: rollers and the arm at rest, within what the tolerance leaves: micrometers
    _, serial, state = settled(timing(), 160, Parts(3, 2, arms=1, tensioners=1), profiles=True)
    np.testing.assert_allclose(state.bodies.numpy()["angle"], serial.bodies()["angle"], atol=1e-4)


@pytest.mark.parametrize("hubs", [pytest.param(1, marks=pytest.mark.long), 2], ids=["alone", "on another arm"])
def test_block_kernel_settles_an_arm_with_its_sprocket(fibers, hubs):
    # as above; the sprocket's center goes with the arm, to the tolerance of that, and the arm with one that carries it
    drive = load_drive(drive_path("swing_idler")) if hubs == 1 else folded()[0]
    packed, serial, state = settled(drive, 160, Parts(3, 0, arms=hubs, hubs=hubs), moving=True)
    ours, theirs, before = state.bodies.numpy(), serial.bodies(), packed.bodies
    np.testing.assert_allclose(ours["angle"], theirs["angle"], atol=1e-4)
    np.testing.assert_allclose(ours["center"], theirs["center"], atol=2e-5)
    for b, on, lever in [(1, 3, packed.hubs["lever"][1]), (3, 4, packed.arms["lever"][0])][:hubs]:
        angle = float(ours["angle"][on])
        turned = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) @ lever
        np.testing.assert_allclose(ours["center"][b], ours["center"][on] + turned, atol=1e-12)
        assert abs(ours["angle"][on] - before["angle"][on]) > 1e-4


class Blocks:
    """Blocks of fibers as an engine whose states can be kept (`engine.checkpoint`)."""

    def __init__(self, packed, kind):
        self.packed, self.kind = packed, kind
        self.ensemble, self.state = (
            upload_ensemble(packed, "cpu", blocks=True),
            upload_state(packed, "cpu", large(kind, 2)),
        )
        self.sums, self.tallies = empty_sums(packed, "cpu", blocks=True), empty_tallies(packed, "cpu")

    def changing_structs(self):
        return {"state": self.state, "sums": self.sums, "tallies": self.tallies}

    def fetch_array(self, group, name):
        return device_values(getattr(self.changing_structs()[group], name), group, name, self.packed.real).copy()

    def set_array(self, group, name, values):
        assign_values(getattr(self.changing_structs()[group], name), values)

    def advance(self, steps):
        kernel, threads = on_fibers(block_kernel(self.kind, 4, self.packed.frame)), self.kind.shape.threads
        none = wp.empty(1, dtype=self.packed.real, device="cpu")
        order = wp.array([0, 1], dtype=wp.int32, device="cpu")
        begun = self.state.progress.numpy()["step"]
        row = [wp.array(of, dtype=wp.int32, device="cpu") for of in (begun + steps, begun)]
        inputs = [self.ensemble, self.state, self.sums, self.tallies, none, order, *row]
        wp.launch(kernel, dim=2 * threads, inputs=inputs, block_dim=threads, device="cpu")


@pytest.mark.parametrize(
    ("drives", "many", "precision", "every", "family"),
    some_of(
        [
            *product([marine, arms], [False], ["float64", "float32"], [32, 64], [()]),
            *product([bending_rk4], [False, True], ["float64", "float32"], [32, 64], [OF_THREE_RK4]),
            (arms, False, "float64", 32, TENSIONED),
        ],
        [(marine, False, "float64", 64, ()), (bending_rk4, True, "float32", 32, OF_THREE_RK4)],
        [(arms, False, "float64", 32, TENSIONED)],
    ),
)
def test_a_longer_run_goes_on_with_the_bits_of_one_run(fibers, drives, many, precision, every, family):
    """A window of ten looks from step 33 that becomes twenty: kept at step 352, or 672, which is between two looks."""
    of_family, kind, frame = sharing(family or (drives,), many, precision)
    variants = of_family[drives]
    short, long = (
        [Schedule(drive.run.step, 33 + steps, 33, 33 + steps, 0, every) for drive in variants]
        for steps in (10 * every, 20 * every)
    )
    half, end = (latest_stop_step(schedules[0]) for schedules in (short, long))

    def engine(schedules):
        return Blocks(replace(pack_for(variants, schedules, precision), frame=frame), kind)

    def kept(of, schedules, states, upto):
        states.prepare(len(variants))
        keeper = StateKeeper(states, variants, schedules, np.arange(len(variants)), precision)
        settled, left = np.zeros(2, dtype=Settling.numpy_dtype()), np.zeros(2)
        keeper.take_over_settling(of.packed, settled, left)
        keeper.restore_states(of)
        of.advance(upto)
        keeper.keep_due_states(of, of.state.progress.numpy())
        return states

    first = kept(engine(short), short, States(), half)
    whole, on = engine(long), engine(long)
    at_once = kept(whole, long, States(), end)
    gone_on = kept(on, long, States(begin=first.kept), end - half)
    assert gone_on.used == [True, True]
    assert [one.data for one in gone_on.kept] == [one.data for one in at_once.kept]
    for each in (whole, on):
        each.advance(2)
    for group in whole.changing_structs():
        for name in (name for name, row in ARRAYS[group].items() if row.in_checkpoints):
            # as values: two float32 hold one number in two ways, a state is kept as float64, and padding is no value
            mine, theirs = (repr(of.fetch_array(group, name).tolist()) for of in (on, whole))
            assert mine == theirs, f"{group}.{name}"
