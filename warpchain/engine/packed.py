"""Many drives as the flat arrays that the kernels read: each variant's parts one after the other.

Nothing of one variant depends on another: the packing only decides where its values stand.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, make_dataclass, replace
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpchain.assembly.stack_assembly import Assemblies
from warpchain.drive.stacks import LARGEST_STACK
from warpchain.engine.arrays import PACKED, TABLE, array_type, dtype_of, lengths, numbered, starts
from warpchain.errors import SimulationError
from warpchain.kernels.native import STATE_ROWS
from warpchain.kernels.structs import GROUND
from warpchain.results.channels import DEFAULT_FRAME, FrameLayout

REAL = {"float64": wp.float64, "float32": wp.float32}


def real_of(precision: str) -> type:
    """Warp's type of a precision; a SimulationError for an unknown one."""
    if precision not in REAL:
        raise SimulationError(f'precision = {precision!r}: allowed are "float64" and "float32"')
    return REAL[precision]


def state_rows(position: NDArray[np.float64], velocity: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rows x, y, vx, vy and the low parts of x, y, which are 0 in float64, (..., 6, N)."""
    rows = np.zeros((*position.shape[:-2], STATE_ROWS, position.shape[-2]))
    rows[..., 0:2, :], rows[..., 2:4, :] = np.swapaxes(position, -1, -2), np.swapaxes(velocity, -1, -2)
    return rows


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


def coordinates(
    rows: NDArray[np.floating], first: NDArray[np.int64], count: int
) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """x and y (K, N) of the rollers of K variants with `count` each, which begin at `first` (K,)."""
    both = taken(rows, STATE_ROWS * first, 2 * count)
    return both[:, :count], both[:, count:]


Arrays: Any = make_dataclass("Arrays", PACKED)


def by_speed(rows: NDArray[Any]) -> NDArray[np.bool_]:
    """Of rows of friction, whether its coefficient depends on the speed."""
    return np.asarray(rows["mu_static"] != rows["mu_dynamic"])


@dataclass
class Packed(Arrays):
    """An ensemble as numpy structured arrays, in the layout of `kernels.structs`, and where each variant's parts begin.

    Attributes:
        drives, chains ...: the packed arrays of the table (`arrays.TABLE`), those of parts one row at least, as Warp
            reads no empty array.
        rollers: (6 * all rollers,) each variant's rows: x, y, vx, vy, and the low parts of x, y (float32).
        assemblies: the initial states.
        frame: how recorded frames lie.
    """

    precision: str
    assemblies: Assemblies
    frame: FrameLayout = DEFAULT_FRAME

    @classmethod
    def blank(cls, drives: NDArray[Any], assemblies: Assemblies) -> Packed:
        """An ensemble in float64 whose drives have their counts and places, and nothing else yet."""
        arrays: dict[str, Any] = {}
        for group in TABLE:
            counts = lengths(drives, group)
            for name, row in TABLE[group].items():
                if row.packed:
                    dtype = dtype_of(array_type(group, name, wp.float64))
                    arrays[row.packed] = np.zeros(counts.get(name, 0), dtype=dtype)
        arrays["seat"][:] = -1
        return cls(**arrays | {"drives": drives}, precision="float64", assemblies=assemblies)

    def without_lag(self) -> None:
        """Makes contacts take speeds as they are, where no step of the drives is taken."""
        for law in (self.sprockets["law"], self.guides["law"]):
            law["lag"] = law["yielding"] = law["most_damping"] = 0.0

    def copy(self) -> Packed:
        """The ensemble with arrays of its own."""
        return replace(self, **{name: getattr(self, name).copy() for name in PACKED})

    @property
    def real(self) -> type:
        """The Warp scalar type of the precision."""
        return REAL[self.precision]

    @property
    def variants(self) -> int:
        """Number of variants."""
        return len(self.assemblies)

    @property
    def begins(self) -> NDArray[np.intp]:
        """The rows at which variants begin, each with its first chain; all rows but where there are several chains."""
        return np.flatnonzero(self.drives["rings"] > 0)

    def having(self, sprockets: NDArray[np.bool_], guides: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """(variants,) whether a variant has one of these sprockets or guides."""
        found = np.zeros(self.variants, dtype=bool)
        for which, counts in ((sprockets, "sprockets"), (guides, "guides")):
            owner = np.repeat(np.arange(self.variants), self.drives[counts])
            found[owner[which[: len(owner)]]] = True
        return found

    @property
    def sliding(self) -> NDArray[np.int64]:
        """(variants,) how rollers rub on teeth or guide-bars: 0 (not at all), 1 or, by the speed, 2."""
        both = (self.tooth_friction, self.guide_friction)
        rubs = self.having(*(friction["inertia"] > 0.0 for friction in both))
        return rubs * (1 + self.having(*(by_speed(friction) for friction in both)))

    @property
    def rubbing(self) -> NDArray[np.int64]:
        """(variants,) the same of a chain's joints."""
        joint = self.chains["joint"]
        return np.asarray((joint["inertia"] > 0.0) * (1 + by_speed(joint)))

    @property
    def varied_links(self) -> NDArray[np.bool_]:
        """(variants,) whether links of a chain differ in more than their length, or have play."""
        of = self.chains
        unlike = (of["outer_stiffness"] != of["stiffness"]) | (of["outer_damping"] != of["damping"])
        return np.asarray(unlike | (of["play"] != 0.0))

    @property
    def linear_hysteretic(self) -> NDArray[np.bool_]:
        """(variants,) whether all contacts' laws are hysteretic and linear."""
        laws = (self.sprockets["law"], self.guides["law"])
        return ~self.having(*((law["exponent"] != 1.0) | (law["form"] != 0) for law in laws))

    @property
    def carried_guides(self) -> NDArray[np.bool_]:
        """(variants,) whether a guide has a profile, or a body carries it."""
        none = np.zeros(len(self.sprockets), dtype=bool)
        return self.having(none, (self.guides["body"] != GROUND) | (self.guides["pieces"] > 0))

    @property
    def crowded_arms(self) -> NDArray[np.bool_]:
        """(variants,) whether an arm carries a guide beside a sprocket or another guide."""

        def carried(counts: str, bodies: NDArray[np.integer]) -> NDArray[np.int64]:
            """(bodies,) how many of some parts, which drives have so many of, bodies carry."""
            owner = np.repeat(self.drives["first_body"], self.drives[counts])
            on = bodies[: len(owner)] != GROUND
            return np.bincount((owner + bodies[: len(owner)])[on], minlength=len(self.bodies))

        guides, sprockets = carried("guides", self.guides["body"]), carried("sprockets", self.hubs["arm"])
        crowded = (guides > 0) & (guides + sprockets > 1)
        return np.asarray(np.logical_or.reduceat(crowded, self.drives["first_body"]))

    @property
    def uniform_links(self) -> NDArray[np.bool_]:
        """(variants,) whether all links of a chain are of one length."""
        first = self.drives["first_roller"].astype(np.int64)
        return np.asarray(np.minimum.reduceat(self.lengths, first) == np.maximum.reduceat(self.lengths, first))

    def _added_up(self, counts: str, numbers: NDArray[np.integer]) -> NDArray[np.int64]:
        """(variants,) whole numbers of parts, of which drives have so many each, added up for each variant."""
        owner = np.repeat(np.arange(self.variants), self.drives[counts])
        return np.bincount(owner, numbers[: len(owner)], self.variants).astype(np.int64)

    @property
    def oiled(self) -> NDArray[np.bool_]:
        """(variants,) whether a tensioner has oil."""
        return self._added_up("tensioners", self.tensioners["hydraulic"]) > 0

    @property
    def fed(self) -> NDArray[np.bool_]:
        """(variants,) whether the supply of a tensioner is tabulated."""
        return self._added_up("tensioners", self.tensioners["supply_table"]["cells"]) > 0

    @property
    def cams(self) -> NDArray[np.int64]:
        """(variants,) number of cams that lift valves."""
        return self._added_up("valves", self.valves["phases"])

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
            for some in np.split(variants, range(LARGEST_STACK, len(variants), LARGEST_STACK)):
                yield some, first[some], count

    def part(self, a: int, b: int) -> Packed:
        """Variants `a` to `b` - 1 as an ensemble of their own, which shares this one's arrays."""
        places = {kind: slice(int(first[a]), int(first[b])) for kind, first in starts(self.drives).items()}
        return self._of(places, self.drives[a:b].copy(), self.assemblies[a:b])

    def taken(self, which: Sequence[int]) -> Packed:
        """The variants of these indices, each as often as it is named, as an ensemble of their own."""
        chosen = np.asarray(which, dtype=np.int64)
        places = {}
        for kind, first in starts(self.drives).items():
            begin, count = first[chosen], np.diff(first)[chosen]
            places[kind] = np.repeat(begin - (np.cumsum(count) - count), count) + np.arange(int(count.sum()))
        return self._of(places, self.drives[chosen], self.assemblies.pick_variants(chosen))

    def _of(
        self, places: Mapping[str, slice | NDArray[np.int64]], drives: NDArray[Any], assemblies: Assemblies
    ) -> Packed:
        """The ensemble of some variants, whose things of each kind are at `places` in this one."""
        arrays = {}
        for name, (group, of) in PACKED.items():
            row, values = TABLE[group][of], getattr(self, name)
            if row.kind:
                chosen = values.reshape(-1, row.width)[places[row.kind]]
                arrays[name] = chosen.reshape(-1) if len(chosen) else values[: row.width]
        return replace(self, **arrays | {"drives": numbered(drives)}, assemblies=assemblies)

    def at_precision(self, precision: str) -> Packed:
        """This ensemble, which is in float64, at another precision; the low parts of positions take what these lose.

        Raises:
            SimulationError: for an unknown precision.
        """
        real = real_of(precision)
        if precision == self.precision:
            return self
        arrays = {
            name: getattr(self, name).astype(dtype_of(array_type(*place, real)), copy=False)
            for name, place in PACKED.items()
        }
        other = replace(self, **arrays, precision=precision)
        bars = other.guides
        bars["slack"] = 1e-6 * (bars["length"] + 2.0 * (bars["end_radius"] + bars["roller_radius"]))
        for _, first, count in self.alike():
            xy = STATE_ROWS * first
            lost = taken(self.rollers, xy, 2 * count) - taken(other.rollers, xy, 2 * count)
            store(other.rollers, xy + 4 * count, lost)
        return other
