"""Friction coefficients of joints, and of rollers on teeth and guides."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from warpchain.drive.stack_math import is_true_somewhere, maximum, minimum
from warpchain.model.chain_model import computed_once

if TYPE_CHECKING:
    from warpchain.drive import ImpactLaw
    from warpchain.drive.chain import Joint
    from warpchain.model import ChainModel


@dataclass(frozen=True)
class FrictionCoefficients:
    """Friction coefficients: mu = dynamic + (static - dynamic) exp(-(v / stribeck_speed)^2)."""

    dynamic: float
    static: float
    stribeck_speed: float

    @cached_property
    def has_friction(self) -> bool:
        """Whether the coefficients give friction."""
        return is_true_somewhere(self.larger_coefficient > 0.0)

    @cached_property
    def larger_coefficient(self) -> float:
        """Larger of the friction coefficients [-]."""
        return maximum(self.dynamic, self.static)


def friction_coefficients(law: ImpactLaw | Joint, most: float = math.inf) -> FrictionCoefficients:
    """Friction coefficients of a contact or joint, at most `most`."""
    dynamic = 0.0 if law.friction is None else law.friction
    static = dynamic if law.static_friction is None else law.static_friction
    speed = 1.0 if law.stribeck_speed is None else law.stribeck_speed
    if most is not math.inf:
        dynamic, static = minimum(dynamic, most), minimum(static, most)
    return FrictionCoefficients(dynamic, static, speed)


def tooth_friction_coefficients(model: ChainModel, s: int | None = None) -> FrictionCoefficients:
    """Friction coefficients of rollers on teeth; 0 on an end."""
    if s is not None and model.sprockets[s].is_end:
        return FrictionCoefficients(0.0, 0.0, 1.0)
    return friction_coefficients(model.contact.sprocket)


def guide_friction_coefficients(model: ChainModel, g: int) -> FrictionCoefficients:
    """Friction coefficients of rollers or plates on guide g."""
    law = model.guide_contact(g)
    return friction_coefficients(law, _rolling_coefficient(model) if law.rolling else math.inf)


@computed_once
def partner_friction_coefficients(model: ChainModel, index: int) -> FrictionCoefficients:
    """Friction coefficients of rollers on sprocket or guide `index`."""
    sprockets = len(model.sprockets)
    if index < sprockets:
        return tooth_friction_coefficients(model, index)
    return guide_friction_coefficients(model, index - sprockets)


def has_partner_friction(model: ChainModel, index: int) -> bool:
    """Whether rollers rub on sprocket or guide `index`."""
    return partner_friction_coefficients(model, index).has_friction


def _rolling_coefficient(model: ChainModel) -> float:
    """Friction coefficient of a rolling roller, mu_b r_b / R_r [-]."""
    joint, pin_radius = getattr(model.chain, "joint", None), getattr(model.chain, "pin_radius", None)
    if joint is None or pin_radius is None:
        return 0.0
    return joint.friction * pin_radius / model.chain.roller_radius
