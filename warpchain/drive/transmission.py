"""The order in which motion goes through the chains of a drive, and the speed ratios of shafts.

With z_c teeth of the sprocket by which chain c is led, and z_d of the driver, a shaft turns

    r = (z_d / z_1) (z_2 / z_3) ...                                                                             (a)

times as fast as the driver, z_1 on the shaft that the first chain leads, z_2 on the same shaft for the next, and so on.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from warpchain.drive.parts_by_chain import shaft_of_sprocket
from warpchain.drive.schema import node_list, node_value
from warpchain.drive.shafts import Shaft
from warpchain.drive.sprocket import Sprocket
from warpchain.drive.trains import body_names, body_ties

GROUP_PARTS = ("gears", "couplings", "valves")
"""Lists of a drive whose parts each belong to one group of tied bodies."""


def is_geared(drive: Any) -> bool:
    """Whether a drive of several chains, or a mapping of one, has more than sprockets on shafts."""
    shafts = node_list(drive, "shafts")
    if not node_list(drive, "chains"):
        return False
    on = [node_value(sprocket, "shaft") for sprocket in node_list(drive, "sprockets")]
    bare = any(node_value(shaft, "name") not in on for shaft in shafts)
    driven = any(node_value(shaft, key) is not None for shaft in shafts for key in ("motor", "initial_speed"))
    return bare or driven or any(node_list(drive, kind) for kind in GROUP_PARTS)


def rotation_owners(drive: Any) -> dict[str, str]:
    """Names of the parts as which sprockets turn, their shaft or the first sprocket on it, by sprocket.

    It is the first sprocket where shafts are not recorded (`warpchain.results.channels`).
    """
    names, first, found = body_names(drive), dict[str, str](), dict[str, str]()
    recorded = not drive.chains or is_geared(drive)
    for tie in body_ties(drive):
        if tie.kind == "shaft":
            shaft, sprocket = names[tie.a], names[tie.b]
            found[sprocket] = shaft if recorded else first.setdefault(shaft, sprocket)
    return {sprocket: part for sprocket, part in found.items() if sprocket != part}


def sprockets_with_shafts(drive: Any) -> list[Any]:
    """The sprockets of a drive or mapping; the first on each shaft has the shaft's motion, load and inertia.

    Of a drive with one chain they are as they stand.
    """
    sprockets = list(node_list(drive, "sprockets"))
    of_several = node_list(drive, "shafts") if node_list(drive, "chains") else ()
    for shaft in of_several:
        named = (
            s for s, sprocket in enumerate(sprockets) if node_value(sprocket, "shaft") == node_value(shaft, "name")
        )
        first = next(named, None)
        if first is not None:
            sprockets[first] = _sprocket_with_shaft(sprockets[first], shaft)
    return sprockets


def _sprocket_with_shaft(sprocket: Any, shaft: Any) -> Any:
    """A sprocket with the motion and load of its shaft, and its inertia on top."""
    own = {key: value for key in ("prescribed", "load", "inertia") if (value := node_value(shaft, key)) is not None}
    if not isinstance(sprocket, Sprocket):
        return {**sprocket, **own} if isinstance(sprocket, Mapping) else sprocket
    if sprocket.inertia is not None and "inertia" in own:
        own["inertia"] = sprocket.inertia + own["inertia"]
    return sprocket.model_copy(update=own) if own else sprocket


def drive_with_bare_shafts(drive: Any) -> Any:
    """A drive of several chains whose shafts are names, what they have on their first sprockets; of one, itself."""
    if not drive.chains:
        return drive
    shafts = tuple(Shaft.model_construct(name=shaft.name) for shaft in drive.shafts)
    return drive.model_copy(update={"sprockets": tuple(sprockets_with_shafts(drive)), "shafts": shafts})


@dataclass(frozen=True)
class RatioContradiction:
    """Two ways from a shaft to another with unlike speed ratios.

    Attributes:
        chains: the names of those that go both ways directly, one where the other way is longer.
        shafts: that one, and the other.
        ratios: of the other's speed over the one's, each way.
        teeth: that the last sprocket would need.
    """

    chains: tuple[str, ...]
    shafts: tuple[str, str]
    ratios: tuple[Fraction, Fraction]
    teeth: Fraction


@dataclass(frozen=True)
class Transmission:
    """The order in which motion goes through the chains of a drive.

    Attributes:
        speeds: of each shaft that the driver turns, over the driver's, (a).
        leaders: of each chain that is turned, the index of the sprocket that leads it; in order.
        contradictions: none, in a drive that is allowed.
    """

    speeds: dict[str, Fraction]
    leaders: dict[str, int]
    contradictions: tuple[RatioContradiction, ...]


def transmission_of_sprockets(sprockets: Sequence[Any]) -> Transmission:
    """The transmission of sprockets whose chains, shafts and teeth are sound, from the first that is prescribed."""
    chains = dict.fromkeys(node_value(sprocket, "chain") for sprocket in sprockets)
    moved = {shaft_of_sprocket(s) for s in sprockets if node_value(s, "prescribed") is not None}
    first = next(s for s in sprockets if node_value(s, "prescribed") is not None)
    speeds, leaders, wrong = {shaft_of_sprocket(first): Fraction(1)}, dict[str, int](), list[RatioContradiction]()
    while len(leaders) < len(chains):
        led = _next_turned_chain(sprockets, [chain for chain in chains if chain not in leaders], (moved, set(speeds)))
        if led is None:
            break
        chain, leader = led
        leaders[chain] = leader
        begin, teeth = shaft_of_sprocket(sprockets[leader]), node_value(sprockets[leader], "teeth")
        speeds.setdefault(begin, Fraction(1))
        for sprocket in (s for s in sprockets if node_value(s, "chain") == chain and shaft_of_sprocket(s) != begin):
            end, ratio = shaft_of_sprocket(sprocket), Fraction(teeth, node_value(sprocket, "teeth"))
            if end in speeds and speeds[end] != speeds[begin] * ratio and end not in moved:
                known = speeds[end] / speeds[begin]
                pair = _shafts_of_chain(sprockets, chain) & {begin, end}
                before = [c for c in leaders if c != chain and pair <= _shafts_of_chain(sprockets, c)]
                names = (*before[:1], chain)
                wrong.append(RatioContradiction(names, (begin, end), (known, ratio), Fraction(teeth) / known))
            speeds.setdefault(end, speeds[begin] * ratio)
    return Transmission(speeds, leaders, tuple(wrong))


def _shafts_of_chain(sprockets: Sequence[Any], chain: str) -> set[str]:
    """The shafts of a chain's sprockets."""
    return {shaft_of_sprocket(s) for s in sprockets if node_value(s, "chain") == chain}


def _next_turned_chain(
    sprockets: Sequence[Any], todo: Sequence[str], ways: Sequence[set[str]]
) -> tuple[str, int] | None:
    """The next chain that is turned, and the sprocket that leads it; shafts of the first of `ways` come first."""
    for turning in ways:
        for chain in todo:
            for s, sprocket in enumerate(sprockets):
                if node_value(sprocket, "chain") == chain and shaft_of_sprocket(sprocket) in turning:
                    return chain, s
    return None
