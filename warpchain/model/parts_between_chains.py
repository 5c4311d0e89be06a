"""Sprockets that belong to two chains' models: the one that leads a chain, and a shaft that stands for one."""

from __future__ import annotations

from warpchain.drive.schema import Name, NonNegative
from warpchain.drive.shafts import Shaft
from warpchain.drive.sprocket import Load, Prescribed, Sprocket


class LedSprocket(Sprocket):
    """Sprocket that leads a chain without a prescribed one, as another chain turns its shaft.

    It counts as prescribed at the speed that the ratios give; in a run its angle is free.

    Attributes:
        driver: motion of the drive's driver at the start.
        start_ratio: forward speed at the start over the driver's, by the radii at which rollers ride [-].
    """

    driver: Prescribed
    start_ratio: float


class SprocketShaft(Shaft):
    """Shaft in a chain's model that stands for a sprocket of another chain.

    Attributes:
        shaft: name of the shaft that the sprocket turns with.
        demand: the sprocket's load with the loads that its chain turns.
        driven_inertia: inertia that its chain turns, with the chain's own [kg m^2].
    """

    shaft: Name | None = None
    demand: Load | None = None
    driven_inertia: NonNegative = 0.0
