"""Laying of links along a curve of pieces: rollers on the curve, links its chords.

Curves of V variants are one, with numbers (V,).
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from functools import cached_property
from itertools import accumulate
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpchain.drive.face_profile import Piece, unit_vector
from warpchain.drive.stack_math import (
    Number,
    array_of_columns,
    has_arrays,
    index_of_maximum,
    is_true_everywhere,
    is_true_somewhere,
    maximum,
    minimum,
    quick_arcsin,
    quick_hypot,
    shared_value,
    where,
    with_last_axis,
)

_NEWTON = 30
_NEAR = 1e-10  # of a link: what is left after a step of Newton's method that small is round-off
_EXACT = 4e-16  # of the curve
_CLOSE = 1e-12  # of the curve; from there on a step to the end leaves round-off


def _length_along_piece(link: Number, curvature: Number) -> Number:
    """Length along a curve's piece that a laid link takes [m]."""
    half = 0.5 * link * abs(curvature)
    bends, otherwise = (half > 0.0) & (half < 1.0), where(half == 0.0, link, math.inf)
    if not is_true_somewhere(bends):
        return otherwise
    safe = where(bends, half, 1.0)
    return where(bends, link * quick_arcsin(safe) / safe, otherwise)


def _table_of_pieces(values: Sequence[Number]) -> NDArray[np.float64]:
    """Table (P, V) or (P, 1) of pieces' numbers or arrays (V,)."""
    return np.atleast_2d(array_of_columns(values)).T


def _rows_of_pieces(table: NDArray[np.float64], i: NDArray[np.int64]) -> NDArray[np.float64]:
    """Rows of a table (P, V, ...) for pieces i (V,)."""
    return table[i, np.arange(len(i)) if table.shape[1] > 1 else 0]


class LayingCurve:
    """Curve on which links are laid: straight pieces and arcs, extended straight at both ends."""

    def __init__(self, pieces: Sequence[Piece]) -> None:
        self.pieces = tuple(pieces)
        self.begins = [0.0, *accumulate(piece.length for piece in self.pieces)]
        self.length = self.begins.pop()
        self.ends = [begin + piece.length for begin, piece in zip(self.begins, self.pieces, strict=True)]
        self.stacked = has_arrays(self.length)

    @property
    def longest(self) -> int:
        """Index of a curve's longest straight piece."""
        straight = [0.0 if is_true_somewhere(piece.curvature != 0.0) else piece.length for piece in self.pieces]
        return int(shared_value(index_of_maximum(straight)))

    @cached_property
    def tables(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Start, heading, curvature, length and begin (P, V, 6), and end (P, V), of a curve's pieces."""
        columns = zip(*((*p.start, p.heading, p.curvature, p.length) for p in self.pieces), strict=True)
        tables = np.broadcast_arrays(*map(_table_of_pieces, columns), _table_of_pieces(self.begins))
        return np.stack(tables, axis=-1), _table_of_pieces(self.ends)

    def _piece_index(self, s: Number) -> Number:
        """Index of a curve's piece at an arc length."""
        if not has_arrays(s) and not self.stacked:
            return min(max(bisect_right(self.begins, s) - 1, 0), len(self.pieces) - 1)
        found = np.zeros(np.broadcast(s, self.length).shape, dtype=np.int64)
        for begin in self.begins[1:]:
            found += s >= begin
        return found

    def at(self, s: Number) -> tuple[tuple[Number, Number], Number]:
        """Point [m] and heading [rad] of a curve at an arc length."""
        i = self._piece_index(s)
        if has_arrays(i):
            x, y, heading, curvature, length, begin = _rows_of_pieces(self.tables[0], i).T
            piece = Piece((x, y), heading, curvature, length)
        else:
            piece, begin = self.pieces[i], self.begins[i]
        inner = s - begin
        held = minimum(maximum(inner, 0.0), piece.length)
        (x, y), heading = piece.at(held)
        if is_true_somewhere(held != inner):
            ux, uy = unit_vector(heading)
            x, y = x + (inner - held) * ux, y + (inner - held) * uy
        return (x, y), heading

    def _link_end(self, s: Number, link: Number) -> Number:
        """Arc length of a laid link's end on another piece of the curve [m]."""
        (x, y), _ = self.at(s)
        ahead, done = s + link, False
        for _ in range(_NEWTON):
            (px, py), heading = self.at(ahead)
            dx, dy = px - x, py - y
            chord = quick_hypot(dx, dy)
            ux, uy = unit_vector(heading)
            change = (link - chord) * chord / (dx * ux + dy * uy)
            ahead = where(done, ahead, ahead + change)
            done = done | (abs(change) <= _NEAR * link)
            if is_true_everywhere(done):
                break
        return ahead

    def places(self, links: NDArray[np.float64]) -> list[Number]:
        """Arc lengths of rollers of links (n,) or (V, n) laid along a curve from 0 [m]."""
        alike = bool((links == links[..., :1]).all())
        stacked = self.stacked or links.ndim > 1
        ends: Any = self.tables[1] if stacked else self.ends
        found: list[Number] = [0.0]
        s: Number = np.zeros(np.broadcast(self.length, links[..., 0]).shape) if stacked else 0.0
        reaches: Any = None
        for link in links.tolist() if links.ndim == 1 else links.T.copy():
            if reaches is None or not alike:
                reaches = [_length_along_piece(link, piece.curvature) for piece in self.pieces]
                reaches = _table_of_pieces(reaches) if stacked else reaches
            i = self._piece_index(s)
            ahead = s + (_rows_of_pieces(reaches, i) if stacked else reaches[i])
            fits = ahead <= (_rows_of_pieces(ends, i) if stacked else ends[i])
            s = ahead if fits is True or is_true_everywhere(fits) else where(fits, ahead, self._link_end(s, link))
            found.append(s)
        return found

    def points(self, places: Sequence[Number]) -> NDArray[np.float64]:
        """Points (n, 2) or (V, n, 2) of a curve at arc lengths [m]."""
        points = [self.at(s)[0] for s in places]
        return np.stack([array_of_columns([point[axis] for point in points]) for axis in range(2)], axis=-1)

    def reversed_curve(self) -> LayingCurve:
        """The curve in the opposite direction."""
        return LayingCurve([piece.reversed_piece() for piece in reversed(self.pieces)])

    def scale(self, links: NDArray[np.float64], guess: Number | None = None) -> Number:
        """Factor on links (n,) or (V, n) that, laid as chords, span a curve."""
        factor, known = self.length / summed_lengths(links) if guess is None else guess, (0.0, 0.0)
        near, done = 4.0 * _EXACT * self.length * links.shape[-1] ** 0.5, False
        first, close = True, 0.0 if guess is None else _CLOSE * self.length
        for _ in range(_NEWTON):
            over = self.places(with_last_axis(factor) * links)[-1] - self.length
            if guess is None:
                done = done | (abs(over) <= near)
                if is_true_everywhere(done):
                    break
            with np.errstate(divide="ignore", invalid="ignore"):
                slope = self.length / factor if first else (over - known[1]) / (factor - known[0])
                known, first = (factor, over), False
                done = done | (slope <= 0.0) | (over == 0.0)
                factor = where(done, factor, factor - over / slope)
                done = done | (abs(over) <= close)
            if is_true_everywhere(done):
                break
        return factor


def summed_lengths(links: NDArray[np.float64]) -> Number:
    """Sum of laid links' lengths (n,) or (V, n) [m]."""
    return float(links.sum()) if links.ndim == 1 else links.sum(axis=1)
