"""Answers of bodies to the dampers of their contacts: G of `kernels.physics.impact`.

If the forces of all contacts of a body change by f, each closing acceleration changes by f times the body's mobility
for each: (R + b)^2 / J of a sprocket that turns with its train, 1 / M of a center on springs, r^2 / I of an arm. With
the n rollers that are seated as a run begins,

    G = 2 m sum n (mobility),

over all sprockets of the train and all that an arm carries. The sum is the trace of what couples the contacts, which
none of its eigenvalues is above.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly import Assembly
from warpchain.drive import Drive
from warpchain.drive.mounts import moving_mass, on_springs
from warpchain.drive.stack_math import power
from warpchain.drive.trains import is_free_body, train_inertia, train_of_body
from warpchain.engine.fill_bodies import lever_squares
from warpchain.engine.packed import Packed


def fill_answers(packed: Packed, rows: NDArray[np.integer], drive: Drive, assembly: Assembly) -> None:
    """Fills `ContactLaw.answer` of a stack's variants; `rows` are theirs in `Packed.drives`."""
    seated = [(assembly.seat_sprocket == s).sum(axis=-1) for s in range(len(drive.sprockets))]
    arms = [lever_squares(drive, a, seated) / drive.arm_inertia(a) for a in range(len(drive.arms))]
    turning = [_turning(drive, s) * n for s, n in enumerate(seated)]
    double = 2.0 * drive.chain.mass
    for s, sprocket in enumerate(drive.sprockets):
        answer = sum(turning[o] for o in train_of_body(drive, s).bodies if o < len(seated))
        if on_springs(sprocket):
            answer = answer + seated[s] / moving_mass(sprocket)
        if (arm := drive.carrier(s)) is not None:
            answer = answer + arms[arm]
        packed.sprockets["law"]["answer"][packed.drives["first_sprocket"][rows] + s] = double * answer
    for g in range(len(drive.guides)):
        if (arm := drive.arm_of(g)) is not None:
            packed.guides["law"]["answer"][packed.drives["first_guide"][rows] + g] = double * arms[arm]


def share_answers(packed: Packed, owners: NDArray[np.int64], places: NDArray[np.int64]) -> None:
    """Makes sprockets of a train that several chains run on answer for all; each is at a place among all, of a row."""
    laws = packed.sprockets["law"]
    own = laws["answer"][places] / packed.chains["mass"][owners]
    total = sum(own[owners == row].max() for row in np.unique(owners))
    laws["answer"][places] = packed.chains["mass"][owners] * total


def _turning(drive: Drive, s: int) -> Any:
    """(R + b)^2 / J of sprocket s, 0 of one that is led [1/kg]."""
    if not is_free_body(drive, s):
        return 0.0
    return power(drive.pitch_radius(s) + drive.engagement(s), 2) / train_inertia(drive, s)
