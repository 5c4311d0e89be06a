"""Balance of a drive's arms: angles at which chain, springs, weight, stops and tensioners hold them.

A frictionless chain of tension T = k p e, e the strain of its path, turns an arm by T (h_out - h_in), h the levers of
the tangents where it comes and goes (docs/guides-and-tensioners.md):

    T (h_out - h_in) - k_t (theta - theta_0) + m (r_c - p) x g + stops + sum of tensioners F l = 0.       (a)

A sprocket on the arm adds its weight and the pull of its strands.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from warpchain.assembly.guide_obstacles import place_on_arm
from warpchain.assembly.path import MAX_STRAIN, ChainPath, PathPlan, PathValues
from warpchain.drive.face_profile import unit_vector
from warpchain.drive.stack_math import (
    Condition,
    Number,
    UnlikeVariants,
    copysign,
    is_true_everywhere,
    maximum,
    minimum,
    ordered_sum,
    shared_value,
    sqrt,
    where,
)
from warpchain.errors import DriveError
from warpchain.model.mounts import moving_mass
from warpchain.model.oil import bottom_place, static_force

if TYPE_CHECKING:
    from warpchain.drive import Arm
    from warpchain.drive.tensioners import Tensioner
    from warpchain.model import ChainModel

FARTHEST = math.radians(90.0)
"""Farthest angle from drawing or stop at which an arm's balance is sought [rad]."""

AT_STOP = math.radians(1e-4)
"""Largest angle off a stop of an arm that stands on it [rad]."""

OFF = math.radians(0.01)
"""Least angle by which a chain that holds an arm turns it [rad]."""

LEAST_SQUARE = 1e-12
"""Least squared length of an arm's coil spring [m^2]."""

_STEP = math.radians(0.25)
_SWEEPS = 60
_SECANTS = 60
_FIRST = 1e-5  # rad
_LONGEST = math.radians(2.0)
_NEAR = 1e-11  # rad; the error after such a step is round-off
_LEAST_CHANGE = 1e-7  # rad; of smaller steps round-off spoils the slope
_STILL = 1e-11  # rad


def path_tension(model: ChainModel, path: ChainPath | PathValues, beyond: Number = 0.0) -> Number:
    """Tension of a chain on its path, strained by `beyond` more [N]; 0 where slack."""
    strain = minimum(path.nominal_strain, MAX_STRAIN) + beyond
    return model.chain.mean_stiffness * path.pitch * maximum(strain, 0.0)


class RestingTensioner:
    """Push of a tensioner on a resting arm: spring, oil, and its chamber's bottom."""

    def __init__(self, model: ChainModel, tensioner: Tensioner) -> None:
        self.at, self.unit_direction = tensioner.at, tensioner.unit_direction
        self.push, self.spring = static_force(tensioner), tensioner.spring_stiffness  # the push at the drawing [N]
        self.bottom, self.stop = bottom_place(tensioner), model.chain.stiffness

    def force(self, x: Number) -> Number:
        """Force of a tensioner at rest at an extension [N]."""
        return maximum(self.push - self.spring * x, 0.0) + self.stop * maximum(self.bottom - x, 0.0)

    def energy(self, x: float) -> float:
        """Potential energy of a tensioner at rest at an extension [J]."""
        reach = min(x, self.push / self.spring) if self.spring > 0.0 else x  # from where on it does not push
        found = 0.5 * self.spring * reach**2 - self.push * reach if self.push > 0.0 or self.spring > 0.0 else 0.0
        return found + 0.5 * self.stop * max(self.bottom - x, 0.0) ** 2

    def stiffness(self, x: float) -> float:
        """Stiffness of a tensioner at rest at an extension [N/m]."""
        return (self.spring if self.push > self.spring * x else 0.0) + (self.stop if x < self.bottom else 0.0)


class RestingCoil:
    """Coil spring of a resting arm."""

    def __init__(self, arm: Arm) -> None:
        spring, (px, py) = arm.spring, arm.pivot
        assert spring is not None
        (qx, qy), (fx, fy) = ((x - px, y - py) for x, y in (spring.at, spring.anchor))
        self.squares, self.inner, self.outer = (
            qx * qx + qy * qy + fx * fx + fy * fy,
            fx * qx + fy * qy,
            fx * qy - fy * qx,
        )
        self.stiffness, self.free_length = spring.stiffness, spring.free_length

    def _length(self, angle: Number) -> tuple[Number, Number, Number]:
        """Coil spring's length [m], and its ends' inner and cross product from the pivot [m^2]."""
        cosine, sine = unit_vector(angle)
        inner, outer = self.inner * cosine - self.outer * sine, self.outer * cosine + self.inner * sine
        return sqrt(maximum(self.squares - 2.0 * inner, LEAST_SQUARE)), inner, outer

    def moment(self, angle: Number) -> Number:
        """Moment of an arm's coil spring at the arm's angle [N m]."""
        length, _, outer = self._length(angle)
        return -self.stiffness * (length - self.free_length) * outer / length

    def energy(self, angle: float) -> float:
        """Potential energy of an arm's coil spring at the arm's angle [J]."""
        return float(0.5 * self.stiffness * (self._length(angle)[0] - self.free_length) ** 2)

    def torsional_stiffness(self, angle: float) -> float:
        """Torsional stiffness of an arm's coil spring at the arm's angle [N m/rad]."""
        length, inner, outer = self._length(angle)
        lever, tension = outer / length, self.stiffness * (length - self.free_length)
        return float(self.stiffness * lever**2 + tension * (inner - lever**2) / length)


class RestingArm:
    """Moments on a resting arm without the chain's: springs, weight, stops, tensioners."""

    def __init__(self, model: ChainModel, a: int) -> None:
        arm = model.arms[a]
        self.arm = arm
        self.gravity = model.run.gravity
        carried = [model.sprockets[s] for s in model.sprockets_on(a)]
        self.weights = [(arm.mass, arm.center), *((moving_mass(s), s.center) for s in carried)]  # as drawn
        self.tensioners = [RestingTensioner(model, t) for t in model.tensioners if t.on == arm.name]
        self.stop = 0.0 if arm.stops is None else model.stop_stiffness(a)
        self.coil = None if arm.spring is None else RestingCoil(arm)

    def moment(self, angle: Number) -> Number:
        """Moment on an arm without the chain's, at the arm's angle [N m]."""
        return self.joint_moment(angle, self.weight_moment(angle))

    def weight_moment(self, angle: Number) -> Number:
        """Moment of an arm's weight about its pivot [N m]."""
        (gx, gy), found = self.gravity, 0.0
        for mass, center in self.weights:
            x, y = self._place_from_pivot(center, angle)
            found = found + mass * (x * gy - y * gx)
        return found

    def joint_moment(self, angle: Number, beside: Number = 0.0) -> Number:
        """Moment of an arm's springs, stops and tensioners, plus `beside`, at its angle to its parent [N m]."""
        found = (
            beside
            - self.arm.stiffness * (angle - self.arm.free_angle_rad)
            - self.stop * self.excess_beyond_stops(angle)
        )
        if self.coil is not None:
            found = found + self.coil.moment(angle)
        for tensioner in self.tensioners:
            lever, _ = self._levers(tensioner, angle)
            found = found + lever * tensioner.force(self.extension(tensioner, angle))
        return found

    def energy(self, angle: float) -> float:
        """Potential energy of an arm without the chain, at the arm's angle [J]."""
        arm = self.arm
        found = 0.5 * arm.stiffness * (angle - arm.free_angle_rad) ** 2 - self.weight_work(angle)
        found += 0.5 * self.stop * self.excess_beyond_stops(angle) ** 2
        found += 0.0 if self.coil is None else self.coil.energy(angle)
        return found + sum(tensioner.energy(self.extension(tensioner, angle)) for tensioner in self.tensioners)

    def stiffness(self, angle: float) -> float:
        """Torsional stiffness of an arm without the chain's [N m/rad]."""
        arm = self.arm
        found = self.weight_work(angle) + arm.stiffness + (self.stop if self.excess_beyond_stops(angle) else 0.0)
        found += 0.0 if self.coil is None else self.coil.torsional_stiffness(angle)
        for tensioner in self.tensioners:
            lever, change = self._levers(tensioner, angle)
            extended = self.extension(tensioner, angle)
            found += tensioner.stiffness(extended) * lever**2 - tensioner.force(extended) * change
        return found

    def excess_beyond_stops(self, angle: Number) -> Number:
        """Angle of an arm beyond its stops [rad], above 0 beyond the upper one."""
        low, high = self.arm.stops_rad
        return maximum(angle - high, 0.0) - maximum(low - angle, 0.0)

    def extension(self, tensioner: Tensioner | RestingTensioner, angle: Number) -> Number:
        """Extension of an arm's tensioner at the arm's angle [m]."""
        (x, y), (ux, uy) = self._place_from_pivot(tensioner.at, angle), tensioner.unit_direction
        (px, py), (ax, ay) = self.arm.pivot, tensioner.at
        return (x + px - ax) * ux + (y + py - ay) * uy

    def weight_work(self, angle: float) -> float:
        """Work of an arm's weight up to an angle [J]."""
        found, (gx, gy) = 0.0, self.gravity
        for mass, center in self.weights:
            x, y = self._place_from_pivot(center, angle)
            found += mass * (x * gx + y * gy)
        return found

    def _levers(self, tensioner: RestingTensioner, angle: Number) -> tuple[Number, Number]:
        """Lever of an arm's tensioner about the pivot [m], and its derivative by the angle [m/rad]."""
        (x, y), (ux, uy) = self._place_from_pivot(tensioner.at, angle), tensioner.unit_direction
        return x * uy - y * ux, -(x * ux + y * uy)

    def _place_from_pivot(self, place: Sequence[float], angle: Number) -> tuple[Number, Number]:
        """Vector from an arm's pivot to a drawn place, turned by an angle [m]."""
        (px, py), (cosine, sine) = self.arm.pivot, unit_vector(angle)
        dx, dy = place[0] - px, place[1] - py
        return cosine * dx - sine * dy, sine * dx + cosine * dy


def is_unloaded_arm(model: ChainModel, a: int, angle: float) -> bool:
    """Whether an arm stands, within `OFF`, at its balance without a chain."""
    still = RestingArm(model, a)
    return abs(still.moment(angle)) <= OFF * abs(still.stiffness(angle))


def stop_name(model: ChainModel, a: int, angle: float) -> str | None:
    """Stop on which arm a stands: "lower", "upper" or None."""
    lower, upper = has_reached_stops(model.arms[a], angle)
    return "lower" if lower else "upper" if upper else None


def has_reached_stops(arm: Arm, angle: Number) -> tuple[Condition, Condition]:
    """Whether an arm stands on its lower stop, and on its upper one."""
    low, high = arm.stops_rad
    return angle <= low + AT_STOP, angle >= high - AT_STOP


def chain_moment(
    model: ChainModel,
    path: ChainPath | PathValues,
    a: int,
    beyond: Number = 0.0,
    pivot: tuple[Number, Number] | None = None,
) -> Number:
    """Moment of the chain on arm a and arms on it, about its drawn pivot or `pivot` [N m]."""
    pivot = model.arms[a].pivot if pivot is None else pivot
    levers = 0.0
    for arm in (a, *model.arms_on(a)):
        levers = levers + ordered_sum(string.levers(model.guides_of(arm), pivot) for string in path.strings if string)
        levers = levers + ordered_sum(_strand_pull_lever(model, path, s, pivot) for s in model.sprockets_on(arm))
    return path_tension(model, path, beyond) * levers


def _strand_pull_lever(model: ChainModel, path: ChainPath | PathValues, s: int, pivot: tuple[Number, Number]) -> Number:
    """Lever of sprocket s' two strands about an arm's pivot, moment over tension [m]."""
    px, py = pivot
    if isinstance(path, PathValues):
        (x, y), (ax, ay), (bx, by) = path.center[s], path.end[s - 1], path.start[s]
    else:
        (x, y), (ax, ay), (bx, by) = path.center[s], path.strand_end[s - 1], path.strand_start[s]
    turned = (x - px) * (bx - ax) + (y - py) * (by - ay)
    return model.sprockets[s].sign * turned / model.riding_radius(s)


class ArmBalance:
    """Solver for the arms' angles in balance with the chain, (a).

    Raises:
        DriveError, UnlikeVariants: as `PathPlan`.
    """

    def __init__(self, model: ChainModel) -> None:
        self.plan = PathPlan(model)
        self.still = [RestingArm(model, a) for a in range(len(model.arms))]
        self.slopes: dict[int, Number] = {}  # of the moments by the angles, as last found [N m/rad]

    def path(self, beyond: Number = 0.0, angles: Sequence[Number] | None = None) -> ChainPath:
        """Chain path with all arms in balance, with the first axis of a stack.

        Args:
            beyond: strain beyond the nominal one [-].
            angles: (A,) first guess, None as drawn [rad].

        Raises:
            DriveError: an arm without a balance; or as `path_at`.
            UnlikeVariants: balances found in unlike ways.
        """
        found: list[Number] = [0.0] * len(self.still) if angles is None else list(angles)
        for a, still in enumerate(self.still):
            low, high = still.arm.stops_rad
            found[a] = minimum(maximum(found[a], low), high)
        for _ in range(_SWEEPS):
            before = list(found)
            for a in range(len(found)):
                found[a] = self._balanced_angle(found, a, beyond)
            moved = [abs(x - y) for x, y in zip(found, before, strict=True)]
            if len(found) == 1 or shared_value(maximum(*moved) <= _STILL):
                break
        return self.plan.path(found)

    def _balanced_angle(self, angles: Sequence[Number], a: int, beyond: Number) -> Number:
        """Angle of arm a in balance, the other arms fixed [rad]."""
        model = self.plan.model

        def moment(angle: Number) -> Number:
            """Moment on the arm, chain included [N m]."""
            course = self.plan.path_values([*angles[:a], angle, *angles[a + 1 :]])
            return self._moment_without_chain(angles, a, angle) + chain_moment(
                model, course, a, beyond, self._pivot(angles, a)
            )

        quick = _secant_root(moment, angles[a], self.slopes.get(a))
        if quick is not None:
            angle, self.slopes[a] = quick
            return angle
        if self.plan.variants > 1:  # by halves, until those that it fails for are alone
            raise UnlikeVariants(np.arange(self.plan.variants) < self.plan.variants // 2)
        return _bracketed_root(moment, self.still[a].arm, angles[a])

    def _pivot(self, angles: Sequence[Number], a: int) -> tuple[Number, Number]:
        """Pivot of arm a with the arms at angles (A,) [m]."""
        model = self.plan.model
        return place_on_arm(model, model.parent(a), model.arms[a].pivot, angles)

    def _moment_without_chain(self, angles: Sequence[Number], a: int, angle: Number) -> Number:
        """Moment on arm a and arms on it without the chain's [N m]."""
        model, (gx, gy) = self.plan.model, self.plan.model.run.gravity
        if model.parent(a) is None and not model.arms_on(a):
            return self.still[a].moment(angle)
        found = self.still[a].joint_moment(angle)
        turned = [*angles[:a], angle, *angles[a + 1 :]]
        px, py = self._pivot(angles, a)
        for arm in (a, *model.arms_on(a)):
            for mass, place in self.still[arm].weights:
                x, y = place_on_arm(model, arm, place, turned)
                found = found + mass * ((x - px) * gy - (y - py) * gx)
        return found


def _bracketed_root(moment: Callable[[float], float], arm: Arm, near: float) -> float:
    """Angle at which an arm's moment is 0, bracketed from `near` [rad]."""
    from scipy.optimize import brentq  # slow to import

    low, high = arm.stops_rad
    start, here = near, moment(near)
    if here == 0.0:
        return near
    step = math.copysign(_STEP, here)
    reason = "the chain leaves it"
    while near + step - min(max(near, low), high) > -FARTHEST and abs(near) < FARTHEST + abs(start):
        try:
            there = moment(near + step)
        except DriveError as error:
            reason = str(error)
            break
        if here * there <= 0.0:
            return float(brentq(moment, *sorted((near, near + step)), xtol=1e-14, rtol=1e-14))
        near, here = near + step, there
    where = f"finds no balance from {math.degrees(start):.3g} to {math.degrees(near):.3g} degrees, {reason}"
    turns = "springs and tensioners that turn it"
    if arm.stops is None:
        raise DriveError(f"arms.{arm.name}.stops: missing; without them the arm {where}; or look at the {turns}")
    raise DriveError(f"arms.{arm.name}: {where}; look at its stops, and at the {turns}")


def _secant_root(
    moment: Callable[[Number], Number], near: Number, slope: Number | None = None
) -> tuple[Number, Number] | None:
    """Angle at which an arm's moment is 0 [rad], and its slope there [N m/rad]; None if secants fail.

    Args:
        moment: falls with the angle.
        near, slope: first guesses of both.
    """
    try:
        before, here = near, moment(near)
        change = where(here == 0.0, 0.0, copysign(_FIRST, here)) if slope is None else _newton_change(here, slope)
        angle, done = near + change, abs(change) <= _NEAR
        low, high = where(here > 0.0, near, -math.inf), where(here < 0.0, near, math.inf)
        steps = [math.inf, abs(change)]
        for _ in range(_SECANTS):
            if is_true_everywhere(done):
                return angle, slope
            last, here = here, moment(angle)
            far = abs(angle - before) > _LEAST_CHANGE
            secant = (here - last) / where(far, angle - before, 1.0)
            slope = where(far, secant, 0.0 if slope is None else slope)
            low, high = where(here > 0.0, maximum(low, angle), low), where(here < 0.0, minimum(high, angle), high)
            held = (low > -math.inf) & (high < math.inf)
            middle = 0.5 * (where(held, low, 0.0) + where(held, high, 0.0))
            if not is_true_everywhere(done | (here == 0.0) | (slope < 0.0) | held):
                return None
            change = _newton_change(here, slope)
            wanted = angle + change
            astray = (slope >= 0.0) | (wanted <= low) | (wanted >= high) | (abs(change) > 0.5 * steps.pop(0))
            change = where(held & astray & (abs(change) > _NEAR), middle - angle, change)
            change = where(done | (here == 0.0), 0.0, change)
            steps.append(abs(change))
            before, angle = angle, angle + change
            done = done | (abs(change) <= _NEAR)
    except DriveError:
        pass
    return None


def _newton_change(here: Number, slope: Number) -> Number:
    """Newton step of an arm's angle to balance [rad]; of slope -1 where the moment does not fall."""
    return maximum(-_LONGEST, minimum(_LONGEST, -here / where(slope < 0.0, slope, -1.0)))


def chain_path(model: ChainModel) -> ChainPath:
    """Path of a chain with arms in balance; links need not fit.

    Raises:
        DriveError: an arm without a balance; or as `path_at`.
    """
    return chain_paths(model)[0]


def chain_paths(model: ChainModel) -> ChainPath:
    """Paths of a stack's chains with arms in balance, as one with a first axis (V,).

    Raises:
        DriveError: as `chain_path`, of the first such variant.
        UnlikeVariants: some go around other arcs of guides.
    """
    return ArmBalance(model).path() if model.arms else PathPlan(model).path(())
