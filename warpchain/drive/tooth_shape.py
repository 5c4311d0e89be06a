"""Tooth gaps of sprockets, given or of ISO 606: seat arc, flanks, tips, outlines."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from warpchain.drive.stack_math import cbrt, elementwise, minimum

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

MARGIN = math.radians(5.0)
"""Margin of the default seating angle [rad]."""


@dataclass(frozen=True)
class Tooth:
    """Gap between two teeth of a sprocket, symmetric.

    Attributes:
        seat_radius: of the seat arc [m].
        seat_angle: extent of the seat arc [rad].
        flank_radius: of the convex flanks [m]; infinite for straight ones.
        tip_radius: from the sprocket's center [m].
    """

    seat_radius: float
    seat_angle: float
    flank_radius: float
    tip_radius: float

    def pressure_angle(self, teeth: int) -> float:
        """Angle between a seated roller's link and the flank's first normal, phi [rad].

        Tension falls by sin(phi) / sin(phi + 2 pi/z) from link to link.
        """
        return 0.5 * math.pi - 0.5 * self.seat_angle - math.pi / teeth

    def normal(
        self, xi: NDArray[np.float64], eta: NDArray[np.float64], roller_radius: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Direction of a tooth gap's force on a roller, outward and counter-clockwise (...).

        Args:
            xi, eta: (...) roller's center from the seat, likewise [m].
        """
        import numpy as np

        cosine, sine = np.cos(0.5 * self.seat_angle), np.sin(0.5 * self.seat_angle)
        size = np.maximum(np.sqrt(xi * xi + eta * eta), 1e-15)
        on_arc = np.abs(eta) * cosine <= -xi * sine
        curvature = 1.0 / (self.flank_radius + roller_radius)
        across = 1.0 - curvature * (np.abs(eta) * sine - xi * cosine - (self.seat_radius - roller_radius))
        along = curvature * (np.abs(eta) * cosine + xi * sine)
        reach = np.hypot(across, along)
        outward = np.where(on_arc, -xi / size, (across * cosine + along * sine) / reach)
        lateral = np.where(on_arc, -eta / size, np.sign(eta) * (along * cosine - across * sine) / reach)
        return outward, lateral


def iso606_tooth(gap: str, roller_radius: float, teeth: int, pitch: float) -> Tooth:
    """Minimum or maximum tooth gap of ISO 606."""
    d1 = 2.0 * roller_radius
    pitch_diameter = pitch / math.sin(math.pi / teeth)
    if gap == "minimum":
        return Tooth(
            seat_radius=0.505 * d1,
            seat_angle=math.radians(140.0 - 90.0 / teeth),
            flank_radius=0.12 * d1 * (teeth + 2),
            tip_radius=0.5 * (pitch_diameter + pitch * (1.0 - 1.6 / teeth) - d1),
        )
    return Tooth(
        seat_radius=0.505 * d1 + 0.069e-3 * cbrt(1e3 * d1),
        seat_angle=math.radians(120.0 - 90.0 / teeth),
        flank_radius=0.008 * d1 * (teeth**2 + 180),
        tip_radius=0.5 * (pitch_diameter + 1.25 * pitch - d1),
    )


@elementwise
def releasing_seat_angle(pitch_radius: float, pitch: float) -> float:
    """Largest seating angle whose straight flanks release a strand's rollers [rad]."""
    reach = pitch_radius + 0.5 * pitch
    s = math.sqrt(reach * reach - pitch_radius * pitch_radius)
    behind = s / pitch_radius - math.atan2(s, pitch_radius)
    return 2.0 * math.atan2(reach * math.cos(behind) - pitch_radius, reach * math.sin(behind))


def default_seat_angle(teeth: int, pitch_radius: float, pitch: float) -> float:
    """Default seating angle, 140 - 90/z degrees or a releasing one [rad]."""
    return minimum(math.radians(140.0 - 90.0 / teeth), releasing_seat_angle(pitch_radius, pitch) - MARGIN)


def half_gap_outline(tooth: Tooth, teeth: int, pitch_radius: float, arc_points: int = 9) -> NDArray[np.float64]:
    """Outline (P, 2) of half a tooth gap, seat at (pitch_radius, 0) [m]."""
    import numpy as np

    half_seat, half_pitch = 0.5 * tooth.seat_angle, math.pi / teeth
    angle = np.linspace(0.0, half_seat, arc_points)
    seat = [pitch_radius, 0.0] + tooth.seat_radius * np.stack([-np.cos(angle), np.sin(angle)], axis=1)
    curvature = 1.0 / tooth.flank_radius
    outward = np.array([math.sin(half_seat), math.cos(half_seat)])
    inward = np.array([math.cos(half_seat), -math.sin(half_seat)])

    def flank(length: float) -> NDArray[np.float64]:
        """Point of the flank at a length from the seat [m]."""
        turn = curvature * length
        bend = 2.0 * math.sin(0.5 * turn) ** 2 / curvature if curvature else 0.0
        return seat[-1] + (math.sin(turn) / curvature if curvature else length) * outward - bend * inward

    def beyond(length: float) -> bool:
        """Whether the flank is past the tip or the next tooth there."""
        x, y = flank(length)
        return math.hypot(x, y) >= tooth.tip_radius or math.atan2(y, x) >= half_pitch

    low, high = 0.0, 2.0 * math.pi * pitch_radius / teeth
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if beyond(middle) else (middle, high)
    half = np.vstack([seat, [flank(length) for length in np.linspace(0.0, high, arc_points)[1:]]])
    if math.atan2(half[-1, 1], half[-1, 0]) < half_pitch * (1.0 - 1e-9):
        half = np.vstack([half, tooth.tip_radius * np.array([math.cos(half_pitch), math.sin(half_pitch)])])
    return half


def gap_outline(tooth: Tooth, teeth: int, pitch_radius: float, arc_points: int = 9) -> NDArray[np.float64]:
    """Outline (P, 2) of a tooth gap, seat at (pitch_radius, 0) [m]."""
    import numpy as np

    half = half_gap_outline(tooth, teeth, pitch_radius, arc_points)
    return np.vstack([half[::-1] * [1.0, -1.0], half[1:]])


def teeth_around(gap: NDArray[np.float64], teeth: int) -> NDArray[np.float64]:
    """Closed outline (P, 2) of a wheel with equal tooth gaps (P, 2) [m]."""
    import numpy as np

    turn = 2.0 * math.pi / teeth * np.arange(teeth)
    cosine, sine = np.cos(turn)[:, None], np.sin(turn)[:, None]
    points = np.stack([gap[:, 0] * cosine - gap[:, 1] * sine, gap[:, 0] * sine + gap[:, 1] * cosine], axis=-1)
    outline = points.reshape(-1, 2)
    return np.vstack([outline, outline[:1]])


def teeth_outline(tooth: Tooth, teeth: int, pitch_radius: float, arc_points: int = 9) -> NDArray[np.float64]:
    """Closed outline (P, 2) of a sprocket's teeth, a seat at (pitch_radius, 0) [m]."""
    return teeth_around(gap_outline(tooth, teeth, pitch_radius, arc_points), teeth)
