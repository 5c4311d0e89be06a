"""Frequencies of strands, and the orders of the driver's revolution that excite a drive."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from warpchain.assembly.table_cells import shaft_ratio
from warpchain.drive import Drive
from warpchain.drive.body_ties import body_names
from warpchain.drive.motion_table import Table
from warpchain.drive.shafts import Shaft
from warpchain.drive.sprocket import Sprocket
from warpchain.model import ChainModel, Model, chains_of
from warpchain.model.trains import body_speed_ratio


def strand_frequency(model: ChainModel, links: int, tension: float) -> float:
    """First transverse frequency of a strand of links at rest [Hz]; 0 without tension."""
    if tension <= 0.0 or links < 2:
        return 0.0
    rate = math.sqrt(tension / (model.chain.mass * model.chain.pitch))
    return rate / math.pi * math.sin(math.pi / (2.0 * links))


def moving_frequency(model: ChainModel, length: float, tension: float, speed: float, mode: int = 1) -> float:
    """Transverse frequency of a traveling strand, ends fixed [Hz]; 0 where waves do not outrun the chain.

    Args:
        length: of the strand [m].
        tension: with its centrifugal part [N].
        speed: of the chain [m/s].
        mode: from 1.
    """
    square = max(tension, 0.0) * model.chain.pitch / model.chain.mass
    if square <= speed * speed:
        return 0.0
    wave = math.sqrt(square)
    return mode * (square - speed * speed) / (2.0 * length * wave)


SAME = 1e-6
"""Relative difference below which two orders are one."""


@dataclass(frozen=True)
class Order:
    """Order of the driver's revolution, and what excites it."""

    value: float
    cause: str


def tooth_orders(drive: Drive) -> dict[str, float]:
    """Orders of the driver's revolution at which teeth pass, by chain name."""
    model = Model(drive)
    return {
        chain.name: ratio * chain.sprockets[chain.driver].teeth
        for chain, ratio in zip(model.chains, model.driver_ratios, strict=True)
    }


def excitation_orders(of: Drive | ChainModel) -> tuple[Order, ...]:
    """Orders of the driver's revolution that excite a drive, ascending, with causes.

    Passing teeth, twice that, and half with unlike outer links; revolving bodies and chain; gears; harmonics and
    tables; valves; balance wheels.
    """
    return _merged_orders([*_orders_of_chains(of, _passing_orders), *_orders_of_chains(of, _driven_orders)])


def excited_orders(of: Drive | ChainModel) -> tuple[Order, ...]:
    """Orders that prescribed motions, loads, motors and valves excite, ascending."""
    return _merged_orders(_orders_of_chains(of, _driven_orders))


def _orders_of_chains(
    of: Drive | ChainModel, part: Callable[[ChainModel, str], list[tuple[float, str]]]
) -> list[tuple[float, str]]:
    """Orders of the drive's driver, from those that `part` gives of each chain's driver."""
    ratios = [1.0] if isinstance(of, ChainModel) else Model(of).driver_ratios
    return [
        (ratio * order, cause)
        for chain, ratio in zip(chains_of(of), ratios, strict=True)
        for order, cause in part(chain, f" of {chain.name}" if chain.name else "")
    ]


def _passing_orders(model: ChainModel, named: str) -> list[tuple[float, str]]:
    """Orders, with causes, of passing teeth, revolving bodies and chain."""
    driver = model.sprockets[model.driver]
    found = [(float(driver.teeth), f"tooth passing{named}"), (2.0 * driver.teeth, f"twice tooth passing{named}")]
    lengths = np.asarray(model.chain.link_lengths)
    even = len(lengths) % 2 == 0
    if model.chain.outer is not None or (even and abs(lengths[0::2].mean() / lengths[1::2].mean() - 1.0) > SAME):
        found.append((0.5 * driver.teeth, f"links of two kinds{named}"))
    found.append((driver.teeth / model.chain.links, f"revolution of the chain{named.removeprefix(' of')}"))
    for sprocket in model.sprockets:
        turns = driver.teeth / sprocket.teeth
        wheel = " and its balance wheel" if sprocket.balance_wheel is not None else ""
        found.append((turns, f"revolution of {sprocket.name}{wheel}"))
    for b, shaft in enumerate(model.own_shafts, len(model.sprockets)):
        found.append((body_speed_ratio(model, b, model.driver), f"revolution of {shaft.name}"))
    for gear in model.gears:
        first = body_names(model).index(gear.between[0])
        found.append((gear.teeth[0] * body_speed_ratio(model, first, model.driver), f"teeth of {gear.name}"))
    return found


def _driven_orders(model: ChainModel, _: str) -> list[tuple[float, str]]:
    """Orders, with causes, of harmonics, periodic tables and valves."""
    found = []
    parts: list[Sprocket | Shaft] = [*model.sprockets, *model.shafts]
    for s, turned in enumerate(parts):
        turns = body_speed_ratio(model, s, model.driver)
        motor = getattr(turned, "motor", None)
        for cause, word in ((turned.prescribed, "motion"), (turned.load, "load"), (motor, "motor")):
            if cause is None:
                continue
            for harmonic in getattr(cause, "harmonics", ()):
                if harmonic.amplitude != 0.0:
                    own = harmonic.order / shaft_ratio(model, s, harmonic.shaft)
                    found.append((own * turns, f"{word} of {turned.name}"))
            if isinstance(cause.table, Table) and cause.table.angle is not None:
                own = 1.0 / (cause.table.revolutions * shaft_ratio(model, s, cause.table.shaft))
                found.append((own * turns, f"{word} table of {turned.name}"))
    for valves in model.valves:
        turns = body_speed_ratio(model, body_names(model).index(valves.on), model.driver)
        found.append((valves.slowest_order * turns, f"valves {valves.name}"))
    return found


def _merged_orders(found: list[tuple[float, str]]) -> tuple[Order, ...]:
    """Orders of excitation ascending, equal ones merged."""
    result: list[Order] = []
    for value, cause in sorted(found, key=lambda pair: pair[0]):
        if result and value - result[-1].value <= SAME * value:
            result[-1] = Order(result[-1].value, f"{result[-1].cause}, {cause}")
        else:
            result.append(Order(value, cause))
    return tuple(result)
