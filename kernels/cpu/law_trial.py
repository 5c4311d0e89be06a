"""A contact law by itself, at given forces, speeds and dampings."""

from typing import Any

import warp as wp


def law_trial_kernel(force: wp.Function, Real: Any) -> wp.Kernel:
    """CPU kernel of a contact law's function, a module of its own.

    It takes (N, 3) elastic forces, impact speeds and dampings, and gives (N, 3) dampers and the speeds that bound them.
    """

    @wp.kernel(enable_backward=False, module="unique")
    def try_law(given: wp.array2d[Real], found: wp.array2d[Real]):
        """Row of a thread."""
        i = wp.tid()
        damper, slowest, fastest = force(given[i, 0], given[i, 1], given[i, 2])
        found[i, 0] = damper
        found[i, 1] = slowest
        found[i, 2] = fastest

    return try_law
