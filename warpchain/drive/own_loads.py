"""Loads of plug-ins: functions of time, angle or speed that become tables (docs/plugins.md)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from warpchain.argument_checks import check_arguments
from warpchain.drive.plugins import add_to_registry, function_code, load_installed_plugins
from warpchain.drive.schema import nearest_key_text
from warpchain.errors import DriveError, PluginError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

LoadFunction = Callable[["NDArray[np.float64]"], Any]
AXES = ("time", "angle", "speed")
CLOSED = 1e-9
"""Relative gap that a load over angle closes."""


@dataclass(frozen=True)
class OwnLoad:
    """A plug-in's load: torque over time, angle or speed, from 0 to an end, in equal rows."""

    function: LoadFunction
    over: str
    end: float
    rows: int

    def columns(self, name: str) -> dict[str, list[float]]:
        """Columns of the load's table by key, in SI units.

        Raises:
            PluginError: what the function raises, or values that are not one finite torque a row.
        """
        import numpy as np

        x = np.linspace(0.0, self.end, self.rows)
        with function_code(self.function, f"load {name!r}"):
            torque = np.array(self.function(x.copy()), dtype=float)
            if torque.shape != x.shape or not np.isfinite(torque).all():
                raise PluginError(f"gives {_wrong_torques_text(torque)}; must be {self.rows} finite torques [N m]")
        if self.over == "angle" and abs(torque[-1] - torque[0]) <= CLOSED * np.abs(torque).max():
            torque[-1] = torque[0]
        return {self.over: x.tolist(), "torque": torque.tolist()}


def _wrong_torques_text(values: NDArray[np.float64]) -> str:
    """Words on torques of a plug-in's load that are not allowed."""
    import numpy as np

    return f"an array of shape {values.shape}" if np.isfinite(values).all() else "torques that are not finite"


OWN_LOADS: dict[str, OwnLoad] = {}


@check_arguments(PluginError)
def load_law(name: str, *, over: str, end: float, rows: int = 721) -> Callable[[LoadFunction], LoadFunction]:
    """Decorator of a plug-in's function that makes it the load `name` of drive files: `table = { own = "NAME" }`.

    The function gets times [s], angles [rad] or speeds [rad/s] (rows,), and returns torques (rows,) [N m]. A drive that
    is read keeps them as its table: runs and archives need the plug-in no more.

    Args:
        over: "time", "angle" or "speed".
        end: last time, angle or speed; the first is 0. Over angle a whole number of revolutions, after which it
            repeats.
        rows: of the table, 2 to 100 000.

    Raises:
        PluginError: a name that is taken or not allowed, another axis, end or number of rows, or no function.
    """
    if over not in AXES:
        raise PluginError(f"load {name!r}: over = {over!r}: must be one of {', '.join(AXES)}")
    if not (0.0 < end < math.inf and 2 <= rows <= 100_000):
        raise PluginError(f"load {name!r}: must end above 0, in 2 to 100000 rows")

    def add(function: LoadFunction) -> LoadFunction:
        """Adds the load; returns its function."""
        if not hasattr(function, "__code__"):
            raise PluginError(f"load {name!r}: must be a function")
        add_to_registry(OWN_LOADS, "load", name, OwnLoad(function, over, end, rows), function.__code__.co_filename)
        return function

    return add


def own_columns(name: Any, axes: tuple[str, ...]) -> dict[str, list[float]]:
    """Columns of a table over `axes` that names a plug-in's load.

    Raises:
        DriveError: an unknown name, or a load over another axis.
        PluginError: as `OwnLoad.columns`.
    """
    load_installed_plugins()
    if not isinstance(name, str) or name not in OWN_LOADS:
        known = nearest_key_text(str(name), OWN_LOADS) if OWN_LOADS else "none is loaded (--plugin)"
        raise DriveError(f"must be the name of a plug-in's load; {known}")
    if OWN_LOADS[name].over not in axes:
        raise DriveError(f"is a load over {OWN_LOADS[name].over}; must be one over {' or '.join(axes)}")
    return OWN_LOADS[name].columns(name)
