"""Limits of the time step by the fastest oscillations of a drive."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from warpchain.drive import Drive
from warpchain.drive.body_ties import body_names, part_of_body
from warpchain.drive.sprocket import Sprocket
from warpchain.drive.stack_math import Number, is_true_somewhere, maximum, power, sqrt
from warpchain.errors import DriveError
from warpchain.model import ChainModel, Model, chains_of
from warpchain.model.mounts import is_on_springs, mount_spring, moving_mass
from warpchain.model.oil import oil_stiffness
from warpchain.model.parts_between_chains import SprocketShaft
from warpchain.model.stacks import pick_variants
from warpchain.model.trains import coupled_bodies, is_free_body, train_inertia, train_of_body

AUTOMATIC = 0.6
"""Automatic time step over its limit of stability (docs/solving.md)."""

STAGED = 0.3  # which hold bristles and dampers at step starts
"""Automatic time step over its limit for schemes with stages."""


@dataclass(frozen=True)
class MovingBody:
    """Springs and dampers on a moving body, along its fastest coordinate, for the time step.

    Attributes:
        name: of the body, and what holds it.
        square: omega^2 [1/s^2].
        rate: c/m of its dampers [1/s].
    """

    name: str
    square: float
    rate: float


def rocking_teeth(sprocket: Sprocket) -> Number:
    """Number of tooth contacts that stretch where a sprocket rocks."""
    return maximum(sprocket.teeth - 1, 1)


def moving_bodies(of: Drive | ChainModel, held: bool = False) -> list[MovingBody]:
    """Moving bodies of all chains for the time step: sprockets on springs, free sprockets unless `held`, arms.

    Sprockets of one shaft are one. The frequencies: docs/moving-sprockets.md, docs/solving.md.
    """
    return _moving_bodies(chains_of(of), held)


def _moving_bodies(chains: Sequence[ChainModel], held: bool = False) -> list[MovingBody]:
    """Moving bodies of a drive's chains, those of one shaft as one."""
    found: dict[str, MovingBody] = {}
    for body in (body for model in chains for body in _bodies_of_chain(model, held)):
        known = found.get(body.name)
        found[body.name] = body if known is None else replace(known, square=known.square + body.square,
                                                              rate=known.rate + body.rate)  # fmt: skip
    for model in chains if not held else ():
        beside = [_on_shaft(shaft.name) for shaft in model.shafts if isinstance(shaft, SprocketShaft)]
        for coupling in model.couplings:
            name = f'coupling "{coupling.name}"'
            more = [found[end].square for end in map(_on_shaft, coupling.between) if end in beside and end in found]
            found[name] = replace(found[name], square=found[name].square + sum(more))
    return list(found.values())


def _bodies_of_chain(model: ChainModel, held: bool) -> list[MovingBody]:
    """Moving bodies of one chain by itself."""
    found = []
    for s, sprocket in enumerate(model.sprockets):
        if is_on_springs(sprocket):
            mass = moving_mass(sprocket) + model.plunger_mass_on(s)
            stiffness, damping = mount_spring(sprocket)
            pushed, damped = _tensioner_pushes(model, s)
            stiffness = stiffness + 0.5 * sprocket.teeth * model.sprocket_stiffness(s) + pushed
            found.append(
                MovingBody(f'sprocket "{sprocket.name}" on its mount', stiffness / mass, (damping + damped) / mass)
            )
    for s, sprocket in enumerate(model.sprockets):
        if not held and is_free_body(model, s) and not is_on_springs(sprocket):
            inertia = train_inertia(model, s)
            turning = rocking_teeth(sprocket) * model.sprocket_stiffness(s) * power(model.pitch_radius(s), 2)
            shaft = _shared_shaft(model, s)  # of all its chains: `moving_bodies`
            name = f'sprocket "{sprocket.name}"' if shaft is None else _on_shaft(shaft)
            found.append(MovingBody(name, turning / inertia, 0.0))
    found += [] if held else _coupling_bodies(model)
    for a, arm in enumerate(model.arms):
        inertia = model.arm_inertia(a)
        pushed, damped = _tensioner_pushes(model, model.first_arm_body + a)
        stiffness, damping = arm.stiffness + pushed, arm.damping + damped
        if arm.spring is not None:
            square = power(arm.spring_lever, 2)
            stiffness, damping = stiffness + arm.spring.stiffness * square, damping + arm.spring.damping * square
        if arm.stops is not None:
            stiffness, damping = stiffness + model.stop_stiffness(a), damping + model.stop_damping(a)
        for g in model.guides_of(a):
            points = model.profile(g).points(model.chain.pitch, caps=False)
            each = (1 + model.chain.is_silent) * model.guide_stiffness(g)  # of a back, too
            stiffness = stiffness + each * sum(math.dist(point, arm.pivot) ** 2 for point in points)
        for s in model.sprockets_on(a):
            pushed = 0.5 * model.sprockets[s].teeth * model.sprocket_stiffness(s)
            stiffness = stiffness + pushed * power(model.center_lever(s), 2)
        found.append(MovingBody(f'arm "{arm.name}"', stiffness / inertia, damping / inertia))
    return _bodies_with_joints(model, found)


def _bodies_with_joints(model: ChainModel, found: list[MovingBody]) -> list[MovingBody]:
    """Moving bodies with arms on arms joined: inertia I_1 I_2 - (d.s)^2 over the other's."""
    first = len(found) - len(model.arms)
    for p, arm in enumerate(model.arms):
        row, own, left = model.arms_on(p), model.arm_inertia(p), 1.0
        square, rate = found[first + p].square, found[first + p].rate
        for k in row:
            (px, py), inertia = model.arms[k].pivot, model.arm_inertia(k)
            moment = math.hypot(*(sum(m * (c[i] - (px, py)[i]) for m, c in model.masses_on(k)) for i in (0, 1)))
            left -= (math.dist((px, py), arm.pivot) * moment) ** 2 / (own * inertia)
            square += found[first + k].square * (1.0 + inertia / own)
            rate += found[first + k].rate * (1.0 + inertia / own)
        for k in (p, *row) if row else ():
            found[first + k] = replace(found[first + k], square=square / left, rate=rate / left)
    return found


def _coupling_bodies(model: ChainModel) -> list[MovingBody]:
    """Moving bodies of couplings, k (1/J_a + i^2/J_b), steep motors and valves."""
    found = _valve_bodies(model)
    for coupling in model.couplings:
        ends = coupled_bodies(model, coupling)
        turns = [(b, i) for b, i in zip(ends, (1.0, coupling.largest_ratio), strict=True) if b >= 0]
        give = sum(i * i / train_inertia(model, b) for b, i in turns if is_free_body(model, b))
        square = coupling.stiffness * give
        for s, _ in turns:
            if s < len(model.sprockets) and is_free_body(model, s):
                teeth = rocking_teeth(model.sprockets[s]) * model.sprocket_stiffness(s)
                square = square + teeth * power(model.pitch_radius(s), 2) / train_inertia(model, s)
        steep = 0.0 if coupling.clutch is None else coupling.clutch.steepest_change
        found.append(MovingBody(f'coupling "{coupling.name}"', square, (coupling.damping + steep) * give))
    for h, shaft in enumerate(model.shafts):
        b = len(model.sprockets) + h
        if shaft.motor is not None and is_free_body(model, b):
            found.append(
                MovingBody(f'the motor of "{shaft.name}"', 0.0, shaft.motor.steepest_fall / train_inertia(model, b))
            )
    return found


def _valve_bodies(model: ChainModel) -> list[MovingBody]:
    """Moving bodies of valve springs on free shafts and sprockets."""
    found = []
    for valves in model.valves:
        b = body_names(model).index(valves.on)
        if is_free_body(model, b):
            stiffness = valves.torsional_stiffness
            if b < len(model.sprockets):
                teeth = rocking_teeth(model.sprockets[b]) * model.sprocket_stiffness(b)
                stiffness = stiffness + teeth * power(model.pitch_radius(b), 2)
            found.append(MovingBody(f'valves "{valves.name}"', stiffness / train_inertia(model, b), 0.0))
    return found


def _on_shaft(name: str) -> str:
    """Name of a shaft as a moving body."""
    return f'shaft "{name}"'


def _shared_shaft(model: ChainModel, s: int) -> str | None:
    """Shaft, or train's first body, that sprocket s shares with other chains, or None."""
    shaft = model.sprockets[s].shaft
    if shaft is not None and shaft not in body_names(model):
        return shaft
    train = train_of_body(model, s).bodies
    shared = any(isinstance(part_of_body(model, b), SprocketShaft) for b in train)
    return body_names(model)[train[0]] if shared else None


def _tensioner_pushes(model: ChainModel, body: int) -> tuple[float, float]:
    """Stiffness and damping of a body's tensioners [N/m], [N s/m]; of an arm times levers squared."""
    stiffness = damping = 0.0
    for t, tensioner in enumerate(model.tensioners):
        if model.tensioner_body(t) == body:
            lever = model.tensioner_lever(t)
            held = tensioner.spring_stiffness + oil_stiffness(tensioner)
            held = held + (model.chain.stiffness if tensioner.ratchet is not None or tensioner.hydraulic else 0.0)
            stiffness = stiffness + held * power(lever, 2)
            damping = damping + tensioner.spring_damping * power(lever, 2)
    return stiffness, damping


def _contact_stiffnesses(model: ChainModel) -> list[tuple[str, float]]:
    """Contact partners of rollers: name and stiffness [N/m]."""
    ends = 4.0 if model.chain.is_silent else 1.0  # of its two links four flanks, whose forces act on a pin and the next
    teeth = [(f'the teeth of "{of.name}"', ends * model.sprocket_stiffness(s)) for s, of in enumerate(model.sprockets)]
    backs = 3.0 if model.chain.is_silent else 1.0  # of a pin and, where these lean on it, of the backs of its two links
    return teeth + [(f'guide "{guide.name}"', backs * model.guide_stiffness(g)) for g, guide in enumerate(model.guides)]


def highest_frequency(of: Drive | ChainModel, damped_links: bool = True, held: bool = False) -> float:
    """Highest frequency of a drive's rollers and bodies, omega_max [rad/s] (docs/solving.md).

    With `damped_links` g + sqrt(g^2 + omega_max^2), g = (c_inner + c_outer) / m.
    """
    chains = chains_of(of)
    return _highest_of_chains(chains, _moving_bodies(chains, held), damped_links)


def _highest_of_chains(chains: Sequence[ChainModel], bodies: Sequence[MovingBody], damped_links: bool = True) -> float:
    """Highest frequency of chains with moving bodies [rad/s]."""
    return maximum(*(_highest_of_chain(model, bodies, damped_links) for model in chains))


def _highest_of_chain(model: ChainModel, bodies: Sequence[MovingBody], damped_links: bool = True) -> float:
    """Highest frequency of one chain with moving bodies [rad/s]."""
    mass = model.chain.lightest_mass
    half_rate = (model.chain.link_damping + model.chain.outer_damping) / mass if damped_links else 0.0
    stiffest = maximum(0.0, *(stiffness for _, stiffness in _contact_stiffnesses(model)))
    springs = 2.0 * (model.chain.stiffness + model.chain.outer_stiffness)
    square = (springs + stiffest) / mass + maximum(0.0, *(body.square for body in bodies))
    return half_rate + sqrt(half_rate * half_rate + square)


def stiffest_part(drive: Drive) -> str:
    """Name of the part that needs the shortest time step."""
    chains = Model(drive).chains
    bodies = _moving_bodies(chains)
    slowest = max(chains, key=lambda model: _highest_of_chain(model, bodies))
    fastest = max(bodies, key=lambda body: body.square + body.rate * body.rate, default=MovingBody("", 0.0, 0.0))
    held = _highest_of_chain(slowest, [])
    if len(chains) > 1 and fastest.square + fastest.rate * fastest.rate > held * held:
        return fastest.name
    return _stiffest_of_chain(slowest) + (f', chain "{slowest.name}"' if slowest.name else "")


def _stiffest_of_chain(model: ChainModel) -> str:
    """Name of the part of one chain that needs the shortest time step."""
    chain, mass = model.chain, model.chain.lightest_mass
    springs = 2.0 * (chain.stiffness + chain.outer_stiffness) / mass
    points = "pins" if chain.is_silent else "rollers"
    parts = {f"{points} on {name}": stiffness / mass for name, stiffness in _contact_stiffnesses(model)}
    parts = {name: square for name, square in parts.items() if square == max(parts.values())}
    parts[f"{points} between two links"] = springs
    links = 2.0 * (chain.link_damping + chain.outer_damping) / mass
    parts["the dampers of the links"] = links * links
    parts |= {body.name: body.square + body.rate * body.rate for body in moving_bodies(model)}
    return max(parts, key=parts.__getitem__)


def step_limit(of: Drive | ChainModel, held: bool = False) -> float:
    """Largest stable time step of leapfrog [s] (docs/solving.md); `held` as of `moving_bodies`."""
    chains = chains_of(of)
    bodies = _moving_bodies(chains, held)
    omega = _highest_of_chains(chains, bodies)
    rate = maximum(0.0, *(body.rate for body in bodies))
    return 4.0 / (rate + sqrt(rate * rate + 4.0 * omega * omega))


def automatic_step(drive: Drive) -> float:
    """Time step that "auto" stands for [s]."""
    return (AUTOMATIC if drive.run.integrator == "leapfrog" else STAGED) * step_limit(drive)


def resolve_step(drive: Drive, step: float | str | None = None) -> float:
    """Time step to take, `step` or the drive's own, () or (V,) [s].

    Raises:
        DriveError: a step that is not positive or not below the limit, of the first such variant.
    """
    asked = drive.run.step if step is None else step
    if isinstance(asked, str):
        if asked != "auto":
            raise DriveError(f'run.step = "{asked}": must be a positive number or "auto"')
        found = automatic_step(drive)
        if is_true_somewhere(~np.greater(found, 0.0)):
            raise DriveError(f'run.step = "{asked}": no step is so small; look at stiffness, damping and mass')
        return found
    limit = step_limit(drive)
    wrong = ~(np.isfinite(asked) & np.greater(asked, 0.0) & np.less(asked, limit))
    if wrong.ndim and wrong.any():
        resolve_step(pick_variants(drive, int(wrong.argmax())), step)
    if is_true_somewhere(wrong):
        raise DriveError(
            f"run.step = {asked:g}: must be above 0 and below {limit:.6g} s, 2 / sqrt((4 k + K_max) / m), less for "
            f'dampers and bodies; or "auto", {automatic_step(drive):.6g} s; stiffest is {stiffest_part(drive)}'
        )
    return asked
