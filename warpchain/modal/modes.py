"""The modes of a drive: frequency, damping ratio, what takes part in each, and its shape."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from warpchain.drive import Drive
from warpchain.engine.packed import Packed
from warpchain.engine.probe import Probe, States
from warpchain.engine.standing import TOLERANCE, beginning, link_tension, passing_rate, released
from warpchain.modal.balance import balanced
from warpchain.modal.coordinates import Array, Coordinates, coordinates
from warpchain.modal.layout import Layout, layout
from warpchain.modal.matrices import damping
from warpchain.modal.pencil import eigenpairs, travelling

ZERO = 1e-5
"""A mode slower than this much of sqrt(k / m) has no restoring force: rounding gives it that."""


@dataclass(frozen=True)
class Modes:
    """Modes of a drive of N rollers, S sprockets and B bodies about a standing or steadily running state.

    Attributes:
        drive: the drive.
        speed: of the driver [rad/s]; 0 is at rest.
        eigenvalue: (K,) s = -zeta omega + i omega sqrt(1 - zeta^2) [1/s], ascending by size.
        names: (K,) the part that moves most, and the how manieth of its modes this is, such as "motor->conveyor 2".
        parts: (P,) strands, sprockets (turning, with the rollers on them), and mounts ("NAME.mount") that can move.
        participation: (K, P) shares of the kinetic energy; they sum to 1.
        across: (K,) share of the rollers' kinetic energy that is transverse to the chain.
        shape: (K, N, 2) complex displacement of the rollers, of unit modal mass [m], the real part the larger.
        bodies: (K, B, 3) complex displacement of the bodies (x, y, theta).
        position: (N, 2) where the rollers stand [m].
        placed: (B, 3) where the bodies stand.
        tension: (N,) of the links there [N].
        zeros: how many independent motions have no restoring force; they are not among the K.
        growing: (U,) growth rates of motions that run away without swinging [1/s]: the state is not a stable one.
        creeping: (O,) decay rates of motions that come back without swinging [1/s].
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
    position: Array
    placed: Array
    tension: Array
    zeros: int
    growing: Array
    creeping: Array

    @property
    def frequency(self) -> Array:
        """(K,) undamped natural frequencies omega / 2 pi [Hz]."""
        return np.abs(self.eigenvalue) / (2.0 * np.pi)

    @property
    def damping_ratio(self) -> Array:
        """(K,) zeta."""
        return -self.eigenvalue.real / np.abs(self.eigenvalue)

    def __len__(self) -> int:
        return len(self.eigenvalue)

    def first(self, count: int) -> Modes:
        """The first of the modes."""
        return self.chosen(np.arange(min(count, len(self))))

    def chosen(self, which: NDArray[np.integer]) -> Modes:
        """The modes of these indices."""
        kept = {name: getattr(self, name)[which] for name in PER_MODE if name != "names"}
        return replace(self, **kept, names=tuple(self.names[k] for k in which))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All arrays by name, with `frequency` and `damping_ratio`."""
        others = ("parts", "position", "placed", "tension", "growing", "creeping")
        result = {name: np.asarray(getattr(self, name)) for name in (*PER_MODE, *others)}
        return {**result, "frequency": self.frequency, "damping_ratio": self.damping_ratio}


PER_MODE = ("eigenvalue", "names", "participation", "across", "shape", "bodies")
"""Fields of `Modes` that have a row for each mode."""


@dataclass(frozen=True)
class System:
    """Small motion of a drive about a state: its matrices, and where it stands.

    Attributes:
        packed: the drive in that state.
        state: that state, one copy.
        at: its free coordinates.
        layout: which rollers lie where.
        mass, damping, stiffness: (n, n) M, C (without what travels), K.
        travel: (n, n) G.
    """

    drive: Drive
    speed: float
    packed: Packed
    state: States
    at: Coordinates
    layout: Layout
    mass: sp.csc_array
    damping: sp.csc_array
    stiffness: sp.csc_array
    travel: sp.csc_array


def system(drive: Drive, speed: float = 0.0, start: Packed | None = None) -> System:
    """Small motion of a drive at a speed of its driver [rad/s].

    Args:
        start: the drive as it stands at a speed nearby.

    Raises:
        DriveError: a chain that does not fit.
        SimulationError: a drive that does not settle, or a chain too fast to stay on its sprockets; one line.
    """
    if start is not None:
        near, unrest = _about(beginning(drive, speed, start), drive, speed)
        if unrest < TOLERANCE:
            return near
    return _about(released(beginning(drive, speed, start), drive), drive, speed)[0]


def _about(packed: Packed, drive: Drive, speed: float) -> tuple[System, float]:
    """Small motion about the standing state near a packed one, and how far from standing that is, of the tension."""
    probe = Probe(packed)
    try:
        state = probe.start()
        at = coordinates(probe, state)
        pull = float(np.abs(_tension(packed, state)).max())
        state, own, unrest = balanced(probe, at, state, drive.chain.pitch, pull)
        places = layout(packed.assemblies[0], probe.contacts(state)[: len(drive.sprockets)])
        travel = travelling(at.rollers, at.mass, passing_rate(drive, speed), places.free_links, at.count)
        drag = damping(probe, at, state)
        return System(drive, speed, probe.packed(state), state, at, places, at.masses, drag, own, travel), unrest
    finally:
        probe.close()


def modes(drive: Drive, count: int = 20, speed: float = 0.0) -> Modes:
    """The lowest modes of a drive.

    Args:
        drive: the drive.
        count: how many modes that swing, from the lowest frequency up.
        speed: of the driver [rad/s]: 0 is at rest under the constant parts of the loads; else the chain runs steadily,
            and loads are those at this speed.

    Raises:
        DriveError: a chain that does not fit.
        SimulationError: a drive that does not settle; one line.
    """
    return modes_of(system(drive, speed), count)


def modes_of(found: System, count: int) -> Modes:
    """The lowest modes of small motion."""
    stiff = float(found.packed.chains["stiffness"][0]) / found.at.mass
    unit, wanted = np.sqrt(stiff) / found.at.rollers, count
    while True:
        value, vector = eigenpairs(found.mass, found.damping + found.travel, found.stiffness, wanted, unit)
        zero = np.abs(value) < ZERO * np.sqrt(stiff)
        real = np.abs(value.imag) < 1e-9 * np.abs(value)
        swings = np.flatnonzero(~zero & ~real)
        if len(swings) >= count or wanted >= found.at.count:
            break
        wanted = min(2 * wanted, found.at.count)
    swings = swings[:count]
    alone = value[~zero & real].real
    vector = _normal(vector[:, swings], found.mass)
    shape, bodies = found.at.split(vector.T)
    parts, share, across = _participation(found, vector)
    return Modes(
        drive=found.drive,
        speed=found.speed,
        eigenvalue=value[swings],
        names=_names(parts, share),
        parts=parts,
        participation=share,
        across=across,
        shape=shape,
        bodies=bodies,
        position=found.state.position[0],
        placed=found.state.bodies[0],
        tension=_tension(found.packed, found.state, passing_rate(found.drive, found.speed)),
        zeros=int(zero.sum() + 1) // 2,
        growing=np.sort(alone[alone > 0.0]),
        creeping=np.sort(-alone[alone < 0.0]),
    )


def _tension(packed: Packed, state: States, rate: float = 0.0) -> Array:
    """(N,) of the links [N]: what stretches them, and of a running chain what bends it around the sprockets too."""
    place = state.position[0]
    length = np.hypot(*(np.roll(place, -1, axis=0) - place).T)
    return link_tension(packed, place) + float(packed.chains["mass"][0]) * rate**2 * length


def _normal(vector: NDArray[np.complex128], mass: sp.csc_array) -> NDArray[np.complex128]:
    """Vectors of unit modal mass x* M x, each turned in phase so that its real part is as large as can be."""
    vector = vector / np.sqrt(np.einsum("ij,ij->j", vector.conj(), mass @ vector).real)
    square = np.einsum("ij,ij->j", vector, mass @ vector)
    return vector * np.exp(-0.5j * np.angle(square))


def _participation(found: System, vector: NDArray[np.complex128]) -> tuple[tuple[str, ...], Array, Array]:
    """Names of the parts, their shares of each mode's kinetic energy (K, P), and the transverse share (K,)."""
    drive, at, places = found.drive, found.at, found.layout
    own = 2 * at.rollers
    energy = (vector.conj() * (found.mass @ vector)).real.T
    roller = energy[:, :own].reshape(-1, at.rollers, 2).sum(axis=2)
    parts, shares = [], []
    for k, name in enumerate(drive.strand_names):
        parts.append(name)
        shares.append(roller[:, places.strand == k].sum(axis=1))
    for s, sprocket in enumerate(drive.sprockets):
        parts.append(sprocket.name)
        turns = (at.owner == s) & at.turning
        shares.append(roller[:, places.arc == s].sum(axis=1) + energy[:, own:][:, turns].sum(axis=1))
        slides = (at.owner == s) & ~at.turning
        if slides.any():
            parts.append(f"{sprocket.name}.mount")
            shares.append(energy[:, own:][:, slides].sum(axis=1))
    place = found.state.position[0]
    along = np.roll(place, -1, axis=0) - np.roll(place, 1, axis=0)
    along /= np.hypot(*along.T)[:, None]
    shape = vector[:own].T.reshape(-1, at.rollers, 2)
    off = np.abs(shape[..., 0] * along[:, 1] - shape[..., 1] * along[:, 0]) ** 2
    across = at.mass * off.sum(axis=1) / np.maximum(roller.sum(axis=1), 1e-300)
    return tuple(parts), np.stack(shares, axis=1), across


def _names(parts: tuple[str, ...], share: Array) -> tuple[str, ...]:
    """Each mode by the part that moves most, numbered from the lowest."""
    most, seen, names = np.argmax(share, axis=1) if len(share) else [], dict.fromkeys(parts, 0), []
    for part in (parts[k] for k in most):
        seen[part] += 1
        names.append(f"{part} {seen[part]}")
    return tuple(names)
