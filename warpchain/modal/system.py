"""Small motion of a drive about the state in which it stands or steadily runs: its matrices."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from warpchain.drive import Drive
from warpchain.drive.oil import static_pressure, valve_flow
from warpchain.engine.packed import Packed
from warpchain.engine.probe import Probe, States
from warpchain.engine.resting import lay_to_rest, springs
from warpchain.engine.standing import TOLERANCE, beginning, link_tension, passing_rate, released
from warpchain.modal.balance import balanced
from warpchain.modal.coordinates import Array, Coordinates, coordinates, strokes
from warpchain.modal.layout import Layout, layout
from warpchain.modal.matrices import damping, stiffness
from warpchain.modal.pencil import travelling


@dataclass(frozen=True)
class System:
    """Small motion of a drive about a state: its matrices, and where it stands.

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
    """Small motion about the standing state near a packed one, and how far from standing that is, of the tension."""
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
    probe = Probe(replace(packed, tensioners=springs(packed.tensioners)))
    try:
        state = probe.start()
        pull = float(np.abs(tension_of(packed, state)).max())
        state, _, unrest = balanced(probe, coordinates(probe, state), state, drive.chain.pitch, pull)
        still = replace(probe.packed(state), drives=packed.drives, tensioners=packed.tensioners, oil=packed.oil.copy())
    finally:
        probe.close()
    lay_to_rest(still)
    return still, unrest


def tension_of(packed: Packed, state: States, rate: float = 0.0) -> Array:
    """(N,) of the links [N]: what stretches them, and of a running chain what bends it around the sprockets too."""
    place = state.position[0]
    length = np.hypot(*(np.roll(place, -1, axis=0) - place).T)
    return link_tension(packed, place) + float(packed.chains["mass"][0]) * rate**2 * length
