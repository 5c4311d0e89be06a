"""Rules of shafts, gears, couplings and motors: contradictions, and values that would fit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from typing import Any

from warpchain.drive.body_ties import (
    DRIVING_KEYS,
    BodyTie,
    TiedRatios,
    body_names,
    body_ties,
    ratios_with_chains,
    rigid_ratios,
)
from warpchain.drive.schema import (
    BARE,
    Problem,
    allowed_text,
    are_numbers,
    is_name,
    nearest_key_text,
    node_list,
    node_value,
)
from warpchain.drive.shafts import FIXED, Shaft
from warpchain.drive.sprocket import Sprocket

MOST_BODIES = 60
"""Most sprockets and shafts of a drive with trains."""

SAME = 1e-6
"""Tolerance of speeds that must agree [-]."""


def train_rules(drive: Any) -> Iterator[Problem]:
    """Problems of shafts, gears, couplings and motors."""
    several = bool(node_list(drive, "chains"))
    on_shafts = any(node_value(sprocket, "shaft") is not None for sprocket in node_list(drive, "sprockets"))
    if not (several or on_shafts or any(node_list(drive, kind) for kind in ("shafts", "gears", "couplings"))):
        return
    names = body_names(drive)
    yield from _known_shaft_rules(drive, [name for name in names if is_name(name)])
    for h, shaft in enumerate(node_list(drive, "shafts") if not several else ()):
        if node_value(shaft, "inertia") is None and node_value(shaft, "prescribed") is None:
            text = f"missing; {allowed_text(Shaft, 'inertia')}; needed unless the shaft is prescribed"
            yield Problem(("shafts", h, "inertia"), None, text, BARE)
    yield from _shaft_sprocket_rules(drive, several)
    found = body_ties(drive)
    if len(names) > MOST_BODIES:
        text = f"with sprockets must be at most {MOST_BODIES}; there are {len(names)}"
        yield Problem(("shafts",), None, text, BARE)
        return
    if len({name for name in names if isinstance(name, str)}) < len(names):
        return  # said by others
    wrong = list(_gearbox_rules(drive, names)) or list(_contradiction_rules(drive, names))
    yield from wrong
    if not wrong:
        whole = _has_known_ties(drive, names, found)
        yield from _inertia_rules(drive, names) if several and whole else ()
        yield from _motion_source_rules(drive, names, whole)
        yield from _carried_part_rules(drive, names)


def _known_shaft_rules(drive: Any, names: Sequence[str]) -> Iterator[Problem]:
    """Problems of unknown names of shafts."""
    shafts = [name for name in (node_value(part, "name") for part in node_list(drive, "shafts")) if is_name(name)]
    several = node_list(drive, "chains")  # `chain_rules.shaft_group_rules`
    for s, sprocket in enumerate(node_list(drive, "sprockets") if not several else ()):
        shaft = node_value(sprocket, "shaft")
        if isinstance(shaft, str) and shaft not in shafts:
            hint = nearest_key_text(shaft, shafts) if shafts else "there are none"
            yield Problem(("sprockets", s, "shaft"), shaft, f"must be the name of a shaft; {hint}")
    for kind in ("gears", "couplings"):
        for i, part in enumerate(node_list(drive, kind)):
            for k, name in enumerate(node_list(part, "between")):
                if isinstance(name, str) and name not in names and (kind, name) != ("couplings", FIXED):
                    text = f"must be the name of a shaft or a sprocket; {nearest_key_text(name, names)}"
                    yield Problem((kind, i, "between", k), name, text)


def _inertia_rules(drive: Any, names: Sequence[str]) -> Iterator[Problem]:
    """Problems of trains without inertia in drives of several chains."""
    tied, parts = rigid_ratios(drive), [*node_list(drive, "sprockets"), *node_list(drive, "shafts")]
    sound = {tied.root[b] for b, of in enumerate(parts) if node_value(of, "inertia") or node_value(of, "prescribed")}
    count = len(node_list(drive, "sprockets"))
    for b, root in enumerate(tied.root):
        if root == b and root not in sound:
            place = ("sprockets", b, "inertia") if b < count else ("shafts", b - count, "inertia")
            text = f'missing; {allowed_text(Shaft, "inertia")}; needed as nothing prescribes "{names[b]}"'
            yield Problem(place, None, text, BARE)


def _shaft_sprocket_rules(drive: Any, several: bool) -> Iterator[Problem]:
    """Problems of sprockets on shafts: other motion, center or mount."""
    rigidly = {tie.b for tie in body_ties(drive) if tie.kind == "shaft"}
    first: dict[str, Any] = {}
    shafts = [node_value(shaft, "name") for shaft in node_list(drive, "shafts")]
    for s, sprocket in enumerate(node_list(drive, "sprockets")):
        shaft = node_value(sprocket, "shaft")
        if not isinstance(shaft, str):
            continue
        for key in ("prescribed", "load") if not several else ():
            if node_value(sprocket, key) is not None:
                text = f'not on a sprocket with a shaft; give shafts."{shaft}".{key} instead'
                yield Problem(("sprockets", s, key), None, text, BARE)
        if node_value(sprocket, "inertia") is None and s not in rigidly and shaft in shafts:
            text = (
                f"missing; {allowed_text(Sprocket, 'inertia')}; needed where a coupling holds the sprocket on its shaft"
            )
            yield Problem(("sprockets", s, "inertia"), None, text, BARE)
        other = first.setdefault(shaft, sprocket)
        for key in ("center", "mount") if not several else ():
            if _plain_value(node_value(other, key)) != _plain_value(node_value(sprocket, key)):
                one = _plain_value(node_value(other, key))
                text = f'must be that of "{node_value(other, "name")}", which is on the same shaft: {one}'
                yield Problem(("sprockets", s, key), _plain_value(node_value(sprocket, key)), text)
    tied = {b for tie in body_ties(drive) for b in (tie.a, tie.b)}
    for s, sprocket in enumerate(node_list(drive, "sprockets")):
        if node_value(sprocket, "balance_wheel") is not None and s in tied:
            text = "not on a sprocket that a shaft, a gear or a coupling turns"
            yield Problem(("sprockets", s, "balance_wheel"), None, text, BARE)


def _plain_value(value: Any) -> Any:
    """Comparable form of a center or mount of shaft rules."""
    if value is None:
        return "fixed"
    if hasattr(value, "model_dump"):
        value = value.model_dump(exclude_none=True)
    if isinstance(value, dict):
        return "fixed" if value.get("kind") == "fixed" else value
    return list(value) if isinstance(value, (tuple, list)) else value


def _gearbox_rules(drive: Any, names: Sequence[str]) -> Iterator[Problem]:
    """Problems of gearbox ratios: not between two shafts, or contradicting ties."""
    on_shaft = [{str(node_value(of, "name")), str(node_value(of, "shaft"))} for of in node_list(drive, "sprockets")]
    for c, coupling in enumerate(node_list(drive, "couplings")):
        between = set(map(str, node_list(coupling, "between")))
        if node_value(coupling, "ratios") is not None and between in on_shaft:
            text = "not between a shaft and a sprocket on it; must be between two shafts"
            yield Problem(("couplings", c, "ratios"), None, text, BARE)
    for tie in body_ties(drive):
        if tie.kind == "couplings":
            ratios = node_value(node_list(drive, "couplings")[int(tie.path[1])], "ratios")
            engaged = {value for value in node_list(ratios, "ratio") if are_numbers(value) and value != 0.0}
            others, _ = ratios_with_chains(drive, without=tie)
            if len(engaged) > 1 and others.root[tie.a] == others.root[tie.b]:
                text = f'"{names[tie.a]}" and "{names[tie.b]}" turn in one ratio by the rest of the drive; must be one'
                yield Problem((*tie.path, "ratios", "ratio"), None, text, BARE)


def _contradiction_rules(drive: Any, names: Sequence[str]) -> Iterator[Problem]:
    """Problems of contradicting ties, and of gears between two motions."""
    _, wrong = ratios_with_chains(drive)
    for tie, known in wrong:
        yield _contradiction_problem(drive, names, tie, known)
    if wrong:
        return
    tied, kept = rigid_ratios(drive), dict[int, int]()
    parts = [*node_list(drive, "sprockets"), *node_list(drive, "shafts")]
    count = len(node_list(drive, "sprockets"))
    for b, part in enumerate(parts):
        if node_value(part, "prescribed") is not None:
            other = kept.setdefault(tied.root[b], b)
            if other != b:
                kind, place = ("sprockets", b) if b < count else ("shafts", b - count)
                text = f'not together with that of "{names[other]}", with which it turns as one; give one of the two'
                yield Problem((kind, place, "prescribed"), None, text, BARE)
    for tie in body_ties(drive):
        if tie.kind == "couplings" and tied.root[tie.a] == tied.root[tie.b]:
            text = f'"{names[tie.a]}" and "{names[tie.b]}" turn as one already; must be two that do not'
            yield Problem((*tie.path, "between"), [names[tie.a], names[tie.b]], text)


def _carried_part_rules(drive: Any, names: Sequence[str]) -> Iterator[Problem]:
    """Problems of bearings on prescribed bodies, and gears whose axes move."""
    sprockets, tied = node_list(drive, "sprockets"), rigid_ratios(drive)
    parts = [*sprockets, *node_list(drive, "shafts")]
    led = {tied.root[b]: names[b] for b, part in enumerate(parts) if node_value(part, "prescribed") is not None}
    for s, sprocket in enumerate(sprockets):
        if (
            node_value(sprocket, "bearing") is not None
            and node_value(sprocket, "prescribed") is None
            and tied.root[s] in led
        ):
            text = f'not on a sprocket that turns with "{led[tied.root[s]]}", whose prescribed motion nothing disturbs'
            yield Problem(("sprockets", s, "bearing"), None, text, BARE)
    on_arms = [sprocket for sprocket in sprockets if node_value(node_value(sprocket, "mount"), "kind") == "arm"]
    swinging = [node_value(sprocket, key) for sprocket in on_arms for key in ("name", "shaft")]
    geared = [("gears", g, gear) for g, gear in enumerate(node_list(drive, "gears"))]
    couplings = enumerate(node_list(drive, "couplings"))
    geared += [("couplings", c, coupling) for c, coupling in couplings if node_value(coupling, "ratios") is not None]
    for kind, i, pair in geared:
        for k, name in enumerate(node_list(pair, "between")):
            if isinstance(name, str) and name in swinging:
                yield Problem((kind, i, "between", k), name, "must not be on an arm, which moves it from the other")


def _ratio_text(ratio: Fraction) -> str:
    """Words for a speed ratio and its sense."""
    size = f"{float(abs(ratio)):.6g} times as fast"
    return size if ratio > 0 else f"{size}, the other way round,"


def _contradiction_problem(drive: Any, names: Sequence[str], tie: BodyTie, known: Fraction) -> Problem:
    """Problem of a tie that contradicts a known ratio."""
    a, b = names[tie.a], names[tie.b]
    has = f'the rest of the drive turns "{b}" {_ratio_text(known)} as "{a}"'
    if tie.kind == "gears":
        teeth = node_value(node_list(drive, "gears")[int(tie.path[1])], "teeth")
        fits = f"teeth as {abs(known).numerator} to {abs(known).denominator}, internal = {str(known > 0).lower()}"
        return Problem((*tie.path, "teeth"), list(teeth), f"{has}; {fits} would fit")
    if tie.kind == "shaft":
        teeth = node_value(node_list(drive, "sprockets")[tie.b], "teeth")
        fits = f"teeth = {float(teeth * abs(known)):g} would fit"
        if known < 0:
            fits = "the other wrap would fit"
        return Problem((*tie.path[:2], "shaft"), a, f"{has}; {fits}")
    if node_value(node_list(drive, "couplings")[int(tie.path[1])], "ratios") is not None:
        return Problem((*tie.path, "ratios", "ratio"), None, f"{has}; {float(1 / known):.9g} would fit", BARE)
    return Problem((*tie.path, "between"), [a, b], f"{has}; a coupling needs two that turn alike")


def _has_known_ties(drive: Any, names: Sequence[str], found: Sequence[BodyTie]) -> bool:
    """Whether all ties between bodies are known."""
    paths, parts = {tie.path for tie in found}, node_list(drive, "sprockets")
    for kind in ("gears", "couplings"):
        there = node_list(drive, kind)
        tied = [i for i, part in enumerate(there) if FIXED not in node_list(part, "between")]
        if not all((kind, i) in paths for i in tied) or (node_value(drive, kind) and not there):
            return False
    chains = [node_value(chain, "name") for chain in node_list(drive, "chains")] or [None]
    return all(node_value(of, "shaft") in [None, *names] and node_value(of, "chain") in chains for of in parts)


def _prescribed_speed_rules(
    parts: Sequence[Any], names: Sequence[str], tied: TiedRatios, count: int
) -> Iterator[Problem]:
    """Problems of constant speeds that ties and chains exclude."""
    first: dict[int, int] = {}
    for b, part in enumerate(parts):
        speed = node_value(node_value(part, "prescribed"), "speed")
        if not are_numbers(speed):
            continue
        other = first.setdefault(tied.root[b], b)
        known = node_value(node_value(parts[other], "prescribed"), "speed")
        fits = float(known) * float(abs(tied.ratio[b] / tied.ratio[other]))
        if abs(speed - fits) > SAME * max(abs(speed), abs(fits)):
            place = ("sprockets", b) if b < count else ("shafts", b - count)
            text = f'must fit that of "{names[other]}", which is prescribed, too, and turns it: {fits:.9g}'
            yield Problem((*place, "prescribed", "speed"), speed, text)


def _motion_source_rules(drive: Any, names: Sequence[str], whole: bool) -> Iterator[Problem]:
    """Problems of shafts that nothing turns, and contradicting start speeds."""
    count = len(node_list(drive, "sprockets"))
    parts = [*node_list(drive, "sprockets"), *node_list(drive, "shafts")]
    all_of, _ = ratios_with_chains(drive)
    keys = ("prescribed", "load", "motor", "initial_speed")
    moved = {root for root, part in zip(all_of.root, parts, strict=False) if any(node_value(part, key) for key in keys)}
    chains = node_list(drive, "chains")
    if not chains:
        moved.add(all_of.root[-1])
    turned = {
        root
        for root, part in zip(all_of.root, parts, strict=False)
        if any(node_value(part, key) for key in DRIVING_KEYS)
    }
    whole = whole and bool(turned)
    on = [node_value(sprocket, "chain") for sprocket in node_list(drive, "sprockets")]
    for c, chain in enumerate(chains if whole else ()):
        if all_of.root[len(parts) + c] not in turned and on.count(node_value(chain, "name")) > 1:
            text = "is turned by nothing: neither a sprocket of it, nor what that turns with, is prescribed or driven"
            yield Problem(("chains", c, "name"), node_value(chain, "name"), text)
    for b in range(count, len(parts) if whole else count):
        if all_of.root[b] not in moved:
            text = "nothing turns it: neither a sprocket on it, a gear or a coupling, nor a motor, load or prescribed"
            yield Problem(("shafts", b - count), None, text, BARE)
    tied, _ = ratios_with_chains(drive, couplings=False)
    yield from _prescribed_speed_rules(parts, names, tied, count)
    begun: dict[int, int] = {}
    for key in ("prescribed", "initial_speed"):
        for b, part in enumerate(parts):
            if node_value(part, key) is None:
                continue
            first = begun.setdefault(tied.root[b], b)
            speed, known = node_value(part, "initial_speed"), node_value(parts[first], "initial_speed")
            if first == b or key == "prescribed" or not are_numbers(speed):
                continue
            at = ("shafts", b - count, "initial_speed")
            if not are_numbers(known):
                yield Problem(at, speed, f'not where "{names[first]}" is prescribed, with which it turns')
                continue
            fits = float(known) * float(abs(tied.ratio[b] / tied.ratio[first]))
            if abs(speed - fits) > SAME * max(abs(speed), abs(fits)):
                yield Problem(at, speed, f'must fit that of "{names[first]}", with which it turns: {fits:.9g}')
