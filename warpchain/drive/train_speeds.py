"""Speeds of sprockets and shafts: at the start, and where a motor and the loads come to balance; what speeds them up.

All that chain, shafts, gears and couplings tie to the driver turns as one body here, without slip, twist or play, as
the driver sees it: sum rho^2 J w' = sum rho (moments of motors) - sum rho (moments of loads), rho the speed of a part
over the driver's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from warpchain.drive.batch_math import largest, many, power, smallest, where
from warpchain.drive.shafts import Beside
from warpchain.drive.trains import (
    driving_body,
    driving_sprocket,
    is_free,
    loads_of,
    nearest_sprocket,
    own_inertia,
    speed_ratio,
    train_of,
    turned_part,
)

HALVINGS = 60
"""Of the interval in which moments balance."""
ROUNDS = 6
"""In which the steps become finer where the run ends long before a balance."""
STEPS = 256
"""Equal steps between two speeds, in which moments are looked at."""


@dataclass(frozen=True)
class AsOne:
    """All that turns with the driver as one body; numbers, of a stack's variants (V,).

    Attributes:
        start: speed of the driving sprocket at the start [rad/s].
        inertia: as the driving sprocket sees it, with that of the chain [kg m^2].
        motors, loads: with the speed of what they act on over that of the driving sprocket.
    """

    start: Any
    inertia: Any
    motors: list[tuple[float, Any]]
    loads: list[tuple[float, Any]]

    def moment(self, speed: Any) -> Any:
        """Moment of the motors beyond that of the loads at a speed of the driving sprocket, as this sees it [N m]; of a
        motor over time or angle the mean."""
        return sum(r * motor.at(r * speed) for r, motor in self.motors) - self._asked(speed)

    def extremes(self, speed: Any) -> tuple[Any, Any]:
        """The least and the largest of it, of motors over time or angle [N m]."""
        bounds = [[r * of for of in motor.bounds(r * speed)] for r, motor in self.motors]
        asked = self._asked(speed)
        return sum(low for low, _ in bounds) - asked, sum(high for _, high in bounds) - asked

    def _asked(self, speed: Any) -> Any:
        return 0.0 * speed + sum(r * load.steady(r * speed) for r, load in self.loads)  # of as many as there are speeds


def as_one(drive: Any) -> AsOne:
    """All that turns with the driver of a chain of which no sprocket is prescribed; a drive, or a stack."""
    driver = driving_sprocket(drive)
    bodies = [b for b in range(len(drive.sprockets) + len(drive.shafts)) if nearest_sprocket(drive, b) is not None]
    beside = {o: speed_ratio(drive, o, driver) for o in bodies}
    inertia = drive.chain.links * drive.chain.mass * power(drive.pitch_radius(driver), 2)
    inertia = inertia + sum(power(beside[o], 2) * own_inertia(drive, o) for o in bodies if is_free(drive, o))
    shafts = [(o, of) for o, of in enumerate(drive.shafts, len(drive.sprockets)) if o in beside]
    motors = [(beside[o], of.motor) for o, of in shafts if of.motor is not None]
    others = [(o, of) for o, of in shafts if isinstance(of, Beside)]
    inertia = inertia + sum(power(beside[o], 2) * of.beyond for o, of in others)
    loads = [(beside[o], load) for o, load in loads_of(drive) if o in beside and o not in dict(others)]
    loads += [(beside[o], of.asks) for o, of in others if of.asks is not None]
    return AsOne(_start_speed(drive, driver), inertia, motors, loads)


def _start_speed(drive: Any, driver: int) -> Any:
    """Speed of the driving sprocket at the start [rad/s]: its train's own, else as the chain, else as couplings have it
    from what begins at a speed."""
    drives = driving_body(drive)
    around = [drives, *train_of(drive, drives).bodies, *train_of(drive, driver).bodies]
    around += [b for s in range(len(drive.sprockets)) for b in train_of(drive, s).bodies]
    around += range(len(drive.sprockets) + len(drive.shafts))
    for b in around:
        speed = getattr(turned_part(drive, b), "initial_speed", None)
        if speed is not None and nearest_sprocket(drive, b) is not None:
            return speed * speed_ratio(drive, driver, b)
    return 0.0


def top_speed(drive: Any) -> Any:
    """Top forward speed of the driving sprocket [rad/s], of a stack's variants (V,).

    With a motor where its moment and the loads first balance, but no more than it comes to within the run; with neither
    motor nor motion the speed at the start.
    """
    b = driving_body(drive)
    part = turned_part(drive, b)
    if part.prescribed is not None:
        return part.prescribed.top_speed * speed_ratio(drive, driving_sprocket(drive), b)
    one = as_one(drive)
    if not one.motors:
        return one.start
    duration, most = drive.run.duration, sum(r * motor.largest for r, motor in one.motors)
    low = 0.0 * one.inertia + one.start
    high = low + largest(0.0, one.moment(low)) / one.inertia * duration
    high = where(one.moment(high) > 0.0, low + most / one.inertia * duration, high)
    high = _balance(one, low, high)
    grid = steps(low, high)
    early = one.moment(grid[1:-1]) <= 0.0
    first = early.argmax(axis=0)
    high = where(early.any(axis=0), _balance(one, _of(grid, first), _of(grid, first + 1)), high)
    for _ in range(ROUNDS):
        high = _in_time(one, low, high, duration)
    return high if many(high) else float(high)


def _balance(one: AsOne, low: Any, high: Any) -> Any:
    """Where between two speeds moments balance; the higher one where they do not [rad/s]."""
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        above = one.moment(middle) > 0.0
        low, high = where(above, middle, low), where(above, high, middle)
    return high


def _in_time(one: AsOne, low: Any, high: Any, duration: Any) -> Any:
    """The speed that is come to from one toward another within a time, motors' ramps counted at half [rad/s]."""
    import numpy as np

    given = largest(0.0, duration - 0.5 * smallest(*(motor.ramp_time for _, motor in one.motors)))
    grid = steps(low, high + 0.0 * given)  # a column for each variant, also where only their times differ
    moment = one.moment(0.5 * (grid[1:] + grid[:-1]))
    with np.errstate(divide="ignore", invalid="ignore"):
        time = np.cumsum(one.inertia * np.diff(grid, axis=0) / np.maximum(moment, 0.0), axis=0)
    time = np.concatenate([np.zeros_like(time[:1]), time])
    late = time[1:] > given
    cell = late.argmax(axis=0)
    begin, end = _of(time, cell), _of(time, cell + 1)
    share = (given - begin) / where(end > begin, end - begin, 1.0)
    found = _of(grid, cell) + share * (_of(grid, cell + 1) - _of(grid, cell))
    # a balance is only approached: nearer than a cell counts as there
    return where(where(one.moment(high) <= 0.0, late[:-1].any(axis=0), late.any(axis=0)), found, high)


def _of(rows: Any, at: Any) -> Any:
    """The number of each column (N,) or (N, V) in a row of its own."""
    import numpy as np

    return rows[at] if rows.ndim == 1 else rows[at, np.arange(rows.shape[1])]


def steps(low: Any, high: Any) -> Any:
    """Speeds from one to another, both ends included, (STEPS + 1,) or (STEPS + 1, V)."""
    import numpy as np

    return np.linspace(low, high, STEPS + 1)
