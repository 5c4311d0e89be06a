"""Which rollers sit on which sprocket, and at which angles the sprockets then stand: the closed polygon of the chain.

Sprocket s holds m_s >= 1 rollers on consecutive seats, the first at polar angle a_s, the last at
b_s = a_s + w_s (m_s - 1) alpha_s; strand k has n_k >= 1 links. The whole numbers satisfy sum (m_s - 1) + sum n_k = N.
The closing conditions, one a strand,

    |first roller of sprocket k+1 (a_{k+1}) - last roller of sprocket k (b_k)| = l_k (1 + strain),     (a)

with l_k the sum of the unloaded lengths of its n_k links, determine the strain and all a_s but the driver's, which is
the angle where the path arrives on it, or `run.phase` teeth further on. They are solved by Newton's method from the
path. In a slack chain (strain < 0) a strand of one link cannot sag: it keeps its length. Rollers stand in their seats'
directions, but where outer links are longer and the rollers ride above the seats: there they lean by
`Drive.riding_lean`, turn by turn back and forth.

The whole numbers come from the path measured in pitches from the driver's arrival: on an arc the angle over the pitch
angle, in a strand the length over p (1 + nominal strain), p the links' mean length. Roller i stands at i pitches, or
`run.phase` further on, and it is seated where it comes within half a pitch of the arc. That is also where the choice
does not matter: a last seat half a pitch angle before the tangent point sends the next roller of a straight strand
exactly to the next seat. So where the solved angles have left that range a seat is added or given back, and the
conditions are solved again.

A strand that touches guides goes around them from seat to seat on the taut string, whose length stands in (a) for the
distance; its directions at both ends are the gradient. Its links are chords: what they are longer or shorter together
than `Taut.chain_length`, where arcs and straight parts meet, is found by laying them and added.
"""

from __future__ import annotations

import math
from copy import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly.path import ChainPath
from warpchain.assembly.taut import Taut, TautError, point, taut
from warpchain.assembly.walk import Curve
from warpchain.drive.each import hypot, some
from warpchain.drive.mounts import initial_center
from warpchain.drive.profile import direction
from warpchain.errors import DriveError

if TYPE_CHECKING:
    from warpchain.drive import Drive

_TIE = 1e-6  # pitches: a roller half a pitch from an arc counts as seated, whatever the round-off
_SPARE = 0.05  # pitch angles beyond the half one before a seat is given back
_ROUNDS = 10
_ITERATIONS = 40
_LAYINGS = 8  # of links on strings; each leaves a thousandth of the error
_CLOSED = 1e-10  # of a pitch


Numbers = NDArray[np.float64]
Counts = NDArray[np.int64]


@dataclass
class Seating:
    """The chains of a stack of V variants seated on their sprockets; S sprockets, as many strands.

    Attributes:
        first_angle: (V, S) polar angles of the seats that hold the first roller of each sprocket [rad].
        seats: (V, S) numbers of seated rollers.
        links: (V, S) numbers of links of the strands.
        strain: (V,) strain of the strands' links, negative in a slack chain.
    """

    first_angle: Numbers
    seats: Counts
    links: Counts
    strain: Numbers

    def of(self, chosen: NDArray[np.int64]) -> Seating:
        """Some of the variants."""
        return Seating(self.first_angle[chosen], self.seats[chosen], self.links[chosen], self.strain[chosen])

    def put(self, chosen: NDArray[np.int64], other: Seating) -> None:
        """Sets some of the variants."""
        self.first_angle[chosen], self.seats[chosen] = other.first_angle, other.seats
        self.links[chosen], self.strain[chosen] = other.links, other.strain

    @property
    def first(self) -> Counts:
        """(V, S) indices of the first roller on each sprocket."""
        return np.cumsum(self.seats - 1 + self.links, axis=1) - (self.seats - 1 + self.links)

    @property
    def last(self) -> Counts:
        """(V, S) indices of the last roller on each sprocket."""
        return self.first + self.seats - 1


def seat_chain(drive: Drive, path: ChainPath, loop: Loop | None = None) -> Seating:
    """Seats the chains of a stack, each of which fits its path.

    Args:
        drive: one, or a stack.
        path: its path or paths, with the first axis of a stack.
        loop: of the drive, where it is known.

    Raises:
        DriveError: where a strand has no room for a link, a sprocket has fewer teeth than rollers to hold, or no
            placement closes the chain; the message names where, of the first such variant.
    """
    loop = loop or Loop(drive, path)
    loop.take(path)
    seating = loop.count(drive, path)
    todo = np.arange(len(seating.strain))
    for turn in range(_ROUNDS + 1):
        part, mine = loop.of(todo), seating.of(todo)
        part.close(mine)
        changed = part.adjust(mine) if turn < _ROUNDS else np.zeros(len(todo), dtype=bool)
        seating.put(todo, mine)
        todo = todo[changed]
        if not len(todo):
            break
    return seating


def forth(roller: Counts) -> Counts:
    """1 where an outer link ends at a roller, -1 where one begins (`Drive.riding_lean`)."""
    return np.where(roller % 2, 1, -1)


class Loop:
    """The sprockets of a stack as plain numbers, in the order of the chain's travel.

    Arrays have a first axis of V, guides' strings are those of one variant alone.
    """

    def __init__(self, drive: Drive, path: ChainPath) -> None:
        self.size = len(drive.sprockets)
        self.driver = drive.driver
        self.names = [sprocket.name for sprocket in drive.sprockets]
        self.teeth = np.array([sprocket.teeth for sprocket in drive.sprockets])
        self.pitch_angle = 2.0 * math.pi / self.teeth
        self.step = np.array([sprocket.sign for sprocket in drive.sprockets]) * self.pitch_angle
        self.lean = [sprocket.sign * drive.riding_lean(s) for s, sprocket in enumerate(drive.sprockets)]
        self.leans = any(map(some, self.lean))
        self.guides = [guide.name for guide in drive.guides]
        variants = len(path.radius)
        wide = (variants, self.size)
        self.center = np.stack(
            [np.broadcast_to(initial_center(sprocket), (variants, 2)) for sprocket in drive.sprockets], axis=1
        )
        self.radius = np.broadcast_to(path.radius, wide)
        self.pitch = np.broadcast_to(path.pitch, variants)
        self.take(path)
        links = np.atleast_2d(drive.chain.pulled_lengths)
        self.links = np.broadcast_to(links, (variants, links.shape[1]))
        reach = np.cumsum(np.tile(links, 2), axis=1)
        reach = np.concatenate([np.zeros((len(links), 1)), reach], axis=1)
        self.reach = np.broadcast_to(reach, (variants, reach.shape[1]))

    def take(self, path: ChainPath) -> None:
        """Goes over to another path of the same drive, whose arms stand elsewhere."""
        self.runs = [runs if path.strings[k] is not None else () for k, runs in enumerate(path.obstacles)]
        self.strings: dict[int, tuple[tuple[float, float], Taut]] = {}  # as last drawn, from where to where
        self.chords = np.zeros(self.radius.shape)  # what links laid on a string measure beyond its chain length [m]

    def of(self, chosen: NDArray[np.int64]) -> Loop:
        """That of some of the variants."""
        if len(chosen) == len(self.pitch):
            return self
        part = copy(self)
        for name in ("center", "radius", "pitch", "chords", "links", "reach"):
            setattr(part, name, getattr(self, name)[chosen])
        return part

    def count(self, drive: Drive, path: ChainPath) -> Seating:
        """The whole numbers and the first guess of the angles, from the path measured in pitches."""
        variants = len(self.pitch)
        wide = (variants, self.size)
        strain = np.broadcast_to(path.nominal_strain, variants).copy()
        seating = Seating(np.zeros(wide), np.zeros(wide, dtype=np.int64), np.zeros(wide, dtype=np.int64), strain)
        link = self.pitch * (1.0 + strain)
        phase = 0.0 if drive.run.phase is None else drive.run.phase
        position, previous = np.broadcast_to(0.0 - phase, variants), np.zeros(variants, dtype=np.int64)
        begin = np.ceil(position - 0.5 - _TIE).astype(np.int64)
        for turn in range(self.size):
            s = (self.driver + turn) % self.size
            first = np.ceil(position - 0.5 - _TIE).astype(np.int64)
            seating.first_angle[:, s] = path.arrival_angle[:, s] + (first - position) * self.step[s]
            if turn > 0:
                seating.links[:, s - 1] = first - previous
            position = position + path.wrap_angle[:, s] / self.pitch_angle[s]
            previous = np.floor(position + 0.5 + _TIE).astype(np.int64)
            seating.seats[:, s] = previous - first + 1
            position = position + path.strand_length[:, s] / link
        seating.links[:, self.driver - 1] = drive.chain.links + begin - previous
        self._check_counts(seating, path)
        return seating

    def _check_counts(self, seating: Seating, path: ChainPath) -> None:
        for v, s in np.argwhere((seating.seats > self.teeth) | (seating.links < 1)):
            name = self.names[s]
            if seating.seats[v, s] > self.teeth[s]:
                raise DriveError(
                    f'sprocket "{name}": the chain would put {seating.seats[v, s]} rollers on it, '
                    f"allowed are at most its {self.teeth[s]} teeth"
                )
            raise DriveError(
                f'strand "{name}->{self.names[(s + 1) % self.size]}": {path[v].strand_length[s]:.6g} m long, '
                f"which leaves no link between the seats; allowed is more than the pitch, {self.pitch[v]:.6g} m"
            )

    def ends(self, seating: Seating, k: Any) -> tuple[Numbers, Numbers]:
        """Polar angles of the last roller before strand k and of the first one after it, (V,), or (V, K) of some."""
        following = (k + 1) % self.size
        leave = seating.first_angle[:, k] + (seating.seats[:, k] - 1) * self.step[k]
        arrive = seating.first_angle[:, following]
        if self.leans:
            last, lean = seating.last[:, k], np.array(self.lean)
            leave = leave + forth(last) * lean[k]
            arrive = arrive + forth(last + seating.links[:, k]) * lean[following]
        return leave, arrive

    def string(self, seating: Seating, k: int) -> Taut | None:
        """Strand k from seat to seat around its guides; None where it touches none."""
        if not self.runs[k]:
            return None
        following = (k + 1) % self.size
        leave, arrive = self.ends(seating, k)
        ends = float(leave[0]), float(arrive[0])
        known, string = self.strings.get(k, (None, None))
        if string is None or known != ends:
            seats = self._seat(k, ends[0]), self._seat(following, ends[1])
            try:
                string = taut(point(seats[0]), point(seats[1]), self.runs[k], string)
            except TautError as error:
                raise DriveError(f"guides.{self.guides[error.guide]}: {error}") from None
            self.strings[k] = ends, string
        return string if string.touches else None

    def _seat(self, s: int, polar: float) -> tuple[float, float]:
        (x, y), radius = self.center[0, s].tolist(), float(self.radius[0, s])
        return x + radius * math.cos(polar), y + radius * math.sin(polar)

    def inward(self, seating: Seating, k: int) -> tuple[Numbers, Numbers]:
        """Unit vectors of strand k where it leaves and arrives, times the outward unit vectors of the seats there."""
        leave, arrive = self.ends(seating, k)
        string = self.string(seating, k)
        if string is None:
            (x, y), _ = self.chord(leave, arrive, k)
            u, v = x, y
        else:
            (x, y), (u, v) = ([np.array([part]) for part in direction(h)] for h in (string.first, string.last))
        return x * np.cos(leave) + y * np.sin(leave), u * np.cos(arrive) + v * np.sin(arrive)

    def laid(self, seating: Seating, k: int) -> float:
        """What the links of strand k, laid as chords on its string, measure beyond its chain length [m]."""
        string = self.string(seating, k)
        if string is None:
            return 0.0
        roller = int(seating.last[0, k])
        links = self.links[0, np.arange(roller, roller + seating.links[0, k]) % self.links.shape[1]]
        return Curve(string.pieces).scale(links) * float(links.sum()) - string.chain_length(float(self.pitch[0]))

    def chord(self, leave: Numbers, arrive: Numbers, k: Any) -> tuple[tuple[Numbers, Numbers], Numbers]:
        """Strand k from seat to seat, between polar angles: its unit vectors' components and lengths [m]."""
        following = (k + 1) % self.size
        center, radius = self.center, self.radius
        x = center[:, following, 0] + radius[:, following] * np.cos(arrive)
        y = center[:, following, 1] + radius[:, following] * np.sin(arrive)
        x = x - (center[:, k, 0] + radius[:, k] * np.cos(leave))
        y = y - (center[:, k, 1] + radius[:, k] * np.sin(leave))
        length = hypot(x, y)
        return (x / length, y / length), length

    def natural(self, seating: Seating) -> Numbers:
        """(V, S) unloaded lengths of the strands: the sums of their own links'."""
        last = seating.last
        begin, end = (np.take_along_axis(self.reach, places, axis=1) for places in (last, last + seating.links))
        return np.asarray(end - begin)

    def close(self, seating: Seating) -> None:
        """Solves the closing conditions (a) for the whole numbers as they stand."""
        lengths = self.natural(seating)
        for _ in range(_LAYINGS if any(self.runs) else 1):
            self._solve(seating, lengths)
            if not any(self.runs):
                break
            before, self.chords = self.chords, np.array([[self.laid(seating, k) for k in range(self.size)]])
            if np.abs(before - self.chords).max() <= 1e-3 * _CLOSED * self.pitch[0]:
                break

    def _solve(self, seating: Seating, lengths: Numbers) -> None:
        self._newton(seating, lengths, lengths)
        short = seating.links == 1
        slack = np.flatnonzero((seating.strain < 0.0) & short.any(axis=1))
        if len(slack):
            sagging = np.where(short[slack], 0.0, lengths[slack])
            if not sagging.any(axis=1).all():
                raise DriveError("chain.links: the chain is slack, but no strand has a second link with which to sag")
            mine = seating.of(slack)
            self.of(slack)._newton(mine, lengths[slack], sagging)
            seating.put(slack, mine)

    def _newton(self, seating: Seating, lengths: Numbers, elastic: Numbers) -> None:
        """Newton's method; `elastic` is the part of each strand's unloaded length that takes the strain.

        Column `driver` of the Jacobian belongs to the strain, the others to the sprockets' angles. A variant that is
        done stays as it is while others go on.
        """
        todo, worst = np.arange(len(lengths)), np.full(len(lengths), math.inf)
        angles = np.arange(self.size) != self.driver
        part, mine = self, seating
        for _ in range(_ITERATIONS):
            residual, jacobian = part._conditions(mine, lengths[todo], elastic[todo])
            before, worst = worst, np.abs(residual).max(axis=1)
            done = (0.5 * before <= worst) & (worst <= _CLOSED * part.pitch)  # round-off is reached
            if done.any():
                seating.put(todo, mine)
                todo, worst, residual, jacobian = todo[~done], worst[~done], residual[~done], jacobian[~done]
                if not len(todo):
                    return
                part, mine = self.of(todo), seating.of(todo)
            try:
                change = np.linalg.solve(jacobian, -residual[..., None])[..., 0]
            except np.linalg.LinAlgError:
                break
            farthest = np.abs(change[:, angles] / self.pitch_angle[angles]).max(axis=1)
            change = change * np.minimum(1.0, 0.5 / np.maximum(1e-300, farthest))[:, None]
            mine.first_angle[:, angles] += change[:, angles]
            mine.strain += change[:, self.driver]
        total = int(seating.links[0].sum() + seating.seats[0].sum()) - self.size
        raise DriveError(
            f"chain.links = {total}: no placement with the seated rollers on their seats closes the chain "
            f"(a gap of {worst[0]:.3g} m remains)"
        )

    def _conditions(self, seating: Seating, lengths: Numbers, elastic: Numbers) -> tuple[Numbers, Numbers]:
        """What is left of (a) (V, S) [m], and its Jacobian (V, S, S)."""
        strands = np.arange(self.size)
        following = (strands + 1) % self.size
        leave, arrive = self.ends(seating, strands)
        (x, y), length = self.chord(leave, arrive, strands)
        (u, v) = (x, y)
        if any(self.runs):
            x, y, u, v = x.copy(), y.copy(), x.copy(), y.copy()
            for k in range(self.size):
                string = self.string(seating, k)
                if string is not None:
                    length[:, k] = string.chain_length(float(self.pitch[0])) + self.chords[:, k]
                    (x[:, k], y[:, k]), (u[:, k], v[:, k]) = direction(string.first), direction(string.last)
        jacobian = np.zeros((*lengths.shape, self.size))
        radius = self.radius
        jacobian[:, strands, following] = radius[:, following] * (v * np.cos(arrive) - u * np.sin(arrive))
        jacobian[:, strands, strands] = -radius * (y * np.cos(leave) - x * np.sin(leave))
        jacobian[:, :, self.driver] = -elastic
        return length - lengths - elastic * seating.strain[:, None], jacobian

    def adjust(self, seating: Seating) -> NDArray[np.bool_]:
        """Adds and gives back seats at both ends of every strand; where anything has changed (V,).

        The driver's first seat stays, since it carries the angle that is not solved for.
        """
        link = self.pitch * (1.0 + np.maximum(seating.strain, 0.0))
        changed = np.zeros(len(link), dtype=bool)
        for k in range(self.size):
            following = (k + 1) % self.size
            leave, arrive = self.inward(seating, k)
            change = self._missing(seating, k, k, -leave, link)
            seating.seats[:, k] += change
            seating.links[:, k] -= change
            changed |= change != 0
            if following != self.driver:
                change = self._missing(seating, k, following, arrive, link)
                seating.seats[:, following] += change
                seating.links[:, k] -= change
                seating.first_angle[:, following] -= change * self.step[following]
                changed |= change != 0
        return changed

    def _missing(self, seating: Seating, k: int, s: int, inward: Numbers, link: Numbers) -> Counts:
        """+1, -1 or 0 (V,): seats to add on sprocket s where strand k ends on it.

        `inward` is the cosine between the strand's direction towards the sprocket and the seat's outward vector e, the
        sine of the angle by which the seat lies within the arc. A straight strand's next roller, a link L away, stands
        at the radius sqrt(R^2 - 2 R L inward + L^2): inside the pitch circle, in the next gap, if inward > L / (2 R).
        Beyond half a pitch angle outside the arc the strand bends away from the seat.
        """
        radius, seats = self.radius[:, s], seating.seats[:, s]
        inside = link * (link - 2.0 * radius * inward) < -_TIE * self.pitch * radius
        outside = -inward > math.sin((0.5 + _SPARE) * self.pitch_angle[s])
        more = inside & (seating.links[:, k] > 1) & (seats < self.teeth[s])
        less = ~inside & outside & (seats > 1)
        return more.astype(np.int64) - less
