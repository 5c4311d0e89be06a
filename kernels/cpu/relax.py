"""Settling on the CPU: relaxation (`relaxation`) of one variant a thread."""

from functools import cache

import warp as wp

from ..relaxation import LOOK_EVERY, Settling
from ..rows import STATE_ROWS, accessors
from ..structs import types
from .integrate import stepping
from .rollers import passes, rows


@cache
def relax_kernel(Real: type, capacity: int) -> wp.Kernel:
    """The kernel that settles variants, for up to `capacity` - 1 rollers."""
    kinds = types(Real)
    part = passes(Real, capacity)
    do = stepping(Real, capacity)
    load, store = accessors(Real).load, accessors(Real).store
    at = rows(capacity)
    VX, VY, TENSION = at.vx, at.vy, at.tension
    kick_drift, acceleration = part.kick_drift, part.acceleration

    @wp.func
    def kinetic_energy(w: wp.array(dtype=Real), n: int, mass: Real):
        total = wp.float64(0.0)
        i = int(0)
        while i < n:
            vx = load(w, VX + i)
            vy = load(w, VY + i)
            total += wp.float64(vx * vx + vy * vy)
            i = i + 1
        return wp.float64(0.5) * wp.float64(mass) * total

    @wp.func
    def stop(w: wp.array(dtype=Real), n: int):
        i = int(0)
        while i < n:
            store(w, VX + i, Real(0.0))
            store(w, VY + i, Real(0.0))
            i = i + 1

    @wp.func
    def residual(w: wp.array(dtype=Real), n: int, chain: kinds.Chain):
        """Largest net force on a roller over the largest link force or a roller's weight; huge where not finite."""
        worst = Real(0.0)
        scale = chain.mass * wp.length(chain.gravity)
        i = int(0)
        while i < n:
            size = wp.length(acceleration(w, i, chain.inverse_mass, chain.gravity))
            if not size < Real(1.0e30):
                size = Real(1.0e30)
            worst = wp.max(worst, size)
            scale = wp.max(scale, wp.abs(load(w, TENSION + i)))
            i = i + 1
        if scale == Real(0.0):
            return wp.float64(worst)
        return wp.float64(chain.mass * worst / scale)

    @wp.kernel(enable_backward=False, module="unique")
    def relax(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        settling: wp.array(dtype=Settling),
        w: wp.array(dtype=Real),
        first: int,
        block: int,
    ):
        """Variants `first` + thread: up to `block` steps of relaxation."""
        variant = first + wp.tid()
        drive = ensemble.drives[variant]
        chain = ensemble.chains[variant]
        s = settling[variant]
        n = drive.rollers
        part.fetch(state.rollers, ensemble.lengths, w, drive.first_roller, n)
        end = wp.min(s.steps + block, s.limit)
        while s.steps < end and s.settled == 0:
            do.evaluate(ensemble, state, drive, chain, w, 0)
            kick = s.step
            if s.steps == 0:
                kick = wp.float64(0.5) * s.step
            if s.steps % LOOK_EVERY == 0:
                energy = kinetic_energy(w, n, chain.mass)
                s.residual = residual(w, n, chain)
                if s.residual < s.tolerance:
                    s.settled = 1
                if energy < s.energy:
                    stop(w, n)
                    energy = wp.float64(0.0)
                    kick = wp.float64(0.5) * s.step
                s.energy = energy
            if s.settled == 0:
                kick_drift(w, n, chain, Real(kick), Real(s.step))
                s.steps = s.steps + 1
        settling[variant] = s
        part.put_back(state.rollers, w, STATE_ROWS * drive.first_roller, n)

    return relax
