"""The chain's path: pitch circles joined by common tangents, the wrapped angles and the straight strands.

A chain that turns with sign w (+1 counter-clockwise, -1 clockwise) about a sprocket at c with pitch radius R, and
leaves it along the unit vector u with left normal n, leaves at c - w R n, since the sprocket lies on its left for
w = +1. For the strand from sprocket k to sprocket l, of length S, both tangent points give

    c_l - c_k = S u + h n,   h = w_l R_l - w_k R_k,                         (a)
    S = sqrt(|c_l - c_k|^2 - h^2),   u = (S D - h D') / |D|^2,               (b)

D = c_l - c_k and D' = D turned by +90 degrees: the outer tangent for equal wraps, the inner one for opposite wraps.
The wrapped angle of a sprocket is w (heading that leaves - heading that arrives), taken in (0, 2 pi).

Where guides reach into a strand it is the taut string around them (`warpchain.assembly.taut`) instead of a tangent.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly.guided import Placed, Run, obstacles, obstructed
from warpchain.assembly.taut import Arc, Taut, TautError, circle, taut
from warpchain.drive.each import joined
from warpchain.drive.mounts import initial_center
from warpchain.drive.stack import picked, size_of
from warpchain.errors import DriveError

if TYPE_CHECKING:
    from warpchain.drive import Drive

MAX_STRAIN = 0.05
"""Largest nominal strain of a chain that counts as fitting its path, taut or slack."""

Found = TypeVar("Found")

_NO_WRAP = 1e-9  # rad
_NOT_STACKED = ("strings", "obstacles", "arm_angle")


@dataclass(frozen=True)
class ChainPath:
    """The path of a drive's chain along pitch circles and common tangents; S sprockets, as many strands.

    Strand k leaves sprocket k and reaches sprocket k + 1 (mod S). The paths of a stack of V variants
    (`warpchain.drive.stack`) are one, `path[v]` that of variant v: all numbers and arrays but those of guides and arms,
    which are one variant's own, then have a first axis more.

    Attributes:
        pitch: mean unloaded length of the chain's links [m].
        radius: (S,) radii at which the rollers ride [m]: the pitch radii, or more where wear has lengthened the chain.
        wrap_angle: (S,) wrapped angles [rad], each in (0, 2 pi).
        arrival_angle: (S,) polar angle about the sprocket's center at which the path arrives on it [rad].
        turning: angle by which the path turns in one round [rad], counter-clockwise positive: +-2 pi for a loop that
            does not cross itself, 0 for a crossed pair.
        strand_start: (S, 2) point where strand k leaves sprocket k [m].
        strand_end: (S, 2) point where strand k reaches sprocket k + 1 [m].
        strand_length: (S,) lengths as links measure them [m]: straight ones, and on a guide's arc those of chords of
            a pitch (`Taut.chain_length`).
        wrapped_pitches: pitches on all wrapped arcs, the sum of wrapped angle over pitch angle.
        nominal_strain: strain of the strands' links for the drive's number of links; infinite where the wrapped arcs
            alone take more.
        strings: (S,) the way around the guides that strand k touches; None where it touches none and is straight.
        obstacles: (S,) the guides that strand k meets or could meet, empty where it meets none.
        arm_angle: (A,) angles of the arms [rad].
    """

    pitch: float
    radius: NDArray[np.float64]
    wrap_angle: NDArray[np.float64]
    arrival_angle: NDArray[np.float64]
    turning: float
    strand_start: NDArray[np.float64]
    strand_end: NDArray[np.float64]
    strand_length: NDArray[np.float64]
    wrapped_pitches: float
    nominal_strain: float
    strings: tuple[Taut | None, ...]
    obstacles: tuple[tuple[Run, ...], ...]
    arm_angle: NDArray[np.float64]

    def __getitem__(self, variants: int | NDArray[np.int64]) -> ChainPath:
        """That of one variant, or those of some, of a stack's."""
        own = {
            field.name: getattr(self, field.name)[variants] for field in fields(self) if field.name not in _NOT_STACKED
        }
        if not isinstance(variants, np.ndarray):
            own |= {name: float(own[name]) for name in ("pitch", "turning", "wrapped_pitches", "nominal_strain")}
        return replace(self, **own)

    def free_lengths(self, k: int) -> tuple[float, ...]:
        """Lengths of strand k's straight parts that lie on no guide, in order [m]; the whole strand without guides."""
        string = self.strings[k]
        return (float(self.strand_length[k]),) if string is None else string.free

    def strain(self, links: int) -> float:
        """Nominal strain of the strands if the chain had `links` links.

        It solves sum(wrap angle / pitch angle) + sum(strand length) / (pitch (1 + strain)) = links; infinite where the
        wrapped arcs alone take as many links or more.
        """
        free = links - self.wrapped_pitches
        return float(self.strand_length.sum()) / self.pitch / free - 1.0 if free > 0.0 else math.inf

    def fitting_links(self) -> tuple[int, ...]:
        """Every number of links whose nominal strain is within `MAX_STRAIN`, ascending; empty where there is none."""
        straight = float(self.strand_length.sum()) / self.pitch
        fewest = math.ceil(self.wrapped_pitches + straight / (1.0 + MAX_STRAIN))
        most = math.floor(self.wrapped_pitches + straight / (1.0 - MAX_STRAIN))
        return tuple(links for links in range(fewest, most + 1) if abs(self.strain(links)) <= MAX_STRAIN)


def path_at(drive: Drive, arm_angle: Sequence[float]) -> ChainPath:
    """The path of the drive's chain with its arms at angles (A,) [rad]; its number of links need not fit.

    Raises:
        DriveError: where pitch circles overlap, a sprocket is not wrapped or is wrapped by a chain that meets itself,
            or a strand passes through another sprocket; the message names the sprockets.
    """
    return Plan(drive).path(arm_angle)[0]


class Obstructed(Exception):
    """Chains of some variants of a stack go around guides or on arms, which is worked out for one variant alone.

    Attributes:
        which: (V,) those variants.
    """

    def __init__(self, which: NDArray[np.bool_]) -> None:
        super().__init__()
        self.which = which


def in_parts(drive: Drive, worked_out: Callable[[Drive], Found]) -> list[tuple[NDArray[np.int64], Found]]:
    """What is worked out of a stack, in parts: which of its variants (K,), and what of them.

    Those that are `Obstructed` are parts of one.
    """
    every = np.arange(size_of(drive))
    try:
        return [(every, worked_out(drive))]
    except Obstructed as around:
        free, others = np.flatnonzero(~around.which), np.flatnonzero(around.which)
    found = [(free, worked_out(picked(drive, free)))] if len(free) else []
    return found + [(np.array([v]), worked_out(picked(drive, int(v)))) for v in others]


def allowed_parts(drive: Drive, worked_out: Callable[[Drive], Found]) -> list[tuple[NDArray[np.int64], Found]]:
    """What is worked out of a stack as by `in_parts`, without the variants that are refused; these cost halvings."""
    try:
        return in_parts(drive, worked_out)
    except DriveError:
        count = size_of(drive)
    if count == 1:
        return []
    found = []
    for half in np.array_split(np.arange(count), 2):
        own = picked(drive, half if len(half) > 1 else int(half[0]))
        found += [(half[places], part) for places, part in allowed_parts(own, worked_out)]
    return found


class Plan:
    """What of a drive's path does not hang on its arms' angles: pitch circles, common tangents, guides as drawn.

    Args:
        drive: one, or a stack.

    Raises:
        DriveError: where pitch circles overlap; of the first such variant.
        Obstructed: a stack of which some go around guides.
    """

    def __init__(self, drive: Drive) -> None:
        sprockets = drive.sprockets
        self.drive = drive
        self.pitch = np.atleast_2d(drive.chain.pulled_lengths).mean(axis=-1)
        centers = [np.atleast_2d(initial_center(sprocket)) for sprocket in sprockets]
        self.center = center = np.stack(np.broadcast_arrays(*centers), axis=1)
        self.radius = radius = np.atleast_2d(joined([drive.riding_radius(s) for s in range(len(sprockets))]))
        self.sign = sign = np.array([sprocket.sign for sprocket in sprockets], dtype=float)
        self.teeth = np.array([sprocket.teeth for sprocket in sprockets], dtype=float)
        variants = size_of(drive)
        if drive.arms and variants > 1:
            raise Obstructed(np.ones(variants, dtype=bool))
        self.pitch = np.broadcast_to(self.pitch, variants)
        self.center = center = np.broadcast_to(center, (variants, *center.shape[1:]))
        self.radius = radius = np.broadcast_to(radius, (variants, *radius.shape[1:]))
        _check_tips(drive, radius)
        _check_apart(drive, center, radius)

        span = _next(center) - center
        lateral = _next(sign * radius) - sign * radius
        square = np.einsum("vsi,vsi->vs", span, span)
        self.length = np.sqrt(square - lateral**2)
        ahead = self.length[..., None] * span - lateral[..., None] * _left(span)
        self.direction = ahead / square[..., None]
        arm = (sign * radius)[..., None]
        normal = _left(self.direction)
        self.start, self.end = center - arm * normal, _next(center) - _next(arm) * normal

        self.leaving = np.arctan2(self.direction[..., 1], self.direction[..., 0])
        self.arriving = np.roll(self.leaving, 1, axis=1)
        self.placed = self._obstacles()
        circles = zip(center[0].tolist(), radius[0].tolist(), sign.tolist(), strict=True)
        self.ends = [circle(c, r, w) for c, r, w in circles]
        self.known: dict[int, Taut | None] = {}  # the strings that no arm can move, once they are found

    def _obstacles(self) -> tuple[Placed, ...]:
        """The guides that strands may have to go around; of a stack, none."""
        if not self.drive.guides:
            return ()
        which = obstructed(self.drive, self.start, self.end)
        if len(which) > 1 and which.any():
            raise Obstructed(which)
        if not which.any():
            return ()
        ends = zip(self.start[0].tolist(), self.end[0].tolist(), strict=True)
        return obstacles(self.drive, [((a[0], a[1]), (b[0], b[1])) for a, b in ends])

    def path(self, arm_angle: Sequence[float]) -> ChainPath:
        """The path with the arms at angles (A,) [rad], as that of a stack.

        Raises:
            DriveError: as `path_at`.
        """
        drive, ends, sign = self.drive, self.ends, self.sign
        start, end, length = self.start.copy(), self.end.copy(), self.length.copy()
        leaving, arriving = self.leaving.copy(), self.arriving.copy()
        met = tuple(
            tuple(placed.standing(arm_angle) for placed in self.placed if placed.strand == k) for k in range(len(ends))
        )
        strings = tuple(self._string(k, runs) for k, runs in enumerate(met))
        for k, string in enumerate(strings):
            if string is not None:
                following = (k + 1) % len(strings)
                leaving[:, k], arriving[:, following] = string.first, string.last
                start[:, k], end[:, k] = ends[k].at(string.first), ends[following].at(string.last)
                length[:, k] = string.chain_length(float(self.pitch[0]))
        wrap = np.mod(sign * (leaving - arriving), 2.0 * math.pi)
        _check_wraps(drive, wrap, 2.0 * math.pi / self.teeth)
        free = [k for k, string in enumerate(strings) if string is None]
        _check_clear(self, start, length, free)

        wrapped = np.sum(wrap * self.teeth, axis=-1) / (2.0 * math.pi)
        return ChainPath(
            pitch=self.pitch,
            radius=self.radius,
            wrap_angle=wrap,
            arrival_angle=arriving - sign * (0.5 * math.pi),
            turning=2.0 * math.pi * np.rint(np.sum(sign * wrap, axis=-1) / (2.0 * math.pi)),
            strand_start=start,
            strand_end=end,
            strand_length=length,
            wrapped_pitches=wrapped,
            nominal_strain=_strain(drive.chain.links, wrapped, length.sum(axis=-1) / self.pitch),  # type: ignore[arg-type]  # (V,)
            strings=strings,
            obstacles=met,
            arm_angle=np.array(arm_angle, dtype=float),
        )

    def _string(self, k: int, runs: tuple[Run, ...]) -> Taut | None:
        """The way of strand k around its guides."""
        if k not in self.known:
            string = _string(self.drive, self.ends[k], self.ends[(k + 1) % len(self.ends)], runs)
            if any(placed.strand == k and placed.arm is not None for placed in self.placed):
                return string
            self.known[k] = string
        return self.known[k]


def _string(drive: Drive, first: Arc, last: Arc, runs: tuple[Run, ...]) -> Taut | None:
    """The way of a strand around its guides; None where it touches none."""
    if not runs:
        return None
    try:
        string = taut(first, last, runs)
    except TautError as error:
        raise DriveError(f"guides.{drive.guides[error.guide].name}: {error}") from None
    return string if string.touches else None


def check_fit(drive: Drive, path: ChainPath) -> None:
    """Checks that the drive's number of links fits its path; of a stack's, that of the first that it does not fit.

    Raises:
        DriveError: if the nominal strain is beyond `MAX_STRAIN`; the message names the numbers of links that fit, and
            the strain that each of the nearest ones gives.
    """
    wrong = np.atleast_1d(~(np.abs(path.nominal_strain) <= MAX_STRAIN))
    if not wrong.any():
        return
    path = path[int(wrong.argmax())] if path.radius.ndim > 1 else path
    fitting = path.fitting_links()
    best = round(path.wrapped_pitches + float(path.strand_length.sum()) / path.pitch)
    if fitting:
        best = min(fitting, key=lambda links: abs(path.strain(links)))
        span = f"{fitting[0]} to {fitting[-1]}, best {best}" if len(fitting) > 1 else str(best)
    else:
        span = "none"
    nearest = ", ".join(f"{links}: {_percent(path.strain(links))}" for links in (best - 1, best, best + 1))
    crossing = ""
    if abs(path.turning) != 2.0 * math.pi:
        most = int(np.argmax(path.wrap_angle))
        crossing = (
            f"; the path crosses itself, turning {math.degrees(path.wrap_angle[most]):.4g} degrees around sprocket "
            f'"{drive.sprockets[most].name}": look at its center and wrap'
        )
    raise DriveError(
        f"chain.links = {drive.chain.links}: does not fit the path, strain {_percent(path.nominal_strain)}, allowed is "
        f"{-100.0 * MAX_STRAIN:g} % to {100.0 * MAX_STRAIN:+g} %; links that fit: {span} "
        f"(strain by links: {nearest}){crossing}"
    )


def _strain(links: int, wrapped: Any, straight: Any) -> NDArray[np.float64]:
    free = np.asarray(links - wrapped)
    with np.errstate(divide="ignore"):
        return np.where(free > 0.0, straight / free - 1.0, math.inf)


def _of(value: Any, v: int) -> float:
    """A number of variant v, which a stack has one or V of."""
    return float(value[v]) if isinstance(value, np.ndarray) else float(value)


def _percent(strain: float) -> str:
    return f"{100.0 * strain:+.3f} %" if math.isfinite(strain) else "too short to go round"


def _next(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.roll(values, -1, axis=1)


def _left(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.stack([-vectors[..., 1], vectors[..., 0]], axis=-1)


def _check_tips(drive: Drive, radius: NDArray[np.float64]) -> None:
    for s, sprocket in enumerate(drive.sprockets):
        tips = np.atleast_1d(drive.tip_radius(s))
        over = radius[:, s] > tips
        if over.any():
            v = int(over.argmax())
            tip = float(tips[min(v, len(tips) - 1)])
            limit = 2.0 * tip * math.sin(math.pi / sprocket.teeth)
            raise DriveError(
                f'sprocket "{sprocket.name}": links of {_of(drive.chain.worn_pitch, v):.6g} m would ride over its '
                f"tips, at {radius[v, s]:.6g} m against {tip:.6g} m; allowed are links of at most {limit:.6g} m"
            )


def _check_apart(drive: Drive, center: NDArray[np.float64], radius: NDArray[np.float64]) -> None:
    offset = center[:, :, None, :] - center[:, None, :, :]
    distance = np.hypot(offset[..., 0], offset[..., 1])
    reach = radius[:, :, None] + radius[:, None, :]
    for v, a, b in np.argwhere(np.triu(distance <= reach, 1)):
        first, second = drive.sprockets[a].name, drive.sprockets[b].name
        raise DriveError(
            f'sprockets "{first}" and "{second}": pitch circles overlap, no tangent joins them; their centers are '
            f"{distance[v, a, b]:.6g} m apart, allowed is more than the sum of pitch radii, {reach[v, a, b]:.6g} m"
        )


def _check_wraps(drive: Drive, wrap: NDArray[np.float64], pitch_angle: NDArray[np.float64]) -> None:
    for v, s in np.argwhere((wrap < _NO_WRAP) | (wrap > 2.0 * math.pi - pitch_angle)):
        sprocket = drive.sprockets[s]
        degrees = math.degrees(wrap[v, s])
        allowed = 360.0 - math.degrees(pitch_angle[s])
        raise DriveError(
            f'sprocket "{sprocket.name}": with wrap = "{sprocket.wrap}" the chain turns {degrees:.4g} degrees around '
            f"it, allowed is more than 0 and at most {allowed:.4g}; it stands on the other side of the chain's path, "
            f"or its wrap is the other one"
        )


def _check_clear(plan: Plan, start: NDArray[np.float64], length: NDArray[np.float64], free: Sequence[int]) -> None:
    drive, direction = plan.drive, plan.direction
    count = len(drive.sprockets)
    if count < 3:
        return
    offset = plan.center[:, None, :, :] - start[:, :, None, :]  # strand, sprocket
    along = np.clip(np.einsum("vksi,vki->vks", offset, direction), 0.0, length[..., None])
    gap = offset - along[..., None] * direction[:, :, None, :]
    through = np.hypot(gap[..., 0], gap[..., 1]) < plan.radius[:, None, :]
    strand = np.arange(count)
    through[:, [k for k in range(count) if k not in free]] = False  # they go around guides
    through[:, strand, strand] = through[:, strand, (strand + 1) % count] = False
    for _, k, s in np.argwhere(through):
        raise DriveError(
            f'strand "{drive.strand_names[k]}": passes through the pitch circle of sprocket '
            f'"{drive.sprockets[s].name}"; allowed is a path clear of the other sprockets'
        )
