"""Sums over the window, in float64 or pairs (`number.sum_with`): `add_*` adds one step, `merge_*` another sum."""

from functools import cache
from typing import Any

import warp as wp

from .native import reciprocal
from .number import gathered_sum, rounded_value, sub, sum_with  # noqa: F401
from .structs import ChainSums, ContactSums, Drive, RollerTally, Strand, StrandSums, Totals

MERGE_EVERY = wp.constant(32)
"""Steps after which links' and sprockets' sums are merged into the window's."""


@wp.func
def is_sample_step(drive: Drive, step: int):
    """Whether the window's sums sample the chain at `step`."""
    return step & (drive.sample_interval - 1) == 0 or step == drive.window_start


@wp.func
def previous_index(i: int, n: int):
    """Index of the roller or link before `i` of `n`."""
    return wp.where(i == 0, n - 1, i - 1)


@wp.func
def next_index(i: int, n: int):
    """Index of the roller or link after `i` of `n`, or 0."""
    return wp.where(i + 1 < n, i + 1, 0)


@wp.func
def add_tension(sums: Any, tension: Any):
    """Sums of tension with one link's [N] added."""
    value = wp.float64(tension)
    sums.tension = sums.tension + value
    sums.tension_square = sums.tension_square + value * value
    return sums


@wp.func
def merge_tension(sums: Any, other: Any):
    """Sums of tension with others added."""
    sums.tension = sums.tension + other.tension
    sums.tension_square = sums.tension_square + other.tension_square
    return sums


@wp.func
def merge_extremes(sums: Any, lowest: wp.float64, highest: wp.float64):
    """Sums of tension with extremes widened [N]."""
    sums.tension_min = wp.min(sums.tension_min, lowest)
    sums.tension_max = wp.max(sums.tension_max, highest)
    return sums


@wp.func
def add_energy(sums: Any, start: bool, energy: wp.float64):
    """Chain's or roller's sums with energy [J] at the window's start or end."""
    if start:
        sums.energy_start = sums.energy_start + energy
    else:
        sums.energy_end = sums.energy_end + energy
    return sums


@wp.func
def merge_roller(sums: ChainSums, tally: RollerTally):
    """Chain's sums with one roller's or body's tally added."""
    sums.dissipated = sums.dissipated + tally.dissipated
    sums.friction = sums.friction + tally.friction
    sums.goods_work = sums.goods_work + tally.goods_work
    sums.energy_start = sums.energy_start + tally.energy_start
    sums.energy_end = sums.energy_end + tally.energy_end
    return sums


@wp.func
def add_contact(sums: ContactSums, totals: Totals, weight: wp.float64, stored: wp.float64):
    """Sums of a partner's contacts with one step's forces and dissipation added.

    `weight` is the step's [s], `stored` elastic energy [J] at the window's ends, negative at its start.
    """
    sums.dissipated = sums.dissipated + weight * totals.dissipated - stored
    sums.friction = sums.friction + weight * totals.friction
    sums.impulse = sums.impulse + weight * totals.force
    sums.force_max = wp.max(sums.force_max, totals.force_max)
    return sums


@wp.func
def add_touches(sums: wp.array[ContactSums], at: int, impacts: int, contacts: int, missed: int):
    """Adds impacts, first contacts and missed faces to contact sums at `at`."""
    if impacts != 0:
        sums[at].impacts = sums[at].impacts + impacts
    if contacts != 0:
        sums[at].contacts = sums[at].contacts + contacts
    if missed != 0:
        sums[at].missed = sums[at].missed + missed


@wp.func
def merge_contact(sums: ContactSums, other: ContactSums):
    """Sums of a partner's contacts with others added."""
    sums.force_max = wp.max(sums.force_max, other.force_max)
    sums.impacts = sums.impacts + other.impacts
    sums.friction = sums.friction + other.friction
    sums.contacts = sums.contacts + other.contacts
    sums.missed = sums.missed + other.missed
    sums.impulse = sums.impulse + other.impulse
    sums.dissipated = sums.dissipated + other.dissipated
    return sums


@wp.func
def add_powers(sums: Any, speed: Any, moment: Any, load: Any, late: Any, weight: Any):
    """A sprocket's window sums with speed, contacts' moment and powers added."""
    way = weight * speed
    sums.moment = sum_with(sums.moment, weight * moment)
    sums.contact_work = sum_with(sums.contact_work, way * moment)
    sums.load_work = sum_with(sums.load_work, way * load)
    sums.late_work = sum_with(sums.late_work, weight * late)
    sums.speed_min = wp.min(sums.speed_min, speed)
    sums.speed_max = wp.max(sums.speed_max, speed)
    sums.speed = sum_with(sums.speed, way)
    sums.speed_square = sum_with(sums.speed_square, way * speed)
    return sums


@wp.func
def gathered_sprocket_sums(sums: Any):
    """A sprocket's window sums with recent additions in pairs."""
    sums.moment = gathered_sum(sums.moment)
    sums.contact_work = gathered_sum(sums.contact_work)
    sums.load_work = gathered_sum(sums.load_work)
    sums.late_work = gathered_sum(sums.late_work)
    return sums


@wp.func
def note_sprocket(note: Any, sums: Any):
    """A batch's note of a sprocket's sums."""
    note.speed = sums.speed
    note.moment = gathered_sum(sums.moment)
    note.force = sums.force
    return note


@wp.func
def note_mount(note: Any, sums: Any):
    """A batch's note of a mount's sums."""
    note.travel = sums.travel
    note.force = sums.force
    return note


@wp.func
def add_hub_force(sums: Any, force: Any, weight: Any):
    """A mount's window sums with the chain's force added."""
    sums.force = sum_with(sums.force, weight * force)
    sums.force_max = wp.max(sums.force_max, wp.length(force))
    return sums


@wp.func
def add_mount(sums: Any, apart: Any, velocity: Any, mount: Any, held: Any, power: Any, weight: Any):
    """A mount's window sums with displacement [m], force [N] and powers added."""
    sums.travel = sum_with(sums.travel, weight * apart)
    sums.travel_max = wp.max(sums.travel_max, wp.length(apart))
    sums.force = sum_with(sums.force, weight * wp.length(held))
    sums.dissipated = sum_with(sums.dissipated, weight * wp.dot(velocity, mount.damping * velocity))
    sums.work = sum_with(sums.work, weight * power)
    return sums


@wp.func
def add_bearing(sums: Any, power: Any, weight: Any):
    """A mount's window sums with power of bearing friction added."""
    sums.friction = sum_with(sums.friction, weight * power)
    return sums


@wp.func
def add_arm(sums: Any, body: Any, moment: Any, power: Any, led: Any, late: Any, weight: Any):
    """An arm's window sums with angle, contacts' moment and powers added."""
    sums.angle_min = wp.min(sums.angle_min, body.angle)
    sums.angle_max = wp.max(sums.angle_max, body.angle)
    sums.angle = sum_with(sums.angle, weight * body.angle)
    sums.angle_square = sum_with(sums.angle_square, weight * body.angle * body.angle)
    sums.moment = sum_with(sums.moment, weight * moment)
    sums.dissipated = sum_with(sums.dissipated, weight * power)
    sums.work = sum_with(sums.work, weight * led)
    sums.late_work = sum_with(sums.late_work, weight * late)
    return sums


@wp.func
def add_shaft(sums: Any, speed: Any, motor: Any, load: Any, weight: Any):
    """A shaft's window sums with speed, motor's and load's moments added."""
    way = weight * speed
    sums.speed_min = wp.min(sums.speed_min, speed)
    sums.speed_max = wp.max(sums.speed_max, speed)
    sums.speed = sum_with(sums.speed, way)
    sums.speed_square = sum_with(sums.speed_square, way * speed)
    sums.motor = sum_with(sums.motor, weight * motor)
    sums.motor_max = wp.max(sums.motor_max, wp.abs(motor))
    sums.motor_work = sum_with(sums.motor_work, way * motor)
    sums.load_work = sum_with(sums.load_work, way * load)
    return sums


@wp.func
def add_coupling(sums: Any, twist: Any, moment: Any, power: Any, led: Any, lost: Any, weight: Any):
    """A coupling's window sums with twist, moment, powers and slip's loss added."""
    sums.twist_min = wp.min(sums.twist_min, twist)
    sums.twist_max = wp.max(sums.twist_max, twist)
    sums.twist = sum_with(sums.twist, weight * twist)
    sums.moment_min = wp.min(sums.moment_min, moment)
    sums.moment_max = wp.max(sums.moment_max, moment)
    sums.moment = sum_with(sums.moment, weight * moment)
    sums.dissipated = sum_with(sums.dissipated, weight * power)
    sums.slip_loss = sum_with(sums.slip_loss, lost)
    sums.led_work = sum_with(sums.led_work, weight * led)
    return sums


@wp.func
def add_gear(sums: Any, moment: Any, force: Any, weight: Any):
    """A gear pair's window sums with moment and tooth force added."""
    sums.moment = sum_with(sums.moment, weight * moment)
    sums.force = sum_with(sums.force, weight * force)
    sums.force_max = wp.max(sums.force_max, force)
    return sums


@wp.func
def add_valve(sums: Any, torque: Any, force: Any, weight: Any):
    """A valve group's window sums with torque and least force added."""
    sums.torque_min = wp.min(sums.torque_min, torque)
    sums.torque_max = wp.max(sums.torque_max, torque)
    sums.torque = sum_with(sums.torque, weight * torque)
    sums.force_min = wp.min(sums.force_min, force)
    sums.afloat = sum_with(sums.afloat, wp.where(force < type(force)(0.0), weight, type(weight)(0.0)))
    return sums


@wp.func
def add_flows(total: Any, flows: Any):
    """A tensioner's total flows with one more step's added."""
    total.leaked = sum_with(total.leaked, flows.leaked)
    total.supplied = sum_with(total.supplied, flows.supplied)
    total.relieved = sum_with(total.relieved, flows.relieved)
    total.vented = sum_with(total.vented, flows.vented)
    total.leak_loss = sum_with(total.leak_loss, flows.leak_loss)
    total.valve_loss = sum_with(total.valve_loss, flows.valve_loss)
    total.supply_work = sum_with(total.supply_work, flows.supply_work)
    total.filling = sum_with(total.filling, flows.filling)
    total.unfilled = flows.unfilled
    return total


@wp.func
def flows_since(now: Any, start: Any):
    """A tensioner's flows since `start`; filling counts from the run's."""
    now.leaked = now.leaked - start.leaked
    now.supplied = now.supplied - start.supplied
    now.relieved = now.relieved - start.relieved
    now.vented = now.vented - start.vented
    now.leak_loss = now.leak_loss - start.leak_loss
    now.valve_loss = now.valve_loss - start.valve_loss
    now.supply_work = now.supply_work - start.supply_work
    return now


@wp.func
def add_tensioner(sums: Any, push: Any, power: Any, suction: Any, weight: Any):
    """A tensioner's window sums with force, pressure, extension and powers added."""
    x = rounded_value(push.extension)
    sums.force_min = wp.min(sums.force_min, push.force)
    sums.force_max = wp.max(sums.force_max, push.force)
    sums.force = sum_with(sums.force, weight * push.force)
    sums.pressure_min = wp.min(sums.pressure_min, push.pressure)
    sums.pressure_max = wp.max(sums.pressure_max, push.pressure)
    sums.pressure = sum_with(sums.pressure, weight * push.pressure)
    sums.extension_min = wp.min(sums.extension_min, x)
    sums.extension_max = wp.max(sums.extension_max, x)
    sums.extension = sum_with(sums.extension, weight * x)
    sums.dissipated = sum_with(sums.dissipated, weight * power)
    sums.suction_work = sum_with(sums.suction_work, weight * suction)
    return sums


@wp.func
def add_meter(sums: Any, meter: Any, start: bool, end: bool):
    """A tensioner's window sums with flows between the window's ends."""
    if start:
        sums.flows = meter
    if end:
        sums.flows = flows_since(meter, sums.flows)
    return sums


@wp.func
def add_displacement(sums: StrandSums, displacement: wp.float64):
    """A strand's window sums with a mid-strand displacement [m]."""
    sums.samples = sums.samples + wp.int64(1)
    sums.displacement_min = wp.min(sums.displacement_min, displacement)
    sums.displacement_max = wp.max(sums.displacement_max, displacement)
    sums.displacement = sums.displacement + displacement
    sums.displacement_square = sums.displacement_square + displacement * displacement
    return sums


@wp.func
def coordinate_along(x: wp.float64, y: wp.float64, strand: Strand):
    """Coordinate [m] along a strand's nominal line."""
    return (x - strand.start[0]) * strand.direction[0] + (y - strand.start[1]) * strand.direction[1]


@wp.func
def distance_left(x: wp.float64, y: wp.float64, strand: Strand):
    """Distance [m] to the left of a strand's line."""
    return (y - strand.start[1]) * strand.direction[0] - (x - strand.start[0]) * strand.direction[1]


@wp.func
def mid_strand_displacement(ax: wp.float64, ay: wp.float64, bx: wp.float64, by: wp.float64, strand: Strand):
    """Transverse displacement [m] of the chain mid-strand, left positive."""
    a = coordinate_along(ax, ay, strand)
    b = coordinate_along(bx, by, strand)
    part = (wp.float64(0.5) * strand.length - a) * reciprocal(b - a)
    return distance_left(ax, ay, strand) * (wp.float64(1.0) - part) + distance_left(bx, by, strand) * part


@cache
def strand_follower(Real: type) -> wp.Function:
    """Warp function that updates a strand's links, at type `Real`."""

    @wp.func
    def roller_coordinate(rollers: wp.array[Real], x: int, y: int, i: int, strand: Strand):
        """Coordinate [m] of roller `i` along a strand."""
        return coordinate_along(wp.float64(rollers[x + i]), wp.float64(rollers[y + i]), strand)

    @wp.func
    def roller_distance(rollers: wp.array[Real], x: int, y: int, i: int, strand: Strand):
        """Distance [m] of roller `i` from a strand."""
        return wp.abs(distance_left(wp.float64(rollers[x + i]), wp.float64(rollers[y + i]), strand))

    @wp.func
    def last_roller_before(rollers: wp.array[Real], x: int, y: int, n: int, i: int, limit: wp.float64, strand: Strand):
        """Last roller not past `limit` [m] along a strand, from `i` on."""
        tries = int(0)
        while roller_coordinate(rollers, x, y, i, strand) > limit and tries < n:
            i = previous_index(i, n)
            tries = tries + 1
        tries = int(0)
        while roller_coordinate(rollers, x, y, next_index(i, n), strand) <= limit and tries < n:
            i = next_index(i, n)
            tries = tries + 1
        return i

    @wp.func
    def mid_crossing(rollers: wp.array[Real], x: int, y: int, n: int, strand: Strand):
        """Last roller not past mid-strand, nearest to the strand's line."""
        limit = wp.float64(0.5) * strand.length
        found = strand.middle
        nearest = wp.float64(wp.inf)
        i = int(0)
        while i < n and nearest > wp.float64(0.0):
            j = next_index(i, n)
            if (
                roller_coordinate(rollers, x, y, i, strand) <= limit
                and roller_coordinate(rollers, x, y, j, strand) > limit
            ):
                apart = roller_distance(rollers, x, y, i, strand) + roller_distance(rollers, x, y, j, strand)
                if apart < nearest:
                    nearest = apart
                    found = i
            i = i + 1
        return found

    @wp.func
    def follow_strand(rollers: wp.array[Real], x: int, y: int, n: int, strand: Strand, anew: bool):
        """A strand with its middle and links updated, or searched `anew`.

        Roller i's coordinates are `rollers[x + i]` and `rollers[y + i]`.
        """
        middle = strand.middle
        if anew:
            middle = mid_crossing(rollers, x, y, n, strand)
        middle = last_roller_before(rollers, x, y, n, middle, wp.float64(0.5) * strand.length, strand)
        first = middle
        last = middle
        if strand.links > 0 and not anew:
            first = strand.first_link
            last = (first + strand.links) % n
        first = next_index(last_roller_before(rollers, x, y, n, previous_index(first, n), wp.float64(0.0), strand), n)
        last = last_roller_before(rollers, x, y, n, last, strand.length, strand)
        if strand.end != 0:
            first = wp.where(strand.end & 1 != 0, 0, first)
            last = wp.where(strand.end & 2 != 0, n - 1, last)
            last = wp.where(strand.end & 4 != 0, first, wp.max(first, last))
            middle = wp.clamp(middle, first, wp.max(first, last - 1))
        strand.middle = middle
        strand.first_link = first
        strand.links = (last - first + n) % n
        return strand

    return follow_strand
