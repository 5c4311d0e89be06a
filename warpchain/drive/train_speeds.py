"""Speeds of sprockets and shafts: at the start, and where a motor and the loads come to balance."""

from __future__ import annotations

from typing import Any

from warpchain.drive.batch_math import largest, many, power, where
from warpchain.drive.shafts import Beside
from warpchain.drive.trains import (
    driving_body,
    driving_sprocket,
    is_free,
    loads_of,
    own_inertia,
    speed_ratio,
    turned_part,
)

HALVINGS = 60
"""Of the interval in which moments balance."""


def top_speed(drive: Any) -> Any:
    """Top forward speed of the driving sprocket [rad/s], of a stack's variants (V,).

    With a motor where its moment and the loads balance, but no more than it can come to within the run; with neither
    motor nor motion the speed at the start.
    """
    b, driver = driving_body(drive), driving_sprocket(drive)
    part, ratio = turned_part(drive, b), speed_ratio(drive, driver, b)
    if part.prescribed is not None:
        return part.prescribed.top_speed * ratio
    begun = 0.0 if part.initial_speed is None else part.initial_speed * ratio
    motors = [(h + len(drive.sprockets), of.motor) for h, of in enumerate(drive.shafts) if of.motor is not None]
    if not motors:
        return begun
    bodies = range(len(drive.sprockets) + len(drive.shafts))
    beside = [speed_ratio(drive, other, driver) for other in bodies]
    inertia = drive.chain.links * drive.chain.mass * power(drive.pitch_radius(driver), 2)
    inertia = inertia + sum(power(beside[o], 2) * own_inertia(drive, o) for o in bodies if is_free(drive, o))
    drives = [(beside[o], motor) for o, motor in motors]
    others = [(o, of) for o, of in enumerate(drive.shafts, len(drive.sprockets)) if isinstance(of, Beside)]
    inertia = inertia + sum(power(beside[o], 2) * of.beyond for o, of in others)
    resists = [(beside[o], load) for o, load in loads_of(drive) if o not in dict(others)]
    resists += [(beside[o], of.asks) for o, of in others if of.asks is not None]

    def moment(speed: Any) -> Any:
        pushing = sum(r * motor.at(r * speed) for r, motor in drives)
        return pushing - sum(r * load.steady(r * speed) for r, load in resists)

    low = 0.0 * inertia + begun * 0.0
    high = low + begun + largest(0.0, moment(low + begun)) / inertia * drive.run.duration
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        above = moment(middle) > 0.0
        low, high = where(above, middle, low), where(above, high, middle)
    return high if many(high) else float(high)
