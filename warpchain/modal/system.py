"""Small motion of a drive about the state in which it rests or steadily runs: the state, and its matrices.

The state is that of `warpchain.assembly.statics`, where the potential of all steady forces is least. It is packed
without what hangs on time, and the kernels' forces about it give the matrices.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from warpchain.assembly import Assembly
from warpchain.assembly.statics import equilibrium, load_moments, passing_rate
from warpchain.drive import Drive
from warpchain.drive.oil import static_pressure, valve_flow
from warpchain.drive.trains import is_free, loads_of, speed_ratio
from warpchain.engine.pack import lay_to_rest, pack
from warpchain.engine.packed import Packed
from warpchain.engine.probe import Probe, States
from warpchain.modal.matrices import Array, Coordinates, coordinates, damping, stiffness, strokes, travelling
from warpchain.results.schedule import Schedule


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


@dataclass(frozen=True)
class System:
    """Small motion of a drive about a state: its matrices, and that state.

    Attributes:
        packed: the drive in that state.
        state: that state, one copy.
        tension: (N,) of the links there [N].
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
    tension: Array
    extension: Array
    valve: str
    at: Coordinates
    layout: Layout
    mass: sp.csc_array
    damping: sp.csc_array
    stiffness: sp.csc_array
    travel: sp.csc_array


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


def standing(drive: Drive, speed: float = 0.0, start: Packed | None = None) -> tuple[Packed, Array]:
    """A drive in static equilibrium under the means of its loads, in float64, and the tensions of its links (N,) [N].

    Prescribed motions stand, loads have their mean, nothing rubs, couplings have taken up their lash, motors are how
    their moments fall with the speed, and tensioners are at rest. Links are those of `warpchain.assembly.potential`,
    (b). A tension is what stretches a link, and of a running chain what bends it around the sprockets too.

    Args:
        speed: of the driver [rad/s], at which loads are taken and by which the chain's steady running counts.
        start: the drive as it stands at a speed nearby.

    Raises:
        DriveError: a chain that does not fit.
        SimulationError: a drive that does not settle, or a chain too fast to stay on its sprockets; one line.
    """
    still = pack([drive], [Schedule(1.0, 1, 2, 2, 0)])
    sprockets, near = len(drive.sprockets), None
    shafts = slice(sprockets, drive.first_arm_body)
    if start is not None:
        centers, angles = start.bodies["center"][:sprockets], np.delete(start.bodies["angle"], shafts)
        near = np.concatenate([start.rows(0)[0:2].T.ravel(), centers.ravel(), angles])
    potential, x = equilibrium(drive, speed, still.assemblies[0], near)
    position, centers, _ = potential.split(x)
    for name in ("joints", "tooth_sliding", "guide_sliding"):
        setattr(still, name, np.zeros_like(getattr(still, name)))
    still.hubs["bearing"] = 0.0
    still.rows(0)[:] = 0.0
    still.rows(0)[0:2] = position.T
    still.seat[:] = -1
    still.bodies["speed"], still.bodies["velocity"] = 0.0, 0.0
    still.bodies["angle"][: drive.first_arm_body] = 0.0
    still.bodies["angle"][np.delete(np.arange(len(still.bodies)), shafts)] = x[2 * potential.rollers + 2 * sprockets :]
    still.bodies["center"][:sprockets] = centers
    still.lengths = potential.natural
    still.links["play"] = potential.play[0]
    still.chains["stiffness"] -= potential.push
    still.links["outer_stiffness"] -= np.where(still.links["varied_links"] == 1, potential.push, 0.0)
    still.guides["deepest_entry"] = np.inf
    still.mounts["amplitude"], still.mounts["frequency"] = 0.0, 0.0
    still.mounts["x_table"]["cells"] = still.mounts["y_table"]["cells"] = 0
    for name in ("speed", "ramp_time", "load_ramp_time", "drive_harmonics", "load_harmonics"):
        still.motions[name] = np.zeros((), dtype=still.motions[name].dtype)
    still.motions["drive_table"]["cells"] = still.motions["load_table"]["cells"] = 0
    still.couplings["lash"], still.motors["present"] = 0.0, 0
    moments = np.append(load_moments(drive, speed), np.zeros(len(drive.shafts)))
    for b, load in loads_of(drive):
        turning = speed * speed_ratio(drive, b, drive.driver)
        still.motions[b]["load"] = (moments[b], load.viscous + 2.0 * load.quadratic * turning, 0.0)
    for b, shaft in enumerate(drive.shafts, sprockets):
        if shaft.motor is not None and is_free(drive, b):
            turning = speed * speed_ratio(drive, b, drive.driver)
            near_by = max(1e-6 * turning, 1e-9)
            fall = shaft.motor.at(turning - near_by) - shaft.motor.at(turning + near_by)
            still.motions[b]["load"][1] += float(fall) / (2.0 * near_by)
    lay_to_rest(still)
    return still, potential.tensions(x)


def system(drive: Drive, speed: float = 0.0, start: Packed | None = None, valve: str = "shut") -> System:
    """Small motion of a drive at a speed of its driver [rad/s].

    Args:
        start: the drive as it stands at a speed nearby.
        valve: check valves of hydraulic tensioners "shut", or "open" as they are at rest (see `conductances`).

    Raises:
        DriveError: a chain that does not fit.
        SimulationError: a drive that does not settle, or a chain too fast to stay on its sprockets; one line.
    """
    packed, tension = standing(drive, speed, start)
    probe = Probe(packed)
    try:
        state = probe.start()
        at = coordinates(probe, state)
        own = stiffness(probe, at, state, drive.chain.pitch)
        places = layout(packed.assemblies[0], probe.contacts(state)[: len(drive.sprockets)])
        travel = travelling(at.rollers, at.mass, passing_rate(drive, speed), places.free_links, at.count)
        drag = damping(probe, at, state, conductances(drive, valve) if len(at.chambers) else None)
        x, _ = strokes(probe, state)
        return System(drive, speed, packed, state, tension, x, valve, at, places, at.masses, drag, own, travel)
    finally:
        probe.close()
