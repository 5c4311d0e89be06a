"""Drives of several chains with gears, couplings, motors, valves or shafts without sprockets: each as one of its own.

Bodies that shafts, gears and couplings tie are a group. It is part of one chain, its home: of the one that turns it, or
of the first that it turns. There its sprockets of other chains are shafts (`warpchain.drive.shafts.Beside`), so that
the home is a drive of one chain with all of the group. In the other chains such a sprocket has the inertia of its
train, and is led or prescribed as that is. In a run it turns as the shaft that it is at home (`joined`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Any, NamedTuple

from warpchain.drive.chain_parts import PARTS, Ring, by_own_angle, places_of
from warpchain.drive.shafts import Beside
from warpchain.drive.sprocket import Led, Load, Prescribed, Sprocket
from warpchain.drive.trains import (
    Ratios,
    leader_of,
    names_of,
    own_inertia,
    seen_inertia,
    ties,
    train_of,
    turned_part,
    with_chain,
)
from warpchain.drive.transmission import OF_GROUPS
from warpchain.drive.turned import turned_on

DRIVING = ("prescribed", "motor", "initial_speed")
"""What makes a body drive, the strongest first."""


class Start(NamedTuple):
    """Speed of a body at the start: that of a motion, and how fast the body turns beside it."""

    motion: Prescribed
    ratio: Any


class _Plan:
    """The way of motion through the chains and groups of a drive.

    Attributes:
        group: of each body, a number that those tied to it have, too.
        leaders: of each chain the sprocket that leads it, in the order of motion.
        home: of each group, its chain.
    """

    def __init__(self, drive: Any) -> None:
        self.drive, self.count = drive, len(drive.sprockets)
        self.names, self.tied = names_of(drive), with_chain(drive)[0]
        groups = Ratios(len(self.names))
        for tie in ties(drive):
            groups.tie(tie.a, tie.b, Fraction(1))
        self.group = groups.root
        self.leaders: dict[str, int] = {}
        self.home: dict[int, str] = {}
        parts = list(enumerate((*drive.sprockets, *drive.shafts)))
        driving = [b for key in DRIVING for b, part in parts if getattr(part, key, None) is not None]
        order = list(dict.fromkeys(self.group[b] for b in driving))
        for group in order:  # which grows
            for chain in drive.chains:
                on = self.of_chain(chain.name)
                leader = next((s for s in on if self.group[s] == group), None)
                if leader is not None and chain.name not in self.leaders:
                    self.leaders[chain.name] = leader
                    for s in (leader, *on):
                        self.home.setdefault(self.group[s], chain.name)
                        order += [] if self.group[s] in order else [self.group[s]]
        for group in self.group:
            self.home.setdefault(group, drive.chains[0].name)

    def of_chain(self, name: str) -> list[int]:
        """Sprockets of a chain."""
        return [s for s, sprocket in enumerate(self.drive.sprockets) if sprocket.chain == name]

    def at_home(self, b: int) -> str:
        """Name of the chain that body b is part of, as a shaft or a sprocket on its own."""
        return self.home[self.group[b]]

    def speed(self, b: int, other: int) -> float:
        """Forward speed of body b over that of another."""
        alike = self.tied.root[b] == self.tied.root[other]
        return abs(float(self.tied.ratio[b] / self.tied.ratio[other])) if alike else 1.0

    def mates(self, b: int) -> list[int]:
        """The bodies of b's group."""
        return [other for other, group in enumerate(self.group) if group == self.group[b]]

    def beyond(self, s: int) -> tuple[list[int], list[str]]:
        """Bodies that are turned by way of sprocket s, which leads its chain, and chains."""
        chains, bodies = [name for name, leader in self.leaders.items() if leader == s], list[int]()
        for name in chains:  # which grows
            new = [b for b in self._turned_by(name) if b not in bodies]
            bodies += new
            chains += [other for other, leader in self.leaders.items() if leader in new and other not in chains]
        return bodies, chains

    def _turned_by(self, name: str) -> list[int]:
        """Bodies of the groups that a chain turns."""
        leader = self.leaders[name]
        groups = {self.group[s] for s in self.of_chain(name)} - {self.group[leader]}
        return [b for b, group in enumerate(self.group) if group in groups and self.home[group] == name]


def geared_rings(drive: Any, loaded: bool = False) -> tuple[Ring, ...]:
    """The chains of such a drive, each as a drive of its own.

    Args:
        loaded: whether shafts that stand for other chains' sprockets have the loads that these turn.
    """
    plan, found = _Plan(drive), dict[str, Ring]()
    starts: dict[str, Start] = {}
    for name in plan.leaders:
        found[name] = _ring(plan, name, found, starts, loaded)
        starts[name] = _start(plan, plan.leaders[name], found, starts)
    return tuple(found[chain.name] for chain in drive.chains)


def joined(drive: Any, rings: Sequence[Ring]) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """Bodies of two chains that are one, as (chain, body): the shaft of its home, and the sprocket."""
    sprockets = {
        drive.sprockets[s].name: (r, k) for r, ring in enumerate(rings) for k, s in enumerate(ring.places["sprockets"])
    }
    return [
        ((r, b), sprockets[shaft.name])
        for r, ring in enumerate(rings)
        for b, shaft in enumerate(ring.drive.shafts, len(ring.drive.sprockets))
        if isinstance(shaft, Beside)
    ]


def bodies_of(drive: Any, ring: Ring) -> list[int]:
    """Places in the whole drive of a chain's own bodies; a shaft that stands for another chain's sprocket has that
    one's."""
    count, names = len(drive.sprockets), [sprocket.name for sprocket in drive.sprockets]
    shafts = [count + h for h in ring.places["shafts"]]
    shafts += [names.index(shaft.name) for shaft in ring.drive.shafts if isinstance(shaft, Beside)]
    return [*ring.places["sprockets"], *shafts, *(drive.first_arm_body + a for a in ring.places["arms"])]


def own_shafts(drive: Any) -> list[Any]:
    """The shafts of a chain's own drive that are none of another chain's sprockets; they stand first."""
    return [shaft for shaft in drive.shafts if not isinstance(shaft, Beside)]


def _ring(plan: _Plan, name: str, found: dict[str, Ring], starts: dict[str, Start], loaded: bool) -> Ring:
    """A chain, after those before it in the order of motion."""
    drive, count, places = plan.drive, plan.count, places_of(plan.drive, name)
    mine = [b for b in range(len(plan.names)) if plan.at_home(b) == name]
    places["shafts"] = tuple(b - count for b in mine if b >= count)
    for kind in OF_GROUPS:
        first = [plan.names.index(getattr(part, "on", None) or part.between[0]) for part in getattr(drive, kind)]
        places[kind] = tuple(i for i, b in enumerate(first) if b in mine)
    beside = [s for s in mine if s < count and s not in places["sprockets"]]
    bodies = [*places["sprockets"], *(h + count for h in places["shafts"]), *beside]
    names = {plan.names[b] for b in bodies}
    sprockets = [
        drive.sprockets[s].model_copy(update=_motions(plan, s, names)) if s in mine else _apart(plan, s, names)
        for s in places["sprockets"]
    ]
    leader, run = plan.leaders[name], drive.run
    at = places["sprockets"].index(leader)
    if sprockets[at].prescribed is None and leader not in mine:
        sprockets[at] = _led(plan, leader, sprockets[at], found, starts)
    if run.phase is not None:
        turned = plan.speed(leader, drive.driver) * drive.sprockets[leader].teeth / drive.sprockets[drive.driver].teeth
        run = run.model_copy(update={"phase": run.phase * turned})
    shafts = [drive.shafts[h].model_copy(update=_motions(plan, h + count, names)) for h in places["shafts"]]
    shafts += [_beside(plan, s, names, loaded) for s in beside]
    changes = {"chain": next(chain for chain in drive.chains if chain.name == name), "chains": (), "run": run}
    changes |= {kind: tuple(getattr(drive, kind)[i] for i in places[kind]) for kind in (*PARTS, *OF_GROUPS)}
    changes |= {"sprockets": tuple(sprockets), "shafts": tuple(shafts)}
    return Ring(name, drive.model_copy(update=changes), places)


def _motions(plan: _Plan, b: int, names: set[str]) -> dict[str, Any]:
    """Motion, load and motor of body b, by the angles of bodies of its chain."""
    part = turned_part(plan.drive, b)
    given = {key: getattr(part, key, None) for key in ("prescribed", "load", "motor")}
    return {key: by_own_angle(of, names, _beside_own(plan, b)) for key, of in given.items() if of is not None}


def _beside_own(plan: _Plan, b: int) -> Any:
    """Speed of a body by name over that of body b."""
    return lambda name: plan.speed(plan.names.index(name), b)


def _apart(plan: _Plan, s: int, names: set[str]) -> Sprocket:
    """Sprocket s in a chain that is not its home: with the inertia and the motion of its train."""
    from warpchain.drive.mounts import wheel_inertia  # here, since it takes numpy

    drive, sprocket = plan.drive, plan.drive.sprockets[s]
    led_by, first = leader_of(drive, s), train_of(drive, s).bodies[0]
    changes = _motions(plan, s, names) | {"shaft": plan.names[first], "prescribed": None}
    changes["inertia"] = seen_inertia(drive, s) - wheel_inertia(sprocket)
    if led_by is not None:
        changes["prescribed"] = _as_fast(plan, led_by[0], s, names)
    found: Sprocket = sprocket.model_copy(update=changes)
    return found


def _as_fast(plan: _Plan, leader: int, b: int, names: set[str]) -> Prescribed:
    """The motion of a body as that of body b, which turns with it in a fixed ratio."""
    own = by_own_angle(turned_part(plan.drive, leader).prescribed, names, _beside_own(plan, leader))
    ratio, table = plan.speed(b, leader), own.table
    if table is not None:
        changes = {"factor": table.factor * ratio}
        if table.angle is not None and table.shaft is None:
            changes["angle"] = tuple(x * ratio for x in table.angle)
        table = table.model_copy(update=changes)
    turns = [h if h.shaft is not None else h.model_copy(update={"order": h.order / ratio}) for h in own.harmonics]
    speed = None if own.speed is None else own.speed * ratio
    motion: Prescribed = own.model_copy(update={"speed": speed, "table": table, "harmonics": tuple(turns)})
    return motion


def _led(plan: _Plan, s: int, sprocket: Sprocket, found: dict[str, Ring], starts: dict[str, Start]) -> Led:
    """Sprocket s, which leads its chain and which another chain turns."""
    home = found[plan.at_home(s)]
    turned = plan.speed(s, home.places["sprockets"][home.drive.driver])
    start = _start(plan, s, found, starts)
    mean = Prescribed.model_construct(speed=turned * home.drive.driver_speed, ramp_time=start.motion.ramp_time)
    values = sprocket.__dict__ | {"prescribed": mean}
    return Led.model_construct(**values, driver=start.motion, start_ratio=start.ratio)


def _start(plan: _Plan, b: int, found: dict[str, Ring], starts: dict[str, Start]) -> Start:
    """Speed of body b at the start: as shafts and gears tie it, else chains, else couplings."""
    for other in (b, *plan.mates(b)):
        start = _own_start(plan, other, found, starts)
        if start is not None:
            return Start(start.motion, start.ratio * plan.speed(b, other))
    return Start(Prescribed.model_construct(speed=0.0), 1.0)


def _own_start(plan: _Plan, b: int, found: dict[str, Ring], starts: dict[str, Start]) -> Start | None:
    """Speed of body b at the start, as its train or a chain around it has it; None where that is not known."""
    train = train_of(plan.drive, b).bodies
    for other in train:
        part, home = turned_part(plan.drive, other), found.get(plan.at_home(other))
        if part.prescribed is not None and home is not None:
            own = next(of for of in (*home.drive.sprockets, *home.drive.shafts) if of.name == part.name)
            return Start(turned_on(home.drive, own, own.prescribed), plan.speed(b, other))
        if getattr(part, "initial_speed", None) is not None:
            return Start(Prescribed.model_construct(speed=part.initial_speed), plan.speed(b, other))
    for other in (s for s in train if s < plan.count):
        chain = str(plan.drive.sprockets[other].chain)
        if chain in starts:
            ring = found[chain]
            lead, own = (ring.places["sprockets"].index(s) for s in (plan.leaders[chain], other))
            radii = ring.drive.riding_radius(lead) / ring.drive.riding_radius(own)
            return Start(starts[chain].motion, starts[chain].ratio * radii * plan.speed(b, other))
    return None


def _beside(plan: _Plan, s: int, names: set[str], loaded: bool) -> Beside:
    """Sprocket s as a shaft of its home."""
    drive, sprocket = plan.drive, plan.drive.sprockets[s]
    bodies, chains = plan.beyond(s)
    own = _motions(plan, s, names)
    asks: Load = own.get("load") or Load()
    parts = {key: getattr(asks, key) for key in ("torque", "viscous", "quadratic")}
    beyond = 0.0
    for b in bodies:
        part, r = turned_part(drive, b), plan.speed(b, s)
        if leader_of(drive, b) is None:
            beyond += r * r * own_inertia(drive, b)
            if part.load is not None:
                for power, key in enumerate(parts, 1):
                    parts[key] += r**power * getattr(part.load, key)
    for chain in (chain for chain in drive.chains if chain.name in chains):
        leader = plan.leaders[chain.name]
        radius = chain.pitch / (2.0 * math.sin(math.pi / drive.sprockets[leader].teeth))
        beyond += chain.links * chain.mass * (radius * plan.speed(leader, s)) ** 2
    asks = asks.model_copy(update=parts)
    return Beside.model_construct(
        name=sprocket.name,
        inertia=own_inertia(drive, s),
        prescribed=own.get("prescribed"),
        load=asks if loaded else None,
        shaft=sprocket.shaft,
        asks=asks,
        beyond=beyond,
    )
