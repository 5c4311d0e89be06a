"""Packed ensemble: drives as flat arrays that kernels read, each variant's parts one after the other."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, make_dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpchain.assembly.stack_assembly import Assemblies
from warpchain.engine.arrays import (
    ARRAYS,
    PACKED_ARRAYS,
    array_lengths,
    array_type,
    dtype_of,
    fill_first_places,
    first_places,
)
from warpchain.errors import SimulationError
from warpchain.kernels.native import STATE_ROWS
from warpchain.kernels.structs import GROUND
from warpchain.model.stacks import LARGEST_STACK
from warpchain.results.channels import DEFAULT_FRAME, FrameLayout

REAL_TYPES = {"float64": wp.float64, "float32": wp.float32}


def real_type(precision: str) -> type:
    """Warp's scalar type of a precision, or SimulationError."""
    if precision not in REAL_TYPES:
        raise SimulationError(f'precision = {precision!r}: allowed are "float64" and "float32"')
    return REAL_TYPES[precision]


def roller_state_rows(position: NDArray[np.float64], velocity: NDArray[np.float64]) -> NDArray[np.float64]:
    """Packed rows (..., 6, N) of rollers' positions and velocities."""
    rows = np.zeros((*position.shape[:-2], STATE_ROWS, position.shape[-2]))
    rows[..., 0:2, :], rows[..., 2:4, :] = np.swapaxes(position, -1, -2), np.swapaxes(velocity, -1, -2)
    return rows


def consecutive_places(first: NDArray[np.integer], count: int) -> NDArray[np.int64]:
    """Places (V, count) from `first` (V,) on in a packed array."""
    return np.asarray(first, dtype=np.int64)[:, None] + np.arange(count)


def strided_view(values: NDArray[Any], first: NDArray[np.integer], count: int) -> NDArray[Any] | None:
    """Writable view (V, count) of evenly spaced packed values, or None."""
    apart = np.diff(first)
    apart_by = int(apart[0]) if len(apart) else count
    if apart_by < count or (apart != apart_by).any():
        return None
    (size,) = values.strides
    return np.lib.stride_tricks.as_strided(values[int(first[0]) :], (len(first), count), (apart_by * size, size))


def gather_values(values: NDArray[Any], first: NDArray[np.integer], count: int) -> NDArray[Any]:
    """Packed values (V, count) from `first` (V,) on, to read."""
    view = strided_view(values, first, count)
    return values[consecutive_places(first, count)] if view is None else view


def scatter_values(values: NDArray[Any], first: NDArray[np.integer], rows: NDArray[Any]) -> None:
    """Sets packed values from `first` (V,) on to `rows`."""
    view = strided_view(values, first, rows.shape[-1])
    if view is None:
        values[consecutive_places(first, rows.shape[-1])] = rows
    else:
        view[:] = rows


def roller_coordinates(
    rows: NDArray[np.floating], first: NDArray[np.int64], count: int
) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """Coordinates x, y (K, N) of packed rollers."""
    both = gather_values(rows, STATE_ROWS * first, 2 * count)
    return both[:, :count], both[:, count:]


_PackedArrays: Any = make_dataclass("Arrays", PACKED_ARRAYS)


def is_speed_dependent(rows: NDArray[Any]) -> NDArray[np.bool_]:
    """Whether each `structs.Friction` has coefficients by speed."""
    return np.asarray(rows["mu_static"] != rows["mu_dynamic"])


@dataclass
class PackedEnsemble(_PackedArrays):
    """Packed ensemble of drives, as numpy structured arrays of `kernels.structs`.

    Attributes:
        drives, chains ...: the arrays of `arrays.ARRAYS`.
        rollers: (6 * all rollers,) rows x, y, vx, vy, low parts of x, y of each variant.
        assemblies: initial states.
    """

    precision: str
    assemblies: Assemblies
    frame: FrameLayout = DEFAULT_FRAME

    @classmethod
    def blank(cls, drives: NDArray[Any], assemblies: Assemblies) -> PackedEnsemble:
        """Packed ensemble in float64 with given counts, of zeros."""
        arrays: dict[str, Any] = {}
        for group in ARRAYS:
            counts = array_lengths(drives, group)
            for name, row in ARRAYS[group].items():
                if row.packed_name:
                    dtype = dtype_of(array_type(group, name, wp.float64))
                    arrays[row.packed_name] = np.zeros(counts.get(name, 0), dtype=dtype)
        arrays["seat"][:] = -1
        arrays["relative_mass"][:] = 1.0
        return cls(**arrays | {"drives": drives}, precision="float64", assemblies=assemblies)

    def remove_lag(self) -> None:
        """Makes packed contacts take speeds as they are."""
        for law in (self.sprockets["law"], self.guides["law"]):
            law["lag"] = law["yielding"] = law["most_damping"] = 0.0

    def copy(self) -> PackedEnsemble:
        """Packed ensemble with copied arrays."""
        return replace(self, **{name: getattr(self, name).copy() for name in PACKED_ARRAYS})

    @cached_property
    def real(self) -> type:
        """Warp's scalar type of the packed ensemble's precision."""
        return REAL_TYPES[self.precision]

    @property
    def variants(self) -> int:
        """Number of packed rows: variants, or their chains."""
        return len(self.assemblies)

    @property
    def first_rows(self) -> NDArray[np.intp]:
        """Packed row of each variant's first chain."""
        return np.flatnonzero(self.drives["chains"] > 0)

    def has_any_of(self, sprockets: NDArray[np.bool_], guides: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Whether packed variants (variants,) have a marked part."""
        found = np.zeros(self.variants, dtype=bool)
        for which, counts in ((sprockets, "sprockets"), (guides, "guides")):
            owner = np.repeat(np.arange(self.variants), self.drives[counts])
            found[owner[which[: len(owner)]]] = True
        return found

    @property
    def contact_friction_kinds(self) -> NDArray[np.int64]:
        """Contact friction (variants,): 0 none, 1 constant, 2 by speed."""
        both = (self.tooth_friction, self.guide_friction)
        rubs = self.has_any_of(*(friction["inertia"] > 0.0 for friction in both))
        return rubs * (1 + self.has_any_of(*(is_speed_dependent(friction) for friction in both)))

    @property
    def joint_friction_kinds(self) -> NDArray[np.int64]:
        """Joint friction (variants,): 0 none, 1 constant, 2 by speed."""
        joint = self.chains["joint"]
        return np.asarray((joint["inertia"] > 0.0) * (1 + is_speed_dependent(joint)))

    @property
    def has_varied_links(self) -> NDArray[np.bool_]:
        """Whether links or masses differ, have play, or one is absent (variants,)."""
        of = self.chains
        unlike = (of["outer_stiffness"] != of["stiffness"]) | (of["outer_damping"] != of["damping"])
        return np.asarray(unlike | (of["unlike_masses"] > 0) | (of["play"] != 0.0) | (of["absent"] > 0))

    @property
    def has_linear_hysteretic_contacts(self) -> NDArray[np.bool_]:
        """Whether contact laws are linear and hysteretic (variants,)."""
        laws = (self.sprockets["law"], self.guides["law"])
        return ~self.has_any_of(*((law["exponent"] != 1.0) | (law["form"] != 0) for law in laws))

    @property
    def has_carried_guides(self) -> NDArray[np.bool_]:
        """Whether a guide is carried or profiled (variants,)."""
        none = np.zeros(len(self.sprockets), dtype=bool)
        return self.has_any_of(none, (self.guides["body"] != GROUND) | (self.guides["pieces"] > 0))

    @property
    def has_crowded_arms(self) -> NDArray[np.bool_]:
        """Whether arms carry a guide and something else (variants,)."""

        def carried(counts: str, bodies: NDArray[np.integer]) -> NDArray[np.int64]:
            """Number (bodies,) of a kind's parts on each packed body."""
            owner = np.repeat(self.drives["first_body"], self.drives[counts])
            on = bodies[: len(owner)] != GROUND
            return np.bincount((owner + bodies[: len(owner)])[on], minlength=len(self.bodies))

        guides, sprockets = carried("guides", self.guides["body"]), carried("sprockets", self.hubs["arm"])
        crowded = (guides > 0) & (guides + sprockets > 1)
        return np.asarray(np.logical_or.reduceat(crowded, self.drives["first_body"]))

    @property
    def has_uniform_links(self) -> NDArray[np.bool_]:
        """Whether all links have one length (variants,)."""
        first = self.drives["first_roller"].astype(np.int64)
        return np.asarray(np.minimum.reduceat(self.lengths, first) == np.maximum.reduceat(self.lengths, first))

    def _sums_by_variant(self, counts: str, numbers: NDArray[np.integer]) -> NDArray[np.int64]:
        """Sums (variants,) of parts' numbers, `drives[counts]` a variant."""
        owner = np.repeat(np.arange(self.variants), self.drives[counts])
        return np.bincount(owner, numbers[: len(owner)], self.variants).astype(np.int64)

    @property
    def has_oil(self) -> NDArray[np.bool_]:
        """Whether a tensioner has oil (variants,)."""
        return self._sums_by_variant("tensioners", self.tensioners["hydraulic"]) > 0

    @property
    def cam_counts(self) -> NDArray[np.int64]:
        """Number (variants,) of valves' cams."""
        return self._sums_by_variant("valves", self.valves["phases"])

    def first_roller_value(self, v: int) -> int:
        """Index at which variant v's packed rollers begin."""
        return STATE_ROWS * int(self.drives["first_roller"][v])

    def roller_rows(self, v: int) -> NDArray[np.floating]:
        """View (6, N) of variant v's packed roller rows."""
        first, n = self.first_roller_value(v), int(self.drives["rollers"][v])
        return self.rollers[first : first + STATE_ROWS * n].reshape(STATE_ROWS, n)

    def groups_by_rollers(self) -> Iterator[tuple[NDArray[np.intp], NDArray[np.int64], int]]:
        """Yields numbers and first rollers (K,) of variants with equally many rollers, and how many."""
        rollers, first = self.drives["rollers"], self.drives["first_roller"].astype(np.int64)
        for count in np.unique(rollers).tolist():
            variants = np.flatnonzero(rollers == count)
            for some in np.split(variants, range(LARGEST_STACK, len(variants), LARGEST_STACK)):
                yield some, first[some], count

    def variant_range(self, a: int, b: int) -> PackedEnsemble:
        """Packed ensemble of variants `a` to `b` - 1, arrays shared."""
        places = {kind: slice(int(first[a]), int(first[b])) for kind, first in first_places(self.drives).items()}
        return self._select_variants(places, self.drives[a:b].copy(), self.assemblies[a:b])

    def pick_variants(self, which: Sequence[int]) -> PackedEnsemble:
        """Packed ensemble of variants `which`, arrays copied."""
        chosen = np.asarray(which, dtype=np.int64)
        places = {}
        for kind, first in first_places(self.drives).items():
            begin, count = first[chosen], np.diff(first)[chosen]
            places[kind] = np.repeat(begin - (np.cumsum(count) - count), count) + np.arange(int(count.sum()))
        return self._select_variants(places, self.drives[chosen], self.assemblies.pick_variants(chosen))

    def _select_variants(
        self, places: Mapping[str, slice | NDArray[np.int64]], drives: NDArray[Any], assemblies: Assemblies
    ) -> PackedEnsemble:
        """Packed ensemble of the variants whose items are at `places`."""
        arrays = {}
        for name, (group, of) in PACKED_ARRAYS.items():
            row, values = ARRAYS[group][of], getattr(self, name)
            if row.dimension:
                chosen = values.reshape(-1, row.width)[places[row.dimension]]
                arrays[name] = chosen.reshape(-1) if len(chosen) else values[: row.width]
        return replace(self, **arrays | {"drives": fill_first_places(drives)}, assemblies=assemblies)

    def at_precision(self, precision: str) -> PackedEnsemble:
        """Packed ensemble at another precision, or SimulationError."""
        real = real_type(precision)
        if precision == self.precision:
            return self
        arrays = {
            name: getattr(self, name).astype(dtype_of(array_type(*place, real)), copy=False)
            for name, place in PACKED_ARRAYS.items()
        }
        other = replace(self, **arrays, precision=precision)
        bars = other.guides
        bars["slack"] = 1e-6 * (bars["length"] + 2.0 * (bars["end_radius"] + bars["roller_radius"]))
        for _, first, count in self.groups_by_rollers():
            xy = STATE_ROWS * first
            lost = gather_values(self.rollers, xy, 2 * count) - gather_values(other.rollers, xy, 2 * count)
            scatter_values(other.rollers, xy + 4 * count, lost)
        return other
