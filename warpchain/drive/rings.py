"""Each chain of a drive of several as a drive of its own, and the ratios of its shafts."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from warpchain.drive.chain_parts import PARTS, TRAIN_PARTS, Ring, by_own_angle, places_of, shaft_of
from warpchain.drive.geared import geared_rings
from warpchain.drive.sprocket import Led, Load, Prescribed, Sprocket
from warpchain.drive.trains import own_inertia, speed_ratio
from warpchain.drive.transmission import Transmission, is_geared, shafts_given, transmission_of, with_shafts
from warpchain.drive.turned import turned_on


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


def inertias_beyond(drive: Any) -> dict[str, float]:
    """Inertia of the chains that a sprocket's shaft turns, with that of their sprockets [kg m^2], by its name.

    Of geared drives nothing: there shafts that stand for the sprockets have it (`warpchain.drive.shafts.Beside`).
    """
    found: dict[str, float] = {}
    if is_geared(drive) or not drive.chains:
        return found
    rings, drive = {ring.name: ring for ring in rings_of(drive)}, shafts_given(drive)
    transmission = transmission_of(drive.sprockets)
    for name in reversed(transmission.leaders):
        ring, leader = rings[name].drive, drive.sprockets[transmission.leaders[name]]
        lead = rings[name].places["sprockets"].index(transmission.leaders[name])
        inertia = ring.chain.links * ring.chain.mass * ring.pitch_radius(lead) ** 2
        for s, sprocket in enumerate(ring.sprockets):
            if s != lead:
                own = own_inertia(ring, s) + found.get(sprocket.name, 0.0)
                inertia += own * (ring.sprockets[lead].teeth / sprocket.teeth) ** 2
        turning = next((s for s in companions(drive, leader) if _turned(rings, s) and s is not leader), None)
        if turning is not None:
            found[turning.name] = found.get(turning.name, 0.0) + inertia
    return found


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
