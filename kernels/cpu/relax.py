"""Settling on the CPU: relaxation (`relaxation`) of one variant a thread."""

from functools import cache

import warp as wp

from ..modules import own_module
from ..native import accessors
from ..physics.body import relax_arm
from ..relaxation import ENERGY_EVERY, Settling, finite_size, judged, relative_residual, relaxation_kick
from ..structs import Drive, types
from .contact_pairs import nearness
from .neighbor_list import neighbor_list
from .rollers import passes, rows
from .steps import evaluating, moving


@cache
def relax_kernel(Real: type, capacity: int) -> wp.Kernel:
    """The kernel that settles variants, for up to `capacity` - 1 rollers."""
    kinds = types(Real)
    Ensemble, State, Chain = kinds.Ensemble, kinds.State, kinds.Chain
    part, row, neighbors = passes(Real, capacity), rows(capacity), neighbor_list(Real, capacity)
    forces, near = evaluating(Real, capacity), nearness(Real, capacity)
    load_row = accessors(Real).load_row
    rates_of, carry = moving(Real).rates_of, moving(Real).carry

    @wp.func
    def kinetic_energy(w: wp.array[Real], n: int, mass: Real):
        total = wp.float64(0.0)
        i = int(0)
        while i < n:
            vx = load_row(w, row.vx + i)
            vy = load_row(w, row.vy + i)
            total += wp.float64(vx * vx + vy * vy)
            i = i + 1
        return wp.float64(0.5) * wp.float64(mass) * total

    @wp.func
    def arms_energy(ensemble: Ensemble, state: State, drive: Drive):
        """Kinetic energy of the arms [J]."""
        total = wp.float64(0.0)
        for a in range(drive.arms):
            b = drive.first_body + drive.bodies - drive.arms + a
            speed = state.bodies[b].speed
            total += wp.float64(0.5) * speed * speed / ensemble.motions[b].inverse_inertia
        return total

    @wp.func
    def arms_acceleration(ensemble: Ensemble, state: State, drive: Drive, chain: Chain):
        """Largest net moment on an arm, as the acceleration [m/s^2] of a roller pushed by that over its reach."""
        worst = wp.float64(0.0)
        for a in range(drive.arms):
            b = drive.first_body + drive.bodies - drive.arms + a
            rates = rates_of(ensemble, state, drive, b, wp.float64(0.0))
            reach = ensemble.arms[drive.first_arm + a].reach
            angular = wp.vec2d(rates[2], wp.float64(0.0)) / (ensemble.motions[b].inverse_inertia * reach)
            worst = wp.max(worst, finite_size(wp.float64(chain.inverse_mass) * angular))
        return worst

    @wp.func
    def turn_arms(ensemble: Ensemble, state: State, drive: Drive, kick: wp.float64, h: wp.float64):
        """A step of every arm."""
        for a in range(drive.arms):
            b = drive.first_body + drive.bodies - drive.arms + a
            rates = rates_of(ensemble, state, drive, b, wp.float64(0.0))
            body = state.bodies[b]
            state.bodies[b] = relax_arm(body, rates[2], kick, h)
        if drive.hubs != 0:
            carry(ensemble, state, drive)

    @wp.func
    def residual(w: wp.array[Real], n: int, chain: Chain, beside: wp.float64):
        """Largest net force on a roller or an arm (`beside`), relative as in `relative_residual`."""
        worst = Real(beside)
        tension = Real(0.0)
        i = int(0)
        while i < n:
            worst = wp.max(worst, finite_size(part.acceleration(w, i, chain.inverse_mass, chain.gravity)))
            tension = wp.max(tension, wp.abs(load_row(w, row.tension + i)))
            i = i + 1
        gravity = wp.vec2d(wp.float64(chain.gravity[0]), wp.float64(chain.gravity[1]))
        stiffness = wp.float64(chain.stiffness)
        return relative_residual(wp.float64(worst), wp.float64(tension), wp.float64(chain.mass), gravity, stiffness)

    @wp.func(inline=False)
    def settle(
        ensemble: Ensemble, state: State, settling: wp.array[Settling], variant: int, w: wp.array[Real], steps: int
    ):
        """One variant: up to `steps` steps of relaxation; a function, as `advance.march` is."""
        drive = ensemble.drives[variant]
        chain = ensemble.chains[variant]
        chain.joint.inertia = Real(0.0)  # no friction while settling
        memory = near.at_chain(near.memory_of(state, drive), drive, chain)
        s = settling[variant]
        n = drive.rollers
        part.fetch(state, ensemble.lengths, w, drive.first_roller, n)
        neighbors.reset(w, drive)
        end = wp.min(s.steps + steps, s.limit)
        while s.steps < end and s.settled == 0:
            forces.pull(ensemble, state, drive, chain, w, memory)
            forces.push(ensemble, state, drive, w, memory)
            restart = int(0)
            if s.steps % ENERGY_EVERY == 0:
                beside = wp.float64(0.0)
                energy = kinetic_energy(w, n, chain.mass)
                beside = arms_acceleration(ensemble, state, drive, chain)
                energy = energy + arms_energy(ensemble, state, drive)
                s, restart = judged(s, energy, residual(w, n, chain, beside))
                if restart == 1:
                    part.clear(w, row.vx, row.vy, n)
            if s.settled == 0:
                turn_arms(ensemble, state, drive, relaxation_kick(s, restart), s.step)
                part.kick_drift(w, n, chain, Real(relaxation_kick(s, restart)), Real(s.step))
                s.steps = s.steps + 1
        settling[variant] = s
        part.put_back(state, w, drive.first_roller, n)

    @wp.kernel(enable_backward=False, module=own_module(__file__, "relax", Real, capacity))
    def relax(
        ensemble: Ensemble, state: State, settling: wp.array[Settling], w: wp.array[Real], first: int, steps: int
    ):
        """Variants `first` + thread: up to `steps` steps of relaxation."""
        settle(ensemble, state, settling, first + wp.tid(), w, steps)

    return relax
