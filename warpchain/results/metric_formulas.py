"""Formulas of metrics: from sums over the window, from the energy balance, and from one another.

With E the energy that contacts dissipate, n_d the driver's revolutions, n_s tooth passings, m a roller's mass:

    peak factor    = largest over mean tension                                                                (a)
    contact energy per revolution = E / n_d, a wear index                                                     (b)
    impact impulse = sqrt(2 m E / n_s), a proxy of noise                                                      (c)
    friction power = friction losses over the window's length                                                 (d)
    rated use      = the driver's mean moment times its mean speed over the rated power                       (e)
"""

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
"""Key of the step [s] among `DesignInputs`; no column."""
VariantValues = Any
"""A number, an array of one number a variant (V,), or their column (`ColumnValues`)."""


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
        """Values of the metric, with another one where they are missing."""
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


def column_of(value: VariantValues, missing: Any = False) -> ColumnValues:
    """Column of a metric formula's value, missing where the formula says so, or `missing` does."""
    if isinstance(value, ColumnValues):
        return ColumnValues(value.values, value.missing | missing)
    found = np.asarray(value)
    return ColumnValues(found, np.broadcast_to(missing, found.shape))


def columns_of_formulas(columns: Iterable[Column], of: Any, missing: Any = False) -> dict[str, ColumnValues]:
    """Columns by name from what their formulas take, missing where a formula says so, or `missing` does."""
    return {column.name: column_of(column.value(of), missing) for column in columns if column.value}


def mask_absent(given: ArrayLike, values: ArrayLike) -> ColumnValues:
    """Column of metric values, missing where not given."""
    return column_of(values, np.logical_not(given))


def number_of_each_drive(
    drives: Sequence[Of], stacks: Sequence[Stack[Of]] | None, value: Callable[..., Any], *given: NDArray[Any]
) -> NDArray[np.float64]:
    """Number of each drive, or chain of a drive (V,), by stacks at once.

    Args:
        value: function of a drive, or of a stack, and of `given`.
        given: arrays (V, ...); a stack gets (..., members).
    """
    found = np.empty(len(drives))
    for stack in stacks or [Stack(np.array([v]), drive) for v, drive in enumerate(drives)]:
        found[stack.members] = value(stack.one, *(np.moveaxis(of[stack.members], 0, -1) for of in given))
    return found


def partner_names(model: ChainModel) -> list[str]:
    """Names of the sprockets, then guides, that rollers touch."""
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
    """Sums of some parts of V variants over the window, for metrics; R rows, V times the parts."""

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
    """Formula of a metric: sum over the window."""
    return lambda of: of.sums[field]


def flow_of(*fields: str) -> Callable[[WindowSums], VariantValues]:
    """Formula of a metric: a tensioner's oil flow."""
    return lambda of: sum(of.sums["flows"][field] for field in fields)


def chamber_filling_time(of: WindowSums) -> VariantValues:
    """Metric time (V,) [s] until a chamber was filled."""
    flows = of.sums["flows"]
    return mask_absent(flows["unfilled"] == 0, flows["filling"])


def mean_of(field: str, component: int | None = None) -> Callable[[WindowSums], VariantValues]:
    """Formula of a metric: mean over the window."""
    if component is not None:
        return lambda of: of.sums[field][..., component] / of.weight
    return lambda of: of.sums[field] / of.weight


def deviation_of(field: str) -> Callable[[WindowSums], VariantValues]:
    """Formula of a metric: standard deviation over the window."""

    def formula(of: WindowSums) -> VariantValues:
        center = of.sums[field] / of.weight
        return np.sqrt(np.maximum(of.sums[f"{field}_square"] / of.weight - center * center, 0.0))

    return formula


def rms_of(field: str) -> Callable[[WindowSums], VariantValues]:
    """Formula of a metric: root mean square."""
    return lambda of: np.sqrt(of.sums[f"{field}_square"] / of.weight)


LEAST_TURNOVER = 1e-3
"""Least energy to divide by, over that stored."""


def tension_quantile_of(share: float) -> Callable[[WindowSums], VariantValues]:
    """Formula of a metric: quantile of link tensions."""

    def formula(of: WindowSums) -> VariantValues:
        assert of.tension is not None
        return histogram_quantile(
            *of.tension, of.sums["tension_min"], of.sums["tension_max"], share, of.cumulative_tension_counts
        )

    return formula


def tension_share_below_value(value: float) -> Callable[[WindowSums], VariantValues]:
    """Formula of a metric: share of tensions below."""

    def formula(of: WindowSums) -> VariantValues:
        assert of.tension is not None
        return histogram_share_below(
            *of.tension, of.sums["tension_min"], of.sums["tension_max"], value, of.cumulative_tension_counts
        )

    return formula


def standard_error_of(mean: Callable[[WindowSums], VariantValues]) -> Callable[[WindowSums], VariantValues]:
    """Formula of a metric: standard error of a mean."""

    def formula(of: WindowSums) -> VariantValues:
        if of.batches is None:
            return mask_absent(np.zeros(len(of.sums), bool), np.zeros(len(of.sums)))
        error = mean_standard_error(mean(of.batches), of.batches.weight)
        return mask_absent(np.isfinite(error), error)

    return formula


@dataclass(frozen=True)
class DriftMeans:
    """Batch means (V, batches) of tension and speeds."""

    tension: NDArray[np.float64]  # of the chain [N]
    speeds: Sequence[NDArray[np.float64]]  # of each sprocket [rad/s]
    waves: NDArray[np.float64]  # (V,) periods of the slowest ripple in the window, 0 for none

    @property
    def tension_change(self) -> VariantValues:
        """Change (V,) [N] of mean tension over the window."""
        found = window_change(self.tension, self.waves)
        return mask_absent(np.isfinite(found), found)

    @property
    def tension_change_chance(self) -> VariantValues:
        """Probability (V,) of so large a tension change."""
        _, chance = window_drift(self.tension)
        return mask_absent(np.isfinite(chance), chance)

    @property
    def is_steady(self) -> VariantValues:
        """Whether neither tension nor speeds drift (V,)."""
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
        """Efficiency, output over output and losses, or missing."""
        taken = self.output + self.dissipated
        given = (self.output >= 0.0) & (taken > 0.0)
        return mask_absent(given, self.output / np.where(given, taken, 1.0))

    @property
    def relative_change(self) -> VariantValues:
        """Change of energy over losses."""
        losses = np.maximum(self.dissipated, LEAST_TURNOVER * abs(self.stored))
        return np.where(losses == 0.0, 0.0, self.change / np.where(losses == 0.0, 1.0, losses))

    @property
    def relative_residual(self) -> VariantValues:
        """Residual of energy over half the balance's terms."""
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
        """Another metric of the part (V,), or nan."""
        found = self.metrics.get(self.prefix + name)
        return np.full(len(self.models), np.nan) if found is None else found.filled(np.nan)

    def has_metrics(self, *names: str) -> NDArray[np.bool_]:
        """Whether other metrics of the part are given (V,)."""
        found = [self.metrics.get(self.prefix + name) for name in names]
        return np.all([np.zeros(len(self.models), bool) if of is None else ~of.missing for of in found], axis=0)

    def number_of_each(self, value: Callable[[ChainModel], Any]) -> NDArray[np.float64]:
        """A number of each drive (V,), computed by stacks."""
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
    """Metric largest over mean tension (V,), (a)."""
    return mask_absent(of["tension_mean"] > 0.0, of["tension_max"] / of["tension_mean"])


def displacement_std(of: DesignInputs) -> VariantValues:
    """Metric standard deviation of a strand's displacement (V,) [m]."""
    center, root = of["displacement_mean"], of["displacement_rms"]
    spread = np.sqrt(np.maximum(root * root - center * center, 0.0))
    return mask_absent(of.has_metrics("displacement_mean", "displacement_rms"), spread)


def contact_energy_per_revolution(of: DesignInputs) -> VariantValues:
    """Metric contact energy a revolution (V,) [J]."""
    model = of.models[0]
    revolutions = of.sprocket_turns(model.driver)
    prefixes = [of.prefix] if of.prefix else [f"{name}." for name in partner_names(model)]
    dissipated = sum(of.metrics[f"{prefix}dissipated"].values for prefix in prefixes)
    return mask_absent(revolutions != 0.0, dissipated / revolutions)


def total_friction_power(of: DesignInputs) -> VariantValues:
    """Metric friction power (V,) [W], (d)."""
    model = of.models[0]
    names = ["joints.friction", *(f"{name}.friction" for name in partner_names(model))]
    rubbed = sum(of.metrics[name].values for name in names if name in of.metrics)
    length = of.metrics["window_end"].values - of.metrics["window_start"].values
    return np.asarray(rubbed / length)


def rated_use(of: DesignInputs) -> VariantValues:
    """Metric driver power over rated power (V,) [-], (e)."""
    first = of.models[0]
    name = first.sprockets[first.driver].name
    moment, speed = (of.metrics[f"{name}.{column}"].values for column in ("moment_mean", "speed_mean"))
    moves = speed != 0.0

    def rated(model: ChainModel, speed: Any) -> Any:
        """Rated power [W] at the driver's speed [rad/s]."""
        teeth = model.sprockets[smallest_driven(model)].teeth
        assert model.chain.size is not None  # the metric's own condition
        return rated_power(model.chain.size, teeth, speed * model.sprockets[model.driver].teeth / teeth).least

    power = number_of_each_drive(of.models, of.stacks, rated, np.where(moves, np.abs(speed), 1.0))
    return mask_absent(moves, np.abs(moment * speed) / power)


def impact_impulse(of: DesignInputs) -> VariantValues:
    """Metric impact impulse of a sprocket (V,) [N s]."""
    teeth = of.number_of_each(lambda model: model.sprockets[of.index].teeth)
    passings = teeth * of.sprocket_turns(of.index)
    return mask_absent(passings > 0.0, np.sqrt(2.0 * of.roller_mass * np.maximum(of["dissipated"], 0.0) / passings))
