"""Tensioner's test rig on the CPU: one a thread, its plunger moved on a sine.

x = x_0 + amplitude sin(2 pi f t), from rest at x_0. The shaker's work is W = -int F dx.
"""

import math

import warp as wp

from ..physics.tensioner import (
    advance_tensioner,
    plunger_losses_at_extension,
    pressure_of_root,
    resting_state,
    tensioner_energy,
    tensioner_force,
    valve_lift,
)
from ..structs import Tensioner, TensionerFlows
from ..sums import add_flows

SAMPLE_COLUMNS = ("extension", "force", "pressure", "valve_lift", "leaked", "supplied")
"""Columns of a tensioner rig's sample; flows since the start."""


@wp.struct
class Ride:
    """Prescribed motion of a tensioner's plunger on the rig."""

    center: wp.float64  # x_0 [m]
    amplitude: wp.float64  # [m]
    step: wp.float64  # h [s]
    cycle: wp.int32  # steps of a cycle
    cycles: wp.int32
    every: wp.int32  # steps between samples; 0: none


@wp.struct
class RideSums:
    """Sums of a plunger's last cycle on the rig."""

    force_min: wp.float64  # [N]
    force_max: wp.float64
    pressure_min: wp.float64  # [Pa]
    pressure_max: wp.float64
    lift_max: wp.float64  # of the valve [m]
    openings: wp.int32  # of the valve
    work: wp.float64  # on the plunger [J]
    flows: TensionerFlows
    damper_loss: wp.float64  # [J]
    suction_work: wp.float64  # on a plunger that its oil would hold back [J]
    gained: wp.float64  # energy stored at its end less that at its beginning [J]
    vapor: wp.float64  # share of it at the vapor pressure


@wp.func
def plunger_position(step: int, ride: Ride):
    """Extension x [m] and rate x' [m/s] of a plunger on the rig at a step."""
    turn = wp.float64(wp.static(2.0 * math.pi)) / wp.float64(ride.cycle)
    angle = turn * wp.float64(step % ride.cycle)
    return ride.center + ride.amplitude * wp.sin(angle), ride.amplitude * turn / ride.step * wp.cos(angle)


@wp.kernel(enable_backward=False)
def shake_plungers(
    rides: wp.array[Ride],
    tensioners: wp.array[Tensioner],
    first: int,
    samples: wp.array3d[wp.float64],
    sums: wp.array[RideSums],
):
    """Shakes tensioners from number `first` on; writes samples (rides, samples, columns) and sums."""
    r = first + wp.tid()
    ride = rides[r]
    tensioner = tensioners[r]
    half = wp.float64(0.5)
    leaked = wp.float64(0.0)
    supplied = wp.float64(0.0)
    total = RideSums()
    x, rate = plunger_position(0, ride)
    state = resting_state(x, tensioner)
    force, pressure = tensioner_force(x, rate, True, state, tensioner)
    lift = wp.float64(0.0)
    steps = ride.cycle * ride.cycles
    i = int(0)
    while i <= steps:
        if ride.every > 0 and i % ride.every == 0:
            at = i // ride.every
            samples[r, at, 0] = x
            samples[r, at, 1] = force
            samples[r, at, 2] = pressure
            samples[r, at, 3] = lift
            samples[r, at, 4] = leaked
            samples[r, at, 5] = supplied
        if i == steps - ride.cycle:
            total.force_min = force
            total.force_max = force
            total.pressure_min = pressure
            total.pressure_max = pressure
            total.gained = -tensioner_energy(x, pressure, state, tensioner)
        if i < steps:
            lost, suction = plunger_losses_at_extension(x, rate, state, tensioner)
            before = x
            pushed = force
            opened = lift
            x, rate = plunger_position(i + 1, ride)
            state, flows = advance_tensioner(x, (x - before) / ride.step, ride.step, True, state, tensioner)
            force, pressure = tensioner_force(x, rate, True, state, tensioner)
            if tensioner.hydraulic == 1:
                lift = valve_lift(tensioner.supply - pressure, tensioner.check)
            leaked += flows.leaked
            supplied += flows.supplied
            if i >= steps - ride.cycle:
                total.force_min = wp.min(total.force_min, force)
                total.force_max = wp.max(total.force_max, force)
                total.pressure_min = wp.min(total.pressure_min, pressure)
                total.pressure_max = wp.max(total.pressure_max, pressure)
                total.lift_max = wp.max(total.lift_max, lift)
                if lift > wp.float64(0.0) and opened <= wp.float64(0.0):
                    total.openings += 1
                total.flows = add_flows(total.flows, flows)
                total.work -= half * (pushed + force) * (x - before)
                after, drawn = plunger_losses_at_extension(x, rate, state, tensioner)
                total.damper_loss += half * ride.step * (lost + after)
                total.suction_work += half * ride.step * (suction + drawn)
                if tensioner.hydraulic == 1 and pressure <= pressure_of_root(tensioner.floor, tensioner) * wp.float64(
                    1.000001
                ):
                    total.vapor += wp.float64(1.0) / wp.float64(ride.cycle)
        i += 1
    total.gained += tensioner_energy(x, pressure, state, tensioner)
    sums[r] = total
