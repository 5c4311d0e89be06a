"""Formulas of metrics: from sums over the window, from the energy balance, and from one another (docs/metrics.md)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpchain.assembly.rating import smallest_driven
from warpchain.model.power_rating import rated_power
from warpchain.model.stacks import Of, Stack
from warpchain.results.window_statistics import (
    cumulative_counts,
    histogram_quantile,
    histogram_share_below,
    is_steady,
    mean_standard_error,
    window_change,
    window_drift,
)

if TYPE_CHECKING:
    from warpchain.model import ChainModel

STEP_KEY = "run.step"
VariantValues = Any
"""Numbers (V,), one for all, or their column."""


class LazyFields(dict[str, Any]):
    """Metric sums by name, computed when first asked for."""

    def __init__(self, value: Callable[[str], Any]) -> None:
        super().__init__()
        self._value = value

    def __missing__(self, name: str) -> Any:
        self[name] = found = self._value(name)
        return found


class ColumnValues(NamedTuple):
    """Column of a metric of V variants."""

    values: NDArray[Any]  # (V,) anything where missing
    missing: NDArray[np.bool_]  # (V,)

    def filled(self, value: float) -> NDArray[Any]:
        """Values of the metric column, missing ones replaced."""
        return np.where(self.missing, value, self.values)


@dataclass(frozen=True)
class Column:
    """Metric column: name, unit, title and formula."""

    name: str  # its own, after that of its part and a dot: `camshaft.speed_mean`
    unit: str  # SI, "1" for a count, ratio or flag
    title: str
    value: Callable[[Any], VariantValues] | None = None  # missing where there is none
    kind: type = float
    is_aside: bool = False  # whether studies analyze it only by name


def column_of_value(value: VariantValues, missing: Any = False) -> ColumnValues:
    """Column of a metric formula's value, with what is missing."""
    if isinstance(value, ColumnValues):
        return ColumnValues(value.values, value.missing | missing)
    found = np.asarray(value)
    return ColumnValues(found, np.broadcast_to(missing, found.shape))


def columns_of_formulas(columns: Iterable[Column], of: Any, missing: Any = False) -> dict[str, ColumnValues]:
    """Columns of metric formulas by name, with what is missing."""
    return {column.name: column_of_value(column.value(of), missing) for column in columns if column.value}


def mask_absent(given: ArrayLike, values: ArrayLike) -> ColumnValues:
    """Column of metric values, missing where not given."""
    return column_of_value(values, np.logical_not(given))


def number_of_each_drive(
    drives: Sequence[Of], stacks: Sequence[Stack[Of]] | None, value: Callable[..., Any], *given: NDArray[Any]
) -> NDArray[np.float64]:
    """Number (V,) of each drive or chain, computed by stacks.

    Args:
        value: function of a drive, or of a stack, and of `given`.
        given: arrays (V, ...); a stack gets (..., members).
    """
    found = np.empty(len(drives))
    for stack in stacks or [Stack(np.array([v]), drive) for v, drive in enumerate(drives)]:
        found[stack.members] = value(stack.one, *(np.moveaxis(of[stack.members], 0, -1) for of in given))
    return found


def partner_names(model: ChainModel) -> list[str]:
    """Names of sprockets, then guides, that rollers touch."""
    return [sprocket.name for sprocket in model.sprockets] + [guide.name for guide in model.guides]


@dataclass(frozen=True)
class BatchSums:
    """Sums over each batch of the window of V variants.

    Attributes:
        sums: by name and field, (V, ..., batches).
        durations: (V, batches) of the batches [s]; nan where the window is too short for them.
    """

    sums: Mapping[str, Mapping[str, NDArray[Any]]]
    durations: NDArray[np.float64]


@dataclass(frozen=True)
class VariantSums:
    """Sums over the window of a chain of V variants with S sprockets, G guides, A arms and T tensioners.

    Attributes:
        whole: by name: "chain" (V,), "strand", "sprocket", "mount", "slip" (V, S), "contact" (V, S + G), "arm" (V, A),
            "tensioner" (V, T) and so on.
        batches: over batches for standard errors.
        long_batches: over those for drifts.
        tension: counts (V, S + 1, bins) of link tensions, and edges (V, bins + 1) of the bins [N].
    """

    whole: Mapping[str, NDArray[Any]]
    batches: BatchSums
    long_batches: BatchSums
    tension: tuple[NDArray[np.integer], NDArray[np.float64]]


@dataclass(frozen=True)
class WindowSums:
    """Sums over the window in R rows: V variants times some parts."""

    sums: Any  # (R,) rows of the group's sums, a variant's parts one after the other
    weight: VariantValues  # (R,) what means divide by: samples, or the window's length [s]
    batches: WindowSums | None = None  # last axis of batches, nan weights for none; None without any
    tension: tuple[NDArray[np.integer], NDArray[np.float64]] | None = None  # counts (R, bins), edges (V, bins + 1) [N]

    @cached_property
    def cumulative_tension_counts(self) -> NDArray[np.float64]:
        """Cumulative counts (V, bins) of link tensions."""
        assert self.tension is not None
        return cumulative_counts(self.tension[0])


def sum_of(field: str) -> Callable[[WindowSums], VariantValues]:
    """Metric formula: sum over the window."""
    return lambda of: of.sums[field]


def flow_of(*fields: str) -> Callable[[WindowSums], VariantValues]:
    """Metric formula: oil flow of a tensioner."""
    return lambda of: sum(of.sums["flows"][field] for field in fields)


def chamber_filling_time(of: WindowSums) -> VariantValues:
    """Metric: time (V,) [s] until a tensioner's chamber was filled."""
    flows = of.sums["flows"]
    return mask_absent(flows["unfilled"] == 0, flows["filling"])


def mean_of(field: str, component: int | None = None) -> Callable[[WindowSums], VariantValues]:
    """Metric formula: mean over the window."""
    if component is not None:
        return lambda of: of.sums[field][..., component] / of.weight
    return lambda of: of.sums[field] / of.weight


def deviation_of(field: str) -> Callable[[WindowSums], VariantValues]:
    """Metric formula: standard deviation over the window."""

    def formula(of: WindowSums) -> VariantValues:
        """Standard deviation (R,) of a sum's field."""
        center = of.sums[field] / of.weight
        return np.sqrt(np.maximum(of.sums[f"{field}_square"] / of.weight - center * center, 0.0))

    return formula


def rms_of(field: str) -> Callable[[WindowSums], VariantValues]:
    """Metric formula: root mean square over the window."""
    return lambda of: np.sqrt(of.sums[f"{field}_square"] / of.weight)


LEAST_TURNOVER = 1e-3


def tension_quantile_of(share: float) -> Callable[[WindowSums], VariantValues]:
    """Metric formula: quantile of link tensions."""

    def formula(of: WindowSums) -> VariantValues:
        """Quantile (R,) of link tensions [N]."""
        assert of.tension is not None
        return histogram_quantile(
            *of.tension, of.sums["tension_min"], of.sums["tension_max"], share, of.cumulative_tension_counts
        )

    return formula


def tension_share_below_value(value: float) -> Callable[[WindowSums], VariantValues]:
    """Metric formula: share of link tensions below a value [N]."""

    def formula(of: WindowSums) -> VariantValues:
        """Share (R,) of link tensions below the value."""
        assert of.tension is not None
        return histogram_share_below(
            *of.tension, of.sums["tension_min"], of.sums["tension_max"], value, of.cumulative_tension_counts
        )

    return formula


def standard_error_of(mean: Callable[[WindowSums], VariantValues]) -> Callable[[WindowSums], VariantValues]:
    """Metric formula: standard error of a mean's formula."""

    def formula(of: WindowSums) -> VariantValues:
        """Standard error (R,) of the mean, missing if unknown."""
        if of.batches is None:
            return mask_absent(np.zeros(len(of.sums), bool), np.zeros(len(of.sums)))
        error = mean_standard_error(mean(of.batches), of.batches.weight)
        return mask_absent(np.isfinite(error), error)

    return formula


@dataclass(frozen=True)
class DriftMeans:
    """Batch means (V, batches) of tension and speeds, for drifts."""

    tension: NDArray[np.float64]  # of the chain [N]
    speeds: Sequence[NDArray[np.float64]]  # of each sprocket [rad/s]
    waves: NDArray[np.float64]  # (V,) periods of the slowest ripple in the window, 0 for none

    @property
    def tension_change(self) -> VariantValues:
        """Metric: change (V,) [N] of mean tension over the window."""
        found = window_change(self.tension, self.waves)
        return mask_absent(np.isfinite(found), found)

    @property
    def tension_change_chance(self) -> VariantValues:
        """Metric: chance (V,) of so large a tension change."""
        _, chance = window_drift(self.tension)
        return mask_absent(np.isfinite(chance), chance)

    @property
    def is_steady(self) -> VariantValues:
        """Metric: whether neither tension nor speeds drift (V,)."""
        each = np.all([is_steady(means) for means in (self.tension, *self.speeds)], axis=0)
        return mask_absent(np.isfinite(self.tension).all(axis=-1), each)


@dataclass(frozen=True)
class EnergyBalance:
    """Energy balance over the window [J]."""

    input: VariantValues  # work of what prescribes angles and centers
    output: VariantValues  # work against the loads
    links: VariantValues  # dissipated in the links
    dissipated: VariantValues  # in all parts
    change: VariantValues  # of the mechanical energy
    stored: VariantValues = 0.0  # mechanical energy, at its larger end

    @property
    def residual(self) -> VariantValues:
        """Energy that the balance misses [J]."""
        return self.input - self.output - self.dissipated - self.change

    @property
    def efficiency(self) -> VariantValues:
        """Output over output and losses, or missing."""
        taken = self.output + self.dissipated
        given = (self.output >= 0.0) & (taken > 0.0)
        return mask_absent(given, self.output / np.where(given, taken, 1.0))

    @property
    def relative_change(self) -> VariantValues:
        """Change of the energy over the losses."""
        losses = np.maximum(self.dissipated, LEAST_TURNOVER * abs(self.stored))
        return np.where(losses == 0.0, 0.0, self.change / np.where(losses == 0.0, 1.0, losses))

    @property
    def relative_residual(self) -> VariantValues:
        """Residual over half the sum of the balance's terms."""
        turnover = 0.5 * (abs(self.input) + abs(self.output) + self.dissipated + abs(self.change))
        turnover = np.maximum(turnover, LEAST_TURNOVER * abs(self.stored))
        return np.where(turnover == 0.0, 0.0, self.residual / turnover)


@dataclass(frozen=True)
class DesignInputs:
    """Inputs of design metrics: other metrics of variants."""

    models: Sequence[ChainModel]
    stacks: Sequence[Stack[ChainModel]] | None  # the models sorted into kinds, where known
    metrics: Mapping[str, ColumnValues]  # columns so far
    prefix: str  # of the part's columns, "" for the chain
    index: int  # of the part

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Other metric (V,) of the part, or nan."""
        found = self.metrics.get(self.prefix + name)
        return np.full(len(self.models), np.nan) if found is None else found.filled(np.nan)

    def has_metrics(self, *names: str) -> NDArray[np.bool_]:
        """(V,) whether the part has other metrics."""
        found = [self.metrics.get(self.prefix + name) for name in names]
        return np.all([np.zeros(len(self.models), bool) if of is None else ~of.missing for of in found], axis=0)

    def number_of_each(self, value: Callable[[ChainModel], Any]) -> NDArray[np.float64]:
        """Number (V,) of each model, computed by stacks."""
        return number_of_each_drive(self.models, self.stacks, value)

    @property
    def roller_mass(self) -> NDArray[np.float64]:
        """Mass of a roller (V,) [kg]."""
        return self.number_of_each(lambda model: model.chain.mass)

    def sprocket_turns(self, s: int) -> NDArray[Any]:
        """Revolutions of a sprocket in the window (V,)."""
        names = ("window_start", "window_end", f"{self.models[0].sprockets[s].name}.speed_mean")
        start, end, speed = (self.metrics[name].values for name in names)
        return np.abs(speed) * (end - start) / (2.0 * math.pi)


def peak_factor(of: DesignInputs) -> VariantValues:
    """Metric: largest over mean tension (V,)."""
    return mask_absent(of["tension_mean"] > 0.0, of["tension_max"] / of["tension_mean"])


def displacement_std(of: DesignInputs) -> VariantValues:
    """Metric: standard deviation of a strand's displacement (V,) [m]."""
    center, root = of["displacement_mean"], of["displacement_rms"]
    spread = np.sqrt(np.maximum(root * root - center * center, 0.0))
    return mask_absent(of.has_metrics("displacement_mean", "displacement_rms"), spread)


def contact_energy_per_revolution(of: DesignInputs) -> VariantValues:
    """Metric: energy that contacts dissipate in a driver's revolution (V,) [J]."""
    model = of.models[0]
    revolutions = of.sprocket_turns(model.driver)
    prefixes = [of.prefix] if of.prefix else [f"{name}." for name in partner_names(model)]
    dissipated = sum(of.metrics[f"{prefix}dissipated"].values for prefix in prefixes)
    return mask_absent(revolutions != 0.0, dissipated / revolutions)


def total_friction_power(of: DesignInputs) -> VariantValues:
    """Metric: friction losses over the window's length (V,) [W]."""
    model = of.models[0]
    names = ["joints.friction", *(f"{name}.friction" for name in partner_names(model))]
    rubbed = sum(of.metrics[name].values for name in names if name in of.metrics)
    length = of.metrics["window_end"].values - of.metrics["window_start"].values
    return np.asarray(rubbed / length)


def rated_use(of: DesignInputs) -> VariantValues:
    """Metric: driver's mean power over the chain's rated power (V,) [-]."""
    first = of.models[0]
    name = first.sprockets[first.driver].name
    moment, speed = (of.metrics[f"{name}.{column}"].values for column in ("moment_mean", "speed_mean"))
    moves = speed != 0.0

    def rated_power_at_speed(model: ChainModel, speed: Any) -> Any:
        """Rated power [W] at the driver's speed [rad/s]."""
        teeth = model.sprockets[smallest_driven(model)].teeth
        assert model.chain.size is not None  # the metric's own condition
        return rated_power(model.chain.size, teeth, speed * model.sprockets[model.driver].teeth / teeth).least

    power = number_of_each_drive(of.models, of.stacks, rated_power_at_speed, np.where(moves, np.abs(speed), 1.0))
    return mask_absent(moves, np.abs(moment * speed) / power)


def impact_impulse(of: DesignInputs) -> VariantValues:
    """Metric impact impulse of a sprocket (V,) [N s]."""
    teeth = of.number_of_each(lambda model: model.sprockets[of.index].teeth)
    passings = teeth * of.sprocket_turns(of.index)
    return mask_absent(passings > 0.0, np.sqrt(2.0 * of.roller_mass * np.maximum(of["dissipated"], 0.0) / passings))
