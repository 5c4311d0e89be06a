"""What tests read off an assembled chain."""

from dataclasses import fields

import numpy as np
import pytest

from warpchain.assembly import assemble
from warpchain.assembly.stack_assembly import assemble_stacks
from warpchain.errors import DriveError
from warpchain.model import single_chain
from warpchain.model.stacks import stacks_of_drives


def link_lengths(assembly):
    return np.hypot(*(np.roll(assembly.position, -1, axis=0) - assembly.position).T)


def strand_of_link(assembly):
    """(N,) the strand that each link belongs to, -1 on an arc."""
    strand = np.full(len(assembly.position), -1)
    for k, (first, links) in enumerate(zip(assembly.strand_first, assembly.strand_links, strict=True)):
        strand[first : first + links] = k
    return strand


def strand_rollers(assembly, k):
    """The positions of strand k's rollers, both end seats included."""
    index = (assembly.strand_first[k] + np.arange(assembly.strand_links[k] + 1)) % len(assembly.position)
    return assembly.position[index]


def assert_same(found, expected):
    """That all of an assembly, its path included, has the same bits."""
    for field in fields(expected):
        mine, other = getattr(found, field.name), getattr(expected, field.name)
        if hasattr(other, "__dataclass_fields__"):
            assert_same(mine, other)
        elif isinstance(other, tuple):
            assert repr(mine) == repr(other)
        else:
            assert np.array_equal(mine, other) and np.shape(mine) == np.shape(other), field.name


def error_of(drives, variant):
    """Why a variant cannot be assembled: the same of a batch, which names it as the first, as by itself."""
    with pytest.raises(DriveError) as alone:
        assemble(drives[variant])
    with pytest.raises(DriveError) as together:
        assemble_stacks(stacks_of_drives(list(map(single_chain, drives))))
    assert str(together.value) == f"variant {variant}: {alone.value}"
    return str(alone.value)


def differences(potential, x, i, d=1e-9):
    """Slope of the energy along coordinate i, and of its gradient, by central differences."""
    after, before = (potential.terms(np.where(np.arange(len(x)) == i, x + by, x)) for by in (d, -d))
    return (after.energy - before.energy) / (2 * d), (after.gradient - before.gradient) / (2 * d)
