"""Models of a drive's chains, each with its parts.

Bodies tied by shafts, gears and couplings are a group. Its home is the chain that turns it, or the first that it turns;
there its other sprockets are shafts (`SprocketShaft`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from fractions import Fraction
from functools import cache
from typing import Any, NamedTuple

from warpchain.drive import Drive
from warpchain.drive.body_ties import DRIVING_KEYS, TiedRatios, body_names, body_ties, part_of_body, ratios_with_chains
from warpchain.drive.sprocket import Load, Prescribed, Sprocket
from warpchain.drive.stack_math import Number
from warpchain.model.chain_model import ChainModel
from warpchain.model.chain_parts import (
    CHAIN_PARTS,
    GROUP_PARTS,
    TRAIN_PARTS,
    chain_part_places,
    motion_by_own_angle,
)
from warpchain.model.mounts import wheel_inertia
from warpchain.model.parts_between_chains import LedSprocket, SprocketShaft
from warpchain.model.start_phase import motion_from_start_phase
from warpchain.model.trains import inertia_of_body, prescribed_leader, train_inertia, train_of_body


class StartMotion(NamedTuple):
    """Start motion of a body, and the body's ratio to it."""

    motion: Prescribed
    ratio: Number


class _MotionPlan:
    """Order of motion through chains and groups.

    Attributes:
        group: of each body, by number.
        leaders: leading sprockets by chain, in this order.
        home: chain of each group.
    """

    def __init__(self, drive: Drive) -> None:
        self.drive, self.count = drive, len(drive.sprockets)
        self.names, self.tied = body_names(drive), ratios_with_chains(drive)[0]
        groups = TiedRatios(len(self.names))
        for tie in body_ties(drive):
            groups.tie(tie.a, tie.b, Fraction(1))
        self.group = groups.root
        self.leaders: dict[str, int] = {}
        self.home: dict[int, str] = {}
        parts = list(enumerate((*drive.sprockets, *drive.shafts)))
        driving = [b for key in DRIVING_KEYS for b, part in parts if getattr(part, key, None) is not None]
        order = list(dict.fromkeys(self.group[b] for b in driving))
        for group in order:  # which grows
            for chain in drive.chains:
                on = self.chain_sprockets(chain.name)
                leader = next((s for s in on if self.group[s] == group), None)
                if leader is not None and chain.name not in self.leaders:
                    self.leaders[chain.name] = leader
                    for s in (leader, *on):
                        self.home.setdefault(self.group[s], chain.name)
                        order += [] if self.group[s] in order else [self.group[s]]
        for group in self.group:
            self.home.setdefault(group, drive.chains[0].name)

    def chain_sprockets(self, name: str) -> list[int]:
        """Indices of a chain's sprockets in the drive."""
        return [s for s, sprocket in enumerate(self.drive.sprockets) if sprocket.chain == name]

    def home_chain(self, b: int) -> str:
        """Name of body b's home chain."""
        return self.home[self.group[b]]

    def speed_ratio(self, b: int, other: int) -> float:
        """Forward speed of a body over another's; 1 if untied."""
        alike = self.tied.root[b] == self.tied.root[other]
        return abs(float(self.tied.ratio[b] / self.tied.ratio[other])) if alike else 1.0

    def group_bodies(self, b: int) -> list[int]:
        """Bodies of body b's group."""
        return [other for other, group in enumerate(self.group) if group == self.group[b]]

    def bodies_and_chains_beyond(self, s: int) -> tuple[list[int], list[str]]:
        """Bodies and chains turned through leading sprocket s."""
        chains, bodies = [name for name, leader in self.leaders.items() if leader == s], list[int]()
        for name in chains:  # which grows
            new = [b for b in self._bodies_turned_by_chain(name) if b not in bodies]
            bodies += new
            chains += [other for other, leader in self.leaders.items() if leader in new and other not in chains]
        return bodies, chains

    def _bodies_turned_by_chain(self, name: str) -> list[int]:
        """Bodies of the groups that a chain turns."""
        leader = self.leaders[name]
        groups = {self.group[s] for s in self.chain_sprockets(name)} - {self.group[leader]}
        return [b for b, group in enumerate(self.group) if group in groups and self.home[group] == name]


def chain_models(drive: Drive, loaded: bool = False) -> tuple[ChainModel, ...]:
    """Models of a drive's or stack's chains, `SprocketShaft`s with loads where `loaded`."""
    if not drive.chains:
        parts = {kind: getattr(drive, kind) for kind in (*CHAIN_PARTS, *TRAIN_PARTS)}
        places = _own_places(tuple(map(len, parts.values())))
        return (ChainModel("", drive.chain, contact=drive.contact, run=drive.run, places=places, **parts),)
    plan, found = _MotionPlan(drive), dict[str, ChainModel]()
    starts: dict[str, StartMotion] = {}
    for name in plan.leaders:
        found[name] = _chain_model(plan, name, found, starts, loaded)
        starts[name] = _start_motion(plan, plan.leaders[name], found, starts)
    return tuple(found[chain.name] for chain in drive.chains)


@cache
def _own_places(counts: tuple[int, ...]) -> Mapping[str, tuple[int, ...]]:
    """Indices of a single chain's parts, by list."""
    return {kind: tuple(range(count)) for kind, count in zip((*CHAIN_PARTS, *TRAIN_PARTS), counts, strict=True)}


def _chain_model(
    plan: _MotionPlan, name: str, found: dict[str, ChainModel], starts: dict[str, StartMotion], loaded: bool
) -> ChainModel:
    """Model of a chain after those before it in motion."""
    drive, count, places = plan.drive, plan.count, chain_part_places(plan.drive, name)
    mine = [b for b in range(len(plan.names)) if plan.home_chain(b) == name]
    places["shafts"] = tuple(b - count for b in mine if b >= count)
    for kind in GROUP_PARTS:
        # of two bodies, which are of one group, the second: the first may be the ground
        last = [plan.names.index(getattr(part, "on", None) or part.between[1]) for part in getattr(drive, kind)]
        places[kind] = tuple(i for i, b in enumerate(last) if b in mine)
    beside = [s for s in mine if s < count and s not in places["sprockets"]]
    bodies = [*places["sprockets"], *(h + count for h in places["shafts"]), *beside]
    names = {plan.names[b] for b in bodies}
    sprockets = [
        drive.sprockets[s].model_copy(update=_motions_by_own_angle(plan, s, names))
        if s in mine
        else _sprocket_away_from_home(plan, s, names)
        for s in places["sprockets"]
    ]
    leader, run = plan.leaders[name], drive.run
    at = places["sprockets"].index(leader)
    if sprockets[at].prescribed is None and leader not in mine:
        sprockets[at] = _led_sprocket(plan, leader, sprockets[at], found, starts)
    if run.phase is not None:
        turned = (
            plan.speed_ratio(leader, drive.driver) * drive.sprockets[leader].teeth / drive.sprockets[drive.driver].teeth
        )
        run = run.model_copy(update={"phase": run.phase * turned})
    shafts = [
        drive.shafts[h].model_copy(update=_motions_by_own_angle(plan, h + count, names)) for h in places["shafts"]
    ]
    shafts += [_sprocket_as_home_shaft(plan, s, names, loaded) for s in beside]
    chain = next(chain for chain in drive.chains if chain.name == name)
    parts = {kind: tuple(getattr(drive, kind)[i] for i in places[kind]) for kind in (*CHAIN_PARTS, *GROUP_PARTS)}
    parts |= {"sprockets": tuple(sprockets), "shafts": tuple(shafts)}
    return ChainModel(name, chain, contact=drive.contact, run=run, places=places, **parts)


def _motions_by_own_angle(plan: _MotionPlan, b: int, names: set[str]) -> dict[str, Any]:
    """Motion, load and motor of body b over its chain's angles."""
    part = part_of_body(plan.drive, b)
    given = {key: getattr(part, key, None) for key in ("prescribed", "load", "motor")}
    return {
        key: motion_by_own_angle(of, names, _speed_ratio_by_name(plan, b))
        for key, of in given.items()
        if of is not None
    }


def _speed_ratio_by_name(plan: _MotionPlan, b: int) -> Any:
    """Function of a body's name: its speed over body b's."""
    return lambda name: plan.speed_ratio(plan.names.index(name), b)


def _sprocket_away_from_home(plan: _MotionPlan, s: int, names: set[str]) -> Sprocket:
    """Sprocket s away from its home chain, with its train's inertia and motion."""
    drive, sprocket = plan.drive, plan.drive.sprockets[s]
    led_by, first = prescribed_leader(drive, s), train_of_body(drive, s).bodies[0]
    changes = _motions_by_own_angle(plan, s, names) | {"shaft": plan.names[first], "prescribed": None}
    changes["inertia"] = train_inertia(drive, s) - wheel_inertia(sprocket)
    if led_by is not None:
        changes["prescribed"] = _motion_at_ratio(plan, led_by[0], s, names)
    found: Sprocket = sprocket.model_copy(update=changes)
    return found


def _motion_at_ratio(plan: _MotionPlan, leader: int, b: int, names: set[str]) -> Prescribed:
    """Prescribed motion of body b by its leader's."""
    own = motion_by_own_angle(part_of_body(plan.drive, leader).prescribed, names, _speed_ratio_by_name(plan, leader))
    ratio, table = plan.speed_ratio(b, leader), own.table
    if table is not None:
        changes = {"factor": table.factor * ratio}
        if table.angle is not None and table.shaft is None:
            changes["angle"] = tuple(x * ratio for x in table.angle)
        table = table.model_copy(update=changes)
    turns = [h if h.shaft is not None else h.model_copy(update={"order": h.order / ratio}) for h in own.harmonics]
    speed = None if own.speed is None else own.speed * ratio
    motion: Prescribed = own.model_copy(update={"speed": speed, "table": table, "harmonics": tuple(turns)})
    return motion


def _led_sprocket(
    plan: _MotionPlan, s: int, sprocket: Sprocket, found: dict[str, ChainModel], starts: dict[str, StartMotion]
) -> LedSprocket:
    """Leading sprocket of a chain that another chain turns."""
    home = found[plan.home_chain(s)]
    turned = plan.speed_ratio(s, home.places["sprockets"][home.driver])
    start = _start_motion(plan, s, found, starts)
    mean = Prescribed.model_construct(speed=turned * home.driver_speed, ramp_time=start.motion.ramp_time)
    values = sprocket.__dict__ | {"prescribed": mean}
    return LedSprocket.model_construct(**values, driver=start.motion, start_ratio=start.ratio)


def _start_motion(
    plan: _MotionPlan, b: int, found: dict[str, ChainModel], starts: dict[str, StartMotion]
) -> StartMotion:
    """Start motion of body b by ties, chains or couplings."""
    for other in (b, *plan.group_bodies(b)):
        start = _train_start_motion(plan, other, found, starts)
        if start is not None:
            return StartMotion(start.motion, start.ratio * plan.speed_ratio(b, other))
    return StartMotion(Prescribed.model_construct(speed=0.0), 1.0)


def _train_start_motion(
    plan: _MotionPlan, b: int, found: dict[str, ChainModel], starts: dict[str, StartMotion]
) -> StartMotion | None:
    """Start motion of body b by its train or chains, or None."""
    train = train_of_body(plan.drive, b).bodies
    for other in train:
        part, home = part_of_body(plan.drive, other), found.get(plan.home_chain(other))
        if part.prescribed is not None and home is not None:
            bodies: tuple[Any, ...] = (*home.sprockets, *home.shafts)
            lead = next(of for of in bodies if of.name == part.name)
            return StartMotion(motion_from_start_phase(home, lead, lead.prescribed), plan.speed_ratio(b, other))
        if getattr(part, "initial_speed", None) is not None:
            return StartMotion(Prescribed.model_construct(speed=part.initial_speed), plan.speed_ratio(b, other))
    for other in (s for s in train if s < plan.count):
        chain = str(plan.drive.sprockets[other].chain)
        if chain in starts:
            on = found[chain]
            first, own = (on.places["sprockets"].index(s) for s in (plan.leaders[chain], other))
            radii = on.riding_radius(first) / on.riding_radius(own)
            return StartMotion(starts[chain].motion, starts[chain].ratio * radii * plan.speed_ratio(b, other))
    return None


def _sprocket_as_home_shaft(plan: _MotionPlan, s: int, names: set[str], loaded: bool) -> SprocketShaft:
    """Shaft that stands for sprocket s in its home chain."""
    drive, sprocket = plan.drive, plan.drive.sprockets[s]
    bodies, chains = plan.bodies_and_chains_beyond(s)
    own = _motions_by_own_angle(plan, s, names)
    demand: Load = own.get("load") or Load()
    parts = {key: getattr(demand, key) for key in ("torque", "viscous", "quadratic")}
    driven_inertia = 0.0
    for b in bodies:
        part, r = part_of_body(drive, b), plan.speed_ratio(b, s)
        if prescribed_leader(drive, b) is None:
            driven_inertia += r * r * inertia_of_body(drive, b)
            if part.load is not None:
                for power, key in enumerate(parts, 1):
                    parts[key] += r**power * getattr(part.load, key)
    for chain in (chain for chain in drive.chains if chain.name in chains):
        leader = plan.leaders[chain.name]
        radius = chain.pitch / (2.0 * math.sin(math.pi / drive.sprockets[leader].teeth))
        driven_inertia += chain.links * chain.mass * (radius * plan.speed_ratio(leader, s)) ** 2
    demand = demand.model_copy(update=parts)
    return SprocketShaft.model_construct(
        name=sprocket.name,
        inertia=inertia_of_body(drive, s),
        prescribed=own.get("prescribed"),
        load=demand if loaded else None,
        shaft=sprocket.shaft,
        demand=demand,
        driven_inertia=driven_inertia,
    )
