"""Forces on the housing, frame by frame: at hubs, guides' bolts, arms' pivots, tensioners' seats (docs/interchange.md).

With F what rollers, tensioners and weight do to a body of mass m and acceleration a, its bearing passes on F - m a; a
balance wheel adds m_b r_b (omega^2 e - alpha e').
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpchain.drive.sprocket import ArmMount, ElasticMount, PrescribedMount, Sprocket
from warpchain.errors import SimulationError
from warpchain.model.mounts import unit_direction
from warpchain.results.arm_pivots import arm_pivots
from warpchain.results.chains import chain_trajectories
from warpchain.results.nearest_parts import nearest_guides_of_rollers
from warpchain.results.run import Trajectory, require_channels
from warpchain.results.shaft_signals import hub_forces
from warpchain.results.signals import order_spectrum

if TYPE_CHECKING:
    import pyarrow as pa

    from warpchain.model import ChainModel

Array = NDArray[np.float64]

LEVEL_REFERENCE = 1e-6
"""Effective value at 0 dB [N] (ISO 1683)."""


class HousingLoad(NamedTuple):
    """Load on the housing at one place, over frames."""

    name: str  # "hub NAME", "bolt NAME N", "guide NAME", "pivot NAME" or "seat NAME"
    place: tuple[float, float]  # [m]
    force: Array  # (F, 2) along x and y [N]
    moment: Array | None = None  # (F,) about the place [N m]


def housing_loads(trajectory: Trajectory) -> list[HousingLoad]:
    """Loads on the housing at hubs, guides, pivots and seats.

    Raises:
        SimulationError: recorded without positions, contact forces, or motion of bodies.
    """
    return [load for part in chain_trajectories(trajectory).values() for load in _chain_housing_loads(part)]


def _chain_housing_loads(trajectory: Trajectory) -> list[HousingLoad]:
    """Loads on the housing by the parts of one chain."""
    model = trajectory.model
    on_hubs, guides = hub_forces(trajectory), _guide_forces_and_moments(trajectory)
    hubs = [_hub_bearing_force(trajectory, s, on_hubs[:, s]) for s in range(len(model.sprockets))]
    found = [
        HousingLoad(f"hub {sprocket.name}", sprocket.center, hubs[s])
        for s, sprocket in enumerate(model.sprockets)
        if not isinstance(sprocket.mount, ArmMount)
    ]
    for g, (force, moment) in enumerate(guides):
        if model.arm_of(g) is None:
            found += _bolt_loads(model, g, force, moment)
    on_arms = [_pivot_load(trajectory, a, hubs, guides) for a in range(len(model.arms))]
    for a, load in enumerate(on_arms):
        if model.parent(a) is None:
            force = load.force + sum((on_arms[k].force for k in model.arms_on(a)), np.zeros_like(load.force))
            coil = _coil_force(trajectory, a)
            found.append(load._replace(force=force + coil))
            spring = model.arms[a].spring
            if spring is not None:
                found.append(HousingLoad(f"spring {model.arms[a].name}", spring.anchor, -coil))
    for t, tensioner in enumerate(model.tensioners):
        (push,) = require_channels(trajectory, "tensioner_force")
        found.append(
            HousingLoad(f"seat {tensioner.name}", tensioner.at, -np.outer(push[:, t], tensioner.unit_direction))
        )
    return found


def _hub_bearing_force(trajectory: Trajectory, s: int, chain: Array) -> Array:
    """Force (F, 2) [N] of a sprocket's bearing on the housing."""
    center, angle, speed = require_channels(trajectory, "sprocket_center", "sprocket_angle", "sprocket_speed")
    sprocket, time = trajectory.model.sprockets[s], trajectory.time
    mass, gravity = sprocket.mass or 0.0, np.asarray(trajectory.model.run.gravity)
    force, mount = chain + mass * gravity, sprocket.mount
    if sprocket.balance_wheel is not None:
        force = force + _balance_wheel_force(
            sprocket, np.asarray(angle[:, s], float), np.asarray(speed[:, s], float), time
        )
        force += sprocket.balance_wheel.mass * gravity
    place = np.asarray(center[:, s], dtype=float)
    if isinstance(mount, ArmMount | PrescribedMount):
        return np.asarray(force - mass * _time_derivative(_time_derivative(place, time), time))
    if mount.kind == "fixed":
        return force
    off, v = place - np.asarray(sprocket.center), _time_derivative(place, time)
    if isinstance(mount, ElasticMount):
        held = off * mount.stiffness + v * mount.damping - np.asarray(mount.preload)
        return np.asarray(held)
    along = unit_direction(mount.direction)
    across = np.array([-along[1], along[0]])
    slide = mount.stiffness * (off @ along) + mount.damping * (v @ along) - mount.preload
    return np.outer(slide, along) + np.outer(force @ across, across)


def _balance_wheel_force(sprocket: Sprocket, angle: Array, speed: Array, time: Array) -> Array:
    """Inertia force (F, 2) [N] of a sprocket's balance wheel."""
    wheel = sprocket.balance_wheel
    assert wheel is not None
    points = np.stack([np.cos(angle + wheel.phase), np.sin(angle + wheel.phase)], axis=-1)
    turned = np.stack([-points[:, 1], points[:, 0]], axis=-1)
    size = wheel.mass * wheel.radius
    return np.asarray(size * ((speed**2)[:, None] * points - _time_derivative(speed, time)[:, None] * turned))


def _time_derivative(values: Array, time: Array) -> Array:
    """Time derivative (F, ...) of samples."""
    return np.gradient(values, time, axis=0) if len(time) > 1 else np.zeros_like(values)


def _guide_forces_and_moments(trajectory: Trajectory) -> list[tuple[Array, Array]]:
    """Chain's force (F, 2) [N] and moment (F,) [N m] on each guide."""
    position, guide_force = require_channels(trajectory, "position", "guide_force")
    frame, roller = np.nonzero(guide_force > 0.0)
    nearest, normal = nearest_guides_of_rollers(trajectory, frame, roller)
    x = np.asarray(position, dtype=float)[frame, roller]
    push = -np.asarray(guide_force, dtype=float)[frame, roller][:, None] * normal
    moment, count = x[:, 0] * push[:, 1] - x[:, 1] * push[:, 0], len(trajectory.time)
    found = []
    for g in range(len(trajectory.model.guides)):
        mine = nearest == g
        sums = [np.bincount(frame[mine], values[mine], minlength=count) for values in (*push.T, moment)]
        found.append((np.stack(sums[:2], axis=-1).astype(float), np.asarray(sums[2], dtype=float)))
    return found


def _bolt_loads(model: ChainModel, g: int, force: Array, moment: Array) -> list[HousingLoad]:
    """Loads on the housing by a guide's bolts, or its face."""
    guide = model.guides[g]
    if not guide.bolts:
        middle = model.profile(g).points(model.chain.pitch, caps=False)
        at = middle[len(middle) // 2]
        return [
            HousingLoad(f"guide {guide.name}", (float(at[0]), float(at[1])), force, _moment_about(at, force, moment))
        ]
    places = np.asarray(guide.bolts, dtype=float)
    mean = places.mean(axis=0)
    whole, r = _moment_about(mean, force, moment), places - mean
    square = float((r**2).sum())
    found = []
    for i, place in enumerate(places):
        share = force / len(places)
        if square > 0.0:
            share = share + np.outer(whole / square, [-r[i, 1], r[i, 0]])
        left = None if square > 0.0 else whole
        found.append(HousingLoad(f"bolt {guide.name} {i + 1}", (float(place[0]), float(place[1])), share, left))
    return found


def _moment_about(place: Array, force: Array, moment: Array) -> Array:
    """Moment (F,) [N m] of a housing load about another place."""
    return np.asarray(moment - (place[0] * force[:, 1] - place[1] * force[:, 0]))


def _pivot_load(trajectory: Trajectory, a: int, hubs: list[Array], guides: list[tuple[Array, Array]]) -> HousingLoad:
    """Load on the housing by an arm's pivot."""
    model, time = trajectory.model, trajectory.time
    arm = model.arms[a]
    arm_angle, arm_speed = require_channels(trajectory, "arm_angle", "arm_speed")
    angle, speed = np.asarray(arm_angle[:, a], dtype=float), np.asarray(arm_speed[:, a], dtype=float)
    turning = _time_derivative(speed, time)
    r = np.subtract(arm.center, arm.pivot)
    c, s = np.cos(angle), np.sin(angle)
    mass_at = np.stack([c * r[0] - s * r[1], s * r[0] + c * r[1]], axis=-1)
    turned = np.stack([-mass_at[:, 1], mass_at[:, 0]], axis=-1)
    acceleration = turning[:, None] * turned - (speed**2)[:, None] * mass_at
    if arm.pivot_table is not None or arm.arm is not None:
        acceleration += _time_derivative(_time_derivative(arm_pivots(model, time, arm_angle)[:, a], time), time)
    force = arm.mass * (np.asarray(model.run.gravity) - acceleration)
    force = force + sum((guides[g][0] for g in model.guides_of(a)), np.zeros_like(force))
    force = force + sum((hubs[s] for s in model.sprockets_on(a)), np.zeros_like(force))
    for t, tensioner in enumerate(model.tensioners):
        if model.tensioner_body(t) == model.first_arm_body + a:
            push, extension = require_channels(trajectory, "tensioner_force", "tensioner_extension")
            stroke = _time_derivative(_time_derivative(np.asarray(extension[:, t], dtype=float), time), time)
            own = np.asarray(push[:, t], dtype=float) - tensioner.plunger_mass * stroke
            force = force + np.outer(own, tensioner.unit_direction)
    return HousingLoad(f"pivot {arm.name}", arm.pivot, force)


def _coil_force(trajectory: Trajectory, a: int) -> Array:
    """Force (F, 2) [N] of an arm's coil spring."""
    arm = trajectory.model.arms[a]
    arm_angle, arm_speed = require_channels(trajectory, "arm_angle", "arm_speed")
    angle, speed = np.asarray(arm_angle[:, a], dtype=float), np.asarray(arm_speed[:, a], dtype=float)
    if arm.spring is None:
        return np.zeros((len(angle), 2))
    (x, y), anchor = np.subtract(arm.spring.at, arm.pivot), np.subtract(arm.spring.anchor, arm.pivot)
    c, s = np.cos(angle), np.sin(angle)
    end = np.stack([c * x - s * y, s * x + c * y], axis=-1)
    length = np.hypot(*(end - anchor).T)
    along = (end - anchor) / length[:, None]
    rate = speed * (end[:, 0] * along[:, 1] - end[:, 1] * along[:, 0])
    tension = arm.spring.stiffness * (length - arm.spring.free_length) + arm.spring.damping * rate
    return np.asarray(-tension[:, None] * along)


def order_levels(trajectory: Trajectory) -> pa.Table:
    """Pyarrow table of housing loads' levels [dB] by order.

    Raises:
        SimulationError: a driver that stops, turns back or turns too little.
    """
    import pyarrow as pa

    columns: dict[str, Array] = {}
    for name, values in housing_components(trajectory).items():
        found = order_spectrum(trajectory, values)
        if found is None:
            raise SimulationError("orders: the driver must turn one way in the latter half, by at least a few teeth")
        columns.setdefault("order", found[0])
        with np.errstate(divide="ignore"):
            columns[name] = 20.0 * np.log10(found[1] / np.sqrt(2.0) / LEVEL_REFERENCE)
    from warpchain.results.arrow_tables import table_with_units

    units = {name: "1" if name == "order" else f"dB re 1 u{_component_unit(name)}" for name in columns}
    return table_with_units({name: pa.array(values) for name, values in columns.items()}, units)


def _component_unit(name: str) -> str:
    """Unit of a housing load's component, by name."""
    return "N m" if name.endswith(".moment") else "N"


def housing_components(trajectory: Trajectory) -> dict[str, Array]:
    """Components (F,) of housing loads by name, "hub crank.x"."""
    found: dict[str, Array] = {}
    for load in housing_loads(trajectory):
        found |= {f"{load.name}.{axis}": load.force[:, k] for k, axis in enumerate("xy")}
        if load.moment is not None:
            found[f"{load.name}.moment"] = load.moment
    return found
