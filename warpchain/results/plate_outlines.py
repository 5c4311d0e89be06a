"""Outlines of silent chains for pictures: plates of links, and teeth of their wheels."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpchain.drive.plate import PIN_RADIUS, ROOT_DEPTH, TOOTH_HEIGHT, Plate, gap_angle, tooth_corner
from warpchain.drive.tooth_shape import teeth_around
from warpchain.model import ChainModel

Array = NDArray[np.float64]

CROTCH_GAP = 0.022


def _ellipse_arc(center: Any, radii: Any, begin: float, end: float, points: int) -> Array:
    """Points (P, 2) on an ellipse between two angles [rad]."""
    angle = np.linspace(begin, end, points)
    return np.asarray(center) + np.multiply(radii, np.stack([np.cos(angle), np.sin(angle)], axis=1))


def plate_outline(plate: Plate, arc_points: int = 5) -> Array:
    """Closed outline (P, 2) [m] of a silent chain's plate, from its link's middle, y to the wheel."""
    radius, half = plate.tip_radius, 0.5 * plate.pitch
    begin, tip = (np.array(plate.flank_end(number)) for number in (0, 1))
    corner = np.array([plate.flank_distance - CROTCH_GAP * plate.pitch, -(TOOTH_HEIGHT + CROTCH_GAP) * plate.pitch])
    normal = math.pi - plate.flank_angle
    way = corner - tip
    inside = math.atan2(way[1], way[0]) + math.acos(radius / math.hypot(*way))  # of the tangent from the corner
    height = plate.back_height + begin[1]
    shoulder = _ellipse_arc((0.0, begin[1]), (radius - begin[0], height), 1.5 * math.pi, math.pi, 2 * arc_points)
    toe = [
        _ellipse_arc(begin, radius, math.pi, normal, arc_points),
        _ellipse_arc(tip, radius, normal, inside, 2 * arc_points),
    ]
    side = np.vstack([shoulder, *toe, corner]) - [half, 0.0]
    whole = np.vstack([side, side[::-1] * [-1.0, 1.0]])
    return np.vstack([whole, whole[:1]])


def wheel_outline(plate: Plate, teeth: int, pitch: float, arc_points: int = 5) -> Array:
    """Closed outline (P, 2) [m] of a silent chain's wheel."""
    gamma, step = gap_angle(plate, teeth), math.pi / teeth
    radius, sine, cosine = 0.5 * pitch / math.sin(step), math.sin(gamma), math.cos(gamma)
    across = radius * sine - plate.flank_distance
    root = 0.5 * pitch / math.tan(step) - ROOT_DEPTH * pitch
    lowest = math.sqrt(max(root * root - across * across, 0.0)) - radius * cosine
    lowest = max(lowest, -plate.flank_distance * cosine / sine)  # where the flanks of a narrow gap meet
    foot = np.array([radius - plate.flank_distance * sine, plate.flank_distance * cosine])
    ends = [foot + along * np.array([cosine, sine]) for along in (lowest, tooth_corner(plate, teeth, pitch))]
    low, high = (math.atan2(y, x) for x, y in ends)
    floor = _ellipse_arc((0.0, 0.0), math.hypot(*ends[0]), 0.0, low, arc_points)
    half = np.vstack([floor, _ellipse_arc((0.0, 0.0), math.hypot(*ends[1]), high, step, arc_points)])
    return teeth_around(np.vstack([half[::-1] * [1.0, -1.0], half[1:]]), teeth)


def plate_outlines(model: ChainModel, position: NDArray[np.floating], arc_points: int = 5) -> Array:
    """Outlines (..., N, P, 2) [m] of plates between pins (..., N, 2)."""
    ahead = np.roll(position, -1, axis=-2)
    way = ahead - position
    along = (way / np.hypot(way[..., 0], way[..., 1])[..., None])[..., None, :]
    inward = model.sprockets[0].sign * np.stack([-along[..., 1], along[..., 0]], axis=-1)
    x, y = plate_outline(model.chain.plate, arc_points).T[..., None]
    return 0.5 * (position + ahead)[..., None, :] + x * along + y * inward


def pin_radius(model: ChainModel) -> float:
    """Radius [m] of a silent chain's drawn pins."""
    return model.chain.pin_radius or PIN_RADIUS * model.chain.pitch


def pin_outlines(model: ChainModel, position: NDArray[np.floating], points: int = 12) -> Array:
    """Outlines (N, P, 2) [m] of a silent chain's pins (N, 2)."""
    return position[:, None] + _ellipse_arc((0.0, 0.0), pin_radius(model), 0.0, 2.0 * math.pi, points)
