"""Contact mobility of bodies under dampers of all contacts at once: G of `kernels.physics.impact`,

    G = 2 m sum n (mobility),

with n rollers seated, over the train and all that an arm carries; mobilities are (R + b)^2 / J of a sprocket with its
train, 1 / M of a center on springs, r^2 / I of an arm.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly import Assembly
from warpchain.drive.stack_math import Number, power
from warpchain.engine.body_struct_rows import squared_levers
from warpchain.engine.packed_ensemble import PackedEnsemble
from warpchain.kernels.physics.toe import LINK_ANSWER
from warpchain.model import ChainModel
from warpchain.model.mounts import is_on_springs, moving_mass
from warpchain.model.trains import is_free_body, train_inertia, train_of_body


def fill_contact_mobility(
    packed: PackedEnsemble, rows: NDArray[np.integer], model: ChainModel, assembly: Assembly
) -> None:
    """Fills contact mobility G of a stack's variants."""
    seated = [(assembly.seat_sprocket == s).sum(axis=-1) for s in range(len(model.sprockets))]
    arms = [squared_levers(model, a, seated) / model.arm_inertia(a) for a in range(len(model.arms))]
    turning = [_turning_mobility(model, s) * n for s, n in enumerate(seated)]
    double = 2.0 * model.chain.mass
    for s, sprocket in enumerate(model.sprockets):
        answer = sum(turning[o] for o in train_of_body(model, s).bodies if o < len(seated))
        if is_on_springs(sprocket):
            answer = answer + seated[s] / moving_mass(sprocket)
        if (arm := model.carrier(s)) is not None:
            answer = answer + arms[arm]
        beside = LINK_ANSWER if model.chain.is_silent else 0.0
        packed.sprockets["law"]["answer"][packed.drives["first_sprocket"][rows] + s] = double * answer + beside
    for g in range(len(model.guides)):
        if (arm := model.arm_of(g)) is not None:
            mine, count = packed.drives["first_guide"][rows] + g, len(model.guides)
            for sort in range(1 + model.chain.is_silent):  # backs and pins, which press the arm both
                own = (1 + model.chain.is_silent) * double * arms[arm]
                packed.guides["law"]["answer"][mine + sort * count] += own


def sum_mobility_over_chains(packed: PackedEnsemble, owners: NDArray[np.int64], places: NDArray[np.int64]) -> None:
    """Sums contact mobility G of a train over chains."""
    laws = packed.sprockets["law"]
    own = laws["answer"][places] / packed.chains["mass"][owners]
    total = sum(own[owners == row].max() for row in np.unique(owners))
    laws["answer"][places] = packed.chains["mass"][owners] * total


def _turning_mobility(model: ChainModel, s: int) -> Number:
    """Turning mobility (R + b)^2 / J of a sprocket [1/kg], or 0."""
    if not is_free_body(model, s):
        return 0.0
    return power(model.pitch_radius(s) + model.engagement(s), 2) / train_inertia(model, s)
