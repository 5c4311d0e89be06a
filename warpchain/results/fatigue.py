"""Fatigue of links: rainflow cycles of their tension, Woehler curve, Miner damage.

A link endures N cycles of the tension range D (peak less valley) by the Woehler curve, and Miner's rule adds up

    N(D) = N_ref (D_ref / D)^m,      damage = sum over cycles n_i / N(D_i).                                   (a)

Mean tension is not corrected for: a chain's tension mostly swings from near zero. Cycles are counted after ASTM
E1049-85 (2011), 5.4.4. `cycles` counts one series with the package rainflow; `damage` counts all links at once in a
Warp kernel that gives the same cycles exactly.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpchain.errors import SimulationError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Woehler:
    """A Woehler (S-N) curve without an endurance limit, eq. (a).

    Attributes:
        exponent: m [-].
        reference_range: D_ref [N].
        reference_cycles: N_ref, cycles of D_ref to failure.

    Raises:
        SimulationError: a value that is not positive and finite.
    """

    exponent: float
    reference_range: float
    reference_cycles: float = 1e6

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (isinstance(value, int | float) and math.isfinite(value) and value > 0.0):
                raise SimulationError(f"fatigue.{name} = {value!r}: allowed is a finite number above 0")

    def endurance(self, ranges: ArrayLike) -> Array:
        """Cycles to failure at ranges [N], of their shape."""
        with np.errstate(divide="ignore"):
            return self.reference_cycles * (self.reference_range / np.asarray(ranges, dtype=float)) ** self.exponent


def cycles(series: ArrayLike) -> Array:
    """Rainflow cycles of one series (C, 3): range, mean, and 1 for a whole or 0.5 for half a cycle.

    Raises:
        SimulationError: the extra `rainflow` is not installed, or a series that is not one row of finite numbers.
    """
    try:
        import rainflow
    except ImportError:
        raise SimulationError("counting cycles needs the package rainflow: pip install 'warpchain[rainflow]'") from None
    values = np.asarray(series, dtype=float)
    if values.ndim != 1 or not np.isfinite(values).all():
        raise SimulationError(f"cycles: needs one row of finite numbers, not an array of shape {values.shape}")
    found = [(size, mean, part) for size, mean, part, *_ in rainflow.extract_cycles(values.tolist())]
    return np.array(found, dtype=float).reshape(-1, 3)


def count_links(series: ArrayLike, room: int | None = None) -> list[Array]:
    """Rainflow cycles of each column of `series` (F, L), as `cycles` gives them, by the streaming counter.

    Args:
        series: samples by column.
        room: most cycles to keep of a column; None keeps all.
    """
    values = _columns(series)
    most = len(values) + 1 if room is None else room
    counts, _, log = _run(values, (1.0, 1.0), most)
    return [log[column, : min(int(count), most)] for column, count in enumerate(counts)]


def damage(tension: ArrayLike, woehler: Woehler) -> Array:
    """Miner damage of each link over a recorded time, eq. (a) (L,); 1 is failure.

    Args:
        tension: (F, L) link tensions [N].
        woehler: the Woehler curve.

    Raises:
        SimulationError: tensions that are not finite or not (F, L).
    """
    _, sums, _ = _run(_columns(tension), (woehler.reference_range, woehler.exponent), 0)
    return sums / woehler.reference_cycles


def equivalent_range(tension: ArrayLike, exponent: float, counted: float) -> Array:
    """Range of the constant-amplitude cycles that do the same damage, for each link [N] (L,).

    (sum n_i D_i^m / counted)^(1/m): the same whatever the reference.

    Args:
        tension: (F, L) link tensions [N].
        exponent: m [-].
        counted: number of those cycles, such as chain revolutions in the recorded time.
    """
    values = _columns(tension)
    largest = float(np.ptp(values, axis=0).max()) or 1.0  # keeps powers near one
    _, sums, _ = _run(values, (largest, exponent), 0)
    return largest * (sums / counted) ** (1.0 / exponent)


def _columns(series: ArrayLike) -> Array:
    values = np.ascontiguousarray(series, dtype=float)
    if values.ndim != 2 or not values.size or not np.isfinite(values).all():
        raise SimulationError(f"fatigue: needs finite tensions (frames, links), not an array of shape {values.shape}")
    return values


def _run(values: Array, woehler: tuple[float, float], room: int) -> tuple[NDArray[np.int32], Array, Array]:
    """Counts (L,), sums of n (range / reference)^m (L,), and the log (L, room, 3) of the columns of (F, L)."""
    import warp as wp

    from warpchain.kernels.rainflow import rainflow_kernel, vec2d, vec3d

    frames, columns = values.shape
    capacity = max(4, frames + 1)  # room for every reversal
    stack = wp.empty(columns * capacity, dtype=wp.float64, device="cpu")
    log = wp.zeros(max(1, columns * room), dtype=vec3d, device="cpu")
    counts = wp.zeros(columns, dtype=wp.int32, device="cpu")
    sums = wp.zeros(columns, dtype=wp.float64, device="cpu")
    wp.launch(
        rainflow_kernel,
        columns,
        inputs=[wp.array(values, device="cpu"), vec2d(*woehler), capacity, room],
        outputs=[stack, log, counts, sums],
        device="cpu",
    )
    return counts.numpy(), sums.numpy(), log.numpy()[: columns * room].reshape(columns, room, 3)
