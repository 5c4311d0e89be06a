r"""Hubs of sprockets: arms that carry them, and bearings that rub.

A sprocket on an arm has its center at a point of it, r = p + Rot(alpha) d, p the arm's pivot; it turns for itself. The
chain's force F on it acts on the arm at r, its moment on the sprocket alone:

    J omega' = M + load - Q,    (I + m d^2) alpha'' = r_d x F + Q + other moments,    r_d = Rot(alpha) d,    (a)

with m, J its mass and inertia. Its bearing, of radius r_b, rubs by Q, at most mu_b r_b |F|, against omega - alpha'
(against omega where no arm carries it), and remembers as all friction does (`friction`).

An arm may carry another, whose pivot then is a point of it. With d from the one's pivot to the other's, absolute angles
and s = m_2 (r_c - p_2) of the other,

    (I_1 + m_2 d^2) alpha_1 + d.s alpha_2 = M_1 + r_d x F_2 + w_2^2 (r_d x s)
    I_2 alpha_2 + d.s alpha_1 = M_2 - w_1^2 (r_d x s),                                                        (b)

F_2 all forces on the other; its spring, damper and stops act on both, at alpha_2 - alpha_1. With several on one, each
is eliminated from the first line.

In leapfrog the center's velocity is alpha' x r_d of the arm's speed half a step behind, so that with the arm's
acceleration, alpha'' x r_d, contacts have that of their instant, as of guides on arms.
"""

from typing import Any

import warp as wp

from ..number import Pair, PairVector, add, difference, leading, mul, number_of, sub  # noqa: F401
from .friction import held_back
from .guide import from_frame
from .mount import left


@wp.func
def carried_by(body: Any, carrier: Any, hub: Any):
    """A sprocket where the arm that carries it has it (`structs.Hub`)."""
    lever = from_frame(hub.lever, carrier)
    body.center = carrier.center + lever
    body.velocity = carrier.velocity + number_of(leading(carrier.speed) * left(leading(lever)))
    body.straight = carrier.straight + carrier.angular * left(leading(lever))
    return body


@wp.func
def against(body: Any, carrier: Any):
    """A body as the one that carries it sees it turn."""
    body.angle = body.angle - carrier.angle
    body.speed = body.speed - carrier.speed
    return body


@wp.func
def moment_of(lever: Any, force: Any):
    """Moment [N m] about a pivot of a force [N], which acts `lever` [m] from it."""
    return lever[0] * force[1] - lever[1] * force[0]


@wp.func
def bearing_moment(force: Any, turning: Any, held: Any, hub: Any, stretched: Any):
    """Moment -Q [N m] of a bearing on its sprocket, and what the bearing holds from now on.

    Args:
        force: of the chain on the sprocket [N].
        turning: the sprocket's angular velocity less its arm's [rad/s].
        held: until now [N m].
        hub: its data.
        stretched: as in `friction.held_back`.
    """
    drag, holds = held_back(hub.bearing * wp.length(force), turning, held, hub.inertia, stretched)
    return -drag, holds
