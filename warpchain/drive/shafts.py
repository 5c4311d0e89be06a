"""Shafts: what sprockets turn with."""

from __future__ import annotations

from warpchain.drive.schema import Name, Part


class Shaft(Part):
    """A shaft: sprockets of several chains that turn as one, about one center.

    Attributes:
        name: unique among all parts.
    """

    name: Name
