"""Contact of parallel cylinders: stiffness from materials, damping, rebound after an impact."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from warpchain.drive.laws import LAWS, is_law, law_factor
from warpchain.drive.stack_math import elementwise, power
from warpchain.drive.toml import value_text
from warpchain.errors import DriveError, drive_error

if TYPE_CHECKING:
    from warpchain.drive.contact_settings import ImpactLaw, Material


def compliance(roller: Material, partner: Material) -> float:
    """Compliance of two contact bodies, s of eq. (20) [1/Pa]."""
    return sum((1.0 - power(body.poissons_ratio, 2)) / (math.pi * body.youngs_modulus) for body in (roller, partner))


@elementwise
def hertz_stiffness(
    load: float, width: float, roller_radius: float, partner_radius: float, compliance: float, exponent: float = 1.0
) -> float:
    """Generalized stiffness of a line contact at a load, K of eq. (20) [N/m^n].

    Args:
        load, width: P [N], w [m].
        roller_radius, partner_radius: R1, R2 [m]; `math.inf` for a flat partner.
        compliance, exponent: s [1/Pa], n [-].

    Raises:
        DriveError: load beyond the formula's validity.
    """
    limit = _validity_limit(width, roller_radius, partner_radius, compliance)
    if not 0.0 < load < limit:
        text = f"must be above 0 and below {limit:g} N, where eq. (20) ends"
        raise drive_error([f"reference_load = {value_text(load)}: {text}"])
    penetration = load * compliance / width * math.log(limit / load)
    try:
        stiffness = load / penetration**exponent
    except (OverflowError, ZeroDivisionError):
        stiffness = math.inf
    if not 0.0 < stiffness < math.inf:
        text = "must give a stiffness that is a positive, finite number"
        raise drive_error([f"reference_load = {value_text(load)}: {text}"])
    return stiffness


def _validity_limit(width: float, roller_radius: float, partner_radius: float, compliance: float) -> float:
    """Load at which the stiffness formula, eq. (20), ends [N]."""
    if compliance == 0.0:  # a modulus beyond all numbers
        return 0.0
    return math.e * width * width * width * (1.0 / roller_radius + 1.0 / partner_radius) / compliance


def largest_load(law: ImpactLaw, roller_radius: float, partner_radius: float) -> float:
    """Upper limit of a contact's reference load [N], or infinite."""
    if law.width is None or law.roller is None or law.partner is None:
        return math.inf
    return _validity_limit(law.width, roller_radius, partner_radius, compliance(law.roller, law.partner))


def contact_stiffness(law: ImpactLaw, roller_radius: float, partner_radius: float, path: str) -> float:
    """Generalized stiffness of a contact, given or by eq. (20) [N/m^n].

    Args:
        partner_radius: [m]; `math.inf` for a flat partner.
        path: key path of the contact.

    Raises:
        DriveError: reference load beyond validity; names the key.
    """
    if law.stiffness is not None:
        return law.stiffness
    assert law.roller is not None and law.partner is not None  # the contact's own rule
    assert law.width is not None and law.reference_load is not None
    body = compliance(law.roller, law.partner)
    try:
        return hertz_stiffness(law.reference_load, law.width, roller_radius, partner_radius, body, law.exponent)
    except DriveError as error:
        raise drive_error([f"{path}.{error}"]) from None


def rebound_ratio(restitution: float, law: str = "lankarani-nikravesh") -> float:
    """Rebound speed over impact speed by a contact law [-].

    Raises:
        DriveError: unknown law, or restitution not above 0 and at most 1.
    """
    if not 0.0 < restitution <= 1.0:
        raise drive_error([f"restitution = {value_text(restitution)}: must be a number above 0, at most 1"])
    if not is_law(law):
        raise drive_error([f"law = {law!r}: must be one of {', '.join(LAWS)}"])
    return LAWS[law].rebound(law_factor(law, restitution))


def contact_rebound(law: ImpactLaw) -> float:
    """Rebound speed over impact speed of a contact's settings [-]."""
    return LAWS[law.law].rebound(law_factor(law.law, law.restitution, law.restitution_means))


def contact_damping(law: ImpactLaw, stiffness: float, mass: float) -> float:
    """Damping of a contact: factor d [-], or c of Kelvin-Voigt [N s/m].

    Args:
        stiffness: K [N/m^n].
        mass: of a roller [kg].
    """
    factor = law_factor(law.law, law.restitution, law.restitution_means)
    return factor * LAWS[law.law].unit(stiffness, mass)
