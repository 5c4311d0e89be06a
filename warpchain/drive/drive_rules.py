"""Rules between the parts of a drive, or of a mapping for one; wrong values are passed over."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

from warpchain.drive.arms import Arm
from warpchain.drive.chain import Chain, NamedChain
from warpchain.drive.contact_settings import (
    MATERIALS,
    GuideContact,
    ImpactLaw,
    SprocketContact,
    contact_rules,
    merged_contact_values,
)
from warpchain.drive.guides import guide_profile
from warpchain.drive.parts_by_chain import Path, chain_nodes, chain_of_part
from warpchain.drive.plate import LEAST_TEETH, ROOT_DEPTH, gap_angle, toe_clearance
from warpchain.drive.schema import (
    BARE,
    Problem,
    allowed_text,
    are_numbers,
    is_name,
    nearest_key_text,
    node_list,
    node_value,
    place_rule,
    valid_part,
)
from warpchain.drive.shafts import FIXED
from warpchain.drive.sprocket import END_TEETH, SliderMount, Sprocket
from warpchain.drive.stiffness import largest_load
from warpchain.drive.tensioners import Tensioner
from warpchain.drive.tooth_shape import iso606_tooth


def sprocket_rules(drive: Any) -> Iterator[Problem]:
    """Problems of too few sprockets, ends, teeth, and undriven drives."""
    sprockets = node_list(drive, "sprockets")
    yield from _end_rules(drive, sprockets)
    if node_value(drive, "sprockets") is not None and len(sprockets) < 2:
        yield Problem(("sprockets",), node_value(drive, "sprockets"), "must be a list of at least 2 sprockets")
    shafts = node_list(drive, "shafts")
    moved = any(
        node_value(of, key) not in (None, 0.0) for of in shafts for key in ("prescribed", "motor", "initial_speed")
    )
    if sprockets and not moved and all(node_value(sprocket, "prescribed") is None for sprocket in sprockets):
        text = "at least one sprocket must be" + (", or a shaft, or have a motor or an initial_speed" if shafts else "")
        yield Problem(("sprockets",), None, f"none is prescribed; {text}", BARE)


ON_TEETH = "teeth", "pitch", "tooth", "balance_wheel"
"""Keys of sprockets that ends have not."""
ON_RIMS = "key", "bearing", "load", "shaft"
"""Keys of ends on rims only."""


def _chains_with_sprockets(drive: Any) -> Iterator[tuple[Path, Any, list[Any]]]:
    """Path and value of each chain, and its sprockets' names."""
    sprockets = node_list(drive, "sprockets")
    for path, chain in chain_nodes(drive):
        around = [of for of in sprockets if path == ("chain",) or node_value(of, "chain") == node_value(chain, "name")]
        yield path, chain, [node_value(of, "name") for of in around]


def _end_rules(drive: Any, sprockets: Sequence[Any]) -> Iterator[Problem]:
    """Problems of open chains' ends, and of other sprockets without teeth."""
    ends: set[Any] = set()
    for path, chain, names in _chains_with_sprockets(drive):
        named = node_list(chain, "ends")
        ends.update(name for name in named if isinstance(name, str))
        if len(named) == 2 and (names[:1], names[-1:]) != ([named[0]], [named[1]]):
            text = "must be the names of the first and the last of the chain's sprockets, in the order of its travel"
            yield Problem((*path, "ends"), list(named), text)
    for s, sprocket in enumerate(sprockets):
        name = node_value(sprocket, "name")
        if not isinstance(name, str) or name not in ends:
            if node_value(sprocket, "teeth") is None or (isinstance(sprocket, Sprocket) and sprocket.is_end):
                yield Problem(("sprockets", s, "teeth"), None, f"missing; {allowed_text(Sprocket, 'teeth')}", BARE)
            if node_value(sprocket, "rim") is not None:
                yield Problem(("sprockets", s, "rim"), None, "only of an end of an open chain", BARE)
            continue
        on_rim = node_value(sprocket, "rim") is not None
        if on_rim and node_value(node_value(sprocket, "mount"), "kind") not in (None, "fixed"):
            yield Problem(("sprockets", s, "mount"), None, "must be fixed with rim", BARE)
        for key in ON_TEETH if on_rim else ON_TEETH + ON_RIMS:
            value = node_value(sprocket, key)
            if value is not None and not (key == "teeth" and value == END_TEETH):
                yield Problem(
                    ("sprockets", s, key),
                    value if are_numbers(value) else None,
                    "not of an end of a chain, which has no teeth" + (" and no rim" if key in ON_RIMS else ""),
                )


def load_rules(drive: Any) -> Iterator[Problem]:
    """Problems of goods between sprockets that are no neighbors."""
    for path, chain, names in _chains_with_sprockets(drive):
        between = node_list(node_value(chain, "load"), "between")
        pairs = list(zip(names, names[1:] + ([] if node_list(chain, "ends") else names[:1]), strict=False))
        if len(between) == 2 and tuple(between) not in pairs:
            known = ", ".join(f"[{one}, {other}]" for one, other in pairs)
            text = f"must be two sprockets of the chain, one after the other: one of {known}"
            yield Problem((*path, "load", "between"), list(between), text)


def shaft_rules(drive: Any) -> Iterator[Problem]:
    """Problems of references to unknown sprockets or shafts."""
    names = [node_value(part, "name") for kind in TURNED for part in node_list(drive, kind)]
    what = "a sprocket or a shaft" if node_list(drive, "shafts") else "a sprocket"
    turned = [(of, s, part) for of in TURNED for s, part in enumerate(node_list(drive, of))]
    for of, s, turning in turned:
        for kind in ("prescribed", "load", "motor"):
            motion = node_value(turning, kind)
            parts: list[tuple[tuple[str | int, ...], Any]] = [(("table",), node_value(motion, "table"))]
            parts += [(("harmonics", h), harmonic) for h, harmonic in enumerate(node_list(motion, "harmonics"))]
            for keys, part in parts:
                shaft = node_value(part, "shaft")
                if isinstance(shaft, str) and shaft not in names:
                    text = f"must be the name of {what}; {nearest_key_text(shaft, filter(is_name, names))}"
                    yield Problem((of, s, kind, *keys, "shaft"), shaft, text)


def guide_rules(drive: Any) -> Iterator[Problem]:
    """Problems of guides' contacts, own or missing."""
    guides = node_list(drive, "guides")
    common = node_value(node_value(drive, "contact"), "guide")
    if guides and common is None and node_value(drive, "contact") is not None:
        yield Problem(("contact", "guide"), None, "missing; must be a table; needed where there are guides", BARE)
    for i, guide in enumerate(guides):
        own = node_value(guide, "contact")
        if own is not None and common is not None:
            before = list(contact_rules(common))
            for problem in contact_rules(merged_contact_values(common, own)):
                if problem not in before:
                    yield problem.nested_under("guides", i, "contact")


def rolling_rules(drive: Any) -> Iterator[Problem]:
    """Problems of rolling on guides without bush friction."""
    text = "must be false without chain.joint, whose friction rolling rollers pass on"
    chains = [chain for chain, _ in _sound_chains(drive) if chain.joint is None]
    places: list[tuple[tuple[str | int, ...], Any]] = []
    if chains:
        places.append((("contact", "guide"), node_value(node_value(drive, "contact"), "guide")))
    for i, guide in enumerate(node_list(drive, "guides")):
        if chain_of_part(drive, guide) in chains:
            places.append((("guides", i, "contact"), node_value(guide, "contact")))
    for keys, contact in places:
        if node_value(contact, "rolling") is True:
            yield Problem((*keys, "rolling"), True, text)


def size_rules(drive: Any) -> Iterator[Problem]:
    """Problems of contacts that do not fit the chain's size."""
    seen = set()
    for chain, guides in _sound_chains(drive):
        for problem in _chain_size_rules(drive, chain, guides):
            if problem.path not in seen:
                seen.add(problem.path)
                yield problem


def _sound_chains(drive: Any) -> Iterator[tuple[Chain, list[tuple[int, Any]]]]:
    """Sound chains, each with its guides and their indices."""
    guides = list(enumerate(node_list(drive, "guides")))
    chains = node_list(drive, "chains")
    if not chains and (chain := valid_part(Chain, node_value(drive, "chain"))) is not None:
        yield chain, guides
    for node in chains:
        if (named := valid_part(NamedChain, node)) is not None:
            yield named, [(g, guide) for g, guide in guides if node_value(guide, "chain") == named.name]


def _chain_size_rules(drive: Any, chain: Chain, guides: Sequence[tuple[int, Any]]) -> Iterator[Problem]:
    """Problems of contacts that do not fit one chain's size."""
    contact, radius = node_value(drive, "contact"), chain.roller_radius
    sprocket = valid_part(SprocketContact, node_value(contact, "sprocket"))
    if sprocket is not None and sprocket.clearance is not None:
        room = chain.pitch / 2 - radius
        if sprocket.clearance >= room and not chain.is_silent:
            text = f"must be below half the pitch less the roller radius, {room:g}"
            yield Problem(("contact", "sprocket", "clearance"), sprocket.clearance, text)
        yield from _reference_load_rule(sprocket, radius, radius + sprocket.clearance, "contact", "sprocket")
    elif sprocket is not None:
        assert sprocket.gap is not None  # the contact's own rule
        seat = iso606_tooth(sprocket.gap, radius, 9, chain.pitch).seat_radius  # the same for any number of teeth
        yield from _reference_load_rule(sprocket, radius, seat, "contact", "sprocket")
    guide = valid_part(GuideContact, node_value(contact, "guide"))
    if guide is None:
        return
    yield from _reference_load_rule(guide, radius, math.inf, "contact", "guide")
    for i, bar in guides:
        own = node_value(bar, "contact")
        if all(node_value(own, key) is None for key in MATERIALS):
            continue
        law = valid_part(GuideContact, merged_contact_values(guide, own))
        if law is not None:
            yield from _reference_load_rule(law, radius, math.inf, "guides", i, "contact")


def _reference_load_rule(law: ImpactLaw, radius: float, partner_radius: float, *keys: str | int) -> Iterator[Problem]:
    """Problem of a contact's reference load too large for eq. (20)."""
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
CLEARANCE_SLACK = 1e-9
"""Overlap of toes and teeth by round-off, in pitches."""
LEAST_ALONG = 0.3
"""Least cosine between guide and strand [-]."""
LEAST_LEVER = 1e-3
"""Least share of a tensioner's lever or direction [-]."""


def name_rules(drive: Any) -> Iterator[Problem]:
    """Problems of parts that share a name."""
    seen: set[str] = set()
    for kind in NAMED:
        for i, part in enumerate(node_list(drive, kind)):
            name = node_value(part, "name")
            if isinstance(name, str) and name in seen:
                yield Problem((kind, i, "name"), name, "must be unique among the names of all parts")
            elif name == FIXED and kind in TURNED:
                yield Problem((kind, i, "name"), name, "must be another name: couplings take it for what does not turn")
            elif isinstance(name, str):
                seen.add(name)


def place_rules(drive: Any) -> Iterator[Problem]:
    """Problems of parts that are too far away."""
    for kind, keys in PLACES.items():
        for i, part in enumerate(node_list(drive, kind)):
            for key in keys:
                for problem in place_rule((key,), node_value(part, key)):
                    yield problem.nested_under(kind, i)
    for a, arm in enumerate(node_list(drive, "arms")):
        for key in ("at", "anchor"):
            yield from place_rule(("arms", a, "spring", key), node_value(node_value(arm, "spring"), key))


MOST_PARTS = 256
"""Most parts of a kind in a drive."""
MOST_PIECES = 1000
"""Most arcs and straight pieces of all guide faces."""
LONGEST_FACE = 20_000
"""Longest guide face, in pitches."""


def count_rules(drive: Any) -> Iterator[Problem]:
    """Problems of too many parts of a kind."""
    for kind in NAMED:
        count = len(node_list(drive, kind))
        if count > MOST_PARTS:
            yield Problem((kind,), None, f"has {count} elements; must have at most {MOST_PARTS}", BARE)


def face_rules(drive: Any) -> Iterator[Problem]:
    """Problems of guide faces too long or of too many pieces."""
    guides, count = node_list(drive, "guides"), 0
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
    """Problems of guide faces that bend within a pitch."""
    for g, guide in enumerate(node_list(drive, "guides")):
        chain = chain_of_part(drive, guide)
        if chain is None:
            continue
        pitch, offset = chain.pitch, node_value(guide, "offset")
        if are_numbers(offset) and offset > pitch:
            yield Problem(("guides", g, "offset"), offset, f"must be at most a pitch, {pitch:g}")
        yield from (problem.nested_under("guides", g) for problem in _face_bend_rules(guide, pitch))


def tooth_rules(drive: Any) -> Iterator[Problem]:
    """Problems of tooth gaps too small for rollers, or too low."""
    for s, sprocket in enumerate(node_list(drive, "sprockets")):
        chain, tooth, teeth = (
            chain_of_part(drive, sprocket),
            node_value(sprocket, "tooth"),
            node_value(sprocket, "teeth"),
        )
        seat, tip = node_value(tooth, "seat_radius"), node_value(tooth, "tip_radius")
        if chain is None or not are_numbers(seat, tip, teeth) or teeth < 2:
            continue
        if seat < chain.roller_radius:
            text = f"must be at least the radius of the rollers, {chain.roller_radius:g}"
            yield Problem(("sprockets", s, "tooth", "seat_radius"), seat, text)
        own = node_value(sprocket, "pitch")
        radius = (chain.pitch if not are_numbers(own) else own) / (2.0 * math.sin(math.pi / teeth))
        if tip <= radius:
            yield Problem(
                ("sprockets", s, "tooth", "tip_radius"), tip, f"must be beyond the pitch circle, {radius:.6g}"
            )


def wheel_rules(drive: Any) -> Iterator[Problem]:
    """Problems of wheels that a silent chain's toes do not fit."""
    sides: dict[Any, tuple[str, str]] = {}
    for s, sprocket in enumerate(node_list(drive, "sprockets")):
        chain, teeth, wrap = chain_of_part(drive, sprocket), node_value(sprocket, "teeth"), node_value(sprocket, "wrap")
        if chain is None or not chain.is_silent:
            continue
        if node_value(sprocket, "tooth") is not None:
            text = "not together with a silent chain, whose plates set the teeth"
            yield Problem(("sprockets", s, "tooth"), None, text, BARE)
        if are_numbers(teeth) and 5 <= teeth < LEAST_TEETH:
            yield Problem(("sprockets", s, "teeth"), teeth, f"must be at least {LEAST_TEETH} with a silent chain")
        elif are_numbers(teeth) and teeth >= LEAST_TEETH:
            yield from (problem.nested_under("sprockets", s) for problem in _toe_rules(chain, teeth))
        first, name = sides.setdefault(getattr(chain, "name", None), (wrap, node_value(sprocket, "name")))
        if wrap != first:
            text = f'must be "{first}", as of "{name}": the toes of a silent chain point to one side'
            yield Problem(("sprockets", s, "wrap"), wrap, text)


def _toe_rules(chain: Chain, teeth: int) -> Iterator[Problem]:
    """Problems of a silent chain's toes on a wheel."""
    plate = chain.plate
    if gap_angle(plate, teeth) - math.pi / teeth <= 0.0:
        most = math.ceil(math.tau / plate.flank_angle)
        yield Problem(("teeth",), teeth, f"must be above {most}, with teeth whose flanks do not cross")
    elif plate.depth >= ROOT_DEPTH * plate.pitch:
        deepest = plate.toe_depths[1] - (plate.depth - ROOT_DEPTH * plate.pitch)
        text = f"must fit toes of a silent chain, which reach a wheel's roots; toe_depths up to {deepest:.4g} fit"
        yield Problem(("teeth",), teeth, text)
    elif toe_clearance(plate, teeth, chain.pitch) < -CLEARANCE_SLACK * chain.pitch:
        text = "must be a wheel that toes clear as links turn in: more teeth, flanks that begin deeper, or lower toes"
        yield Problem(("teeth",), teeth, text)


def back_rules(drive: Any) -> Iterator[Problem]:
    """Problems of guides on the toes of a silent chain."""
    for g, guide in enumerate(node_list(drive, "guides")):
        chain = chain_of_part(drive, guide)
        profile = guide_profile(guide, chain.pitch) if chain is not None and chain.is_silent else None
        if chain is None or profile is None:
            continue
        name = node_value(guide, "chain")
        own = [part for part in node_list(drive, "sprockets") if node_value(part, "chain") == name]
        wheels = [wheel for part in own if (wheel := valid_part(Sprocket, part)) is not None]
        ends = profile.face[0].start, profile.face[-1].end
        if any(True for place in (*ends, *(of.center for of in wheels)) for _ in place_rule((), place)):
            continue
        begin, end = (complex(*place) for place in ends)
        middle, way = 0.5 * (begin + end), (end - begin) / max(abs(end - begin), 1e-300)
        found: list[tuple[float, float, str]] = []  # distance, cosine to the face, name
        for k in range(len(wheels) if len(wheels) == len(own) > 1 else 0):
            pair = wheels[k], wheels[(k + 1) % len(wheels)]
            heading = _strand_heading(*pair, chain.pitch)
            if heading is None:
                continue
            along = complex(math.cos(heading), math.sin(heading))
            start, stop = (complex(*of.center) - of.sign * _pitch_radius(of, chain.pitch) * 1j * along for of in pair)
            part = min(max(((middle - start) * along.conjugate()).real, 0.0), abs(stop - start))
            cosine = pair[0].sign * (way * along.conjugate()).real
            if abs(cosine) > LEAST_ALONG:
                found.append((abs(middle - start - part * along), cosine, "->".join(of.name for of in pair)))
        if found and min(found)[1] < 0.0:
            text = f'its face is turned to the toes of strand "{min(found)[2]}"; must be turned to the chain\'s back'
            yield Problem(("guides", g), None, text, BARE)


def _face_bend_rules(guide: Any, pitch: float) -> Iterator[Problem]:
    """Problems of one guide face that bends within a pitch."""
    text = f"must be at least a pitch, {pitch:g}; links cannot follow a tighter face"
    radius = node_value(guide, "radius")
    if are_numbers(radius) and 0.0 < radius < pitch:
        yield Problem(("radius",), radius, text)
    for k, arc in enumerate(node_list(guide, "arcs")):
        radius = node_value(arc, "radius")
        if are_numbers(radius) and 0.0 < radius < pitch:
            yield Problem(("arcs", k, "radius"), radius, text)
    profile = guide_profile(guide, pitch) if node_value(guide, "profile") is not None else None
    if profile is not None:
        worst = max(profile.face, key=lambda piece: abs(piece.curvature))
        if abs(worst.curvature) * pitch > 1.0:
            (x, y), radius = worst.at(0.5 * worst.length)[0], 1.0 / abs(worst.curvature)
            bends = f"bends with a radius of {radius:.3g} m at [{x:.4g}, {y:.4g}]"
            yield Problem(("profile",), None, f"{bends}; {text}", BARE)


def arm_rules(drive: Any) -> Iterator[Problem]:
    """Problems of parts on unknown arms, and of three arms in a row."""
    names = [node_value(arm, "name") for arm in node_list(drive, "arms")]
    places: list[tuple[tuple[str | int, ...], Any]] = [
        (("guides", g), guide) for g, guide in enumerate(node_list(drive, "guides"))
    ]
    places += [
        (("sprockets", s, "mount"), node_value(part, "mount")) for s, part in enumerate(node_list(drive, "sprockets"))
    ]
    places += [(("arms", a), part) for a, part in enumerate(node_list(drive, "arms"))]
    for keys, part in places:
        arm = node_value(part, "arm")
        if isinstance(arm, str) and arm in names and keys[0] == "arms":
            yield from (
                problem.nested_under(*keys)
                for problem in _parent_arm_rules(part, node_list(drive, "arms")[names.index(arm)])
            )
        if isinstance(arm, str) and arm not in names:
            hint = nearest_key_text(arm, filter(is_name, names)) if names else "there are none"
            yield Problem((*keys, "arm"), arm, f"must be the name of an arm; {hint}")


def _parent_arm_rules(arm: Any, carrier: Any) -> Iterator[Problem]:
    """Problem of an arm on an arm off the ground."""
    name, on = node_value(arm, "name"), node_value(carrier, "arm")
    if node_value(carrier, "name") == name or on == name:
        yield Problem(("arm",), node_value(arm, "arm"), "hangs on itself; one of the arms must stand on the ground")
    elif on is not None:
        text = f'hangs on "{on}" itself; at most two arms may stand in a row'
        yield Problem(("arm",), node_value(arm, "arm"), text)
    if node_value(arm, "pivot_table") is not None:
        yield Problem(("pivot_table",), None, "not together with arm, which leads the pivot", BARE)


def pivot_rules(drive: Any) -> Iterator[Problem]:
    """Problems of sprockets at the pivot of their arm."""
    pivots = {
        node_value(arm, "name"): node_list(arm, "pivot")
        for arm in node_list(drive, "arms")
        if is_name(node_value(arm, "name"))
    }
    for s, sprocket in enumerate(node_list(drive, "sprockets")):
        name, center = node_value(node_value(sprocket, "mount"), "arm"), list(node_list(sprocket, "center"))
        if isinstance(name, str) and center and center == list(pivots.get(name, ())):
            yield Problem(("sprockets", s, "center"), center, f'must not be the pivot of "{name}", which carries it')


def tensioner_rules(drive: Any) -> Iterator[Problem]:
    """Problems of tensioners that push nothing, or away from the chain."""
    if not node_list(drive, "tensioners"):
        return
    arms, sprockets = (_index_by_name(node_list(drive, kind)) for kind in ("arms", "sprockets"))
    for t, node in enumerate(node_list(drive, "tensioners")):
        on = node_value(node, "on")
        if not isinstance(on, str):
            continue
        found: Iterator[Problem] = iter(())
        if on in arms:
            found = _arm_push_rules(drive, node, node_list(drive, "arms")[arms[on]])
        elif on in sprockets:
            found = _slider_push_rules(drive, node, sprockets[on])
        else:
            known = [name for name in (*arms, *_sprockets_on_sliders(drive)) if is_name(name)]
            hint = nearest_key_text(on, known) if known else "there are none"
            found = iter([Problem(("on",), on, f"must be the name of an arm, or of a sprocket on a slider; {hint}")])
        yield from (problem.nested_under("tensioners", t) for problem in found)


def pump_rules(drive: Any) -> Iterator[Problem]:
    """Problems of pumps that an unknown sprocket or shaft turns."""
    several = bool(node_list(drive, "chains"))
    what = "a sprocket of its chain" if several else "a sprocket or a shaft"
    for t, node in enumerate(node_list(drive, "tensioners")):
        shaft = node_value(node_value(node_value(node, "oil"), "supply_table"), "shaft")
        if not isinstance(shaft, str):
            continue
        parts = [part for kind in TURNED for part in node_list(drive, kind)]
        if several:
            of_chains = (part for kind in ("sprockets", "guides") for part in node_list(drive, kind))
            own = {node_value(part, "chain") for part in of_chains if _is_on_body(part, node_value(node, "on"))}
            parts = [part for part in node_list(drive, "sprockets") if node_value(part, "chain") in own]
        names = [name for part in parts if is_name(name := node_value(part, "name"))]
        if shaft not in names:
            path = ("tensioners", t, "oil", "supply_table", "shaft")
            yield Problem(path, shaft, f"must be the name of {what}; {nearest_key_text(shaft, names)}")


def _is_on_body(part: Any, on: Any) -> bool:
    """Whether a guide or sprocket is on a named body."""
    return on in (node_value(part, "name"), node_value(part, "arm"), node_value(node_value(part, "mount"), "arm"))


def _index_by_name(parts: Sequence[Any]) -> dict[str, int]:
    """Indices of parts by name."""
    return {name: i for i, part in enumerate(parts) if isinstance(name := node_value(part, "name"), str)}


def _sprockets_on_sliders(drive: Any) -> list[Any]:
    """Names of the sprockets on sliders."""
    sprockets = node_list(drive, "sprockets")
    return [node_value(part, "name") for part in sprockets if node_value(node_value(part, "mount"), "kind") == "slider"]


def _arm_push_rules(drive: Any, node: Any, arm_node: Any) -> Iterator[Problem]:
    """Problem of a tensioner that turns an arm's faces away from the chain."""
    arm, tensioner = valid_part(Arm, arm_node), valid_part(Tensioner, node)
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
    nodes = [guide for guide in node_list(drive, "guides") if node_value(guide, "arm") == arm.name]
    carried = [
        part for part in node_list(drive, "sprockets") if node_value(node_value(part, "mount"), "arm") == arm.name
    ]
    chain = next((chain_of_part(drive, part) for part in (*nodes, *carried)), None)
    if chain is None:
        return
    profiles = [profile for guide in nodes if (profile := guide_profile(guide, chain.pitch)) is not None]
    ends = [(math.dist(p.face[-1].end, arm.pivot), math.dist(p.face[0].start, arm.pivot)) for p in profiles]
    sense = sum(end * end - start * start for end, start in ends)
    if sense * lever < 0.0 and abs(sense) > LEAST_LEVER * sum(end * end + start * start for end, start in ends):
        names = " and ".join(f'"{node_value(guide, "name")}"' for guide in nodes)
        sides = {"right" if node_value(guide, "side") == "right" else "left" for guide in nodes}
        rides = f"which rides on the {' and '.join(sorted(sides))} of {names} from start to end"
        text = f'turns "{arm.name}" away from the chain, {rides}; must push towards it'
        yield Problem(("direction",), list(tensioner.direction), text)
    yield from _arm_sprocket_rules(drive, tensioner, arm, lever, chain.pitch)


def _arm_sprocket_rules(drive: Any, tensioner: Tensioner, arm: Arm, lever: float, pitch: float) -> Iterator[Problem]:
    """Problem of a tensioner that turns an arm's sprockets with their pull."""
    parts = node_list(drive, "sprockets")
    mine = next(
        (node_value(part, "chain") for part in parts if node_value(node_value(part, "mount"), "arm") == arm.name), None
    )
    sprockets = [valid_part(Sprocket, part) for part in parts if node_value(part, "chain") == mine]
    whole = [sprocket for sprocket in sprockets if sprocket is not None]
    if len(whole) < 2 or len(whole) < len(sprockets):
        return
    for s, own in enumerate(whole):
        pull = _strand_pull(whole, s, pitch) if node_value(own.mount, "arm") == arm.name else None
        if pull is not None:
            dx, dy = own.center[0] - arm.pivot[0], own.center[1] - arm.pivot[1]
            turned = dx * pull[1] - dy * pull[0]
            if turned * lever > 0.0 and abs(turned) > 0.1 * math.hypot(dx, dy):
                text = f'turns "{own.name}" the way its strands pull it, ({pull[0]:.2f}, {pull[1]:.2f})'
                yield Problem(("direction",), list(tensioner.direction), f"{text}; must push against them")


def _slider_push_rules(drive: Any, node: Any, s: int) -> Iterator[Problem]:
    """Problem of a tensioner that pushes a slider with its strands' pull."""
    kind = node_value(node_value(node_list(drive, "sprockets")[s], "mount"), "kind") or "fixed"
    if kind != "slider":
        name = node_value(node, "on")
        text = f'must be the name of an arm, or of a sprocket on a slider; the mount of "{name}" is of kind "{kind}"'
        yield Problem(("on",), name, text)
        return
    place, parts = s, node_list(drive, "sprockets")
    along_chain = [k for k, part in enumerate(parts) if node_value(part, "chain") == node_value(parts[s], "chain")]
    s, sprockets = along_chain.index(place), [valid_part(Sprocket, parts[k]) for k in along_chain]
    tensioner, chain = valid_part(Tensioner, node), chain_of_part(drive, parts[place])
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
    pull = _strand_pull([sprocket for sprocket in sprockets if sprocket is not None], s, chain.pitch)
    if pull is not None and along * (pull[0] * x + pull[1] * y) / length > 0.1:
        text = (
            f'pushes "{own.name}" the way its strands pull it, ({pull[0]:.2f}, {pull[1]:.2f}); must push against them'
        )
        yield Problem(("direction",), list(tensioner.direction), text)


def _strand_pull(sprockets: list[Sprocket], s: int, pitch: float) -> tuple[float, float] | None:
    """Sum of two strands' unit vectors on a sprocket, or None."""
    before, own, after = sprockets[s - 1], sprockets[s], sprockets[(s + 1) % len(sprockets)]
    away, home = _strand_heading(own, after, pitch), _strand_heading(before, own, pitch)
    if away is None or home is None:
        return None
    return math.cos(away) - math.cos(home), math.sin(away) - math.sin(home)


def _strand_heading(one: Sprocket, other: Sprocket, pitch: float) -> float | None:
    """Heading of the strand between two sprockets [rad], or None."""
    dx, dy = other.center[0] - one.center[0], other.center[1] - one.center[1]
    first, second = (part.sign * _pitch_radius(part, pitch) for part in (one, other))
    distance = math.hypot(dx, dy)
    if abs(second - first) >= distance:
        return None
    return math.atan2(dy, dx) - math.asin((second - first) / distance)


def _pitch_radius(sprocket: Sprocket, pitch: float) -> float:
    """Pitch radius of a sprocket [m]."""
    return pitch / (2.0 * math.sin(math.pi / sprocket.teeth))
