"""Tensioners at rest: the force that they push with at an extension, the oil at the pressure at which flows balance."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from warpchain.drive.tensioners import Tensioner

LAMINAR = 5.0e3
"""Difference of pressure below which the valve's flow is linear [Pa]."""


def static_pressure(tensioner: Tensioner) -> float:
    """Pressure in the chamber at rest [Pa]: what the valve lets in leaks, G (P - P_0) = Q_cv(P_s - P); 0 without oil.

    The valve's hole stands in series with the curtain under its ball, as in `kernels/physics/tensioner.py`. Where the
    supply does not crack the valve, the chamber leaks down to the ambient pressure.
    """
    oil, valve = tensioner.oil, tensioner.valve
    if not tensioner.hydraulic or oil is None or valve is None:
        return 0.0
    supply, ambient, density = oil.supply, oil.ambient, oil.density
    closed = supply - valve.cracking_pressure
    if closed <= ambient:
        return ambient

    def surplus(pressure: float) -> float:
        drop = supply - pressure
        push = drop * valve.hole_area - valve.preload
        lift = valve.lift if valve.stiffness == 0.0 else min(max(push / valve.stiffness, 0.0), valve.lift)
        curtain = valve.discharge * valve.flow_area(lift)
        through = curtain * valve.hole_area / math.hypot(curtain, valve.hole_area)
        limit = max(drop, LAMINAR)
        flow = through * math.sqrt(2.0 * limit / density) * (drop / limit)
        return flow - tensioner.leak_conductance * (pressure - ambient)

    from scipy.optimize import brentq

    if surplus(ambient) <= 0.0 or surplus(closed) >= 0.0:
        return ambient if surplus(ambient) <= 0.0 else closed
    return float(brentq(surplus, ambient, closed, xtol=1e-6))


def static_force(tensioner: Tensioner, extension: float) -> float:
    """Force at rest [N] at an extension [m]: (P - P_0) A + preload - k x, never pulling."""
    oil = 0.0
    if tensioner.hydraulic and tensioner.oil is not None:
        oil = (static_pressure(tensioner) - tensioner.oil.ambient) * tensioner.area
    return max(0.0, oil + tensioner.spring_preload - tensioner.spring_stiffness * extension)
