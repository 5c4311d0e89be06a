"""Many drives as the flat arrays that the kernels read: each variant's parts one after the other.

Nothing of one variant depends on another: the packing only decides where its values stand.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpchain.assembly.together import Assemblies
from warpchain.drive.stack import LARGEST
from warpchain.errors import SimulationError
from warpchain.kernels import structs
from warpchain.kernels.rows import STATE_ROWS
from warpchain.results.channels import FRAME, FrameLayout

REAL = {"float64": wp.float64, "float32": wp.float32}


def real_of(precision: str) -> type:
    """Warp's type of a precision; a SimulationError for an unknown one."""
    if precision not in REAL:
        raise SimulationError(f'precision = {precision!r}: allowed are "float64" and "float32"')
    return REAL[precision]


def state_rows(position: NDArray[np.float64], velocity: NDArray[np.float64], precision: str) -> NDArray[np.floating]:
    """Rows x, y, vx, vy and the low parts of x, y: what `precision` rounds off a position, (..., 6, N)."""
    if precision == position.dtype:
        rows = np.zeros((*position.shape[:-2], STATE_ROWS, position.shape[-2]))
        rows[..., 0:2, :], rows[..., 2:4, :] = np.swapaxes(position, -1, -2), np.swapaxes(velocity, -1, -2)
        return rows
    high = position.astype(precision)
    return np.concatenate([np.swapaxes(of, -1, -2) for of in (high, velocity, position - high)], axis=-2).astype(
        precision
    )


Places = slice | NDArray[np.int64]
"""Where values stand: one after the other, or anywhere."""


@dataclass(frozen=True)
class Kind:
    """A kind of thing that arrays hold, variant after variant.

    Attributes:
        first: the field of `kernels.structs.Drive` that says where a variant's begin.
        count: how many each variant has, (variants,), from the rows of `drives`.
    """

    first: str
    count: Callable[[NDArray[Any]], NDArray[Any]]


KINDS = {
    "roller": Kind("first_roller", lambda drives: drives["rollers"]),
    "sprocket": Kind("first_sprocket", lambda drives: drives["sprockets"]),
    "body": Kind("first_body", lambda drives: drives["bodies"]),
    "guide": Kind("first_guide", lambda drives: drives["guides"]),
    "piece": Kind("first_piece", lambda drives: drives["pieces"]),
    "arm": Kind("first_arm", lambda drives: drives["arms"]),
    "tensioner": Kind("first_tensioner", lambda drives: drives["tensioners"]),
    "contact": Kind("first_contact", lambda drives: drives["rollers"] * (drives["sprockets"] + drives["guides"])),
    "tally": Kind("first_tally", lambda drives: drives["rollers"] * (drives["sprockets"] + 1)),
}

FIELDS = {
    "lengths": ("roller", 1),
    "rollers": ("roller", STATE_ROWS),
    "sprockets": ("sprocket", 1),
    "strands": ("sprocket", 1),
    "motions": ("body", 1),
    "mounts": ("body", 1),
    "bodies": ("body", 1),
    "guides": ("guide", 1),
    "pieces": ("piece", 1),
    "arms": ("arm", 1),
    "tensioners": ("tensioner", 1),
    "oil": ("tensioner", 1),
    "tooth_sliding": ("sprocket", 1),
    "guide_sliding": ("guide", 1),
    "seat": ("contact", 1),
}
"""What each array of an ensemble counts by, and how many values each has; a new array of parts needs a row here."""


@cache
def dtype_of(struct: Any) -> np.dtype[Any]:
    """The numpy type of rows of a Warp struct; Warp takes long to lay it out."""
    return np.dtype(struct.numpy_dtype())


def numbered(drives: NDArray[Any]) -> NDArray[Any]:
    """Rows of `kernels.structs.Drive` with the places where their parts begin, one variant after the other."""
    for kind in KINDS.values():
        counts = kind.count(drives).astype(np.int64)
        drives[kind.first] = np.cumsum(counts) - counts
    return drives


def _spread(first: NDArray[np.int64], count: NDArray[np.int64]) -> NDArray[np.int64]:
    """The places `first` to `first + count - 1` of each variant, one after the other."""
    new = np.cumsum(count) - count
    return np.repeat(first - new, count) + np.arange(int(count.sum()))


def spread(first: NDArray[np.integer], count: int) -> NDArray[np.int64]:
    """The places `first` to `first + count - 1` of each variant (V, count)."""
    return np.asarray(first, dtype=np.int64)[:, None] + np.arange(count)


def windows(values: NDArray[Any], first: NDArray[np.integer], count: int) -> NDArray[Any] | None:
    """View (V, count) of the values from `first` (V,) on, which writes to them; None where those lie anyhow."""
    apart = np.diff(first)
    apart_by = int(apart[0]) if len(apart) else count
    if apart_by < count or (apart != apart_by).any():
        return None
    (size,) = values.strides
    return np.lib.stride_tricks.as_strided(values[int(first[0]) :], (len(first), count), (apart_by * size, size))


def taken(values: NDArray[Any], first: NDArray[np.integer], count: int) -> NDArray[Any]:
    """The values from `first` (V,) on, (V, count); to read."""
    view = windows(values, first, count)
    return values[spread(first, count)] if view is None else view


def store(values: NDArray[Any], first: NDArray[np.integer], rows: NDArray[Any]) -> None:
    """Sets the values from `first` (V,) on to `rows` (V, count), or (count,) for all."""
    view = windows(values, first, rows.shape[-1])
    if view is None:
        values[spread(first, rows.shape[-1])] = rows
    else:
        view[:] = rows


def _rows(values: NDArray[Any], places: Places, width: int) -> NDArray[Any]:
    """The values at these places, `width` each; the first of all where there are none, as Warp reads no empty array."""
    if width > 1:
        return values.reshape(-1, width)[places].reshape(-1)
    chosen = values[places]
    return chosen if len(chosen) else values[:1]


@dataclass
class Packed:
    """An ensemble as numpy structured arrays, in the layout of `kernels.structs`, and where each variant's parts begin.

    Attributes:
        drives ... impact_speed: see `kernels.structs.Ensemble` and `.State`.
        rollers: (6 * all rollers,) each variant's rows: x, y, vx, vy, and the low parts of x, y (float32).
        assemblies: the initial states.
        frame: how recorded frames lie.
    """

    precision: str
    drives: NDArray[Any]
    chains: NDArray[Any]
    joints: NDArray[Any]
    links: NDArray[Any]
    lengths: NDArray[np.floating]
    sprockets: NDArray[Any]
    motions: NDArray[Any]
    mounts: NDArray[Any]
    guides: NDArray[Any]
    pieces: NDArray[Any]
    arms: NDArray[Any]
    tensioners: NDArray[Any]
    oil: NDArray[Any]
    tooth_sliding: NDArray[Any]
    guide_sliding: NDArray[Any]
    harmonics: NDArray[np.float64]
    tables: NDArray[np.float64]
    seats: NDArray[np.floating]
    rollers: NDArray[np.floating]
    bodies: NDArray[Any]
    strands: NDArray[Any]
    seat: NDArray[np.int32]
    assemblies: Assemblies
    frame: FrameLayout = FRAME

    @property
    def real(self) -> type:
        """The Warp scalar type of the precision."""
        return REAL[self.precision]

    @property
    def variants(self) -> int:
        """Number of variants."""
        return len(self.assemblies)

    @property
    def slides(self) -> NDArray[np.bool_]:
        """(variants,) whether rollers rub on teeth or guide-bars."""
        found = np.zeros(self.variants, dtype=bool)
        for sliding, counts in ((self.tooth_sliding, "sprockets"), (self.guide_sliding, "guides")):
            owner = np.repeat(np.arange(self.variants), self.drives[counts])
            found[owner[sliding["rubs"][: len(owner)] != 0]] = True
        return found

    @property
    def usual(self) -> NDArray[np.bool_]:
        """(variants,) whether all contacts' laws are hysteretic and linear."""
        found = np.ones(self.variants, dtype=bool)
        for partners, counts in ((self.sprockets, "sprockets"), (self.guides, "guides")):
            owner = np.repeat(np.arange(self.variants), self.drives[counts])
            law = partners["law"][: len(owner)]
            found[owner[(law["exponent"] != 1.0) | (law["form"] != 0)]] = False
        return found

    @property
    def regular(self) -> NDArray[np.bool_]:
        """(variants,) whether all links of a chain are of one length."""
        first = self.drives["first_roller"].astype(np.int64)
        return np.asarray(np.minimum.reduceat(self.lengths, first) == np.maximum.reduceat(self.lengths, first))

    @property
    def stribeck(self) -> NDArray[np.bool_]:
        """(variants,) whether a coefficient of friction depends on the speed."""
        found = self.joints["law"]["mu_static"] != self.joints["law"]["mu_dynamic"]
        for sliding, counts in ((self.tooth_sliding, "sprockets"), (self.guide_sliding, "guides")):
            owner = np.repeat(np.arange(self.variants), self.drives[counts])
            law = sliding["law"][: len(owner)]
            found[owner[law["mu_static"] != law["mu_dynamic"]]] = True
        return np.asarray(found)

    def first_value(self, v: int) -> int:
        """Where variant v's rows begin in `rollers`."""
        return STATE_ROWS * int(self.drives["first_roller"][v])

    def rows(self, v: int) -> NDArray[np.floating]:
        """View of variant v's rows x, y, vx, vy and low parts of x, y, (6, N)."""
        first, n = self.first_value(v), int(self.drives["rollers"][v])
        return self.rollers[first : first + STATE_ROWS * n].reshape(STATE_ROWS, n)

    def alike(self) -> Iterator[tuple[NDArray[np.intp], NDArray[np.int64], int]]:
        """Variants (K,) with the same number of rollers, where their rollers begin (K,), and how many each has.

        At most `LARGEST` at a time, so that what is worked on stays in the processor's caches.
        """
        rollers, first = self.drives["rollers"], self.drives["first_roller"].astype(np.int64)
        for count in np.unique(rollers).tolist():
            variants = np.flatnonzero(rollers == count)
            for some in np.split(variants, range(LARGEST, len(variants), LARGEST)):
                yield some, first[some], count

    def part(self, a: int, b: int) -> Packed:
        """Variants `a` to `b` - 1 as an ensemble of their own, which shares this one's arrays."""
        drives, last = self.drives[a:b].copy(), self.drives[b - 1 : b]
        places = {
            name: slice(int(drives[kind.first][0]), int((last[kind.first] + kind.count(last))[0]))
            for name, kind in KINDS.items()
        }
        return self._of(drives, slice(a, b), places, self.assemblies[a:b])

    def taken(self, which: Sequence[int]) -> Packed:
        """The variants of these indices, each as often as it is named, as an ensemble of their own."""
        chosen = np.asarray(which, dtype=np.int64)
        drives = self.drives[chosen]
        places = {
            name: _spread(drives[kind.first].astype(np.int64), kind.count(drives).astype(np.int64))
            for name, kind in KINDS.items()
        }
        return self._of(drives, chosen, places, self.assemblies.taken(chosen))

    def _of(self, drives: NDArray[Any], chosen: Places, places: Mapping[str, Places], assemblies: Assemblies) -> Packed:
        """The ensemble of `chosen` variants, whose rows are `drives` and whose parts stand at `places` in this one."""
        arrays: dict[str, Any] = {
            name: _rows(getattr(self, name), places[kind], width) for name, (kind, width) in FIELDS.items()
        }
        each: dict[str, Any] = {
            "chains": self.chains[chosen],
            "joints": self.joints[chosen],
            "links": self.links[chosen],
        }
        return replace(self, drives=numbered(drives), assemblies=assemblies, **each, **arrays)

    def at_precision(self, precision: str) -> Packed:
        """This ensemble, which is in float64, at another precision; what positions lose goes to their low parts.

        Raises:
            SimulationError: for an unknown precision.
        """
        kinds = structs.types(real_of(precision))
        if precision == self.precision:
            return self
        rollers = self.rollers.astype(precision)
        other = replace(
            self,
            precision=precision,
            chains=self.chains.astype(dtype_of(kinds.Chain)),
            joints=self.joints.astype(dtype_of(kinds.Joint)),
            links=self.links.astype(dtype_of(kinds.Links)),
            lengths=self.lengths.astype(precision),
            sprockets=self.sprockets.astype(dtype_of(kinds.Sprocket)),
            guides=self.guides.astype(dtype_of(kinds.Guide)),
            tooth_sliding=self.tooth_sliding.astype(dtype_of(kinds.Sliding)),
            guide_sliding=self.guide_sliding.astype(dtype_of(kinds.Sliding)),
            rollers=rollers,
        )
        for _, first, count in self.alike():
            xy = STATE_ROWS * first
            lost = taken(self.rollers, xy, 2 * count) - taken(rollers, xy, 2 * count)
            store(rollers, xy + 4 * count, lost)
        return other
