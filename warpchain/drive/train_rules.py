"""Rules of shafts, gears, couplings and motors: contradictions, and the values that would fit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from typing import Any

from warpchain.drive.geared_chain_drives import DRIVING_KEYS
from warpchain.drive.schema import BARE, Problem, allowed, elements, get, is_name, nearest, numbers
from warpchain.drive.shafts import FIXED, Shaft
from warpchain.drive.sprocket import Sprocket
from warpchain.drive.trains import (
    BodyTie,
    TiedRatios,
    body_names,
    body_ties,
    has_trains,
    ratios_with_chains,
    rigid_ratios,
)
from warpchain.drive.transmission import is_geared

MOST_BODIES = 60
"""Sprockets and shafts of a drive with shafts, gears or couplings."""

SAME = 1e-6
"""Of speeds that have to agree."""


def train_rules(drive: Any) -> Iterator[Problem]:
    """Everything that ties shafts says the same, and something turns them."""
    several = bool(elements(drive, "chains"))
    if several and not is_geared(drive):
        return  # `chain_rules`
    if not has_trains(drive) and all(get(of, "shaft") is None for of in elements(drive, "sprockets")):
        return
    names = body_names(drive)
    yield from _known(drive, [name for name in names if is_name(name)])
    for h, shaft in enumerate(elements(drive, "shafts") if not several else ()):
        if get(shaft, "inertia") is None and get(shaft, "prescribed") is None:
            text = f"missing; {allowed(Shaft, 'inertia')}; needed unless the shaft is prescribed"
            yield Problem(("shafts", h, "inertia"), None, text, BARE)
    yield from _on_shafts(drive, several)
    found = body_ties(drive)
    if len(names) > MOST_BODIES:
        text = f"with sprockets must be at most {MOST_BODIES}; there are {len(names)}"
        yield Problem(("shafts",), None, text, BARE)
        return
    if len({name for name in names if isinstance(name, str)}) < len(names):
        return  # said by others
    wrong = list(_gearboxes(drive, names)) or list(_contradictions(drive, names))
    yield from wrong
    if not wrong:
        whole = _whole(drive, names, found)
        yield from _inertias(drive, names) if several and whole else ()
        yield from _driven(drive, names, whole)
        yield from _carried(drive, names)


def _known(drive: Any, names: Sequence[str]) -> Iterator[Problem]:
    """Shafts that others name are there."""
    shafts = [name for name in (get(part, "name") for part in elements(drive, "shafts")) if is_name(name)]
    several = elements(drive, "chains")  # `chain_rules.shaft_group_rules`
    for s, sprocket in enumerate(elements(drive, "sprockets") if not several else ()):
        shaft = get(sprocket, "shaft")
        if isinstance(shaft, str) and shaft not in shafts:
            hint = nearest(shaft, shafts) if shafts else "there are none"
            yield Problem(("sprockets", s, "shaft"), shaft, f"must be the name of a shaft; {hint}")
    for kind in ("gears", "couplings"):
        for i, part in enumerate(elements(drive, kind)):
            for k, name in enumerate(elements(part, "between")):
                if isinstance(name, str) and name not in names and (kind, name) != ("couplings", FIXED):
                    text = f"must be the name of a shaft or a sprocket; {nearest(name, names)}"
                    yield Problem((kind, i, "between", k), name, text)


def _inertias(drive: Any, names: Sequence[str]) -> Iterator[Problem]:
    """Something of each train has an inertia, of drives with several chains, unless it is prescribed."""
    tied, parts = rigid_ratios(drive), [*elements(drive, "sprockets"), *elements(drive, "shafts")]
    sound = {tied.root[b] for b, of in enumerate(parts) if get(of, "inertia") or get(of, "prescribed")}
    count = len(elements(drive, "sprockets"))
    for b, root in enumerate(tied.root):
        if root == b and root not in sound:
            place = ("sprockets", b, "inertia") if b < count else ("shafts", b - count, "inertia")
            text = f'missing; {allowed(Shaft, "inertia")}; needed as nothing prescribes "{names[b]}"'
            yield Problem(place, None, text, BARE)


def _on_shafts(drive: Any, several: bool) -> Iterator[Problem]:
    """Sprockets on shafts have no motion of their own, and one center and mount a shaft; of `several` chains the first
    sprocket may have the motion, and `chain_rules` has the rest.
    """
    rigidly = {tie.b for tie in body_ties(drive) if tie.kind == "shaft"}
    first: dict[str, Any] = {}
    shafts = [get(shaft, "name") for shaft in elements(drive, "shafts")]
    for s, sprocket in enumerate(elements(drive, "sprockets")):
        shaft = get(sprocket, "shaft")
        if not isinstance(shaft, str):
            continue
        for key in ("prescribed", "load") if not several else ():
            if get(sprocket, key) is not None:
                text = f'not on a sprocket with a shaft; give shafts."{shaft}".{key} instead'
                yield Problem(("sprockets", s, key), None, text, BARE)
        if get(sprocket, "inertia") is None and s not in rigidly and shaft in shafts:
            text = f"missing; {allowed(Sprocket, 'inertia')}; needed where a coupling holds the sprocket on its shaft"
            yield Problem(("sprockets", s, "inertia"), None, text, BARE)
        other = first.setdefault(shaft, sprocket)
        for key in ("center", "mount") if not several else ():
            if _plain(get(other, key)) != _plain(get(sprocket, key)):
                text = f'must be that of "{get(other, "name")}", which is on the same shaft: {_plain(get(other, key))}'
                yield Problem(("sprockets", s, key), _plain(get(sprocket, key)), text)
    tied = {b for tie in body_ties(drive) for b in (tie.a, tie.b)}
    for s, sprocket in enumerate(elements(drive, "sprockets")):
        if get(sprocket, "balance_wheel") is not None and s in tied:
            text = "not on a sprocket that a shaft, a gear or a coupling turns"
            yield Problem(("sprockets", s, "balance_wheel"), None, text, BARE)


def _plain(value: Any) -> Any:
    """A center or a mount that can be compared and shown."""
    if value is None:
        return "fixed"
    if hasattr(value, "model_dump"):
        value = value.model_dump(exclude_none=True)
    if isinstance(value, dict):
        return "fixed" if value.get("kind") == "fixed" else value
    return list(value) if isinstance(value, (tuple, list)) else value


def _gearboxes(drive: Any, names: Sequence[str]) -> Iterator[Problem]:
    """Ratios are between two shafts, and those that change between two that nothing else ties."""
    on_shaft = [{str(get(of, "name")), str(get(of, "shaft"))} for of in elements(drive, "sprockets")]
    for c, coupling in enumerate(elements(drive, "couplings")):
        between = set(map(str, elements(coupling, "between")))
        if get(coupling, "ratios") is not None and between in on_shaft:
            text = "not between a shaft and a sprocket on it; must be between two shafts"
            yield Problem(("couplings", c, "ratios"), None, text, BARE)
    for tie in body_ties(drive):
        if tie.kind == "couplings":
            ratios = get(elements(drive, "couplings")[int(tie.path[1])], "ratios")
            several = {value for value in elements(ratios, "ratio") if numbers(value) and value != 0.0}
            others, _ = ratios_with_chains(drive, without=tie)
            if len(several) > 1 and others.root[tie.a] == others.root[tie.b]:
                text = f'"{names[tie.a]}" and "{names[tie.b]}" turn in one ratio by the rest of the drive; must be one'
                yield Problem((*tie.path, "ratios", "ratio"), None, text, BARE)


def _contradictions(drive: Any, names: Sequence[str]) -> Iterator[Problem]:
    """Gears, shafts and couplings that turn two bodies unlike the others do, and gears between two motions."""
    _, wrong = ratios_with_chains(drive)
    for tie, known in wrong:
        yield _contradiction(drive, names, tie, known)
    if wrong:
        return
    tied, kept = rigid_ratios(drive), dict[int, int]()
    parts = [*elements(drive, "sprockets"), *elements(drive, "shafts")]
    count = len(elements(drive, "sprockets"))
    for b, part in enumerate(parts):
        if get(part, "prescribed") is not None:
            other = kept.setdefault(tied.root[b], b)
            if other != b:
                kind, place = ("sprockets", b) if b < count else ("shafts", b - count)
                text = f'not together with that of "{names[other]}", with which it turns as one; give one of the two'
                yield Problem((kind, place, "prescribed"), None, text, BARE)
    for tie in body_ties(drive):
        if tie.kind == "couplings" and tied.root[tie.a] == tied.root[tie.b]:
            text = f'"{names[tie.a]}" and "{names[tie.b]}" turn as one already; must be two that do not'
            yield Problem((*tie.path, "between"), [names[tie.a], names[tie.b]], text)


def _carried(drive: Any, names: Sequence[str]) -> Iterator[Problem]:
    """Bearings rub on what turns freely, and gears have axes that stand still."""
    sprockets, tied = elements(drive, "sprockets"), rigid_ratios(drive)
    parts = [*sprockets, *elements(drive, "shafts")]
    led = {tied.root[b]: names[b] for b, part in enumerate(parts) if get(part, "prescribed") is not None}
    for s, sprocket in enumerate(sprockets):
        if get(sprocket, "bearing") is not None and get(sprocket, "prescribed") is None and tied.root[s] in led:
            text = f'not on a sprocket that turns with "{led[tied.root[s]]}", whose prescribed motion nothing disturbs'
            yield Problem(("sprockets", s, "bearing"), None, text, BARE)
    on_arms = [sprocket for sprocket in sprockets if get(get(sprocket, "mount"), "kind") == "arm"]
    swinging = [get(sprocket, key) for sprocket in on_arms for key in ("name", "shaft")]
    geared = [("gears", g, gear) for g, gear in enumerate(elements(drive, "gears"))]
    couplings = enumerate(elements(drive, "couplings"))
    geared += [("couplings", c, coupling) for c, coupling in couplings if get(coupling, "ratios") is not None]
    for kind, i, pair in geared:
        for k, name in enumerate(elements(pair, "between")):
            if isinstance(name, str) and name in swinging:
                yield Problem((kind, i, "between", k), name, "must not be on an arm, which moves it from the other")


def _times(ratio: Fraction) -> str:
    """A ratio in words."""
    size = f"{float(abs(ratio)):.6g} times as fast"
    return size if ratio > 0 else f"{size}, the other way round,"


def _contradiction(drive: Any, names: Sequence[str], tie: BodyTie, known: Fraction) -> Problem:
    a, b = names[tie.a], names[tie.b]
    has = f'the rest of the drive turns "{b}" {_times(known)} as "{a}"'
    if tie.kind == "gears":
        teeth = get(elements(drive, "gears")[int(tie.path[1])], "teeth")
        fits = f"teeth as {abs(known).numerator} to {abs(known).denominator}, internal = {str(known > 0).lower()}"
        return Problem((*tie.path, "teeth"), list(teeth), f"{has}; {fits} would fit")
    if tie.kind == "shaft":
        teeth = get(elements(drive, "sprockets")[tie.b], "teeth")
        fits = f"teeth = {float(teeth * abs(known)):g} would fit"
        if known < 0:
            fits = "the other wrap would fit"
        return Problem((*tie.path[:2], "shaft"), a, f"{has}; {fits}")
    if get(elements(drive, "couplings")[int(tie.path[1])], "ratios") is not None:
        return Problem((*tie.path, "ratios", "ratio"), None, f"{has}; {float(1 / known):.9g} would fit", BARE)
    return Problem((*tie.path, "between"), [a, b], f"{has}; a coupling needs two that turn alike")


def _whole(drive: Any, names: Sequence[str], found: Sequence[BodyTie]) -> bool:
    """Whether all that ties bodies is known, so that what nothing turns is no consequence of another fault."""
    paths, parts = {tie.path for tie in found}, elements(drive, "sprockets")
    for kind in ("gears", "couplings"):
        there = elements(drive, kind)
        tied = [i for i, part in enumerate(there) if FIXED not in elements(part, "between")]
        if not all((kind, i) in paths for i in tied) or (get(drive, kind) and not there):
            return False
    chains = [get(chain, "name") for chain in elements(drive, "chains")] or [None]
    return all(get(of, "shaft") in [None, *names] and get(of, "chain") in chains for of in parts)


def _led_alike(parts: Sequence[Any], names: Sequence[str], tied: TiedRatios, count: int) -> Iterator[Problem]:
    """Constant speeds that are prescribed at two places fit each other by gears, shafts and chains."""
    first: dict[int, int] = {}
    for b, part in enumerate(parts):
        speed = get(get(part, "prescribed"), "speed")
        if not numbers(speed):
            continue
        other = first.setdefault(tied.root[b], b)
        known = get(get(parts[other], "prescribed"), "speed")
        fits = float(known) * float(abs(tied.ratio[b] / tied.ratio[other]))
        if abs(speed - fits) > SAME * max(abs(speed), abs(fits)):
            place = ("sprockets", b) if b < count else ("shafts", b - count)
            text = f'must fit that of "{names[other]}", which is prescribed, too, and turns it: {fits:.9g}'
            yield Problem((*place, "prescribed", "speed"), speed, text)


def _driven(drive: Any, names: Sequence[str], whole: bool) -> Iterator[Problem]:
    """Something turns every shaft, where all that ties bodies is known, and speeds at the start fit each other."""
    count = len(elements(drive, "sprockets"))
    parts = [*elements(drive, "sprockets"), *elements(drive, "shafts")]
    all_of, _ = ratios_with_chains(drive)
    keys = ("prescribed", "load", "motor", "initial_speed")
    moved = {root for root, part in zip(all_of.root, parts, strict=False) if any(get(part, key) for key in keys)}
    chains = elements(drive, "chains")
    if not chains:
        moved.add(all_of.root[-1])
    turned = {
        root for root, part in zip(all_of.root, parts, strict=False) if any(get(part, key) for key in DRIVING_KEYS)
    }
    whole = whole and bool(turned)
    on = [get(sprocket, "chain") for sprocket in elements(drive, "sprockets")]
    for c, chain in enumerate(chains if whole else ()):
        if all_of.root[len(parts) + c] not in turned and on.count(get(chain, "name")) > 1:
            text = "is turned by nothing: neither a sprocket of it, nor what that turns with, is prescribed or driven"
            yield Problem(("chains", c, "name"), get(chain, "name"), text)
    for b in range(count, len(parts) if whole else count):
        if all_of.root[b] not in moved:
            text = "nothing turns it: neither a sprocket on it, a gear or a coupling, nor a motor, load or prescribed"
            yield Problem(("shafts", b - count), None, text, BARE)
    tied, _ = ratios_with_chains(drive, couplings=False)
    yield from _led_alike(parts, names, tied, count)
    begun: dict[int, int] = {}
    for key in ("prescribed", "initial_speed"):
        for b, part in enumerate(parts):
            if get(part, key) is None:
                continue
            first = begun.setdefault(tied.root[b], b)
            speed, known = get(part, "initial_speed"), get(parts[first], "initial_speed")
            if first == b or key == "prescribed" or not numbers(speed):
                continue
            at = ("shafts", b - count, "initial_speed")
            if not numbers(known):
                yield Problem(at, speed, f'not where "{names[first]}" is prescribed, with which it turns')
                continue
            fits = float(known) * float(abs(tied.ratio[b] / tied.ratio[first]))
            if abs(speed - fits) > SAME * max(abs(speed), abs(fits)):
                yield Problem(at, speed, f'must fit that of "{names[first]}", with which it turns: {fits:.9g}')
