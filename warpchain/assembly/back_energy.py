"""Elastic energy of backs of a silent chain's links on a guide, its gradient and Hessian (`kernels.physics.back`)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly.link_contact_energy import (
    DIFFERENCE_STEP,
    Array,
    LinkContacts,
    along_direction,
    difference_hessian,
)
from warpchain.drive.chain import Chain
from warpchain.drive.face_profile import Profile, unit_vector
from warpchain.drive.plate import CROWN


@dataclass(frozen=True)
class Backs:
    """Backs of a silent chain's links on a guide.

    Attributes:
        chain: the chain.
        side: +1 where wheels are to the left of its travel, else -1.
        profile: the guide's face where it stands.
        center: about which it turns [m].
        offset: height of touching pins over the face [m].
        stiffness: generalized stiffness of a contact [N/m^n].
        exponent: n of the contact law [-].
    """

    chain: Chain
    side: float
    profile: Profile
    center: Array
    offset: float
    stiffness: float
    exponent: float

    def near_links(self, pins: Array) -> NDArray[np.int64]:
        """Numbers of the links that touch the guide, of pins (N, 2) [m]."""
        values = np.zeros((len(pins), 7))
        values[:, :4], values[:, 4:6] = np.hstack([pins, np.roll(pins, -1, axis=0)]), self.center
        return np.flatnonzero(self.energy(values)[0] > 0.0)

    def energy(self, x: Array) -> tuple[Array, Array]:
        """Energies (M,) [J] of backs, and gradients (M, 7), by coordinates `x` (M, 7).

        The coordinates are the places of a link's pins, of the guide's center of turn, and its angle from where it is.
        """
        return self._contacts(x).energy(self.stiffness, self.exponent)

    def hessian(self, x: Array) -> Array:
        """Hessians (M, 7, 7) of the backs' energies, by differences of gradients."""
        apart = np.full(7, DIFFERENCE_STEP * self.chain.pitch)
        apart[6] = DIFFERENCE_STEP
        return difference_hessian(lambda at: self.energy(at)[1], x, apart)

    def _contacts(self, x: Array) -> LinkContacts:
        """Contacts of backs with the guide."""
        radius = CROWN * self.chain.pitch
        rise = radius - self.offset
        d = x[:, 2:4] - x[:, 0:2]
        length = np.hypot(d[:, 0], d[:, 1])
        u, middle = d / length[:, None], 0.5 * (x[:, 0:2] + x[:, 2:4])
        across = self.side * np.stack([-u[:, 1], u[:, 0]], axis=1)
        crown = middle + rise * across - x[:, 4:6]  # from the guide's center
        c, s = np.cos(x[:, 6]), np.sin(x[:, 6])
        place = self.center + np.stack([c * crown[:, 0] + s * crown[:, 1], c * crown[:, 1] - s * crown[:, 0]], axis=1)
        depth, normal = np.zeros(len(x)), np.zeros((len(x), 2))
        for piece in self.profile.pieces:
            (on_u, on_w, at, height, root), k = piece.heights(place), piece.curvature
            mine = (height < radius) & (height > radius - self.offset) & (at >= 0.0) & (at < piece.length)
            t, root = np.array(unit_vector(piece.heading)), np.maximum(root[:, None], 1e-6)
            facing = (1.0 - k * on_w[:, None]) / root * [-t[1], t[0]] - k * on_u[:, None] / root * t
            depth = np.where(mine, radius - height, depth)
            normal = np.where(mine[:, None], facing, normal)
        normal = np.stack([c * normal[:, 0] - s * normal[:, 1], s * normal[:, 0] + c * normal[:, 1]], axis=1)
        z = rise * across - radius * normal
        under = (np.abs(along_direction(z, u)) <= 0.5 * length) & (along_direction(normal, across) > 0.0)
        return LinkContacts(np.where(under, depth, 0.0), normal, middle + z - x[:, 4:6], z, u, length)
