"""Contacts of a silent chain's toes with the teeth of one wheel, for the pins that have seats there (`physics.toe`).

A pin has four contacts, with the flank ends of its two links.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..native import products, row_access
from ..physics.contact import AWAY, memory_after_teeth, relative_acceleration
from ..physics.toe import ENDS, point_mobility, seated_toe_contact, toe_contact
from ..structs import Drive, Pose, types
from .contact_rows import contact_row_functions
from .neighbor_list import Group, lowest_bit, without_lowest_bit
from .rollers import roller_functions, rows


@dataclass(frozen=True)
class ToeFunctions:
    """CPU functions of toes' contacts with one wheel."""

    fetch_pushes: wp.Function
    put_back_pushes: wp.Function
    find_link_motions: wp.Function
    find_motions: wp.Function  # of contacts of links after pins
    find_contacts: tuple[wp.Function, ...]  # of each of a pin's flank ends (`physics.toe.ENDS`)


@cache
def toe_functions(Real: type, capacity: int) -> ToeFunctions:
    """CPU functions of contacts with wheel teeth, for rows of `capacity` values of type `Real`."""
    kinds = types(Real)
    Chain, Memory, Plate, Sprocket, State = kinds.Chain, kinds.Memory, kinds.Plate, kinds.Sprocket, kinds.State
    vec2 = kinds.vec2
    row = rows(capacity)
    rollers = roller_functions(Real, capacity)
    contact_rows = contact_row_functions(Real, capacity)
    access = row_access(Real)

    @wp.func
    def fetch_pushes(state: State, drive: Drive, w: wp.array[Real]):
        """Copies v0 and forces of the step before from the state to their rows, at a launch's begin."""
        n = drive.rollers
        for p in range(contact_rows.link_contacts(drive)):
            push, speed = p * wp.static(capacity), p * wp.static(capacity)
            push, speed = push + contact_rows.push_row(drive, 0), speed + contact_rows.speed_row(drive, 0)
            for i in range(n):
                access.store(w, push + i, access.load(state.push, drive.first_push + p * n + i))
                access.store(w, speed + i, access.load(state.impact_speed, drive.first_contact + p * n + i))
        at = drive.first_push + contact_rows.link_contacts(drive) * n
        for i in range(n):
            access.store(w, row.toe_x + i, access.load(state.push, at + i))
            access.store(w, row.toe_y + i, access.load(state.push, at + n + i))

    @wp.func
    def put_back_pushes(state: State, drive: Drive, w: wp.array[Real]):
        """Copies v0 and forces of the step before from their rows to the state, at a launch's end."""
        n = drive.rollers
        for p in range(contact_rows.link_contacts(drive)):
            push, speed = p * wp.static(capacity), p * wp.static(capacity)
            push, speed = push + contact_rows.push_row(drive, 0), speed + contact_rows.speed_row(drive, 0)
            for i in range(n):
                access.store(state.push, drive.first_push + p * n + i, access.load(w, push + i))
                access.store(state.impact_speed, drive.first_contact + p * n + i, access.load(w, speed + i))
        at = drive.first_push + contact_rows.link_contacts(drive) * n
        for i in range(n):
            access.store(state.push, at + i, access.load(w, row.toe_x + i))
            access.store(state.push, at + n + i, access.load(w, row.toe_y + i))

    @wp.func
    def link_acceleration(w: wp.array[Real], i: int, chain: Chain):
        """Acceleration [m/s^2] of pin `i` by its links now, and by its contacts as in the step before."""
        a = rollers.acceleration(w, i, chain.inverse_mass, chain.gravity)
        own = chain.inverse_mass * access.load(w, row.mobility + i)
        return vec2(a[0] + own * access.load(w, row.toe_x + i), a[1] + own * access.load(w, row.toe_y + i))

    @wp.func
    def find_link_motions(w: wp.array[Real], n: int, chain: Chain):
        """Stores each link's direction, length and motion, link i's at i + 1."""
        i = int(0)
        while i < n:
            a = link_acceleration(w, i, chain)
            access.store(w, row.pin_ax + i, a[0])
            access.store(w, row.pin_ay + i, a[1])
            i = i + 1
        access.store(w, row.pin_ax + n, access.load(w, row.pin_ax))
        access.store(w, row.pin_ay + n, access.load(w, row.pin_ay))
        i = int(0)
        while i < n:
            d, v = rollers.link_vector(w, i), rollers.link_velocity(w, i)
            ax = access.load(w, row.pin_ax + i + 1) - access.load(w, row.pin_ax + i)
            ay = access.load(w, row.pin_ay + i + 1) - access.load(w, row.pin_ay + i)
            length = wp.sqrt(d[0] * d[0] + d[1] * d[1])
            inverse = Real(1.0) / length
            ux, uy = inverse * d[0], inverse * d[1]
            access.store(w, row.link_ux + i + 1, ux)
            access.store(w, row.link_uy + i + 1, uy)
            access.store(w, row.link_length + i + 1, length)
            access.store(w, row.link_turn + i + 1, inverse * products(ux, v[1], -uy, v[0]))
            access.store(w, row.link_angular + i + 1, inverse * products(ux, ay, -uy, ax))
            access.store(w, row.middle_vx + i + 1, access.load(w, row.vx + i) + Real(0.5) * v[0])
            access.store(w, row.middle_vy + i + 1, access.load(w, row.vy + i) + Real(0.5) * v[1])
            access.store(w, row.middle_ax + i + 1, access.load(w, row.pin_ax + i) + Real(0.5) * ax)
            access.store(w, row.middle_ay + i + 1, access.load(w, row.pin_ay + i) + Real(0.5) * ay)
            i = i + 1
        for k in range(9):
            first = row.link_ux + k * wp.static(capacity)
            access.store(w, first, access.load(w, first + n))

    def contact_functions(end: int) -> tuple[wp.Function, wp.Function]:
        """Functions that store contacts of flank end `end`, and the motions of contacts of its link."""
        after, number_of_end = end < 2, end % 2
        apart, sign = int(after), 1.0 if after else -1.0

        @wp.func
        def link_direction(w: wp.array[Real], i: int):
            """Unit vector from pin `i` into the link, along and across the seat's direction."""
            x, y = access.load(w, row.outward_x + i), access.load(w, row.outward_y + i)
            ux = wp.static(Real(sign)) * access.load(w, row.link_ux + i + wp.static(apart))
            uy = wp.static(Real(sign)) * access.load(w, row.link_uy + i + wp.static(apart))
            return vec2(products(ux, x, uy, y), products(uy, x, -ux, y))

        @wp.func
        def store_place(w: wp.array[Real], i: int, depth: Real, n: vec2, z: vec2):
            """Stores penetration, normal and place, along and across the seat's direction, and their mobility."""
            x, y = access.load(w, row.outward_x + i), access.load(w, row.outward_y + i)
            access.store(w, row.penetration + i, depth)
            access.store(w, row.normal_x + i, products(n[0], x, -n[1], y))
            access.store(w, row.normal_y + i, products(n[0], y, n[1], x))
            access.store(w, row.place_x + i, products(z[0], x, -z[1], y))
            access.store(w, row.place_y + i, products(z[0], y, z[1], x))
            length = access.load(w, row.link_length + i + wp.static(apart))
            access.store(w, row.point_mobility + i, point_mobility(z, n, length))

        @wp.func
        def mend_places(w: wp.array[Real], group: Group, plate: Plate, sprocket: Sprocket):
            """Stores the contacts of the few arcs that are not on the flank that they face."""
            bits = access.find_unlike(w, row.exception + group.low, group.high - group.low, Real(0.0))
            while bits != wp.uint64(0):
                i = group.low + lowest_bit(bits)
                u, length = link_direction(w, i), access.load(w, row.link_length + i + wp.static(apart))
                xi, lateral = access.load(w, row.radial + i), access.load(w, row.lateral + i)
                depth, n, z = toe_contact(
                    xi, lateral, u, length, wp.static(number_of_end), wp.static(after), plate, sprocket
                )
                store_place(w, i, depth, n, z)
                bits = without_lowest_bit(bits)

        @wp.func
        def find_places(w: wp.array[Real], group: Group, last: int, plate: Plate, sprocket: Sprocket, number: int):
            """Stores penetrations, normals, places and mobilities of one flank end at the group's pins."""
            others = int(0)
            i = group.low
            while i < group.high:
                u, length = link_direction(w, i), access.load(w, row.link_length + i + wp.static(apart))
                xi, lateral = access.load(w, row.radial + i), access.load(w, row.lateral + i)
                depth, n, z, on_flank = seated_toe_contact(
                    xi, lateral, u, length, wp.static(number_of_end), wp.static(after), plate, sprocket
                )
                seated = access.load(w, row.direction_owner + i) == Real(number) and i < last
                exception = wp.where(seated, 1 - on_flank, 0)
                others = others | exception
                access.store(w, row.exception + i, Real(exception))
                store_place(w, i, wp.where(seated, depth, Real(AWAY)), n, z)
                before = wp.where(seated, access.load(w, row.v0_before + i), Real(0.0))
                access.store(w, row.v0_before + i, before)
                access.store(w, row.v0_open + i, memory_after_teeth(before))
                i = i + 1
            if others != 0:
                mend_places(w, group, plate, sprocket)

        @wp.func
        def find_motions(w: wp.array[Real], group: Group, body: Pose, memory: Memory):
            """Stores relative velocities and accelerations of contacts of links at the group's pins."""
            center_vx, center_vy, omega = Real(body.velocity[0]), Real(body.velocity[1]), Real(body.speed)
            i = group.low
            while i < group.high:
                at = i + wp.static(apart)
                half = wp.static(Real(0.5 * sign)) * access.load(w, row.link_length + at)
                x, y = access.load(w, row.place_x + i), access.load(w, row.place_y + i)
                p = rollers.exact_position(w, i) - body.center
                arm_x = Real(p[0]) + half * access.load(w, row.link_ux + at) + x
                arm_y = Real(p[1]) + half * access.load(w, row.link_uy + at) + y
                turn, angular = access.load(w, row.link_turn + at), access.load(w, row.link_angular + at)
                speed_x = access.load(w, row.middle_vx + at) - turn * y
                speed_y = access.load(w, row.middle_vy + at) + turn * x
                ax, ay = access.load(w, row.middle_ax + at), access.load(w, row.middle_ay + at)
                own = vec2(ax - angular * y, ay + angular * x)
                more = relative_acceleration(memory.straight, memory.angular, vec2(arm_x, arm_y), own)
                contact_rows.store_arm(w, i, arm_x, arm_y)
                access.store(w, row.relative_x + i, (center_vx - omega * arm_y) - speed_x)
                access.store(w, row.relative_y + i, (center_vy + omega * arm_x) - speed_y)
                access.store(w, row.more_x + i, more[0])
                access.store(w, row.more_y + i, more[1])
                i = i + 1

        @wp.func
        def find_contacts(
            w: wp.array[Real],
            group: Group,
            last: int,
            plate: Plate,
            sprocket: Sprocket,
            body: Pose,
            number: int,
            memory: Memory,
        ):
            """Stores contacts of one flank end with wheel `number` at the group's pins before `last`.

            Gap coordinates and v0 are in their rows.
            """
            find_places(w, group, last, plate, sprocket, number)
            find_motions(w, group, body, memory)

        return find_contacts, find_motions

    of_ends = [contact_functions(end) for end in range(int(ENDS))]
    return ToeFunctions(
        fetch_pushes=fetch_pushes,
        put_back_pushes=put_back_pushes,
        find_link_motions=find_link_motions,
        find_motions=of_ends[0][1],
        find_contacts=tuple(find for find, _ in of_ends),
    )
