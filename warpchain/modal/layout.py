"""Which rollers of a standing drive lie on which sprocket, and which in which strand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly import Assembly


@dataclass(frozen=True)
class Layout:
    """Parts of a chain of N rollers around S sprockets.

    Attributes:
        arc: (N,) the sprocket on which a roller lies, from the first that touches its teeth to the last; else -1.
        strand: (N,) the strand in which it hangs, else -1.
        free_links: (N,) whether a link is one of a strand's: one of its ends at least hangs.
    """

    arc: NDArray[np.int64]
    strand: NDArray[np.int64]
    free_links: NDArray[np.bool_]


def layout(assembly: Assembly, touching: NDArray[np.bool_]) -> Layout:
    """The parts of a chain.

    Args:
        assembly: how it was laid around its sprockets.
        touching: (S, N) which rollers touch which sprocket.
    """
    count = touching.shape[1]
    sprockets = len(assembly.strand_first)
    arc = np.full(count, -1)
    last = np.asarray(assembly.strand_first, dtype=np.int64)
    first = np.roll(last + np.asarray(assembly.strand_links), 1)
    first = np.where(first > last, first - count, first)
    for s in range(sprockets):
        middle = (first[s] + last[s]) // 2
        off = (np.flatnonzero(touching[s]) - middle + count // 2) % count - count // 2
        if len(off):
            first[s], last[s] = middle + off.min(), middle + off.max()
            arc[np.arange(first[s], last[s] + 1) % count] = s
        else:
            first[s] = last[s] = middle
    strand = np.full(count, -1)
    for s in range(sprockets):
        end = first[(s + 1) % sprockets]
        hanging = np.arange(last[s], last[s] + (end - last[s]) % count + 1) % count
        strand[hanging[arc[hanging] < 0]] = s
    return Layout(arc, strand, (arc < 0) | (np.roll(arc, -1) < 0))
