"""Small motion of a drive about the state in which it rests or runs steadily: that state, and its matrices.

With P_c the rows of chain c's coordinates by the whole drive's, M = sum P_c^T M_c P_c, and so C, G and K.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from warpchain.assembly import Assembly
from warpchain.assembly.potential import Potential
from warpchain.assembly.statics import Joined, equilibrium, passing_rate
from warpchain.drive import Drive
from warpchain.engine.force_probe import ForceProbe, ProbeStates
from warpchain.engine.pack import pack, rest_tensioners
from warpchain.engine.packed_ensemble import PackedEnsemble
from warpchain.modal.matrices import (
    Array,
    Coordinates,
    centrifugal_matrix,
    damping_matrix,
    free_coordinates,
    stiffness_matrix,
    tensioner_strokes,
    travel_matrix,
)
from warpchain.model import ChainModel, Model
from warpchain.model.oil import outlet_flows, static_pressure, valve_flow
from warpchain.model.trains import body_speed_ratio, body_turning_sign, free_body_loads, is_free_body
from warpchain.results.schedule import Schedule


@dataclass(frozen=True)
class RollerPlaces:
    """Places of a chain's rollers: sprocket or strand of each."""

    arc: NDArray[np.int64]  # (N,) sprocket of a roller, from the first that touches its teeth to the last; else -1
    strand: NDArray[np.int64]  # (N,) strand in which a roller hangs; else -1
    free_links: NDArray[np.bool_]  # (N,) whether a link has an end that hangs


def roller_places(assembly: Assembly, touching: NDArray[np.bool_]) -> RollerPlaces:
    """Places of a chain's rollers: sprocket or strand of each."""
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
    return RollerPlaces(arc, strand, (arc < 0) | (np.roll(arc, -1) < 0))


@dataclass(frozen=True)
class ChainMotion:
    """Small motion of one chain: state and matrices."""

    model: ChainModel
    speed: float
    packed: PackedEnsemble  # in that state
    state: ProbeStates  # one copy
    tension: Array  # (N,) of links [N]
    extension: Array  # (T,) of tensioners [m]
    valve: str  # "shut" or "open", how check valves are taken
    at: Coordinates
    layout: RollerPlaces
    mass: sp.csc_array  # (n, n) M
    damping: sp.csc_array  # (n, n) C, without what travels
    stiffness: sp.csc_array  # (n, n) K
    travel: sp.csc_array  # (n, n) G

    def without_inertia_of(self, place: int) -> ChainMotion:
        """Small motion of the chain without a coordinate's inertia."""
        mass = self.mass.tolil()
        mass[place, place] = 0.0
        return replace(self, mass=sp.csc_array(mass))


PRESSURE_STEP = 1.0
"""Pressure step of a valve's slope [Pa]."""


def oil_conductances(model: ChainModel, valve: str) -> Array:
    """Conductances G (w,) of oil chambers [m^3/(s Pa)]."""
    found = []
    for tensioner in model.tensioners:
        if tensioner.hydraulic:
            rest = static_pressure(tensioner)
            slope = (
                0.5
                * (valve_flow(tensioner, rest - PRESSURE_STEP) - valve_flow(tensioner, rest + PRESSURE_STEP))
                / PRESSURE_STEP
            )
            out = (
                0.5
                * (
                    sum(outlet_flows(tensioner, rest + PRESSURE_STEP))
                    - sum(outlet_flows(tensioner, rest - PRESSURE_STEP))
                )
                / PRESSURE_STEP
            )
            found.append(tensioner.leak_conductance + out + (slope if valve == "open" else 0.0))
    return np.array(found)


@dataclass(frozen=True)
class DriveMotion:
    """Small motion of a drive: its chains', and matrices."""

    drive: Drive
    speed: float
    chains: tuple[ChainModel, ...]
    parts: tuple[ChainMotion, ...]  # of each chain; the mass of a shared shaft is in its first
    ties: tuple[sp.csc_array, ...]  # P_c of each chain (n_c, n)
    mass: sp.csc_array  # (n, n) M, and so the others
    damping: sp.csc_array
    stiffness: sp.csc_array
    travel: sp.csc_array


def standing_chains(
    drive: Drive, speed: float = 0.0, start: Sequence[PackedEnsemble] | None = None
) -> list[tuple[ChainModel, float, PackedEnsemble, Array]]:
    """Chains in static equilibrium, packed, with speeds and tensions (N,) [N].

    Nothing rubs, couplings have taken up their lash, freewheels are locked, brakes and backstops open.

    Args:
        speed: of the drive's driver [rad/s].
        start: the chains as they stand at a speed nearby.

    Raises:
        DriveError: a chain that does not fit.
        SimulationError: a drive that does not settle, or a chain too fast.
    """
    model = Model(drive)
    speeds = [speed * ratio for ratio in model.driver_ratios]
    still = [pack([chain], [Schedule(1.0, 1, 2, 2, 0)]) for chain in model.chains]
    near = None
    if start is not None:
        near = [_standing_coordinates(own, packed) for own, packed in zip(model.chains, start, strict=True)]
    assemblies = [packed.assemblies[0] for packed in still]
    states = zip(*equilibrium(model.chains, speeds, assemblies, near, model.shared_bodies), strict=True)
    found = []
    for chain, own, packed, (potential, x) in zip(model.chains, speeds, still, states, strict=True):
        _lay_in_equilibrium(packed, potential, x, own)
        found.append((chain, own, packed, potential.tensions(x)))
    return found


def _standing_coordinates(model: ChainModel, packed: PackedEnsemble) -> Array:
    """Coordinates in which a packed chain stands."""
    centers = packed.bodies["center"][: len(model.sprockets)]
    hung = [model.first_arm_body + a for a in range(len(model.arms)) if model.parent(a) is not None]
    angles, pivots = packed.bodies["angle"], packed.bodies["center"][hung]
    return np.concatenate([packed.roller_rows(0)[0:2].T.ravel(), centers.ravel(), angles, pivots.ravel()])


def _lay_in_equilibrium(still: PackedEnsemble, potential: Potential, x: Array, speed: float) -> None:
    """Writes a chain's static equilibrium into its packed arrays."""
    model = potential.model
    sprockets = len(model.sprockets)
    position, centers, _ = potential.parts_of_coordinates(x)
    for friction in (still.chains["joint"], still.tooth_friction, still.guide_friction):
        friction["inertia"] = 0.0
    still.hubs["bearing"] = 0.0
    still.roller_rows(0)[:] = 0.0
    still.roller_rows(0)[0:2] = position.T
    still.seat[:] = -1
    still.bodies["speed"], still.bodies["velocity"] = 0.0, 0.0
    still.bodies["angle"] = x[2 * potential.rollers + 2 * sprockets : potential.first_pivot]
    still.bodies["center"][:sprockets] = centers
    for a, _ in potential.hung:
        still.bodies["center"][model.first_arm_body + a] = potential.pivots(x)[a]
    still.guides["deepest_entry"] = np.inf
    still.mounts["amplitude"], still.mounts["frequency"] = 0.0, 0.0
    still.mounts["x_table"]["cells"] = still.mounts["y_table"]["cells"] = 0
    for name in ("speed", "ramp_time", "load_ramp_time", "drive_harmonics", "load_harmonics"):
        still.motions[name] = np.zeros((), dtype=still.motions[name].dtype)
    still.motions["drive_table"]["cells"] = still.motions["load_table"]["cells"] = 0
    still.valves["preload"] = still.valves["stiffness"] = 0.0
    still.couplings["lash"], still.couplings["capacity"], still.motors["present"] = 0.0, 0.0, 0
    still.couplings["freewheel"] = 0
    still.engaged["ratio"][[coupling.is_grounded for coupling in model.couplings]] = 0.0
    for b, load in free_body_loads(model):
        turning = speed * body_speed_ratio(model, b, model.driver)
        moment = body_turning_sign(model, b) * potential.moments[b]
        still.motions[b]["load"] = (moment, load.viscous + 2.0 * load.quadratic * turning, 0.0)
    for b, shaft in enumerate(model.shafts, sprockets):
        if shaft.motor is not None and is_free_body(model, b):
            turning = speed * body_speed_ratio(model, b, model.driver)
            near_by = max(1e-6 * turning, 1e-9)
            fall = shaft.motor.at(turning - near_by) - shaft.motor.at(turning + near_by)
            still.motions[b]["load"][1] += float(fall) / (2.0 * near_by)
    rest_tensioners(still)


def drive_motion(
    drive: Drive, speed: float = 0.0, start: DriveMotion | None = None, valve: str = "shut"
) -> DriveMotion:
    """Small motion of a drive at a speed [rad/s].

    Args:
        start: that of the drive at a speed nearby.
        valve: check valves "shut", or "open" as at rest.

    Raises:
        DriveError: a chain that does not fit.
        SimulationError: a drive that does not settle, or a chain too fast.
    """
    begun = None if start is None else [part.packed for part in start.parts]
    drained = [t.name for t in drive.tensioners if t.is_drained]
    drive = drive.with_values({f"tensioners.{name}.chamber.drained": 0.0 for name in drained}) if drained else drive
    found = standing_chains(drive, speed, begun)
    parts = [_chain_motion(chain, own, packed, tension, valve) for chain, own, packed, tension in found]
    parts, ties = _tie_chains(parts, Model(drive).shared_bodies)
    joined = [
        _sum_over_chains(ties, [getattr(part, name) for part in parts])
        for name in ("mass", "damping", "stiffness", "travel")
    ]
    return DriveMotion(drive, speed, tuple(chain for chain, *_ in found), tuple(parts), tuple(ties), *joined)


def _sum_over_chains(ties: list[sp.csc_array], matrices: list[sp.csc_array]) -> sp.csc_array:
    """Matrix (n, n) of a drive, summed from its chains'."""
    if len(matrices) == 1:
        return matrices[0]
    return sp.csc_array(sum(tie.T @ own @ tie for tie, own in zip(ties, matrices, strict=True)))


def _tie_chains(parts: list[ChainMotion], shafts: Joined) -> tuple[list[ChainMotion], list[sp.csc_array]]:
    """Small motions of chains on shared shafts, and their ties P_c."""
    counts = [part.at.coordinate_count for part in parts]
    places = [first + np.arange(n) for first, n in zip(np.cumsum([0, *counts]), counts, strict=False)]
    kept, parts, share = np.ones(sum(counts), dtype=np.bool_), list(parts), [np.ones(n) for n in counts]
    for (r, s), *others in shafts:
        first = parts[r].at.turning_coordinate(s)
        for other, t in others:
            mine = parts[other].at.turning_coordinate(t)
            if first is not None and mine is not None:
                kept[places[other][mine[0]]] = False
                places[other][mine[0]], share[other][mine[0]] = places[r][first[0]], first[1] / mine[1]
                parts[other] = parts[other].without_inertia_of(mine[0])
    number = np.cumsum(kept) - 1
    ties = []
    for place, part in zip(places, share, strict=True):
        at = np.arange(len(place)), number[place]
        ties.append(sp.csc_array((part, at), shape=(len(place), int(kept.sum()))))
    return parts, ties


def _chain_motion(model: ChainModel, speed: float, packed: PackedEnsemble, tension: Array, valve: str) -> ChainMotion:
    """Small motion of one packed chain."""
    probe = ForceProbe(packed)
    try:
        state = probe.packed_state()
        at = free_coordinates(probe, state)
        rate = passing_rate(model, speed)
        pushed = centrifugal_matrix(at.rollers, at.mass, rate, at.coordinate_count)
        own = sp.csc_array(stiffness_matrix(probe, at, state, model.chain.pitch) - pushed)
        places = roller_places(packed.assemblies[0], probe.touching_rollers(state)[: len(model.sprockets)])
        travel = travel_matrix(at.rollers, at.mass, rate, places.free_links, at.coordinate_count)
        drag = damping_matrix(probe, at, state, oil_conductances(model, valve) if len(at.chambers) else None)
        x, _ = tensioner_strokes(probe, state)
        return ChainMotion(
            model, speed, packed, state, tension, x, valve, at, places, at.mass_matrix, drag, own, travel
        )
    finally:
        probe.close()
