"""Drives whose guides bend the chain and whose arms turn, a stack at once: each as it stands alone, to the bit."""

import math
from dataclasses import fields

import numpy as np
import pytest
from assemblies import error_of
from drives import example

from warpchain import assemble
from warpchain.assembly import assembly, path
from warpchain.assembly.fitting import fit_position, fit_positions
from warpchain.assembly.layout_checks import has_possible_faults, layout_faults
from warpchain.assembly.stack_assembly import assemble_stacks
from warpchain.engine.arrays import dtype_of
from warpchain.engine.body_struct_rows import fill_tensioner_element
from warpchain.engine.pack import pack
from warpchain.errors import DriveError
from warpchain.kernels import structs
from warpchain.model import single_chain
from warpchain.model.stacks import pick_variants, stacks_of_drives
from warpchain.results.schedule import Schedule


@pytest.fixture(autouse=True)
def _stacks_of_few(monkeypatch):
    monkeypatch.setattr(path, "FEW", 2)


def car(**values):
    return example("car").with_values(values)


def cars(count, seed=1):
    """Cars that differ in their chains, places, arms, oil and loads."""
    random, base, found = np.random.default_rng(seed), car(), []

    def about(value, share=0.02):
        return value * (1.0 + share * float(random.uniform(-1.0, 1.0)))

    for _ in range(count):
        x, y = base.sprockets[1].center
        values = {
            "chain.stiffness": about(base.chain.stiffness),
            "sprockets.intake cam.center": (about(x, 1e-3), about(y, 1e-4)),
            "sprockets.intake cam.load.torque": about(2.0),
            "arms.arm.mass": about(0.12),
            "arms.arm.stops": (about(-8.0), about(8.0)),
            "tensioners.tensioner.spring.preload": about(40.0, 0.3),
            "tensioners.tensioner.plunger.gap": about(5e-5),
            "tensioners.tensioner.oil.viscosity": about(1.2e-5, 0.5),
            "tensioners.tensioner.at.1": about(0.15232),
        }
        found.append(base.with_values(values))
    return found


def assert_same(found, expected):
    for name in ("position", "velocity", "sprocket_angle", "sprocket_speed", "arm_angle", "strain"):
        assert np.array_equal(getattr(found, name), getattr(expected, name)), name
    for name in ("seat_sprocket", "seat_index", "strand_first", "strand_links"):
        assert np.array_equal(getattr(found, name), getattr(expected, name)), name


def test_cars_that_differ_are_assembled_together():
    drives = cars(40)
    (stack,) = stacks_of_drives(list(map(single_chain, drives)))
    states = assemble_stacks([stack])
    assert len(states.blocks) < 8  # what is seated alike is worked out at once
    for found, drive in zip(states, drives, strict=True):
        assert_same(found, assemble(drive))


REFERENCE = [
    ({}, 0.005126970799072728, 0.00024760640212759136,
     [(-0.04106400173715122, 0.10544655067023453), (-0.07866068879707888, 0.35601284875569583),
      (0.055409452397001714, 0.11474245107479433)]),
    ({"chain.stiffness": 4.0e6, "tensioners.tensioner.spring.preload": 55.0, "sprockets.intake cam.center.0": -0.0621},
     -0.04528231487332108, 0.0034641759167368907,
     [(-0.03822854080770259, 0.10607763988036396), (-0.07995324902534673, 0.3556388431511042),
      (0.055513391575390605, 0.11512694554372845)]),
    ({"chain.elongation": 0.002}, -0.02976799721937408, 0.00014856196362733766,
     [(-0.0391055178208898, 0.10584533545452274), (-0.0794834976649707, 0.3558788705524718),
      (0.055476198018797954, 0.11498944502319823)]),
]  # fmt: skip


@pytest.mark.parametrize(("values", "angle", "strain", "places"), REFERENCE)
def test_the_car_stands_where_it_stood(values, angle, strain, places):
    """As commit c539d00 found it, which balanced the arm for the last strain again and again, until it moved by 3e-14.

    It stopped at 1e-9 rad there, within 2e-12 rad of these numbers, in which its loop has gone on.
    """
    state = assemble(car(**values))
    assert state.position[[20, 50, 95]] == pytest.approx(np.array(places), abs=1e-12 * 0.009525)
    assert float(state.arm_angle[0]) == pytest.approx(angle, abs=1e-13)
    assert state.strain == pytest.approx(strain, abs=1e-14)


def faceted(**values):
    """The car with a blade of many short arcs, so that chains a little apart touch unlike ones."""
    angles = np.radians(np.linspace(40.0, -6.0, 16))
    points = np.array([-0.292449, 0.070235]) + 0.25 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    blade = {
        "name": "blade", "points": points.tolist(), "radius": 0.02, "offset": 0.00413, "end_radius": 0.009525,
        "arm": "arm",
    }  # fmt: skip
    return car().with_values({"guides.0": blade}).with_values(values)


def test_cars_in_balance_after_unlike_rounds_are_assembled_together(monkeypatch):
    """What is done stays, to the bit, while the others go on; none is worked out twice."""
    rounds, seated = [], assembly.seat_chain
    monkeypatch.setattr(assembly, "seat_chain", lambda *given: rounds.append(len(given[1].radius)) or seated(*given))
    springs = ((87.89806463878415, 89761941.80622698), (60.0, 9e7), (73.20330446547551, 77259095.73362029), (40.0, 8e7))
    drives = [
        car(**{"tensioners.tensioner.spring.preload": preload, "chain.stiffness": stiffness})
        for preload, stiffness in springs
    ]
    alone, turns = [], set()
    for drive in drives:
        rounds.clear()
        alone.append(assemble(drive))
        turns.add(len(rounds))
    assert len(turns) > 1
    rounds.clear()
    (stack,) = stacks_of_drives(list(map(single_chain, drives)))
    for found, expected in zip(assemble_stacks([stack]), alone, strict=True):
        assert_same(found, expected)
    assert rounds == [4] * max(turns)


def test_chains_on_unlike_arcs_are_told_apart():
    drives = [faceted(**{"sprockets.intake cam.center.0": x}) for x in np.linspace(-0.065, -0.059, 8).tolist()]
    (stack,) = stacks_of_drives(list(map(single_chain, drives)))
    states = assemble_stacks([stack])
    touched = set()
    for found, drive in zip(states, drives, strict=True):
        assert_same(found, assemble(drive))
        touched.add(tuple(len(string.touches) for string in found.path.strings if string))
    assert len(touched) > 1 and min(map(max, touched)) >= 5


def test_a_car_that_does_not_fit_is_named():
    drives = cars(6)
    drives[4] = drives[4].with_values({"sprockets.exhaust cam.center.1": 0.4})
    assert error_of(drives, 4)


def test_cars_are_packed_together():
    """Every array is what it is of each alone."""
    drives, schedule = cars(5), Schedule(1e-6, 10, 10, 10, 0)
    together = pack(drives, [schedule] * 5)
    for v, drive in enumerate(drives):
        part, alone = together.variant_range(v, v + 1), pack([drive], [schedule])
        for name in (field.name for field in fields(part) if isinstance(getattr(part, field.name), np.ndarray)):
            np.testing.assert_array_equal(getattr(part, name), getattr(alone, name), err_msg=name)


def test_valves_of_a_stack_have_their_rows_to_the_bit():
    """At angles whose tangent numpy rounds otherwise than Python, mostly one in 240."""
    angles = np.linspace(20.0, 70.0, 4001)
    otherwise = [math.tan(math.radians(a)) != t for a, t in zip(angles, np.tan(np.radians(angles)), strict=True)]
    angles = np.append(angles[::400], angles[otherwise])
    base, tensioner = car(), car().tensioners[0]
    stack = tensioner.model_copy(update={"valve": tensioner.valve.model_copy(update={"seat_angle": angles})})
    rows = np.zeros(len(angles), dtype=dtype_of(structs.Tensioner))
    fill_tensioner_element(rows, single_chain(base), stack)
    for v in range(len(angles)):
        alone = np.zeros(1, dtype=rows.dtype)
        fill_tensioner_element(alone, single_chain(base), pick_variants(stack, v))
        assert all(rows[name][v] == alone[name][0] for name in ("rest", "leak"))
        assert all(rows["check"][name][v] == alone["check"][name][0] for name in ("seat_width", "seat_growth"))


def test_only_what_stands_on_its_stop_or_is_not_touched_is_suspect():
    drives = [*cars(6), *(drive.with_values({"arms.arm.stops": (-8.0, -7.0)}) for drive in cars(3))]
    (stack,) = stacks_of_drives(list(map(single_chain, drives)))
    states = assemble_stacks([stack])
    for places, state in states.states_by_block(stack.members):
        told = [bool(layout_faults(single_chain(drives[v]), states[v].path)) for v in places.tolist()]
        assert has_possible_faults(single_chain(pick_variants(stack.one, places)), state.path).tolist() == told
    assert sum(bool(layout_faults(single_chain(drives[v]), states[v].path)) for v in range(9)) == 3


def test_cars_are_moved_together():
    """The place of a sprocket for a strain: sought to 1e-10 of strain, centers rounded to 1e-10 m."""
    drives = cars(4)
    strains = [2.0e-4, 2.5e-4, 3.0e-4, 3.5e-4]
    together = fit_positions(drives, "exhaust cam", (1.0, 0.0), strains, [0.004] * 4)
    for drive, strain, moved in zip(drives, strains, together, strict=True):
        alone = fit_position(drive, "exhaust cam", (1.0, 0.0), strain=strain, travel=0.004)
        assert moved.sprockets[2].center == pytest.approx(alone.sprockets[2].center, abs=2.1e-10)


def test_a_few_are_worked_out_one_by_one(monkeypatch):
    monkeypatch.undo()
    drives = cars(path.FEW - 1)
    states = assemble_stacks(stacks_of_drives(list(map(single_chain, drives))))
    assert len(states.blocks) == len(drives)
    assert np.array_equal(states[3].position, assemble(drives[3]).position)


def slack_cars(count, seed=3):
    """Cars whose arms come to their stops, so that some chains hang slack on the guides, on seats numbered unlike."""
    random, base, found = np.random.default_rng(seed), car(), []

    def between(low, high):
        return float(random.uniform(low, high))

    for _ in range(count):
        values = {
            "arms.arm.stops": (-3.0, between(0.1, 0.5)),
            "chain.elongation": between(0.0, 0.006),
            "sprockets.intake cam.center": (-0.062 * between(0.9, 1.1), 0.3008 * between(0.999, 1.001)),
            "sprockets.exhaust cam.center": (0.062 * between(0.9, 1.1), 0.3008 * between(0.97, 1.03)),
        }
        drive = base.with_values(values)
        try:
            assemble(drive)
        except DriveError:  # worn and far apart, one of them does not fit
            continue
        found.append(drive)
    return found


def test_slack_chains_seated_unlike_are_each_told_apart():
    """Strands that hang are laid for those alone whose rollers sit alike: which of these part is told of the whole."""
    drives = slack_cars(24)
    states = assemble_stacks(stacks_of_drives(list(map(single_chain, drives))))
    for found, drive in zip(states, drives, strict=True):
        assert_same(found, assemble(drive))
    assert min(state.strain for state in states) < 0.0 < max(state.strain for state in states)


def test_where_a_slack_strand_hangs_from_hangs_on_no_round_off():
    """Both ends of its longest straight part are rollers' places, to round-off: the strand hangs from them, always.

    A center moved by 1e-13 m moves rollers by as much, a slack strand's by 1e-13 m / sqrt(strain) ~ 1e-11 m; hung from
    the roller beside its end it would be off by a millimeter.
    """
    slack = car(**{"arms.arm.stops": (-3.0, 0.3), "chain.elongation": 0.004})
    x, y = slack.sprockets[1].center
    states = [assemble(slack.with_values({"sprockets.intake cam.center": (x + i * 1e-13, y)})) for i in range(8)]
    assert states[0].strain < -1e-4
    for state in states[1:]:
        assert np.abs(state.position - states[0].position).max() < 1e-9
