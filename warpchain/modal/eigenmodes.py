r"""Modes of a drive by the eigenvalues of its small motion: frequency, damping ratio, energy shares and shape.

    (s^2 M + s (C + G) + K) x = 0,    s = -zeta omega +- i omega sqrt(1 - zeta^2),

K the stiffness, C the damping, G the travel of strands (docs/modes.md).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal, overload

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import LinearOperator, eigs, splu

from warpchain.argument_checks import Count, Index, NonNegativeNumber, Workers, check_arguments
from warpchain.drive import Drive
from warpchain.engine.process_pool import map_in_processes
from warpchain.engine.simulation import available_cores
from warpchain.errors import SimulationError, WarpchainError
from warpchain.modal.matrices import Array
from warpchain.modal.rigid_rotation import free_rotations, stiffness_without_rotation
from warpchain.modal.small_motion import ChainMotion, DriveMotion, drive_motion
from warpchain.modal.tensioner_modes import PlungerMotion, plunger_motion, standing_lines
from warpchain.model import ChainModel, Model, single_chain
from warpchain.progress import Progress, interruptible_work, progress_reporter

PartEnergy = tuple[str, Array]
SMALL_PENCIL = 120
EIGENVALUE_SHIFT = 1e-2
INFINITE_EIGENVALUE = 1e-9


def eigenpairs(
    mass: sp.csc_array, damping: sp.csc_array, stiffness: sp.csc_array, wanted: int, unit: float
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Eigenvalues (K,) [1/s], ascending by size, and eigenvectors (n, K).

    Args:
        unit: a frequency of the size of those wanted [rad/s].
    """
    n = mass.shape[0]
    m, c, k = mass, damping / unit, stiffness / unit**2
    if n <= SMALL_PENCIL:
        above = np.hstack([np.zeros((n, n)), np.eye(n)])
        below = np.hstack([-k.toarray(), -c.toarray()])
        right = scipy.linalg.block_diag(np.eye(n), m.toarray())
        (top, bottom), vector = scipy.linalg.eig(np.vstack([above, below]), right, homogeneous_eigvals=True)
        finite = np.abs(bottom) > INFINITE_EIGENVALUE * np.abs(top)
        value, vector = top[finite] / bottom[finite], vector[:, finite]
    else:
        value, vector = _nearest_eigenpairs(m, c, k, min(2 * wanted + 8, n))
    upper = np.flatnonzero(value.imag >= 0.0)
    upper = upper[np.argsort(np.abs(value[upper]))]
    return unit * value[upper], vector[:n, upper]


def _nearest_eigenpairs(m: sp.csc_array, c: sp.csc_array, k: sp.csc_array, count: int) -> tuple[Array, Array]:
    """Eigenvalues and eigenvectors nearest to 0, by Arnoldi's method."""
    n = m.shape[0]
    factor = splu((k + EIGENVALUE_SHIFT * c + EIGENVALUE_SHIFT**2 * m).tocsc())
    drag = (c + EIGENVALUE_SHIFT * m).tocsr()

    def apply_inverse(vector: Array) -> Array:
        """Vector (2 n,) times the shifted, inverted pencil."""
        first, second = vector[:n], m @ vector[n:]
        x = -factor.solve(second + drag @ first)
        return np.concatenate([x, first + EIGENVALUE_SHIFT * x])

    inverse = LinearOperator((2 * n, 2 * n), matvec=apply_inverse, dtype=np.float64)
    start = np.random.default_rng(0).standard_normal(2 * n)
    value, vector = eigs(inverse, k=count, v0=start, ncv=min(2 * n - 1, max(3 * count, 60)), maxiter=2000)
    return EIGENVALUE_SHIFT + 1.0 / value, vector


ZERO_FREQUENCY = 1e-5
"""Frequency that counts as zero, over sqrt(k / m)."""
RESTORING_STIFFNESS = 1e-7
"""Least stiffness that restores, over a link's."""


@dataclass(frozen=True)
class Modes:
    """Modes of a drive: frequencies, damping, energy shares, shapes.

    Attributes:
        drive: with N rollers (one chain after the other), B bodies, T tensioners.
        speed: of the driver [rad/s]; 0 is at rest.
        eigenvalue: (K,) s = -zeta omega + i omega sqrt(1 - zeta^2) [1/s], ascending by size.
        names: (K,) the part that moves most, and a number: "motor->conveyor 2".
        parts: (P,) strands ("CHAIN.FROM->TO" of several chains), sprockets with rollers, mounts ("NAME.mount"), other
            shafts, arms, plungers.
        participation: (K, P) shares of the kinetic energy.
        across: (K,) share of the rollers' kinetic energy transverse to the chain.
        shape: (K, N, 2) complex displacement of rollers at unit modal mass [m].
        bodies: (K, B, 3) complex displacement (x, y, theta).
        stroke: (K, T) complex extension of tensioners [m].
        pressure: (K, T) complex pressure of oil [Pa]; 0 without oil.
        stored: (K, T) share of x* K x in a tensioner.
        lost: (K, T) share of x* C x in a tensioner.
        position: (N, 2) of rollers at rest [m].
        placed: (B, 3) of bodies at rest.
        tension: (N,) of links at rest [N].
        rotations: groups that turn freely at 0 Hz, not among the K.
        zeros: other motions without restoring force, not among the K.
        growing: (U,) growth rates of motions without swinging [1/s].
        creeping: (O,) decay rates of motions without swinging [1/s].
        standing: lines on how arms and tensioners stand.
        chain: the one chain whose parts these are; None where they are the whole drive's.
    """

    drive: Drive
    speed: float
    eigenvalue: NDArray[np.complex128]
    names: tuple[str, ...]
    parts: tuple[str, ...]
    participation: Array
    across: Array
    shape: NDArray[np.complex128]
    bodies: NDArray[np.complex128]
    stroke: NDArray[np.complex128]
    pressure: NDArray[np.complex128]
    stored: Array
    lost: Array
    position: Array
    placed: Array
    tension: Array
    rotations: int
    zeros: int
    growing: Array
    creeping: Array
    standing: tuple[str, ...]
    chain: ChainModel | None = None

    @property
    def model(self) -> ChainModel:
        """Model of the one chain whose modes these are.

        Raises:
            DriveError: of a drive of several.
        """
        return single_chain(self.drive if self.chain is None else self.chain)

    @property
    def frequency(self) -> Array:
        """Natural frequencies (K,) of the modes [Hz]."""
        return np.abs(self.eigenvalue) / (2.0 * np.pi)

    @property
    def damping_ratio(self) -> Array:
        """Damping ratios zeta (K,) of the modes."""
        return -self.eigenvalue.real / np.abs(self.eigenvalue)

    def __len__(self) -> int:
        return len(self.eigenvalue)

    @check_arguments(SimulationError)
    def first(self, count: Count) -> Modes:
        """Lowest `count` of the modes."""
        return self.select_modes(np.arange(min(count, len(self))))

    @check_arguments(SimulationError)
    def select_modes(self, which: Sequence[Index] | NDArray[np.integer]) -> Modes:
        """Modes at given indices.

        Raises:
            SimulationError: an index past the last mode.
        """
        which = np.asarray(which, dtype=np.int64)
        if len(which) and not which.max() < len(self):
            raise SimulationError(f"which = {which.max()}: must be a mode from 0, below {len(self)}")
        kept = {name: getattr(self, name)[which] for name in MODE_FIELDS if name != "names"}
        return replace(self, **kept, names=tuple(self.names[k] for k in which))

    def of_chains(self) -> tuple[Modes, ...]:
        """Modes of the drive with each chain's parts alone."""
        found, first, model = [], 0, Model(self.drive)
        for chain in model.chains:
            rollers = slice(first, first + chain.links)
            bodies, pushed = model.bodies_of_chain(chain), list(chain.places["tensioners"])
            own: dict[str, Any] = {name: getattr(self, name)[:, pushed] for name in TENSIONER_FIELDS}
            own |= {"position": self.position[rollers], "tension": self.tension[rollers], "placed": self.placed[bodies]}
            own |= {"shape": self.shape[:, rollers], "bodies": self.bodies[:, bodies], "chain": chain}
            found.append(replace(self, **own))
            first = rollers.stop
        return tuple(found)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Arrays of the modes, by field name."""
        others = ("parts", "position", "placed", "tension", "growing", "creeping")
        tensioned = MODE_FIELDS if self.drive.tensioners else MOTION_FIELDS
        result = {name: np.asarray(getattr(self, name)) for name in (*tensioned, *others)}
        return {**result, "frequency": self.frequency, "damping_ratio": self.damping_ratio}


MOTION_FIELDS = ("eigenvalue", "names", "participation", "across", "shape", "bodies")
TENSIONER_FIELDS = ("stroke", "pressure", "stored", "lost")
MODE_FIELDS = (*MOTION_FIELDS, *TENSIONER_FIELDS)


@overload
def modes(
    drives: Drive,
    count: int = 20,
    speed: float = 0.0,
    valve: Literal["shut", "open"] = "shut",
    *,
    workers: int | None = None,
    progress: Progress = False,
) -> Modes: ...


@overload
def modes(
    drives: Sequence[Drive],
    count: int = 20,
    speed: float = 0.0,
    valve: Literal["shut", "open"] = "shut",
    *,
    workers: int | None = None,
    progress: Progress = False,
) -> list[Modes | WarpchainError]: ...


@check_arguments(SimulationError)
def modes(
    drives: Drive | Sequence[Drive],
    count: Count = 20,
    speed: NonNegativeNumber = 0.0,
    valve: Literal["shut", "open"] = "shut",
    *,
    workers: Workers | None = None,
    progress: Progress = False,
) -> Modes | list[Modes | WarpchainError]:
    """Lowest modes of a drive, or of many.

    Args:
        count: modes that swing, from the lowest frequency up.
        speed: of the driver [rad/s]; 0 is at rest under the constant parts of loads.
        valve: check valves of tensioners "shut", or "open" as at rest, for small swings of pressure.
        workers: processes for many drives.
        progress: True shows a bar; a function gets ("modes", done, total), in drives.

    Returns:
        Of one drive its modes; of many, in order, the modes or the error of each.

    Raises:
        DriveError: a chain that does not fit.
        SimulationError: a drive that does not settle, or an argument not allowed.
        KeyboardInterrupt: the user stopped it.
    """
    work = partial(_modes_at_speed, count=count, speed=speed, valve=valve)
    if isinstance(drives, Drive):
        return work(drives)
    with interruptible_work(), progress_reporter(progress) as report:
        found = map_in_processes(work, drives, workers or available_cores(), "modes", report)
    for error in found:
        if not isinstance(error, Modes | WarpchainError):
            raise error
    return [
        replace(own, drive=drive) if isinstance(own, Modes) else own for drive, own in zip(drives, found, strict=True)
    ]


def _modes_at_speed(drive: Drive, count: int, speed: float, valve: str) -> Modes:
    """Lowest modes of a drive at a speed [rad/s]."""
    return lowest_modes(drive_motion(drive, speed, valve=valve), count)


def _move_carried_bodies(found: ChainMotion, bodies: NDArray[Any]) -> None:
    """Moves arms and sprockets along with what carries them in modes."""
    model, placed = found.model, found.state.bodies[0]
    first = model.first_arm_body
    on = {first + a: model.parent(a) for a in range(len(model.arms))}
    on |= {s: model.carrier(s) for s in range(len(model.sprockets))}
    for b, arm in on.items():
        if arm is not None:
            x, y = placed[b, :2] - placed[first + arm, :2]
            bodies[:, b, :2] = bodies[:, first + arm, :2] + bodies[:, first + arm, 2, None] * np.array([-y, x])


def lowest_modes(found: DriveMotion, count: int) -> Modes:
    """Lowest modes of a drive from its small motion."""
    stiff = max(float(part.packed.chains["stiffness"][0]) / part.at.mass for part in found.parts)
    unit, wanted = np.sqrt(stiff) / max(part.at.rollers for part in found.parts), count
    every, groups = found.mass.shape[0], free_rotations(found)
    found = (
        replace(found, stiffness=stiffness_without_rotation(found, groups, (1e-2 * ZERO_FREQUENCY) ** 2 * stiff))
        if groups
        else found
    )
    while True:
        value, vector = eigenpairs(found.mass, found.damping + found.travel, found.stiffness, wanted, unit)
        real = np.abs(value.imag) < 1e-9 * np.abs(value)
        zero = np.abs(value) < ZERO_FREQUENCY * np.sqrt(stiff)
        zero[zero & real] &= ~_has_restoring_stiffness(found, vector[:, zero & real])
        swings = np.flatnonzero(~zero & ~real)
        if len(swings) >= count or wanted >= every:
            break
        wanted = min(2 * wanted, every)
    swings = swings[:count]
    alone = value[~zero & real].real
    vector = _normalized_vectors(vector[:, swings], found.mass)
    parts, energy, across = _kinetic_participation(found, vector)
    return Modes(
        drive=found.drive,
        speed=found.speed,
        eigenvalue=value[swings],
        names=_mode_names(parts, energy),
        parts=parts,
        participation=energy,
        across=across,
        **_mode_shapes(found, vector),
        position=np.concatenate([part.state.position[0] for part in found.parts]),
        tension=np.concatenate([part.tension for part in found.parts]),
        rotations=len(groups),
        zeros=max(0, int(zero.sum() + 1) // 2 - len(groups)),
        growing=np.sort(alone[alone > 0.0]),
        creeping=np.sort(-alone[alone < 0.0]),
        standing=sum((standing_lines(part) for part in found.parts), ()),
    )


def _chain_motions(
    found: DriveMotion, vector: NDArray[np.complex128]
) -> list[tuple[ChainMotion, NDArray[np.complex128], PlungerMotion]]:
    """Small motion, eigenvectors and plungers of each chain."""
    works = (found.stiffness, found.damping)
    stiff, drag = (np.einsum("ij,ij->j", vector.conj(), matrix @ vector).real for matrix in works)
    own = [tie @ vector if len(found.parts) > 1 else vector for tie in found.ties]
    return [(part, v, plunger_motion(part, v, stiff, drag)) for part, v in zip(found.parts, own, strict=True)]


def _mode_shapes(found: DriveMotion, vector: NDArray[np.complex128]) -> dict[str, Any]:
    """Fields of `Modes` on displacements, from eigenvectors."""
    drive, model, shapes = found.drive, Model(found.drive), []
    placed = np.zeros((len(drive.sprockets) + len(drive.shafts) + len(drive.arms), 3))
    bodies = np.zeros((vector.shape[1], *placed.shape), dtype=np.complex128)
    kinds = zip(TENSIONER_FIELDS, (np.complex128, np.complex128, np.float64, np.float64), strict=True)
    pushed: dict[str, Any] = {name: np.zeros((vector.shape[1], len(drive.tensioners)), kind) for name, kind in kinds}
    for chain, (part, own, plunger) in zip(found.chains, _chain_motions(found, vector), strict=True):
        shape, turned = part.at.roller_and_body_parts(own.T)
        _move_carried_bodies(part, turned)
        shapes.append(shape)
        mine = [*range(len(chain.sprockets) + len(chain.places["shafts"]))]
        mine += range(chain.first_arm_body, chain.first_arm_body + len(chain.places["arms"]))
        at = np.array(model.bodies_of_chain(chain))[mine]
        bodies[:, at], placed[at] = turned[:, mine], part.state.bodies[0][mine]
        for name, values in pushed.items():
            values[:, list(chain.places["tensioners"])] = getattr(plunger, name)
    return {"shape": np.concatenate(shapes, axis=1), "bodies": bodies, "placed": placed, **pushed}


def _has_restoring_stiffness(found: DriveMotion, vector: NDArray[np.complex128]) -> NDArray[np.bool_]:
    """(K,) whether each eigenvector's motion is restored by stiffness."""
    held = np.einsum("ij,ij->j", vector.conj(), found.stiffness @ vector).real
    stiffest = max(float(part.packed.chains["stiffness"][0]) for part in found.parts)
    return np.asarray(held > RESTORING_STIFFNESS * stiffest * (np.abs(vector) ** 2).sum(axis=0))


def _normalized_vectors(vector: NDArray[np.complex128], mass: sp.csc_array) -> NDArray[np.complex128]:
    """Eigenvectors (n, K) at unit modal mass."""
    vector = vector / np.sqrt(np.einsum("ij,ij->j", vector.conj(), mass @ vector).real)
    square = np.einsum("ij,ij->j", vector, mass @ vector)
    return vector * np.exp(-0.5j * np.angle(square))


def _kinetic_participation(found: DriveMotion, vector: NDArray[np.complex128]) -> tuple[tuple[str, ...], Array, Array]:
    """Parts' names, shares (K, P) of modes' kinetic energy, transverse share (K,)."""
    parts, shares = list[str](), list[Array]()
    off, roller = np.zeros(vector.shape[1]), np.zeros(vector.shape[1])
    motions = zip(found.drive.chain_prefixes, _chain_motions(found, vector), strict=True)
    for before, (part, own, plunger) in motions:
        energy = (own.conj() * (part.mass @ own)).real.T
        for name, share in _part_energies(part, energy, plunger.kinetic, before):
            if name in parts:  # a sprocket that is a shaft beside another chain
                shares[parts.index(name)] = shares[parts.index(name)] + share
                continue
            parts.append(name)
            shares.append(share)
        place, count = part.state.position[0], part.at.rollers
        along = np.roll(place, -1, axis=0) - np.roll(place, 1, axis=0)
        along /= np.hypot(*along.T)[:, None]
        shape = own[: 2 * count].T.reshape(-1, count, 2)
        turned = np.abs(shape[..., 0] * along[:, 1] - shape[..., 1] * along[:, 0]) ** 2
        off += part.at.mass * (part.at.relative_mass * turned).sum(axis=1)
        roller += energy[:, : 2 * count].reshape(-1, count, 2).sum(axis=2).sum(axis=1)
    return tuple(parts), np.stack(shares, axis=1), off / np.maximum(roller, 1e-300)


def _part_energies(found: ChainMotion, energy: Array, plunger: Array, before: str) -> Iterator[PartEnergy]:
    """Name and kinetic energy (K,) of each part in modes.

    Args:
        energy: (K, n) of the coordinates.
        plunger: (K, T) of tensioners' plungers.
    """
    model, at, places = found.model, found.at, found.layout
    own = 2 * at.rollers
    roller = energy[:, :own].reshape(-1, at.rollers, 2).sum(axis=2)
    body = energy[:, own : at.oil_start]
    for k, name in enumerate(model.strand_names):
        yield before + name, roller[:, places.strand == k].sum(axis=1)
    carried = np.zeros((len(energy), model.first_arm_body + len(model.arms)))
    for t in range(len(model.tensioners)):
        carried[:, model.tensioner_body(t)] += plunger[:, t]
    for s, sprocket in enumerate(model.sprockets):
        turns = body[:, (at.owner == s) & at.turning].sum(axis=1)
        on = roller[:, places.arc == s].sum(axis=1)
        yield sprocket.name, on + turns
        slides = (at.owner == s) & ~at.turning
        if slides.any():
            yield f"{sprocket.name}.mount", body[:, slides].sum(axis=1) - carried[:, s]
    for b, shaft in enumerate(model.shafts, len(model.sprockets)):
        if (at.owner == b).any():
            yield shaft.name, body[:, at.owner == b].sum(axis=1)
    for b, arm in enumerate(model.arms, model.first_arm_body):
        yield arm.name, body[:, at.owner == b].sum(axis=1) - carried[:, b]
    for t, tensioner in enumerate(model.tensioners):
        yield tensioner.name, plunger[:, t]


def _mode_names(parts: tuple[str, ...], share: Array) -> tuple[str, ...]:
    """Names of modes, by the part with most kinetic energy."""
    most, seen, names = np.argmax(share, axis=1) if len(share) else [], dict.fromkeys(parts, 0), []
    for part in (parts[k] for k in most):
        seen[part] += 1
        names.append(f"{part} {seen[part]}")
    return tuple(names)
