"""Rules that tie the parts of a drive together, and what this version cannot simulate yet.

Each rule yields its problems. It takes the drive, or the mapping that should become one if a value somewhere is wrong:
what a rule needs and does not find whole, it leaves to the error of that value.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from warpchain.drive.contact import MATERIALS, GuideContact, ImpactLaw, SprocketContact, contact_rules, merged
from warpchain.drive.part import BARE, Problem, elements, get, is_name, nearest, valid
from warpchain.drive.parts import Chain
from warpchain.drive.stiffness import largest_load
from warpchain.drive.teeth import iso606_tooth


def sprocket_rules(drive: Any) -> Iterator[Problem]:
    sprockets = elements(drive, "sprockets")
    if get(drive, "sprockets") is not None and len(sprockets) < 2:
        yield Problem(("sprockets",), get(drive, "sprockets"), "must be a list of at least 2 sprockets")
    if sprockets and all(get(sprocket, "prescribed") is None for sprocket in sprockets):
        yield Problem(("sprockets",), None, "none is prescribed; at least one sprocket must be", BARE)


def shaft_rules(drive: Any) -> Iterator[Problem]:
    """Shafts that tables and harmonics refer to must be sprockets."""
    sprockets = elements(drive, "sprockets")
    names = [get(sprocket, "name") for sprocket in sprockets]
    for s, sprocket in enumerate(sprockets):
        for kind in ("prescribed", "load"):
            motion = get(sprocket, kind)
            parts: list[tuple[tuple[str | int, ...], Any]] = [(("table",), get(motion, "table"))]
            parts += [(("harmonics", h), harmonic) for h, harmonic in enumerate(elements(motion, "harmonics"))]
            for keys, part in parts:
                shaft = get(part, "shaft")
                if isinstance(shaft, str) and shaft not in names:
                    text = f"must be the name of a sprocket; {nearest(shaft, filter(is_name, names))}"
                    yield Problem(("sprockets", s, kind, *keys, "shaft"), shaft, text)


def guide_rules(drive: Any) -> Iterator[Problem]:
    guides = elements(drive, "guides")
    common = get(get(drive, "contact"), "guide")
    if guides and common is None and get(drive, "contact") is not None:
        yield Problem(("contact", "guide"), None, "missing; must be a table; needed where there are guides", BARE)
    for i, guide in enumerate(guides):
        own = get(guide, "contact")
        if own is not None and common is not None:
            before = list(contact_rules(common))
            for problem in contact_rules(merged(common, own)):
                if problem not in before:
                    yield problem.under("guides", i, "contact")


def rolling_rules(drive: Any) -> Iterator[Problem]:
    """What rolls on a guide-bar passes on the friction of its bush, which the chain must have."""
    chain = valid(Chain, get(drive, "chain"))
    if chain is None or chain.joint is not None:
        return
    text = "must be false without chain.joint, whose friction rolling rollers pass on"
    places: list[tuple[tuple[str | int, ...], Any]] = [(("contact", "guide"), get(get(drive, "contact"), "guide"))]
    places += [(("guides", i, "contact"), get(guide, "contact")) for i, guide in enumerate(elements(drive, "guides"))]
    for keys, contact in places:
        if get(contact, "rolling") is True:
            yield Problem((*keys, "rolling"), True, text)


def size_rules(drive: Any) -> Iterator[Problem]:
    """Rules that hold the contacts against the chain's size."""
    chain = valid(Chain, get(drive, "chain"))
    if chain is None:
        return
    contact, radius = get(drive, "contact"), chain.roller_radius
    sprocket = valid(SprocketContact, get(contact, "sprocket"))
    if sprocket is not None and sprocket.clearance is not None:
        room = chain.pitch / 2 - radius
        if sprocket.clearance >= room:
            text = f"must be below half the pitch less the roller radius, {room:g}"
            yield Problem(("contact", "sprocket", "clearance"), sprocket.clearance, text)
        yield from _load_rule(sprocket, radius, radius + sprocket.clearance, "contact", "sprocket")
    elif sprocket is not None:
        assert sprocket.gap is not None  # the contact's own rule
        seat = iso606_tooth(sprocket.gap, radius, 9, chain.pitch).seat_radius  # the same for any number of teeth
        yield from _load_rule(sprocket, radius, seat, "contact", "sprocket")
    guide = valid(GuideContact, get(contact, "guide"))
    if guide is None:
        return
    yield from _load_rule(guide, radius, math.inf, "contact", "guide")
    for i, bar in enumerate(elements(drive, "guides")):
        own = get(bar, "contact")
        if all(get(own, key) is None for key in MATERIALS):
            continue
        law = valid(GuideContact, merged(guide, own))
        if law is not None:
            yield from _load_rule(law, radius, math.inf, "guides", i, "contact")


def _load_rule(law: ImpactLaw, radius: float, partner_radius: float, *keys: str | int) -> Iterator[Problem]:
    if law.stiffness is None:
        limit = largest_load(law, radius, partner_radius)
        if law.reference_load is not None and law.reference_load >= limit:
            text = f"must be below {limit:g} N, beyond which the stiffness formula does not hold for these materials"
            yield Problem((*keys, "reference_load"), law.reference_load, text)
