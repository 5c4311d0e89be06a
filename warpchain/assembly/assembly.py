"""Initial state of a drive: rollers of wrapped arcs on seats, strands drawn from seat to seat.

A slack strand of chord C is an arc of radius rho through its end seats, whose chords are its links of unloaded lengths
l_i. With 2 y_i the angle of link i at the arc's center, Y_i = y_1 + ... + y_i and Y the sum of all, roller i is at x_i
along the chord and h_i off it, towards gravity:

    2 rho sin(Y) = C,   sin(y_i) = l_i / (2 rho),                                               (a)
    x_i = C sin(Y_i) cos(Y - Y_i) / sin(Y),   h_i = C sin(Y_i) sin(Y - Y_i) / sin(Y).            (b)

The driver has a seat where the path arrives, or `run.phase` teeth further on.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpchain.argument_checks import check_arguments
from warpchain.assembly.arm_balance import ArmBalance, chain_path, chain_paths
from warpchain.assembly.link_laying import LayingCurve
from warpchain.assembly.path import MAX_STRAIN, ChainPath, check_fit
from warpchain.assembly.seating import Loop, Seating, seat_chain
from warpchain.assembly.strand_load import check_load_places
from warpchain.assembly.table_cells import initial_speed
from warpchain.assembly.taut_string import TautString
from warpchain.drive.body_ties import BodyTie, body_ties
from warpchain.drive.face_profile import unit_vector
from warpchain.drive.sprocket import ElasticMount, SliderMount
from warpchain.drive.stack_math import (
    Number,
    UnlikeVariants,
    array_of_columns,
    columns_of_table,
    has_arrays,
    hypot,
    is_true_everywhere,
    is_true_somewhere,
    maximum,
    power,
    shared_value,
    table_of_columns,
    where,
    with_last_axis,
)
from warpchain.errors import DriveError
from warpchain.model import ChainModel, Model
from warpchain.model.mounts import initial_velocity, is_on_springs, moving_mass, rim_angle, unit_direction
from warpchain.model.parts_between_chains import LedSprocket
from warpchain.model.stacks import pick_variants, variants_of_either
from warpchain.model.start_phase import motion_from_start_phase
from warpchain.model.trains import body_turning_sign

if TYPE_CHECKING:
    from warpchain.drive import Drive, Shaft, Sprocket

Array = NDArray[np.float64]

_STRAIGHT = 1e-12  # a strand this little slack is drawn straight
_BALANCES = 12  # of arms
_HANGS = 3  # of a weight on an end
_NEAR = 1e-8  # rad; an arm that has turned by no more is where secants leave round-off
_ROUGH, _FINE = 1e-10, 1e-13  # pitches that a further laying of links may change, at first and at last
KEYED = 0.05  # degrees; a key that misses by no more fits
_TIE = 1e-9  # of a pitch angle, gravity's direction or a strand's length: which way round-off must not decide


@dataclass(frozen=True)
class Assembly:
    """Assembled state of a drive: N rollers, S sprockets, A arms, H shafts; the chain travels to higher indices.

    Roller 0 is the first seated one of sprocket 0. States of V variants have a first axis more.

    Attributes:
        position: (N, 2) rollers [m].
        velocity: (N, 2) rollers [m/s].
        sprocket_angle: (S,) counter-clockwise [rad].
        sprocket_speed: (S,) counter-clockwise [rad/s].
        seat_sprocket: (N,) int32, sprocket on which the roller sits, -1 in a strand.
        seat_index: (N,) int32, its seat, or -1; seat j is at sprocket angle + j 2 pi / teeth.
        strand_first: (S,) roller on the last seat before strand k.
        strand_links: (S,) links of strand k, from seat to seat.
        strain: of the strands' links; below 0 a slack chain's shortfall of chord.
        arm_angle: (A,) counter-clockwise [rad]; 0 as drawn.
        shaft_speed: (H,) counter-clockwise [rad/s].
    """

    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    sprocket_angle: NDArray[np.float64]
    sprocket_speed: NDArray[np.float64]
    seat_sprocket: NDArray[np.int32]
    seat_index: NDArray[np.int32]
    strand_first: NDArray[np.int32]
    strand_links: NDArray[np.int32]
    strain: float
    path: ChainPath
    arm_angle: NDArray[np.float64]
    shaft_speed: NDArray[np.float64]

    def __getitem__(self, v: int) -> Assembly:
        """Assembled state of variant v of a stack."""
        found = self.pick_variants(v)
        return replace(found, strain=float(found.strain))

    def pick_variants(self, variants: int | NDArray[np.int64]) -> Assembly:
        """Assembled states of chosen variants of a stack."""
        return replace(self, **{field.name: getattr(self, field.name)[variants] for field in fields(self)})


@check_arguments(DriveError)
def assemble(drive: Drive) -> Assembly:
    """Initial state of a drive of one chain, before settling.

    Free sprockets and strands move at the driver's pitch-circle speed unless given their own.

    Raises:
        DriveError: a path that cannot be drawn, or a number of links that does not fit it.
    """
    return assemble_chain(Model(drive).chain)


def assemble_chain(model: ChainModel) -> Assembly:
    """Initial state of one chain, before settling; raises as `assemble`."""
    return assemble_stack(model)[0]


def assemble_stack(model: ChainModel) -> Assembly:
    """Initial states of a stack of drives, as one with a first axis (V,).

    Raises:
        DriveError: as `assemble`, of the first such variant.
        UnlikeVariants: some go around other arcs of guides.
    """
    path, seating, loop = _seated_stack(model)
    check_load_places(model, path)
    count, variants = model.chain.rollers, len(path.radius)
    angle, first_seat = _sprocket_angles(model, table_of_columns(seating.first_angle, variants))
    for s, sprocket in enumerate(model.sprockets):
        if sprocket.rim is not None:
            angle[:, s], first_seat[:, s] = rim_angle(sprocket), 0
    speed, shaft_speed = _starting_speeds(model, path, variants)
    _check_keyed_sprockets(model, angle)
    position, velocity = np.empty((variants, count, 2)), np.empty((variants, count, 2))
    seat_sprocket = np.full((variants, count), -1, dtype=np.int32)
    seat_index = np.full((variants, count), -1, dtype=np.int32)
    seats, links, first, last = (
        table_of_columns(column, variants) for column in (seating.seats, seating.links, seating.first, seating.last)
    )
    strain = np.atleast_1d(seating.strain)
    for alike in _seat_patterns(seats, links):
        at = _RollerPlacement(model, path, alike, count)
        like = 0 if isinstance(alike, slice) else alike[0]
        hangs = [sprocket.is_end and is_on_springs(sprocket) for sprocket in model.sprockets]
        for s in sorted(range(len(hangs)), key=hangs.__getitem__):  # on what holds its strand, which is in place
            sprocket = model.sprockets[s]
            if hangs[s]:
                k = max(s - 1, 0)
                at.hang_end(s, int(last[like, k]), int(links[like, k]))
            rollers = slice(first[like, s], last[like, s] + 1)
            seat = sprocket.sign * np.arange(seats[like, s]) + first_seat[alike, s, None]
            at.place_seated(s, rollers, angle[alike, s], speed[alike, s], seat % sprocket.teeth)
            seat_sprocket[alike, rollers], seat_index[alike, rollers] = s, seat % sprocket.teeth
        for k, own in enumerate(links[like].tolist()):
            begin, end = int(last[like, k]), int(first[like, (k + 1) % len(first[like])])
            strand = path.strings[k] and loop.string(seating, k)
            try:
                at.place_strand((begin, end, own), strain[alike], pick_variants(strand, alike))
            except UnlikeVariants as parted:
                raise parted.at_places(alike, variants) from None
        position[alike], velocity[alike] = at.position, at.velocity
    return Assembly(
        position=position,
        velocity=velocity,
        sprocket_angle=angle,
        sprocket_speed=speed,
        seat_sprocket=seat_sprocket,
        seat_index=seat_index,
        strand_first=last.astype(np.int32),
        strand_links=links.astype(np.int32),
        strain=strain,  # type: ignore[arg-type]  # (V,)
        path=path,
        arm_angle=path.arm_angle,
        shaft_speed=shaft_speed,
    )


Alike = NDArray[np.int64] | slice


def _seat_patterns(seats: NDArray[np.int64], links: NDArray[np.int64]) -> list[Alike]:
    """Groups of variants with equal numbers of seated rollers and links."""
    table = np.concatenate([seats, links], axis=1)
    if (table == table[0]).all():
        return [slice(None)]
    _, which = np.unique(table, axis=0, return_inverse=True)
    order = np.argsort(which.ravel(), kind="stable")
    return [*np.split(order, np.flatnonzero(np.diff(which.ravel()[order])) + 1)]


class _RollerPlacement:
    """Placement of rollers in the initial state, of K variants of one seat pattern.

    Attributes:
        position, velocity: (K, N, 2) [m], [m/s].
    """

    def __init__(self, model: ChainModel, path: ChainPath, alike: Alike, count: int) -> None:
        self.model, self.path, self.alike = model, path, alike
        self.radius, self.turning = path.radius[alike], np.asarray(path.turning)[alike]
        lengths = model.chain.pulled_lengths
        self.lengths = lengths[None] if lengths.ndim == 1 else lengths[alike]  # (1, N) or (K, N)
        self.position, self.velocity = (np.empty((len(self.radius), count, 2)) for _ in range(2))

    def _variant_column(self, value: Number) -> Number:
        """Column (K, 1) of an array (V,) for these variants; a number stays."""
        return value[self.alike][:, None] if has_arrays(value) else value

    def place_seated(self, s: int, rollers: slice, angle: Array, speed: Array, seat: NDArray[np.int64]) -> None:
        """Writes places and velocities of rollers seated on sprocket s, on seats (K, rollers)."""
        sprocket = self.model.sprockets[s]
        forth = np.where(np.arange(rollers.start, rollers.stop) % 2, 1.0, -1.0)
        lean = self._variant_column(sprocket.sign * self.model.riding_lean(s)) * forth
        polar = angle[:, None] + seat * (2.0 * math.pi / sprocket.teeth) + lean
        radius = self.radius[:, s, None]
        center, velocity = self.path.center[self.alike, s], initial_velocity(sprocket, self.model.pivot_table(s))
        across, up = radius * np.cos(polar), radius * np.sin(polar)
        self.position[:, rollers, 0] = center[:, 0, None] + across
        self.position[:, rollers, 1] = center[:, 1, None] + up
        if sprocket.rim is not None:
            rim = self._variant_column(sprocket.rim)
            across, up = rim * np.cos(polar), rim * np.sin(polar)
        self.velocity[:, rollers, 0] = self._variant_column(velocity[..., 0]) + speed[:, None] * -up
        self.velocity[:, rollers, 1] = self._variant_column(velocity[..., 1]) + speed[:, None] * across

    def hang_end(self, s: int, begin: int, links: int) -> None:
        """Moves an open chain's end to where its strand holds its weight and preload.

        Args:
            begin, links: of the strand.
        """
        sprocket, chain, held = self.model.sprockets[s], self.model.chain, begin + links if s == 0 else begin
        natural = np.take(self.lengths, np.arange(begin, begin + links) % self.lengths.shape[1], axis=1).sum(axis=1)
        gravity = np.concatenate([self._full_column(part) for part in self.model.run.gravity], axis=1)
        mount, from_held = sprocket.mount, self.path.center[self.alike, s] - self.position[:, held]
        off = from_held
        pull = self._full_column(moving_mass(sprocket)) * gravity
        if isinstance(mount, SliderMount):
            way = np.concatenate(
                [self._full_column(part) for part in np.moveaxis(unit_direction(mount.direction), -1, 0)], axis=1
            )
            pull = pull + self._full_column(mount.preload) * way
        else:
            pull = pull + np.concatenate([self._full_column(part) for part in mount.preload], axis=1)  # type: ignore[union-attr]
            way, off = pull / np.hypot(pull[:, :1], pull[:, 1:]), 0.0 * off
        slack = np.flatnonzero(~(np.einsum("ki,ki->k", pull, from_held) > 0.0))
        if len(slack):
            raise DriveError(
                f'sprocket "{sprocket.name}": its weight and preload do not pull at the chain, which would be slack; '
                "allowed is a place on that side of the chain to which they pull it"
            )
        ahead = np.einsum("ki,ki->k", off, way)
        chord = np.where(ahead == 0.0, 1.0, ahead / np.hypot(off[:, 0], off[:, 1])) if off.any() else np.ones(len(off))
        tension = np.einsum("ki,ki->k", pull, way) / chord
        own = 0.5 * links * self._full_column(chain.mass)[:, 0] * np.einsum("ki,ki->k", gravity, way)
        stiffness = self._full_column(chain.mean_stiffness)[:, 0]
        holes = 1 + self.model.sprockets[1 if s == 0 else s - 1].is_end
        length = natural + ((links + holes) * tension + links * own) / stiffness
        _check_stretch(sprocket, length / natural - 1.0)
        across = np.einsum("ki,ki->k", off, off) - ahead**2
        side = np.where(ahead < 0.0, -1.0, 1.0)
        moved = side * np.sqrt(np.maximum(length**2 - across, 0.0))
        self.path.center[self.alike, s] = self.position[:, held] + off + (moved - ahead)[:, None] * way

    def _full_column(self, value: Number) -> Array:
        """Column (K, 1) of a number or array (V,) for these variants."""
        return np.broadcast_to(np.asarray(self._variant_column(value), dtype=np.float64), (len(self.position), 1))

    def place_strand(self, span: tuple[int, int, int], strain: Array, string: TautString | None) -> None:
        """Writes places and velocities of a strand's rollers between its seated ends."""
        begin, end, links = span
        rollers = slice(begin + 1, begin + links)
        natural = np.take(self.lengths, np.arange(begin, begin + links) % self.lengths.shape[1], axis=1)
        position, velocity, gravity = self.position, self.velocity, self.model.run.gravity
        if string:
            around = _GuidedStrand(string, natural)
            pull = np.concatenate(
                [np.broadcast_to(self._variant_column(part), (len(position), 1)) for part in gravity], axis=1
            )
            position[:, rollers] = around.places(self.turning, pull)[:, 1:-1]
            velocity[:, rollers] = around.velocities(velocity[:, begin], velocity[:, end])
            return
        fraction = (np.cumsum(natural, axis=1) / natural.sum(axis=1, keepdims=True))[:, :-1]
        chord = position[:, end] - position[:, begin]
        slack = np.flatnonzero((strain < -_STRAIGHT) & (links > 1))
        bent: tuple[Array, Array] | None = None
        if len(slack):
            gx, gy = (np.broadcast_to(self._variant_column(part), (len(chord), 1))[slack] for part in gravity)
            own = np.broadcast_to(natural, (len(chord), links))[slack]
            bent = _sagging_places(chord[slack], own, self.turning[slack], np.concatenate([gx, gy], axis=1))
        for axis in range(2):
            first, final = velocity[:, begin, axis, None], velocity[:, end, axis, None]
            velocity[:, rollers, axis] = first + fraction * (final - first)
            place = fraction * chord[:, axis, None]
            if bent is not None:
                place[slack] = bent[axis]
            position[:, rollers, axis] = position[:, begin, axis, None] + place


def assembled_strains(model: ChainModel) -> tuple[ChainPath, Array]:
    """Chain paths of a stack and its assembled chains' strains (V,).

    Raises:
        DriveError, UnlikeVariants: as `assemble_stack`.
    """
    path, seating, _ = _seated_stack(model)
    return path, np.atleast_1d(seating.strain)


def assembled_path(model: ChainModel) -> ChainPath:
    """Path of an assembled chain, arms in balance with the seated chain.

    Raises:
        DriveError: as `assemble`, where there are arms; else as `chain_path`.
    """
    return _seated_stack(model)[0][0] if model.arms else chain_path(model)


def _seated_stack(model: ChainModel) -> tuple[ChainPath, Seating, Loop]:
    """Paths, seatings and sprocket loops of a stack, arms in balance."""
    if model.arms:
        return _seated_stack_with_arms(model)
    weights = [s for s, sprocket in enumerate(model.sprockets) if sprocket.is_end and is_on_springs(sprocket)]
    if len(weights) == 1:
        model = _with_hanging_end(model, weights[0])
    path = chain_paths(model)
    check_fit(model, path)
    loop = Loop(model, path)
    return path, seat_chain(model, path, loop), loop


def _seated_stack_with_arms(model: ChainModel) -> tuple[ChainPath, Seating, Loop]:
    """Paths, seatings and sprocket loops of a stack, arms in balance with the seated chains' strains."""
    balance, beyond = ArmBalance(model), 0.0
    path = balance.path()
    check_fit(model, path)
    loop, known, last = Loop(model, path), None, False  # last: this turn, or one before
    kept: tuple[Any, ChainPath, Seating] | None = None  # what is found of some, while others go on
    for turn in range(_BALANCES):
        seating = seat_chain(model, path, loop, where(last, _FINE, _ROUGH))
        if kept is not None:
            found, before, seated = kept
            path = variants_of_either(found, before, path)
            seating.set_variants(np.flatnonzero(found), seated.pick_variants(np.flatnonzero(found)))
            loop.use_path(path)
        if is_true_everywhere(last):
            break
        if is_true_somewhere(last):
            kept = last, path, seating
        (nominal,) = columns_of_table(np.asarray(path.nominal_strain)[:, None])
        off, slope = seating.strain - nominal - beyond, -1.0
        if known is not None:
            moved = where(beyond == known[0], 1.0, beyond - known[0])
            slope = (off - known[1]) / moved
            slope = where(abs(slope + 1.0) < 0.5, slope, -1.0)
            (turned,) = columns_of_table(np.abs(path.arm_angle - known[2]).max(axis=1)[:, None])
            if turn == _BALANCES - 1:
                break
            last = last | (abs(off / slope * turned / moved) <= _NEAR)
        known = beyond, off, path.arm_angle
        beyond = beyond - off / slope
        path = balance.path(beyond, columns_of_table(path.arm_angle))
    return path, seating, loop


def _check_stretch(sprocket: Sprocket, strain: Number) -> None:
    """Raises a DriveError where an open chain's end strains it too far."""
    most = float(np.max(strain))
    if not most <= MAX_STRAIN:
        raise DriveError(
            f'sprocket "{sprocket.name}": its weight and preload stretch the chain by {100.0 * most:.3g} %; allowed is '
            f"at most {100.0 * MAX_STRAIN:g} %: look at them and at chain.stiffness"
        )


def _with_hanging_end(model: ChainModel, s: int) -> ChainModel:
    """Model of an open chain, its hanging end s where its weight strains the strands."""
    for _ in range(_HANGS):
        path, sprocket, mount = chain_paths(model), model.sprockets[s], model.sprockets[s].mount
        k = 0 if s == 0 else s - 1
        chord = (path.strand_end[:, k] - path.strand_start[:, k]) * (-1.0 if s == 0 else 1.0)
        along = columns_of_table(chord / np.hypot(chord[:, :1], chord[:, 1:]))
        preload = mount.preload if isinstance(mount, ElasticMount) else (0.0, 0.0)
        pull = [moving_mass(sprocket) * g + f for g, f in zip(model.run.gravity, preload, strict=True)]
        if isinstance(mount, SliderMount):
            way = [of if of.ndim else float(of) for of in np.moveaxis(unit_direction(mount.direction), -1, 0)]
            off = way[0] * along[0] + way[1] * along[1]
            tension = (pull[0] * way[0] + pull[1] * way[1] + mount.preload) / off
        else:
            way, off = along, 1.0
            tension = pull[0] * along[0] + pull[1] * along[1]
        straight, wrapped = (columns_of_table(np.asarray(of)[:, None])[0] for of in (
            path.strand_length.sum(axis=1), path.wrapped_pitches))  # fmt: skip
        (pitch,) = columns_of_table(np.asarray(path.pitch)[:, None])
        strain = maximum(tension, 0.0) / (model.chain.mean_stiffness * pitch)
        _check_stretch(sprocket, strain)
        moved = ((model.chain.links - wrapped) * pitch * (1.0 + strain) - straight) / off
        (x, y), ends = sprocket.center, list(model.sprockets)
        ends[s] = sprocket.model_copy(update={"center": (x + moved * way[0], y + moved * way[1])})
        model = replace(model, sprockets=tuple(ends))
    return model


class _GuidedStrand:
    """Rollers of a strand on guides: on its string, a slack one sagging in the longest straight part.

    Args:
        natural: (1, links) or (K, links) lengths of links [m].
    """

    def __init__(self, string: TautString, natural: Array) -> None:
        self.string, self.curve = string, LayingCurve(string.pieces)
        self.links = natural[0] if len(natural) == 1 else natural
        self.scale = self.curve.scale(self.links)
        self.at = self.curve.places(with_last_axis(self.scale) * self.links)

    def places(self, turning: Array, gravity: Array) -> Array:
        """Places of a guided strand's rollers, ends included (K, links + 1, 2) [m].

        Args:
            turning: (K,) of the path [rad].
        """
        curve, points = self.curve, _rows_of_variants(self.curve.points(self.at), len(turning))
        if not shared_value(self.scale < 1.0 - _STRAIGHT):
            return points
        longest, near = curve.longest, _TIE * curve.length
        low, high = curve.begins[longest] - near, curve.ends[longest] + near
        inner = np.atleast_2d(array_of_columns([(low <= s) & (s <= high) for s in self.at]))
        a, count = shared_value(inner.argmax(axis=1)), shared_value(inner.sum(axis=1))
        if count <= 2:
            return points
        b, back = a + int(count) - 1, curve.reversed_curve()
        ahead = _rows_of_variants(curve.points(curve.places(self.links)), len(turning))
        behind = _rows_of_variants(back.points(back.places(self.links[..., ::-1])), len(turning))[:, ::-1]
        points[:, : a + 1], points[:, b:] = ahead[:, : a + 1], behind[:, b:]
        natural = _rows_of_variants(self.links[..., a:b], len(turning), 1)
        bent = _sagging_places(points[:, b] - points[:, a], natural, turning, gravity)
        points[:, a + 1 : b] = points[:, a, None] + np.stack(bent, axis=2)
        return points

    def velocities(self, begin: Array, end: Array) -> Array:
        """Velocities of a guided strand's inner rollers (K, links - 1, 2), from its ends' [m/s]."""
        share = np.linspace(0.0, 1.0, len(self.at))[1:-1]
        ends = (np.hypot(ends[:, 0], ends[:, 1])[:, None] for ends in (begin, end))
        speed = (1.0 - share) * next(ends) + share * next(ends)
        heading = np.atleast_2d(array_of_columns([self.curve.at(s)[1] for s in self.at[1:-1]]))
        x, y = unit_vector(self.string.first)
        sense = np.where(begin[:, 0] * x + begin[:, 1] * y >= 0.0, 1.0, -1.0)
        return np.asarray((sense[:, None] * speed)[..., None] * np.stack([np.cos(heading), np.sin(heading)], axis=2))


def _rows_of_variants(values: Array, count: int, axes: int = 2) -> Array:
    """Rows (K, ...) of strand values for `count` variants."""
    return np.array(np.broadcast_to(values, (count, *values.shape[values.ndim - axes :])))


def _sprocket_angles(model: ChainModel, first_angle: Array) -> tuple[Array, NDArray[np.int64]]:
    """Sprocket angles within half a pitch angle of zero [rad], and first rollers' seats, each (V, S)."""
    pitch_angle = 2.0 * math.pi / np.array([sprocket.teeth for sprocket in model.sprockets])
    seat = np.ceil(first_angle / pitch_angle - 0.5 - _TIE).astype(np.int64)
    return first_angle - seat * pitch_angle, seat


def _check_keyed_sprockets(model: ChainModel, angle: Array) -> None:
    """Raises a DriveError for keyed sprockets on which the chain seats at other angles."""
    for s, sprocket in enumerate(model.sprockets):
        if sprocket.key is not None:
            pitch = 360.0 / sprocket.teeth
            seated = np.degrees(angle[:, s])
            wrong = np.flatnonzero(np.abs((seated - sprocket.key + 0.5 * pitch) % pitch - 0.5 * pitch) > KEYED)
            if len(wrong):
                key = float(np.broadcast_to(sprocket.key, seated.shape)[wrong[0]])
                raise DriveError(
                    f"sprockets.{sprocket.name}.key = {key:g}: the chain seats at {seated[wrong[0]]:.4f} degrees and "
                    f"whole teeth of {pitch:.4f} degrees from there; one of these, or run.phase, would fit"
                )


def _starting_speeds(model: ChainModel, path: ChainPath, variants: int) -> tuple[Array, Array]:
    """Initial angular velocities (V, S) of sprockets and (V, H) of shafts [rad/s]."""
    count = len(model.sprockets)
    known: dict[int, Number] = {}
    parts: list[Sprocket | Shaft] = [*model.sprockets, *model.shafts]
    for b, part in enumerate(parts):
        if part.prescribed is not None:
            known[b] = body_turning_sign(model, b) * _prescribed_speed(model, part)
    for b, shaft in enumerate(model.shafts, count):
        if shaft.initial_speed is not None:
            known[b] = body_turning_sign(model, b) * shaft.initial_speed
    tied, before = body_ties(model), -1
    while len(known) > before:
        before = len(known)
        _spread_speeds(known, [tie for tie in tied if tie.kind != "couplings"])
        first = next((s for s in (model.driver, *range(count)) if s in known), None)
        if first is not None and len(known) == before:
            travel = model.sprockets[first].sign * known[first] * path.radius[:, first]
            for s, sprocket in enumerate(model.sprockets):
                if not sprocket.is_end:
                    known.setdefault(s, sprocket.sign * (travel / path.radius[:, s]))
        if len(known) == before:
            _spread_speeds(known, tied)
    speeds = [known.get(b, 0.0) for b in range(count + len(model.shafts))]
    shafts = speeds[count:]
    return table_of_columns(speeds[:count], variants), table_of_columns(shafts, variants) if shafts else np.empty(
        (variants, 0)
    )


def _spread_speeds(known: dict[int, Number], tied: Sequence[BodyTie]) -> None:
    """Adds to `known` the initial speeds of bodies tied to those in it."""
    for tie in tied:
        if tie.a in known and tie.b not in known:
            known[tie.b] = float(tie.ratio) * known[tie.a]
        elif tie.b in known and tie.a not in known:
            known[tie.a] = known[tie.b] / float(tie.ratio)


def _prescribed_speed(model: ChainModel, turned: Sprocket | Shaft) -> Number:
    """Prescribed forward speed of a body at t = 0 [rad/s]; 0 if ramped up."""
    motion = turned.prescribed
    if motion is None or is_true_somewhere(motion.ramp_time > 0.0):
        return 0.0
    motion = turned.driver if isinstance(turned, LedSprocket) else motion_from_start_phase(model, turned, motion)
    speed = initial_speed(motion.table) if motion.table is not None else motion.top_speed
    speed = speed * (1.0 + sum(h.amplitude * np.cos(h.phase) for h in motion.harmonics))
    return speed * turned.start_ratio if isinstance(turned, LedSprocket) else speed


def _sagging_places(chord: Array, natural: Array, turning: Array, gravity: Array) -> tuple[Array, Array]:
    """Places along and off the chord (V, links - 1) of a sagging strand's inner rollers [m], (b).

    Args:
        natural: (V, links) lengths of links [m].
        turning: (V,) of the path [rad].
    """
    length = hypot(chord[:, 0], chord[:, 1])
    along = chord / length[:, None]
    off = np.stack([-along[:, 1], along[:, 0]], axis=1)
    pull = np.sum(off * gravity, axis=1)
    level = np.abs(pull) <= _TIE * hypot(gravity[:, 0], gravity[:, 1])
    off = np.where((np.where(level, -turning, pull) < 0.0)[:, None], -off, off)
    angle = _half_angles(length, natural)
    whole = angle.sum(axis=1)
    passed = np.cumsum(angle, axis=1)[:, :-1]
    with np.errstate(invalid="ignore"):
        sine = length[:, None] * np.sin(passed) / np.sin(whole)[:, None]
    rest = whole[:, None] - passed
    ahead, aside = sine * np.cos(rest), sine * np.sin(rest)
    fraction = (np.cumsum(natural, axis=1) / natural.sum(axis=1, keepdims=True))[:, :-1]

    def part(axis: int) -> Array:
        """Rollers' coordinates (V, links - 1) from the strand's start [m]."""
        bent = ahead * along[:, axis, None] + aside * off[:, axis, None]
        return np.where((whole == 0.0)[:, None], fraction * chord[:, axis, None], bent)

    return part(0), part(1)


def _half_angles(chord: Array, natural: Array) -> Array:
    """Half angles y_i (V, links) of a sagging strand's links at its arc's center [rad], (a)."""
    total = natural.sum(axis=1)
    square = 6.0 * (total - chord) / (power(total, 3) - (natural**3).sum(axis=1))
    todo = np.flatnonzero(square > 0.0)
    square = np.where(square > 0.0, square, 0.0)
    for _ in range(20):
        if not len(todo):
            break
        mine, links = square[todo], natural[todo]
        curvature = np.sqrt(mine)
        angle = np.arcsin(curvature[:, None] * links)
        whole = angle.sum(axis=1)
        value = np.sin(whole) / curvature
        open_ = np.abs(chord[todo] - value) > 4e-16 * total[todo]
        spread = (links / np.cos(angle)).sum(axis=1)
        slope = (np.cos(whole) * spread - value) / (2.0 * mine)
        square[todo] = np.where(open_, mine + (chord[todo] - value) / slope, mine)
        todo = todo[open_]
    return np.arcsin(np.sqrt(square)[:, None] * natural)
