"""Drives assembled and packed together, a stack of a kind at once: each as if it were alone, to the last bit."""

import contextlib
import warnings

import numpy as np
import pytest
from assemblies import assert_same, error_of
from drives import ONE_CHAIN, but, example, numbers, with_parts
from parts import gears, shaft

from warpchain.assembly import assemble
from warpchain.assembly.arm_balance import chain_paths
from warpchain.assembly.assembly import assemble_chain
from warpchain.assembly.crossings import assemble_chains
from warpchain.assembly.layout_checks import has_possible_faults, layout_faults
from warpchain.assembly.stack_assembly import assemble_stacks
from warpchain.drive.examples import example_names
from warpchain.engine.chain_rows import ChainRows
from warpchain.errors import DriveError
from warpchain.model import Model, single_chain
from warpchain.model.stacks import (
    LARGEST_STACK,
    pick_variants,
    stack_arrays,
    stack_of_values,
    stacks_of_drives,
    variant_count,
)


def marine(**values):
    return example("marine").with_values({key.replace("__", "."): value for key, value in values.items()})


def scattered(name, count, seed=1):
    """Variants of an example with sprockets elsewhere: taut and slack, worn, turned on, under another gravity."""
    base, random = example(name), np.random.default_rng(seed)
    found = []
    for v in range(count):
        values = {"chain.elongation": float(random.uniform(-0.001, 0.004))}
        for sprocket in base.sprockets:
            place = np.array(sprocket.center) + 0.03 * base.chain.pitch * random.standard_normal(2)
            values[f"sprockets.{sprocket.name}.center"] = tuple(place.tolist())
        if v % 5 == 0:
            values["run.phase"] = float(random.uniform(-0.5, 0.5))
        if v % 7 == 0:
            values["chain.pitch"] = base.chain.pitch * (1.0 + 1e-3 * float(random.standard_normal()))
        if v % 11 == 0:
            values["run.gravity"] = (1.0, -3.0)
        if v % 13 == 0:
            values["chain.outer"] = {"elongation": 0.002}
        found.append(base.with_values(values))
    return found


@pytest.mark.parametrize("name", [name for name in ONE_CHAIN if name != "car"])
def test_each_is_assembled_as_if_alone(name):
    drives = scattered(name, 40)
    stacks = stacks_of_drives(list(map(single_chain, drives)))
    assert len(stacks) < len(drives) / 2  # else nothing is shown
    for found, drive in zip(assemble_stacks(stacks), drives, strict=True):
        assert_same(found, assemble(drive))


@pytest.mark.parametrize("name", but(example_names(), ("v6", "car")))
@pytest.mark.filterwarnings("ignore")
def test_with_any_other_number_each_chain_is_assembled_as_if_alone(name):
    """Under way from the start, as speeds hang on other chains' numbers then."""
    base, drives = example(name), []
    ramps = [path for path in base.paths() if path.endswith("prescribed.ramp_time") and base.get_value(path)]
    base = base.with_values(dict.fromkeys(ramps, 0.0))
    for path in numbers(base)[:: 4 if name == "v6" else 1]:  # of its 257
        value = base.get_value(path)
        with contextlib.suppress(DriveError):  # a size has a pitch of its own; or the chain fits no more
            drive = base.with_values({path: value + 1 if isinstance(value, int) else 1.001 * value})
            assemble_chains(Model(drive))
            drives.append(drive)
    rows = ChainRows(drives, stacks_of_drives(drives))
    for found, model in zip(assemble_stacks(rows.stacks), rows.models, strict=True):
        alone = assemble_chain(model)
        for of in ("position", "velocity", "sprocket_angle", "sprocket_speed", "shaft_speed", "arm_angle"):
            np.testing.assert_array_equal(getattr(found, of), getattr(alone, of), err_msg=of)


@pytest.mark.filterwarnings("ignore")
def test_a_chain_that_another_turns_begins_as_fast_as_that_turns_it():
    """Nothing of its own differs: only how the driver's speed, the mean of which is the same, swings."""
    base = example("v6").with_values({"sprockets.crank.prescribed.ramp_time": 0.0})
    drives = [base, base.with_values({"sprockets.crank.prescribed.harmonics.0.amplitude": 0.1})]
    rows = ChainRows(drives, stacks_of_drives(drives))
    speeds = [state.sprocket_speed for state in assemble_stacks(rows.stacks)]
    left = [r for r, chain in enumerate(rows.models) if chain.name == "left"]
    for r in left:
        assert np.array_equal(speeds[r], assemble_chain(rows.models[r]).sprocket_speed)
    assert abs(speeds[left[0]][0] / speeds[left[1]][0] - 1.0) > 0.05


def test_what_a_chain_does_not_fit_is_refused_beside_one_that_it_fits():
    """A key and a tooth of its own, of a sprocket that otherwise stands alike."""
    base = marine(chain__elongation=1e-3)  # rollers ride 1 mm above their seats
    low = {"seat_radius": 0.0366, "seat_angle": 100.0, "tip_radius": single_chain(base).pitch_radius(2) + 1e-4}
    for values in ({"sprockets.camshaft.key": 0.5}, {"sprockets.camshaft.tooth": low}):
        assert error_of([base, base.with_values(values)], 1)


def test_layouts_without_suspicion_have_no_findings():
    """All that `findings` tells of is suspect; here bars cut through, dent, and strands cross."""
    random, base, paths = np.random.default_rng(2), marine(), {}
    for _ in range(200):
        ends = {
            f"guides.tight strand.{end}": tuple(random.uniform((-2.0, 0.0), (2.0, 6.0))) for end in ("start", "end")
        }
        drive = base.with_values(ends | {"sprockets.tightener.center": (random.uniform(-1.0, 2.0), 3.0)})
        try:
            path = chain_paths(single_chain(drive))
        except DriveError:
            continue
        if not any(path.strings):
            paths[drive] = path
    drives = list(paths)
    suspect = [bool(has_possible_faults(single_chain(drive), path)[0]) for drive, path in paths.items()]
    told = [bool(layout_faults(single_chain(drive), path[0])) for drive, path in paths.items()]
    assert all(s or not t for s, t in zip(suspect, told, strict=True))
    assert 20 < sum(told) <= sum(suspect) < len(drives) - 20
    drive = stack_of_values(drives)
    assert has_possible_faults(single_chain(drive), chain_paths(single_chain(drive))).tolist() == suspect


def test_the_first_variant_that_does_not_fit_is_named():
    drives = [marine(chain__stiffness=1e9 + v) for v in range(20)]
    far = {5: (1.0, 9.0), 3: (0.30, 3.5), 17: (0.3, 9.0)}
    for v, center in far.items():
        drives[v] = marine(sprockets__camshaft__center=center)
    assert error_of(drives, 3)


def test_a_chain_around_a_bar_shares_a_stack_with_one_that_is_not():
    """The bar stands up to two thirds of a pitch deep in its strand: in the way from half a roller's radius on."""
    base, drives = marine(), []
    for depth in np.linspace(-0.02, 0.08, 12):
        shift = {
            f"guides.tight strand.{end}": (place[0] - depth, place[1])
            for end, place in (("start", base.guides[0].start), ("end", base.guides[0].end))
        }
        drives.append(base.with_values(shift))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        (stack,) = stacks_of_drives(list(map(single_chain, drives)))
    states = assemble_stacks([stack])
    bent = [any(string is not None for string in state.path.strings) for state in states]
    assert any(bent) and not all(bent)
    for state, drive in zip(states, drives, strict=True):
        assert_same(state, assemble(drive))


def test_a_car_stands_by_its_own_stiffness():
    """The chain's stiffness moves its tensioner's arm; before stacks, variants that differed in it shared one state."""
    base = example("car")
    other = base.with_values({"chain.stiffness": 1.1 * base.chain.stiffness})
    together = assemble_stacks(stacks_of_drives(list(map(single_chain, [base, other]))))
    assert together[0].arm_angle[0] != together[1].arm_angle[0]


def test_a_stack_holds_arrays_of_what_varies_alone():
    drives = [marine(chain__stiffness=1e9 + v, sprockets__camshaft__center=(0.30, 5.96)) for v in range(3)]
    drive = stack_of_values(drives)
    assert [column.tolist() for column in stack_arrays(drive)] == [[1e9, 1e9 + 1, 1e9 + 2]] and variant_count(
        drive
    ) == 3
    assert pick_variants(drive, 1) == drives[1]
    assert stack_of_values([drives[0]] * 3) is drives[0]


def test_zeros_given_values_and_counts_make_kinds():
    changes = [{}, {"chain.damping": 2e5}, {"chain.damping": 0.0}, {"chain.damping_ratio": 0.1}, {"chain.links": 164},
               {"sprockets.camshaft.load.torque": 5.0}, {"sprockets.tightener.teeth": 26}]  # fmt: skip
    drives = [marine().with_values(change) for change in changes]
    assert sorted(stack.members.tolist() for stack in stacks_of_drives(list(map(single_chain, drives)))) == [
        [0, 1, 5],
        [2],
        [3],
        [4],
        [6],
    ]
    assert (
        max(len(stack.members) for stack in stacks_of_drives([drives[0], drives[1]] * LARGEST_STACK)) == LARGEST_STACK
    )


def test_drives_of_unlike_sprockets_may_each_have_a_phase():
    """Phases part drives with tables alone, which are looked for in drives of a kind."""
    engine = example("engine")
    drives = [of.with_values({"run.phase": 0.1 * k}) for k in range(1, 3) for of in (marine(), engine)]
    assert [stack.members.tolist() for stack in stacks_of_drives(list(map(single_chain, drives)))] == [[0, 2], [1, 3]]
    table = {"sprockets.camshaft.load.table": {"time": [0.0, 1.0], "torque": [0.0, 5.0]}}
    assert len(stacks_of_drives([*drives, *(drive.with_values(table) for drive in drives[::2])])) == 4


def test_a_tail_of_one_is_assembled_as_if_alone():
    """Of one more drive than a stack holds, and of two of which one chain goes around a bar, one stays by itself."""
    base = marine()
    drives = [marine(sprockets__camshaft__center=(0.30, 5.96 + 1e-6 * v)) for v in range(3)]
    stack = stacks_of_drives([*drives, drives[0]] * (LARGEST_STACK // 4) + [drives[1]])[-1]
    assert len(stack.members) == 1 and stack.one == drives[1]
    ends = zip(("start", "end"), (base.guides[0].start, base.guides[0].end), strict=True)
    around = base.with_values({f"guides.tight strand.{end}": (x - 0.08, y) for end, (x, y) in ends})
    for found, drive in zip(
        assemble_stacks(stacks_of_drives(list(map(single_chain, [around, base])))), (around, base), strict=True
    ):
        assert_same(found, assemble(drive))


@pytest.mark.parametrize("values", [{"shafts.pump.initial_speed": 60.0}, {"shafts.pump.prescribed": {"speed": 60.0}}])
def test_shafts_of_a_stack_start_at_their_own_speeds(values):
    """A bare shaft, of which nothing but the start differs; it turns as fast as it is told."""
    slow = {"initial_speed": 30.0} if "shafts.pump.initial_speed" in values else {"prescribed": {"speed": 30.0}}
    base = with_parts(shaft("pump", inertia=0.1, **slow))
    drives = [base, base.with_values(values), base]
    stacks = stacks_of_drives(list(map(single_chain, drives)))
    assert len(stacks) == 1
    assert [float(found.shaft_speed[0]) for found in assemble_stacks(stacks)] == [30.0, 60.0, 30.0]


def test_drives_with_other_shafts_are_states_of_their_own():
    """Of the same chain and sprockets: gears of unlike teeth, and another shaft."""
    text = shaft("pump", inertia=0.1) + shaft("in", inertia=0.1, initial_speed=30.0)
    more = shaft("third", inertia=0.1, initial_speed=5.0)
    ends = ((40, ""), (10, ""), (40, more))
    drives = [with_parts(text + gears("pair", ["in", "pump"], [20, teeth]) + end) for teeth, end in ends]
    speeds = [
        found.shaft_speed.tolist() for found in assemble_stacks(stacks_of_drives(list(map(single_chain, drives))))
    ]
    assert np.abs(speeds[0]).tolist() == [15.0, 30.0] and np.abs(speeds[1]).tolist() == [60.0, 30.0]
    assert np.abs(speeds[2]).tolist() == [15.0, 30.0, 5.0]
