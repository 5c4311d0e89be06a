"""The drives that speed is measured on, and ensembles of drives that differ."""

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np
from common.drives import Values, equal_sprocket_values, example_drive, two_sprockets, without_friction

from warpchain import Drive

Range = Callable[[float, float], float]
"""A value, given a drive's own and a share of the range."""
PITCH, SLACK = 0.1, 0.0004
TWO = equal_sprocket_values(30, 118, PITCH, SLACK) | {
    "chain.roller_mass": 3.0,
    "chain.stiffness": 2e8,
    "chain.roller_radius": 0.03,
    "sprockets.driver.prescribed.speed": 12.0,
    "sprockets.driven.inertia": 50.0,
    "sprockets.driven.load.torque": 5000.0,
    "contact.sprocket.seat_angle": 137.0,
    "contact.sprocket.restitution": 0.8,
    "contact.sprocket.impact_speed_floor": 0.05,
    "contact.sprocket.stiffness": 5e8,
    "run": {"duration": 1.0, "step": 5e-6, "sample_rate": 5000.0},
}
"""The values of two equal sprockets."""
JOINT_FRICTION: Values = {"chain.joint": {"friction": 0.1, "pin_radius": 0.02}}
STRIBECK = JOINT_FRICTION | {"chain.joint.static_friction": 0.15, "chain.joint.stribeck_speed": 0.05}
HARMONICS: Values = {
    f"sprockets.{cam}.load.harmonics": [
        {"order": 4, "amplitude": 7.56, "phase": 1.5708 + 4.0 * lead},
        {"order": 8, "amplitude": 0.96, "phase": -1.5708 + 8.0 * lead},
    ]
    for cam, lead in (("intake cam", 0.0), ("exhaust cam", 1.9199))
}
"""Two orders of a camshaft's torque at 3000 rpm, for valves, which the C program does not know."""


def drive_by_name(name: str) -> Drive:
    """A drive by name: `two` equal sprockets, the same by `rk4`, `smooth` (marine without friction), `harmonics` (`car`
    with these for its valves), or an example.
    """
    if name in ("two", "rk4"):
        return two_sprockets(TWO | ({"run.integrator": "rk4"} if name == "rk4" else {}))
    if name == "harmonics":
        return example_drive("car", {"valves": ()} | HARMONICS)
    return without_friction(example_drive("marine")) if name == "smooth" else example_drive(name)


def without_valves(name: str) -> Drive:
    """A drive by name as the C program knows it: camshafts of `car` have harmonics for valves."""
    return drive_by_name("harmonics" if name == "car" else name)


def two_sprockets_of_length(links: int) -> Drive:
    """Two equal sprockets with a chain of so many links."""
    return drive_by_name("two").with_values(equal_sprocket_values(30, links, PITCH, SLACK))


def varied_factor(low: float, high: float) -> Range:
    """Value of a drive times a factor between these, for designs."""
    return lambda own, share: own * (low + (high - low) * share)


def varied_value(low: float, high: float) -> Range:
    """Value between these, for designs."""
    return lambda own, share: low + (high - low) * share


MARINE = {
    "sprockets.camshaft.load.torque": varied_value(6e3, 12e3),
    "chain.stiffness": varied_factor(0.8, 1.2),
    "chain.damping": varied_factor(0.5, 1.5),
    "sprockets.camshaft.inertia": varied_factor(0.7, 1.3),
    "sprockets.tightener.center.0": varied_value(1.190, 1.196),
    "sprockets.tightener.center.1": varied_value(3.0, 3.05),
}
TWO_EQUAL = {
    "sprockets.driven.load.torque": varied_factor(0.6, 1.3),
    "chain.stiffness": varied_factor(0.8, 1.2),
    "chain.damping": varied_factor(0.5, 1.5),
    "sprockets.driven.inertia": varied_factor(0.5, 2.0),
    "contact.sprocket.restitution": varied_value(0.6, 0.9),
}
CAR = {
    "tensioners.tensioner.spring.preload": varied_value(30.0, 90.0),
    "chain.stiffness": varied_factor(0.8, 1.2),
    "chain.joint.friction": varied_value(0.05, 0.11),
    "sprockets.intake cam.inertia": varied_factor(0.7, 1.3),
    "chain.damping_ratio": varied_factor(0.5, 3.0),
}
RANGES = {
    "two": TWO_EQUAL,
    "marine": MARINE,
    "smooth": MARINE,
    "car": CAR,
    "harmonics": CAR,
    "industrial": {
        "sprockets.conveyor.load.torque": varied_factor(0.6, 1.3),
        "sprockets.conveyor.inertia": varied_factor(0.5, 2.0),
        "chain.joint.friction": varied_value(0.05, 0.2),
        "chain.damping_ratio": varied_factor(0.5, 3.0),
        "contact.sprocket.restitution": varied_value(0.2, 0.5),
    },
    "engine": {
        "chain.stiffness": varied_factor(0.7, 1.4),
        "chain.damping_ratio": varied_factor(0.5, 3.0),
        "sprockets.exhaust cam.inertia": varied_factor(0.7, 1.3),
        "sprockets.intake cam.inertia": varied_factor(0.7, 1.3),
    },
}
"""By how much drives of a name differ in a design: in what an engineer may choose, and in what is not known."""


@cache
def varied_designs(drive: Drive, name: str, count: int) -> Sequence[Drive]:
    """Drives that differ as those of a design of experiments do: one with values uniform over the ranges of a name.

    Their automatic steps differ, too: those of marine drives twofold.
    """
    ranges = RANGES[name].items()
    own = [float(drive.get_value(path)) for path, _ in ranges]
    rows = np.random.default_rng(1).random((count, len(own))).tolist()
    values = [{path: to(mine, share) for (path, to), mine, share in zip(ranges, own, row, strict=True)} for row in rows]
    return [drive.with_values(each) for each in values]


def two_sprocket_kinds() -> list[Drive]:
    """Two-sprocket drives of 224 kinds: 14 numbers of teeth by 16 of links."""
    base = drive_by_name("two")
    sizes = [(teeth, links) for teeth in range(20, 34) for links in range(104, 136, 2)]
    return [base.with_values(equal_sprocket_values(teeth, links, PITCH, SLACK)) for teeth, links in sizes]
