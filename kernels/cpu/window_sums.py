"""Sums over the window of one variant on the CPU, by evaluated steps, and its energy balance."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..bodies.tensioners import tensioner_sums
from ..physics.tensioner import tensioner_energy
from ..physics.train import coupling_energy
from ..structs import Drive, Now, Sums, types
from ..sums import MERGE_EVERY, add_contact, add_energy, add_meter, add_touches
from . import body_states, body_sums, couplings, train_sums
from .chain_sums import chain_sum_functions
from .joints import joint_functions
from .link_tallies import link_tally_functions
from .strand_loads import strand_load_functions


@dataclass(frozen=True)
class WindowSumFunctions:
    """CPU window sum function."""

    add_step: wp.Function


@cache
def window_sum_functions(Real: type, capacity: int) -> WindowSumFunctions:
    """CPU window sum function."""
    kinds = types(Real)
    Ensemble, State, Chain = kinds.Ensemble, kinds.State, kinds.Chain
    chain_sums = chain_sum_functions(Real, capacity)
    link_tallies = link_tally_functions(Real, capacity)
    joints = joint_functions(Real, capacity)
    strand_loads = strand_load_functions(Real, capacity)

    @wp.func(inline=False)  # out of the time loop's one piece, as few steps call it: that compiles faster
    def mechanical_energy(ensemble: Ensemble, state: State, drive: Drive, chain: Chain, w: wp.array[Real], now: Now):
        """Energy [J] of chain, contacts, bodies, tensioners and couplings at a step."""
        total = link_tallies.rollers_energy(w, drive.rollers, chain, Real(now.lag))
        for p in range(drive.sprockets + drive.guides):
            total += state.totals[drive.first_sprocket + drive.first_guide + p].energy
        for b in range(drive.first_body, drive.first_body + drive.bodies):
            total += body_sums.body_energy_now(ensemble, state, drive, b, now)
        for t in range(drive.first_tensioner, drive.first_tensioner + drive.tensioners):
            push = state.pushes[t]
            total += tensioner_energy(push.extension, push.pressure, state.tensioners[t], ensemble.tensioners[t])
        for c in range(drive.first_coupling, drive.first_coupling + drive.couplings):
            twist, moment = couplings.twist_and_moment(ensemble, state, drive, c)
            total += coupling_energy(twist, ensemble.couplings[c])
        return total

    @wp.func
    def add_tensioner_step(ensemble: Ensemble, state: State, sums: Sums, drive: Drive, t: int, now: Now):
        """Adds a step of tensioner `t` to the window's sums, flows at its ends, on the CPU."""
        tensioner = ensemble.tensioners[t]
        b = drive.first_body + tensioner.body
        seen = body_states.body_now(ensemble, state, b, now.time, now.lag)
        added = tensioner_sums(sums.tensioner[t], state.poses[b], seen, state, t, tensioner, now.weight)
        starts, ends = now.step == drive.window_start, now.step == drive.window_end
        sums.tensioner[t] = add_meter(added, state.meters[t], starts, ends)

    @wp.func
    def add_contact_step(state: State, sums: Sums, drive: Drive, now: Now):
        """Adds the contacts of an evaluated step to the window's sums."""
        first = drive.first_sprocket + drive.first_guide
        for i in range(first, first + drive.sprockets + drive.guides):
            of = state.totals[i]
            stored = wp.where(drive.integrator == 0, of.energy, wp.float64(0.0))
            stored = wp.where(now.step == drive.window_start, -stored, stored)
            sums.contact[i] = add_contact(sums.contact[i], of, now.weight, stored)
            missed = wp.where(now.step == drive.window_start, of.missing, of.missed)
            add_touches(sums.contact, i, of.impacts, of.contacts, missed)

    @wp.func
    def add_step(
        ensemble: Ensemble,
        state: State,
        sums: Sums,
        variant: int,
        drive: Drive,
        w: wp.array[Real],
        now: Now,
    ):
        """Adds an evaluated step of a variant to the window's sums, on the CPU."""
        n, chain = drive.rollers, ensemble.chains[variant]
        if now.step % MERGE_EVERY == 0 or now.step == drive.window_start:
            chain_sums.merge_and_sample(ensemble, state, sums, variant, drive, w, now.step)
        link_tallies.widen_extremes(w, n)
        share = Real(now.weight / drive.step)
        link_tallies.add_rates(w, n, share)
        if chain.joint.inertia > Real(0.0):
            joints.add_friction_powers(w, n, chain, Real(now.lag), share)
        if chain.load.relative_mass > Real(0.0):
            power = strand_loads.power_of_goods(w, n, chain, Real(drive.step), Real(now.lag))
            sums.chain[variant].goods_work = sums.chain[variant].goods_work + now.weight * power
        if now.ends != 0:
            energy = mechanical_energy(ensemble, state, drive, chain, w, now)
            sums.chain[variant] = add_energy(sums.chain[variant], now.step == drive.window_start, energy)
        add_contact_step(state, sums, drive, now)
        for s in range(drive.sprockets):
            body_sums.add_sprocket_step(ensemble, state, sums, drive, s, now)
        for a in range(drive.arms):
            body_sums.add_arm_step(ensemble, state, sums, drive, a, now)
        for t in range(drive.first_tensioner, drive.first_tensioner + drive.tensioners):
            add_tensioner_step(ensemble, state, sums, drive, t, now)
        train_sums.add_train_step(ensemble, state, sums, drive, now)

    return WindowSumFunctions(add_step=add_step)
