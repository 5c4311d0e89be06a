"""Driver's speed at the start and in balance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from warpchain.drive.body_ties import driving_body, driving_sprocket, nearest_sprocket, part_of_body
from warpchain.drive.stack_math import Number, has_arrays, maximum, minimum, power, where
from warpchain.model.parts_between_chains import SprocketShaft
from warpchain.model.trains import body_speed_ratio, free_body_loads, inertia_of_body, is_free_body, train_of_body

BALANCE_HALVINGS = 60
"""Halvings of the interval in which moments balance."""
RUN_UP_ROUNDS = 6
"""Refinements of a run-up's steps."""
SPEED_STEPS = 256
"""Steps between two speeds for moments."""


@dataclass(frozen=True)
class LumpedDrive:
    """A drive lumped into its driving sprocket, () or (V,).

    Attributes:
        start: start speed [rad/s].
        inertia: with the chain's [kg m^2].
        motors, loads: with speed ratios.
    """

    start: Number
    inertia: Number
    motors: list[tuple[float, Number]]
    loads: list[tuple[float, Number]]

    def net_moment(self, speed: Number) -> Number:
        """Mean moment of a lumped drive's motors less loads' [N m]."""
        return sum(r * motor.at(r * speed) for r, motor in self.motors) - self._load_moment(speed)

    def net_moment_bounds(self, speed: Number) -> tuple[Number, Number]:
        """Least and largest net moment of a lumped drive [N m]."""
        bounds = [[r * of for of in motor.bounds(r * speed)] for r, motor in self.motors]
        asked = self._load_moment(speed)
        return sum(low for low, _ in bounds) - asked, sum(high for _, high in bounds) - asked

    def _load_moment(self, speed: Number) -> Number:
        """Moment of a lumped drive's loads [N m]."""
        # 0 of as many as there are speeds, where nothing loads
        return 0.0 * speed + sum(r * load.steady_moment(r * speed) for r, load in self.loads)


def lumped_drive(model: Any) -> LumpedDrive:
    """Lumped drive of a chain without prescribed sprockets."""
    driver = driving_sprocket(model)
    bodies = [b for b in range(len(model.sprockets) + len(model.shafts)) if nearest_sprocket(model, b) is not None]
    beside = {o: body_speed_ratio(model, o, driver) for o in bodies}
    inertia = model.chain.links * model.chain.mass * power(model.pitch_radius(driver), 2)
    inertia = inertia + sum(power(beside[o], 2) * inertia_of_body(model, o) for o in bodies if is_free_body(model, o))
    shafts = [(o, of) for o, of in enumerate(model.shafts, len(model.sprockets)) if o in beside]
    motors = [(beside[o], of.motor) for o, of in shafts if of.motor is not None]
    others = [(o, of) for o, of in shafts if isinstance(of, SprocketShaft)]
    inertia = inertia + sum(power(beside[o], 2) * of.driven_inertia for o, of in others)
    loads = [(beside[o], load) for o, load in free_body_loads(model) if o in beside and o not in dict(others)]
    loads += [(beside[o], of.demand) for o, of in others if of.demand is not None]
    return LumpedDrive(_driver_start_speed(model, driver), inertia, motors, loads)


def _driver_start_speed(model: Any, driver: int) -> Number:
    """Start speed of the driving sprocket, by ties [rad/s]."""
    models = driving_body(model)
    around = [models, *train_of_body(model, models).bodies, *train_of_body(model, driver).bodies]
    around += [b for s in range(len(model.sprockets)) for b in train_of_body(model, s).bodies]
    around += range(len(model.sprockets) + len(model.shafts))
    for b in around:
        speed = getattr(part_of_body(model, b), "initial_speed", None)
        if speed is not None and nearest_sprocket(model, b) is not None:
            return speed * body_speed_ratio(model, driver, b)
    return 0.0


def driver_top_speed(model: Any) -> Number:
    """Top forward speed of the driving sprocket, () or (V,) [rad/s].

    With a motor where moments first balance within the run.
    """
    b = driving_body(model)
    part = part_of_body(model, b)
    if part.prescribed is not None:
        return part.prescribed.top_speed * body_speed_ratio(model, driving_sprocket(model), b)
    one = lumped_drive(model)
    if not one.motors:
        return one.start
    duration, most = model.run.duration, sum(r * motor.largest_moment for r, motor in one.motors)
    low = 0.0 * one.inertia + one.start
    high = low + maximum(0.0, one.net_moment(low)) / one.inertia * duration
    high = where(one.net_moment(high) > 0.0, low + most / one.inertia * duration, high)
    high = _balanced_speed(one, low, high)
    grid = speed_steps(low, high)
    early = one.net_moment(grid[1:-1]) <= 0.0
    first = early.argmax(axis=0)
    high = where(
        early.any(axis=0), _balanced_speed(one, _values_at_rows(grid, first), _values_at_rows(grid, first + 1)), high
    )
    for _ in range(RUN_UP_ROUNDS):
        high = _speed_within_time(one, low, high, duration)
    return high if has_arrays(high) else float(high)


def _balanced_speed(one: LumpedDrive, low: Number, high: Number) -> Number:
    """Speed at which moments balance, else the higher [rad/s]."""
    for _ in range(BALANCE_HALVINGS):
        middle = 0.5 * (low + high)
        above = one.net_moment(middle) > 0.0
        low, high = where(above, middle, low), where(above, high, middle)
    return high


def _speed_within_time(one: LumpedDrive, low: Number, high: Number, duration: Number) -> Number:
    """Speed reached within a time, motors' ramps at half [rad/s]."""
    import numpy as np

    given = maximum(0.0, duration - 0.5 * minimum(*(motor.ramp_time for _, motor in one.motors)))
    grid = speed_steps(low, high + 0.0 * given)  # a column for each variant, also where only their times differ
    moment = one.net_moment(0.5 * (grid[1:] + grid[:-1]))
    with np.errstate(divide="ignore", invalid="ignore"):
        time = np.cumsum(one.inertia * np.diff(grid, axis=0) / np.maximum(moment, 0.0), axis=0)
    time = np.concatenate([np.zeros_like(time[:1]), time])
    late = time[1:] > given
    cell = late.argmax(axis=0)
    begin, end = _values_at_rows(time, cell), _values_at_rows(time, cell + 1)
    share = (given - begin) / where(end > begin, end - begin, 1.0)
    found = _values_at_rows(grid, cell) + share * (_values_at_rows(grid, cell + 1) - _values_at_rows(grid, cell))
    # a balance is only approached: nearer than a cell counts as there
    return where(where(one.net_moment(high) <= 0.0, late[:-1].any(axis=0), late.any(axis=0)), found, high)


def _values_at_rows(rows: Any, at: Any) -> Any:
    """Values of a run-up's table at a row of each column."""
    import numpy as np

    return rows[at] if rows.ndim == 1 else rows[at, np.arange(rows.shape[1])]


def speed_steps(low: Number, high: Number) -> Number:
    """Speeds in equal steps (SPEED_STEPS + 1, ...)."""
    import numpy as np

    return np.linspace(low, high, SPEED_STEPS + 1)
