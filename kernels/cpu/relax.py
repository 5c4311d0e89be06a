"""Settling on the CPU: relaxation (`relaxation`) of one variant a thread."""

from functools import cache

import warp as wp

from ..modules import own_module
from ..native import row_access
from ..physics.body import relax_arm
from ..relaxation import ENERGY_EVERY, Settling, finite_size, relative_residual, relaxation_after_check, relaxation_kick
from ..structs import Drive, types
from . import bodies, hubs
from .forces import force_functions
from .link_runs import link_run_functions
from .near_rollers import near_roller_functions
from .neighbor_list import neighbor_list_functions
from .rollers import roller_functions, rows


@cache
def relax_kernel(Real: type, capacity: int, silent: bool = False) -> wp.Kernel:
    """CPU kernel that settles variants, for up to `capacity` - 1 rollers of a chain; only with `silent` silent ones."""
    kinds = types(Real)
    Ensemble, State, Chain = kinds.Ensemble, kinds.State, kinds.Chain
    rollers = roller_functions(Real, capacity)
    row = rows(capacity)
    neighbor_list = neighbor_list_functions(Real, capacity)
    forces = force_functions(Real, capacity, silent)
    near_rollers = near_roller_functions(Real, capacity)
    access = row_access(Real)
    link_runs = link_run_functions(Real, capacity)

    @wp.func
    def kinetic_energy(w: wp.array[Real], n: int, mass: Real):
        """Kinetic energy [J] of rollers in settling on the CPU."""
        total = wp.float64(0.0)
        i = int(0)
        while i < n:
            vx = access.load(w, row.vx + i)
            vy = access.load(w, row.vy + i)
            total += wp.float64(vx * vx + vy * vy)
            i = i + 1
        return wp.float64(0.5) * wp.float64(mass) * total

    @wp.func
    def arms_energy(ensemble: Ensemble, state: State, drive: Drive):
        """Kinetic energy [J] of arms in settling on the CPU."""
        total = wp.float64(0.0)
        for a in range(drive.arms):
            b = drive.first_body + drive.bodies - drive.arms + a
            speed = state.bodies[b].speed
            total += wp.float64(0.5) * speed * speed / ensemble.motions[b].inverse_inertia
        return total

    @wp.func
    def largest_arm_acceleration(ensemble: Ensemble, state: State, drive: Drive, chain: Chain):
        """Largest net moment on a settling arm, as acceleration [m/s^2] of a roller at its reach."""
        worst = wp.float64(0.0)
        for a in range(drive.arms):
            b = drive.first_body + drive.bodies - drive.arms + a
            rates = bodies.accelerations_of(ensemble, state, drive, b, wp.float64(0.0))
            reach = ensemble.arms[drive.first_arm + a].reach
            angular = wp.vec2d(rates[2], wp.float64(0.0)) / (ensemble.motions[b].inverse_inertia * reach)
            worst = wp.max(worst, finite_size(wp.float64(chain.inverse_mass) * angular))
        return worst

    @wp.func
    def relax_arms(ensemble: Ensemble, state: State, drive: Drive, kick: wp.float64, h: wp.float64):
        """Moves every arm by one step of relaxation."""
        for a in range(drive.arms):
            b = drive.first_body + drive.bodies - drive.arms + a
            rates = bodies.accelerations_of(ensemble, state, drive, b, wp.float64(0.0))
            body = state.bodies[b]
            state.bodies[b] = relax_arm(body, rates[2], kick, h)
        if drive.hubs != 0:
            hubs.place_carried_bodies(ensemble, state, drive)

    @wp.func
    def largest_residual(w: wp.array[Real], n: int, chain: Chain, beside: wp.float64):
        """Largest net force on a roller or an arm (`beside`, as acceleration), as `relaxation.relative_residual`."""
        worst = Real(beside)
        tension = Real(0.0)
        i = int(0)
        while i < n:
            worst = wp.max(worst, finite_size(rollers.acceleration(w, i, chain.inverse_mass, chain.gravity)))
            tension = wp.max(tension, wp.abs(access.load(w, row.tension + i)))
            i = i + 1
        gravity = wp.vec2d(wp.float64(chain.gravity[0]), wp.float64(chain.gravity[1]))
        stiffness = wp.float64(chain.stiffness)
        return relative_residual(wp.float64(worst), wp.float64(tension), wp.float64(chain.mass), gravity, stiffness)

    @wp.func(inline=False)
    def settle_variant(
        ensemble: Ensemble, state: State, settling: wp.array[Settling], variant: int, w: wp.array[Real], steps: int
    ):
        """Settles one variant on the CPU by up to `steps` steps."""
        drive = ensemble.drives[variant]
        chain = ensemble.chains[variant]
        chain.joint.inertia = Real(0.0)  # no friction while settling
        memory = near_rollers.memory_at_chain(near_rollers.contact_memory(state, drive), drive, chain)
        s = settling[variant]
        n = drive.rollers
        rollers.fetch(state, ensemble.lengths, w, drive.first_roller, n)
        if wp.static(silent):
            if drive.points > 1:
                link_runs.fetch_pushes(state, drive, w)
        neighbor_list.reset(w, drive)
        end = wp.min(s.steps + steps, s.limit)
        while s.steps < end and s.settled == 0:
            forces.add_link_forces(ensemble, state, drive, chain, w, memory)
            forces.add_contact_forces(ensemble, state, drive, variant, w, memory)
            restart = int(0)
            if s.steps % ENERGY_EVERY == 0:
                beside = wp.float64(0.0)
                energy = kinetic_energy(w, n, chain.mass)
                beside = largest_arm_acceleration(ensemble, state, drive, chain)
                energy = energy + arms_energy(ensemble, state, drive)
                s, restart = relaxation_after_check(s, energy, largest_residual(w, n, chain, beside))
                if restart == 1:
                    rollers.clear_rows(w, row.vx, row.vy, n)
            if s.settled == 0:
                relax_arms(ensemble, state, drive, relaxation_kick(s, restart), s.step)
                rollers.kick_and_drift(w, n, chain, Real(relaxation_kick(s, restart)), Real(s.step))
                s.steps = s.steps + 1
        if wp.static(silent):
            if drive.points > 1:
                link_runs.put_back_pushes(state, drive, w)
        settling[variant] = s
        rollers.put_back(state, w, drive.first_roller, n)

    @wp.kernel(enable_backward=False, module=own_module(__file__, "relax", Real, capacity, silent))
    def relax(
        ensemble: Ensemble, state: State, settling: wp.array[Settling], w: wp.array[Real], first: int, steps: int
    ):
        """Settles variants `first` + thread on the CPU by up to `steps` steps."""
        settle_variant(ensemble, state, settling, first + wp.tid(), w, steps)

    return relax
