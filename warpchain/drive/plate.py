"""Plates of silent chains: back, toes with straight flanks, and wheel teeth (docs/silent-chains.md).

In a link's frame x runs from the nearer pin into the link, y from the pins' line to the wheel. A toe's flank lies at
the distance f of that pin, its normal (-cos a, sin a), from depth d_1 to d_2, rounded by r. After ASME B29.2

    a = 30 degrees,    f = 0.375 p,    teeth to (p / 2) (cot(pi / z) + 0.08).                                     (a)
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from warpchain.drive.stack_math import cos, cos_sin, sin, sqrt
from warpchain.drive.tooth_shape import Tooth

FLANK_ANGLE = 30.0
"""Angle of flanks to a link's normal [degrees]."""
FLANK_DISTANCE, BACK_HEIGHT, TOE_DEPTHS, TIP_RADIUS = 0.375, 0.4, (0.2, 0.5), 0.05
"""Default values of plates, over the pitch."""
TOOTH_HEIGHT = 0.04
"""Height of teeth above the pins' line, over the pitch."""
ROOT_DEPTH = 0.6
"""Depth of roots below the pins' line, over the pitch."""
LEAST_TEETH = 17
"""Least teeth of a wheel."""
PIN_RADIUS, PLATE_AREA = 0.15, 0.95
"""Estimates of pins over pitch, and plates over squared pitch."""
CROWN = 25.0
"""Radius of a plate's back between its pins over the pitch, an estimate."""
PLATE_KEYS = ("flank_angle", "flank_distance", "back_height", "toe_depths", "tip_radius")
"""Keys of a chain's plates."""


@dataclass(frozen=True)
class Plate:
    """Plate of a silent chain.

    Attributes:
        pitch: p [m].
        flank_angle: a [rad].
        flank_distance: f [m].
        back_height: of the back above the line of the pins [m].
        toe_depths: d_1, d_2 [m].
        tip_radius: r [m].
    """

    pitch: float
    flank_angle: float
    flank_distance: float
    back_height: float
    toe_depths: tuple[float, float]
    tip_radius: float

    def flank_end(self, number: int) -> tuple[float, float]:
        """Place (x, y) of the center of a flank's rounded end [m]: 0 its beginning, 1 the toe's tip."""
        cosine, sine = cos_sin(self.flank_angle)
        along = (self.toe_depths[number] - self.flank_distance * sine) / cosine
        apart = self.flank_distance - self.tip_radius
        return along * sine - apart * cosine, along * cosine + apart * sine

    @property
    def flank_length(self) -> float:
        """Length of a plate's flank between its ends' centers [m]."""
        return (self.toe_depths[1] - self.toe_depths[0]) / cos(self.flank_angle)

    @property
    def depth(self) -> float:
        """Depth of a plate's toes below the pins' line [m]."""
        return self.flank_end(1)[1] + self.tip_radius

    @property
    def reach(self) -> float:
        """Distance of a toe's farthest point from its pin [m]."""
        x, y = self.flank_end(1)
        return sqrt(x * x + y * y) + self.tip_radius


def wheel_tip_radius(teeth: int, pitch: float) -> float:
    """Radius of a silent chain wheel's tips [m], (a)."""
    return 0.5 * pitch / math.tan(math.pi / teeth) + TOOTH_HEIGHT * pitch


def gap_angle(plate: Plate, teeth: int) -> float:
    """Angle of a wheel's flanks to their gap's middle [rad]."""
    return plate.flank_angle - math.pi / teeth


def wheel_tooth(plate: Plate, teeth: int, pitch: float) -> Tooth:
    """Gap between the teeth of a silent chain's wheel."""
    return Tooth(
        seat_radius=plate.flank_distance,
        seat_angle=math.pi - 2.0 * gap_angle(plate, teeth),
        flank_radius=math.inf,
        tip_radius=wheel_tip_radius(teeth, pitch),
    )


def tooth_corner(plate: Plate, teeth: int, pitch: float) -> float:
    """Place of a wheel tooth's tip along its flank [m]."""
    gamma, radius, f = gap_angle(plate, teeth), pitch / (2.0 * math.sin(math.pi / teeth)), plate.flank_distance
    tip = wheel_tip_radius(teeth, pitch)
    across = radius * sin(gamma) - f
    return sqrt(tip * tip - across * across) - radius * cos(gamma)


def top_radius(plate: Plate, teeth: int, pitch: float) -> float:
    """Radius of the pins of a link on a wheel's tips [m]."""
    x, y = plate.flank_end(1)
    half, reach = 0.5 * plate.pitch, wheel_tip_radius(teeth, pitch) + plate.tip_radius
    height = y + sqrt(reach * reach - (half - x) * (half - x))
    return sqrt(height * height + half * half)


def plate_problems(plate: Plate) -> Iterator[tuple[str, Any, str]]:
    """Keys, values and error sentences of plates that cannot be."""
    begin, end = plate.toe_depths
    foot = plate.flank_distance * sin(plate.flank_angle)
    if plate.back_height >= plate.pitch:
        yield "back_height", plate.back_height, f"must be below the pitch, {plate.pitch:g}"
    if plate.tip_radius >= plate.flank_distance:
        text = f"must be below flank_distance, {plate.flank_distance:g}"
        yield "tip_radius", plate.tip_radius, text
    elif begin < foot:
        text = (
            f"must begin at least {foot:g} deep, at the foot of the pin's perpendicular; above it links turn into teeth"
        )
        yield "toe_depths", list(plate.toe_depths), text
    elif end <= begin:
        yield "toe_depths", list(plate.toe_depths), f"must end deeper than it begins, {begin:g}"
    elif plate.flank_end(1)[0] + plate.tip_radius >= 0.5 * plate.pitch:
        most = begin + (0.5 * plate.pitch - plate.tip_radius - plate.flank_end(0)[0]) / math.tan(plate.flank_angle)
        text = f"must end less than {most:.4g} deep, where the flanks of both toes would cross"
        yield "toe_depths", list(plate.toe_depths), text


def toe_clearance(plate: Plate, teeth: int, pitch: float) -> float:
    """Least clearance of toes from teeth while a link is seated [m]."""
    step, gamma, tip = 2.0 * math.pi / teeth, gap_angle(plate, teeth), wheel_tip_radius(teeth, pitch)
    radius, least = pitch / (2.0 * math.sin(0.5 * step)), math.inf
    seats = radius, radius * complex(math.cos(step), math.sin(step))  # of the pins, the second one last to be seated
    for part in range(17):
        link = (seats[1] - seats[0]) * complex(math.cos(step * part / 16.0), -math.sin(step * part / 16.0))
        along = link / abs(link)
        for seat, pin, into in ((0, seats[0], along), (1, seats[0] + link, -along)):
            for x, y in (plate.flank_end(0), plate.flank_end(1)):
                place = (pin + x * into + y * 1j * along) * (seats[0] / seats[seat])  # the gap's middle on the x axis
                side = place.imag if seat else -place.imag
                flank = (place.real - radius) * math.sin(gamma) - side * math.cos(gamma) + plate.flank_distance
                least = min(least, max(flank - plate.tip_radius, abs(place) - tip - plate.tip_radius))
    return least
