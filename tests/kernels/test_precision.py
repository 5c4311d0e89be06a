"""Sums and what is remembered at both precisions: every field of a struct has its way to a block and back."""

import subprocess
import sys

import numpy as np
import pytest
import warp as wp
from own_kernels import kernel

from warpchain.kernels.gpu.statistics import tally_sum_kernel
from warpchain.kernels.number import Pair, PairVector, RecentSum
from warpchain.kernels.precision import as_float32, as_float64
from warpchain.kernels.statistics import NOTES
from warpchain.kernels.structs import (
    PAIRS,
    ArmSums,
    ContactSums,
    Drive,
    LinkTally,
    MountSums,
    RollerTally,
    SprocketSums,
    Sums,
    Tallies,
    TensionerFlows,
    TensionerSums,
    types,
)
from warpchain.kernels.sums import gathered_sprocket_sums

KEPT = SprocketSums, MountSums, ArmSums, TensionerSums
"""Sums that blocks at float32 keep in pairs."""
BLOCKS = types(wp.float32, blocks=True)


def leaves(dtype, name=""):
    """Names of all numbers of a structured row."""
    inner = dtype.names or ()
    return [leaf for field in inner for leaf in leaves(dtype[field], f"{name}.{field}" if name else field)] or [name]


def at(rows, leaf):
    """The values of one of them."""
    for field in leaf.split("."):
        rows = rows[field]
    return rows


@pytest.mark.parametrize("full", [*KEPT, TensionerFlows, *PAIRS], ids=lambda full: full.key)
def test_every_field_has_its_way_there_and_back(full):
    given = np.zeros(3, dtype=full.numpy_dtype())
    for k, leaf in enumerate(leaves(given.dtype)):
        at(given, leaf)[...] = (k + 1) * np.pi
    made = getattr(BLOCKS, full.key)
    found = as_float64(as_float32(given, np.dtype(made.numpy_dtype())), given.dtype)
    for leaf in leaves(given.dtype):
        of = made
        for name in leaf.split("."):
            of = of.vars[name].type
        close = 2.0**-47 if of in (Pair, PairVector, RecentSum) else 2.0**-24
        np.testing.assert_allclose(at(found, leaf), at(given, leaf), rtol=close, err_msg=leaf)
        assert at(found, leaf).all(), leaf


def test_blocks_keep_every_sum_by_its_name():
    double, single = types(wp.float64, blocks=True), BLOCKS
    assert list(double.Sums.vars) == list(single.Sums.vars) == list(Sums.vars)
    for full in KEPT:
        made = getattr(single, full.key)
        assert getattr(double, full.key) is full
        assert [name for name in made.vars if not name.startswith("unused")] == list(full.vars)
        added = [
            name for name, var in full.vars.items() if var.type == wp.float64 and not name.endswith(("_min", "_max"))
        ]
        assert all(made.vars[name].type in (Pair, RecentSum) for name in added)


@kernel
def gathering(sums: wp.array[BLOCKS.SprocketSums]):
    sums[1] = gathered_sprocket_sums(sums[0])


def test_recent_terms_of_sums_are_gathered():
    recent = [name for name, var in BLOCKS.SprocketSums.vars.items() if var.type is RecentSum]
    assert recent == ["moment", "contact_work", "load_work", "late_work"]
    assert BLOCKS.SprocketSums.vars["speed"].type is Pair
    rows = np.zeros(2, dtype=BLOCKS.SprocketSums.numpy_dtype())
    for k, name in enumerate(recent, start=1):
        rows[name]["recent"][0] = k
    sums = wp.array(rows, dtype=BLOCKS.SprocketSums, device="cpu")
    wp.launch(gathering, 1, inputs=[sums], device="cpu")
    assert not any(sums.numpy()[name]["recent"][1] for name in recent)
    found = as_float64(sums.numpy(), np.dtype(SprocketSums.numpy_dtype()))
    for row in found:
        assert [row[name] for name in recent] == [1.0, 2.0, 3.0, 4.0]


def test_every_sum_of_contacts_and_links_comes_back_from_the_tallies():
    drive = np.zeros(1, dtype=Drive.numpy_dtype())
    drive["rollers"], drive["sprockets"], drive["bodies"], drive["points"] = 2, 1, 1, 1
    tallies, sums = Tallies(), Sums()
    for name, var in Tallies.vars.items():
        dtype, count = var.type.dtype, 4
        rows = np.zeros(count, dtype=dtype.numpy_dtype() if hasattr(dtype, "vars") else wp.dtype_to_numpy(dtype))
        for leaf in leaves(rows.dtype):
            (at(rows, leaf) if leaf else rows)[...] = 1
        setattr(tallies, name, wp.array(rows, dtype=dtype, device="cpu"))
    for name, var in Sums.vars.items():
        setattr(sums, name, wp.zeros(4 * NOTES, dtype=var.type.dtype, device="cpu"))
    inputs = [wp.array(drive, dtype=Drive, device="cpu"), tallies, sums]
    wp.launch(tally_sum_kernel(wp.float64), 1, inputs=inputs, device="cpu")
    contact, chain, strand = (getattr(sums, name).numpy()[0] for name in ("contact", "chain", "strand"))
    assert {name: contact[name] for name in ContactSums.vars if contact[name] == 0} == {}
    assert {name: chain[name] for name in RollerTally.vars if chain[name] == 0} == {}
    assert {name: chain[name] for name in LinkTally.vars if chain[name] == 0} == {}
    assert [strand[name] for name in ("links", "tension", "tension_square")] == [2, 2.0, 2.0]


def test_threads_that_ask_for_structs_at_once_get_the_same():
    program = (
        "import sys, threading, warp as wp\n"
        "from warpchain.kernels.structs import types\n"
        "sys.setswitchinterval(1e-6)\n"
        "start, found = threading.Barrier(4), []\n"
        "def ask():\n"
        "    start.wait()\n"
        "    found.append(types(wp.float32, True).Gear)\n"
        "threads = [threading.Thread(target=ask) for _ in range(4)]\n"
        "[thread.start() for thread in threads]\n"
        "[thread.join() for thread in threads]\n"
        "print(len(set(map(id, found))))\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "1"
