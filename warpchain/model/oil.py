"""Oil in a hydraulic tensioner at rest."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING

from warpchain.drive.stack_math import Number, maximum, power

if TYPE_CHECKING:
    from warpchain.drive.tensioners import Oil, Relief, Tensioner, Valve

EXPONENT = 1.4
"""Adiabatic exponent of air [-]."""
LAMINAR_DROP = 5.0e3
"""Pressure drop of linear valve flow [Pa]."""
BOTTOM = 0.95
"""Share of a chamber's volume for the plunger [-]."""


def oil_stiffness(tensioner: Tensioner) -> float:
    """Stiffness of a tensioner's closed oil chamber [N/m]."""
    if not tensioner.hydraulic:
        return 0.0
    oil, chamber = tensioner.oil, tensioner.chamber
    assert oil is not None and chamber is not None
    return oil.bulk_modulus * (1.0 + oil.air) * power(tensioner.area, 2) / chamber.volume


def valve_flow(tensioner: Tensioner, pressure: float) -> float:
    """Flow through a tensioner's check valve at an absolute pressure [m^3/s]."""
    oil, valve = tensioner.oil, tensioner.valve
    assert oil is not None and valve is not None
    drop = oil.supply - pressure
    area = _lifted_area(valve, drop * valve.hole_area - valve.preload)
    return _jet_flow(area, drop, oil)


def outlet_flows(tensioner: Tensioner, pressure: float) -> tuple[float, float]:
    """Flows through a tensioner's relief valve and vent at an absolute pressure [m^3/s]."""
    oil, relief, vent = tensioner.oil, tensioner.relief, tensioner.vent
    assert oil is not None
    drop = pressure - oil.ambient
    relieved = vented = 0.0
    if relief is not None:
        relieved = _jet_flow(_lifted_area(relief, drop * relief.hole_area - relief.preload(oil.ambient)), drop, oil)
    if vent is not None:
        vented = _jet_flow(vent.flow_area, drop, oil)
    return relieved, vented


def _lifted_area(valve: Valve | Relief, push: float) -> float:
    """Jet area of an oil valve under a force [m^2]."""
    if push <= 0.0:
        return 0.0
    lift = valve.lift if push >= valve.stiffness * valve.lift else push / valve.stiffness
    curtain = valve.discharge * valve.flow_area(lift)
    return curtain * valve.hole_area / math.hypot(curtain, valve.hole_area)


def _jet_flow(area: float, drop: float, oil: Oil) -> float:
    """Flow of an oil jet over a pressure drop [m^3/s]."""
    limit = max(drop, LAMINAR_DROP)
    return area * math.sqrt(2.0 * limit / oil.density) * drop / limit if drop > 0.0 else 0.0


def static_pressure(tensioner: Tensioner) -> Number:
    """Absolute oil pressure of a tensioner at rest [Pa]."""
    from warpchain.model.stacks import pick_variants, stack_arrays

    assert tensioner.oil is not None
    oil = tensioner.oil.model_copy(update={"supply_table": None})
    own = tensioner.model_copy(update={"spring": None, "at": (0.0, 0.0), "direction": (1.0, 0.0), "oil": oil})
    column = next(stack_arrays(own), None)
    if column is None:
        return _single_static_pressure(own)
    import numpy as np

    return np.array([_single_static_pressure(pick_variants(own, v)) for v in range(len(column))])


@lru_cache(maxsize=1024)
def _single_static_pressure(tensioner: Tensioner) -> float:
    """Oil pressure at rest of one tensioner [Pa]."""
    oil = tensioner.oil
    assert oil is not None
    if tensioner.is_drained:
        return oil.ambient
    low, high = oil.ambient, oil.supply
    while low < (middle := 0.5 * (low + high)) < high:
        out = tensioner.leak_conductance * (middle - oil.ambient) + sum(outlet_flows(tensioner, middle))
        if valve_flow(tensioner, middle) > out:
            low = middle
        else:
            high = middle
    return low


def filled_tensioner(tensioner: Tensioner) -> Tensioner:
    """A tensioner with its oil chamber full."""
    if tensioner.chamber is None:
        return tensioner
    return tensioner.model_copy(update={"chamber": tensioner.chamber.model_copy(update={"drained": 0.0})})


def filling_time(tensioner: Tensioner) -> float:
    """Time in which oil fills a drained chamber [s]."""
    oil, chamber = tensioner.oil, tensioner.chamber
    assert oil is not None and chamber is not None
    most = oil.supply if oil.supply_table is None else max(oil.supply_table.values)
    fed = tensioner.model_copy(update={"oil": oil.model_copy(update={"supply": most})})
    flow = valve_flow(fed, oil.ambient)
    return chamber.drained * chamber.volume / flow if flow > 0.0 else math.inf


def static_force(tensioner: Tensioner, x: float = 0.0) -> Number:
    """Force of a tensioner at rest at an extension [N]."""
    push = tensioner.spring_preload - tensioner.spring_stiffness * x
    if tensioner.hydraulic:
        assert tensioner.oil is not None
        push = push + (static_pressure(tensioner) - tensioner.oil.ambient) * tensioner.area
    return maximum(push, 0.0)


def bottom_place(tensioner: Tensioner) -> float:
    """Extension of a plunger on its chamber's bottom [m]."""
    if not tensioner.hydraulic:
        return -math.inf
    assert tensioner.chamber is not None
    return -BOTTOM * tensioner.chamber.volume / tensioner.area
