"""Elastic energy of a silent chain's toes on a wheel's teeth, its gradient and Hessian (`kernels.physics.toe`)."""

from __future__ import annotations

import math
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
from warpchain.drive.plate import tooth_corner
from warpchain.model import ChainModel


@dataclass(frozen=True)
class Wheel:
    """Wheel of a silent chain with what its teeth's contacts need.

    Attributes:
        s: index of its sprocket.
        stiffness: generalized stiffness of a flank's end [N/m^n].
        exponent: n of the contact law [-].
    """

    model: ChainModel
    s: int
    stiffness: float
    exponent: float

    def near_pins(self, place: Array) -> NDArray[np.int64]:
        """Pins whose toes may touch teeth, of places (N, 2) from the wheel's center."""
        distance, radius, pitch = np.hypot(*place.T), self.model.pitch_radius(self.s), self.model.chain.pitch
        return np.flatnonzero(np.abs(distance - radius) < max(self.model.engagement(self.s), pitch))

    def energy(self, x: Array, number: int) -> tuple[Array, Array]:
        """Energies (M,) [J] of toes' flank ends, and gradients (M, 7), by coordinates `x` (M, 7).

        These are the pin's place, the link's other pin's, the wheel's center, and its angle.

        Args:
            number: 0, 1 tip and beginning of the flank on the link after the pin, 2, 3 on that before.
        """
        return self._contacts(x, number).energy(self.stiffness, self.exponent)

    def hessian(self, x: Array, number: int) -> Array:
        """Hessians (M, 7, 7) of the toes' energies, by differences of gradients."""
        apart = np.full(7, DIFFERENCE_STEP * self.model.chain.pitch)
        apart[6] /= self.model.pitch_radius(self.s)
        return difference_hessian(lambda at: self.energy(at, number)[1], x, apart)

    def _contacts(self, x: Array, number: int) -> LinkContacts:
        """Contacts of toes with teeth."""
        model, plate, teeth = self.model, self.model.chain.plate, self.model.sprockets[self.s].teeth
        radius, tooth = model.pitch_radius(self.s), model.tooth(self.s)
        pin, far, center = x[:, 0:2], x[:, 2:4], x[:, 4:6]
        d = far - pin
        length = np.hypot(d[:, 0], d[:, 1])
        u, middle = d / length[:, None], 0.5 * (pin + far) - center
        turn = model.sprockets[0].sign * (1.0 if number < 2 else -1.0)
        w = turn * np.stack([-u[:, 1], u[:, 0]], axis=1)
        ends = []
        for end in (0, 1):
            along, down = plate.flank_end(end)
            ends.append(middle + (along - 0.5 * plate.pitch) * u + down * w)
        begin, tip = ends
        step = 2.0 * math.pi / teeth
        polar = x[:, 6] + step * np.rint((np.arctan2(tip[:, 1], tip[:, 0]) - x[:, 6]) / step)
        e = np.stack([np.cos(polar), np.sin(polar)], axis=1)
        tau = np.stack([-e[:, 1], e[:, 0]], axis=1)
        cosine, sine = math.sin(0.5 * tooth.seat_angle), math.cos(0.5 * tooth.seat_angle)  # of flanks to e
        outward, foot = (
            cosine * e - turn * sine * tau,
            radius * e - plate.flank_distance * (sine * e + turn * cosine * tau),
        )
        corner = foot + tooth_corner(plate, teeth, model.sprocket_pitch(self.s)) * outward
        reach = along_direction(corner - foot, outward)
        at_tip = np.full(len(x), number % 2 == 0) | (along_direction(tip - foot, outward) > reach)
        at = np.where(at_tip[:, None], tip, begin)
        depth, normal = self._depth(at, e, tau, radius, (cosine, sine))
        place = at - plate.tip_radius * normal
        facing = math.cos(plate.flank_angle) * u - math.sin(plate.flank_angle) * w
        on_corner = ~at_tip & (along_direction(begin - foot, outward) > reach)
        depth = np.where(on_corner, plate.tip_radius + along_direction(corner - tip, facing), depth)
        normal, place = np.where(on_corner[:, None], facing, normal), np.where(on_corner[:, None], corner, place)
        return LinkContacts(depth, normal, place, place - middle, u, length)

    def _depth(self, at: Array, e: Array, tau: Array, radius: float, flank: tuple[float, float]) -> tuple[Array, Array]:
        """Depths in teeth [m], and normals, of toes' arcs at centers `at` (M, 2)."""
        plate, tooth, (cosine, sine) = self.model.chain.plate, self.model.tooth(self.s), flank
        xi, eta, distance = along_direction(at, e) - radius, along_direction(at, tau), np.hypot(at[:, 0], at[:, 1])
        on_flank = np.abs(eta) * cosine - xi * sine - (plate.flank_distance - plate.tip_radius)
        on_tip = tooth.tip_radius + plate.tip_radius - distance
        flanks = sine * e - np.where(eta >= 0.0, cosine, -cosine)[:, None] * tau
        higher = (on_flank > on_tip)[:, None]
        return np.minimum(on_flank, on_tip), np.where(higher, at / distance[:, None], flanks)
