"""The example `car` with all that an engine may ask of it: gas torque on a flywheel, heat, oil in every way."""

import math

from drives import example

from warpchain.drive import Drive

CYCLE = [math.radians(degrees) for degrees in range(0, 721, 10)]
"""Angles of two turns [rad]."""
GAS = [60.0 * (1.0 - math.cos(2.0 * angle)) * (1.0 + 0.3 * math.sin(0.5 * angle)) for angle in CYCLE]
"""Torque over them [N m]; the last is the first."""
VALUES = {
    "temperature": 60.0,
    "expansion": {"block": "aluminum"},
    "shafts": [
        {
            "name": "flywheel", "inertia": 0.2, "initial_speed": 300.0, "load": {"torque": 60.0},
            "motor": {"table": {"angle": CYCLE, "torque": [*GAS[:-1], GAS[0]]}},
        }
    ],
    "tensioners.tensioner.chamber.drained": 0.01,
    "tensioners.tensioner.relief": {"pressure": 2.2e5, "diameter": 2e-3, "stiffness": 2e4, "lift": 2e-6},
    "tensioners.tensioner.vent": {"diameter": 2e-4},
    "tensioners.tensioner.oil.viscosity": None,
    "tensioners.tensioner.oil.viscosity_40": 62e-6,
    "tensioners.tensioner.oil.viscosity_100": 10.3e-6,
    "tensioners.tensioner.oil.supply_table": {"speed": [0.0, 320.0], "pressure": [3e5, 4e5], "shaft": "crank"},
}  # fmt: skip


def fired(**changes) -> Drive:
    """The drive with all of that, from its first step on."""
    at_once = {"sprockets.crank.prescribed.ramp_time": 0.0}
    return example("car").with_values(VALUES | at_once | changes)
