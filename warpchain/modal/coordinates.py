"""The free coordinates of a drive: rollers (x_0, y_0, x_1, ...), those of the bodies that are free, and oil.

Displacements, velocities and forces are (n,) vectors of these; states are `engine.probe.States`.

The oil in the chamber of a hydraulic tensioner is a spring, what leaks a damper in series with it (a Maxwell element).
Its coordinate u is that damper's stroke [m]: A u is the volume that has leaked. With the pressure's excess
p = P - P_rest over the one at rest, G the conductance of the gap, E and V modulus and volume of the chamber,

    A p = -(E A^2 / V) (x + u),    (A^2 / G) u' = A p + (A d / G) x'                                    (a)

at the pressure at which the valve brings in what leaks; d x' is the oil that the plunger drags through the gap. The
force on u is A p, its damping A^2 / G, and it has no mass.
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
    """The n = 2 N + m + w free coordinates of a drive of N rollers and B bodies, of which m coordinates are free, and w
    chambers of oil.

    Attributes:
        rollers: N.
        mass: of a roller [kg].
        basis: (3 B, m) each free coordinate of a body as a unit direction of all (x, y, theta).
        inertia: (m, m) mass matrix of these.
        owner: (m,) the body of each.
        turning: (m,) whether it is an angle.
        chambers: (w,) the tensioners that have oil, of T.
        area: (w,) A of their plungers [m^2].
        content_rate: (w,) change of the logarithm of a chamber's mass of oil with u [1/m]: -A / V.
        rest: (w,) pressures at rest [Pa].
        strokes: (T, n) extension x of each tensioner for a unit of each coordinate [-], [m/rad].
    """

    rollers: int
    mass: float
    basis: Array
    inertia: Array
    owner: NDArray[np.int64]
    turning: NDArray[np.bool_]
    chambers: NDArray[np.int64]
    area: Array
    content_rate: Array
    rest: Array
    strokes: Array

    @property
    def count(self) -> int:
        """n."""
        return self.solid + len(self.chambers)

    @property
    def solid(self) -> int:
        """2 N + m: where the coordinates of oil begin."""
        return 2 * self.rollers + len(self.owner)

    @property
    def masses(self) -> sp.csc_array:
        """(n, n) mass matrix: block diagonal, and zero for oil."""
        own = sp.diags_array(np.full(2 * self.rollers, self.mass))
        blocks = [own, self.inertia] if len(self.owner) else [own]
        if len(self.chambers):
            blocks.append(sp.csc_array((len(self.chambers),) * 2))
        return sp.csc_array(sp.block_diag(blocks))

    def moved(self, base: States, displacement: Array) -> States:
        """Copies of one state, displaced by (copies, n)."""
        straight, turned = self.split(displacement)
        oil = np.repeat(base.oil, len(displacement), axis=0)
        oil[:, self.chambers] += self.content_rate * displacement[:, self.solid :]
        return States(
            base.position + straight,
            np.zeros_like(straight) + base.velocity,
            base.bodies + turned,
            np.zeros_like(turned) + base.rates,
            oil,
        )

    def moving(self, base: States, velocity: Array) -> States:
        """Copies of one state, their velocities changed by (copies, n)."""
        straight, turned = self.split(velocity)
        return States(
            np.zeros_like(straight) + base.position,
            base.velocity + straight,
            np.zeros_like(turned) + base.bodies,
            base.rates + turned,
            np.repeat(base.oil, len(velocity), axis=0),
        )

    def forces(self, probe: Probe, states: States) -> Array:
        """Generalized forces of states at rest, (copies, n): mass matrix times accelerations."""
        straight, turned, pressure = probe(states)
        copies = len(straight)
        own = (turned.reshape(copies, -1) @ self.basis) @ self.inertia
        oil = self.area * (pressure[:, self.chambers] - self.rest)
        return np.hstack([self.mass * straight.reshape(copies, -1), own, oil])

    def vector(self, straight: NDArray[Any], turned: NDArray[Any]) -> NDArray[Any]:
        """Vectors (copies, n) of displacements of rollers (copies, N, 2) and bodies (copies, B, 3), 0 for oil."""
        own = turned.reshape(len(turned), -1) @ self.basis
        return np.hstack([straight.reshape(len(straight), -1), own, np.zeros((len(own), len(self.chambers)))])

    def split(self, vector: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
        """Rollers' (copies, N, 2) and bodies' (copies, B, 3) parts of vectors (copies, n)."""
        own = 2 * self.rollers
        straight = vector[:, :own].reshape(len(vector), self.rollers, 2)
        turned = vector[:, own : self.solid] @ self.basis.T
        return straight, turned.reshape(len(vector), len(self.basis) // 3, 3)


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
    of = probe.base.tensioners[: probe.tensioners]
    chambers = np.flatnonzero(of["hydraulic"] == 1)
    wet = of[chambers]
    x, change = strokes(probe, states)
    volume = wet["volume"] + wet["area"] * np.maximum(x[chambers], wet["bottom"])
    n = 2 * probe.rollers
    moves = np.hstack([np.zeros((len(of), n)), change @ basis, np.zeros((len(of), len(chambers)))])
    mass, area, rate = float(probe.base.chains["mass"][0]), wet["area"].copy(), -wet["area"] / volume
    return Coordinates(
        probe.rollers, mass, basis, inertia, owner, turning, chambers, area, rate, wet["rest"].copy(), moves
    )


def strokes(probe: Probe, states: States) -> tuple[Array, Array]:
    """(T,) extension of each tensioner in the first of the states [m], and (T, 3 B) its derivative by the bodies'
    (x, y, theta)."""
    of = probe.base.tensioners[: probe.tensioners]
    body = states.bodies[0, of["body"]]
    cosine, sine, point = np.cos(body[:, 2]), np.sin(body[:, 2]), of["point"]
    lever = np.stack([point[:, 0] * cosine - point[:, 1] * sine, point[:, 0] * sine + point[:, 1] * cosine], axis=1)
    along = of["direction"]
    x = ((body[:, :2] + lever - of["home"]) * along).sum(axis=1)
    change = np.zeros((len(of), probe.body_count, 3))
    change[np.arange(len(of)), of["body"], :2] = along
    change[np.arange(len(of)), of["body"], 2] = lever[:, 0] * along[:, 1] - lever[:, 1] * along[:, 0]
    return x, change.reshape(len(of), 3 * probe.body_count)
