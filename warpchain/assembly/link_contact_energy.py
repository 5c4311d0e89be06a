"""Energy of contacts of a silent chain's links with bodies, its gradient and Hessian (`kernels.physics.toe`).

Coordinates (M, 7) are the places of a link's two pins, the body's center of turn, and its angle.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

DIFFERENCE_STEP = 1e-7
"""Step of the differences of gradients, in pitches."""


@dataclass(frozen=True)
class LinkContacts:
    """Contacts of links with a body.

    Attributes:
        depth: (M,) penetrations [m], negative or 0 where open.
        normal: (M, 2) from the body into the link.
        arm: (M, 2) places from the body's center of turn [m].
        place: (M, 2) places from the links' middles [m].
        u: (M, 2) unit vectors along the links.
        length: (M,) of the links [m].
    """

    depth: Array
    normal: Array
    arm: Array
    place: Array
    u: Array
    length: Array

    def energy(self, stiffness: float, exponent: float) -> tuple[Array, Array]:
        """Energies (M,) [J] of contacts of a generalized stiffness [N/m^n], and gradients (M, 7)."""
        normal, u = self.normal, self.u
        pushed = np.maximum(self.depth, 0.0)
        force = stiffness * pushed**exponent
        lever = (self.place[:, 0] * normal[:, 1] - self.place[:, 1] * normal[:, 0]) / self.length
        turning = lever[:, None] * np.stack([-u[:, 1], u[:, 0]], axis=1)
        moment = self.arm[:, 0] * normal[:, 1] - self.arm[:, 1] * normal[:, 0]
        slope = np.concatenate([turning - 0.5 * normal, -turning - 0.5 * normal, normal, moment[:, None]], axis=1)
        return force * pushed / (exponent + 1.0), force[:, None] * slope


def difference_hessian(gradient: Callable[[Array], Array], x: Array, apart: Array) -> Array:
    """Hessians (M, 7, 7) at coordinates `x` (M, 7), by differences of gradients over `apart` (7,)."""
    steps = np.diag(apart)[:, None]
    slope = gradient(np.concatenate([x + steps, x - steps]).reshape(-1, 7)).reshape(2, 7, len(x), 7)
    found = np.moveaxis((slope[0] - slope[1]) / (2.0 * apart[:, None, None]), 0, 1)
    return 0.5 * (found + np.swapaxes(found, 1, 2))


def along_direction(place: Array, direction: Array) -> Array:
    """Components (M,) of places along directions, each (M, 2)."""
    return np.einsum("mi,mi->m", place, direction)
