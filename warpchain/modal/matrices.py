r"""Mass, stiffness, damping and travel matrices of a drive's small motion, by its free coordinates (docs/modes.md).

Oil in a tensioner is a coordinate u [m], its leakage's stroke. All matrices but the mass are derivatives of generalized
forces f(q, v): K = -df/dq and C = -df/dv.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from warpchain.assembly.strand_load import LoadLine, carried_part
from warpchain.engine.force_probe import ForceProbe, ProbeStates
from warpchain.engine.struct_rows import FORCE_NUMBERS

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Coordinates:
    """Free coordinates of a drive's small motion."""

    rollers: int  # N
    mass: float  # of a roller, in the mean [kg]
    relative_mass: Array  # (N,) of each over that
    basis: Array  # (3 B, m) free coordinates of bodies as unit directions of all (x, y, theta)
    inertia: Array  # (m, m) mass matrix of these
    owner: NDArray[np.int64]  # (m,) the body of each
    turning: NDArray[np.bool_]  # (m,) whether it is an angle
    chambers: NDArray[np.int64]  # (w,) indices of tensioners with oil
    area: Array  # (w,) A of their plungers [m^2]
    content_rate: Array  # (w,) -A / V, change of the logarithm of a chamber's oil mass with u [1/m]
    rest: Array  # (w,) pressures at rest [Pa]
    strokes: Array  # (T, n) extensions x of tensioners by the coordinates [-], [m/rad]

    @property
    def coordinate_count(self) -> int:
        """Number n of free coordinates."""
        return self.oil_start + len(self.chambers)

    @property
    def roller_masses(self) -> Array:
        """Masses (2 N,) of the rollers' coordinates [kg]."""
        return np.repeat(self.mass * self.relative_mass, 2)

    @property
    def oil_start(self) -> int:
        """Index of the first coordinate of oil."""
        return 2 * self.rollers + len(self.owner)

    def turning_coordinate(self, b: int) -> tuple[int, float] | None:
        """Index of a body's turning coordinate, and angle, or None."""
        turns = np.where(self.turning, self.basis[3 * b + 2], 0.0)
        found = np.flatnonzero(turns)
        return (2 * self.rollers + int(found[0]), float(turns[found[0]])) if len(found) else None

    @property
    def mass_matrix(self) -> sp.csc_array:
        """Mass matrix M (n, n): block diagonal, zero for oil."""
        own = sp.diags_array(self.roller_masses)
        blocks = [own, self.inertia] if len(self.owner) else [own]
        if len(self.chambers):
            blocks.append(sp.csc_array((len(self.chambers),) * 2))
        return sp.csc_array(sp.block_diag(blocks))

    def displaced_states(self, base: ProbeStates, displacement: Array) -> ProbeStates:
        """Copies of a probe's state with displaced coordinates."""
        straight, turned = self.roller_and_body_parts(displacement)
        oil = np.repeat(base.oil, len(displacement), axis=0)
        oil[:, self.chambers] += self.content_rate * displacement[:, self.oil_start :]
        return ProbeStates(
            base.position + straight,
            np.zeros_like(straight) + base.velocity,
            base.bodies + turned,
            np.zeros_like(turned) + base.rates,
            oil,
        )

    def moving_states(self, base: ProbeStates, velocity: Array) -> ProbeStates:
        """Copies of a probe's state with changed velocities."""
        straight, turned = self.roller_and_body_parts(velocity)
        return ProbeStates(
            np.zeros_like(straight) + base.position,
            base.velocity + straight,
            np.zeros_like(turned) + base.bodies,
            base.rates + turned,
            np.repeat(base.oil, len(velocity), axis=0),
        )

    def generalized_forces(self, probe: ForceProbe, states: ProbeStates) -> Array:
        """Generalized forces (copies, n) on states at rest."""
        straight, turned, pressure = probe(states)
        copies = len(straight)
        own = (turned.reshape(copies, -1) @ self.basis) @ self.inertia
        oil = self.area * (pressure[:, self.chambers] - self.rest)
        return np.hstack([self.roller_masses * straight.reshape(copies, -1), own, oil])

    def coordinate_vector(self, straight: NDArray[Any], turned: NDArray[Any]) -> NDArray[Any]:
        """Coordinate vectors (copies, n) from displacements of rollers and bodies."""
        own = turned.reshape(len(turned), -1) @ np.linalg.pinv(self.basis).T
        return np.hstack([straight.reshape(len(straight), -1), own, np.zeros((len(own), len(self.chambers)))])

    def roller_and_body_parts(self, vector: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
        """Displacements of rollers and bodies from coordinate vectors."""
        own = 2 * self.rollers
        straight = vector[:, :own].reshape(len(vector), self.rollers, 2)
        turned = vector[:, own : self.oil_start] @ self.basis.T
        return straight, turned.reshape(len(vector), len(self.basis) // 3, 3)


def free_coordinates(probe: ForceProbe, states: ProbeStates) -> Coordinates:
    """Free coordinates of a drive in a state."""
    rows = [probe.body_freedom(b, float(states.bodies[0, b, 2])) for b in range(probe.body_count)]
    turned = [probe.train_angles(b) for b in range(probe.body_count)]
    rows = [row.without_turning() if len(turned[b]) == 0 else row for b, row in enumerate(rows)]
    count = [row.free.shape[1] for row in rows]
    basis = np.zeros((3 * len(rows), sum(count)))
    inertia = np.zeros((sum(count), sum(count)))
    at = 0
    for b, row in enumerate(rows):
        mine = slice(at, at + count[b])
        basis[3 * b : 3 * b + 3, mine] = row.free
        inertia[mine, mine] = row.free.T @ row.inertia @ row.free
        if len(turned[b]) > 1 and row.free[2].any():  # its angle is the last of its coordinates
            angle = at + count[b] - 1
            basis[2::3, angle] = turned[b]
            inertia[mine, angle] *= turned[b][b]
            inertia[angle, mine] *= turned[b][b]
        at += count[b]
    owner = np.repeat(np.arange(len(rows)), count)
    for b, on, shared in probe.arm_joints(states.bodies[0, :, 2]):
        i, j = np.flatnonzero(owner == b)[0], np.flatnonzero(owner == on)[-1]
        inertia[i, j] = inertia[j, i] = shared
    turning = np.asarray(basis.reshape(len(rows), 3, sum(count))[:, 2].any(axis=0))
    of = probe.base.tensioners[: probe.tensioners]
    chambers = np.flatnonzero(of["hydraulic"] == 1)
    wet = of[chambers]
    x, change = tensioner_strokes(probe, states)
    volume = wet["volume"] + wet["area"] * np.maximum(x[chambers], wet["bottom"])
    n = 2 * probe.rollers
    moves = np.hstack([np.zeros((len(of), n)), change @ basis, np.zeros((len(of), len(chambers)))])
    mass, area, rate = float(probe.base.chains["mass"][0]), wet["area"].copy(), -wet["area"] / volume
    load = probe.base.chains["load"][0]
    goods = np.zeros(probe.rollers)
    if load["relative_mass"]:
        line = LoadLine(*(load[name] for name in LoadLine._fields))
        goods = load["relative_mass"] * carried_part(states.position[0], line, 1.0 / load["per_pitch"])
    masses = mass, probe.base.relative_mass[: probe.rollers] + goods
    return Coordinates(
        probe.rollers, *masses, basis, inertia, owner, turning, chambers, area, rate, wet["rest"].copy(), moves
    )


def tensioner_strokes(probe: ForceProbe, states: ProbeStates) -> tuple[Array, Array]:
    """Extensions (T,) [m] of tensioners, and derivatives (T, 3 B)."""
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


DISPLACEMENT_STEP = 1e-7
"""Displacement of difference quotients, in pitches."""
MOST_VELOCITY_STEP = 2.0**-17
"""Largest velocity of difference quotients [m/s]."""


def separate_roller_sets(rollers: int) -> list[NDArray[np.int64]]:
    """Sets of a chain's rollers, at least three apart in each."""
    # a roller feels only its two neighbors and the bodies, so those of a set move in one copy of the state
    whole = rollers - rollers % 3
    sets = [np.arange(first, whole, 3) for first in range(3)]
    return sets + [np.array([i]) for i in range(whole, rollers)]


def stiffness_matrix(probe: ForceProbe, at: Coordinates, base: ProbeStates, pitch: float) -> sp.csc_array:
    """Stiffness matrix K (n, n) of a drive."""
    return _force_derivative(
        probe,
        at,
        _coordinate_steps(probe, at, DISPLACEMENT_STEP * pitch),
        lambda change: at.displaced_states(base, change),
    )


def damping_matrix(
    probe: ForceProbe, at: Coordinates, base: ProbeStates, conductance: Array | None = None
) -> sp.csc_array:
    """Damping matrix C (n, n) of a drive at rest.

    Args:
        conductance: (w,) of leaking oil; None leaves it out.
    """
    steps = _coordinate_steps(probe, at, velocity_step(probe))
    own = _force_derivative(probe, at, steps, lambda change: at.moving_states(base, change))
    return own if conductance is None else sp.csc_array(own + leakage_matrix(probe, at, conductance))


def velocity_step(probe: ForceProbe) -> float:
    """Velocity [m/s] for difference quotients of forces that damp linearly."""
    counts, step = probe.base.drives[0], MOST_VELOCITY_STEP
    for parts, count in ((probe.base.sprockets, counts["sprockets"]), (probe.base.guides, counts["guides"])):
        law = parts["law"][:count]
        limit = 0.5 * law["speed_floor"] / np.maximum(law["damping"], 1.0)
        step = min(
            step, float(limit[law["form"] == FORCE_NUMBERS["hysteretic_damper"]].min(initial=MOST_VELOCITY_STEP))
        )
    return step


def leakage_matrix(probe: ForceProbe, at: Coordinates, conductance: Array) -> sp.csc_array:
    """Part (n, n) of the damping matrix by leakage of oil."""
    of = probe.base.tensioners[at.chambers]
    places = at.oil_start + np.arange(len(of))
    gap = np.zeros((len(of), at.coordinate_count))
    gap[np.arange(len(of)), places] = of["area"] ** 2 / conductance
    gap -= (of["area"] * of["drag"] / conductance)[:, None] * at.strokes[at.chambers]
    above = sp.csc_array((at.oil_start, at.coordinate_count))
    return sp.csc_array(sp.vstack([above, sp.csc_array(gap)]))


def travel_matrix(rollers: int, mass: float, rate: float, links: NDArray[np.bool_], count: int) -> sp.csc_array:
    """Travel matrix G (n, n), skew, of a running chain."""
    i = np.flatnonzero(links)
    j = (i + 1) % rollers
    value = np.full(len(i), mass * rate)
    chain = sp.coo_array((np.append(value, -value), (np.append(i, j), np.append(j, i))), shape=(rollers, rollers))
    both = sp.kron(chain.tocsc(), sp.eye_array(2))
    return sp.csc_array(sp.block_diag([both, sp.csc_array((count - 2 * rollers,) * 2)]))


def centrifugal_matrix(rollers: int, mass: float, rate: float, count: int) -> sp.csc_array:
    """Part (n, n) of the stiffness matrix by centrifugal force."""
    i = np.arange(rollers)
    j = (i + 1) % rollers
    value = np.full(rollers, mass * rate * rate)
    at = np.concatenate([i, i, j]), np.concatenate([i, j, i])
    chain = sp.coo_array((np.concatenate([2.0 * value, -value, -value]), at), shape=(rollers, rollers))
    both = sp.kron(chain.tocsc(), sp.eye_array(2))
    return sp.csc_array(sp.block_diag([both, sp.csc_array((count - 2 * rollers,) * 2)]))


def _coordinate_steps(probe: ForceProbe, at: Coordinates, step: float) -> Array:
    """Steps (n,) of coordinates for difference quotients."""
    widest = float(probe.base.sprockets["exact_radius"].max(initial=probe.base.chains["length"][0]))
    steps = np.full(at.coordinate_count, step)
    steps[2 * at.rollers : at.oil_start][at.turning] /= widest
    return np.asarray(2.0 ** np.floor(np.log2(steps)))


def _force_derivative(probe, at: Coordinates, steps: Array, states) -> sp.csc_array:  # type: ignore[no-untyped-def]
    """Negative derivative (n, n) of generalized forces, by central differences."""
    own, n = 2 * at.rollers, at.coordinate_count
    sets = [2 * some + axis for some in separate_roller_sets(at.rollers) for axis in (0, 1)]
    sets += [np.array([k]) for k in range(own, n)]
    change = np.zeros((len(sets), n))
    for row, some in zip(change, sets, strict=True):
        row[some] = steps[some]
    both = at.generalized_forces(probe, states(np.concatenate([change, -change])))
    slope = -0.5 * (both[: len(sets)] - both[len(sets) :])
    rows, columns, values = [], [], []
    near = np.arange(-2, 4)  # a roller's neighbors' coordinates, from its own x
    for some, answer in zip(sets, slope, strict=True):
        if some[0] < own:
            felt = (some - some % 2)[:, None] + near
            felt %= own
            columns.append(np.repeat(some, len(near)))
            rows.append(felt.ravel())
            values.append((answer[felt] / steps[some][:, None]).ravel())
        else:
            column = answer / steps[some]
            felt = np.flatnonzero(column)
            rollers = felt[felt < own]
            rows += [felt, np.full(len(rollers), some[0])]
            columns += [np.full(len(felt), some[0]), rollers]
            values += [column[felt], column[rollers]]
    place = (np.concatenate(rows), np.concatenate(columns))
    matrix = sp.coo_array((np.concatenate(values), place), shape=(n, n)).tocsc()
    return sp.csc_array(0.5 * (matrix + matrix.T))
