"""How metrics are formed: from sums over the window, from the energy balance, and from one another.

The last are what designs are judged by. With E the energy that a partner's contacts dissipate in the window, n_d the
driver's revolutions, n_s a sprocket's tooth passings, m a roller's mass:

    peak factor    = largest over mean tension                                                                (a)
    contact energy per revolution = E / n_d, a wear index: what the contacts have to take up                  (b)
    impact impulse = sqrt(2 m E / n_s), of the blow that would lose E / n_s, a proxy of noise                 (c)

There is no friction in the model: (b) is the work of normal impacts, not of sliding in the bushings.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from warpchain.drive import Drive

Number = float | int | None


def partner_names(drive: Drive) -> list[str]:
    """Names of what rollers touch: the sprockets, then the guide-bars."""
    return [sprocket.name for sprocket in drive.sprockets] + [guide.name for guide in drive.guides]


THINGS: dict[str, Callable[[Drive], list[str]]] = {
    "chain": lambda drive: [""],
    "strand": lambda drive: [f"{name}." for name in drive.strand_names],
    "sprocket": lambda drive: [f"{sprocket.name}." for sprocket in drive.sprockets],
    "partner": lambda drive: [f"{name}." for name in partner_names(drive)],
}
"""The things of a drive that columns are of, by what stands before their names."""


@dataclass(frozen=True)
class Summed:
    """What the kernels added up of one thing over the window.

    Attributes:
        sums: a row of the group's sums.
        weight: what means divide by: samples, or the window's length [s].
    """

    sums: Any
    weight: float


def total(field: str) -> Callable[[Summed], Number]:
    """A sum itself."""
    return lambda of: of.sums[field]


def mean(field: str, component: int | None = None) -> Callable[[Summed], Number]:
    """A sum over its weight."""
    if component is not None:
        return lambda of: of.sums[field][component] / of.weight
    return lambda of: of.sums[field] / of.weight


def deviation(field: str) -> Callable[[Summed], Number]:
    """Standard deviation, from a sum and that of squares."""

    def value(of: Summed) -> float:
        center = of.sums[field] / of.weight
        return float(np.sqrt(max(of.sums[f"{field}_square"] / of.weight - center * center, 0.0)))

    return value


def rms(field: str) -> Callable[[Summed], Number]:
    """Root of the mean square."""
    return lambda of: np.sqrt(of.sums[f"{field}_square"] / of.weight)


@dataclass(frozen=True)
class Balance:
    """The energy balance over the window [J].

    Attributes:
        input: work of what prescribes angles and centers.
        output: work against the loads.
        links: dissipated in the links.
        dissipated: in links, contacts and mounts.
        change: of the mechanical energy.
    """

    input: float
    output: float
    links: float
    dissipated: float
    change: float

    @property
    def residual(self) -> float:
        """What the balance misses."""
        return self.input - self.output - self.dissipated - self.change

    @property
    def relative(self) -> float:
        """The residual over half the sum of the terms' magnitudes."""
        turnover = 0.5 * (abs(self.input) + abs(self.output) + self.dissipated + abs(self.change))
        return self.residual / turnover if turnover else 0.0


@dataclass(frozen=True)
class Judged:
    """What a design is judged by: a variant's other metrics, for one of its things.

    Attributes:
        drive: the variant.
        metrics: its row so far.
        prefix: of the thing's columns, "" for the whole chain.
        index: the thing's.
    """

    drive: Drive
    metrics: dict[str, Any]
    prefix: str
    index: int

    def __getitem__(self, name: str) -> Any:
        """Another metric of the thing, None if it has none."""
        return self.metrics.get(self.prefix + name)

    def turns(self, s: int) -> float:
        """Revolutions of a sprocket in the window."""
        seconds = self.metrics["window_end"] - self.metrics["window_start"]
        return abs(self.metrics[f"{self.drive.sprockets[s].name}.speed_mean"]) * seconds / (2.0 * math.pi)


def peak_factor(of: Judged) -> Number:
    """(a), of the chain or of a strand."""
    return of["tension_max"] / of["tension_mean"] if (of["tension_mean"] or 0.0) > 0.0 else None


def displacement_std(of: Judged) -> Number:
    """Standard deviation [m] of a strand's displacement, from its mean and its root mean square."""
    center, root = of["displacement_mean"], of["displacement_rms"]
    return None if center is None or root is None else math.sqrt(max(root * root - center * center, 0.0))


def per_revolution(of: Judged) -> Number:
    """(b) [J], of one partner, or of all for the chain."""
    revolutions = of.turns(of.drive.driver)
    if revolutions == 0.0:
        return None
    if of.prefix:
        return of["dissipated"] / revolutions
    return sum(of.metrics[f"{name}.dissipated"] for name in partner_names(of.drive)) / revolutions


def impact_impulse(of: Judged) -> Number:
    """(c) [N s], of a sprocket."""
    passings = of.drive.sprockets[of.index].teeth * of.turns(of.index)
    return math.sqrt(2.0 * of.drive.chain.mass * max(of["dissipated"], 0.0) / passings) if passings > 0.0 else None
