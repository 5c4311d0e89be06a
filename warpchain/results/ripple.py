"""Slowest ripple of the mean tension that a drive's own motions, loads and valves cause."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpchain.drive.body_ties import body_names
from warpchain.drive.sprocket import PrescribedMount
from warpchain.drive.stack_math import is_true_somewhere, minimum
from warpchain.model.trains import body_speed_ratio

if TYPE_CHECKING:
    from warpchain.model import ChainModel


def slowest_ripple_periods(model: ChainModel, turns: NDArray[np.float64], seconds: Any) -> Any:
    """Periods in the window of the slowest tension ripple, or 0.

    Args:
        turns: of each sprocket in the window, (S,) or (S, V).
        seconds: duration of the window [s].
    """
    count = len(turns)

    def periods_in_window(b: int, order: Any) -> Any:
        """Periods in the window of a body's ripple order."""
        led = b if b < count else model.driver
        return order * turns[led] * (1.0 if b < count else body_speed_ratio(model, b, led))

    mounts = (sprocket.mount for sprocket in model.sprockets)
    swings = [
        mount.frequency for mount in mounts if isinstance(mount, PrescribedMount) and is_true_somewhere(mount.frequency)
    ]
    slow = [
        *(periods_in_window(b, order) for b, order in _ripple_orders(model)),
        *(swing * seconds for swing in swings),
    ]
    return minimum(*slow) if slow else 0.0


def _ripple_orders(model: ChainModel) -> Iterator[tuple[int, float]]:
    """Body and order of each tension ripple."""
    names: list[Any] = []
    acting: list[tuple[Any, ...]] = [(of.load, of.prescribed) for of in model.sprockets]
    acting += [(of.load, of.prescribed, of.motor) for of in model.shafts]
    for b, causes in enumerate(acting):
        for of in causes:
            table = getattr(of, "table", None)
            ripples = [(h.shaft, h.order) for h in getattr(of, "harmonics", ()) if is_true_somewhere(h.amplitude)]
            if table is not None and table.slowest_order is not None:
                ripples.append((table.shaft, table.slowest_order))
            for shaft, order in ripples:
                names = names or (body_names(model) if shaft is not None else [])
                yield names.index(shaft) if shaft in names else b, order
    for valves in model.valves:
        names = names or body_names(model)
        yield names.index(valves.on), valves.slowest_order
