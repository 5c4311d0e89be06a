"""Sums over the window of one variant on the CPU, from an evaluated step, and its energy balance."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..physics.body import (
    arm_dissipation,
    arm_energy,
    arm_mass_moment,
    body_accelerations,
    body_energy,
    heading_of,
    holding_force_and_power,
    late_power,
    pivot_power,
    pose_of,
    wrench_with_force,
)
from ..physics.hub import pivot_force, relative_body
from ..physics.motion import load_moment_at_speed
from ..physics.mount import CARRIED, displacement_from_home
from ..physics.tensioner import extension_and_rate, plunger_losses, tensioner_energy
from ..physics.train import coupling_energy, own_body_energy
from ..physics.valve import cam_energy
from ..structs import Drive, Now, Sums, Wrench, types
from ..sums import (
    MERGE_EVERY,
    add_arm,
    add_bearing,
    add_contact,
    add_energy,
    add_hub_force,
    add_meter,
    add_mount,
    add_powers,
    add_tensioner,
    add_touches,
)
from .body_states import arm_of, body_state_functions
from .carried_arms import arm_carrier, carried_energy
from .chain_sums import chain_sum_functions
from .couplings import coupling_functions
from .hubs import hub_functions
from .joints import joint_functions
from .link_tallies import link_tally_functions
from .loads import load_functions
from .train_sums import train_sum_functions


@dataclass(frozen=True)
class WindowSumFunctions:
    """CPU function that adds one variant's steps to its window's sums."""

    add_step: wp.Function


@cache
def window_sum_functions(Real: type, capacity: int) -> WindowSumFunctions:
    """CPU function that adds steps to the window's sums, for rows of `capacity` values of type `Real`."""
    kinds = types(Real)
    Ensemble, State, Chain = kinds.Ensemble, kinds.State, kinds.Chain
    chain_sums = chain_sum_functions(Real, capacity)
    body_states = body_state_functions(Real)
    couplings = coupling_functions(Real)
    loads = load_functions(Real)
    hubs = hub_functions(Real)
    link_tallies = link_tally_functions(Real, capacity)
    joints = joint_functions(Real, capacity)
    train_sums = train_sum_functions(Real)

    @wp.func(inline=False)  # out of the time loop's one piece, as few steps call it: that compiles faster
    def mechanical_energy(ensemble: Ensemble, state: State, drive: Drive, chain: Chain, w: wp.array[Real], now: Now):
        """Energy [J] of chain, contacts, bodies, tensioners and couplings at an evaluated step."""
        total = link_tallies.rollers_energy(w, drive.rollers, chain, Real(now.lag))
        for p in range(drive.sprockets + drive.guides):
            total += state.totals[drive.first_sprocket + drive.first_guide + p].energy
        for b in range(drive.first_body, drive.first_body + drive.bodies):
            body = body_states.body_now(ensemble, state, b, now.time, now.lag)
            heading = heading_of(body)
            mount = ensemble.mounts[b]
            energy = body_energy(displacement_from_home(body.center, mount), body, heading, ensemble.motions[b], mount)
            arm = arm_of(drive, b)
            if arm >= 0:
                of, turned = ensemble.arms[arm], body
                on = arm_carrier(drive, of.on)
                if on >= 0:
                    carrier = body_states.body_now(ensemble, state, on, now.time, now.lag)
                    turned = relative_body(body, carrier)
                    energy += carried_energy(body, carrier, of)
                energy = arm_energy(energy, turned, heading, of)
            if arm < 0 and (drive.tied != 0 or drive.chains != 1):
                energy = own_body_energy(energy, body.speed, ensemble.motions[b])
            if drive.valves > 0:
                energy += cam_energy(body.speed, state.cams[b], ensemble.motions[b])
            total += energy
        for t in range(drive.first_tensioner, drive.first_tensioner + drive.tensioners):
            push = state.pushes[t]
            total += tensioner_energy(push.extension, push.pressure, state.tensioners[t], ensemble.tensioners[t])
        for c in range(drive.first_coupling, drive.first_coupling + drive.couplings):
            twist, moment = couplings.twist_and_moment(ensemble, state, drive, c)
            total += coupling_energy(twist, ensemble.couplings[c])
        return total

    @wp.func
    def add_sprocket_step(ensemble: Ensemble, state: State, sums: Sums, drive: Drive, s: int, now: Now):
        """Adds a step of sprocket `s` and its mount to the window's sums."""
        i = drive.first_sprocket + s
        b = drive.first_body + s
        motion = ensemble.motions[b]
        mount = ensemble.mounts[b]
        body = body_states.body_now(ensemble, state, b, now.time, now.lag)
        wrench = state.wrenches[b]
        load = load_moment_at_speed(now.time, wrench.load, state.bodies[b].speed, body.speed, motion)
        if ensemble.hubs[i].bearing > wp.float64(0.0):
            power = hubs.bearing_power(ensemble, state, drive, s, now.time, now.lag)
            sums.mount[i] = add_bearing(sums.mount[i], power, now.weight)
        if mount.active == 1:
            whole = loads.body_wrench(ensemble, state, drive, b)
            whole.load = load + whole.bearing
            off = displacement_from_home(body.center, mount)
            heading = heading_of(body)
            rates = body_accelerations(now.time, off, body, heading, whole, motion, mount, ensemble)
            held, power = holding_force_and_power(off, body, heading, whole, rates, motion, mount)
            sums.mount[i] = add_mount(sums.mount[i], off, body.velocity, mount, held, power, now.weight)
        late = late_power(wrench, body, state.poses[b], now.lag, mount.moves == CARRIED)
        sums.sprocket[i] = add_powers(sums.sprocket[i], body.speed, wrench.moment, load, late, now.weight)
        sums.sprocket[i] = add_hub_force(sums.sprocket[i], wrench.force, now.weight)

    @wp.func
    def wrench_with_pivot_forces(
        ensemble: Ensemble, state: State, drive: Drive, a: int, wrench: Wrench, rates: wp.vec3d, now: Now
    ):
        """Wrench on arm `a` with carried arms' forces on their pivots, and its accelerations (`physics.hub`)."""
        for k in range(drive.arms):
            arm = ensemble.arms[drive.first_arm + k]
            if arm.on == a + 1:
                b = drive.first_body + drive.bodies - drive.arms + k
                body = body_states.body_now(ensemble, state, b, now.time, now.lag)
                force = pivot_force(body.speed, state.rates[b][2], arm_mass_moment(heading_of(body), arm))
                wrench = wrench_with_force(wrench, force, wp.float64(0.0))
                rates[2] = state.rates[arm_carrier(drive, arm.on)][2]
        return wrench, rates

    @wp.func
    def add_arm_step(ensemble: Ensemble, state: State, sums: Sums, drive: Drive, a: int, now: Now):
        """Adds a step of arm `a` to the window's sums."""
        b = drive.first_body + drive.bodies - drive.arms + a
        i = drive.first_arm + a
        body = body_states.body_now(ensemble, state, b, now.time, now.lag)
        turned, on = body, arm_carrier(drive, ensemble.arms[i].on)
        if on >= 0:
            turned = relative_body(body, body_states.body_now(ensemble, state, on, now.time, now.lag))
        power = arm_dissipation(turned, ensemble.arms[i])
        led = wp.float64(0.0)
        mount = ensemble.mounts[b]
        if mount.active == 1:
            whole = loads.body_wrench(ensemble, state, drive, b)
            whole.load = loads.body_load(ensemble, state, drive, body, b, now.time) + whole.bearing
            off, motion, heading = displacement_from_home(body.center, mount), ensemble.motions[b], heading_of(body)
            rates = body_accelerations(now.time, off, body, heading, whole, motion, mount, ensemble)
            whole, rates = wrench_with_pivot_forces(ensemble, state, drive, a, whole, rates, now)
            held, led = holding_force_and_power(off, body, heading, whole, rates, motion, mount)
            led = pivot_power(led, body, ensemble.arms[i])
        late = late_power(state.wrenches[b], body, state.poses[b], now.lag, ensemble.mounts[b].moves == CARRIED)
        sums.arm[i] = add_arm(sums.arm[i], body, state.wrenches[b].moment, power, led, late, now.weight)

    @wp.func
    def add_tensioner_step(ensemble: Ensemble, state: State, sums: Sums, drive: Drive, t: int, now: Now):
        """Adds a step of tensioner `t` to the window's sums, and flows at the window's ends."""
        tensioner = ensemble.tensioners[t]
        push = state.pushes[t]
        body = body_states.body_now(ensemble, state, drive.first_body + tensioner.body, now.time, now.lag)
        x, rate = extension_and_rate(pose_of(body), tensioner)
        power, suction = plunger_losses(push, rate, state.tensioners[t], tensioner)
        added = add_tensioner(sums.tensioner[t], push, power, suction, now.weight)
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
        """Adds an evaluated step to the window's sums."""
        n, chain = drive.rollers, ensemble.chains[variant]
        if now.step % MERGE_EVERY == 0 or now.step == drive.window_start:
            chain_sums.merge_and_sample(ensemble, state, sums, variant, drive, w, now.step)
        link_tallies.widen_extremes(w, n)
        share = Real(now.weight / drive.step)
        link_tallies.add_rates(w, n, share)
        if chain.joint.inertia > Real(0.0):
            joints.add_friction_powers(w, n, chain, Real(now.lag), share)
        if now.ends != 0:
            energy = mechanical_energy(ensemble, state, drive, chain, w, now)
            sums.chain[variant] = add_energy(sums.chain[variant], now.step == drive.window_start, energy)
        add_contact_step(state, sums, drive, now)
        for s in range(drive.sprockets):
            add_sprocket_step(ensemble, state, sums, drive, s, now)
        for a in range(drive.arms):
            add_arm_step(ensemble, state, sums, drive, a, now)
        for t in range(drive.first_tensioner, drive.first_tensioner + drive.tensioners):
            add_tensioner_step(ensemble, state, sums, drive, t, now)
        train_sums.add_train_step(ensemble, state, sums, drive, now)

    return WindowSumFunctions(add_step=add_step)
