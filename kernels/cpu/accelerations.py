"""Accelerations on the CPU: those of rollers and bodies in given states, without a step."""

from functools import cache

import warp as wp

from ..modules import own_module
from ..native import STATE_ROWS, accessors
from ..structs import types
from .contact_pairs import nearness
from .neighbor_list import neighbor_list
from .rollers import passes, rows
from .steps import evaluating, moving


@cache
def accelerations_kernel(Real: type, capacity: int, plain: bool) -> wp.Kernel:
    """The kernel that evaluates variants' states, for up to `capacity` - 1 rollers; `plain` as in `serial`."""
    kinds = types(Real)
    Ensemble, State = kinds.Ensemble, kinds.State
    part, row, neighbors = passes(Real, capacity), rows(capacity), neighbor_list(Real, capacity)
    evaluate, memory_of = evaluating(Real, capacity, plain).evaluate, nearness(Real, capacity, plain).memory_of
    find_rates, store_row = moving(Real, plain).find_rates, accessors(Real).store_row

    @wp.func(inline=False)
    def accelerate(ensemble: Ensemble, state: State, variant: int, w: wp.array[Real]):
        """One variant; a function, for what `serial.march` is one."""
        drive = ensemble.drives[variant]
        chain = ensemble.chains[variant]
        n = drive.rollers
        part.fetch(state.rollers, ensemble.lengths, w, drive.first_roller, n)
        neighbors.reset(w, drive)
        memory = memory_of(state, drive)
        evaluate(ensemble, state, drive, chain, ensemble.links[variant], ensemble.joints[variant], w, memory)
        find_rates(ensemble, state, drive, wp.float64(0.0))
        i = int(0)
        while i < n:
            x, y = part.accelerations(w, i, chain.inverse_mass, chain.gravity)
            store_row(w, row.vx + i, x)
            store_row(w, row.vy + i, y)
            i = i + 1
        part.put_back(state.rollers, w, STATE_ROWS * drive.first_roller, n)

    @wp.kernel(enable_backward=False, module=own_module(__file__, "accelerations", Real, capacity, plain))
    def accelerations(ensemble: Ensemble, state: State, w: wp.array[Real], first: int):
        """Variants `first` + thread: the rollers' accelerations take the place of their velocities, the bodies' are in
        `state.rates`.
        """
        accelerate(ensemble, state, first + wp.tid(), w)

    return accelerations
