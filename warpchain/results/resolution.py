r"""Errors of the step in friction and ramps, of which a drive's limit of stability does not know.

Friction that sticks is held by a bristle that is no stiffer than the step can follow (`kernels.physics.friction`):
where it takes hold within a few steps, what it gives way by hangs on the step. With mu the larger coefficient, N the
largest normal force of a partner, m a roller's mass, T the tension that 99.9 % of links and instants are below, z the
fewest teeth and I = m p^2 / 6, friction moves

    a roller by a pitch in               sqrt(m p / (mu N)),                                                  (a)
    a joint by the bend of a tooth in    sqrt((2 pi / z) I / (mu kappa r_p T)).                               (b)

A motion that is ramped up takes its ramp's time.

A joint that sticks gives way by phi = mu kappa r_p T h^2 / (0.12 I) until its bristle holds it where the step bounds
that, T the mean tension of its strand. The n joints of a strand that swings by the amplitude a let its middle give by
n^2 p phi / 8. That pays out pi^2 a / (2 n p) times as much of the chain, which n links of the stiffness k answer with
the tension

    (pi^2 / 16) k a phi,                                                                                      (c)

and sprockets pass it on to slack strands, which have little of their own. It falls with the square of the step.

The energy balance tells of none of these. What half the step changes of means, quantiles and losses (`python
scripts/bench.py resolution`, docs/steps.md): of four examples up to 1.8 % with 46 steps and more in (b), up to
38 % with 29 and fewer; of `marine` 8 % with 95. How often (c) tells: `python scripts/bench.py gives`.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from warpchain.drive.batch_math import smallest
from warpchain.drive.friction_coefficients import guide_rubbing, rubbing_of, tooth_rubbing
from warpchain.results.formulas import STEP, Judged, Values, displacement_std, where

if TYPE_CHECKING:
    from warpchain.drive import Drive

HELD = 0.12
"""Stiffness of a joint's bristle, times h^2 / I (`kernels.physics.friction`)."""


def joint_resolution(of: Judged) -> Values:
    """(b) over the step."""
    return _steps(of, of.each(_bend), _joint_moment(of, of["tension_q999"]))


def joint_give(of: Judged) -> Values:
    """(c), the largest of all strands, over a strand's own `tension_q999`."""
    step = np.ma.getdata(of.metrics[STEP])
    stiffness = of.each(_least_stiffness)
    inertias = of.mass * of.each(lambda drive: drive.chain.pitch * drive.chain.pitch) / 6.0
    gives = np.zeros(len(of.drives))
    for name in of.drives[0].strand_names:
        strand = replace(of, prefix=f"{name}.")
        moment = _joint_moment(of, np.maximum(strand["tension_mean"], 0.0))
        turned = moment * step * step / (HELD * inertias)
        swings = math.sqrt(2.0) * np.ma.filled(displacement_std(strand), 0.0)
        gives = np.fmax(gives, math.pi**2 / 16.0 * stiffness * swings * turned)
    tension = of["tension_q999"]
    return where(tension > 0.0, gives / np.where(tension > 0.0, tension, 1.0))


def partner_resolution(of: Judged) -> Values:
    """(a) over the step, or the ramp of a sprocket's motion, which is shorter."""
    ways = of.mass * of.each(lambda drive: drive.chain.pitch)
    steps = _steps(of, ways, of.each(lambda drive: _rubbing(drive, of.index)) * of["force_max"])
    times = of.each(lambda drive: _ramp_time(drive, of.index))
    ramped = where(times > 0.0, times / np.ma.getdata(of.metrics[STEP]))
    fewer = np.minimum(steps.filled(np.inf), ramped.filled(np.inf))
    return where(np.isfinite(fewer), fewer)


def ramps(drive: Drive, index: int) -> bool:
    """Whether a partner is a sprocket whose motion is ramped up."""
    return _ramp_time(drive, index) > 0.0


def _steps(of: Judged, way: Values, force: Values) -> np.ma.MaskedArray:
    """Steps in which a force moves by a way, times the mass that it moves; masked where there is none."""
    with np.errstate(all="ignore"):
        steps = np.sqrt(way / force) / np.ma.getdata(of.metrics[STEP])
    return where(np.isfinite(steps) & (force > 0.0), steps)


def _joint_moment(of: Judged, tension: Values) -> Values:
    """(V,) largest moment in a joint between links of a tension [N] (V,), mu kappa r_p T [N m]."""
    return of.each(_joint_arm) * tension


def _joint_arm(drive: Drive) -> float:
    """mu kappa r_p [m]."""
    chain = drive.chain
    assert chain.joint is not None and chain.pin_radius is not None  # as the group's `where` has found
    return rubbing_of(chain.joint).most * chain.joint.factor * chain.pin_radius


def _bend(drive: Drive) -> float:
    """(2 pi / z) I [kg m^2]."""
    chain, teeth = drive.chain, min(sprocket.teeth for sprocket in drive.sprockets)
    return 2.0 * math.pi / teeth * chain.mass * (chain.pitch * chain.pitch) / 6.0


def _least_stiffness(drive: Drive) -> float:
    """Stiffness of the softest link [N/m]."""
    return smallest(drive.chain.stiffness, drive.chain.outer_stiffness)


def _rubbing(drive: Drive, index: int) -> float:
    """mu of rollers and a partner [-]."""
    s = len(drive.sprockets)
    return (tooth_rubbing(drive) if index < s else guide_rubbing(drive, index - s)).most


def _ramp_time(drive: Drive, index: int) -> float:
    """The time in which a partner's motion is ramped up [s], or 0."""
    motion = drive.sprockets[index].prescribed if index < len(drive.sprockets) else None
    return 0.0 if motion is None else motion.ramp_time
