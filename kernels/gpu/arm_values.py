"""Values that arms on a block share where arms carry arms (`carried_arms`)."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..native import row_access
from .block_kinds import BlockKind
from .shared_memory import ARM_FORCE, VALUES_PER_ARM


@dataclass(frozen=True)
class ArmValueFunctions:
    """Values that arms share."""

    arm_value: wp.Function
    share_value: wp.Function
    shared_value: wp.Function
    share_force: wp.Function


@cache
def arm_value_functions(kind: BlockKind) -> ArmValueFunctions:
    """The functions that share values of arms, and read them."""
    Real, rotors = kind.Real, kind.parts.rotors
    kinds = kind.types
    Shared = kinds.Shared
    vec2 = kinds.vec2
    access = row_access(Real)

    @wp.func
    def arm_value(shared: Shared, a: int, k: int):
        """Value k that arm `a` shares where arms carry arms."""
        return access.load(shared.carried_arms, a * VALUES_PER_ARM + k)

    @wp.func
    def share_value(shared: Shared, b: int, k: int, value: Real):
        """Shares value k of body b, an arm."""
        access.store(shared.carried_arms, (b - rotors) * VALUES_PER_ARM + k, value)

    @wp.func
    def shared_value(shared: Shared, b: int, k: int):
        """Value k that body b, an arm, shares."""
        return arm_value(shared, b - rotors, k)

    @wp.func
    def share_force(shared: Shared, b: int, force: vec2):
        """Shares a force [N] that body b, an arm, passes on to the one that carries it."""
        share_value(shared, b, ARM_FORCE, force[0])
        share_value(shared, b, ARM_FORCE + 1, force[1])

    return ArmValueFunctions(
        arm_value=arm_value,
        share_value=share_value,
        shared_value=shared_value,
        share_force=share_force,
    )
