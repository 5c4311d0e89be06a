"""The time step's limit: omega_max^2 = (4 k + K_max) / m bounds how fast a roller oscillates on links and a contact.

A Kelvin-Voigt contact, whose damper c does not vanish with the penetration, lowers it: leapfrog reads the damper's
speed half a step late, and is stable where omega_max^2 h^2 + 2 (c/m) h < 4.
"""

from __future__ import annotations

import math

from warpchain.contact import contact_damping, guide_stiffness, sprocket_stiffness
from warpchain.drive import Drive, ImpactLaw
from warpchain.errors import DriveError
from warpchain.laws import LAWS

AUTOMATIC = 0.2
"""omega_max h of the automatic step."""


def highest_frequency(drive: Drive) -> float:
    """omega_max [rad/s]: a roller of the chain's mass on two links and the stiffest contact.

    With dampers g + sqrt(g^2 + omega_max^2), g = c / (2 m): twice its inverse is where leapfrog becomes unstable.
    """
    stiffest = half_rate = 0.0
    contacts: list[tuple[ImpactLaw, float]]
    contacts = [(drive.contact.sprocket, sprocket_stiffness(drive, s)) for s in range(len(drive.sprockets))]
    contacts += [(drive.guide_contact(g), guide_stiffness(drive, g)) for g in range(len(drive.guides))]
    mass = drive.chain.mass
    for law, stiffness in contacts:
        stiffest = max(stiffest, stiffness)
        if LAWS[law.law].viscous:
            half_rate = max(half_rate, 0.5 * contact_damping(law, stiffness, mass) / mass)
    return half_rate + math.sqrt(half_rate**2 + (4.0 * drive.chain.stiffness + stiffest) / mass)


def step_limit(drive: Drive) -> float:
    """Steps must be shorter than this [s]: 2 / omega_max, leapfrog's limit of stability."""
    return 2.0 / highest_frequency(drive)


def automatic_step(drive: Drive) -> float:
    """The step that "auto" stands for [s]: omega_max h = 0.2."""
    return AUTOMATIC / highest_frequency(drive)


def resolve_step(drive: Drive, step: float | None = None) -> float:
    """The step to take [s]: `step`, or else the drive's own.

    Raises:
        DriveError: a step that is not positive or not below the limit; the message states the limit.
    """
    asked = drive.run.step if step is None else step
    if isinstance(asked, str):
        return automatic_step(drive)
    limit = step_limit(drive)
    if not (math.isfinite(asked) and 0.0 < asked < limit):
        laws = [drive.contact.sprocket, *(drive.guide_contact(g) for g in range(len(drive.guides)))]
        damped = ", less for contact dampers" if any(LAWS[law.law].viscous for law in laws) else ""
        raise DriveError(
            f"run.step = {asked:g}: must be above 0 and below {limit:.6g} s, 2 / sqrt((4 k + K_max) / m){damped}; "
            f'or "auto", {automatic_step(drive):.6g} s'
        )
    return asked
