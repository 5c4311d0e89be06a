"""The free coordinates of a drive: rollers (x_0, y_0, x_1, ...), then those of the bodies that are free.

Displacements, velocities and forces are (n,) vectors of these; states are `engine.probe.States`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from warpchain.engine.probe import Probe, States

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Coordinates:
    """The n = 2 N + m free coordinates of a drive of N rollers and B bodies, of which m coordinates are free.

    Attributes:
        rollers: N.
        mass: of a roller [kg].
        basis: (3 B, m) each free coordinate of a body as a unit direction of all (x, y, theta).
        inertia: (m, m) mass matrix of these.
        owner: (m,) the body of each.
        turning: (m,) whether it is an angle.
    """

    rollers: int
    mass: float
    basis: Array
    inertia: Array
    owner: NDArray[np.int64]
    turning: NDArray[np.bool_]

    @property
    def count(self) -> int:
        """n."""
        return 2 * self.rollers + len(self.owner)

    @property
    def masses(self) -> sp.csc_array:
        """(n, n) mass matrix: block diagonal."""
        own = sp.diags_array(np.full(2 * self.rollers, self.mass))
        return sp.csc_array(sp.block_diag([own, self.inertia]) if len(self.owner) else own)

    def moved(self, base: States, displacement: Array) -> States:
        """Copies of one state, displaced by (copies, n)."""
        straight, turned = self.split(displacement)
        return States(
            base.position + straight,
            np.zeros_like(straight) + base.velocity,
            base.bodies + turned,
            np.zeros_like(turned) + base.rates,
        )

    def moving(self, base: States, velocity: Array) -> States:
        """Copies of one state, their velocities changed by (copies, n)."""
        straight, turned = self.split(velocity)
        return States(
            np.zeros_like(straight) + base.position,
            base.velocity + straight,
            np.zeros_like(turned) + base.bodies,
            base.rates + turned,
        )

    def forces(self, probe: Probe, states: States) -> Array:
        """Generalized forces of states at rest, (copies, n): mass matrix times accelerations."""
        straight, turned = probe(states)
        copies = len(straight)
        own = (turned.reshape(copies, -1) @ self.basis) @ self.inertia
        return np.hstack([self.mass * straight.reshape(copies, -1), own])

    def vector(self, straight: NDArray[Any], turned: NDArray[Any]) -> NDArray[Any]:
        """Vectors (copies, n) of displacements of rollers (copies, N, 2) and bodies (copies, B, 3)."""
        own = turned.reshape(len(turned), -1) @ self.basis
        return np.hstack([straight.reshape(len(straight), -1), own])

    def split(self, vector: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
        """Rollers' (copies, N, 2) and bodies' (copies, B, 3) parts of vectors (copies, n)."""
        own = 2 * self.rollers
        straight = vector[:, :own].reshape(len(vector), self.rollers, 2)
        return straight, (vector[:, own:] @ self.basis.T).reshape(len(vector), len(self.basis) // 3, 3)


def coordinates(probe: Probe, states: States) -> Coordinates:
    """The free coordinates of a drive, with the bodies' inertia where they stand in `states`."""
    rows = [probe.body(b, float(states.bodies[0, b, 2])) for b in range(probe.body_count)]
    count = [row.free.shape[1] for row in rows]
    basis = np.zeros((3 * len(rows), sum(count)))
    inertia = np.zeros((sum(count), sum(count)))
    at = 0
    for b, row in enumerate(rows):
        mine = slice(at, at + count[b])
        basis[3 * b : 3 * b + 3, mine] = row.free
        inertia[mine, mine] = row.free.T @ row.inertia @ row.free
        at += count[b]
    owner = np.repeat(np.arange(len(rows)), count)
    turning = np.asarray(basis.reshape(len(rows), 3, sum(count))[:, 2].any(axis=0))
    return Coordinates(probe.rollers, float(probe.base.chains["mass"][0]), basis, inertia, owner, turning)
