"""Links laid along a curve of straight pieces and arcs: every roller on the curve, every link a chord of it."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from warpchain.drive.profile import Piece, Point, direction

_NEWTON = 30
_NEAR = 1e-10  # of a link: what is left after a step of Newton's method that small is round-off
_EXACT = 4e-16  # of the curve


class Curve:
    """Pieces that follow each other, drawn out straight at both ends.

    Args:
        pieces: at least one.
    """

    def __init__(self, pieces: Sequence[Piece]) -> None:
        self.pieces = tuple(pieces)
        self.begins = [0.0, *accumulate(piece.length for piece in self.pieces)]
        self.length = self.begins.pop()
        self.ends = [begin + piece.length for begin, piece in zip(self.begins, self.pieces, strict=True)]
        self.longest = max(range(len(self.pieces)), key=lambda i: self._straight(i))

    def _straight(self, i: int) -> float:
        return 0.0 if self.pieces[i].curvature else self.pieces[i].length

    def at(self, s: float) -> tuple[Point, float]:
        """The point [m] and the heading [rad] at the arc length s [m]."""
        i = min(max(bisect_right(self.begins, s) - 1, 0), len(self.pieces) - 1)
        piece = self.pieces[i]
        inner = s - self.begins[i]
        held = min(max(inner, 0.0), piece.length)
        (x, y), heading = piece.at(held)
        if held != inner:
            ux, uy = direction(heading)
            x, y = x + (inner - held) * ux, y + (inner - held) * uy
        return (x, y), heading

    def _over(self, s: float, link: float) -> float:
        """Where a link that begins at s and ends on another piece ends [m], by Newton's method."""
        (x, y), _ = self.at(s)
        ahead = s + link
        for _ in range(_NEWTON):
            (px, py), heading = self.at(ahead)
            dx, dy = px - x, py - y
            chord = math.hypot(dx, dy)
            ux, uy = direction(heading)
            change = (link - chord) * chord / (dx * ux + dy * uy)
            ahead += change
            if abs(change) <= _NEAR * link:
                break
        return ahead

    def _along(self, i: int, link: float) -> float:
        """How far a link reaches that begins and ends on piece i [m]."""
        half = 0.5 * link * abs(self.pieces[i].curvature)
        return link if half == 0.0 else link * math.asin(half) / half if half < 1.0 else math.inf

    def places(self, links: NDArray[np.float64]) -> list[float]:
        """Where the rollers stand [m]: one more than there are links, the first at 0."""
        found, s, i, of = [0.0], 0.0, -1, math.nan
        for link in links.tolist():
            while i + 1 < len(self.begins) and self.begins[i + 1] <= s:
                i, of = i + 1, math.nan
            if link != of:
                reach, of = self._along(i, link), link
            s = s + reach if s + reach <= self.ends[i] else self._over(s, link)
            found.append(s)
        return found

    def points(self, places: Sequence[float]) -> NDArray[np.float64]:
        """(n, 2) points at arc lengths [m]."""
        return np.array([self.at(s)[0] for s in places]).reshape(-1, 2)

    def reversed(self) -> Curve:
        """The curve run the other way."""
        return Curve([piece.turned() for piece in reversed(self.pieces)])

    def scale(self, links: NDArray[np.float64]) -> float:
        """The factor by which links of these lengths must be scaled to go from end to end, each a chord."""
        factor, known = self.length / float(links.sum()), (0.0, 0.0)
        for _ in range(_NEWTON):
            over = self.places(factor * links)[-1] - self.length
            if abs(over) <= 4.0 * _EXACT * self.length * len(links) ** 0.5:
                break
            slope = (over - known[1]) / (factor - known[0]) if known[0] else self.length / factor
            known = (factor, over)
            if slope <= 0.0 or over == 0.0:
                break
            factor -= over / slope
        return factor
