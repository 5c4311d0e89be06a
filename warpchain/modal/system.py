"""Small motion of a drive about the state in which it rests or steadily runs: the state, and its matrices.

Relaxation leaves a millionth of the chain's tension unbalanced, which moves slack strands by micrometers. Each step
goes as far along K^-1 F as lowers the energy: to where the forces no longer work along it. A state in which contacts
are about to open or close has no stiffness of its own, and steps there lead back and forth; the best one is taken.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from warpchain.assembly import Assembly
from warpchain.drive import Drive
from warpchain.drive.oil import static_pressure, valve_flow
from warpchain.engine.pack import lay_to_rest, springs
from warpchain.engine.packed import Packed
from warpchain.engine.probe import Probe, States
from warpchain.engine.static_equilibrium import TOLERANCE, beginning, link_tension, passing_rate, released
from warpchain.modal.matrices import Array, Coordinates, coordinates, damping, stiffness, strokes, travelling


@dataclass(frozen=True)
class Layout:
    """Parts of a chain of N rollers around S sprockets.

    Attributes:
        arc: (N,) the sprocket on which a roller lies, from the first that touches its teeth to the last; else -1.
        strand: (N,) the strand in which it hangs, else -1.
        free_links: (N,) whether a link is one of a strand's: one of its ends at least hangs.
    """

    arc: NDArray[np.int64]
    strand: NDArray[np.int64]
    free_links: NDArray[np.bool_]


def layout(assembly: Assembly, touching: NDArray[np.bool_]) -> Layout:
    """The parts of a chain.

    Args:
        assembly: how it was laid around its sprockets.
        touching: (S, N) which rollers touch which sprocket.
    """
    count = touching.shape[1]
    sprockets = len(assembly.strand_first)
    arc = np.full(count, -1)
    last = np.asarray(assembly.strand_first, dtype=np.int64)
    first = np.roll(last + np.asarray(assembly.strand_links), 1)
    first = np.where(first > last, first - count, first)
    for s in range(sprockets):
        middle = (first[s] + last[s]) // 2
        off = (np.flatnonzero(touching[s]) - middle + count // 2) % count - count // 2
        if len(off):
            first[s], last[s] = middle + off.min(), middle + off.max()
            arc[np.arange(first[s], last[s] + 1) % count] = s
        else:
            first[s] = last[s] = middle
    strand = np.full(count, -1)
    for s in range(sprockets):
        end = first[(s + 1) % sprockets]
        hanging = np.arange(last[s], last[s] + (end - last[s]) % count + 1) % count
        strand[hanging[arc[hanging] < 0]] = s
    return Layout(arc, strand, (arc < 0) | (np.roll(arc, -1) < 0))


STEPS = 8
SHARES = 0.5 ** np.arange(8.0)
"""Of a step, tried at once."""
FAINT = 1e-10
"""Of the tension of a link: forces below this are rounding."""


def balanced(
    probe: Probe, at: Coordinates, state: States, pitch: float, tension: float
) -> tuple[States, sp.csc_array, float]:
    """The equilibrium nearest to a relaxed state, K there, and its largest force, of the tension.

    Args:
        state: one copy.
        tension: of a link, for comparison [N].
    """
    force = at.forces(probe, state)[0]
    best, least = state, float(np.abs(force).max())
    for _ in range(STEPS):
        if least < FAINT * tension:
            break
        try:
            step = splu(stiffness(probe, at, state, pitch)).solve(force)
        except RuntimeError:  # a motion that nothing restores
            break
        new = at.forces(probe, at.moved(state, SHARES[:, None] * step))
        along = np.abs(new @ step) < 0.9 * abs(float(force @ step))
        if not along.any():
            break
        k = int(np.argmax(along))
        state, force = at.moved(state, SHARES[k] * step[None]), new[k]
        if np.abs(force).max() < least:
            best, least = state, float(np.abs(force).max())
    return best, stiffness(probe, at, best, pitch), least / tension


@dataclass(frozen=True)
class System:
    """Small motion of a drive about a state: its matrices, and that state.

    Attributes:
        packed: the drive in that state.
        state: that state, one copy.
        extension: (T,) of the tensioners there [m].
        valve: how check valves are taken, "shut" or "open".
        at: its free coordinates.
        layout: which rollers lie where.
        mass, damping, stiffness: (n, n) M, C (without what travels), K.
        travel: (n, n) G.
    """

    drive: Drive
    speed: float
    packed: Packed
    state: States
    extension: Array
    valve: str
    at: Coordinates
    layout: Layout
    mass: sp.csc_array
    damping: sp.csc_array
    stiffness: sp.csc_array
    travel: sp.csc_array


VALVES = ("shut", "open")
NEAR = 1.0
"""Change of pressure for the slope of a valve's flow [Pa]; some hundreds shut it."""


def conductances(drive: Drive, valve: str) -> Array:
    """(w,) G of the chambers of oil about their rest [m^3/(s Pa)]: of the plungers' gaps, and of valves that are open.

    At rest a valve is open as far as lets in what leaks, some micrometers, and shuts when the pressure rises by some
    hundred pascals to kilopascals. Within that it passes more than the gap by a factor of tens or hundreds.
    """
    found = []
    for tensioner in drive.tensioners:
        if tensioner.hydraulic:
            rest = static_pressure(tensioner)
            slope = 0.5 * (valve_flow(tensioner, rest - NEAR) - valve_flow(tensioner, rest + NEAR)) / NEAR
            found.append(tensioner.leak_conductance + (slope if valve == "open" else 0.0))
    return np.array(found)


def system(drive: Drive, speed: float = 0.0, start: Packed | None = None, valve: str = "shut") -> System:
    """Small motion of a drive at a speed of its driver [rad/s].

    Args:
        start: the drive as it stands at a speed nearby.
        valve: check valves of hydraulic tensioners "shut", or "open" as they are at rest (see `conductances`).

    Raises:
        DriveError: a chain that does not fit.
        SimulationError: a drive that does not settle, or a chain too fast to stay on its sprockets; one line.
    """
    if start is not None:
        near, unrest = _about(beginning(drive, speed, start), drive, speed, valve)
        if unrest < TOLERANCE:
            return near
    return _about(released(beginning(drive, speed, start), drive), drive, speed, valve)[0]


def _about(packed: Packed, drive: Drive, speed: float, valve: str) -> tuple[System, float]:
    """Small motion about the equilibrium near a packed state, and its largest force, of the tension."""
    if drive.tensioners:
        packed, unrest = _still(packed, drive)
    probe = Probe(packed)
    try:
        state = probe.start()
        at = coordinates(probe, state)
        if drive.tensioners:
            own = stiffness(probe, at, state, drive.chain.pitch)
        else:
            pull = float(np.abs(tension_of(packed, state)).max())
            state, own, unrest = balanced(probe, at, state, drive.chain.pitch, pull)
        places = layout(packed.assemblies[0], probe.contacts(state)[: len(drive.sprockets)])
        travel = travelling(at.rollers, at.mass, passing_rate(drive, speed), places.free_links, at.count)
        drag = damping(probe, at, state, conductances(drive, valve) if len(at.chambers) else None)
        x, _ = strokes(probe, state)
        still = probe.packed(state)
        return System(drive, speed, still, state, x, valve, at, places, at.masses, drag, own, travel), unrest
    finally:
        probe.close()


def _still(packed: Packed, drive: Drive) -> tuple[Packed, float]:
    """The standing state near a packed one as `balanced` finds it with tensioners that push with what they push with at
    rest, however long that takes their oil, and how far from standing it is; there tensioners are laid to rest."""
    probe = Probe(packed.with_arrays(tensioners=springs(packed.tensioners)))
    try:
        state = probe.start()
        pull = float(np.abs(tension_of(packed, state)).max())
        state, _, unrest = balanced(probe, coordinates(probe, state), state, drive.chain.pitch, pull)
        still = probe.packed(state).with_arrays(
            drives=packed.drives, tensioners=packed.tensioners, oil=packed.oil.copy()
        )
    finally:
        probe.close()
    lay_to_rest(still)
    return still, unrest


def tension_of(packed: Packed, state: States, rate: float = 0.0) -> Array:
    """(N,) of the links [N]: what stretches them, and of a running chain what bends it around the sprockets too."""
    place = state.position[0]
    length = np.hypot(*(np.roll(place, -1, axis=0) - place).T)
    return link_tension(packed, place) + float(packed.chains["mass"][0]) * rate**2 * length
