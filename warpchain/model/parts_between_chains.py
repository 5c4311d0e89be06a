"""Sprockets that turn as another chain's, as each of the two chains has them."""

from __future__ import annotations

from warpchain.drive.schema import Name, NonNegative
from warpchain.drive.shafts import Shaft
from warpchain.drive.sprocket import Load, Prescribed, Sprocket


class LedSprocket(Sprocket):
    """Sprocket that leads its chain, turned by another chain.

    It counts as prescribed but in a run (`warpchain.model.trains.is_free_body`).

    Attributes:
        driver: motion of the drive's driver at the start.
        start_ratio: forward speed at the start over the driver's [-].
    """

    driver: Prescribed
    start_ratio: float


class SprocketShaft(Shaft):
    """Sprocket of another chain, as a shaft of its home chain.

    Attributes:
        shaft: that it turns with.
        demand: its load with those that its chain turns.
        driven_inertia: inertia of its chain and what that turns [kg m^2].
    """

    shaft: Name | None = None
    demand: Load | None = None
    driven_inertia: NonNegative = 0.0
