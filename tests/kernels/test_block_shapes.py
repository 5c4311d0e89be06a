"""Block kernels of every shape on cooperative fibers: in each a variant has the same bits, its sums too.

Few variants have a roller a thread, many a warp each; kernels without metrics take the steps outside its window.
"""

from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np
import pytest
import warp as wp
from blocks import (
    RUBBING,
    TENSIONED,
    arms,
    bending,
    equal_sprockets,
    fed,
    flat,
    folded,
    kind_of,
    light_wheels,
    marine,
    moving_sprockets,
    pack_for,
    rk4,
    rubbing,
    run_blocks,
    shape_of,
    sharing,
    shod,
    some_of,
    swung,
    trains,
    uneven,
    unusual_contacts,
    v6,
    valves,
)

from warpchain.engine.arrays import ARRAYS
from warpchain.kernels.gpu.shared_memory import parts_per_body
from warpchain.results.schedule import Schedule

DRIVES = [
    equal_sprockets, marine, rubbing, bending, uneven, light_wheels, unusual_contacts, moving_sprockets, arms, fed,
    swung, shod, folded, trains, valves, rk4, v6,
]  # fmt: skip
USUAL = [(bending, "float64", RUBBING)]
LONG = [
    (equal_sprockets, "float32", ()), (shod, "float64", ()), (marine, "float32", ()), (arms, "float64", TENSIONED),
    (swung, "float64", TENSIONED),
]  # fmt: skip
CASES = list(dict.fromkeys([*USUAL, *LONG, *product(DRIVES, ("float64", "float32"), [()])]))
STATE = ("rollers", "bodies", "seat", "impact_speed", "tensioners")
END = 300


def taken(drives, precision, each, measuring, family=()):
    """State and sums of an ensemble at its end, on blocks of which a multiprocessor gets so many."""
    of_family, kind, frame = sharing(family or (drives,), each > 1, precision)
    variants = of_family[drives]
    schedules = [Schedule(drive.run.step, END, 111, END - 10, 0) for drive in variants]
    packed = replace(pack_for(variants, schedules, precision), frame=frame)
    order, none = range(len(packed.first_rows)), wp.zeros(1, dtype=packed.real, device="cpu")
    return run_blocks(packed, replace(kind, measuring=measuring), [END + 1], [*order], none)


def assert_same_state(mine, theirs):
    for name in STATE:
        np.testing.assert_array_equal(getattr(mine, name).numpy(), getattr(theirs, name).numpy(), err_msg=name)


@pytest.mark.parametrize(("drives", "precision", "family"), some_of(CASES, USUAL, LONG))
def test_each_shape_gives_the_same_bits_with_metrics_and_without(fibers, drives, precision, family):
    few, sums = taken(drives, precision, 1, True, family)
    many, theirs = taken(drives, precision, 100, True, family)
    assert_same_state(many, few)
    for name in ARRAYS["sums"]:
        mine, other = (flat(of[name]) if of[name].dtype.names else {"of all": of[name]} for of in (sums, theirs))
        for field in mine:
            np.testing.assert_array_equal(other[field], mine[field], err_msg=f"{name}.{field}")
    for each in (1, 100):
        assert_same_state(taken(drives, precision, each, False, family)[0], few)


@pytest.mark.parametrize(("drives", "many"), [(shod, 128), (swung, 32)])
def test_parts_of_sums_are_of_rollers_where_an_arm_has_a_guide_beside_its_sprocket(drives, many):
    """Else of threads, which take on their rollers in the same order: each presses on an arm in one way."""
    variants = drives()
    packed = pack_for(variants, [Schedule(1e-6, 10, 1, 10, 0)] * 2, "float64")
    kinds = [kind_of(packed, shape_of(variants, each)) for each in (1, 100)]
    assert [parts_per_body(kind) for kind in kinds] == [128, many]


@pytest.mark.parametrize("precision", ["float64", pytest.param("float32", marks=pytest.mark.long)])
def test_neighbors_that_diverge_leave_a_variant_its_bits(fibers, precision):
    first, second = equal_sprockets()
    torn = second.with_values({"sprockets.driver.prescribed": {"speed": 1e5, "ramp_time": 0.0}})
    ends = []
    for variants in ([first, second], [first, torn]):
        state, sums = taken(partial(list, variants), precision, 100, True)
        of_first = slice(6 * first.chain.links)
        ends.append((state.progress.numpy()["diverged"].tolist(), state.rollers.numpy()[of_first], sums["chain"][0]))
    (none, rollers, chain), (one, beside, sums_beside) = ends
    assert (none, one) == ([0, 0], [0, 1])
    np.testing.assert_array_equal(beside, rollers)
    assert sums_beside == chain
