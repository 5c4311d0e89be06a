"""Packing: a mixed ensemble is its variants' own packs one after the other, to the last bit."""

import contextlib

import pytest
from drives import LARGE, ONE_CHAIN, but, example, numbers, two_sprockets

from warpchain import Record
from warpchain.assembly.stack_assembly import layout_faults_of_drives
from warpchain.drive.changed_copies import DriveChanges
from warpchain.engine.chain_rows import ChainRows
from warpchain.engine.pack import pack
from warpchain.engine.simulation import schedules_of
from warpchain.errors import DriveError
from warpchain.model.stacks import stacks_of_drives
from warpchain.results.schedule import Schedule

PLACES = ("first_roller", "first_sprocket", "first_guide", "first_contact", "first_tally")


def mixed():
    """All examples, some alike in all but a load, out of order and some repeated."""
    marine = example("marine")
    torque = [marine.with_values({"sprockets.camshaft.load.torque": 8000.0 + k}) for k in range(3)]
    beats = [{"order": 3, "amplitude": 100.0, "phase": 0.5}, {"order": 6, "amplitude": 50.0, "phase": 0.0}]
    torque.append(marine.with_values({"sprockets.camshaft.load.harmonics": beats}))
    for most in (500.0, 700.0):
        table = {"time": [0.0, 0.1, 0.3], "torque": [0.0, most, 100.0]}
        torque.append(marine.with_values({"sprockets.camshaft.load.table": table}))
    worn = marine.with_values({"chain.elongation": 0.002})
    stiff = marine.with_values({"sprockets.camshaft.inertia": 9.0})
    others = [example(name) for name in ONE_CHAIN]
    own = [[{"link": 3 + v, "elongation": 1e-3 * v}, {"link": 9, "elongation": 2e-3}] for v in range(3)]
    unlike = [
        marine.with_values({"chain.worn_links": own[v], "chain.play": 1e-4 * (1.0 + v), "chain.outer": outer})
        for v, outer in enumerate({"stiffness": k, "elongation": 1e-3} for k in (1e9, marine.chain.stiffness, 2e9))
    ]
    some = [torque[0], two_sprockets(), worn, unlike[0], torque[1], *others, unlike[1], stiff, *others[::-1]]
    return [*some, *torque[2:], two_sprockets(), unlike[2]]


def schedules(count):
    return [Schedule(1e-6 * (v + 1), 100 + v, v, 50 + v, v % 3) for v in range(count)]


def assert_same(values, expected, but=()):
    """Field by field, bit by bit; padding between fields means nothing."""
    assert values.shape == expected.shape and values.dtype == expected.dtype
    if values.dtype.names is None:
        assert values.tobytes() == expected.tobytes()
        return
    for name in values.dtype.names:
        if name not in but:
            assert_same(values[name], expected[name])


def rows_of(motion, packed):
    """The harmonics that a motion refers to."""
    for name in ("drive_harmonics", "load_harmonics"):
        first, count = int(motion[name]["first"]), int(motion[name]["count"])
        yield packed.harmonics[first : first + count]
    for name in ("drive_table", "load_table"):
        first, cells = int(motion[name]["first"]), int(motion[name]["cells"])
        yield packed.tables[first : first + 5 * cells]


def test_each_variant_is_packed_as_if_alone():
    drives = mixed()
    plan = schedules(len(drives))
    packed = pack(drives, plan)
    at = dict.fromkeys(PLACES, 0)
    for v, drive in enumerate(drives):
        part, alone = packed.variant_range(v, v + 1), pack([drive], [plan[v]])
        row = packed.drives[v]
        assert {name: int(row[name]) for name in PLACES} == at
        rollers, wheels, bars = (int(row[name]) for name in ("rollers", "sprockets", "guides"))
        contacts = wheels * int(row["points"]) + bars
        steps = (rollers, wheels, bars, rollers * contacts, rollers * (wheels + 1))
        at = {name: at[name] + more for name, more in zip(PLACES, steps, strict=True)}
        for name in ("drives", "chains", "lengths", "rollers", "bodies", "strands", "seat"):
            assert_same(getattr(part, name), getattr(alone, name))
        assert_same(part.mounts, alone.mounts, but=("x_table", "y_table"))
        for name in ("x_table", "y_table"):
            assert_same(part.mounts[name], alone.mounts[name], but=("first",))
        if bars:
            assert_same(part.guides, alone.guides)
        assert_same(part.sprockets, alone.sprockets, but=("first_seat",))
        assert_same(part.motions, alone.motions, but=("drive_harmonics", "load_harmonics", "drive_table", "load_table"))
        for own, single in zip(part.motions, alone.motions, strict=True):
            for values, expected in zip(rows_of(own, packed), rows_of(single, alone), strict=True):
                assert_same(values, expected)
            for name in ("drive_table", "load_table"):
                assert_same(own[name], single[name], but=("first",))
        for own, single in zip(part.sprockets, alone.sprockets, strict=True):
            teeth, first, other = int(own["teeth"]), int(own["first_seat"]), int(single["first_seat"])
            assert_same(packed.seats[first : first + teeth], alone.seats[other : other + teeth])


def test_outer_links_as_stiff_as_inner_ones_are_packed_as_alike():
    """Of a stack as alone."""
    marine = example("marine")
    stiffness, damping = marine.chain.stiffness, marine.chain.damping
    drives = [
        marine.with_values({"chain.stiffness": k, "chain.outer": {"stiffness": stiffness, "damping": damping}})
        for k in (stiffness, 0.9 * stiffness)
    ]
    packed = pack(drives, schedules(2))
    assert packed.has_varied_links.tolist() == [False, True] and packed.chains["play"].tolist() == [0.0, 0.0]
    assert packed.chains["outer_stiffness"].tolist() == [stiffness, stiffness]
    assert packed.chains["outer_damping"].tolist() == [damping, damping]


@pytest.mark.parametrize("name", but(ONE_CHAIN, LARGE))  # of one chain
@pytest.mark.filterwarnings("ignore")
def test_every_number_of_an_example_may_vary_in_a_batch(name):
    base = example(name)
    changes = DriveChanges(base)
    for path in numbers(base):
        value, drives = base.get_value(path), []
        if any(path.startswith(f"sprockets.{end}.") for end in base.chain.ends or ()) and (
            path.endswith(".teeth") or ".prescribed." in path
        ):  # an end has no teeth and does not turn
            continue
        for near in (value, *((value + 1, value + 2) if isinstance(value, int) else (1.0001 * value, 0.9999 * value))):
            with contextlib.suppress(DriveError):  # a bush's stiffness allows one exponent, a size its own chain
                drives.append(changes.changed_drive({path: near}))
        stacks = stacks_of_drives(drives)
        rows = ChainRows(drives, stacks)
        packed = pack(rows.models, schedules_of(drives, None, None, Record("none"), None, stacks), rows.stacks)
        layout_faults_of_drives(rows.models, packed.assemblies, rows.stacks)
        part = 0.5 if base.chain.kind == "silent" else 1.0  # of one of a flank's ends
        stiffness = [part * model.sprocket_stiffness(s) for model in rows.models for s in range(len(model.sprockets))]
        assert packed.sprockets["law"]["stiffness"].tolist() == stiffness, path
