"""Tooth geometry that decides whether a chain can leave its sprocket: straight flanks must let a straight strand go.

A roller of a strand that is drawn straight off the pitch circle (radius R) at the distance s from the tangent point
stands, seen from the sprocket, at the radius sqrt(R^2 + s^2) and behind its own seat by the angle d = s/R - atan(s/R).
With xi and eta its place in its own tooth gap, the straight flank of half seating angle b is clear of it where
eta sin(b) < xi cos(b). The roller passes the tips at the radius R + p/2; there the flank is nearest, so

    tan(b) < xi / eta,   xi = (R + p/2) cos(d) - R,   eta = (R + p/2) sin(d),   s^2 = (R + p/2)^2 - R^2.

Polygon action lowers strands by up to R (1 - cos(pi/z)), which `MARGIN` allows for. Teeth beyond the limit catch every
roller that comes and goes: measured on 20 teeth with a limit of 136 degrees, a drive that pulls 2.0 kN carries 7.1 kN
at 137 degrees, and 2.0 kN again at 130 (scripts/seat_angle_study.py).
"""

import math

MARGIN = math.radians(5.0)
"""How far below the limit the default seating angle stays [rad]."""


def releasing_seat_angle(pitch_radius: float, pitch: float) -> float:
    """Largest seating angle whose straight flanks let the rollers of a straight strand go [rad].

    Args:
        pitch_radius: R [m].
        pitch: the chain's pitch p [m].
    """
    reach = pitch_radius + 0.5 * pitch
    s = math.sqrt(reach * reach - pitch_radius * pitch_radius)
    behind = s / pitch_radius - math.atan2(s, pitch_radius)
    return 2.0 * math.atan2(reach * math.cos(behind) - pitch_radius, reach * math.sin(behind))


def default_seat_angle(teeth: int, pitch_radius: float, pitch: float) -> float:
    """Seating angle of a circular profile that gives none [rad]: 140 degrees - 90 degrees / z, or what releases."""
    return min(math.radians(140.0 - 90.0 / teeth), releasing_seat_angle(pitch_radius, pitch) - MARGIN)
