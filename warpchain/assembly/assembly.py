"""The initial state of a drive: every roller of a wrapped arc on a seat, every strand drawn from seat to seat.

A taut chain's strands are straight and all their links are strained alike. A slack chain's links have exactly their
unloaded length l_i: the links of a strand of chord C are chords of a circular arc of radius rho through both end seats.
With 2 y_i the angle that link i takes at the arc's center, Y_i = y_1 + ... + y_i and Y their sum over all,

    2 rho sin(Y) = C,   sin(y_i) = l_i / (2 rho),                                               (a)
    x_i = C sin(Y_i) cos(Y - Y_i) / sin(Y),   h_i = C sin(Y_i) sin(Y - Y_i) / sin(Y)             (b)

are roller i's places along the chord and off it, on the side of gravity (outward of the loop where gravity does not
tell). Links on a wrapped arc carry no force: where wear has made them longer than the sprocket's pitch, the rollers
stand off their seats, at the radius where links of that length span a tooth each, an outer and an inner one of unlike
lengths two teeth. Only a sprocket's pitch above the chain's, or a single link unlike the others, carries the stiffness
times the difference from the start, until settling.

The driver, the first prescribed sprocket, has a seat exactly where the chain's path arrives on it, which is where the
strand that it pulls ends; or `run.phase` teeth further on. The other angles follow (see `warpchain.assembly.seating`).
Seat 0 of every sprocket is the one nearest to the x direction, so that sprocket angles are within half a pitch angle of
zero.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly.arms import balanced
from warpchain.assembly.path import ChainPath, check_fit
from warpchain.assembly.route import chain_path
from warpchain.assembly.seating import Seating, seat_chain, seat_string
from warpchain.assembly.tables import initial_speed
from warpchain.assembly.taut import Taut
from warpchain.assembly.walk import Curve
from warpchain.drive.copies import turned_on
from warpchain.drive.mounts import initial_center, initial_velocity
from warpchain.drive.profile import direction

if TYPE_CHECKING:
    from warpchain.drive import Drive, Sprocket

_STRAIGHT = 1e-12  # a strand this little slack is drawn straight
_BALANCES = 12  # of arms; each leaves some percent of what is wrong
_STILL = 1e-9  # rad
_TIE = 1e-9  # of a pitch angle, or of gravity's direction: which way round-off must not decide


@dataclass(frozen=True)
class Assembly:
    """The assembled state of a drive of N rollers and S sprockets; the chain travels towards increasing index.

    Roller 0 is the first seated roller of sprocket 0.

    Attributes:
        position: (N, 2) roller centers [m].
        velocity: (N, 2) roller velocities [m/s].
        sprocket_angle: (S,) sprocket angles, counter-clockwise [rad].
        sprocket_speed: (S,) sprocket angular velocities, counter-clockwise [rad/s].
        seat_sprocket: (N,) int32, the sprocket on which the roller sits, -1 in a strand.
        seat_index: (N,) int32, the seat that holds the roller, in 0..teeth - 1, or -1; seat j is at the polar angle
            sprocket angle + j 2 pi / teeth.
        strand_first: (S,) index of the roller on the last seat before strand k.
        strand_links: (S,) number of links of strand k, from that seat to the first of the next sprocket.
        strain: strain of the strands' links; a slack chain (below 0) has a chord shorter than its links by that.
        path: the path of the chain.
        arm_angle: (A,) angles of the arms, counter-clockwise [rad]; 0 as drawn.
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


def assemble(drive: Drive) -> Assembly:
    """The drive's initial state, before settling.

    Sprockets at fixed speed have their own initial speed; free sprockets and the strands move along the path at the
    driver's pitch-circle speed.

    Raises:
        DriveError: where the path cannot be drawn or the number of links does not fit it; one line that names the
            sprockets, or the numbers of links that fit.
    """
    path, seating = _seated(drive)
    angle, first_seat = _sprocket_angles(drive, seating)
    speed = _sprocket_speeds(drive, path)

    count, lengths = drive.chain.links, drive.chain.pulled_lengths
    position, velocity = np.empty((count, 2)), np.empty((count, 2))
    seat_sprocket, seat_index = (
        np.full(count, -1, dtype=np.int32),
        np.full(count, -1, dtype=np.int32),
    )
    first, last = _ends(seating)
    for s, sprocket in enumerate(drive.sprockets):
        rollers = slice(first[s], last[s] + 1)
        seat = (first_seat[s] + sprocket.sign * np.arange(seating.seats[s])) % sprocket.teeth
        lean = sprocket.sign * drive.riding_lean(s) * np.where(np.arange(first[s], last[s] + 1) % 2, 1.0, -1.0)
        polar = angle[s] + seat * (2.0 * math.pi / sprocket.teeth) + lean
        arm = path.radius[s] * np.stack([np.cos(polar), np.sin(polar)], axis=1)
        position[rollers] = initial_center(sprocket) + arm
        velocity[rollers] = initial_velocity(sprocket) + speed[s] * np.stack([-arm[:, 1], arm[:, 0]], axis=1)
        seat_sprocket[rollers], seat_index[rollers] = s, seat
    slack = seating.strain < -_STRAIGHT
    for k, links in enumerate(seating.links):
        begin, end = last[k], first[(k + 1) % len(first)]
        rollers = slice(begin + 1, begin + links)
        natural = lengths[np.arange(begin, begin + links) % count]
        strand = path.strings[k] and seat_string(drive, path, seating, k)
        if strand:
            at, velocity[rollers] = _around(strand, natural, velocity[begin], velocity[end], path, drive.run.gravity)
            position[rollers] = at
            continue
        fraction = (np.cumsum(natural) / natural.sum())[:-1, None]
        velocity[rollers] = velocity[begin] + fraction * (velocity[end] - velocity[begin])
        chord = position[end] - position[begin]
        if slack and links > 1:
            position[rollers] = position[begin] + _arc(chord, natural, path, drive.run.gravity)
        else:
            position[rollers] = position[begin] + fraction * chord
    return Assembly(
        position=position,
        velocity=velocity,
        sprocket_angle=np.array(angle),
        sprocket_speed=speed,
        seat_sprocket=seat_sprocket,
        seat_index=seat_index,
        strand_first=np.array(last, dtype=np.int32),
        strand_links=np.array(seating.links, dtype=np.int32),
        strain=seating.strain,
        path=path,
        arm_angle=path.arm_angle,
    )


def assembled_path(drive: Drive) -> ChainPath:
    """The path of the assembled chain: `chain_path`, but with arms where the chain on its seats holds them.

    Raises:
        DriveError: as `assemble`, where there are arms; else as `chain_path`.
    """
    return _seated(drive)[0] if drive.arms else chain_path(drive)


def _seated(drive: Drive) -> tuple[ChainPath, Seating]:
    """Path and seats; arms in balance with the strain of the chain on its seats."""
    path = chain_path(drive)
    check_fit(drive, path)
    seating = seat_chain(drive, path)
    if not drive.arms:
        return path, seating
    for _ in range(_BALANCES):
        before = path.arm_angle
        path = balanced(drive, seating.strain - path.nominal_strain, before)
        seating = seat_chain(drive, path)
        if float(np.abs(path.arm_angle - before).max()) <= _STILL:
            break
    return path, seating


def _around(
    string: Taut,
    natural: NDArray[np.float64],
    begin: NDArray[np.float64],
    end: NDArray[np.float64],
    path: ChainPath,
    gravity: Sequence[float],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Places and velocities (links - 1, 2) of the rollers of a strand that touches guides.

    A taut strand's links, strained alike, are chords of its string. A slack one's are unstrained, and what they are too
    long hangs in the longest straight part.

    Args:
        begin, end: velocities of the end rollers (2,) [m/s].
    """
    curve = Curve(string.pieces)
    scale = curve.scale(natural)
    places = curve.places(scale * natural)
    points = curve.points(places)
    if scale < 1.0 - _STRAIGHT:
        low = curve.begins[curve.longest]
        high = low + curve.pieces[curve.longest].length
        inner = [i for i, s in enumerate(places) if low <= s <= high]
        ahead, back = curve.points(curve.places(natural)), curve.reversed()
        behind = back.points(back.places(natural[::-1]))[::-1]
        if len(inner) > 2:
            a, b = inner[0], inner[-1]
            points[: a + 1], points[b:] = ahead[: a + 1], behind[b:]
            points[a + 1 : b] = points[a] + _arc(points[b] - points[a], natural[a:b], path, gravity)
    share = np.linspace(0.0, 1.0, len(places))[1:-1]
    speed = (1.0 - share) * np.hypot(*begin) + share * np.hypot(*end)
    heading = np.array([curve.at(s)[1] for s in places[1:-1]])
    sense = 1.0 if begin @ np.array(direction(string.first)) >= 0.0 else -1.0
    return points[1:-1], sense * speed[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=1)


def _ends(seating: Seating) -> tuple[list[int], list[int]]:
    """Indices of the first and the last roller on each sprocket."""
    first, last, roller = [], [], 0
    for seats, links in zip(seating.seats, seating.links, strict=True):
        first.append(roller)
        last.append(roller + seats - 1)
        roller += seats - 1 + links
    return first, last


def _sprocket_angles(drive: Drive, seating: Seating) -> tuple[list[float], list[int]]:
    """Sprocket angles within half a pitch angle of zero, and the seat that then holds each first roller."""
    angles, seats = [], []
    for sprocket, polar in zip(drive.sprockets, seating.first_angle, strict=True):
        pitch_angle = 2.0 * math.pi / sprocket.teeth
        seat = math.ceil(polar / pitch_angle - 0.5 - _TIE)
        angles.append(polar - seat * pitch_angle)
        seats.append(seat)
    return angles, seats


def _sprocket_speeds(drive: Drive, path: ChainPath) -> NDArray[np.float64]:
    """Initial angular velocities (S,) [rad/s]: prescribed, or at the driver's pitch-circle speed."""
    travel = _prescribed_speed(drive, drive.sprockets[drive.driver]) * float(path.radius[drive.driver])
    speeds = [
        travel / float(path.radius[s]) if sprocket.prescribed is None else _prescribed_speed(drive, sprocket)
        for s, sprocket in enumerate(drive.sprockets)
    ]
    return np.array([sprocket.sign * speed for sprocket, speed in zip(drive.sprockets, speeds, strict=True)])


def _prescribed_speed(drive: Drive, sprocket: Sprocket) -> float:
    """Forward speed at t = 0 [rad/s]: zero if it is ramped up, else with its harmonics."""
    motion = sprocket.prescribed
    if motion is None or motion.ramp_time > 0.0:
        return 0.0
    motion = turned_on(drive, sprocket, motion)
    speed = initial_speed(motion.table) if motion.table is not None else motion.top_speed
    return speed * (1.0 + sum(h.amplitude * math.cos(h.phase) for h in motion.harmonics))


def _arc(
    chord: NDArray[np.float64], natural: NDArray[np.float64], path: ChainPath, gravity: Sequence[float]
) -> NDArray[np.float64]:
    """The rollers between the ends of a sagging strand (links - 1, 2), from its first end [m]; (b) above."""
    length = math.hypot(chord[0], chord[1])
    along = chord / length
    off = np.array([-along[1], along[0]])
    pull = float(off @ np.asarray(gravity, dtype=float))
    if abs(pull) <= _TIE * math.hypot(*gravity):
        pull = -path.turning
    if pull < 0.0:
        off = -off
    angle = _half_angles(length, natural)
    whole = float(angle.sum())
    if whole == 0.0:
        return (np.cumsum(natural) / natural.sum())[:-1, None] * chord
    passed = np.cumsum(angle)[:-1]
    sine = length * np.sin(passed) / math.sin(whole)
    return (sine * np.cos(whole - passed))[:, None] * along + (sine * np.sin(whole - passed))[:, None] * off


def _half_angles(chord: float, natural: NDArray[np.float64]) -> NDArray[np.float64]:
    """Half the angle y_i that each link takes at the center of a sagging strand's arc [rad], from (a): Newton's method.

    Sought is the square of the curvature c = 1 / (2 rho), y_i = asin(c l_i), in which the chord sin(sum y_i) / c = l -
    (l^3 - sum l_i^3) c^2 / 6 + ... is nearly straight.
    """
    total = float(natural.sum())
    square = 6.0 * (total - chord) / (total**3 - float((natural**3).sum()))
    if square <= 0.0:
        return np.zeros_like(natural)
    for _ in range(20):
        curvature = math.sqrt(square)
        angle = np.arcsin(curvature * natural)
        whole = float(angle.sum())
        value = math.sin(whole) / curvature
        if abs(chord - value) <= 4e-16 * total:
            break
        spread = float((natural / np.cos(angle)).sum())
        slope = (math.cos(whole) * spread - value) / (2.0 * square)
        square += (chord - value) / slope
    return np.arcsin(math.sqrt(square) * natural)
