"""Formulas of metrics: from sums over the window, from the energy balance, and from one another.

The last are what designs are judged by. With E the energy that a partner's contacts dissipate in the window, n_d the
driver's revolutions, n_s a sprocket's tooth passings, m a roller's mass:

    peak factor    = largest over mean tension                                                                (a)
    contact energy per revolution = E / n_d, a wear index: what the contacts have to take up                  (b)
    impact impulse = sqrt(2 m E / n_s), of the blow that would lose E / n_s, a proxy of noise                 (c)
    friction power = what rubs in joints, on teeth and on guide-bars, over the window's length                (d)

(b) is the work of normal impacts; what sliding takes, where things rub, is in `joints.friction` and `PART.friction`.

Every formula takes the numbers of one variant or arrays (V,) of variants of the same columns.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpchain.drive.batch import Stack
from warpchain.drive.geared import own_shafts
from warpchain.results.batch_means import change, counted_below, drift, quantile, share_below, standard_error, steady

if TYPE_CHECKING:
    from warpchain.drive import Drive

STEP = "run.step"
"""The step [s] among the metrics that `Judged` has; no column."""
Values = Any
"""A number, or an array of one number a variant (V,)."""


class Fields(dict[str, Any]):
    """Arrays by name, each worked out by `value` when it is first asked for."""

    def __init__(self, value: Callable[[str], Any]) -> None:
        super().__init__()
        self._value = value

    def __missing__(self, name: str) -> Any:
        self[name] = found = self._value(name)
        return found


def where(given: ArrayLike, values: ArrayLike) -> np.ma.MaskedArray[Any, Any]:
    """Values where they are given, masked elsewhere."""
    return np.ma.MaskedArray(values, mask=np.logical_not(given))


def each_of(
    drives: Sequence[Drive], stacks: Sequence[Stack] | None, value: Callable[..., Any], *given: NDArray[Any]
) -> NDArray[np.float64]:
    """(V,) a number of each drive, worked out for all of a stack at once.

    Args:
        drives: (V,) the drives.
        stacks: them sorted into kinds, where they are.
        value: of a drive, or of a stack, and of what is given.
        given: arrays (V, ...), of which a stack gets its members' along the last axis, (..., members).
    """
    found = np.empty(len(drives))
    for stack in stacks or [Stack(np.array([v]), drive) for v, drive in enumerate(drives)]:
        found[stack.members] = value(stack.drive, *(np.moveaxis(of[stack.members], 0, -1) for of in given))
    return found


def partner_names(drive: Drive) -> list[str]:
    """Names of what rollers touch: the sprockets, then the guide-bars."""
    return [sprocket.name for sprocket in drive.sprockets] + [guide.name for guide in drive.guides]


THINGS: dict[str, Callable[[Drive], list[str]]] = {
    "chain": lambda drive: [""],
    "strand": lambda drive: [f"{name}." for name in drive.strand_names],
    "sprocket": lambda drive: [f"{sprocket.name}." for sprocket in drive.sprockets],
    "partner": lambda drive: [f"{name}." for name in partner_names(drive)],
    "arm": lambda drive: [f"{arm.name}." for arm in drive.arms],
    "tensioner": lambda drive: [f"{tensioner.name}." for tensioner in drive.tensioners],
    "shaft": lambda drive: [f"{shaft.name}." for shaft in own_shafts(drive)],
    "coupling": lambda drive: [f"{coupling.name}." for coupling in drive.couplings],
    "gear": lambda drive: [f"{gear.name}." for gear in drive.gears],
    "valve": lambda drive: [f"{valves.name}." for valves in drive.valves],
    "probe": lambda drive: [f"{probe.name}." for probe in drive.probes],
}
"""The things of a drive that columns are of, by what stands before their names."""


@dataclass(frozen=True)
class Summed:
    """Sums of one thing over the window, as the kernels added them up.

    Attributes:
        sums: rows of the group's sums.
        weight: what means divide by: samples, or the window's length [s].
        batches: the same batch by batch along a last axis, where sums are noted so; weights are nan where nothing is.
        tension: link tensions in each bin (V, bins), and the bins' edges (V, bins + 1) [N], of what has tensions.
    """

    sums: Any
    weight: Values
    batches: Summed | None = None
    tension: tuple[NDArray[np.integer], NDArray[np.float64]] | None = None

    @cached_property
    def below(self) -> NDArray[np.float64]:
        """(V, bins) link tensions in each bin and those before it (`statistics.counted_below`)."""
        assert self.tension is not None
        return counted_below(self.tension[0])


def total(field: str) -> Callable[[Summed], Values]:
    """A sum itself."""
    return lambda of: of.sums[field]


def flowed(*fields: str) -> Callable[[Summed], Values]:
    """Sum of some of a tensioner's flows."""
    return lambda of: sum(of.sums["flows"][field] for field in fields)


def filling_time(of: Summed) -> Values:
    """Time until oil had filled a tensioner's chamber, from the run's beginning; none where it has not."""
    flows = of.sums["flows"]
    return where(flows["unfilled"] == 0, flows["filling"])


def mean(field: str, component: int | None = None) -> Callable[[Summed], Values]:
    """A sum over its weight."""
    if component is not None:
        return lambda of: of.sums[field][..., component] / of.weight
    return lambda of: of.sums[field] / of.weight


def deviation(field: str) -> Callable[[Summed], Values]:
    """Standard deviation, from a sum and that of squares."""

    def value(of: Summed) -> Values:
        center = of.sums[field] / of.weight
        return np.sqrt(np.maximum(of.sums[f"{field}_square"] / of.weight - center * center, 0.0))

    return value


def rms(field: str) -> Callable[[Summed], Values]:
    """Root of the mean square."""
    return lambda of: np.sqrt(of.sums[f"{field}_square"] / of.weight)


LEAST_TURNOVER = 1e-3
"""Least energy that a residual or a change is held against, of the energy stored."""


def tension_quantile(share: float) -> Callable[[Summed], Values]:
    """The tension that this share of links and instants is below."""

    def value(of: Summed) -> Values:
        assert of.tension is not None
        return quantile(*of.tension, of.sums["tension_min"], of.sums["tension_max"], share, of.below)

    return value


def tension_share_below(value: float) -> Callable[[Summed], Values]:
    """The share of links and instants whose tension is below a value [N]."""

    def share(of: Summed) -> Values:
        assert of.tension is not None
        return share_below(*of.tension, of.sums["tension_min"], of.sums["tension_max"], value, of.below)

    return share


def error_of(mean: Callable[[Summed], Values]) -> Callable[[Summed], Values]:
    """The standard error of a mean (`results.batch_means`)."""

    def value(of: Summed) -> Values:
        assert of.batches is not None
        error = standard_error(mean(of.batches), of.batches.weight)
        return where(np.isfinite(error), error)

    return value


@dataclass(frozen=True)
class Drifts:
    """Means of batches (V, batches) that say whether a variant is steady.

    Attributes:
        tension: of the chain's tension [N].
        speeds: of each sprocket's angular velocity [rad/s].
        waves: (V,) periods of the slowest harmonic of motions and loads in the window [-], 0 for none.
    """

    tension: NDArray[np.float64]
    speeds: Sequence[NDArray[np.float64]]
    waves: NDArray[np.float64]

    @property
    def change(self) -> Values:
        """Of the mean tension over the window [N]."""
        found = change(self.tension, self.waves)
        return where(np.isfinite(found), found)

    @property
    def chance(self) -> Values:
        """Probability that the mean tension seems to change so much without doing so."""
        _, chance = drift(self.tension)
        return where(np.isfinite(chance), chance)

    @property
    def steady(self) -> Values:
        """Whether none of them drifts."""
        each = np.all([steady(means) for means in (self.tension, *self.speeds)], axis=0)
        return where(np.isfinite(self.tension).all(axis=-1), each)


@dataclass(frozen=True)
class Balance:
    """The energy balance over the window [J].

    Attributes:
        input: work of what prescribes angles and centers.
        output: work against the loads.
        links: dissipated in the links.
        dissipated: in links, joints, contacts, mounts, arms and tensioners.
        change: of the mechanical energy.
        stored: the mechanical energy itself, at its larger end.
    """

    input: Values
    output: Values
    links: Values
    dissipated: Values
    change: Values
    stored: Values = 0.0

    @property
    def residual(self) -> Values:
        """The energy that the balance misses."""
        return self.input - self.output - self.dissipated - self.change

    @property
    def efficiency(self) -> Values:
        """Output over output and losses, masked where the loads drive or no work is done.

        What the drive stores meanwhile is no work of its loads, nor lost.
        """
        taken = self.output + self.dissipated
        given = (self.output >= 0.0) & (taken > 0.0)
        return where(given, self.output / np.where(given, taken, 1.0))

    @property
    def relative_change(self) -> Values:
        """The change of energy over the losses, or over `LEAST_TURNOVER` of the energy stored."""
        losses = np.maximum(self.dissipated, LEAST_TURNOVER * abs(self.stored))
        return np.where(losses == 0.0, 0.0, self.change / np.where(losses == 0.0, 1.0, losses))

    @property
    def relative(self) -> Values:
        """The residual over half the sum of the terms' magnitudes, or `LEAST_TURNOVER` of the energy stored.

        Where hardly any energy is turned over the residual is round-off of what is stored.
        """
        turnover = 0.5 * (abs(self.input) + abs(self.output) + self.dissipated + abs(self.change))
        turnover = np.maximum(turnover, LEAST_TURNOVER * abs(self.stored))
        return np.where(turnover == 0.0, 0.0, self.residual / turnover)


@dataclass(frozen=True)
class Judged:
    """Arguments of design metrics: the other metrics of variants of the same columns, for one of their things.

    Attributes:
        drives: the variants.
        stacks: them sorted into kinds, where they are.
        metrics: their columns so far, (V,) each, masked where a variant has none.
        prefix: of the thing's columns, "" for the whole chain.
        index: the thing's.
    """

    drives: Sequence[Drive]
    stacks: Sequence[Stack] | None
    metrics: Mapping[str, np.ma.MaskedArray[Any, Any]]
    prefix: str
    index: int

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Another metric of the thing, nan where there is none."""
        found = self.metrics.get(self.prefix + name, np.ma.masked_all(len(self.drives)))
        return np.where(np.ma.getmaskarray(found), np.nan, np.ma.getdata(found))

    def has(self, *names: str) -> NDArray[np.bool_]:
        """Where other metrics of the thing are given."""
        none = np.ma.masked_all(len(self.drives))
        masks = [np.ma.getmaskarray(self.metrics.get(self.prefix + name, none)) for name in names]
        return ~np.any(masks, axis=0)

    def each(self, value: Callable[[Drive], Any]) -> NDArray[np.float64]:
        """(V,) a number of each drive (`each_of`)."""
        return each_of(self.drives, self.stacks, value)

    @property
    def mass(self) -> NDArray[np.float64]:
        """Mass of a roller [kg]."""
        return self.each(lambda drive: drive.chain.mass)

    def teeth(self, s: int) -> NDArray[np.float64]:
        """Number of teeth of a sprocket."""
        return self.each(lambda drive: drive.sprockets[s].teeth)

    def turns(self, s: int) -> NDArray[Any]:
        """Revolutions of a sprocket in the window."""
        names = ("window_start", "window_end", f"{self.drives[0].sprockets[s].name}.speed_mean")
        start, end, speed = (np.ma.getdata(self.metrics[name]) for name in names)
        return np.abs(speed) * (end - start) / (2.0 * math.pi)


def peak_factor(of: Judged) -> Values:
    """(a), of the chain or of a strand."""
    return where(of["tension_mean"] > 0.0, of["tension_max"] / of["tension_mean"])


def displacement_std(of: Judged) -> Values:
    """Standard deviation [m] of a strand's displacement, from its mean and its root mean square."""
    center, root = of["displacement_mean"], of["displacement_rms"]
    spread = np.sqrt(np.maximum(root * root - center * center, 0.0))
    return where(of.has("displacement_mean", "displacement_rms"), spread)


def per_revolution(of: Judged) -> Values:
    """(b) [J], of one partner, or of all for the chain."""
    drive = of.drives[0]
    revolutions = of.turns(drive.driver)
    prefixes = [of.prefix] if of.prefix else [f"{name}." for name in partner_names(drive)]
    dissipated = sum(np.ma.getdata(of.metrics[f"{prefix}dissipated"]) for prefix in prefixes)
    return where(revolutions != 0.0, dissipated / revolutions)


def friction_power(of: Judged) -> Values:
    """(d) [W], of all that rubs together."""
    drive = of.drives[0]
    names = ["joints.friction", *(f"{name}.friction" for name in partner_names(drive))]
    rubbed = sum(np.ma.getdata(of.metrics[name]) for name in names if name in of.metrics)
    length = np.ma.getdata(of.metrics["window_end"]) - np.ma.getdata(of.metrics["window_start"])
    return np.asarray(rubbed / length)


def impact_impulse(of: Judged) -> Values:
    """(c) [N s], of a sprocket."""
    passings = of.teeth(of.index) * of.turns(of.index)
    return where(passings > 0.0, np.sqrt(2.0 * of.mass * np.maximum(of["dissipated"], 0.0) / passings))
