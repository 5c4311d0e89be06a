"""A contact law by itself, at given forces, speeds and dampings."""

from dataclasses import dataclass, field
from typing import Any

import warp as wp

from ..modules import own_module


@dataclass(frozen=True)
class TriedForce:
    """A contact law's function and its source, which tells it apart."""

    source: str
    function: wp.Function = field(repr=False)


def law_trial_kernel(force: TriedForce, Real: Any) -> wp.Kernel:
    """CPU kernel of a contact law's function.

    It takes (N, 3) elastic forces, impact speeds and dampings, and gives (N, 3) dampers and the speeds that bound them.
    """
    law = force.function

    @wp.kernel(enable_backward=False, module=own_module(__file__, "try_law", force, Real))
    def try_law(given: wp.array2d[Real], found: wp.array2d[Real]):
        """Row of a thread."""
        i = wp.tid()
        damper, slowest, fastest = law(given[i, 0], given[i, 1], given[i, 2])
        found[i, 0] = damper
        found[i, 1] = slowest
        found[i, 2] = fastest

    return try_law
