"""Sums and what is remembered at both precisions: every field of a struct has its way to a block and back."""

import numpy as np
import pytest
import warp as wp
from grown import grown, recipe, run_in

from warpchain.kernels.gpu.observe import collect
from warpchain.kernels.number import Pair, RecentSum, gathered, whole
from warpchain.kernels.structs import Drive, float32, types
from warpchain.kernels.sum_structs import (
    ArmSums,
    ContactSums,
    LinkTally,
    MountSums,
    RollerTally,
    SprocketSums,
    Sums,
    Tallies,
    TensionerFlows,
    TensionerSums,
)

KEPT = SprocketSums, MountSums, ArmSums, TensionerSums
"""Sums that blocks keep in shared memory, at float32 in pairs."""
narrowed = types(wp.float32).narrowed


def leaves(dtype, name=""):
    """Names of all numbers of a structured row."""
    inner = dtype.names or ()
    return [leaf for field in inner for leaf in leaves(dtype[field], f"{name}.{field}" if name else field)] or [name]


def at(rows, leaf):
    """The values of one of them."""
    for field in leaf.split("."):
        rows = rows[field]
    return rows


def there_and_back(full, Real):
    """The kernel that keeps a struct as a block does, and gives it back."""
    narrowed = types(Real).narrowed

    @wp.kernel(enable_backward=False, module="unique")
    def kernel(given: wp.array[full], found: wp.array[full]):
        found[0] = whole(narrowed(given[0]))

    return kernel


@pytest.mark.parametrize("Real", [wp.float64, wp.float32], ids=["float64", "float32"])
@pytest.mark.parametrize("full", [*KEPT, TensionerFlows], ids=lambda full: full.key)
def test_every_field_has_its_way_there_and_back(full, Real):
    given = np.zeros(1, dtype=full.numpy_dtype())
    for k, leaf in enumerate(leaves(given.dtype)):
        at(given, leaf)[...] = (k + 1) * np.pi
    found = wp.zeros(1, dtype=full, device="cpu")
    wp.launch(there_and_back(full, Real), 1, inputs=[wp.array(given, dtype=full, device="cpu"), found], device="cpu")
    for leaf in leaves(given.dtype):
        once = leaf.endswith(("_min", "_max")) or (full is TensionerFlows and leaf == "lift")
        close = 0.0 if Real == wp.float64 else 2.0**-24 if once else 2.0**-47
        np.testing.assert_allclose(at(found.numpy(), leaf), at(given, leaf), rtol=close, err_msg=leaf)


def test_blocks_keep_the_sums_of_every_body_by_the_same_names():
    double, single = types(wp.float64).Shared.vars, types(wp.float32).Shared.vars
    for full in KEPT:
        (name,) = (
            f"{field}_sums" for field, var in Sums.vars.items() if var.type.dtype is full and "note" not in field
        )
        made = single[name].type.dtype
        assert double[name].type.dtype is full
        assert made is getattr(float32, full.key)
        assert list(made.vars) == list(full.vars)


@wp.kernel(enable_backward=False, module="unique")
def gathering(out: wp.array[SprocketSums], kept: wp.array[wp.float32]):
    sums = narrowed(SprocketSums())
    sums.moment.recent = 1.0
    sums.contact_work.recent = 2.0
    sums.load_work.recent = 3.0
    out[0] = whole(sums)
    sums = gathered(sums)
    kept[0] = sums.moment.recent + sums.contact_work.recent + sums.load_work.recent
    out[1] = whole(sums)


def test_recent_terms_of_sums_are_gathered():
    recent = [name for name, var in float32.SprocketSums.vars.items() if var.type is RecentSum]
    assert recent == ["moment", "contact_work", "load_work"]
    assert float32.SprocketSums.vars["speed"].type is Pair
    out, kept = wp.zeros(2, dtype=SprocketSums, device="cpu"), wp.ones(1, dtype=wp.float32, device="cpu")
    wp.launch(gathering, 1, inputs=[out, kept], device="cpu")
    assert kept.numpy()[0] == 0.0
    for rows in out.numpy():
        assert [rows[name] for name in recent] == [1.0, 2.0, 3.0]


def test_every_sum_of_contacts_and_links_comes_back_from_the_tallies():
    drive = np.zeros(1, dtype=Drive.numpy_dtype())
    drive["rollers"], drive["sprockets"], drive["bodies"] = 2, 1, 1
    tallies, sums = Tallies(), Sums()
    for name, var in Tallies.vars.items():
        dtype, count = var.type.dtype, 4
        rows = np.zeros(count, dtype=dtype.numpy_dtype() if hasattr(dtype, "vars") else wp.dtype_to_numpy(dtype))
        for leaf in leaves(rows.dtype):
            (at(rows, leaf) if leaf else rows)[...] = 1
        setattr(tallies, name, wp.array(rows, dtype=dtype, device="cpu"))
    for name, var in Sums.vars.items():
        setattr(sums, name, wp.zeros(64, dtype=var.type.dtype, device="cpu"))
    wp.launch(collect, 1, inputs=[wp.array(drive, dtype=Drive, device="cpu"), tallies, sums], device="cpu")
    contact, chain, strand = (getattr(sums, name).numpy()[0] for name in ("contact", "chain", "strand"))
    assert {name: contact[name] for name in ContactSums.vars if contact[name] == 0} == {}
    assert {name: chain[name] for name in RollerTally.vars if chain[name] == 0} == {}
    assert {name: chain[name] for name in LinkTally.vars if chain[name] == 0} == {}
    assert [strand[name] for name in ("links", "tension", "tension_square")] == [2, 2.0, 2.0]


ON_FIBERS = """
import warp as wp
from blocks import assert_steps_of_the_cpu, marine
from warpchain.kernels.sum_structs import SprocketSums

wp.config.enable_cpu_blocks = True
assert "moment_max" in SprocketSums.vars
assert_steps_of_the_cpu(marine, False, "float32")  # of every field of every sum
"""


def test_the_recipe_of_a_metric_at_float32_on_blocks(tmp_path):
    run_in(grown(tmp_path, recipe("A new metric")), ON_FIBERS)
