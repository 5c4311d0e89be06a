"""The drives that speed is measured on, and ensembles of drives that differ."""

from typing import Any

from warpchain import Drive, load_drive, loads_drive
from warpchain.drive.examples import drive_path

TWO_SPROCKETS = """
[chain]
pitch = 0.1
links = 118
roller_mass = 3.0
stiffness = 2.0e8
damping = 2000.0
roller_radius = 0.03
[[sprockets]]
name = "driver"
teeth = 30
center = [0.0, 0.0]
wrap = "ccw"
prescribed = { speed = 12.0 }
[[sprockets]]
name = "driven"
teeth = 30
center = [4.4004, 0.0]
wrap = "ccw"
inertia = 50.0
load = { torque = 5000.0 }
[contact.sprocket]
seat_angle = 137.0
clearance = 1.0e-4
restitution = 0.8
impact_speed_floor = 0.05
stiffness = 5.0e8
[run]
duration = 1.0
step = 5.0e-6
sample_rate = 5000.0
"""
SMOOTH: dict[str, Any] = {
    "chain.joint": None,
    "contact.sprocket.friction": None,
    "contact.guide.friction": None,
    "contact.guide.rolling": False,
}
"""The values that take friction from a drive."""
JOINT_FRICTION: dict[str, Any] = {"chain.joint": {"friction": 0.1, "pin_radius": 0.02}}
STRIBECK = JOINT_FRICTION | {"chain.joint.static_friction": 0.15, "chain.joint.stribeck_speed": 0.05}


def named(name: str) -> Drive:
    """A drive by name: `two` equal sprockets, the same by `rk4`, `smooth` (marine without friction), or an example."""
    if name == "rk4":
        return named("two").with_values({"run.integrator": "rk4"})
    if name == "two":
        return loads_drive(TWO_SPROCKETS)
    if name == "smooth":
        return load_drive(drive_path("marine")).with_values(SMOOTH)
    return load_drive(drive_path(name))


def of_length(links: int) -> Drive:
    """Two equal sprockets with a chain of so many links."""
    center = [(links - 30) / 2 * 0.1 + 0.0004, 0.0]
    return named("two").with_values({"chain.links": links, "sprockets.driven.center": center})


def other(drive: Drive, k: int) -> Drive:
    """The k-th of marine drives that differ in five values, two of which move rollers to other places.

    The camshaft's torque, the tightener's place, the chain's elongation, roller mass and damping.
    """
    x, y = drive.sprockets[1].center
    values = {
        "sprockets.camshaft.load.torque": 8000.0 + 0.2 * k,
        "sprockets.tightener.center": [x - 1e-7 * k, y],
        "chain.elongation": 1e-8 * k,
        "chain.roller_mass": 6.95 + 1e-5 * k,
        "chain.damping": 1.0e5 + k,
    }
    return drive.with_values(values)


def different(drive: Drive, count: int) -> list[Drive]:
    """As many of `other`."""
    return [other(drive, k) for k in range(count)]


def kinds_of(base: Drive) -> list[Drive]:
    """Two-sprocket drives of 224 kinds: 14 numbers of teeth by 16 of links."""
    return [
        base.with_values(
            {
                "chain.links": links,
                "sprockets.driver.teeth": teeth,
                "sprockets.driven.teeth": teeth,
                "sprockets.driven.center": [(links - teeth) / 2 * base.chain.pitch + 0.0004, 0.0],
            }
        )
        for teeth in range(20, 34)
        for links in range(104, 136, 2)
    ]
