"""Sprockets of two chains' models: as a leader, and as a shaft."""

from __future__ import annotations

from warpchain.drive.schema import Name, NonNegative
from warpchain.drive.shafts import Shaft
from warpchain.drive.sprocket import Load, Prescribed, Sprocket


class LedSprocket(Sprocket):
    """Sprocket that leads a chain, itself turned by another.

    It counts as prescribed; in a run its angle is free.

    Attributes:
        driver: start motion of the drive's driver.
        start_ratio: forward start speed over the driver's, by riding radii [-].
    """

    driver: Prescribed
    start_ratio: float


class SprocketShaft(Shaft):
    """Shaft in a chain's model for a sprocket of another chain.

    Attributes:
        shaft: name of the sprocket's own.
        demand: the sprocket's load and those behind its chain.
        driven_inertia: of its chain and what that turns [kg m^2].
    """

    shaft: Name | None = None
    demand: Load | None = None
    driven_inertia: NonNegative = 0.0
