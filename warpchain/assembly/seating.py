"""Seating of rollers on sprockets, and the sprocket angles that close the chain's polygon.

Sprocket s holds m_s rollers on consecutive seats, the first at polar angle a_s, the last at b_s = a_s + w_s (m_s - 1)
alpha_s; strand k has n_k links of unloaded length l_k. One closing condition a strand,

    |first roller of sprocket k+1 (a_{k+1}) - last roller of sprocket k (b_k)| = l_k (1 + strain),     (a)

determines the strain and all a_s but the driver's. In a slack chain a strand of one link keeps its length; on guides
(a) has the taut string's. An open chain has a sprocket of one seat and no radius at each end, no (a) between them, and
its driver's angle as an unknown.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from functools import reduce
from operator import and_
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly.link_laying import LayingCurve, summed_lengths
from warpchain.assembly.path import ChainPath
from warpchain.assembly.taut_string import TautError, TautString, point_end, taut_string
from warpchain.drive.face_profile import unit_vector
from warpchain.drive.stack_math import (
    Condition,
    Number,
    UnlikeVariants,
    ceil,
    columns_of_table,
    cos_sin,
    floor,
    has_arrays,
    hypot,
    is_true_somewhere,
    maximum,
    minimum,
    pairwise_sum,
    pick_places,
    shared_value,
    table_of_columns,
    where,
)
from warpchain.errors import DriveError
from warpchain.model.mounts import initial_place
from warpchain.model.stacks import pick_variants

if TYPE_CHECKING:
    from warpchain.model import ChainModel

_TIE = 1e-6  # pitches: a roller half a pitch from an arc counts as seated, whatever the round-off
_SPARE = 0.05  # pitch angles beyond the half one before a seat is given back
_ROUNDS = 10
_ITERATIONS = 40
_LAYINGS = 8  # of links on strings
_LEFT = 2e-2  # of the error, by each of them, at most
_CLOSED, _CLOSEST = 1e-10, 2e-14  # of a pitch
_LAID = 1e-13  # of a pitch

Places = NDArray[np.int64]


@dataclass
class Seating:
    """Seating of a stack's chains on S sprockets, in arrays (V,) or numbers.

    Attributes:
        first_angle: (S,) polar angles of the first rollers' seats [rad].
        seats: (S,) numbers of seated rollers.
        links: (S,) numbers of links of the strands.
        strain: of the strands' links, negative in a slack chain.
    """

    first_angle: list[Number]
    seats: list[Number]
    links: list[Number]
    strain: Number

    def pick_variants(self, chosen: Places) -> Seating:
        """Seatings of chosen variants of a stack."""
        angle, seats, links = ([column[chosen] for column in own] for own in (self.first_angle, self.seats, self.links))
        return Seating(angle, seats, links, self.strain[chosen])

    def set_variants(self, chosen: Places, other: Seating) -> None:
        """Sets the seatings of chosen variants to another's."""

        def column_with(column: Number, new: Number) -> Number:
            """Copy of a column with the chosen variants' new values."""
            column = column.copy()
            column[chosen] = new
            return column

        for name in ("first_angle", "seats", "links"):
            setattr(self, name, list(map(column_with, getattr(self, name), getattr(other, name))))
        self.strain = column_with(self.strain, other.strain)

    @property
    def first(self) -> list[Number]:
        """Indices of the first seated roller on each sprocket (S,)."""
        found = [0 * self.seats[0]]
        for seats, links in zip(self.seats[:-1], self.links[:-1], strict=True):
            found.append(found[-1] + (seats - 1 + links))
        return found

    @property
    def last(self) -> list[Number]:
        """Indices of the last seated roller on each sprocket (S,)."""
        return [first + seats - 1 for first, seats in zip(self.first, self.seats, strict=True)]


def seat_chain(model: ChainModel, path: ChainPath, loop: Loop | None = None, near: Number = 0.0) -> Seating:
    """Seating of chains that fit their paths.

    Args:
        path: with the first axis of a stack.
        loop: whose last solution is the first guess, with arms.
        near: tolerance of links laid on guides [pitches].

    Raises:
        DriveError: a strand without room for a link, too few teeth, or no placement that closes the chain; of the first
            such variant.
        UnlikeVariants: chains on guides with unlike arcs, or links.
    """
    loop = loop or Loop(model, path)
    loop.use_path(path)
    seating = loop.start_seating(loop.counted_seating(model, path))
    part, mine, todo = loop, seating, np.arange(len(path.radius))
    for turn in range(_ROUNDS + 1):
        part.solve_closure(mine, near)
        if part is not loop:
            loop.keep_laid_links(todo, part)
        changed: Condition = turn < _ROUNDS and part.adjust_seats(mine)
        if mine is not seating:
            seating.set_variants(todo, mine)
        if not is_true_somewhere(changed):
            break
        if has_arrays(changed) and not changed.all():
            todo = todo[changed]
            part, mine = loop.pick_variants(todo), seating.pick_variants(todo)
    loop.solved = seating
    return seating


def outer_link_sign(roller: Number) -> Number:
    """Sign of the riding lean at a roller: 1 where an outer link ends, else -1."""
    return 2 * (roller % 2) - 1


class Loop:
    """Loop of a stack's sprockets that the seated chain closes.

    Attributes:
        members: (V,) their variants among the stack's `whole`.
    """

    def __init__(self, model: ChainModel, path: ChainPath) -> None:
        self.variants = self.whole = len(path.radius)
        self.members: Places = np.arange(self.whole)
        self.size = len(model.sprockets)
        self.open = model.chain.is_open
        self.driver = 0 if self.open else model.driver  # from whose first seat the others are counted
        self.names = [sprocket.name for sprocket in model.sprockets]
        self.teeth = [sprocket.teeth for sprocket in model.sprockets]
        self.pitch_angle = [2.0 * math.pi / teeth for teeth in self.teeth]
        self.step = [sprocket.sign * angle for sprocket, angle in zip(model.sprockets, self.pitch_angle, strict=True)]
        self.lean = [sprocket.sign * model.riding_lean(s) for s, sprocket in enumerate(model.sprockets)]
        self.leans = any(map(is_true_somewhere, self.lean))
        self.guides = [guide.name for guide in model.guides]
        self.x, self.y = map(list, zip(*(initial_place(sprocket) for sprocket in model.sprockets), strict=True))
        self.rides = any(model.carrier(s) is not None for s in range(self.size))
        self.radius = columns_of_table(path.radius)
        (self.pitch,) = columns_of_table(np.asarray(path.pitch)[:, None])
        self.links = np.atleast_2d(model.chain.pulled_lengths)
        reach = np.cumsum(np.tile(self.links, 2), axis=1)
        self.reach = np.concatenate([np.zeros((len(reach), 1)), reach], axis=1)
        self.remembers = bool(model.arms)
        self.counted: Seating | None = None
        self.solved: Seating | None = None
        self.chords: list[Number] = [0.0] * self.size  # what links on a string measure beyond its chain length [m]
        self.scales: dict[int, Number] = {}  # of links on strings, as last found
        self.last_arcs: dict[int, tuple[int, ...]] = {}  # the arcs that strings last lay on
        self.use_path(path)

    def use_path(self, path: ChainPath) -> None:
        """Takes another path of the drive, with arms elsewhere."""
        if self.rides:
            self.x, self.y = columns_of_table(path.center[..., 0]), columns_of_table(path.center[..., 1])
        self.runs = [runs if path.strings[k] is not None else () for k, runs in enumerate(path.obstacles)]
        self.around = any(self.runs)
        self.strings: dict[int, tuple[tuple[Number, Number], TautString]] = {}  # as last drawn, from where to where

    def pick_variants(self, chosen: Places) -> Loop:
        """Sprocket loops of chosen variants of a stack."""
        part = copy(self)
        part.variants, part.pitch, part.members = len(chosen), self.pitch[chosen], self.members[chosen]
        part.runs, part.strings = [pick_variants(runs, chosen) if runs else () for runs in self.runs], {}
        part.chords = [pick_places(chord, chosen) for chord in self.chords]
        part.scales = {k: pick_places(scale, chosen) for k, scale in self.scales.items()}
        for name in ("x", "y", "radius", "lean"):
            setattr(part, name, [pick_places(value, chosen) for value in getattr(self, name)])
        if len(self.reach) > 1:
            part.links, part.reach = self.links[chosen], self.reach[chosen]
        return part

    def chosen_loops(
        self, chosen: Condition, seating: Seating, lengths: list[Number]
    ) -> tuple[Loop, Seating, list[Number]]:
        """Loops, seatings and strand lengths of chosen variants."""
        if not has_arrays(chosen) or chosen.all():
            return self, seating, lengths
        places = np.flatnonzero(chosen)
        return (
            self.pick_variants(places),
            seating.pick_variants(places),
            [pick_places(length, places) for length in lengths],
        )

    def keep_laid_links(self, chosen: Places, part: Loop) -> None:
        """Keeps the laid links' lengths that `part` found for chosen variants."""

        def column_with(old: Number, new: Number) -> Number:
            """Column of all variants with the chosen ones' new values."""
            if not has_arrays(old, new):
                return new
            column = np.array(np.broadcast_to(old, self.variants))
            column[chosen] = new
            return column

        self.chords = list(map(column_with, self.chords, part.chords))
        self.scales = {k: column_with(self.scales.get(k, scale), scale) for k, scale in part.scales.items()}

    def counted_seating(self, model: ChainModel, path: ChainPath) -> Seating:
        """Seating by counting pitches along the path."""
        arrival, wrap, length = (
            columns_of_table(table) for table in (path.arrival_angle, path.wrap_angle, path.strand_length)
        )
        (strain,) = columns_of_table(np.asarray(path.nominal_strain)[:, None])
        link = self.pitch * (1.0 + strain)
        position: Number = 0.0 - (0.0 if model.run.phase is None or self.open else model.run.phase)
        if self.variants > 1:
            position = np.broadcast_to(position, self.variants)
        begin = ceil(position - 0.5 - _TIE)
        angles, seats, links = ([0.0] * self.size for _ in range(3))
        previous: Number = 0
        for turn in range(self.size):
            s = (self.driver + turn) % self.size
            first = ceil(position - 0.5 - _TIE)
            angles[s] = arrival[s] + (first - position) * self.step[s]
            if turn > 0:
                links[s - 1] = first - previous
            position = position + wrap[s] / self.pitch_angle[s]
            previous = floor(position + 0.5 + _TIE)
            seats[s] = previous - first + 1
            position = position + length[s] / link
        links[self.driver - 1] = model.chain.rollers + begin - previous
        self._check_counts(seats, links, path)
        return Seating(angles, seats, links, strain)

    def start_seating(self, counted: Seating) -> Seating:
        """First guess of a seating: as counted, or the last solution with equal counts."""
        before, self.counted = self.counted, counted
        solved = self.solved
        if solved is None or before is None or not self.remembers:
            return counted
        counts = zip([*before.seats, *before.links], [*counted.seats, *counted.links], strict=True)
        alike = reduce(and_, (old == new for old, new in counts))
        angles, seats, links = (
            [where(alike, old, new) for old, new in zip(getattr(solved, name), getattr(counted, name), strict=True)]
            for name in ("first_angle", "seats", "links")
        )
        angles[self.driver] = counted.first_angle[self.driver]
        return Seating(angles, seats, links, where(alike, solved.strain, counted.strain))

    def _check_counts(self, seats: Sequence[Number], links: Sequence[Number], path: ChainPath) -> None:
        """Raises a DriveError where a sprocket lacks teeth for its seats, or a strand links."""
        for s, name in enumerate(self.names):
            if is_true_somewhere(seats[s] > self.teeth[s]):
                raise DriveError(
                    f'sprocket "{name}": the chain would put {np.max(seats[s])} rollers on it, '
                    f"allowed are at most its {self.teeth[s]} teeth"
                )
            if is_true_somewhere(links[s] < 1):
                v = int(np.argmin(links[s]))
                raise DriveError(
                    f'strand "{name}->{self.names[(s + 1) % self.size]}": {path[v].strand_length[s]:.6g} m long, '
                    f"which leaves no link between the seats; allowed is more than the pitch, {path[v].pitch:.6g} m"
                )

    def end_seat_angles(self, seating: Seating, k: int) -> tuple[Number, Number]:
        """Polar angles of the seated rollers before and after strand k [rad]."""
        following = (k + 1) % self.size
        leave = seating.first_angle[k] + (seating.seats[k] - 1) * self.step[k]
        arrive = seating.first_angle[following]
        if self.leans:
            last = seating.last[k]
            leave = leave + outer_link_sign(last) * self.lean[k]
            arrive = arrive + outer_link_sign(last + seating.links[k]) * self.lean[following]
        return leave, arrive

    def string(self, seating: Seating, k: int) -> TautString | None:
        """Taut string of strand k from seat to seat, or None."""
        if not self.runs[k]:
            return None
        ends = self.end_seat_angles(seating, k)
        known = self.strings.get(k)
        if known is None or any(is_true_somewhere(old != new) for old, new in zip(known[0], ends, strict=True)):
            first, last = self._seated_place(k, ends[0]), self._seated_place((k + 1) % self.size, ends[1])
            try:
                string = taut_string(point_end(first), point_end(last), self.runs[k], self.last_arcs.get(k, ()))
            except TautError as error:
                raise DriveError(f"guides.{self.guides[error.guide]}: {error}") from None
            except UnlikeVariants as parted:
                raise parted.at_places(self.members, self.whole) from None
            self.strings[k], self.last_arcs[k] = (ends, string), string.numbers
        string = self.strings[k][1]
        return string if string.touches else None

    def _seated_place(self, s: int, polar: Number) -> tuple[Number, Number]:
        """Place of a roller seated at a polar angle on sprocket s [m]."""
        radius, (x, y) = self.radius[s], unit_vector(polar)
        return self.x[s] + radius * x, self.y[s] + radius * y

    def strand(self, seating: Seating, k: int) -> _Strand:
        """Strand k from seat to seat, around its guides."""
        following = (k + 1) % self.size
        leave, arrive = self.end_seat_angles(seating, k)
        leaving, arriving = cos_sin(leave), cos_sin(arrive)
        string = self.string(seating, k) if self.around else None
        if string is not None:
            length = string.chain_length(self.pitch) + self.chords[k]
            return _Strand(leaving, arriving, unit_vector(string.first), unit_vector(string.last), length)
        x = self.x[following] + self.radius[following] * arriving[0]
        y = self.y[following] + self.radius[following] * arriving[1]
        x = x - (self.x[k] + self.radius[k] * leaving[0])
        y = y - (self.y[k] + self.radius[k] * leaving[1])
        length = hypot(x, y)
        along = x / length, y / length
        return _Strand(leaving, arriving, along, along, length)

    def laid_excess(self, seating: Seating, k: int) -> Number:
        """Length of strand k's links laid on its string beyond its chain length [m]."""
        string = self.string(seating, k)
        if string is None:
            return 0.0
        try:
            roller, links = shared_value(seating.last[k]), shared_value(seating.links[k])
        except UnlikeVariants as parted:
            raise parted.at_places(self.members, self.whole) from None
        own = np.take(self.links, np.arange(roller, roller + links) % self.links.shape[1], axis=1)
        own = own[0] if len(own) == 1 else own
        scale = LayingCurve(string.pieces).scale(own, self.scales.get(k))
        if self.remembers:
            self.scales[k] = scale
        return scale * summed_lengths(own) - string.chain_length(self.pitch)

    def unloaded_lengths(self, seating: Seating) -> list[Number]:
        """Unloaded lengths of the strands (S,) [m]."""
        row = 0 if len(self.reach) == 1 else np.arange(self.variants)
        ends = [(last, last + links) for last, links in zip(seating.last, seating.links, strict=True)]
        found = [self.reach[row, end] - self.reach[row, begin] for begin, end in ends]
        return [length if has_arrays(length) else float(length) for length in found]

    def solve_closure(self, seating: Seating, near: Number) -> None:
        """Solves a seating's closing conditions (a) for given counts, laid links to `near`."""
        part, mine, lengths = self, seating, self.unloaded_lengths(seating)
        todo = np.arange(self.variants)
        for _ in range(_LAYINGS if self.around else 1):
            part._solve_conditions(mine, lengths)
            if not self.around:
                return
            before, part.chords = part.chords, [part.laid_excess(mine, k) for k in range(self.size)]
            change = maximum(*(abs(old - new) for old, new in zip(before, part.chords, strict=True)))
            rest = pick_places(near, part.members) * part.pitch
            moved, much = change > _LAID * part.pitch, _LEFT * change > rest
            last, further = moved & (much ^ True), moved & much
            if is_true_somewhere(last):
                own, solved, natural = part.chosen_loops(last, mine, lengths)
                own._solve_conditions(solved, natural)
                if solved is not mine:
                    mine.set_variants(np.flatnonzero(last), solved)
            if part is not self:
                seating.set_variants(todo, mine)
                self.keep_laid_links(todo, part)
            if not is_true_somewhere(further):
                return
            todo = todo[further] if has_arrays(further) else todo
            part, mine, lengths = part.chosen_loops(further, mine, lengths)

    def _solve_conditions(self, seating: Seating, lengths: list[Number]) -> None:
        """Solves a seating's closing conditions (a) for given laid links."""
        self._solve_by_newton(seating, lengths, lengths)
        slack = seating.strain < 0.0
        short = [slack & (links == 1) for links in seating.links]
        if not any(map(is_true_somewhere, short)):
            return
        sagging = [where(alone, 0.0, length) for alone, length in zip(short, lengths, strict=True)]
        if is_true_somewhere(slack & (pairwise_sum(sagging) == 0.0)):
            raise DriveError("chain.links: the chain is slack, but no strand has a second link with which to sag")
        if not has_arrays(slack):
            self._solve_by_newton(seating, lengths, sagging)
            return
        chosen = np.flatnonzero(np.any(short, axis=0))
        mine = seating.pick_variants(chosen)
        own, elastic = ([pick_places(value, chosen) for value in values] for values in (lengths, sagging))
        self.pick_variants(chosen)._solve_by_newton(mine, own, elastic)
        seating.set_variants(chosen, mine)

    def _solve_by_newton(self, seating: Seating, lengths: list[Number], elastic: list[Number]) -> None:
        """Solves a seating's closing conditions (a) by Newton's method.

        Args:
            elastic: parts of the strands' lengths that take the strain (S,) [m].
        """
        angles = [s for s in range(self.size) if s != self.driver]
        part, mine, todo, worst = self, seating, np.arange(self.variants), math.inf
        for _ in range(_ITERATIONS):
            residual, jacobian = part._conditions(mine, lengths, elastic)
            before, worst = worst, maximum(*map(abs, residual))
            done = (0.5 * before <= worst) & (worst <= _CLOSED * part.pitch)  # round-off is reached
            if self.remembers:
                done = done | (worst <= _CLOSEST * part.pitch)
            if is_true_somewhere(done):
                if mine is not seating:
                    seating.set_variants(todo, mine)
                if not has_arrays(done) or done.all():
                    return
                left = np.flatnonzero(~done)
                todo, worst, jacobian = todo[left], worst[left], jacobian[left]
                lengths, elastic, residual = (
                    [pick_places(c, left) for c in own] for own in (lengths, elastic, residual)
                )
                part, mine = part.pick_variants(left), mine.pick_variants(left)
            try:
                solved = np.linalg.solve(jacobian, -table_of_columns(residual, part.variants)[..., None])[..., 0]
            except np.linalg.LinAlgError:
                break
            change = columns_of_table(solved)
            farthest = maximum(*(abs(change[s] / self.pitch_angle[s]) for s in angles))
            share = minimum(1.0, 0.5 / maximum(1e-300, farthest))
            for s in angles:
                mine.first_angle[s] = mine.first_angle[s] + change[s] * share
            mine.strain = mine.strain + change[self.driver] * share
        seats, links = (sum(np.max(column) for column in own) for own in (seating.seats, seating.links))
        raise DriveError(
            f"chain.links = {seats + links - self.size}: no placement with the seated rollers on their seats closes "
            f"the chain (a gap of {np.max(worst):.3g} m remains)"
        )

    def _conditions(
        self, seating: Seating, lengths: list[Number], elastic: list[Number]
    ) -> tuple[list[Number], NDArray[np.float64]]:
        """Residual (S,) of the closing conditions (a) [m], and Jacobian (V, S, S)."""
        residual, jacobian = [], np.zeros((self.variants, self.size, self.size))
        for k in range(self.size):
            following = (k + 1) % self.size
            strand = self.strand(seating, k)
            (cl, sl), (ca, sa), (x, y), (u, v) = strand.leaving, strand.arriving, strand.first, strand.final
            jacobian[:, k, following] = self.radius[following] * (v * ca - u * sa)
            jacobian[:, k, k] = -self.radius[k] * (y * cl - x * sl)
            jacobian[:, k, self.driver] = -elastic[k]  # the strain's column
            residual.append(strand.length - lengths[k] - elastic[k] * seating.strain)
        if self.open:  # the gap between the ends closes by itself, and the angle of the last end is its own
            jacobian[:, -1] = 0.0
            jacobian[:, -1, -1], residual[-1] = 1.0, 0.0 * residual[-1]
        return residual, jacobian

    def adjust_seats(self, seating: Seating) -> Condition:
        """Adds and gives back seats at strands' ends; returns where any changed."""
        link = self.pitch * (1.0 + maximum(seating.strain, 0.0))
        changed = link != link  # False, or an array of it
        for k in range(self.size):
            following = (k + 1) % self.size
            strand = self.strand(seating, k)
            (cl, sl), (ca, sa), (x, y), (u, v) = strand.leaving, strand.arriving, strand.first, strand.final
            change = self._seat_change(seating, k, k, -(x * cl + y * sl), link)
            seating.seats[k] = seating.seats[k] + change
            seating.links[k] = seating.links[k] - change
            changed = changed | (change != 0)
            if following != self.driver:
                change = self._seat_change(seating, k, following, u * ca + v * sa, link)
                seating.seats[following] = seating.seats[following] + change
                seating.links[k] = seating.links[k] - change
                seating.first_angle[following] = seating.first_angle[following] - change * self.step[following]
                changed = changed | (change != 0)
        return changed

    def _seat_change(self, seating: Seating, k: int, s: int, inward: Number, link: Number) -> Number:
        """Seats to add on sprocket s where strand k ends: +1, -1 or 0.

        Args:
            inward: cosine between the strand towards the sprocket and the seat's outward vector.
            link: length of a link [m].
        """
        radius, seats = self.radius[s], seating.seats[s]
        # a straight strand's next roller, a link L away, is in the next gap if inward > L / (2 R)
        inside = link * (link - 2.0 * radius * inward) < -_TIE * self.pitch * radius
        outside = -inward > math.sin((0.5 + _SPARE) * self.pitch_angle[s])
        more = inside & (seating.links[k] > 1) & (seats < self.teeth[s])
        return where(more, 1, where((inside ^ True) & outside & (seats > 1), -1, 0))


@dataclass(frozen=True)
class _Strand:
    """Strand from seat to seat, of a seating.

    Attributes:
        leaving, arriving: (2,) outward unit vectors of its end seats.
        first, final: (2,) its unit vectors there.
    """

    leaving: tuple[Number, Number]
    arriving: tuple[Number, Number]
    first: tuple[Number, Number]
    final: tuple[Number, Number]
    length: Number
