"""Motions of a silent chain's links, and of their contacts."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..native import products, row_access
from ..physics.contact import relative_acceleration
from ..physics.toe import approach_bound
from ..structs import Pose, types
from .contact_rows import contact_row_functions
from .rollers import roller_functions, rows


@dataclass(frozen=True)
class LinkMotionFunctions:
    """CPU functions of links' motions."""

    find_link_motions: wp.Function
    Link: type
    link_at: wp.Function
    arm_of_middle: wp.Function
    find_approach_bound: wp.Function
    store_motion: wp.Function


@cache
def link_motion_functions(Real: type, capacity: int) -> LinkMotionFunctions:
    """CPU functions of links' motions, for rows of `capacity` values."""
    kinds = types(Real)
    Chain, Memory, vec2 = kinds.Chain, kinds.Memory, kinds.vec2
    row = rows(capacity)
    rollers = roller_functions(Real, capacity)
    contact_rows = contact_row_functions(Real, capacity)
    access = row_access(Real)

    @wp.struct
    class Link:
        """Motion of a link."""

        ux: Real
        uy: Real
        length: Real  # [m]
        turn: Real  # angular velocity [rad/s]
        angular: Real  # angular acceleration [rad/s^2]
        vx: Real  # velocity of its middle [m/s]
        vy: Real
        ax: Real  # acceleration of that [m/s^2]
        ay: Real

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
        while i < access.whole_vectors(n):
            a = link_acceleration(w, i, chain)
            access.store(w, row.pin_ax + i, a[0])
            access.store(w, row.pin_ay + i, a[1])
            i = i + 1
        access.store(w, row.pin_ax + n, access.load(w, row.pin_ax))
        access.store(w, row.pin_ay + n, access.load(w, row.pin_ay))
        i = int(0)
        while i < access.whole_vectors(n):
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

    @wp.func
    def link_at(w: wp.array[Real], at: int):
        """Link of rows at `at`."""
        link = Link()
        link.ux = access.load(w, row.link_ux + at)
        link.uy = access.load(w, row.link_uy + at)
        link.length = access.load(w, row.link_length + at)
        link.turn = access.load(w, row.link_turn + at)
        link.angular = access.load(w, row.link_angular + at)
        link.vx = access.load(w, row.middle_vx + at)
        link.vy = access.load(w, row.middle_vy + at)
        link.ax = access.load(w, row.middle_ax + at)
        link.ay = access.load(w, row.middle_ay + at)
        return link

    @wp.func
    def arm_of_middle(w: wp.array[Real], i: int, link: Link, sign: Real, body: Pose):
        """Vector [m] from a body's center to the middle of pin i's link, `sign` 1 for that after it, else -1."""
        p = rollers.exact_position(w, i) - body.center
        half = Real(0.5) * sign * link.length
        return vec2(Real(p[0]) + half * link.ux, Real(p[1]) + half * link.uy)

    @wp.func
    def find_approach_bound(link: Link, arm: vec2, reach: Real, body: Pose, memory: Memory):
        """`approach_bound` [m/s] of a link and a body, `arm` from the body's center to the link's middle [m]."""
        omega = Real(body.speed)
        x = (Real(body.velocity[0]) - omega * arm[1]) - link.vx
        y = (Real(body.velocity[1]) + omega * arm[0]) - link.vy
        more = relative_acceleration(memory.straight, memory.angular, arm, vec2(link.ax, link.ay))
        return approach_bound(vec2(x, y), more, omega - link.turn, memory.angular - link.angular, reach, memory.lag)

    @wp.func(inline=True)
    def store_motion(contacts: wp.array[Real], c: int, arm: vec2, place: vec2, link: Link, body: Pose, memory: Memory):
        """Stores the arm of contact `c` [m], and its relative velocity and acceleration."""
        x, y = arm[0] + place[0], arm[1] + place[1]
        omega = Real(body.speed)
        speed_x, speed_y = link.vx - link.turn * place[1], link.vy + link.turn * place[0]
        own = vec2(link.ax - link.angular * place[1], link.ay + link.angular * place[0])
        more = relative_acceleration(memory.straight, memory.angular, vec2(x, y), own)
        contact_rows.store_arm(contacts, c, x, y)
        access.store(contacts, row.relative_x + c, (Real(body.velocity[0]) - omega * y) - speed_x)
        access.store(contacts, row.relative_y + c, (Real(body.velocity[1]) + omega * x) - speed_y)
        access.store(contacts, row.more_x + c, more[0])
        access.store(contacts, row.more_y + c, more[1])

    return LinkMotionFunctions(
        find_link_motions=find_link_motions,
        Link=Link,
        link_at=link_at,
        arm_of_middle=arm_of_middle,
        find_approach_bound=find_approach_bound,
        store_motion=store_motion,
    )
