"""The table of arrays against the arrays that the kernels' structs have."""

import numpy as np
import pytest
import warp as wp
from drives import example

from warpchain.engine.arrays import (
    ARRAYS,
    FIRST_ITEMS,
    PACKED_ARRAYS,
    array_lengths,
    array_type,
    dtype_of,
    empty_sums,
    empty_tallies,
    first_places,
    upload_ensemble,
    upload_state,
)
from warpchain.engine.pack import pack
from warpchain.kernels import structs
from warpchain.results.schedule import Schedule

KEPT = {
    "state": "rollers bodies body_stages wrenches tensioners pushes meters strands seat impact_speed "
    "contact_hold damper_speed joint_hold hub_hold totals progress couplings push",
    "sums": "chain strand sprocket mount arm tensioner contact slip tension_counts "
    "chain_notes strand_notes sprocket_notes mount_notes shaft coupling gear valve",
    "tallies": "link impacts contacts missed dissipated friction impulse force_max roller body",
}


def held(drives):
    """The structs of two marine drives on a device, by group."""
    packed = pack(drives, [Schedule(1e-5, 10, 2, 10, 0)] * len(drives))
    return packed, {
        "ensemble": upload_ensemble(packed, "cpu"),
        "state": upload_state(packed, "cpu", (1, 1)),
        "sums": empty_sums(packed, "cpu"),
        "tallies": empty_tallies(packed, "cpu"),
    }


@pytest.mark.parametrize("real", [wp.float64, wp.float32])
def test_each_array_has_its_row(real):
    kinds = structs.types(real)
    of_group = {
        "ensemble": kinds.Ensemble,
        "state": kinds.State,
        "sums": structs.Sums,
        "tallies": structs.Tallies,
    }
    assert of_group.keys() == ARRAYS.keys()
    for group, struct in of_group.items():
        arrays = {name for name, var in struct.vars.items() if isinstance(var.type, type(wp.array[real]))}
        assert arrays == ARRAYS[group].keys()
        assert struct.vars.keys() == arrays


def test_arrays_are_as_the_table_says():
    """Types are the structs', lengths those of the rows; what is packed, and zeros elsewhere, is what devices get."""
    packed, groups = held([example("marine")] * 2)
    first = first_places(packed.drives)
    for group, struct in groups.items():
        for name, row in ARRAYS[group].items():
            array, kind = getattr(struct, name), array_type(group, name, wp.float64)
            assert array.dtype == kind, name
            if row.dimension and row.values_for_device is None and row.where != "cpu":
                assert (
                    len(array) == array_lengths(packed.drives, group)[name] >= row.width * first[row.dimension][-1]
                ), name
            if row.packed_name and row.values_for_device is None:
                assert getattr(packed, row.packed_name).dtype == dtype_of(kind), name
                np.testing.assert_array_equal(array.numpy(), getattr(packed, row.packed_name), err_msg=name)
            elif group in ("state", "tallies") and row.dimension:
                assert not any(array.numpy().tobytes()), name
    for name in FIRST_ITEMS:
        np.testing.assert_array_equal(packed.drives[name], first[name.removeprefix("first_")][:-1])


def test_precisions_and_copies_go_by_the_table():
    packed, _ = held([example("marine")])
    single, twin = packed.at_precision("float32"), packed.copy()
    for name, place in PACKED_ARRAYS.items():
        assert getattr(single, name).dtype == dtype_of(array_type(*place, wp.float32)), name
        np.testing.assert_array_equal(getattr(twin, name), getattr(packed, name), err_msg=name)
        assert not np.shares_memory(getattr(twin, name), getattr(packed, name)), name


def test_states_on_disk_keep_their_order():
    """The bytes of a state are these arrays', one after the other: another order makes other files."""
    kept = {group: " ".join(name for name, row in rows.items() if row.in_checkpoints) for group, rows in ARRAYS.items()}
    assert {group: names for group, names in kept.items() if names} == KEPT
