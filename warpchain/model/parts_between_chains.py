"""Sprockets that turn as another chain's."""

from __future__ import annotations

from warpchain.drive.schema import Name, NonNegative
from warpchain.drive.shafts import Shaft
from warpchain.drive.sprocket import Load, Prescribed, Sprocket


class LedSprocket(Sprocket):
    """Leading sprocket of a chain, turned by another chain.

    Prescribed but in a run.

    Attributes:
        driver: motion of the drive's driver.
        start_ratio: forward start speed over the driver's [-].
    """

    driver: Prescribed
    start_ratio: float


class SprocketShaft(Shaft):
    """Sprocket of another chain as a home chain's shaft.

    Attributes:
        shaft: that it turns with.
        demand: load with that of its chain.
        driven_inertia: inertia with its chain's [kg m^2].
    """

    shaft: Name | None = None
    demand: Load | None = None
    driven_inertia: NonNegative = 0.0
