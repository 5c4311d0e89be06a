"""Probes: places in space at which the passing chain is looked at, as by a sensor there."""

from __future__ import annotations

from warpchain.drive.part import Name, Pair, Part, Positive


class Probe(Part):
    """A place at which the chain that passes is looked at (`results.passing`); it changes nothing of the motion.

    Attributes:
        name: unique among all parts.
        at: place [m].
        radius: how near the chain must come to be seen [m]; None is a pitch.
    """

    name: Name
    at: Pair
    radius: Positive | None = None
