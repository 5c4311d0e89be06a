"""Tensioners of one variant through a step on the CPU: supplies and oil."""

from typing import Any

import warp as wp

from ..physics.body import pose_of
from ..physics.tensioner import advance_tensioner, extension_and_rate, supply_pressure
from ..structs import Drive
from ..sums import add_flows


@wp.func
def find_supplies(ensemble: Any, state: Any, drive: Drive, time: wp.float64):
    """Sets tabulated supply pressures of tensioners at a step's start, on the CPU."""
    for t in range(drive.first_tensioner, drive.first_tensioner + drive.tensioners):
        tensioner = ensemble.tensioners[t]
        if tensioner.supply_table.cells > 0:
            pump = drive.first_body + tensioner.pump
            forward = ensemble.motions[pump].sign * state.poses[pump].speed
            state.tensioners[t].supply = supply_pressure(time, forward, tensioner, ensemble.tables)


@wp.func
def advance_tensioners(ensemble: Any, state: Any, drive: Drive):
    """Advances tensioners on the CPU by a step after bodies, and adds flows to meters."""
    for t in range(drive.first_tensioner, drive.first_tensioner + drive.tensioners):
        tensioner = ensemble.tensioners[t]
        x, rate = extension_and_rate(pose_of(state.bodies[drive.first_body + tensioner.body]), tensioner)
        if tensioner.supply_table.cells > 0:
            tensioner.supply = state.tensioners[t].supply
        after, flows = advance_tensioner(x, rate, drive.step, True, state.tensioners[t], tensioner)
        state.tensioners[t] = after
        state.meters[t] = add_flows(state.meters[t], flows)
