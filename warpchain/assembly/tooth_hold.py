"""Tooth jump at rest: an estimate of the tensions that the teeth of a sprocket bear (docs/jump.md).

Tension falls from one link of a wrap psi to the next at most to 1/q, theta half the seating angle,

    q = cos(theta - pi/z) / cos(theta + pi/z).                                                                     (a)

The chain jumps where on the tips, at radius rho_top, tensions of an elongation e' in place of e have

    T_1 > q^n T_2,    N p (e - e') = psi (rho_top - r') + sum over other sprockets of psi_o (r_o - r_o').          (b)
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly import statics
from warpchain.assembly.assembly import assemble_chain
from warpchain.drive import plate
from warpchain.drive.tooth_shape import half_gap_outline
from warpchain.errors import DriveError
from warpchain.model import ChainModel

LEAST_CHANGE = 1e-9
"""Tension below which a strand counts as slack [N]."""
MOST_LEFT = 0.02
"""Force that may be left at rest over the largest that acts."""
ROUNDS = 8
"""Rounds of the fixed point (b)."""


def top_radius(model: ChainModel, s: int) -> float:
    """Distance rho_top of a roller from sprocket s' center where its flank ends [m].

    Of a silent chain that of pins where both toes of a link stand on tips.
    """
    if model.chain.is_silent:
        return plate.top_radius(model.chain.plate, model.sprockets[s].teeth, model.sprocket_pitch(s))
    tooth, radius, points = model.tooth(s), model.pitch_radius(s), 9
    tip = half_gap_outline(tooth, model.sprockets[s].teeth, radius, points)[2 * points - 2]
    half = 0.5 * tooth.seat_angle
    normal = np.array([math.cos(half), -math.sin(half)])
    if math.isfinite(tooth.flank_radius):
        end = [radius, 0.0] + tooth.seat_radius * np.array([-math.cos(half), math.sin(half)])
        normal = (tip - end) / tooth.flank_radius + normal
    return float(np.hypot(*(tip + model.chain.roller_radius * normal)))


def held_tension_ratio(model: ChainModel, s: int) -> float:
    """Largest ratio of neighboring links' tensions that a tooth of sprocket s holds, q of (a)."""
    phi, step = model.tooth(s).pressure_angle(model.sprockets[s].teeth), math.tau / model.sprockets[s].teeth
    return math.sin(phi + step) / math.sin(phi) if phi > 0.0 else math.inf


def has_tooth_jump(model: ChainModel, s: int) -> bool:
    """Whether the chain jumps a tooth of sprocket s at rest, (b), or comes to no rest there.

    Raises:
        DriveError: a chain that does not fit.
    """
    wraps = assemble_chain(model).path.wrap_angle
    if top_radius(model, s) <= model.riding_radius(s):
        return True
    try:
        found = statics.at_work(_drive_on_tips(model, s, wraps))
    except DriveError:  # no chain so short goes around: there is no slack to climb with
        return False
    if found.failure is not None and found.residual > MOST_LEFT:
        return True
    low, high = sorted(float(found.tension[k]) - found.centrifugal for k in (s - 1, s))
    held = model.sprockets[s].teeth * float(wraps[s]) / math.tau
    return high > LEAST_CHANGE and (low <= 0.0 or math.log(high / low) > held * math.log(held_tension_ratio(model, s)))


def _drive_on_tips(model: ChainModel, s: int, wraps: NDArray[np.float64]) -> ChainModel:
    """Model of a chain as short as on the tips of sprocket s, for a jump, (b)."""
    chain, others = model.chain, [o for o in range(len(model.sprockets)) if o != s]
    risen, top = model, top_radius(model, s)
    for _ in range(ROUNDS):
        taken = wraps[s] * (top - risen.riding_radius(s))
        taken += sum(wraps[o] * (model.riding_radius(o) - risen.riding_radius(o)) for o in others)
        shorter = chain.elongation - float(taken) / (chain.links * chain.pitch)
        risen = replace(model, chain=chain.model_copy(update={"elongation": shorter}))
    return risen
