r"""Arms in balance: the angles at which chain, springs, weight, stops and tensioners turn no arm.

Without friction the chain, of tension T throughout, turns an arm about its pivot by T (h_out - h_in), h the levers of
the tangents where it comes and goes (`Taut.levers`). With the strain e of the chain's path at these angles, T = k p e:

    T (h_out - h_in) - k_t (theta - theta_0) + m (r_c - p) x g + stops + sum of tensioners F l = 0.       (a)

Turning towards the chain lengthens its path, so that the left side falls through 0 once: sought arm by arm, all arms
over again until none moves.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from warpchain.assembly.path import MAX_STRAIN, ChainPath, Plan
from warpchain.drive.oil import static_force
from warpchain.errors import DriveError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from warpchain.drive import Drive

FARTHEST = math.radians(90.0)
"""No arm is sought farther from where it is drawn, or from its stops [rad]."""

_STEP = math.radians(0.25)
_SWEEPS = 60
_SECANTS = 30
_FIRST = 1e-5  # rad
_LONGEST = math.radians(2.0)
_NEAR = 1e-11  # rad; the error after such a step is round-off
_STILL = 1e-11  # rad


def tension(drive: Drive, path: ChainPath, beyond: float = 0.0) -> float:
    """Tension of the chain on its path [N], 0 where it is slack; `beyond` adds to its strain."""
    strain = min(path.nominal_strain, MAX_STRAIN) + beyond
    return drive.chain.mean_stiffness * path.pitch * max(strain, 0.0)


def extension(drive: Drive, t: int, angle: float) -> float:
    """Extension of tensioner t [m] with its arm at an angle [rad]."""
    (x, y), (ux, uy) = _reach(drive, t, angle), drive.tensioners[t].unit_direction
    (ax, ay), (px, py) = drive.tensioners[t].at, drive.arms[_arm(drive, t)].pivot
    return (x + px - ax) * ux + (y + py - ay) * uy


def own_moment(drive: Drive, a: int, angle: float) -> float:
    """Moment on arm a at an angle [rad] of all but the chain [N m]."""
    arm = drive.arms[a]
    cosine, sine = math.cos(angle), math.sin(angle)
    dx, dy = arm.center[0] - arm.pivot[0], arm.center[1] - arm.pivot[1]
    x, y = cosine * dx - sine * dy, sine * dx + cosine * dy
    gx, gy = drive.run.gravity
    low, high = arm.stops_rad
    found = arm.mass * (x * gy - y * gx) - arm.stiffness * (angle - arm.free_angle_rad)
    if not low <= angle <= high:
        found += drive.stop_stiffness(a) * (max(low - angle, 0.0) - max(angle - high, 0.0))
    for t, tensioner in enumerate(drive.tensioners):
        if tensioner.on == arm.name:
            (rx, ry), (ux, uy) = _reach(drive, t, angle), tensioner.unit_direction
            found += (rx * uy - ry * ux) * static_force(tensioner, extension(drive, t, angle))
    return found


def chain_moment(drive: Drive, path: ChainPath, a: int, beyond: float = 0.0) -> float:
    """Moment of the chain on arm a about its pivot [N m]."""
    levers = sum(string.levers(drive.guides_of(a), drive.arms[a].pivot) for string in path.strings if string)
    return tension(drive, path, beyond) * levers


def balanced(
    drive: Drive, beyond: float = 0.0, angles: Sequence[float] | NDArray[np.float64] | None = None
) -> ChainPath:
    """The path of the chain with all arms in balance (a).

    Args:
        drive: with arms.
        beyond: what the chain's strain is beyond the path's nominal one [-].
        angles: (A,) first guess [rad]; None is as drawn.

    Raises:
        DriveError: an arm without a balance; or as `path_at`.
    """
    found = [0.0] * len(drive.arms) if angles is None else [float(angle) for angle in angles]
    for a, arm in enumerate(drive.arms):
        low, high = arm.stops_rad
        found[a] = min(max(found[a], low), high)
    plan = Plan(drive)
    for _ in range(_SWEEPS):
        before = list(found)
        for a in range(len(found)):
            found[a] = _balance(plan, found, a, beyond)
        if len(found) == 1 or max(abs(x - y) for x, y in zip(found, before, strict=True)) <= _STILL:
            break
    return plan.path(found)


def _balance(plan: Plan, angles: Sequence[float], a: int, beyond: float) -> float:
    """The angle of arm a [rad] at which (a) holds, with the others where they are."""
    from scipy.optimize import brentq

    drive = plan.drive

    def moment(angle: float) -> float:
        path = plan.path([*angles[:a], angle, *angles[a + 1 :]])
        return own_moment(drive, a, angle) + chain_moment(drive, path, a, beyond)

    quick = _secant(moment, angles[a])
    if quick is not None:
        return quick
    arm = drive.arms[a]
    low, high = arm.stops_rad
    near, here = angles[a], moment(angles[a])
    if here == 0.0:
        return near
    step = math.copysign(_STEP, here)
    reason = "the chain leaves it"
    while near + step - min(max(near, low), high) > -FARTHEST and abs(near) < FARTHEST + abs(angles[a]):
        try:
            there = moment(near + step)
        except DriveError as error:
            reason = str(error)
            break
        if here * there <= 0.0:
            return float(brentq(moment, *sorted((near, near + step)), xtol=1e-14, rtol=1e-14))
        near, here = near + step, there
    stops = "give it stops, or" if arm.stops is None else "look at its stops, and"
    raise DriveError(
        f"arms.{arm.name}: finds no balance from {math.degrees(angles[a]):.3g} to {math.degrees(near):.3g} degrees, "
        f"{reason}; {stops} at the springs and tensioners that turn it"
    )


def _secant(moment: Callable[[float], float], near: float) -> float | None:
    """Where a moment that falls with the angle is 0 [rad], by secants; None where they lead astray."""
    try:
        before, here = near, moment(near)
        angle = near + math.copysign(_FIRST, here)
        for _ in range(_SECANTS):
            last, here = here, moment(angle)
            slope = (here - last) / (angle - before)
            if here == 0.0 or slope >= 0.0:
                return angle if here == 0.0 else None
            change = max(-_LONGEST, min(_LONGEST, -here / slope))
            before, angle = angle, angle + change
            if abs(change) <= _NEAR:
                return angle
    except DriveError:
        pass
    return None


def _arm(drive: Drive, t: int) -> int:
    arm = drive.arm_index(drive.tensioners[t].on)
    assert arm is not None
    return arm


def _reach(drive: Drive, t: int, angle: float) -> tuple[float, float]:
    """From the pivot to the touched point of tensioner t, its arm at an angle [m]."""
    pivot, at = drive.arms[_arm(drive, t)].pivot, drive.tensioners[t].at
    dx, dy = at[0] - pivot[0], at[1] - pivot[1]
    cosine, sine = math.cos(angle), math.sin(angle)
    return cosine * dx - sine * dy, sine * dx + cosine * dy
