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
is eliminated from the first line. As it turns the other leaves on its pivot, beside what its mass there does,

    F_2 + w_2^2 s - alpha_2 e_z x s,                                                                          (c)

which whatever leads the pivot of the one has to hold, too.

In leapfrog the center's velocity is alpha' x r_d of the arm's speed half a step behind, so that with the arm's
acceleration, alpha'' x r_d, contacts have that of their instant, as of guides on arms.
"""

from typing import Any

import warp as wp

from ..number import Pair, PairVector, add, difference, leading, mul, number_of, sub  # noqa: F401
from .friction import DAMPER, SPRING, held_back
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
def joint_terms(lever: Any, s: Any, w1: Any, w2: Any, led: Any, moment: Any):
    """d.s [kg m^2], the right side of the second line and the last term of the first [N m] of (b).

    Args:
        lever, s: d [m] and s [kg m].
        w1, w2: angular velocities of the carrying and the other arm [rad/s].
        led: acceleration of the carrying arm's pivot [m/s^2].
        moment: M_2 [N m].
    """
    across = moment_of(lever, s)
    right = moment - w1 * w1 * across - moment_of(s, led)
    return wp.vector(wp.dot(lever, s), right, w2 * w2 * across)


@wp.func
def eliminated(moment: Any, inertia: Any, terms: Any, inverse: Any):
    """Moment [N m] and inertia [kg m^2] of the first line of (b) without the other arm, of `inverse` 1 / I_2."""
    moment = moment + terms[2] - terms[0] * inverse * terms[1]
    return moment, inertia - terms[0] * terms[0] * inverse


@wp.func
def hanging_on(angular: Any, terms: Any, inverse: Any):
    """alpha_2 [rad/s^2] of (b) from alpha_1."""
    return inverse * (terms[1] - terms[0] * angular)


@wp.func
def turning_force(speed: Any, angular: Any, s: Any):
    """Force [N] that an arm leaves on its pivot as it turns: (c) without F_2."""
    return speed * speed * s - angular * left(s)


@wp.func
def joint_energy(speed: Any, s: Any, lever: Any, carrier: Any):
    """Kinetic energy [J] that an arm of this `speed` has as its pivot goes along with the `carrier`."""
    return speed * wp.dot(left(s), carrier.velocity + carrier.speed * left(lever))


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
    most = hub.bearing * wp.length(force)
    drag, holds = held_back(
        most, turning, held, type(turning)(SPRING) * hub.inertia, type(turning)(DAMPER) * hub.inertia, stretched
    )
    return -drag, holds
