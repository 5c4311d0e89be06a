"""The time step's limit: how fast a roller can oscillate on links and a contact, and a sprocket on its mount.

Dampers lower it: leapfrog reads their speed half a step late, and is stable where omega_max^2 h^2 + 2 (c/m) h < 4.
Those of links and mounts count, and of Kelvin-Voigt contacts, which do not vanish with the penetration. The damping of
hysteretic contacts does not, nor does friction: a step bounds them (`kernels/physics/impact.py`, `friction.py`).
"""

from __future__ import annotations

import math

from warpchain.drive import Drive, ImpactLaw
from warpchain.drive.laws import LAWS
from warpchain.drive.mounts import moving_mass, on_springs, spring
from warpchain.drive.stiffness import contact_damping
from warpchain.errors import DriveError

AUTOMATIC = 0.2
"""omega_max h of the automatic step."""

DAMPED = 0.25
"""The automatic step is at most this part of the limit, where strong dampers of links set it."""


def highest_frequency(drive: Drive, damped_links: bool = True) -> float:
    """omega_max [rad/s]: a roller of the chain's mass on two links and the stiffest contact, (4 k + K_max) / m.

    A sprocket of mass M on springs adds (k_b + K z / 2) / M: two coupled parts oscillate no faster than the root of the
    sum of their squares, and of z teeth all around half can push along one line. Where outer links differ,
    2 (k_inner + k_outer) stands in place of 4 k. With contact dampers
    g + sqrt(g^2 + omega_max^2), g = c / (2 m): twice its inverse is where leapfrog becomes unstable. So with dampers of
    links, whose 2 (c_inner + c_outer) a roller feels where they stretch in turn, unless `damped_links` is false.
    """
    contacts: list[tuple[ImpactLaw, float]]
    contacts = [(drive.contact.sprocket, drive.sprocket_stiffness(s)) for s in range(len(drive.sprockets))]
    contacts += [(drive.guide_contact(g), drive.guide_stiffness(g)) for g in range(len(drive.guides))]
    mass = drive.chain.mass
    stiffest = half_rate = 0.0
    for law, stiffness in contacts:
        stiffest = max(stiffest, stiffness)
        if LAWS[law.law].viscous:
            half_rate = max(half_rate, 0.5 * contact_damping(law, stiffness, mass) / mass)
    centers = [
        (spring(sprocket)[0] + 0.5 * sprocket.teeth * contacts[s][1]) / moving_mass(sprocket)
        for s, sprocket in enumerate(drive.sprockets)
        if on_springs(sprocket)
    ]
    if damped_links:
        half_rate += (drive.chain.link_damping + drive.chain.outer_damping) / mass
    springs = 2.0 * (drive.chain.stiffness + drive.chain.outer_stiffness)
    square = (springs + stiffest) / mass + max(centers, default=0.0)
    return half_rate + math.sqrt(half_rate**2 + square)


def step_limit(drive: Drive, damped_links: bool = True) -> float:
    """Steps must be shorter than this [s]: 2 / omega_max, leapfrog's limit of stability.

    Leapfrog takes a mount's damper c_b half a step late, which needs omega_max^2 h^2 + 2 h c_b / M < 4.
    """
    omega = highest_frequency(drive, damped_links)
    rates = [spring(sprocket)[1] / moving_mass(sprocket) for sprocket in drive.sprockets if on_springs(sprocket)]
    rate = max(rates, default=0.0)
    return 4.0 / (rate + math.sqrt(rate * rate + 4.0 * omega * omega))


def automatic_step(drive: Drive) -> float:
    """The step that "auto" stands for [s]: omega_max h = 0.2, less for dampers of mounts and contacts.

    A tenth of what the limit would be if links had no dampers, and at most a quarter of what it is.
    """
    return min(0.5 * AUTOMATIC * step_limit(drive, damped_links=False), DAMPED * step_limit(drive))


def resolve_step(drive: Drive, step: float | str | None = None) -> float:
    """The step to take [s]: `step`, or else the drive's own; "auto" is the automatic one.

    Raises:
        DriveError: a step that is not positive or not below the limit; the message states the limit.
    """
    asked = drive.run.step if step is None else step
    if isinstance(asked, str):
        if asked != "auto":
            raise DriveError(f'run.step = "{asked}": must be a positive number or "auto"')
        return automatic_step(drive)
    limit = step_limit(drive)
    mounts = " with what mounts on springs add" if any(map(on_springs, drive.sprockets)) else ""
    if not (math.isfinite(asked) and 0.0 < asked < limit):
        raise DriveError(
            f"run.step = {asked:g}: must be above 0 and below {limit:.6g} s, 2 / sqrt((4 k + K_max) / m), less for "
            f'dampers{mounts}; or "auto", {automatic_step(drive):.6g} s'
        )
    return asked
