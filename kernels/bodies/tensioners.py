"""Tensioners on the CPU and blocks alike: supplies, oil, sums over the window (`physics.tensioner`)."""

from typing import Any

import warp as wp

from ..number import leading_value
from ..physics.tensioner import advance_tensioner, extension_rate, plunger_arm, plunger_losses, supply_pressure
from ..structs import Drive
from ..sums import add_flows, add_tensioner


@wp.func
def find_supply(time: Any, ensemble: Any, state: Any, drive: Drive, t: int, poses: Any, pump: int):
    """Stores the tabulated supply pressure of tensioner `t` of all at a step's start, by its pump's pose."""
    tensioner = ensemble.tensioners[t]
    forward = ensemble.motions[drive.first_body + tensioner.pump].sign * leading_value(poses[pump].speed)
    state.tensioners[t].supply = supply_pressure(time, forward, tensioner, ensemble.tables)


@wp.func
def advance_tensioner_at(x: Any, rate: Any, h: Any, metered: bool, state: Any, t: int, tensioner: Any):
    """Advances tensioner `t` of all by `h` [s], its plunger then at `x` [m]; adds what has flowed to its meter."""
    if tensioner.supply_table.cells > 0:
        tensioner.supply = state.tensioners[t].supply
    after, flows = advance_tensioner(x, rate, h, metered, state.tensioners[t], tensioner)
    state.tensioners[t] = after
    state.meters[t] = add_flows(state.meters[t], flows)


@wp.func
def tensioner_sums(sums: Any, before: Any, seen: Any, state: Any, t: int, tensioner: Any, weight: Any):
    """Window's sums of tensioner `t` of all with a step added, its body at `before` with rates of `seen`."""
    push, arm = state.pushes[t], leading_value(plunger_arm(before, tensioner))
    rate = extension_rate(arm, seen.speed, seen.velocity, tensioner)
    power, suction = plunger_losses(push, rate, state.tensioners[t], tensioner)
    return add_tensioner(sums, push, power, suction, weight)
