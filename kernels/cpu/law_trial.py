"""Trial of a contact law by itself, at given forces, speeds and dampings."""

from dataclasses import dataclass, field
from typing import Any

import warp as wp

from ..modules import own_module


@dataclass(frozen=True)
class TriedForce:
    """A contact law's function and its source, which identifies it."""

    source: str
    function: wp.Function = field(repr=False)


def law_trial_kernel(force: TriedForce, Real: Any) -> wp.Kernel:
    """CPU kernel of a contact law's function.

    In: (N, 3) elastic forces, impact speeds, dampings. Out: (N, 3) dampers and speeds that bound them.
    """
    law = force.function

    @wp.kernel(enable_backward=False, module=own_module(__file__, "try_law", force, Real))
    def try_law(given: wp.array2d[Real], found: wp.array2d[Real]):
        """Writes the contact law's values for a thread's row."""
        i = wp.tid()
        damper, slowest, fastest = law(given[i, 0], given[i, 1], given[i, 2])
        found[i, 0] = damper
        found[i, 1] = slowest
        found[i, 2] = fastest

    return try_law
