"""Step resolution: errors of the time step in friction and ramps, which the limit of stability does not cover.

With mu the larger coefficient, N a partner's largest normal force, m a roller's mass, T the 99.9 % quantile of tension,
z the fewest teeth, I = m p^2 / 6, friction moves

    a roller by a pitch in               sqrt(m p / (mu N)),                                                  (a)
    a joint by the bend of a tooth in    sqrt((2 pi / z) I / (mu kappa r_p T)).                               (b)

A joint that sticks gives way by phi = mu kappa r_p T h^2 / (0.12 I), T its strand's mean tension. In a strand that
swings by a, links of stiffness k answer with the tension

    (pi^2 / 16) k a phi.                                                                                      (c)
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from warpchain.drive.stack_math import minimum
from warpchain.model.friction_coefficients import friction_coefficients, partner_friction_coefficients
from warpchain.results.metric_formulas import (
    STEP_KEY,
    ColumnValues,
    DesignInputs,
    VariantValues,
    displacement_std,
    mask_absent,
)

if TYPE_CHECKING:
    from warpchain.model import ChainModel

BRISTLE_STIFFNESS = 0.12
"""Stiffness of a bristle, times h^2 / I."""


def joint_resolution(of: DesignInputs) -> VariantValues:
    """Metric: steps (V,) in which friction bends a joint, (b)."""
    return _steps_of_force(of, of.number_of_each(_tooth_bend_inertia), _joint_friction_moment(of, of["tension_q999"]))


def joint_give(of: DesignInputs) -> VariantValues:
    """Metric: tension (V,) that sticking joints give up, relative, (c)."""
    step = of.metrics[STEP_KEY].values
    stiffness = of.number_of_each(_softest_link_stiffness)
    inertias = of.roller_mass * of.number_of_each(lambda model: model.chain.pitch * model.chain.pitch) / 6.0
    strands = [replace(of, prefix=f"{name}.") for name in of.models[0].strand_names]
    tensions = np.array([strand["tension_mean"] for strand in strands])
    moments = _joint_friction_moment(of, np.maximum(tensions, 0.0))
    turned = moments * step * step / (BRISTLE_STIFFNESS * inertias)
    swings = math.sqrt(2.0) * np.array([displacement_std(strand).filled(0.0) for strand in strands])
    gives = np.fmax.reduce(math.pi**2 / 16.0 * stiffness * swings * turned, axis=0, initial=0.0)
    tension = of["tension_q999"]
    return mask_absent(tension > 0.0, gives / np.where(tension > 0.0, tension, 1.0))


def partner_resolution(of: DesignInputs) -> VariantValues:
    """Metric: steps (V,) in which friction moves a roller, (a), or of a ramp."""
    ways = of.roller_mass * of.number_of_each(lambda model: model.chain.pitch)
    coefficients = of.number_of_each(lambda model: partner_friction_coefficients(model, of.index).larger_coefficient)
    steps = _steps_of_force(of, ways, coefficients * of["force_max"])
    times = of.number_of_each(lambda model: _partner_ramp_time(model, of.index))
    ramped = mask_absent(times > 0.0, times / of.metrics[STEP_KEY].values)
    fewer = np.minimum(steps.filled(np.inf), ramped.filled(np.inf))
    return mask_absent(np.isfinite(fewer), fewer)


def is_ramped(model: ChainModel, index: int) -> bool:
    """Whether a partner is a sprocket with a ramped motion."""
    return _partner_ramp_time(model, index) > 0.0


def _steps_of_force(of: DesignInputs, way: VariantValues, force: VariantValues) -> ColumnValues:
    """Number of steps in which a force covers a way."""
    with np.errstate(all="ignore"):
        steps = np.sqrt(way / force) / of.metrics[STEP_KEY].values
    return mask_absent(np.isfinite(steps) & (force > 0.0), steps)


def _joint_friction_moment(of: DesignInputs, tension: VariantValues) -> VariantValues:
    """Largest friction moment (V,) [N m] in a joint."""
    return of.number_of_each(_joint_friction_arm) * tension


def _joint_friction_arm(model: ChainModel) -> float:
    """Arm of a joint's friction [m], mu kappa r_p."""
    joint, pin_radius = model.chain.joint, model.chain.pin_radius
    assert joint is not None and pin_radius is not None  # as the group's `applies_to` has found
    return friction_coefficients(joint).larger_coefficient * joint.factor * pin_radius


def _tooth_bend_inertia(model: ChainModel) -> float:
    """Joint's bend on a tooth times its inertia [kg m^2]."""
    chain, teeth = model.chain, min(sprocket.teeth for sprocket in model.sprockets)
    return 2.0 * math.pi / teeth * chain.mass * (chain.pitch * chain.pitch) / 6.0


def _softest_link_stiffness(model: ChainModel) -> float:
    """Stiffness [N/m] of the softest link."""
    return minimum(model.chain.stiffness, model.chain.outer_stiffness)


def _partner_ramp_time(model: ChainModel, index: int) -> float:
    """Ramp time [s] of a partner's motion, or 0."""
    motion = model.sprockets[index].prescribed if index < len(model.sprockets) else None
    return 0.0 if motion is None else motion.ramp_time
