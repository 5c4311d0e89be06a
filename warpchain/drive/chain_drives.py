"""Each chain of a drive as a drive of its own, and the speed ratios of its shafts."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from warpchain.drive.geared_chain_drives import geared_chain_drives
from warpchain.drive.parts_by_chain import (
    CHAIN_PARTS,
    TRAIN_PARTS,
    ChainDrive,
    chain_part_places,
    motion_by_own_angle,
    shaft_of_sprocket,
)
from warpchain.drive.sprocket import LedSprocket, Load, Prescribed, Sprocket
from warpchain.drive.start_phase import motion_from_start_phase
from warpchain.drive.trains import body_speed_ratio, inertia_of_body
from warpchain.drive.transmission import (
    Transmission,
    drive_with_bare_shafts,
    is_geared,
    sprockets_with_shafts,
    transmission_of_sprockets,
)


def chain_drives(drive: Any) -> tuple[ChainDrive, ...]:
    """Each chain of a drive, or of a stack, as a drive of its own; a single chain is the drive itself."""
    if not drive.chains:
        return (
            ChainDrive(
                "", drive, {kind: tuple(range(len(getattr(drive, kind)))) for kind in (*CHAIN_PARTS, *TRAIN_PARTS)}
            ),
        )
    if is_geared(drive):
        return geared_chain_drives(drive)
    drive = drive_with_bare_shafts(drive)
    transmission = transmission_of_sprockets(drive.sprockets)
    first = next(s for s in drive.sprockets if s.prescribed is not None)
    begins = {shaft_of_sprocket(first): 1.0}
    found: dict[str, ChainDrive] = {}
    # in the order of motion: speeds at the start follow from those before
    for name, leader in transmission.leaders.items():
        chain_drive = found[name] = _chain_drive(drive, name, leader, transmission, begins)
        own = chain_drive.places["sprockets"]
        at = own.index(leader)
        begin = begins.setdefault(shaft_of_sprocket(drive.sprockets[leader]), 1.0)
        for k, s in enumerate(own):
            ratio = chain_drive.drive.riding_radius(at) / chain_drive.drive.riding_radius(k)
            begins.setdefault(shaft_of_sprocket(drive.sprockets[s]), begin * ratio)
    return tuple(found[chain.name] for chain in drive.chains)


def _chain_drive(
    drive: Any, name: str, leader: int, transmission: Transmission, begins: dict[str, float]
) -> ChainDrive:
    """The drive of one chain that a sprocket leads.

    Args:
        begins: speeds of shafts at the start over the driver's.
    """
    places = chain_part_places(drive, name)
    names = {drive.sprockets[s].name for s in places["sprockets"]}
    leads, first = drive.sprockets[leader], next(s for s in drive.sprockets if s.prescribed is not None)
    turned, run = float(transmission.speeds[shaft_of_sprocket(leads)]), drive.run
    if run.phase is not None:
        run = run.model_copy(update={"phase": run.phase * turned * leads.teeth / first.teeth})
    parts: dict[str, Any] = {kind: tuple(getattr(drive, kind)[i] for i in places[kind]) for kind in CHAIN_PARTS}
    sprockets = [_sprocket_turned_by_shaft(drive, drive.sprockets[s], names, transmission) for s in places["sprockets"]]
    if all(sprocket.prescribed is None for sprocket in sprockets):
        assert first.prescribed is not None
        at, own = places["sprockets"].index(leader), first.prescribed
        mean = Prescribed.model_construct(speed=turned * own.top_speed, ramp_time=own.ramp_time)
        beside = {s.name for s in drive.sprockets if s.chain == first.chain}
        motion = motion_from_start_phase(
            drive, first, _sprocket_motion_by_own_angle(own, drive, first, beside, transmission)
        )
        values = sprockets[at].__dict__ | {"prescribed": mean}
        sprockets[at] = LedSprocket.model_construct(
            **values, driver=motion, start_ratio=begins[shaft_of_sprocket(leads)]
        )
    parts["sprockets"] = tuple(sprockets)
    chain = next(chain for chain in drive.chains if chain.name == name)
    changes = {"chain": chain, "chains": (), "shafts": (), "run": run, **parts}
    return ChainDrive(name, drive.model_copy(update=changes), places | {kind: () for kind in TRAIN_PARTS})


def chain_driver_ratios(drive: Any) -> list[float]:
    """Speed of the sprocket that drives each chain over that of the drive's driver."""
    if not drive.chains:
        return [1.0]
    drivers = [chain.places["sprockets"][chain.drive.driver] for chain in chain_drives(drive)]
    if is_geared(drive):
        return [body_speed_ratio(drive, driver, drive.driver) for driver in drivers]
    speeds = transmission_of_sprockets(sprockets_with_shafts(drive)).speeds
    return [float(speeds[shaft_of_sprocket(drive.sprockets[driver])]) for driver in drivers]


def shaft_speed_ratios(drive: Any) -> dict[str, float]:
    """Speeds of the shafts over that of the driver, by name."""
    if is_geared(drive):
        count = len(drive.sprockets)
        return {shaft.name: body_speed_ratio(drive, b, drive.driver) for b, shaft in enumerate(drive.shafts, count)}
    speeds = transmission_of_sprockets(sprockets_with_shafts(drive)).speeds
    return {shaft.name: float(speeds[shaft.name]) for shaft in drive.shafts}


def loaded_chain_drives(drive: Any) -> tuple[ChainDrive, ...]:
    """Each chain as a drive of its own, its sprockets loaded by the steady loads of the chains that they turn.

    They are for figures before a run. A chain that is led takes its loads times the ratios of teeth.
    """
    if is_geared(drive):
        return geared_chain_drives(drive, loaded=True)
    chains, drive = chain_drives(drive), drive_with_bare_shafts(drive)
    if len(chains) == 1:
        return chains
    transmission, found = transmission_of_sprockets(drive.sprockets), {chain.name: chain for chain in chains}
    for name in reversed(transmission.leaders):
        leader = drive.sprockets[transmission.leaders[name]]
        turning = next(
            (s for s in sprockets_on_shaft_of(drive, leader) if _is_turned_by_chain(found, s) and s is not leader), None
        )
        if turning is None or leader.chain is None:
            continue
        moment = _leading_moment(found[name].drive, found[name].places["sprockets"].index(transmission.leaders[name]))
        found[str(turning.chain)] = _chain_drive_with_load(
            found[str(turning.chain)], drive.sprockets.index(turning), moment
        )
    return tuple(found[chain.name] for chain in chains)


def driven_chain_inertias(drive: Any) -> dict[str, float]:
    """Inertia of the chains that a sprocket's shaft turns, with their sprockets [kg m^2], by the sprocket's name.

    Empty for geared drives, whose shafts have it (`warpchain.drive.shafts.SprocketShaft`).
    """
    found: dict[str, float] = {}
    if is_geared(drive) or not drive.chains:
        return found
    chains, drive = {chain.name: chain for chain in chain_drives(drive)}, drive_with_bare_shafts(drive)
    transmission = transmission_of_sprockets(drive.sprockets)
    for name in reversed(transmission.leaders):
        chain, leader = chains[name].drive, drive.sprockets[transmission.leaders[name]]
        lead = chains[name].places["sprockets"].index(transmission.leaders[name])
        inertia = chain.chain.links * chain.chain.mass * chain.pitch_radius(lead) ** 2
        for s, sprocket in enumerate(chain.sprockets):
            if s != lead:
                own = inertia_of_body(chain, s) + found.get(sprocket.name, 0.0)
                inertia += own * (chain.sprockets[lead].teeth / sprocket.teeth) ** 2
        turning = next(
            (s for s in sprockets_on_shaft_of(drive, leader) if _is_turned_by_chain(chains, s) and s is not leader),
            None,
        )
        if turning is not None:
            found[turning.name] = found.get(turning.name, 0.0) + inertia
    return found


def _is_turned_by_chain(found: dict[str, ChainDrive], sprocket: Sprocket) -> bool:
    """Whether a sprocket's chain turns it, rather than it the chain."""
    chain = found[str(sprocket.chain)].drive
    mine = next(s for s in chain.sprockets if s.name == sprocket.name)
    return mine.prescribed is None


def _leading_moment(chain: Any, lead: int) -> float:
    """Moment [N m] that a chain's steady loads ask of the sprocket that leads it, its own load among them."""
    own = chain.sprockets[lead]
    assert own.prescribed is not None
    speed, moment = own.prescribed.top_speed, 0.0
    for sprocket in chain.sprockets:
        if sprocket.load is not None:
            ratio = own.teeth / sprocket.teeth
            moment = moment + sprocket.load.steady(speed * ratio) * ratio
    return moment


def _chain_drive_with_load(chain: ChainDrive, s: int, moment: float) -> ChainDrive:
    """A chain's drive with a further load on a sprocket, number s in the whole drive."""
    at, sprockets = chain.places["sprockets"].index(s), list(chain.drive.sprockets)
    load = sprockets[at].load or Load()
    sprockets[at] = sprockets[at].model_copy(update={"load": load.model_copy(update={"torque": load.torque + moment})})
    return replace(chain, drive=chain.drive.model_copy(update={"sprockets": tuple(sprockets)}))


def sprockets_on_shaft_of(drive: Any, sprocket: Sprocket) -> list[Sprocket]:
    """The sprockets that turn with a sprocket, it among them, in order."""
    if sprocket.shaft is None:
        return [sprocket]
    return [other for other in drive.sprockets if other.shaft == sprocket.shaft]


def _sprocket_turned_by_shaft(drive: Any, sprocket: Sprocket, names: set[str], transmission: Transmission) -> Sprocket:
    """A sprocket with the motion of its shaft, or with the inertia of all sprockets on it."""
    from warpchain.drive.mounts import wheel_inertia

    changes: dict[str, Any] = {}
    together = sprockets_on_shaft_of(drive, sprocket)
    motion = next((other.prescribed for other in together if other.prescribed is not None), None)
    if motion is not None:
        changes["prescribed"] = _sprocket_motion_by_own_angle(motion, drive, sprocket, names, transmission)
    elif len(together) > 1:
        whole = sum((0.0 if other.inertia is None else other.inertia) + wheel_inertia(other) for other in together)
        changes["inertia"] = whole - wheel_inertia(sprocket)
    if sprocket.load is not None:
        changes["load"] = _sprocket_motion_by_own_angle(sprocket.load, drive, sprocket, names, transmission)
    return sprocket.model_copy(update=changes) if changes else sprocket


def _sprocket_motion_by_own_angle(
    motion: Any, drive: Any, sprocket: Sprocket, names: set[str], transmission: Transmission
) -> Any:
    """A sprocket's motion or load whose harmonics and tables count shafts of its own chain, or its own."""

    def ratio(shaft: str) -> float:
        turns = next((shaft_of_sprocket(s) for s in drive.sprockets if s.name == shaft), shaft)
        return float(transmission.speeds[turns] / transmission.speeds[shaft_of_sprocket(sprocket)])

    return motion_by_own_angle(motion, names, ratio)
