"""Tensioners of one variant through a step on the CPU: supplies and oil."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..physics.body import pose_of
from ..physics.tensioner import advance_tensioner, extension_and_rate, supply_pressure
from ..structs import Drive, types
from ..sums import add_flows


@dataclass(frozen=True)
class TensionerFunctions:
    """CPU tensioner functions (`physics.tensioner`)."""

    find_supplies: wp.Function
    advance_tensioners: wp.Function


@cache
def tensioner_functions(Real: type) -> TensionerFunctions:
    """CPU tensioner functions."""
    kinds = types(Real)
    Ensemble, State = kinds.Ensemble, kinds.State

    @wp.func
    def find_supplies(ensemble: Ensemble, state: State, drive: Drive, time: wp.float64):
        """Sets tabulated supply pressures of tensioners at a step's start, on the CPU."""
        for t in range(drive.first_tensioner, drive.first_tensioner + drive.tensioners):
            tensioner = ensemble.tensioners[t]
            if tensioner.supply_table.cells > 0:
                pump = drive.first_body + tensioner.pump
                forward = ensemble.motions[pump].sign * state.poses[pump].speed
                state.tensioners[t].supply = supply_pressure(time, forward, tensioner, ensemble.tables)

    @wp.func
    def advance_tensioners(ensemble: Ensemble, state: State, drive: Drive):
        """Advances tensioners on the CPU by a step after bodies, and adds flows to meters."""
        for t in range(drive.first_tensioner, drive.first_tensioner + drive.tensioners):
            tensioner = ensemble.tensioners[t]
            x, rate = extension_and_rate(pose_of(state.bodies[drive.first_body + tensioner.body]), tensioner)
            if tensioner.supply_table.cells > 0:
                tensioner.supply = state.tensioners[t].supply
            after, flows = advance_tensioner(x, rate, drive.step, True, state.tensioners[t], tensioner)
            state.tensioners[t] = after
            state.meters[t] = add_flows(state.meters[t], flows)

    return TensionerFunctions(find_supplies=find_supplies, advance_tensioners=advance_tensioners)
