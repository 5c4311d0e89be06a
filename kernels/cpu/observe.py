"""Observation of an evaluated step: sums of the window, the energy balance, and frames.

What few steps come to is kept out of the time loop's one piece (`inline=False`), which compiles sooner then.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from ..frames import frame_writers
from ..integrate import leapfrog_lag
from ..native import accessors
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
)
from ..physics.hub import pivot_force, relative_body
from ..physics.motion import load_moment_at_speed
from ..physics.mount import CARRIED, displacement_from_home
from ..physics.tensioner import extension_and_rate, plunger_losses, tensioner_energy
from ..physics.train import coupling_energy, coupling_loss, is_on_gear_side, own_body_energy
from ..physics.valve import cam_energy
from ..structs import Drive, Now, Sums, Wrench, types
from ..sums import (
    MERGE_EVERY,
    add_arm,
    add_bearing,
    add_contact,
    add_coupling,
    add_energy,
    add_gear,
    add_hub_force,
    add_meter,
    add_mount,
    add_powers,
    add_shaft,
    add_tensioner,
    add_touches,
    add_valve,
)
from .chain_sums import chain_sums
from .contact_pairs import with_reaction
from .jointed import carrier_of, joint_energy
from .joints import joint_passes
from .rollers import passes, rows
from .steps import arm_of, moving


@wp.func
def now_at(drive: Drive, step: int):
    """Step `step`, and what is wanted of it as it begins."""
    now = Now()
    now.step = step
    now.time = wp.float64(step) * drive.step
    if drive.integrator == 0:
        now.lag = leapfrog_lag(step, drive.step)
    now.weight = drive.step
    if step >= drive.window_start and step <= drive.window_end:
        now.measures = 1
        now.ends = wp.where(step == drive.window_start or step == drive.window_end, 1, 0)
    if now.ends != 0:
        now.weight = wp.float64(0.5) * now.weight
    if drive.sample_every > 0:
        now.sizes = wp.where(step % drive.sample_every == 0, 1, 0)
    return now


@cache
def measuring_trains(Real: type) -> SimpleNamespace:
    """The functions that add shafts, couplings, gears and valves of one variant to the sums of the window."""
    kinds, bodies = types(Real), moving(Real)
    Ensemble, State, body_now = kinds.Ensemble, kinds.State, bodies.body_now

    @wp.func
    def add_shaft_body(ensemble: Ensemble, state: State, sums: Sums, drive: Drive, h: int, now: Now):
        """Adds shaft h of the drive to the sums of the window."""
        b, i = drive.first_body + drive.sprockets + h, drive.first_shaft + h
        body = body_now(ensemble, state, b, now.time, now.lag)
        before = state.bodies[b].speed
        load = load_moment_at_speed(now.time, state.wrenches[b].load, before, body.speed, ensemble.motions[b])
        motor = bodies.motor_on(ensemble, state, drive, b, now.time)
        sums.shaft[i] = add_shaft(sums.shaft[i], body.speed, motor, load, now.weight)

    @wp.func
    def add_twist(ensemble: Ensemble, state: State, sums: Sums, drive: Drive, c: int, now: Now):
        """Adds coupling c of all to the sums of the window."""
        coupling, engaged = ensemble.couplings[c], state.couplings[c]
        twist, rate, moment = bodies.coupled_now(ensemble, state, drive, c, now.time, now.lag)
        led = wp.float64(0.0)
        for second in range(2):
            b = drive.first_body + wp.where(second == 0, coupling.first, coupling.second)
            if ensemble.motions[b].prescribed == 1:
                speed = body_now(ensemble, state, b, now.time, now.lag).speed
                led = led + wp.where(second == 0, -moment, engaged.ratio * moment) * speed
        power = coupling_loss(twist, rate, coupling, engaged)
        lost = wp.where(now.step == drive.window_start, wp.float64(0.0), engaged.lost)
        sums.coupling[c] = add_coupling(sums.coupling[c], twist, moment, power, led, lost, now.weight)

    @wp.func
    def add_teeth(ensemble: Ensemble, state: State, sums: Sums, drive: Drive, g: int, now: Now):
        """Adds the pair of gears g of all to the sums of the window."""
        gear = ensemble.gears[g]
        at = drive.first_body + gear.body
        mine = ensemble.motions[at]
        moment = gear.inertia * bodies.angular_now(ensemble, state, at, now.time)
        for b in range(drive.sprockets + drive.shafts):
            if is_on_gear_side(gear, b):
                other = drive.first_body + b
                moment = moment - ensemble.motions[other].ratio / mine.ratio * state.passed[other]
        for v in range(drive.first_valve, drive.first_valve + drive.valves):
            valve = ensemble.valves[v]
            if is_on_gear_side(gear, valve.body):
                torque, force = bodies.lifted(ensemble, state, drive, v, now.time, now.lag)
                beside = ensemble.motions[drive.first_body + valve.body].ratio / mine.ratio
                moment = moment + beside * valve.sign * torque
        sums.gear[g] = add_gear(sums.gear[g], moment, wp.abs(moment) / gear.lever, now.weight)

    @wp.func
    def add_valves(ensemble: Ensemble, state: State, sums: Sums, drive: Drive, v: int, now: Now):
        """Adds group v of all valves to the sums of the window."""
        torque, force = bodies.lifted(ensemble, state, drive, v, now.time, now.lag)
        sums.valve[v] = add_valve(sums.valve[v], torque, force, now.weight)

    @wp.func
    def add_trains(ensemble: Ensemble, state: State, sums: Sums, drive: Drive, now: Now):
        """Adds shafts, couplings, gears and valves to the sums of the window."""
        for h in range(drive.shafts):
            add_shaft_body(ensemble, state, sums, drive, h, now)
        for c in range(drive.first_coupling, drive.first_coupling + drive.couplings):
            add_twist(ensemble, state, sums, drive, c, now)
        for g in range(drive.first_gear, drive.first_gear + drive.gears):
            add_teeth(ensemble, state, sums, drive, g, now)
        for v in range(drive.first_valve, drive.first_valve + drive.valves):
            add_valves(ensemble, state, sums, drive, v, now)

    return SimpleNamespace(**locals())


@cache
def measuring(Real: type, capacity: int) -> SimpleNamespace:
    """The functions that add evaluated steps of one variant to the sums of the window."""
    kinds, sums_of, bodies = types(Real), chain_sums(Real, capacity), moving(Real)
    Ensemble, State, Chain = kinds.Ensemble, kinds.State, kinds.Chain
    add_friction, body_now = joint_passes(Real, capacity).add_friction, bodies.body_now
    add_trains = measuring_trains(Real).add_trains

    @wp.func(inline=False)
    def mechanical_energy(ensemble: Ensemble, state: State, drive: Drive, chain: Chain, w: wp.array[Real], now: Now):
        """Energy of chain, contacts, free sprockets and mounts at an evaluated step [J]."""
        total = sums_of.energy(w, drive.rollers, chain, Real(now.lag))
        for p in range(drive.sprockets + drive.guides):
            total += state.totals[drive.first_sprocket + drive.first_guide + p].energy
        for b in range(drive.first_body, drive.first_body + drive.bodies):
            body = body_now(ensemble, state, b, now.time, now.lag)
            heading = heading_of(body)
            mount = ensemble.mounts[b]
            energy = body_energy(displacement_from_home(body.center, mount), body, heading, ensemble.motions[b], mount)
            arm = arm_of(drive, b)
            if arm >= 0:
                of, turned = ensemble.arms[arm], body
                on = carrier_of(drive, of.on)
                if on >= 0:
                    carrier = body_now(ensemble, state, on, now.time, now.lag)
                    turned = relative_body(body, carrier)
                    energy += joint_energy(body, carrier, of)
                energy = arm_energy(energy, turned, heading, of)
            if arm < 0 and (drive.tied != 0 or drive.rings != 1):
                energy = own_body_energy(energy, body.speed, ensemble.motions[b])
            if drive.valves > 0:
                energy += cam_energy(body.speed, state.cams[b], ensemble.motions[b])
            total += energy
        for t in range(drive.first_tensioner, drive.first_tensioner + drive.tensioners):
            push = state.pushes[t]
            total += tensioner_energy(push.extension, push.pressure, state.tensioners[t], ensemble.tensioners[t])
        for c in range(drive.first_coupling, drive.first_coupling + drive.couplings):
            twist, moment = bodies.coupled(ensemble, state, drive, c)
            total += coupling_energy(twist, ensemble.couplings[c])
        return total

    @wp.func
    def add_body(ensemble: Ensemble, state: State, sums: Sums, drive: Drive, s: int, now: Now):
        """Adds sprocket s, with its mount, to the sums of the window."""
        i = drive.first_sprocket + s
        b = drive.first_body + s
        motion = ensemble.motions[b]
        mount = ensemble.mounts[b]
        body = body_now(ensemble, state, b, now.time, now.lag)
        wrench = state.wrenches[b]
        load = load_moment_at_speed(now.time, wrench.load, state.bodies[b].speed, body.speed, motion)
        if ensemble.hubs[i].bearing > wp.float64(0.0):
            power = bodies.bearing_power(ensemble, state, drive, s, now.time, now.lag)
            sums.mount[i] = add_bearing(sums.mount[i], power, now.weight)
        if mount.active == 1:
            whole = bodies.wrench_on(ensemble, state, drive, b)
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
    def with_turning(ensemble: Ensemble, state: State, drive: Drive, a: int, wrench: Wrench, rates: wp.vec3d, now: Now):
        """The wrench on arm a of the drive with what arms on it leave on their pivots, and its accelerations with
        them (`physics.hub`, (b) and (c)).
        """
        for k in range(drive.arms):
            arm = ensemble.arms[drive.first_arm + k]
            if arm.on == a + 1:
                b = drive.first_body + drive.bodies - drive.arms + k
                body = body_now(ensemble, state, b, now.time, now.lag)
                force = pivot_force(body.speed, state.rates[b][2], arm_mass_moment(heading_of(body), arm))
                wrench = with_reaction(wrench, force, wp.float64(0.0))
                rates[2] = state.rates[carrier_of(drive, arm.on)][2]
        return wrench, rates

    @wp.func
    def add_arm_body(ensemble: Ensemble, state: State, sums: Sums, drive: Drive, a: int, now: Now):
        """Adds arm a of the drive to the sums of the window."""
        b = drive.first_body + drive.bodies - drive.arms + a
        i = drive.first_arm + a
        body = body_now(ensemble, state, b, now.time, now.lag)
        turned, on = body, carrier_of(drive, ensemble.arms[i].on)
        if on >= 0:
            turned = relative_body(body, body_now(ensemble, state, on, now.time, now.lag))
        power = arm_dissipation(turned, ensemble.arms[i])
        led = wp.float64(0.0)
        mount = ensemble.mounts[b]
        if mount.active == 1:
            whole = bodies.wrench_on(ensemble, state, drive, b)
            whole.load = bodies.load_on(ensemble, state, drive, body, b, now.time) + whole.bearing
            off, motion, heading = displacement_from_home(body.center, mount), ensemble.motions[b], heading_of(body)
            rates = body_accelerations(now.time, off, body, heading, whole, motion, mount, ensemble)
            whole, rates = with_turning(ensemble, state, drive, a, whole, rates, now)
            held, led = holding_force_and_power(off, body, heading, whole, rates, motion, mount)
            led = pivot_power(led, body, ensemble.arms[i])
        late = late_power(state.wrenches[b], body, state.poses[b], now.lag, ensemble.mounts[b].moves == CARRIED)
        sums.arm[i] = add_arm(sums.arm[i], body, state.wrenches[b].moment, power, led, late, now.weight)

    @wp.func
    def add_push(ensemble: Ensemble, state: State, sums: Sums, drive: Drive, t: int, now: Now):
        """Adds tensioner t of all to the sums of the window, and at its ends what its meter says."""
        tensioner = ensemble.tensioners[t]
        push = state.pushes[t]
        body = body_now(ensemble, state, drive.first_body + tensioner.body, now.time, now.lag)
        x, rate = extension_and_rate(pose_of(body), tensioner)
        power, suction = plunger_losses(push, rate, state.tensioners[t], tensioner)
        added = add_tensioner(sums.tensioner[t], push, power, suction, now.weight)
        starts, ends = now.step == drive.window_start, now.step == drive.window_end
        sums.tensioner[t] = add_meter(added, state.meters[t], starts, ends)

    @wp.func
    def measure_contacts(state: State, sums: Sums, drive: Drive, now: Now):
        """Adds the contacts of an evaluated step to the sums of the window."""
        first = drive.first_sprocket + drive.first_guide
        for i in range(first, first + drive.sprockets + drive.guides):
            of = state.totals[i]
            stored = wp.where(drive.integrator == 0, of.energy, wp.float64(0.0))
            stored = wp.where(now.step == drive.window_start, -stored, stored)
            sums.contact[i] = add_contact(sums.contact[i], of, now.weight, stored)
            missed = wp.where(now.step == drive.window_start, of.missing, of.missed)
            add_touches(sums.contact, i, of.impacts, of.contacts, missed)

    @wp.func
    def measure(
        ensemble: Ensemble,
        state: State,
        sums: Sums,
        variant: int,
        drive: Drive,
        w: wp.array[Real],
        now: Now,
    ):
        """Adds an evaluated step to the sums of the window."""
        n, chain = drive.rollers, ensemble.chains[variant]
        if now.step % MERGE_EVERY == 0 or now.step == drive.window_start:
            sums_of.gather(ensemble, state, sums, variant, drive, w, now.step)
        sums_of.widen(w, n)
        share = Real(now.weight / drive.step)
        sums_of.add_rates(w, n, share)
        if chain.joint.inertia > Real(0.0):
            add_friction(w, n, chain, Real(now.lag), share)
        if now.ends != 0:
            energy = mechanical_energy(ensemble, state, drive, chain, w, now)
            sums.chain[variant] = add_energy(sums.chain[variant], now.step == drive.window_start, energy)
        measure_contacts(state, sums, drive, now)
        for s in range(drive.sprockets):
            add_body(ensemble, state, sums, drive, s, now)
        for a in range(drive.arms):
            add_arm_body(ensemble, state, sums, drive, a, now)
        for t in range(drive.first_tensioner, drive.first_tensioner + drive.tensioners):
            add_push(ensemble, state, sums, drive, t, now)
        add_trains(ensemble, state, sums, drive, now)

    clear, merge = sums_of.clear, sums_of.merge
    return SimpleNamespace(**locals())


@cache
def sampling(Real: type, capacity: int, frame: Any) -> SimpleNamespace:
    """The functions that write frames of one variant, which lie as `frame` says (`frames.frame_writers`)."""
    kinds = types(Real)
    vec2, load_row, row = kinds.vec2, accessors(Real).load_row, rows(capacity)
    acceleration, joint_power = passes(Real, capacity).acceleration, joint_passes(Real, capacity).joint_power
    body_now, coupled = moving(Real).body_now, moving(Real).coupled_now
    lifted = moving(Real).lifted
    write = frame_writers(Real, frame)

    @wp.func
    def seen(w: wp.array[Real], i: int):
        """Forces of roller i and its link for a frame."""
        of = kinds.Extra()
        of.tension = load_row(w, row.tension + i)
        of.rate = load_row(w, row.rate + i)
        of.sprocket_force = load_row(w, row.sprocket_force + i)
        of.guide_force = load_row(w, row.guide_force + i)
        return of

    @wp.func(inline=False)
    def sample(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        variant: int,
        drive: Drive,
        w: wp.array[Real],
        frames: wp.array[Real],
        number: int,
        now: Now,
    ):
        """Writes the chain's frame of this number in the launch."""
        n = drive.rollers
        begin = int(drive.first_value + wp.int64(number) * wp.int64(write.width_of(drive)))
        lag = Real(now.lag)
        chain = ensemble.chains[variant]
        inverse_mass = chain.inverse_mass
        for i in range(n):
            a = acceleration(w, i, inverse_mass, chain.gravity)
            position = vec2(load_row(w, row.x + i), load_row(w, row.y + i))
            velocity = vec2(load_row(w, row.vx + i) + lag * a[0], load_row(w, row.vy + i) + lag * a[1])
            extra = seen(w, i)
            if wp.static(frame.holds("joint_friction_power")):
                if chain.joint.inertia > Real(0.0):
                    extra.friction_power = joint_power(w, i, n, chain, lag)
            write.write_roller(frames, begin, n, i, position, velocity, extra)
        for s in range(drive.sprockets):
            b = drive.first_body + s
            body = body_now(ensemble, state, b, now.time, now.lag)
            write.write_sprocket(frames, begin, n, s, body, state.wrenches[b].moment, state.wrenches[b].force)
        for a in range(drive.arms):
            b = drive.first_body + drive.bodies - drive.arms + a
            arm = body_now(ensemble, state, b, now.time, now.lag)
            write.write_arm(frames, begin, drive, a, arm, state.wrenches[b].moment)
        for t in range(drive.tensioners):
            write.write_tensioner(frames, begin, drive, t, state.pushes[drive.first_tensioner + t])
        for h in range(drive.shafts):
            shaft = body_now(ensemble, state, drive.first_body + drive.sprockets + h, now.time, now.lag)
            write.write_shaft(frames, begin, drive, h, shaft)
        for c in range(drive.couplings):
            twist, rate, moment = coupled(ensemble, state, drive, drive.first_coupling + c, now.time, now.lag)
            write.write_coupling(frames, begin, drive, c, twist, moment)
        for v in range(drive.valves):
            torque, force = lifted(ensemble, state, drive, drive.first_valve + v, now.time, now.lag)
            write.write_valve(frames, begin, drive, v, torque, force)

    return SimpleNamespace(**locals())
