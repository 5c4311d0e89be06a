"""Drives of several chains: the parts of each chain, ratios of shafts, and each chain as a drive of its own.

With z_c teeth of the sprocket by which chain c is led, and z_d of the driver, a shaft turns

    r = (z_d / z_1) (z_2 / z_3) ...                                                                             (a)

times as fast as the driver, z_1 on the shaft that the first chain leads, z_2 on the same shaft for the next, and so on.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

from warpchain.drive.chain_parts import PARTS, TRAIN_PARTS, Ring, by_own_angle, places_of, shaft_of
from warpchain.drive.geared import geared_rings, is_geared
from warpchain.drive.schema import elements, get
from warpchain.drive.shafts import Shaft
from warpchain.drive.sprocket import Led, Load, Prescribed, Sprocket
from warpchain.drive.trains import speed_ratio
from warpchain.drive.turned import turned_on


def with_shafts(drive: Any) -> list[Any]:
    """The sprockets of a drive; of several chains the first on each shaft has what that has: its motion or load, and
    its inertia on top. Drives may be mappings, as for rules.
    """
    sprockets = list(elements(drive, "sprockets"))
    of_several = elements(drive, "shafts") if elements(drive, "chains") else ()
    for shaft in of_several:
        named = (s for s, sprocket in enumerate(sprockets) if get(sprocket, "shaft") == get(shaft, "name"))
        first = next(named, None)
        if first is not None:
            sprockets[first] = _with_shaft(sprockets[first], shaft)
    return sprockets


def _with_shaft(sprocket: Any, shaft: Any) -> Any:
    """A sprocket with what its shaft has."""
    own = {key: value for key in ("prescribed", "load", "inertia") if (value := get(shaft, key)) is not None}
    if not isinstance(sprocket, Sprocket):
        return {**sprocket, **own} if isinstance(sprocket, Mapping) else sprocket
    if sprocket.inertia is not None and "inertia" in own:
        own["inertia"] = sprocket.inertia + own["inertia"]
    return sprocket.model_copy(update=own) if own else sprocket


def shafts_given(drive: Any) -> Any:
    """A drive of several chains with `with_shafts`, after which shafts are names; of one chain, itself."""
    if not drive.chains:
        return drive
    shafts = tuple(Shaft.model_construct(name=shaft.name) for shaft in drive.shafts)
    return drive.model_copy(update={"sprockets": tuple(with_shafts(drive)), "shafts": shafts})


@dataclass(frozen=True)
class Contradiction:
    """Two ways from a shaft to another with unlike ratios.

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
    """Order in which motion goes through the chains.

    Attributes:
        speeds: of each shaft that the driver turns, over the driver's, (a).
        leaders: of each chain that is turned, the index of the sprocket that leads it; in order.
        contradictions: none, in a drive that is allowed.
    """

    speeds: dict[str, Fraction]
    leaders: dict[str, int]
    contradictions: tuple[Contradiction, ...]


def transmission_of(sprockets: Sequence[Any]) -> Transmission:
    """The transmission of sprockets whose chains, shafts and teeth are sound, from the first that is prescribed."""
    chains = dict.fromkeys(get(sprocket, "chain") for sprocket in sprockets)
    moved = {shaft_of(s) for s in sprockets if get(s, "prescribed") is not None}
    first = next(s for s in sprockets if get(s, "prescribed") is not None)
    speeds, leaders, wrong = {shaft_of(first): Fraction(1)}, dict[str, int](), list[Contradiction]()
    while len(leaders) < len(chains):
        led = _next(sprockets, [chain for chain in chains if chain not in leaders], (moved, set(speeds)))
        if led is None:
            break
        chain, leader = led
        leaders[chain] = leader
        begin, teeth = shaft_of(sprockets[leader]), get(sprockets[leader], "teeth")
        speeds.setdefault(begin, Fraction(1))
        for sprocket in (s for s in sprockets if get(s, "chain") == chain and shaft_of(s) != begin):
            end, ratio = shaft_of(sprocket), Fraction(teeth, get(sprocket, "teeth"))
            if end in speeds and speeds[end] != speeds[begin] * ratio and end not in moved:
                known = speeds[end] / speeds[begin]
                pair = {shaft_of(s) for s in sprockets if get(s, "chain") == chain} & {begin, end}
                before = [c for c in leaders if c != chain and pair <= _shafts(sprockets, c)]
                names = (*before[:1], chain)
                wrong.append(Contradiction(names, (begin, end), (known, ratio), Fraction(teeth) / known))
            speeds.setdefault(end, speeds[begin] * ratio)
    return Transmission(speeds, leaders, tuple(wrong))


def _shafts(sprockets: Sequence[Any], chain: str) -> set[str]:
    return {shaft_of(s) for s in sprockets if get(s, "chain") == chain}


def _next(sprockets: Sequence[Any], todo: Sequence[str], ways: Sequence[set[str]]) -> tuple[str, int] | None:
    """The next chain that is turned, and by which sprocket; shafts of the first of `ways` come first."""
    for turning in ways:
        for chain in todo:
            for s, sprocket in enumerate(sprockets):
                if get(sprocket, "chain") == chain and shaft_of(sprocket) in turning:
                    return chain, s
    return None


def rings_of(drive: Any) -> tuple[Ring, ...]:
    """The chains of a drive, or of a stack of drives, each as a drive of its own; of one chain, the drive itself."""
    if not drive.chains:
        return (Ring("", drive, {kind: tuple(range(len(getattr(drive, kind)))) for kind in (*PARTS, *TRAIN_PARTS)}),)
    if is_geared(drive):
        return geared_rings(drive)
    drive = shafts_given(drive)
    transmission = transmission_of(drive.sprockets)
    first = next(s for s in drive.sprockets if s.prescribed is not None)
    begins = {shaft_of(first): 1.0}
    found: dict[str, Ring] = {}
    # in the order of motion: speeds at the start follow from those before
    for name, leader in transmission.leaders.items():
        ring = found[name] = _ring(drive, name, leader, transmission, begins)
        own = ring.places["sprockets"]
        at = own.index(leader)
        begin = begins.setdefault(shaft_of(drive.sprockets[leader]), 1.0)
        for k, s in enumerate(own):
            ratio = ring.drive.riding_radius(at) / ring.drive.riding_radius(k)
            begins.setdefault(shaft_of(drive.sprockets[s]), begin * ratio)
    return tuple(found[chain.name] for chain in drive.chains)


def _ring(drive: Any, name: str, leader: int, transmission: Transmission, begins: dict[str, float]) -> Ring:
    """A chain that a sprocket leads; `begins` are speeds of shafts at the start over the driver's."""
    places = places_of(drive, name)
    names = {drive.sprockets[s].name for s in places["sprockets"]}
    leads, first = drive.sprockets[leader], next(s for s in drive.sprockets if s.prescribed is not None)
    turned, run = float(transmission.speeds[shaft_of(leads)]), drive.run
    if run.phase is not None:
        run = run.model_copy(update={"phase": run.phase * turned * leads.teeth / first.teeth})
    parts: dict[str, Any] = {kind: tuple(getattr(drive, kind)[i] for i in places[kind]) for kind in PARTS}
    sprockets = [_sprocket(drive, drive.sprockets[s], names, transmission) for s in places["sprockets"]]
    if all(sprocket.prescribed is None for sprocket in sprockets):
        assert first.prescribed is not None
        at, own = places["sprockets"].index(leader), first.prescribed
        mean = Prescribed.model_construct(speed=turned * own.top_speed, ramp_time=own.ramp_time)
        beside = {s.name for s in drive.sprockets if s.chain == first.chain}
        motion = turned_on(drive, first, _by_own_angle(own, drive, first, beside, transmission))
        values = sprockets[at].__dict__ | {"prescribed": mean}
        sprockets[at] = Led.model_construct(**values, driver=motion, start_ratio=begins[shaft_of(leads)])
    parts["sprockets"] = tuple(sprockets)
    chain = next(chain for chain in drive.chains if chain.name == name)
    changes = {"chain": chain, "chains": (), "shafts": (), "run": run, **parts}
    return Ring(name, drive.model_copy(update=changes), places | {kind: () for kind in TRAIN_PARTS})


def driver_ratios(drive: Any) -> list[float]:
    """Speed of the sprocket that drives each chain, over that of the drive's driver."""
    if not drive.chains:
        return [1.0]
    drivers = [ring.places["sprockets"][ring.drive.driver] for ring in rings_of(drive)]
    if is_geared(drive):
        return [speed_ratio(drive, driver, drive.driver) for driver in drivers]
    speeds = transmission_of(with_shafts(drive)).speeds
    return [float(speeds[shaft_of(drive.sprockets[driver])]) for driver in drivers]


def shaft_ratios(drive: Any) -> dict[str, float]:
    """Speeds of the shafts over that of the driver, by name."""
    if is_geared(drive):
        count = len(drive.sprockets)
        return {shaft.name: speed_ratio(drive, b, drive.driver) for b, shaft in enumerate(drive.shafts, count)}
    speeds = transmission_of(with_shafts(drive)).speeds
    return {shaft.name: float(speeds[shaft.name]) for shaft in drive.shafts}


def loaded_rings(drive: Any) -> tuple[Ring, ...]:
    """The chains as `rings_of`, with the steady loads of the chains that each turns on its own sprockets.

    A chain that is led takes its loads times the ratios of teeth, and what else is on its shaft. Before a run only.
    """
    if is_geared(drive):
        return geared_rings(drive, loaded=True)
    rings, drive = rings_of(drive), shafts_given(drive)
    if len(rings) == 1:
        return rings
    transmission, found = transmission_of(drive.sprockets), {ring.name: ring for ring in rings}
    for name in reversed(transmission.leaders):
        leader = drive.sprockets[transmission.leaders[name]]
        turning = next((s for s in companions(drive, leader) if _turned(found, s) and s is not leader), None)
        if turning is None or leader.chain is None:
            continue
        moment = _demand(found[name].drive, found[name].places["sprockets"].index(transmission.leaders[name]))
        found[str(turning.chain)] = _with_load(found[str(turning.chain)], drive.sprockets.index(turning), moment)
    return tuple(found[ring.name] for ring in rings)


def _turned(found: dict[str, Ring], sprocket: Sprocket) -> bool:
    """Whether a sprocket's chain turns it, rather than it the chain."""
    ring = found[str(sprocket.chain)].drive
    mine = next(s for s in ring.sprockets if s.name == sprocket.name)
    return mine.prescribed is None


def _demand(ring: Any, lead: int) -> float:
    """Moment [N m] that the steady loads of a chain ask of the sprocket that leads it, its own load among them."""
    own = ring.sprockets[lead]
    assert own.prescribed is not None
    speed, moment = own.prescribed.top_speed, 0.0
    for sprocket in ring.sprockets:
        if sprocket.load is not None:
            ratio = own.teeth / sprocket.teeth
            moment = moment + sprocket.load.steady(speed * ratio) * ratio
    return moment


def _with_load(ring: Ring, s: int, moment: float) -> Ring:
    """A chain with a further load on a sprocket, the `s`th of the whole drive."""
    at, sprockets = ring.places["sprockets"].index(s), list(ring.drive.sprockets)
    load = sprockets[at].load or Load()
    sprockets[at] = sprockets[at].model_copy(update={"load": load.model_copy(update={"torque": load.torque + moment})})
    return replace(ring, drive=ring.drive.model_copy(update={"sprockets": tuple(sprockets)}))


def companions(drive: Any, sprocket: Sprocket) -> list[Sprocket]:
    """The sprockets that turn with one, it among them, in order."""
    if sprocket.shaft is None:
        return [sprocket]
    return [other for other in drive.sprockets if other.shaft == sprocket.shaft]


def _sprocket(drive: Any, sprocket: Sprocket, names: set[str], transmission: Transmission) -> Sprocket:
    """A sprocket with what its shaft has, the motion or the inertia of all that turns."""
    from warpchain.drive.mounts import wheel_inertia

    changes: dict[str, Any] = {}
    together = companions(drive, sprocket)
    motion = next((other.prescribed for other in together if other.prescribed is not None), None)
    if motion is not None:
        changes["prescribed"] = _by_own_angle(motion, drive, sprocket, names, transmission)
    elif len(together) > 1:
        whole = sum((0.0 if other.inertia is None else other.inertia) + wheel_inertia(other) for other in together)
        changes["inertia"] = whole - wheel_inertia(sprocket)
    if sprocket.load is not None:
        changes["load"] = _by_own_angle(sprocket.load, drive, sprocket, names, transmission)
    return sprocket.model_copy(update=changes) if changes else sprocket


def _by_own_angle(motion: Any, drive: Any, sprocket: Sprocket, names: set[str], transmission: Transmission) -> Any:
    """`by_own_angle` of a sprocket's motion or load."""

    def ratio(shaft: str) -> float:
        turns = next((shaft_of(s) for s in drive.sprockets if s.name == shaft), shaft)
        return float(transmission.speeds[turns] / transmission.speeds[shaft_of(sprocket)])

    return by_own_angle(motion, names, ratio)
