r"""Campbell diagram of a drive's modes over its speed, and modes followed over the variants of a study (docs/modes.md).

Modes of neighboring states are matched one to one by modal assurance, |a* M b|^2 / (a* M a)(b* M b).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from warpchain.argument_checks import AllowedRange, Count, NonNegativeNumber, check_arguments
from warpchain.assembly.frequencies import Order, excitation_orders, tooth_orders
from warpchain.drive import Drive
from warpchain.errors import SimulationError
from warpchain.modal.eigenmodes import Modes, lowest_modes
from warpchain.modal.matrices import Array
from warpchain.modal.small_motion import DriveMotion, drive_motion
from warpchain.progress import Progress, progress_reporter

SPARE_MODES = 10
LEAST_ASSURANCE = 0.35

MOST_PHASES, MOST_POINTS = 1000, 10_000
PhaseCount = Annotated[int, AllowedRange(f"a whole number from 1 to {MOST_PHASES}", lambda n: 1 <= n <= MOST_PHASES)]


@dataclass(frozen=True)
class OrderCrossing:
    """Crossing of a mode's frequency and an excitation order."""

    mode: str
    order: Order
    speed: float  # of the driver [rad/s]
    frequency: float  # [Hz]
    damping_ratio: float


@dataclass(frozen=True)
class InstabilityTongue:
    """Instability tongue: speed at which a mode may run away."""

    mode: str
    speed: float  # of the driver [rad/s]
    frequency: float  # of the mode [Hz]
    threshold: float  # e = 4 zeta, share by which the tension swings


@dataclass(frozen=True)
class Campbell:
    """Campbell diagram: K modes at P speeds.

    Attributes:
        speed: (P,) of the driver [rad/s], ascending.
        names: (K,) of the modes, as at the lowest speed.
        frequency: (P, K) undamped [Hz]; NaN where a mode was lost.
        damping_ratio: (P, K).
        orders: what excites the drive.
        modes: (P,) at each speed.
    """

    drive: Drive
    speed: Array
    names: tuple[str, ...]
    frequency: Array
    damping_ratio: Array
    orders: tuple[Order, ...]
    modes: tuple[Modes, ...]

    def crossings(self) -> list[OrderCrossing]:
        """Crossings of modes and excitation orders, by speed."""
        found = []
        for order in self.orders:
            for k, speed, frequency, ratio in self._crossings_of_order(order.value, 1.0):
                found.append(OrderCrossing(self.names[k], order, speed, frequency, ratio))
        return sorted(found, key=lambda crossing: crossing.speed)

    def tongues(self) -> list[InstabilityTongue]:
        """Instability tongues of modes, by speed."""
        found = [
            InstabilityTongue(self.names[k], s, f, 4.0 * r)
            for chain, teeth in tooth_orders(self.drive).items()
            for k, s, f, r in self._crossings_of_order(teeth, 2.0)
            if not chain or self.names[k].startswith(f"{chain}.")
        ]
        return sorted(found, key=lambda tongue: tongue.speed)

    def _crossings_of_order(self, order: float, multiple: float) -> list[tuple[int, float, float, float]]:
        """Mode, speed [rad/s], frequency [Hz] and damping at crossings of an order."""
        gap = multiple * self.frequency - order * self.speed[:, None] / (2.0 * np.pi)
        result = []
        for p, k in zip(*np.nonzero((gap[:-1] > 0.0) != (gap[1:] > 0.0)), strict=True):
            if np.isfinite(gap[p : p + 2, k]).all():
                share = gap[p, k] / (gap[p, k] - gap[p + 1, k])
                at = [float(a[p] + share * (a[p + 1] - a[p])) for a in (self.speed, self.frequency[:, k])]
                ratio = self.damping_ratio[:, k]
                result.append((int(k), at[0], at[1], float(ratio[p] + share * (ratio[p + 1] - ratio[p]))))
        return result


@check_arguments(SimulationError)
def campbell(
    drive: Drive,
    speeds: Sequence[NonNegativeNumber],
    count: Count = 20,
    *,
    progress: Progress = False,
) -> Campbell:
    """Campbell diagram of a drive's modes over speed.

    Args:
        speeds: of the driver [rad/s], two or more, ascending.
        count: modes, the lowest at the first speed.
        progress: True shows a bar; a function gets ("speeds", done, total).

    Raises:
        DriveError: a chain that does not fit.
        SimulationError: speeds do not ascend, or the drive does not settle.
    """
    if len(speeds) < 2 or not (np.diff(speeds) > 0.0).all():
        raise SimulationError("speeds: must be at least two, ascending")
    found: list[DriveMotion] = []
    shown: list[Modes] = []
    frequency, ratio = np.full((2, len(speeds), count), np.nan)
    which = np.arange(count)
    with progress_reporter(progress) as report:
        for p, speed in enumerate(speeds):
            found = [*found[-1:], drive_motion(drive, float(speed), found[-1] if found else None)]
            shown.append(lowest_modes(found[-1], count + SPARE_MODES))
            if p > 0:
                which = followed_modes(shown[-2], shown[-1], which, found[-1])
            seen = which >= 0
            frequency[p, seen], ratio[p, seen] = (
                shown[-1].frequency[which[seen]],
                shown[-1].damping_ratio[which[seen]],
            )
            report("speeds", p + 1, len(speeds))
    return Campbell(
        drive,
        np.asarray(speeds, float),
        shown[0].names[:count],
        frequency,
        ratio,
        excitation_orders(drive),
        tuple(shown),
    )


def followed_modes(before: Modes, after: Modes, which: NDArray[np.int64], at: DriveMotion) -> NDArray[np.int64]:
    """Indices (K,) of modes followed to the next speed, or -1."""
    kept = np.flatnonzero(which >= 0)
    result = np.full(len(which), -1)
    result[kept] = matched_modes(before.select_modes(which[kept]), after, at)
    return result


def matched_modes(these: Modes, those: Modes, at: DriveMotion) -> NDArray[np.int64]:
    """Indices (K,) of those modes that are most alike, or -1."""
    alike = modal_assurance(these, those, at)
    rows, columns = linear_sum_assignment(-alike)
    result = np.full(len(these), -1)
    good = alike[rows, columns] >= LEAST_ASSURANCE
    result[rows[good]] = columns[good]
    return result


def modal_assurance(a: Modes, b: Modes, at: DriveMotion) -> Array:
    """Modal assurance (K, L) between modes at two speeds."""
    product, size = np.zeros((len(a), len(b)), dtype=np.complex128), [np.zeros(len(a)), np.zeros(len(b))]
    for part, *both in zip(at.parts, a.of_chains(), b.of_chains(), strict=True):
        first, second = (part.at.coordinate_vector(modes.shape, modes.bodies) for modes in both)
        product += first.conj() @ (part.mass @ second.T)
        for v, own in zip((first, second), size, strict=True):
            own += np.einsum("ij,ij->i", v.conj(), (part.mass @ v.T).T).real
    return np.asarray(np.abs(product) ** 2 / np.outer(*size))


METRIC_PREFIX = "modes."


@lru_cache(maxsize=4)
def base_drive_modes(drive: Drive, count: int) -> Modes:
    """Lowest modes of a study's base drive."""
    return lowest_modes(drive_motion(drive), count)


def mode_metrics(base: Modes, drive: Drive) -> dict[str, float]:
    """Metrics of a variant's modes by name, matched with the base drive's [Hz]."""
    try:
        found = drive_motion(drive)
    except SimulationError:
        return {}
    own = lowest_modes(found, len(base) + SPARE_MODES)
    if own.shape.shape[1:] == base.shape.shape[1:]:
        which = matched_modes(base, own, found).tolist()
    else:
        which = [own.names.index(name) if name in own.names else -1 for name in base.names]
    result = {}
    for name, k in zip(base.names, which, strict=True):
        if k >= 0:
            result[f"{METRIC_PREFIX}{name}.frequency"] = float(own.frequency[k])
            result[f"{METRIC_PREFIX}{name}.damping_ratio"] = float(own.damping_ratio[k])
    return result


@check_arguments(SimulationError)
def pitch_averaged_campbell(
    drive: Drive,
    speeds: Sequence[NonNegativeNumber],
    count: Count,
    phases: PhaseCount = 4,
    *,
    progress: Progress = False,
) -> tuple[Campbell, Array]:
    """Campbell diagram averaged over a tooth pitch, and frequencies (phases, P, K).

    Args:
        speeds, count: as of `campbell`.
        phases: in equal steps; modes are named by phase 0.
        progress: True shows a bar; a function gets ("phases", done, total).

    Raises:
        DriveError, SimulationError: as of `campbell`.
    """
    with progress_reporter(progress) as report:
        first = campbell(drive.with_values({"run.phase": 0.0}), speeds, count)
        report("phases", 1, phases)
        at = drive_motion(first.drive, float(speeds[0]))
        frequency, ratio = [first.frequency], [first.damping_ratio]
        for k in range(1, phases):
            phase = k / phases - float(2 * k > phases)
            other = campbell(drive.with_values({"run.phase": phase}), speeds, count + SPARE_MODES)
            which = matched_modes(first.modes[0].first(count), other.modes[0].first(count + SPARE_MODES), at)
            for values, own in ((frequency, other.frequency), (ratio, other.damping_ratio)):
                values.append(np.where(which >= 0, own[:, which], np.nan))
            report("phases", k + 1, phases)
    both = np.ma.masked_invalid(np.stack(frequency)), np.ma.masked_invalid(np.stack(ratio))
    mean = np.sqrt((both[0] ** 2).mean(axis=0)).filled(np.nan)
    found = replace(first, frequency=mean, damping_ratio=both[1].mean(axis=0).filled(np.nan))
    return found, np.stack(frequency)
