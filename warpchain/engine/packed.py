"""Many drives as the flat arrays that the kernels read: each variant's parts one after the other.

Nothing of one variant depends on another: the packing only decides where its values stand.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpchain.assembly import Assembly
from warpchain.errors import SimulationError
from warpchain.kernels import structs
from warpchain.kernels.rows import STATE_ROWS

REAL = {"float64": wp.float64, "float32": wp.float32}


def real_of(precision: str) -> type:
    """Warp's type of a precision; a SimulationError for an unknown one."""
    if precision not in REAL:
        raise SimulationError(f'precision = {precision!r}: allowed are "float64" and "float32"')
    return REAL[precision]


def state_rows(position: NDArray[np.float64], velocity: NDArray[np.float64], precision: str) -> NDArray[np.floating]:
    """Rows x, y, vx, vy and the low parts of x, y: what `precision` rounds off a position, (6, N)."""
    high = position.astype(precision)
    return np.concatenate([high.T, velocity.T, (position - high).T]).astype(precision)


@dataclass
class Packed:
    """An ensemble as numpy structured arrays, in the layout of `kernels.structs`, and where each variant's parts begin.

    Attributes:
        drives ... impact_speed: see `kernels.structs.Ensemble` and `.State`.
        rollers: (6 * all rollers,) each variant's rows: x, y, vx, vy, and the low parts of x, y (float32).
        assemblies: the initial states.
    """

    precision: str
    drives: NDArray[Any]
    chains: NDArray[Any]
    lengths: NDArray[np.floating]
    sprockets: NDArray[Any]
    motions: NDArray[Any]
    mounts: NDArray[Any]
    guides: NDArray[Any]
    harmonics: NDArray[np.float64]
    tables: NDArray[np.float64]
    seats: NDArray[np.floating]
    rollers: NDArray[np.floating]
    bodies: NDArray[Any]
    strands: NDArray[Any]
    seat: NDArray[np.int32]
    assemblies: tuple[Assembly, ...]

    @property
    def real(self) -> type:
        """The Warp scalar type of the precision."""
        return REAL[self.precision]

    @property
    def variants(self) -> int:
        """Number of variants."""
        return len(self.assemblies)

    def first_value(self, v: int) -> int:
        """Where variant v's rows begin in `rollers`."""
        return STATE_ROWS * int(self.drives["first_roller"][v])

    def rows(self, v: int) -> NDArray[np.floating]:
        """View of variant v's rows x, y, vx, vy and low parts of x, y, (6, N)."""
        first, n = self.first_value(v), int(self.drives["rollers"][v])
        return self.rollers[first : first + STATE_ROWS * n].reshape(STATE_ROWS, n)

    def part(self, a: int, b: int) -> Packed:
        """Variants `a` to `b` - 1 as an ensemble of their own."""

        def span(first: str, per: Any) -> slice:
            """The values of these variants in an array that begins at `first` and has `per` values a variant."""
            starts = self.drives[first].astype(np.int64)
            return slice(int(starts[a]), int(starts[b - 1] + per[b - 1]))

        rollers, wheels, bars = (self.drives[name].astype(np.int64) for name in ("rollers", "sprockets", "guides"))
        chain = span("first_roller", rollers)
        disks, rails = span("first_sprocket", wheels), span("first_guide", bars)
        memories = span("first_contact", rollers * (wheels + bars))
        drives = self.drives[a:b].copy()
        for name in ("first_roller", "first_sprocket", "first_guide", "first_contact", "first_tally"):
            drives[name] -= drives[name][0]
        guides = self.guides[rails] if rails.stop > rails.start else self.guides[:1]
        return replace(
            self,
            drives=drives,
            chains=self.chains[a:b],
            lengths=self.lengths[chain],
            sprockets=self.sprockets[disks],
            motions=self.motions[disks],
            mounts=self.mounts[disks],
            guides=guides,
            rollers=self.rollers[STATE_ROWS * chain.start : STATE_ROWS * chain.stop],
            bodies=self.bodies[disks],
            strands=self.strands[disks],
            seat=self.seat[memories],
            assemblies=self.assemblies[a:b],
        )

    def taken(self, which: Sequence[int]) -> Packed:
        """The variants of these indices, each as often as it is named, as an ensemble of their own."""
        chosen = np.asarray(which, dtype=np.int64)
        drives = self.drives[chosen]
        rollers, wheels, bars = (drives[name].astype(np.int64) for name in ("rollers", "sprockets", "guides"))
        memories = rollers * (wheels + bars)

        def spread(first: str, per: NDArray[np.int64], width: int = 1) -> NDArray[np.int64]:
            """Where the values stand now; `drives` then says where they will stand."""
            old, new = width * drives[first].astype(np.int64), width * (np.cumsum(per) - per)
            drives[first] = new // width
            return np.repeat(old - new, width * per) + np.arange(int(width * per.sum()))

        rows = spread("first_roller", rollers, STATE_ROWS)
        drives["first_roller"] = self.drives["first_roller"][chosen]
        chain, disks = spread("first_roller", rollers), spread("first_sprocket", wheels)
        rails, seats = spread("first_guide", bars), spread("first_contact", memories)
        spread("first_tally", rollers * (wheels + 1))
        return replace(
            self,
            drives=drives,
            chains=self.chains[chosen],
            lengths=self.lengths[chain],
            sprockets=self.sprockets[disks],
            motions=self.motions[disks],
            mounts=self.mounts[disks],
            guides=self.guides[rails] if len(rails) else self.guides[:1],
            rollers=self.rollers[rows],
            bodies=self.bodies[disks],
            strands=self.strands[disks],
            seat=self.seat[seats],
            assemblies=tuple(self.assemblies[v] for v in which),
        )

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
            chains=self.chains.astype(kinds.Chain.numpy_dtype()),
            lengths=self.lengths.astype(precision),
            sprockets=self.sprockets.astype(kinds.Sprocket.numpy_dtype()),
            guides=self.guides.astype(kinds.Guide.numpy_dtype()),
            rollers=rollers,
        )
        for v in range(self.variants):
            exact, rows = self.rows(v), other.rows(v)
            rows[4:6] = exact[0:2] - rows[0:2]
        return other
