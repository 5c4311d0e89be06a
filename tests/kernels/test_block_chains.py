"""The block kernel on cooperative fibers: drives of several chains, all on one block."""

from dataclasses import replace
from itertools import product

import chains
import numpy as np
import pytest
import warp as wp
from blocks import (
    V6,
    VALVED,
    geared_stages,
    kind_of,
    light_stages,
    pack_for,
    run_blocks,
    shape_of,
    sharing,
    some_of,
    stages_of_two_chains,
    v6,
)
from raw import stepped

from warpchain import load_drive
from warpchain.assembly.timestep import resolve_step
from warpchain.drive.examples import drive_path
from warpchain.engine.arrays import first_places
from warpchain.model import Model
from warpchain.results.channels import drive_frame_width
from warpchain.results.schedule import Schedule


def run(packed, variants, kind, blocks, order):
    """State, sums and frames of variants on blocks, by name; launches of so many steps."""
    chains_of = [chain for drive in variants for chain in Model(drive).chains]
    widths = [drive_frame_width(chain, packed.frame) * 16 for chain in chains_of]
    packed.drives["first_value"] = np.cumsum([0, *widths[:-1]])
    frames = wp.full(sum(widths), np.nan, dtype=packed.real, device="cpu")
    state, sums = run_blocks(packed, kind, blocks, order, frames)
    names = ("rollers", "bodies", "seat", "impact_speed", "joint_hold", "tensioners", "progress")
    return {name: getattr(state, name).numpy() for name in names} | sums | {"frames": frames.numpy()}


def assert_same(ours, theirs):
    for name in ours:
        np.testing.assert_array_equal(ours[name], theirs[name], err_msg=name)


def ensemble(drives, precision, **more):
    schedules = [Schedule(drive.run.step, 300, 111, 290, 20, 64) for drive in drives]
    return replace(pack_for(drives, schedules, precision), **more)


SOME = some_of(
    [
        *product([v6], [True], ["float64", "float32"], [V6]),
        *product([stages_of_two_chains, geared_stages], [True, False], ["float64", "float32"], [VALVED]),
    ],
    [(stages_of_two_chains, False, "float32", VALVED)],
    [(v6, True, "float64", V6), (geared_stages, True, "float64", VALVED)],
)


@pytest.mark.parametrize(("drives", "many", "precision", "family"), SOME)
def test_where_launches_end_does_not_matter(fibers, drives, many, precision, family):
    of_family, kind, frame = sharing(family, many, precision)
    variants = of_family[drives]
    packed = ensemble(variants, precision, frame=frame)
    whole = run(packed, variants, kind, [301], [0, 1])
    assert_same(whole, run(packed, variants, kind, [64, 96, 141], [1, 0]))
    assert np.isfinite(whole["frames"]).all()


@pytest.mark.parametrize(("drives", "many", "precision", "family"), SOME)
def test_a_variant_alone_is_the_same_in_a_crowd(fibers, drives, many, precision, family):
    of_family, kind, frame = sharing(family, many, precision)
    first, second = of_family[drives]
    crowd, alone = (
        run(ensemble(variants, precision, frame=frame), variants, kind, [301], [*range(len(variants))][::-1])
        for variants in ([first, second, first], [second])
    )
    whole = ensemble([first, second, first], precision)
    n = len(Model(second).chains)
    middle = whole.variant_range(n, 2 * n)
    for name, sort in (("rollers", "roller"), ("bodies", "body"), ("chain", "variant"), ("strand", "sprocket")):
        begin, end = (
            int(first_places(of.drives)[sort][-1]) for of in (whole.variant_range(0, n), whole.variant_range(0, 2 * n))
        )
        width = len(alone[name]) // int(first_places(middle.drives)[sort][-1])
        np.testing.assert_array_equal(crowd[name][width * begin : width * end], alone[name], err_msg=name)
    count = len(alone["frames"])
    np.testing.assert_array_equal(crowd["frames"][count : 2 * count], alone["frames"])


@pytest.mark.long
def test_two_equal_chains_are_one_of_twice_the_mass_stiffness_and_contact(fibers):
    """To round-off, which contacts amplify: the moments of two chains are added up in another order than one's."""
    one, two = ([chains.side_by_side(count, step=2.5e-6)] for count in (0, 2))
    packed = [ensemble(variants, "float64") for variants in (one, two)]
    kinds = [kind_of(each, shape_of(variants, 100)) for each, variants in zip(packed, (one, two), strict=True)]
    once, twice = (run(*each, [301], [0]) for each in zip(packed, (one, two), kinds, strict=True))
    n = 60
    rows, each = once["rollers"].reshape(6, n), twice["rollers"].reshape(2, 6, n)
    np.testing.assert_allclose(each, [rows, rows], atol=1e-10)
    before = pack_for(two, [Schedule(2.5e-6, 1, 0, 1, 0)], "float64").roller_rows(0)
    assert np.abs(each[0, :2] - before[:2]).max() > 1e-3
    for name in ("tension", "dissipated"):
        np.testing.assert_allclose(2.0 * twice["chain"][name], [once["chain"][name][0]] * 2, rtol=1e-9, err_msg=name)
    for name in ("energy_start", "energy_end"):  # of the shafts, too
        np.testing.assert_allclose(twice["chain"][name].sum(), once["chain"][name][0], rtol=1e-9, err_msg=name)
    np.testing.assert_allclose(twice["bodies"]["angle"], np.tile(once["bodies"]["angle"][:2], 4), atol=1e-10)
    turned = twice["bodies"]["speed"].reshape(4, 2)  # sprockets, shafts, the other chain's sprockets here and there
    np.testing.assert_array_equal(turned, np.tile(turned[0], (4, 1)))


def test_the_shaft_of_light_stages_answers_for_both_its_chains():
    """Over a roller's mass by 2 sum(n (R + b)^2) / J, of n rollers on each of its two sprockets."""
    drive = light_stages()[0]
    packed, squares = ensemble([drive], "float64"), 0.0
    for part, assembly, s in zip(Model(drive).chains, packed.assemblies, (1, 0), strict=True):
        reach = part.pitch_radius(s) + part.engagement(s)
        squares += (assembly.seat_sprocket == s).sum() * reach**2
    found = packed.sprockets["law"]["answer"][1:3] / packed.chains["mass"]
    assert found == pytest.approx([2.0 * squares / 2e-3] * 2, rel=1e-12)


@pytest.mark.long
def test_ten_milliseconds_of_gears_couplings_and_two_chains_are_those_of_the_cpu(fibers):
    """From one start: what differs between devices by more is where a slack chain settles (docs/devices.md).

    To round-off, which contacts amplify: 1e-11 of the mean tensions in 10 ms, a hundredth of what is allowed here.
    """
    drive = load_drive(drive_path("balance_shafts"))
    step = resolve_step(drive)
    steps = round(0.01 / step)
    packed = pack_for([drive], [Schedule(step, steps, 0, steps, 0)], "float64")
    serial, _ = stepped(packed, steps + 1)
    frames = wp.zeros(1, dtype=packed.real, device="cpu")
    _, ours = run_blocks(packed, kind_of(packed, shape_of([drive], 1)), [steps + 1], [0], frames)
    tension = serial.sums()["chain"]["tension"]
    np.testing.assert_allclose(ours["chain"]["tension"], tension, rtol=1e-9)
    assert (tension > 0.0).all()
