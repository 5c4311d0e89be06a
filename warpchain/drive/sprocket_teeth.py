"""Teeth of a drive's sprockets: pitch, gap, and release of rollers."""

from __future__ import annotations

import math

from warpchain.drive.chain import Chain
from warpchain.drive.contact_settings import SprocketContact
from warpchain.drive.plate import wheel_tooth
from warpchain.drive.sprocket import Sprocket
from warpchain.drive.stack_math import radians
from warpchain.drive.tooth_shape import Tooth, default_seat_angle, iso606_tooth, releasing_seat_angle

END_RADIUS = 1e-9
"""Radius at which a toothless end holds its pin [m]."""
END_REACH = 1e4
"""Tip radius of an end, beyond its pin's reach [m]."""


def tooth_pitch(sprocket: Sprocket, chain: Chain) -> float:
    """Pitch of a sprocket's teeth [m]."""
    return chain.pitch if sprocket.pitch is None else sprocket.pitch


def pitch_radius(sprocket: Sprocket, chain: Chain) -> float:
    """Radius of a sprocket's pitch circle, of an end's rim, or `END_RADIUS` [m]."""
    if sprocket.is_end:
        return END_RADIUS if sprocket.rim is None else sprocket.rim
    return tooth_pitch(sprocket, chain) / (2.0 * math.sin(math.pi / sprocket.teeth))


def sprocket_tooth(sprocket: Sprocket, chain: Chain, contact: SprocketContact) -> Tooth:
    """Tooth gap of a sprocket: own, contact's, silent chain's; or an end's hole."""
    if sprocket.is_end:
        return Tooth(chain.roller_radius, 2.0 * math.pi, math.inf, END_REACH)
    if chain.is_silent:
        return wheel_tooth(chain.plate, sprocket.teeth, tooth_pitch(sprocket, chain))
    own = sprocket.tooth
    if own is not None:
        flank = math.inf if own.flank_radius is None else own.flank_radius
        return Tooth(own.seat_radius, radians(own.seat_angle), flank, own.tip_radius)
    radius, teeth = chain.roller_radius, sprocket.teeth
    if contact.profile == "iso606":
        assert contact.gap is not None  # the contact's own rule
        return iso606_tooth(contact.gap, radius, teeth, tooth_pitch(sprocket, chain))
    assert contact.clearance is not None
    angle, seats = contact.seat_angle, pitch_radius(sprocket, chain)
    return Tooth(
        seat_radius=radius + contact.clearance,
        seat_angle=default_seat_angle(teeth, seats, chain.pitch) if angle is None else radians(angle),
        flank_radius=math.inf,
        tip_radius=seats + 0.5 * (chain.pitch - 2.0 * radius),
    )


def is_catching(sprocket: Sprocket, chain: Chain, tooth: Tooth) -> bool:
    """Whether a sprocket's straight flanks catch a strand's rollers."""
    straight = not sprocket.is_end and not chain.is_silent and math.isinf(tooth.flank_radius)
    return straight and bool(tooth.seat_angle > releasing_seat_angle(pitch_radius(sprocket, chain), chain.pitch))
