"""Rules that tie the parts of a drive together, and what this version cannot simulate yet.

Each rule yields its problems. It takes the drive, or the mapping that should become one if a value somewhere is wrong:
what a rule needs and does not find whole, it leaves to the error of that value.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

from warpchain.drive.arms import Arm
from warpchain.drive.chain import Chain, NamedChain
from warpchain.drive.contact_settings import MATERIALS, GuideContact, ImpactLaw, SprocketContact, contact_rules, merged
from warpchain.drive.guides import guide_profile
from warpchain.drive.parts_by_chain import chain_of_part
from warpchain.drive.schema import BARE, Problem, elements, get, is_name, nearest, numbers, too_far, valid
from warpchain.drive.shafts import FIXED
from warpchain.drive.sprocket import SliderMount, Sprocket
from warpchain.drive.stiffness import largest_load
from warpchain.drive.tensioners import Tensioner
from warpchain.drive.tooth_shape import iso606_tooth


def sprocket_rules(drive: Any) -> Iterator[Problem]:
    sprockets = elements(drive, "sprockets")
    if get(drive, "sprockets") is not None and len(sprockets) < 2:
        yield Problem(("sprockets",), get(drive, "sprockets"), "must be a list of at least 2 sprockets")
    shafts = elements(drive, "shafts")
    moved = any(get(of, key) not in (None, 0.0) for of in shafts for key in ("prescribed", "motor", "initial_speed"))
    if sprockets and not moved and all(get(sprocket, "prescribed") is None for sprocket in sprockets):
        text = "at least one sprocket must be" + (", or a shaft, or have a motor or an initial_speed" if shafts else "")
        yield Problem(("sprockets",), None, f"none is prescribed; {text}", BARE)


def shaft_rules(drive: Any) -> Iterator[Problem]:
    """Shafts that tables and harmonics refer to must be sprockets, or shafts."""
    names = [get(part, "name") for kind in TURNED for part in elements(drive, kind)]
    what = "a sprocket or a shaft" if elements(drive, "shafts") else "a sprocket"
    turned = [(of, s, part) for of in TURNED for s, part in enumerate(elements(drive, of))]
    for of, s, turning in turned:
        for kind in ("prescribed", "load", "motor"):
            motion = get(turning, kind)
            parts: list[tuple[tuple[str | int, ...], Any]] = [(("table",), get(motion, "table"))]
            parts += [(("harmonics", h), harmonic) for h, harmonic in enumerate(elements(motion, "harmonics"))]
            for keys, part in parts:
                shaft = get(part, "shaft")
                if isinstance(shaft, str) and shaft not in names:
                    text = f"must be the name of {what}; {nearest(shaft, filter(is_name, names))}"
                    yield Problem((of, s, kind, *keys, "shaft"), shaft, text)


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
    """A roller that rolls on a guide-bar passes on the friction of its bush, which the chain must have."""
    text = "must be false without chain.joint, whose friction rolling rollers pass on"
    chains = [chain for chain, _ in _chains(drive) if chain.joint is None]
    places: list[tuple[tuple[str | int, ...], Any]] = []
    if chains:
        places.append((("contact", "guide"), get(get(drive, "contact"), "guide")))
    for i, guide in enumerate(elements(drive, "guides")):
        if chain_of_part(drive, guide) in chains:
            places.append((("guides", i, "contact"), get(guide, "contact")))
    for keys, contact in places:
        if get(contact, "rolling") is True:
            yield Problem((*keys, "rolling"), True, text)


def size_rules(drive: Any) -> Iterator[Problem]:
    """Rules that hold the contacts against the chain's size."""
    seen = set()
    for chain, guides in _chains(drive):
        for problem in _sizes(drive, chain, guides):
            if problem.path not in seen:
                seen.add(problem.path)
                yield problem


def _chains(drive: Any) -> Iterator[tuple[Chain, list[tuple[int, Any]]]]:
    """The chains that are sound, each with its guides and their places."""
    guides = list(enumerate(elements(drive, "guides")))
    chains = elements(drive, "chains")
    if not chains and (chain := valid(Chain, get(drive, "chain"))) is not None:
        yield chain, guides
    for node in chains:
        if (named := valid(NamedChain, node)) is not None:
            yield named, [(g, guide) for g, guide in guides if get(guide, "chain") == named.name]


def _sizes(drive: Any, chain: Chain, guides: Sequence[tuple[int, Any]]) -> Iterator[Problem]:
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
    for i, bar in guides:
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


TURNED = ("sprockets", "shafts")
NAMED = ("chains", *TURNED, "guides", "arms", "tensioners", "gears", "couplings", "valves", "probes")
PLACES = {
    "sprockets": ("center",),
    "guides": ("start", "end"),
    "arms": ("pivot", "center"),
    "tensioners": ("at",),
    "probes": ("at",),
}
LEAST_LEVER = 1e-3
"""Share of a tensioner's distance from what it moves that must be lever, or of its direction that must be along."""


def name_rules(drive: Any) -> Iterator[Problem]:
    """No two parts share a name."""
    seen: set[str] = set()
    for kind in NAMED:
        for i, part in enumerate(elements(drive, kind)):
            name = get(part, "name")
            if isinstance(name, str) and name in seen:
                yield Problem((kind, i, "name"), name, "must be unique among the names of all parts")
            elif name == FIXED and kind in TURNED:
                yield Problem((kind, i, "name"), name, "must be another name: couplings take it for what does not turn")
            elif isinstance(name, str):
                seen.add(name)


def place_rules(drive: Any) -> Iterator[Problem]:
    """No part stands beyond all reason."""
    for kind, keys in PLACES.items():
        for i, part in enumerate(elements(drive, kind)):
            for key in keys:
                for problem in too_far((key,), get(part, key)):
                    yield problem.under(kind, i)


MOST_PARTS = 256
"""Most parts of a kind: time and memory grow with them."""
MOST_PIECES = 1000
"""Most arcs and straight pieces of all faces together, rounded ends too: every roller is held against each."""
LONGEST_FACE = 20_000
"""Longest face, rounded ends too, in pitches: it is followed pitch by pitch."""


def count_rules(drive: Any) -> Iterator[Problem]:
    """No kind of part is there beyond all reason."""
    for kind in NAMED:
        count = len(elements(drive, kind))
        if count > MOST_PARTS:
            yield Problem((kind,), None, f"has {count} elements; must have at most {MOST_PARTS}", BARE)


def face_rules(drive: Any) -> Iterator[Problem]:
    """No face is longer, and no faces have more pieces, than can be worked through."""
    guides, count = elements(drive, "guides"), 0
    if len(guides) > MOST_PARTS:
        return
    for g, guide in enumerate(guides):
        chain = chain_of_part(drive, guide)
        profile = None if chain is None else guide_profile(guide, chain.pitch)
        if chain is None or profile is None:
            continue
        longest = LONGEST_FACE * chain.pitch
        count += len(profile.pieces)
        length = sum(piece.length for piece in profile.pieces)
        if length > longest:
            text = f"its face is {length:.4g} m long; must be at most {longest:.4g} m, {LONGEST_FACE} pitches"
            yield Problem(("guides", g), None, text, BARE)
        if count > MOST_PIECES:
            text = f"its face has {len(profile.pieces)} pieces; all faces together must have at most {MOST_PIECES}"
            yield Problem(("guides", g), None, text, BARE)
            return


def profile_rules(drive: Any) -> Iterator[Problem]:
    """No face bends within a pitch: links cannot follow it."""
    for g, guide in enumerate(elements(drive, "guides")):
        chain = chain_of_part(drive, guide)
        if chain is None:
            continue
        pitch, offset = chain.pitch, get(guide, "offset")
        if numbers(offset) and offset > pitch:
            yield Problem(("guides", g, "offset"), offset, f"must be at most a pitch, {pitch:g}")
        yield from (problem.under("guides", g) for problem in _tight(guide, pitch))


def tooth_rules(drive: Any) -> Iterator[Problem]:
    """Rollers go into the gaps of sprockets that have their own, and teeth reach beyond the pitch circle."""
    for s, sprocket in enumerate(elements(drive, "sprockets")):
        chain, tooth, teeth = chain_of_part(drive, sprocket), get(sprocket, "tooth"), get(sprocket, "teeth")
        seat, tip = get(tooth, "seat_radius"), get(tooth, "tip_radius")
        if chain is None or not numbers(seat, tip, teeth) or teeth < 2:
            continue
        if seat < chain.roller_radius:
            text = f"must be at least the radius of the rollers, {chain.roller_radius:g}"
            yield Problem(("sprockets", s, "tooth", "seat_radius"), seat, text)
        own = get(sprocket, "pitch")
        radius = (chain.pitch if not numbers(own) else own) / (2.0 * math.sin(math.pi / teeth))
        if tip <= radius:
            yield Problem(
                ("sprockets", s, "tooth", "tip_radius"), tip, f"must be beyond the pitch circle, {radius:.6g}"
            )


def _tight(guide: Any, pitch: float) -> Iterator[Problem]:
    text = f"must be at least a pitch, {pitch:g}; links cannot follow a tighter face"
    radius = get(guide, "radius")
    if numbers(radius) and 0.0 < radius < pitch:
        yield Problem(("radius",), radius, text)
    for k, arc in enumerate(elements(guide, "arcs")):
        radius = get(arc, "radius")
        if numbers(radius) and 0.0 < radius < pitch:
            yield Problem(("arcs", k, "radius"), radius, text)
    profile = guide_profile(guide, pitch) if get(guide, "profile") is not None else None
    if profile is not None:
        worst = max(profile.face, key=lambda piece: abs(piece.curvature))
        if abs(worst.curvature) * pitch > 1.0:
            (x, y), radius = worst.at(0.5 * worst.length)[0], 1.0 / abs(worst.curvature)
            bends = f"bends with a radius of {radius:.3g} m at [{x:.4g}, {y:.4g}]"
            yield Problem(("profile",), None, f"{bends}; {text}", BARE)


def arm_rules(drive: Any) -> Iterator[Problem]:
    """Guides, sprockets and arms hang on arms that there are, arms at most one on another."""
    names = [get(arm, "name") for arm in elements(drive, "arms")]
    places: list[tuple[tuple[str | int, ...], Any]] = [
        (("guides", g), guide) for g, guide in enumerate(elements(drive, "guides"))
    ]
    places += [(("sprockets", s, "mount"), get(part, "mount")) for s, part in enumerate(elements(drive, "sprockets"))]
    places += [(("arms", a), part) for a, part in enumerate(elements(drive, "arms"))]
    for keys, part in places:
        arm = get(part, "arm")
        if isinstance(arm, str) and arm in names and keys[0] == "arms":
            yield from (problem.under(*keys) for problem in _hangs(part, elements(drive, "arms")[names.index(arm)]))
        if isinstance(arm, str) and arm not in names:
            hint = nearest(arm, filter(is_name, names)) if names else "there are none"
            yield Problem((*keys, "arm"), arm, f"must be the name of an arm; {hint}")


def _hangs(arm: Any, carrier: Any) -> Iterator[Problem]:
    """An arm hangs on one that stands on the ground."""
    name, on = get(arm, "name"), get(carrier, "arm")
    if get(carrier, "name") == name or on == name:
        yield Problem(("arm",), get(arm, "arm"), "hangs on itself; one of the arms must stand on the ground")
    elif on is not None:
        text = f'hangs on "{on}" itself; at most two arms may stand in a row'
        yield Problem(("arm",), get(arm, "arm"), text)
    if get(arm, "pivot_table") is not None:
        yield Problem(("pivot_table",), None, "not together with arm, which leads the pivot", BARE)


def pivot_rules(drive: Any) -> Iterator[Problem]:
    """A sprocket on an arm is apart from its pivot."""
    pivots = {get(arm, "name"): elements(arm, "pivot") for arm in elements(drive, "arms") if is_name(get(arm, "name"))}
    for s, sprocket in enumerate(elements(drive, "sprockets")):
        name, center = get(get(sprocket, "mount"), "arm"), list(elements(sprocket, "center"))
        if isinstance(name, str) and center and center == list(pivots.get(name, ())):
            yield Problem(("sprockets", s, "center"), center, f'must not be the pivot of "{name}", which carries it')


def tensioner_rules(drive: Any) -> Iterator[Problem]:
    """Tensioners push what can give way, and towards the chain."""
    if not elements(drive, "tensioners"):
        return
    arms, sprockets = (_by_name(elements(drive, kind)) for kind in ("arms", "sprockets"))
    for t, node in enumerate(elements(drive, "tensioners")):
        on = get(node, "on")
        if not isinstance(on, str):
            continue
        found: Iterator[Problem] = iter(())
        if on in arms:
            found = _pushes_arm(drive, node, elements(drive, "arms")[arms[on]])
        elif on in sprockets:
            found = _pushes_sprocket(drive, node, sprockets[on])
        else:
            known = [name for name in (*arms, *_on_sliders(drive)) if is_name(name)]
            hint = nearest(on, known) if known else "there are none"
            found = iter([Problem(("on",), on, f"must be the name of an arm, or of a sprocket on a slider; {hint}")])
        yield from (problem.under("tensioners", t) for problem in found)


def pump_rules(drive: Any) -> Iterator[Problem]:
    """A sprocket or shaft that turns a pump must be there, of several chains on that of the tensioner."""
    several = bool(elements(drive, "chains"))
    what = "a sprocket of its chain" if several else "a sprocket or a shaft"
    for t, node in enumerate(elements(drive, "tensioners")):
        shaft = get(get(get(node, "oil"), "supply_table"), "shaft")
        if not isinstance(shaft, str):
            continue
        parts = [part for kind in TURNED for part in elements(drive, kind)]
        if several:
            of_chains = (part for kind in ("sprockets", "guides") for part in elements(drive, kind))
            own = {get(part, "chain") for part in of_chains if _moves_with(part, get(node, "on"))}
            parts = [part for part in elements(drive, "sprockets") if get(part, "chain") in own]
        names = [name for part in parts if is_name(name := get(part, "name"))]
        if shaft not in names:
            path = ("tensioners", t, "oil", "supply_table", "shaft")
            yield Problem(path, shaft, f"must be the name of {what}; {nearest(shaft, names)}")


def _moves_with(part: Any, on: Any) -> bool:
    """Whether a guide or a sprocket is the body of this name, or on it."""
    return on in (get(part, "name"), get(part, "arm"), get(get(part, "mount"), "arm"))


def _by_name(parts: Sequence[Any]) -> dict[str, int]:
    """Indices of parts by their names, where those are text."""
    return {name: i for i, part in enumerate(parts) if isinstance(name := get(part, "name"), str)}


def _on_sliders(drive: Any) -> list[Any]:
    sprockets = elements(drive, "sprockets")
    return [get(part, "name") for part in sprockets if get(get(part, "mount"), "kind") == "slider"]


def _pushes_arm(drive: Any, node: Any, arm_node: Any) -> Iterator[Problem]:
    """The tensioner's moment must turn the arm's faces towards the chain.

    A turn by dtheta moves a face towards the chain by (r - p).t dtheta, in the mean over its length in proportion to
    |end - p|^2 - |start - p|^2.
    """
    arm, tensioner = valid(Arm, arm_node), valid(Tensioner, node)
    if arm is None or tensioner is None:
        return
    if arm.arm is not None:
        yield Problem(("on",), arm.name, f'must not hang on another arm, as it does on "{arm.arm}"')
        return
    if arm.pivot_table is not None and tensioner.plunger_mass > 0.0:
        text = f'must be 0 on "{arm.name}", whose pivot is led; its mass would not go along'
        yield Problem(("plunger", "mass"), tensioner.plunger_mass, text)
    (x, y), (px, py) = tensioner.unit_direction, arm.pivot
    dx, dy = tensioner.at[0] - px, tensioner.at[1] - py
    lever = dx * y - dy * x
    if abs(lever) <= LEAST_LEVER * math.hypot(dx, dy):
        text = f'points through the pivot of "{arm.name}" and cannot turn it'
        yield Problem(("direction",), list(tensioner.direction), f"{text}; must point past it")
        return
    nodes = [guide for guide in elements(drive, "guides") if get(guide, "arm") == arm.name]
    carried = [part for part in elements(drive, "sprockets") if get(get(part, "mount"), "arm") == arm.name]
    chain = next((chain_of_part(drive, part) for part in (*nodes, *carried)), None)
    if chain is None:
        return
    profiles = [profile for guide in nodes if (profile := guide_profile(guide, chain.pitch)) is not None]
    ends = [(math.dist(p.face[-1].end, arm.pivot), math.dist(p.face[0].start, arm.pivot)) for p in profiles]
    sense = sum(end * end - start * start for end, start in ends)
    if sense * lever < 0.0 and abs(sense) > LEAST_LEVER * sum(end * end + start * start for end, start in ends):
        names = " and ".join(f'"{get(guide, "name")}"' for guide in nodes)
        sides = {"right" if get(guide, "side") == "right" else "left" for guide in nodes}
        rides = f"which rides on the {' and '.join(sorted(sides))} of {names} from start to end"
        text = f'turns "{arm.name}" away from the chain, {rides}; must push towards it'
        yield Problem(("direction",), list(tensioner.direction), text)
    yield from _turns_sprockets(drive, tensioner, arm, lever, chain.pitch)


def _turns_sprockets(drive: Any, tensioner: Tensioner, arm: Arm, lever: float, pitch: float) -> Iterator[Problem]:
    """The tensioner must turn the sprockets on its arm against the pull of their strands."""
    parts = elements(drive, "sprockets")
    mine = next((get(part, "chain") for part in parts if get(get(part, "mount"), "arm") == arm.name), None)
    sprockets = [valid(Sprocket, part) for part in parts if get(part, "chain") == mine]
    whole = [sprocket for sprocket in sprockets if sprocket is not None]
    if len(whole) < 2 or len(whole) < len(sprockets):
        return
    for s, own in enumerate(whole):
        pull = _pull(whole, s, pitch) if get(own.mount, "arm") == arm.name else None
        if pull is not None:
            dx, dy = own.center[0] - arm.pivot[0], own.center[1] - arm.pivot[1]
            turned = dx * pull[1] - dy * pull[0]
            if turned * lever > 0.0 and abs(turned) > 0.1 * math.hypot(dx, dy):
                text = f'turns "{own.name}" the way its strands pull it, ({pull[0]:.2f}, {pull[1]:.2f})'
                yield Problem(("direction",), list(tensioner.direction), f"{text}; must push against them")


def _pushes_sprocket(drive: Any, node: Any, s: int) -> Iterator[Problem]:
    """The tensioner must push along the slider, against the pull of the sprocket's two strands."""
    kind = get(get(elements(drive, "sprockets")[s], "mount"), "kind") or "fixed"
    if kind != "slider":
        name = get(node, "on")
        text = f'must be the name of an arm, or of a sprocket on a slider; the mount of "{name}" is of kind "{kind}"'
        yield Problem(("on",), name, text)
        return
    place, parts = s, elements(drive, "sprockets")
    along_chain = [k for k, part in enumerate(parts) if get(part, "chain") == get(parts[s], "chain")]
    s, sprockets = along_chain.index(place), [valid(Sprocket, parts[k]) for k in along_chain]
    tensioner, chain = valid(Tensioner, node), chain_of_part(drive, parts[place])
    own = sprockets[s]
    if own is None or tensioner is None or not isinstance(own.mount, SliderMount):
        return
    (x, y), length = own.mount.direction, math.hypot(*own.mount.direction)
    along = (tensioner.unit_direction[0] * x + tensioner.unit_direction[1] * y) / length
    if abs(along) <= LEAST_LEVER:
        text = f'pushes across the slider of "{own.name}", whose direction is {list(own.mount.direction)}'
        yield Problem(("direction",), list(tensioner.direction), f"{text}; must have a part along it")
        return
    if chain is None or len(sprockets) < 2 or any(sprocket is None for sprocket in sprockets):
        return
    pull = _pull([sprocket for sprocket in sprockets if sprocket is not None], s, chain.pitch)
    if pull is not None and along * (pull[0] * x + pull[1] * y) / length > 0.1:
        text = (
            f'pushes "{own.name}" the way its strands pull it, ({pull[0]:.2f}, {pull[1]:.2f}); must push against them'
        )
        yield Problem(("direction",), list(tensioner.direction), text)


def _pull(sprockets: list[Sprocket], s: int, pitch: float) -> tuple[float, float] | None:
    """Sum of the unit vectors along which the two strands of sprocket s pull it; None where no strands can run."""
    before, own, after = sprockets[s - 1], sprockets[s], sprockets[(s + 1) % len(sprockets)]
    away, home = _heading(own, after, pitch), _heading(before, own, pitch)
    if away is None or home is None:
        return None
    return math.cos(away) - math.cos(home), math.sin(away) - math.sin(home)


def _heading(one: Sprocket, other: Sprocket, pitch: float) -> float | None:
    """Heading [rad] of the straight strand from a sprocket to another.

    It passes the centers at their radius, on the right of those that the chain turns about counter-clockwise:
    (c_2 - c_1).n = s_2 R_2 - s_1 R_1, n the strand's left normal.
    """
    dx, dy = other.center[0] - one.center[0], other.center[1] - one.center[1]
    first, second = (part.sign * pitch / (2.0 * math.sin(math.pi / part.teeth)) for part in (one, other))
    distance = math.hypot(dx, dy)
    if abs(second - first) >= distance:
        return None
    return math.atan2(dy, dx) - math.asin((second - first) / distance)
