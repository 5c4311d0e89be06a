"""Links of a block's silent chains as their contacts see them, place, motion, acceleration, and what they touch."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import warp as wp

from ..native import inverse_root, products
from ..number import difference, leading_value
from ..physics.link import roller_acceleration
from .block_kinds import BlockKind
from .block_structs import ThreadParts
from .chains import chain_functions
from .rollers import roller_functions
from .toe_rows import toe_row_functions


@dataclass(frozen=True)
class ToeLinkFunctions:
    """Links of one variant's silent chains."""

    Link: Any
    partner_law: wp.Function
    partner_pose: wp.Function
    pin_acceleration: wp.Function
    link_of_pin: wp.Function
    with_motion: wp.Function


@cache
def toe_link_functions(kind: BlockKind) -> ToeLinkFunctions:
    """The functions that find links of silent chains of one variant on a block."""
    Real, kinds, sprockets = kind.Real, kind.types, kind.parts.sprockets
    State, Shared, vec2 = kinds.State, kinds.Shared, kinds.vec2
    chains = chain_functions(kind)
    rollers = roller_functions(kind)
    toe_rows = toe_row_functions(kind)

    @wp.struct
    class Link:
        """A link of a pin and its motion."""

        u: vec2  # unit vector from the pin into the link
        length: Real  # [m]
        inverse: Real  # 1 over that
        turn: Real  # angular velocity [rad/s]
        angular: Real  # angular acceleration [rad/s^2]
        velocity: vec2  # of its middle [m/s]
        acceleration: vec2  # of its middle [m/s^2]
        middle: vec2  # from the wheel's center [m]

    @wp.func
    def partner_law(shared: Shared, p: int):
        """Contact law of partner p."""
        if wp.static(kind.parts.guides):
            if p >= sprockets:
                return shared.guides[p - sprockets].law
        return shared.teeth[p].law

    @wp.func
    def partner_pose(shared: Shared, p: int):
        """Pose of partner p's body; a guide's that nothing carries is at zero."""
        if wp.static(kind.parts.guides):
            if p >= sprockets:
                if wp.static(kind.profiles):
                    return shared.poses[shared.guides[p - sprockets].body]
                else:
                    return kinds.Pose()
        return shared.poses[p]

    @wp.func
    def pin_acceleration(state: State, shared: Shared, mine: ThreadParts, j: int):
        """Acceleration of pin j by its links now, and by contacts as in the step before [m/s^2]."""
        chain = chains.chain_at(shared, j)
        force = rollers.force(shared, j) + toe_rows.force_before(state, shared, mine, j)
        return roller_acceleration(force, chain.inverse_mass, chain.gravity)

    @wp.func
    def link_of_pin(shared: Shared, j: int, other: int, arm: vec2):
        """Link from pin j, `arm` from the wheel's center, to pin `other`, without its motion."""
        d = leading_value(
            difference(rollers.exact_position(shared.rows, other), rollers.exact_position(shared.rows, j))
        )
        link = Link()
        square = products(d[0], d[0], d[1], d[1])
        link.inverse = inverse_root(square)
        link.length = square * link.inverse
        link.u = link.inverse * d
        link.middle = arm + Real(0.5) * d
        return link

    @wp.func
    def with_motion(state: State, shared: Shared, mine: ThreadParts, j: int, other: int, a: vec2, link: Link):
        """The link with its velocities and accelerations; `a` is that of pin j [m/s^2]."""
        v = rollers.velocity(shared.rows, j)
        w = rollers.velocity(shared.rows, other) - v
        b = pin_acceleration(state, shared, mine, other) - a
        link.turn = link.inverse * products(link.u[0], w[1], -link.u[1], w[0])
        link.angular = link.inverse * products(link.u[0], b[1], -link.u[1], b[0])
        link.velocity = v + Real(0.5) * w
        link.acceleration = a + Real(0.5) * b
        return link

    return ToeLinkFunctions(
        Link=Link,
        partner_law=partner_law,
        partner_pose=partner_pose,
        pin_acceleration=pin_acceleration,
        link_of_pin=link_of_pin,
        with_motion=with_motion,
    )
