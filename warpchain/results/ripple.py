"""Ripples of the mean tension that a drive's own motions, loads and valves cause, and changes that tables prescribe.

Neither is a start that has not died away.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpchain.drive import Drive
from warpchain.drive.trains import names_of, speed_ratio


def slowest_ripple(drive: Drive, turns: NDArray[np.float64], seconds: float) -> float:
    """Periods in a window of the slowest ripple of motions, loads, motors, valves and prescribed centers; 0 for none.

    Args:
        turns: of each sprocket in the window.
        seconds: duration of the window [s].
    """
    count = len(turns)

    def periods(b: int, order: float) -> float:
        led = b if b < count else drive.driver
        return order * float(turns[led]) * (1.0 if b < count else speed_ratio(drive, b, led))

    swings = (getattr(sprocket.mount, "frequency", 0.0) * seconds for sprocket in drive.sprockets)
    slow = [*(periods(b, order) for b, order in _orders(drive)), *(swing for swing in swings if swing)]
    return min(slow, default=0.0)


def _orders(drive: Drive) -> Iterator[tuple[int, float]]:
    """Bodies, and periods per revolution of ripples that their angles cause."""
    names: list[Any] = []
    bodies: list[Any] = [*drive.sprockets, *drive.shafts]
    for b, part in enumerate(bodies):
        for of in (part.load, part.prescribed, _of(part, "motor")):
            table = _of(of, "table")
            ripples = [(h.shaft, h.order) for h in getattr(of, "harmonics", ()) if h.amplitude]
            if table is not None and table.slowest_order is not None:
                ripples.append((table.shaft, table.slowest_order))
            for shaft, order in ripples:
                names = names or (names_of(drive) if shaft is not None else [])
                yield names.index(shaft) if shaft in names else b, order
    for valves in drive.valves:
        names = names or names_of(drive)
        yield names.index(valves.on), valves.slowest_order


def changes_within(drive: Drive, begin: float, end: float) -> bool:
    """Whether a table over time changes a motion, load, motor, ratio, clutch, oil supply or place between two times
    [s]."""
    return any(not _even(over, values, begin, end) for over, values in _tables(drive))


def _tables(drive: Drive) -> Iterator[tuple[Any, Any]]:
    """Times [s] and values of all tables over time."""
    parts: list[Any] = [*drive.sprockets, *drive.shafts]
    held = [_of(of, "table") for part in parts for of in (part.load, part.prescribed, _of(part, "motor"))]
    held += [_of(coupling.clutch, "table") for coupling in drive.couplings]
    held += [_of(tensioner.oil, "supply_table") for tensioner in drive.tensioners]
    yield from ((table.over, table.values) for table in held if table is not None and table.time is not None)
    ratios = (coupling.ratios for coupling in drive.couplings)
    yield from ((of.time, of.ratio) for of in ratios if of is not None)
    places = [*(_of(sprocket.mount, "table") for sprocket in drive.sprockets), *(arm.pivot_table for arm in drive.arms)]
    for table in (table for table in places if table is not None):
        yield from ((table.time, column) for column in (table.x, table.y) if column is not None)


def _of(part: Any, name: str) -> Any:
    return getattr(part, name, None)


def _even(over: Any, values: Any, begin: float, end: float) -> bool:
    """Whether a quantity over time, as at its ends beyond them, is the same from `begin` to `end`."""
    time, value = np.asarray(over, dtype=float), np.asarray(values, dtype=float)
    first, last = np.searchsorted(time, begin, side="right") - 1, np.searchsorted(time, end)
    return bool(np.ptp(value[max(int(first), 0) : min(int(last), len(value) - 1) + 1]) == 0.0)
