"""Energy losses of a window by group, and friction power over time by what rubs.

With N normal forces, v sliding speeds and mu(v) of docs/contact-forces.md,

    joints   mu(r_p |g|) kappa r_p max(|T_i-1|, |T_i|) |g|,   g the rate at which links turn against each other  (a)
    guides   mu(v) N |v|                                                                                         (b)
    teeth    mu(v) N |v|,   v along the contact                                                                  (c)
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpchain.drive import Drive
from warpchain.model import ChainModel
from warpchain.model.friction_coefficients import (
    FrictionCoefficients,
    friction_coefficients,
    guide_friction_coefficients,
    tooth_friction_coefficients,
)
from warpchain.results.guide_load import GuideContacts, recorded_guide_contacts
from warpchain.results.nearest_parts import engaged_sprockets, sprocket_normals
from warpchain.results.run import Run, Trajectory, require_channels

JOINT_LOSSES = "joints"
TOOTH_LOSSES = "sprocket contacts"
GUIDE_LOSSES = "guides"
LINK_LOSSES = "links"
MOUNT_LOSSES = "mounts"
BEARING_LOSSES = "bearings"
ARM_LOSSES = "arms and tensioners"
COUPLING_LOSSES = "couplings"
SLIP_LOSSES = "clutches and gear changes"


def losses(drive: Drive, metrics: Mapping[str, Any]) -> dict[str, float]:
    """Energy losses [J] over the window by group: `input_work` less output, change and residual.

    Args:
        metrics: a variant's row.
    """
    teeth = [s.name for s in drive.sprockets]
    bars = [g.name for g in drive.guides]
    pushed = [arm.name for arm in drive.arms] + [tensioner.name for tensioner in drive.tensioners]
    columns = {
        JOINT_LOSSES: [f"{before}joints.friction" for before in drive.chain_prefixes],
        TOOTH_LOSSES: [f"{name}.{kind}" for name in teeth for kind in ("dissipated", "friction")],
        GUIDE_LOSSES: [f"{name}.{kind}" for name in bars for kind in ("dissipated", "friction")],
        LINK_LOSSES: ["links.dissipated"],
        MOUNT_LOSSES: [f"{name}.mount_dissipated" for name in teeth],
        BEARING_LOSSES: [f"{name}.bearing_friction" for name in teeth],
        ARM_LOSSES: [f"{name}.{kind}" for name in pushed for kind in ("damping_loss", "oil_loss")],
        COUPLING_LOSSES: [f"{coupling.name}.damping_loss" for coupling in drive.couplings],
        SLIP_LOSSES: [f"{coupling.name}.slip_loss" for coupling in drive.couplings],
    }
    found = {
        group: [float(metrics[name]) for name in names if metrics.get(name) is not None]
        for group, names in columns.items()
    }
    totals = {group: sum(values) for group, values in found.items() if values}
    return dict(sorted(totals.items(), key=lambda item: -item[1]))


class Loss(NamedTuple):
    """Energy loss of a group, power, share of the input."""

    energy: float
    power: float
    input_share: float | None


def loss_shares(drive: Drive, metrics: Mapping[str, Any]) -> dict[str, Loss]:
    """Energy losses by group, with power and input share."""
    work = metrics.get("input_work")
    if work is None:
        return {}
    seconds = metrics["window_end"] - metrics["window_start"]
    return {
        group: Loss(energy, energy / seconds, energy / work if work > 0.0 else None)
        for group, energy in losses(drive, metrics).items()
    }


Array = NDArray[np.float64]


def friction_coefficient(rubbing: FrictionCoefficients, speed: Array) -> Array:
    """Friction coefficient mu(v) at sliding speeds [m/s]."""
    part = np.asarray(speed) / rubbing.stribeck_speed
    return rubbing.dynamic + (rubbing.static - rubbing.dynamic) * np.exp(-part * part)


def joint_turn_rates(trajectory: Trajectory) -> Array:
    """Turn rates g (F, N) [rad/s] of joints."""
    position, velocity = require_channels(trajectory, "position", "velocity")
    across = np.roll(position, -1, axis=1) - position
    relative = np.roll(velocity, -1, axis=1) - velocity
    square = across[..., 0] ** 2 + across[..., 1] ** 2
    turning = (across[..., 0] * relative[..., 1] - across[..., 1] * relative[..., 0]) / square
    return np.asarray(turning - np.roll(turning, 1, axis=1), dtype=float)


def joint_loads(trajectory: Trajectory) -> Array:
    """Force (F, N) [N] in each joint."""
    (tension,) = require_channels(trajectory, "tension")
    size = np.abs(np.asarray(tension, dtype=float))
    return np.maximum(size, np.roll(size, 1, axis=1))


def total_joint_friction_power(trajectory: Trajectory) -> Array:
    """Friction power (F,) [W] of all joints, (a)."""
    if trajectory.joint_friction_power is not None:
        return np.asarray(trajectory.joint_friction_power, dtype=float).sum(axis=1)
    joint, radius = trajectory.model.chain.joint, trajectory.model.chain.pin_radius
    if joint is None or radius is None:
        return np.zeros(len(trajectory.time))
    rate = np.abs(joint_turn_rates(trajectory))
    moment = (
        friction_coefficient(friction_coefficients(joint), radius * rate)
        * joint.factor
        * radius
        * joint_loads(trajectory)
    )
    return np.asarray((moment * rate).sum(axis=1))


def guide_friction_power(trajectory: Trajectory, g: int, contacts: GuideContacts) -> Array:
    """Friction power (F,) [W] on guide g, (b)."""
    speed = np.abs(contacts.speed)
    power = friction_coefficient(guide_friction_coefficients(trajectory.model, g), speed) * contacts.force * speed
    return np.asarray(np.bincount(contacts.frame, power, minlength=len(trajectory.time)), dtype=float)


def tooth_friction_power(trajectory: Trajectory, s: int, near: NDArray[np.intp]) -> Array:
    """Friction power (F,) [W] on a sprocket's teeth, (c)."""
    position, velocity, sprocket_force, sprocket_speed, sprocket_center = require_channels(
        trajectory, "position", "velocity", "sprocket_force", "sprocket_speed", "sprocket_center"
    )
    frame, roller = np.nonzero((sprocket_force > 0.0) & (near == s))
    force = np.asarray(sprocket_force, dtype=float)[frame, roller]
    center = np.asarray(sprocket_center[:, s], dtype=float)
    moving = np.gradient(center, trajectory.time, axis=0)
    r = np.asarray(position, dtype=float)[frame, roller] - center[frame]
    v = np.asarray(velocity, dtype=float)[frame, roller] - moving[frame]
    omega = np.asarray(sprocket_speed, dtype=float)[frame, s]
    relative = np.stack([-omega * r[:, 1], omega * r[:, 0]], axis=-1) - v
    n = sprocket_normals(trajectory, s, frame, roller)
    sliding = np.abs(relative[:, 1] * n[:, 0] - relative[:, 0] * n[:, 1])
    power = friction_coefficient(tooth_friction_coefficients(trajectory.model, s), sliding) * force * sliding
    return np.asarray(np.bincount(frame, power, minlength=len(trajectory.time)), dtype=float)


def friction_power(trajectory: Trajectory) -> dict[str, Array]:
    """Friction power (F,) [W] by part that rubs."""
    model = trajectory.model
    found: dict[str, Array] = {}
    if model.chain.has_friction:
        found["joints"] = total_joint_friction_power(trajectory)
    touching = recorded_guide_contacts(trajectory) if model.guides else []
    for g, guide in enumerate(model.guides):
        if guide_friction_coefficients(model, g).has_friction:
            found[guide.name] = guide_friction_power(trajectory, g, touching[g])
    if tooth_friction_coefficients(model).has_friction and not model.chain.is_silent:  # whose flanks no channel has
        near = engaged_sprockets(trajectory)
        for s, sprocket in enumerate(model.sprockets):
            found[sprocket.name] = tooth_friction_power(trajectory, s, near)
    return found


def friction_power_by_group(parts: Drive | ChainModel, power: Mapping[str, Array]) -> dict[str, Array]:
    """Friction power (F,) [W] by group: joints, guides, teeth."""
    groups = {
        "joints": ["joints"],
        "guides": [guide.name for guide in parts.guides],
        "teeth": [sprocket.name for sprocket in parts.sprockets],
    }
    held = {group: [power[name] for name in names if name in power] for group, names in groups.items()}
    return {group: np.sum(values, axis=0) for group, values in held.items() if values}


def friction_power_over_speed(run: Run) -> tuple[Array, dict[str, Array]] | None:
    """Driver speeds (V,) [rad/s] and friction power by group, of a run.

    None with fewer than three speeds, several chains, unlike drivers, or where nothing rubs.
    """
    drive, table = run.drives[0], run.metrics
    names = {f"{of.sprockets[of.driver].name}.speed_mean" for of in run.drives}
    name = next(iter(names))
    several = len(names) > 1 or any(of.chains for of in run.drives)
    if several or not {name, "window_start", "window_end"} <= set(table.column_names):
        return None
    partners = [*(sprocket.name for sprocket in drive.sprockets), *(guide.name for guide in drive.guides)]
    of = {part: f"{part}.friction" for part in ("joints", *partners)}
    columns = {part: np.array(table[held].to_pylist(), dtype=float) for part, held in of.items()
               if held in table.column_names}  # fmt: skip
    start, end, speed = (np.array(table[key].to_pylist(), dtype=float) for key in ("window_start", "window_end", name))
    known = run.ok & np.isfinite(speed) & np.isfinite(np.sum(list(columns.values()), axis=0))
    if not columns or len(np.unique(np.round(np.abs(speed[known]), 6))) < 3:
        return None
    order = np.flatnonzero(known)[np.argsort(np.abs(speed[known]))]
    power = {part: values[order] / (end - start)[order] for part, values in columns.items()}
    return np.abs(speed[order]), friction_power_by_group(drive, power)
