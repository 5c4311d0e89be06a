"""Contact of parallel cylinders: stiffness from materials, damping, and the rebound after an impact."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from warpchain.drive.laws import LAWS, law_factor
from warpchain.drive.stack_math import elementwise, power
from warpchain.drive.toml import value_text
from warpchain.errors import DriveError, drive_error

if TYPE_CHECKING:
    from warpchain.drive.contact_settings import ImpactLaw, Material


def compliance(roller: Material, partner: Material) -> float:
    """Sum of (1 - nu^2)/(pi E) over both bodies [1/Pa]: s of eq. (20)."""
    return sum((1.0 - power(body.poissons_ratio, 2)) / (math.pi * body.youngs_modulus) for body in (roller, partner))


@elementwise
def hertz_stiffness(
    load: float, width: float, roller_radius: float, partner_radius: float, compliance: float, exponent: float = 1.0
) -> float:
    """Generalized stiffness K of a line contact at a load [N/m^n], from eq. (20).

    Args:
        load: P [N].
        width: w [m].
        roller_radius: R1 [m].
        partner_radius: R2 [m]; `math.inf` for a flat partner.
        compliance: s [1/Pa].
        exponent: n of the force law [-].

    Raises:
        DriveError: if the load is beyond the formula's validity.
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
    """Load at which the bracket of eq. (20) is zero [N]: the bracket is ln(limit / P)."""
    if compliance == 0.0:  # a modulus beyond all numbers
        return 0.0
    return math.e * width * width * width * (1.0 / roller_radius + 1.0 / partner_radius) / compliance


def largest_load(law: ImpactLaw, roller_radius: float, partner_radius: float) -> float:
    """Reference load below which the materials of a contact give a stiffness [N]; infinite for a given stiffness."""
    if law.width is None or law.roller is None or law.partner is None:
        return math.inf
    return _validity_limit(law.width, roller_radius, partner_radius, compliance(law.roller, law.partner))


def contact_stiffness(law: ImpactLaw, roller_radius: float, partner_radius: float, path: str) -> float:
    """Generalized stiffness of a contact [N/m^n], given or from materials (eq. (20)).

    Args:
        law: the contact's settings.
        roller_radius: R1 [m].
        partner_radius: R2 [m]; `math.inf` for a flat partner.
        path: of the contact in the drive, for the message.

    Raises:
        DriveError: if the reference load is beyond the formula's validity; the message names the key.
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
    """Speed after an impact over the speed before, as a contact law gives it where no other force acts [-].

    It is not e: Lankarani and Nikravesh's law was derived for e near 1, and e = 0.3 returns 0.684 (see
    `warpchain.drive.laws`).

    Args:
        restitution: e [-], above 0, at most 1.
        law: name of the law.

    Raises:
        DriveError: for a restitution out of that range, or an unknown law.
    """
    if not 0.0 < restitution <= 1.0:
        raise drive_error([f"restitution = {value_text(restitution)}: must be a number above 0, at most 1"])
    if law not in LAWS:
        raise drive_error([f"law = {law!r}: must be one of {', '.join(LAWS)}"])
    return LAWS[law].rebound(law_factor(law, restitution))


def contact_rebound(law: ImpactLaw) -> float:
    """Speed after an impact over the speed before of a contact as set [-], where no other force acts."""
    return LAWS[law.law].rebound(law_factor(law.law, law.restitution, law.restitution_means))


def contact_damping(law: ImpactLaw, stiffness: float, mass: float) -> float:
    """The damping value of the law's function: hysteresis factor d [-], or c of Kelvin-Voigt [N s/m].

    Args:
        law: the contact's settings.
        stiffness: K [N/m^n].
        mass: of a roller [kg], which hits a partner that counts as much heavier.
    """
    factor = law_factor(law.law, law.restitution, law.restitution_means)
    return factor * LAWS[law.law].unit(stiffness, mass)
