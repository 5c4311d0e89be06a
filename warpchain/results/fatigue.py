"""Fatigue of links: rainflow cycles of their tension (ASTM E1049-85, 5.4.4), Woehler curve, Miner damage.

Cycles of the tension range D do the damage n_i / N(D_i), N(D) = N_ref (D_ref / D)^m, without correction for the mean.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpchain.argument_checks import PositiveNumber, check_arguments
from warpchain.errors import SimulationError
from warpchain.extras import require_extra

Array = NDArray[np.float64]


@check_arguments(SimulationError, "fatigue.")
@dataclass(frozen=True)
class Woehler:
    """Woehler (S-N) curve of a link's tension, N(D)."""

    exponent: PositiveNumber  # m [-]
    reference_range: PositiveNumber  # D_ref [N]
    reference_cycles: PositiveNumber = 1e6  # N_ref, cycles of D_ref to failure

    def cycles_to_failure(self, ranges: ArrayLike) -> Array:
        """Number of cycles to failure at tension ranges [N]."""
        with np.errstate(divide="ignore"):
            return self.reference_cycles * (self.reference_range / np.asarray(ranges, dtype=float)) ** self.exponent


def rainflow_counter() -> Callable[[Sequence[float]], Iterable[tuple[Any, ...]]]:
    """Function that yields the rainflow cycles of a series.

    Raises:
        SimulationError: the extra `rainflow` is not installed.
    """
    require_extra("rainflow", "fatigue", SimulationError)
    from rainflow import extract_cycles

    counter: Callable[[Sequence[float]], Iterable[tuple[Any, ...]]] = extract_cycles
    return counter


def count_links(tension: ArrayLike) -> list[Array]:
    """Rainflow cycles (C, 3) of links: range, mean [N], count.

    Args:
        tension: (F, L) of links [N].

    Raises:
        SimulationError: tensions not finite or not (F, L), or no extra `rainflow`.
    """
    values = np.asarray(tension, dtype=float)
    if values.ndim != 2 or not values.size or not np.isfinite(values).all():
        raise SimulationError(f"fatigue: needs finite tensions (frames, links), not an array of shape {values.shape}")
    extract = rainflow_counter()
    columns = ([cycle[:3] for cycle in extract(column.tolist())] for column in values.T)
    return [np.array(found, dtype=float).reshape(-1, 3) for found in columns]


def miner_damage(tension: ArrayLike, woehler: Woehler, cycles: Sequence[Array] | None = None) -> Array:
    """Miner damage (L,) of links by their cycles; 1 is failure.

    Args:
        tension: (F, L) of links [N].
        cycles: of `count_links`.

    Raises:
        SimulationError: as of `count_links`.
    """
    found = count_links(tension) if cycles is None else cycles
    return _link_cycle_sums(found, woehler.reference_range, woehler.exponent) / woehler.reference_cycles


def equivalent_range(
    tension: ArrayLike, exponent: float, counted: float, cycles: Sequence[Array] | None = None
) -> Array:
    """Tension range (L,) [N] of equal fatigue damage in `counted` cycles.

    Args:
        tension: (F, L) of links [N].
        exponent: m [-].
        cycles: of `count_links`.

    Raises:
        SimulationError: as of `count_links`.
    """
    found = count_links(tension) if cycles is None else cycles
    largest = max((float(one[:, 0].max()) for one in found if len(one)), default=0.0) or 1.0  # keeps powers near one
    return largest * (_link_cycle_sums(found, largest, exponent) / counted) ** (1.0 / exponent)


def _link_cycle_sums(cycles: Sequence[Array], reference: float, exponent: float) -> Array:
    """Sums (L,) of n (range / reference)^m over links' cycles."""
    sums = np.zeros(len(cycles))
    for link, found in enumerate(cycles):
        total = 0.0
        for size, _, part in found.tolist():
            total += part * (size / reference) ** exponent
        sums[link] = total
    return sums
