"""Sprockets that turn as another chain's, as each of the two chains has them."""

from __future__ import annotations

from warpchain.drive.schema import Name, NonNegative
from warpchain.drive.shafts import Shaft
from warpchain.drive.sprocket import Load, Prescribed, Sprocket


class LedSprocket(Sprocket):
    """The sprocket that leads a chain of which none is prescribed, as another chain turns its shaft.

    Before a run, and where runs are looked at, it counts as prescribed at the speed that the ratios give; in the run
    its angle is free (`warpchain.model.trains.is_free_body`).

    Attributes:
        driver: motion of the drive's driver, as it begins.
        start_ratio: forward speed at the start over the driver's [-], by the radii at which rollers ride.
    """

    driver: Prescribed
    start_ratio: float


class SprocketShaft(Shaft):
    """A sprocket of another chain, as a shaft of its home chain (`warpchain.model.chain_models`).

    Attributes:
        shaft: that it turns with.
        demand: its load and those that its chain turns, together.
        driven_inertia: inertia that its chain turns, with that of the chain [kg m^2].
    """

    shaft: Name | None = None
    demand: Load | None = None
    driven_inertia: NonNegative = 0.0
