"""The drives of scripts: examples with other values, and two equal sprockets."""

from typing import Any

from warpchain import Drive, load_drive, loads_drive
from warpchain.drive.examples import drive_path

Values = dict[str, Any]
TWO = """
[chain]
pitch = 0.05
links = 60
roller_mass = 1.0
stiffness = 5e7
damping = 2000.0
roller_radius = 0.015
[[sprockets]]
name = "driver"
teeth = 20
center = [0.0, 0.0]
wrap = "ccw"
prescribed = { speed = 10.0 }
[[sprockets]]
name = "driven"
teeth = 20
center = [1.0, 0.0]
wrap = "ccw"
inertia = 2.0
load = { torque = 300.0 }
[contact.sprocket]
seat_angle = 125.0
clearance = 1e-4
restitution = 0.5
impact_speed_floor = 0.02
stiffness = 2e8
[run]
settle = false
duration = 0.01
step = 5e-6
sample_rate = 4000.0
gravity = [0.0, -9.81]
"""


def example(name: str, values: Values | None = None) -> Drive:
    """One of the package's examples, with other values."""
    return load_drive(drive_path(name)).with_values(values or {})


def pair(values: Values | None = None) -> Drive:
    """Two equal sprockets, with other values."""
    return loads_drive(TWO).with_values(values or {})


def equal(teeth: int, links: int, pitch: float, slack: float = 0.0) -> Values:
    """Values that give both sprockets so many teeth, and put them apart by the chain's straight strands and `slack`."""
    span = (links - teeth) / 2 * pitch + slack
    return {
        "chain.pitch": pitch,
        "chain.links": links,
        "sprockets.driver.teeth": teeth,
        "sprockets.driven.teeth": teeth,
        "sprockets.driven.center": [span, 0.0],
    }
