"""Chains of unlike links, a stack at once: each to the last bit as it stands alone."""

import numpy as np
import pytest
from assemblies import assert_same, error_of
from drives import example

from warpchain.assembly import assemble, path
from warpchain.assembly.fitting import fit_position, fit_positions
from warpchain.assembly.stack_assembly import assemble_stacks
from warpchain.assembly.timestep import resolve_step, step_limit
from warpchain.drive.stack_math import has_arrays
from warpchain.model import single_chain
from warpchain.model.stacks import pick_variants, stack_arrays, stack_of_values, stacks_of_drives, variant_count

COUNT = 24


def worn(random, v, links):
    """Two links of their own, which ones differs from variant to variant, one of them with no wear now and then."""
    places = random.choice(links, 2, replace=False).tolist()
    own = [0.0 if v % 6 == 0 else float(random.uniform(-0.002, 0.02)), float(random.uniform(0.0, 0.02))]
    return {"chain.worn_links": [{"link": i, "elongation": e} for i, e in zip(places, own, strict=True)]}


def lengthened(random, v, _):
    """Outer links of their own length, so that rollers ride above their seats and lean; every fifth as the inner."""
    inner = float(random.uniform(1e-4, 0.004))
    own = inner if v % 5 == 0 else float(random.uniform(1e-4, 0.012))
    return {"chain.elongation": inner, "chain.outer": {"elongation": own}}


def stiff(random, v, _):
    """Outer links of their own stiffness and damping; every fifth as stiff as the inner ones."""
    inner = 1e9 * float(random.uniform(0.9, 1.1))
    own = inner if v % 5 == 0 else 1.3 * inner
    return {"chain.stiffness": inner, "chain.outer": {"stiffness": own, "damping": 4e5 + 1e3 * v}}


def played(random, v, _):
    return {"chain.play": 1e-4 * float(random.uniform(0.1, 3.0))}


def everything(random, v, links):
    parts = [kind(random, v, links) for kind in (worn, lengthened, stiff, played)]
    outer = {key: value for part in parts for key, value in part.get("chain.outer", {}).items()}
    return {key: value for part in parts for key, value in part.items()} | {"chain.outer": outer}


KINDS = [worn, lengthened, stiff, played, everything]


def variants(kind, name="marine", count=COUNT, own=None):
    """Variants of an example whose links are unlike, taut and slack, with a sprocket elsewhere."""
    random, base, found = np.random.default_rng(7), example(name), []
    for v in range(count):
        values = kind(random, v, base.chain.links)
        values["sprockets.1.center"] = tuple(
            (np.array(base.sprockets[1].center) + 0.02 * base.chain.pitch * random.standard_normal(2)).tolist()
        )
        found.append(base.with_values(values if own is None else {**values, **own(random, base)}))
    return found


@pytest.mark.parametrize("kind", KINDS)
def test_each_is_assembled_as_if_alone(kind):
    drives = variants(kind)
    (stack,) = stacks_of_drives(list(map(single_chain, drives)))
    assert variant_count(stack.one) == len(drives) and not has_arrays(stack.one.chain.links)
    states = assemble_stacks([stack])
    assert len(states.blocks) == 1
    for found, drive in zip(states, drives, strict=True):
        assert_same(found, assemble(drive))


@pytest.mark.parametrize("kind", KINDS)
def test_each_has_the_step_and_the_stiffness_that_it_has_alone(kind):
    drives = variants(kind)
    stack = stack_of_values(drives)
    for of in (
        step_limit,
        resolve_step,
        lambda drive: drive.chain.mean_stiffness,
        lambda drive: drive.chain.varied_links,
    ):
        assert np.broadcast_to(of(stack), len(drives)).tolist() == [of(drive) for drive in drives]


@pytest.mark.parametrize("kind", KINDS)
def test_each_is_moved_as_if_alone(kind):
    """The place of a sprocket for a strain, sought among others."""
    drives = variants(kind, count=6)
    strains = [1e-4 * (v + 1) for v in range(6)]
    together = fit_positions(drives, "camshaft", (0.0, 1.0), strains, [0.5] * 6)
    for drive, strain, found in zip(drives, strains, together, strict=True):
        assert found == fit_position(drive, "camshaft", (0.0, 1.0), strain=strain, travel=0.5)


def test_links_lie_where_each_variant_has_them():
    """Link i is p (1 + e_i) long, whichever links of the others are worn; play is added where links are pulled."""
    drives = variants(everything)
    chain = stack_of_values(drives).chain
    assert chain.link_lengths.shape == (COUNT, chain.links)
    for v, drive in enumerate(drives):
        own = drive.chain
        expected = [own.pitch * (1.0 + (own.elongation if i % 2 else own.outer.elongation)) for i in range(own.links)]
        for one in own.worn_links:
            expected[one.link] = own.pitch * (1.0 + one.elongation)
        assert chain.link_lengths[v].tolist() == expected
        assert chain.pulled_lengths[v].tolist() == [length + own.play for length in expected]


def test_what_does_not_move_rollers_makes_no_states():
    """Outer links' stiffness and damping alone: one state for all of them."""
    base = example("marine")
    drives = [base.with_values({"chain.outer": {"stiffness": 1e9 + v, "damping": 1.0 + v}}) for v in range(5)]
    states = assemble_stacks(stacks_of_drives(list(map(single_chain, drives))))
    assert len(states.blocks) == 1 and states.row.tolist() == [0] * 5


def test_numbers_of_worn_links_and_what_is_given_make_kinds():
    base = example("marine")
    one, other = {"link": 3, "elongation": 0.01}, {"link": 8, "elongation": 0.0}
    changes = [{"chain.worn_links": [one]}, {"chain.worn_links": [other]}, {"chain.worn_links": [one, other]},
               {"chain.outer": {"elongation": 0.01}}, {"chain.outer": {"stiffness": 1e9}}, {"chain.play": 0.0},
               {"chain.play": 1e-4}, {"chain.worn_links": []}, {"chain.play": 2e-4}]  # fmt: skip
    drives = [base.with_values(change) for change in changes]
    assert [stack.members.tolist() for stack in stacks_of_drives(drives)] == [
        [0, 1],
        [2],
        [3],
        [4],
        [5],
        [6, 8],
        [7],
    ]
    (stack, *_) = stacks_of_drives(drives)
    assert [column.tolist() for column in stack_arrays(stack.one)] == [[3, 8], [0.01, 0.0]]
    assert [pick_variants(stack.one, v) for v in range(2)] == drives[:2]


@pytest.mark.parametrize("kind", [worn, lengthened, played])
def test_the_first_that_does_not_fit_is_named(kind):
    drives = variants(kind)
    for v in (17, 5):
        drives[v] = drives[v].with_values({"sprockets.1.center": (0.3, 9.0)})
    assert error_of(drives, 5)


def test_links_that_ride_over_the_tips_are_named():
    """An outer link as long as 1.1 pitches is refused, of a stack as alone."""
    drives = variants(lengthened)
    drives[9] = drives[9].with_values({"chain.outer.elongation": 0.1, "chain.elongation": 0.1})
    assert "would ride over its tips" in error_of(drives, 9)


def small(kind):
    """As unlike as a kind's links are, a tenth of it, which the car's arm takes up."""

    def made(random, v, links):
        found = kind(random, v, links)
        if "chain.worn_links" in found:
            own = [{**one, "elongation": 0.1 * one["elongation"]} for one in found["chain.worn_links"]]
            found["chain.worn_links"] = own
        if "chain.outer" in found:
            scaled = {"elongation": 0.1, "stiffness": 2e-3, "damping": 1e-3}
            found["chain.outer"] = {key: scaled[key] * value for key, value in found["chain.outer"].items()}
        scaled = {"chain.elongation": 0.1, "chain.stiffness": 2e-3, "chain.play": 0.02}
        return {key: scaled[key] * value if key in scaled else value for key, value in found.items()}

    return made


@pytest.mark.parametrize("kind", KINDS)
def test_on_guides_each_stands_as_it_stands_alone(kind, monkeypatch):
    """With arms and curved faces."""
    monkeypatch.setattr(path, "FEW", 2)
    drives = variants(small(kind), "car", 12, lambda random, base: {"sprockets.1.center": base.sprockets[1].center})
    (stack,) = stacks_of_drives(list(map(single_chain, drives)))
    states = assemble_stacks([stack])
    assert len(states.blocks) < 6
    for found, drive in zip(states, drives, strict=True):
        expected = assemble(drive)
        assert found.strain == expected.strain
        for name in (
            "position", "velocity", "arm_angle", "seat_sprocket", "seat_index", "strand_first", "strand_links",
        ):  # fmt: skip
            assert np.array_equal(getattr(found, name), getattr(expected, name)), name
