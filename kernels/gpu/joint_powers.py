"""Friction powers of the joints of a block's chains, for frames."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..native import row_access
from ..physics.friction import (
    joint_friction_power,
)
from .block_kinds import BlockKind
from .block_structs import ThreadParts
from .chains import chain_functions
from .joints import joint_functions
from .links import link_functions
from .rollers import roller_functions


@dataclass(frozen=True)
class JointPowerFunctions:
    """Joint power functions of a block."""

    friction_power: wp.Function


@cache
def joint_power_functions(kind: BlockKind) -> JointPowerFunctions:
    """Joint power functions of block kernels."""
    Real = kind.Real
    kinds = kind.types
    Ensemble, State, Shared = kinds.Ensemble, kinds.State, kinds.Shared
    vec2 = kinds.vec2
    rollers = roller_functions(kind)
    access = row_access(Real)
    chains = chain_functions(kind)
    links = link_functions(kind)
    joints = joint_functions(kind)

    @wp.func
    def tension_and_turn_rates(ensemble: Ensemble, shared: Shared, mine: ThreadParts, j: int, lag: Real):
        """Tension [N] and rate of turning [rad/s] of a block's link j, and that rate from `lag` [s] later."""
        n = mine.rollers
        tension, rate, force = links.link_load(shared, j, n, access.load(ensemble.lengths, mine.first_roller + j))
        d, w = links.link_vector_and_velocity(shared, j, n)
        next = chains.next_roller(shared, j, n)
        lever, turn = joints.turning_of_link(shared, j, n, d, w)
        later = turn + lag * wp.dot(lever, rollers.acceleration(shared, next) - rollers.acceleration(shared, j))
        return tension, turn, later

    @wp.func
    def friction_power(ensemble: Ensemble, state: State, shared: Shared, mine: ThreadParts, j: int, lag: Real):
        """Power [W] that joint j of a block dissipates, at rates from `lag` [s] later."""
        last = chains.previous_roller(shared, j, mine.rollers)
        tension_before, turn_before, later_before = tension_and_turn_rates(ensemble, shared, mine, last, lag)
        tension, turn, later = tension_and_turn_rates(ensemble, shared, mine, j, lag)
        held = access.load(state.joint_hold, mine.first_roller + j)
        first, second = vec2(tension_before, turn_before), vec2(tension, turn)
        moment, holds = joints.moment_between_links(first, second, held, chains.chain_at(shared, j), Real(0.0))
        return joint_friction_power(moment, later_before, later)

    return JointPowerFunctions(friction_power=friction_power)
