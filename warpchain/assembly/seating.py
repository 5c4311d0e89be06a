"""Which rollers sit on which sprocket, and at which angles the sprockets then stand: the closed polygon of the chain.

Sprocket s holds m_s >= 1 rollers on consecutive seats, the first at polar angle a_s, the last at
b_s = a_s + w_s (m_s - 1) alpha_s; strand k has n_k >= 1 links. The whole numbers satisfy sum (m_s - 1) + sum n_k = N.
The closing conditions, one a strand,

    |first roller of sprocket k+1 (a_{k+1}) - last roller of sprocket k (b_k)| = l_k (1 + strain),     (a)

with l_k the sum of the unloaded lengths of its n_k links, determine the strain and all a_s but the driver's, which is
the angle where the path arrives on it. They are solved by Newton's method from the path. In a slack chain (strain < 0)
a strand of one link cannot sag: it keeps its length. Rollers stand in their seats' directions, but where outer links
are longer and the rollers ride above the seats: there they lean by `Drive.riding_lean`, turn by turn back and forth.

The whole numbers come from the path measured in pitches from the driver's arrival: on an arc the angle over the pitch
angle, in a strand the length over p (1 + nominal strain), p the links' mean length. Roller i stands at i pitches, and
it is seated where it comes within half a pitch of the arc. That is also where the choice does not matter: a last seat
half a pitch angle before the tangent point sends the next roller of a straight strand exactly to the next seat. So
where the solved angles have left that range a seat is added or given back, and the conditions are solved again.

A strand that touches guides goes around them from seat to seat on the taut string, whose length stands in (a) for the
distance; its directions at both ends are the gradient. Its links are chords: what they are longer or shorter together
than `Taut.chain_length`, where arcs and straight parts meet, is found by laying them and added.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from warpchain.assembly.path import ChainPath
from warpchain.assembly.taut import Taut, TautError, point, taut
from warpchain.assembly.walk import Curve
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


@dataclass
class Seating:
    """A chain seated on its sprockets; S sprockets, as many strands.

    Attributes:
        first_angle: S polar angles of the seats that hold the first roller of each sprocket [rad].
        seats: S numbers of seated rollers.
        links: S numbers of links of the strands.
        strain: strain of the strands' links, negative in a slack chain.
    """

    first_angle: list[float]
    seats: list[int]
    links: list[int]
    strain: float


def seat_chain(drive: Drive, path: ChainPath) -> Seating:
    """Seats the chain of a drive whose number of links fits its path.

    Raises:
        DriveError: where a strand has no room for a link, a sprocket has fewer teeth than rollers to hold, or no
            placement closes the chain; the message names where.
    """
    loop = _Loop(drive, path)
    seating = loop.count(drive, path)
    for _ in range(_ROUNDS):
        loop.close(seating)
        if not loop.adjust(seating):
            return seating
    loop.close(seating)
    return seating


def seat_string(drive: Drive, path: ChainPath, seating: Seating, k: int) -> Taut | None:
    """Strand k from seat to seat around the guides that it touches; None where it is straight."""
    return _Loop(drive, path).string(seating, k)


def forth(roller: int) -> int:
    """1 where an outer link ends at a roller, -1 where one begins (`Drive.riding_lean`)."""
    return 1 if roller % 2 else -1


class _Loop:
    """A drive's sprockets as plain numbers, in the order of the chain's travel."""

    def __init__(self, drive: Drive, path: ChainPath) -> None:
        self.size = len(drive.sprockets)
        self.driver = drive.driver
        self.names = [sprocket.name for sprocket in drive.sprockets]
        self.center = [tuple(initial_center(sprocket).tolist()) for sprocket in drive.sprockets]
        self.teeth = [sprocket.teeth for sprocket in drive.sprockets]
        self.pitch_angle = [2.0 * math.pi / teeth for teeth in self.teeth]
        self.step = [sprocket.sign * angle for sprocket, angle in zip(drive.sprockets, self.pitch_angle, strict=True)]
        self.radius = [float(radius) for radius in path.radius]
        self.lean = [sprocket.sign * drive.riding_lean(s) for s, sprocket in enumerate(drive.sprockets)]
        self.pitch = path.pitch
        self.runs = [runs if path.strings[k] is not None else () for k, runs in enumerate(path.obstacles)]
        self.guides = [guide.name for guide in drive.guides]
        self.chords = [0.0] * self.size  # what links laid on a string measure beyond its chain length [m]
        self.links = drive.chain.pulled_lengths
        self.reach = np.concatenate([[0.0], np.cumsum(np.tile(drive.chain.pulled_lengths, 2))])

    def count(self, drive: Drive, path: ChainPath) -> Seating:
        """The whole numbers and the first guess of the angles, from the path measured in pitches."""
        seating = Seating([0.0] * self.size, [0] * self.size, [0] * self.size, path.nominal_strain)
        link = path.pitch * (1.0 + path.nominal_strain)
        position, previous = 0.0, 0
        for turn in range(self.size):
            s = (self.driver + turn) % self.size
            first = math.ceil(position - 0.5 - _TIE)
            seating.first_angle[s] = float(path.arrival_angle[s]) + (first - position) * self.step[s]
            if turn > 0:
                seating.links[s - 1] = first - previous
            position += float(path.wrap_angle[s]) / self.pitch_angle[s]
            previous = math.floor(position + 0.5 + _TIE)
            seating.seats[s] = previous - first + 1
            position += float(path.strand_length[s]) / link
        seating.links[self.driver - 1] = drive.chain.links - previous
        self._check_counts(seating, path)
        return seating

    def _check_counts(self, seating: Seating, path: ChainPath) -> None:
        for s, name in enumerate(self.names):
            if seating.seats[s] > self.teeth[s]:
                raise DriveError(
                    f'sprocket "{name}": the chain would put {seating.seats[s]} rollers on it, '
                    f"allowed are at most its {self.teeth[s]} teeth"
                )
            if seating.links[s] < 1:
                raise DriveError(
                    f'strand "{name}->{self.names[(s + 1) % self.size]}": {path.strand_length[s]:.6g} m long, '
                    f"which leaves no link between the seats; allowed is more than the pitch, {self.pitch:.6g} m"
                )

    def last_angle(self, seating: Seating, s: int) -> float:
        """Polar angle of the seat that holds the last roller of sprocket s."""
        return seating.first_angle[s] + (seating.seats[s] - 1) * self.step[s]

    def ends(self, seating: Seating, k: int) -> tuple[float, float]:
        """Polar angles of the last roller before strand k and of the first one after it."""
        following = (k + 1) % self.size
        last = sum(seating.seats[: k + 1]) + sum(seating.links[:k]) - 1 - k
        leave = self.last_angle(seating, k) + forth(last) * self.lean[k]
        return leave, seating.first_angle[following] + forth(last + seating.links[k]) * self.lean[following]

    def string(self, seating: Seating, k: int) -> Taut | None:
        """Strand k from seat to seat around its guides; None where it touches none."""
        if not self.runs[k]:
            return None
        following = (k + 1) % self.size
        leave, arrive = self.ends(seating, k)
        try:
            string = taut(point(self._seat(k, leave)), point(self._seat(following, arrive)), self.runs[k])
        except TautError as error:
            raise DriveError(f"guides.{self.guides[error.guide]}: {error}") from None
        return string if string.touches else None

    def _seat(self, s: int, polar: float) -> tuple[float, float]:
        (x, y), radius = self.center[s], self.radius[s]
        return x + radius * math.cos(polar), y + radius * math.sin(polar)

    def span(self, seating: Seating, k: int) -> tuple[float, tuple[float, float], tuple[float, float]]:
        """Length of strand k from seat to seat [m], and the unit vectors along which it leaves and arrives."""
        string = self.string(seating, k)
        if string is None:
            x, y, length, _, _ = self.chord(seating, k)
            return length, (x, y), (x, y)
        return string.chain_length(self.pitch) + self.chords[k], direction(string.first), direction(string.last)

    def inward(self, seating: Seating, k: int) -> tuple[float, float]:
        """Unit vectors of strand k where it leaves and arrives, times the outward unit vectors of the seats there."""
        if not self.runs[k]:
            _, _, _, first, last = self.chord(seating, k)
            return first, last
        _, (x, y), (u, v) = self.span(seating, k)
        leave, arrive = self.ends(seating, k)
        return x * math.cos(leave) + y * math.sin(leave), u * math.cos(arrive) + v * math.sin(arrive)

    def laid(self, seating: Seating, k: int) -> float:
        """What the links of strand k, laid as chords on its string, measure beyond its chain length [m]."""
        string = self.string(seating, k)
        if string is None:
            return 0.0
        roller = sum(seats - 1 for seats in seating.seats[: k + 1]) + sum(seating.links[:k])
        links = self.links[np.arange(roller, roller + seating.links[k]) % len(self.links)]
        return Curve(string.pieces).scale(links) * float(links.sum()) - string.chain_length(self.pitch)

    def chord(self, seating: Seating, k: int) -> tuple[float, float, float, float, float]:
        """Strand k from seat to seat: its unit vector's components and length; the last two are its unit vector times
        the outward unit vectors of its first and last seat."""
        following = (k + 1) % self.size
        leave, arrive = self.ends(seating, k)
        cos_leave, sin_leave = math.cos(leave), math.sin(leave)
        cos_arrive, sin_arrive = math.cos(arrive), math.sin(arrive)
        x = self.center[following][0] + self.radius[following] * cos_arrive
        y = self.center[following][1] + self.radius[following] * sin_arrive
        x -= self.center[k][0] + self.radius[k] * cos_leave
        y -= self.center[k][1] + self.radius[k] * sin_leave
        length = math.hypot(x, y)
        x, y = x / length, y / length
        return (
            x,
            y,
            length,
            x * cos_leave + y * sin_leave,
            x * cos_arrive + y * sin_arrive,
        )

    def natural(self, seating: Seating) -> list[float]:
        """Unloaded lengths of the strands: the sums of their own links'."""
        lengths, roller = [], 0
        for seats, links in zip(seating.seats, seating.links, strict=True):
            roller += seats - 1
            lengths.append(float(self.reach[roller + links] - self.reach[roller]))
            roller += links
        return lengths

    def close(self, seating: Seating) -> None:
        """Solves the closing conditions (a) for the whole numbers as they stand."""
        lengths = self.natural(seating)
        for _ in range(_LAYINGS if any(self.runs) else 1):
            self._solve(seating, lengths)
            before, self.chords = self.chords, [self.laid(seating, k) for k in range(self.size)]
            if max(abs(a - b) for a, b in zip(before, self.chords, strict=True)) <= 1e-3 * _CLOSED * self.pitch:
                break

    def _solve(self, seating: Seating, lengths: list[float]) -> None:
        self._newton(seating, lengths, lengths)
        if seating.strain < 0.0 and 1 in seating.links:
            sagging = [length if links > 1 else 0.0 for links, length in zip(seating.links, lengths, strict=True)]
            if not any(sagging):
                raise DriveError("chain.links: the chain is slack, but no strand has a second link with which to sag")
            self._newton(seating, lengths, sagging)

    def _newton(self, seating: Seating, lengths: list[float], elastic: list[float]) -> None:
        """Newton's method; `elastic` is the part of each strand's unloaded length that takes the strain.

        Column `driver` of the Jacobian belongs to the strain, the others to the sprockets' angles.
        """
        size, pitch = self.size, self.pitch
        worst = math.inf
        for _ in range(_ITERATIONS):
            jacobian = np.zeros((size, size))
            residual = np.zeros(size)
            for k in range(size):
                following = (k + 1) % size
                length, (x, y), (u, v) = self.span(seating, k)
                residual[k] = length - lengths[k] - elastic[k] * seating.strain
                leave, arrive = self.ends(seating, k)
                jacobian[k, following] = self.radius[following] * (v * math.cos(arrive) - u * math.sin(arrive))
                jacobian[k, k] = -self.radius[k] * (y * math.cos(leave) - x * math.sin(leave))
                jacobian[k, self.driver] = -elastic[k]
            before, worst = worst, float(np.abs(residual).max())
            if 0.5 * before <= worst <= _CLOSED * pitch:  # round-off is reached
                return
            try:
                change = np.linalg.solve(jacobian, -residual)
            except np.linalg.LinAlgError:
                break
            angles = [s for s in range(size) if s != self.driver]
            scale = min(
                1.0,
                0.5 / max(1e-300, max(abs(change[s]) / self.pitch_angle[s] for s in angles)),
            )
            for s in angles:
                seating.first_angle[s] += scale * float(change[s])
            seating.strain += scale * float(change[self.driver])
        total = sum(seating.links) + sum(seating.seats) - size
        raise DriveError(
            f"chain.links = {total}: no placement with the seated rollers on their seats closes the chain "
            f"(a gap of {worst:.3g} m remains)"
        )

    def adjust(self, seating: Seating) -> bool:
        """Adds and gives back seats at both ends of every strand; True if anything has changed.

        The driver's first seat stays, since it carries the angle that is not solved for.
        """
        link = self.pitch * (1.0 + max(seating.strain, 0.0))
        changed = False
        for k in range(self.size):
            following = (k + 1) % self.size
            leave, arrive = self.inward(seating, k)
            change = self._missing(seating, k, k, -leave, link)
            seating.seats[k] += change
            seating.links[k] -= change
            changed = changed or change != 0
            if following != self.driver:
                change = self._missing(seating, k, following, arrive, link)
                seating.seats[following] += change
                seating.links[k] -= change
                seating.first_angle[following] -= change * self.step[following]
                changed = changed or change != 0
        return changed

    def _missing(self, seating: Seating, k: int, s: int, inward: float, link: float) -> int:
        """+1, -1 or 0: seats to add on sprocket s where strand k ends on it.

        `inward` is the cosine between the strand's direction towards the sprocket and the seat's outward vector e, the
        sine of the angle by which the seat lies within the arc. A straight strand's next roller, a link L away, stands
        at the radius sqrt(R^2 - 2 R L inward + L^2): inside the pitch circle, in the next gap, if inward > L / (2 R).
        Beyond half a pitch angle outside the arc the strand bends away from the seat.
        """
        radius = self.radius[s]
        if link * (link - 2.0 * radius * inward) < -_TIE * self.pitch * radius:
            return 1 if seating.links[k] > 1 and seating.seats[s] < self.teeth[s] else 0
        if -inward > math.sin((0.5 + _SPARE) * self.pitch_angle[s]):
            return -1 if seating.seats[s] > 1 else 0
        return 0
