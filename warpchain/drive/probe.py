"""Probes: places in space at which the passing chain is looked at, as by a sensor there."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from warpchain.drive.part import Name, Pair, Part, Positive, Problem, elements, get


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


def probe_rules(drive: Any, farthest: float) -> Iterator[Problem]:
    """Names of probes must be their own, and their places within `farthest` of the origin [m]."""
    kinds = ("sprockets", "guides", "arms", "tensioners")
    seen = {get(part, "name") for kind in kinds for part in elements(drive, kind)}
    for i, probe in enumerate(elements(drive, "probes")):
        name, at = get(probe, "name"), get(probe, "at")
        if isinstance(name, str) and name in seen:
            yield Problem(("probes", i, "name"), name, "must be unique among all parts")
        seen.add(name if isinstance(name, str) else None)
        along = [x for x in at if isinstance(x, (int, float))] if isinstance(at, (list, tuple)) else []
        if any(abs(x) > farthest for x in along):
            yield Problem(("probes", i, "at"), list(at), f"must be within {farthest:g} m of the origin")
