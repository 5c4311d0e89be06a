"""Forces of one variant at one instant on the CPU: of links, joints, contacts, tensioners and hubs."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..physics.link import has_uneven_links
from ..physics.tensioner import tensioner_push
from ..structs import Drive, Wrench, types
from . import hubs
from .contact_pairs import contact_pair_functions
from .joints import joint_functions
from .near_rollers import near_roller_functions
from .rollers import roller_functions, rows
from .strand_loads import strand_load_functions


@dataclass(frozen=True)
class ForceFunctions:
    """CPU force functions."""

    add_link_forces: wp.Function
    add_contact_forces: wp.Function


@cache
def force_functions(Real: type, capacity: int, silent: bool) -> ForceFunctions:
    """CPU force functions, with silent chains only where `silent`."""
    kinds = types(Real)
    rollers = roller_functions(Real, capacity)
    near_rollers = near_roller_functions(Real, capacity)
    contact_pairs = contact_pair_functions(Real, capacity, silent)
    row = rows(capacity)
    strand_loads = strand_load_functions(Real, capacity)
    joints = joint_functions(Real, capacity)

    @wp.func
    def add_link_forces(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        drive: Drive,
        chain: kinds.Chain,
        w: wp.array[Real],
        memory: kinds.Memory,
    ):
        """Sets poses of bodies, and rollers' link and joint forces in CPU rows; adds tensioners'."""
        n = drive.rollers
        near_rollers.find_poses(state, drive)
        rubs = chain.joint.inertia > Real(0.0)
        if has_uneven_links(chain) or rubs:
            joints.find_link_forces(w, n, chain)
        else:
            rollers.find_link_forces(w, n, chain)
        if rubs:
            joints.find_joint_moments(w, n, chain, memory)
            joints.add_couple_forces(w, n)
        if chain.load.relative_mass > Real(0.0):
            strand_loads.carry_goods(state, w, drive.first_roller, n, Real(drive.step), chain)
        if memory.wanted.sizes != 0:
            rollers.clear_rows(w, row.sprocket_force, row.guide_force, n)
        for t in range(drive.first_tensioner, drive.first_tensioner + drive.tensioners):
            tensioner = ensemble.tensioners[t]
            pushed = state.poses[drive.first_body + tensioner.body]
            state.pushes[t] = tensioner_push(pushed, memory.stage == 0, state.tensioners[t], tensioner)

    @wp.func
    def add_contact_forces(
        ensemble: kinds.Ensemble,
        state: kinds.State,
        drive: Drive,
        place: int,
        w: wp.array[Real],
        memory: kinds.Memory,
    ):
        """Adds contact forces to rollers in CPU rows; sets wrenches on bodies, with hubs'."""
        for b in range(drive.first_body, drive.first_body + drive.bodies):
            state.wrenches[b] = Wrench()
        contact_pairs.add_contact_forces(ensemble, state, drive, place, w, memory)
        if drive.hubs != 0:
            hubs.add_hub_reactions(ensemble, state, drive, memory.stage, wp.float64(memory.stretch_part))

    return ForceFunctions(add_link_forces=add_link_forces, add_contact_forces=add_contact_forces)
