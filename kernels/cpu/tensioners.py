"""Tensioners of one variant through a step on the CPU: supplies and oil."""

from typing import Any

import warp as wp

from ..bodies.tensioners import advance_tensioner_at, find_supply
from ..physics.body import pose_of
from ..physics.tensioner import extension_and_rate
from ..structs import Drive


@wp.func
def find_supplies(ensemble: Any, state: Any, drive: Drive, time: wp.float64):
    """Sets tabulated supply pressures of tensioners at a step's start."""
    for t in range(drive.first_tensioner, drive.first_tensioner + drive.tensioners):
        tensioner = ensemble.tensioners[t]
        if tensioner.supply_table.cells > 0:
            find_supply(time, ensemble, state, drive, t, state.poses, drive.first_body + tensioner.pump)


@wp.func
def advance_tensioners(ensemble: Any, state: Any, drive: Drive):
    """Advances tensioners by a step after bodies, and adds flows to meters."""
    for t in range(drive.first_tensioner, drive.first_tensioner + drive.tensioners):
        tensioner = ensemble.tensioners[t]
        x, rate = extension_and_rate(pose_of(state.bodies[drive.first_body + tensioner.body]), tensioner)
        advance_tensioner_at(x, rate, drive.step, True, state, t, tensioner)
