"""Drives with silent chains that tests share."""

import math

from drives import two_sprockets

from warpchain import Drive, loads_drive
from warpchain.drive.drive import drive_values

CENTERS = 0.222
"""Distance of the two shafts [m]."""


def pulled_silent_drive(teeth: tuple[int, int] = (23, 23), wrap: str = "ccw", **values: object) -> Drive:
    """Two wheels and the silent chain of 9.525 mm that fits between them, on a slider, with values replaced."""
    pitch, (first, second) = 9.525e-3, teeth
    links = 2.0 * CENTERS / pitch + 0.5 * (first + second) + ((first - second) / math.tau) ** 2 * pitch / CENTERS
    text = f"""
[chain]
kind = "silent"
pitch = {pitch}
links = {2 * math.ceil(links / 2)}
mass_per_length = 1.0
stiffness = 2e7
damping_ratio = 0.02
[[sprockets]]
name = "drive"
teeth = {first}
center = [0.0, 0.0]
wrap = "{wrap}"
prescribed = {{ speed = 200.0 }}
[[sprockets]]
name = "driven"
teeth = {second}
center = [{CENTERS}, 0.0]
wrap = "{wrap}"
inertia = 2e-4
mass = 1.0
mount = {{ kind = "slider", direction = [1.0, 0.0], stiffness = 0.0, damping = 50.0, preload = 1000.0 }}
[contact.sprocket]
restitution = 0.3
impact_speed_floor = 0.02
stiffness = 5e7
[run]
duration = 0.002
step = "auto"
"""
    return loads_drive(text).with_values(values)


def silent_drive(**values):
    """Two equal wheels of a silent chain; `values` as of `drives.two_sprockets`."""
    whole = two_sprockets(**{"teeth": 20, "links": 60} | values).model_dump(exclude_none=True)
    del whole["chain"]["roller_radius"]
    whole["chain"]["kind"] = "silent"
    return Drive(**whole)


def guided_silent_drive(**values: object) -> Drive:
    """`pulled_silent_drive` with a bent rail above its chain, flat between two arcs, and a straight bar below."""
    pitch = 9.525e-3
    high = 0.5 * pitch / math.sin(math.pi / 23) + 0.4 * pitch - 2e-3  # of faces that press strands in by 2 mm
    rail = {"name": "rail", "radius": 0.06, "end_radius": 0.005}
    rail["points"] = [[0.17, high + 6e-3], [0.14, high], [0.08, high], [0.05, high + 6e-3]]
    bar = {"name": "bar", "start": [0.07, -high], "end": [0.15, -high], "end_radius": 0.01}
    drive = drive_values(pulled_silent_drive()) | {"guides": [rail, bar]}
    drive["contact"]["guide"] = {"restitution": 0.5, "impact_speed_floor": 0.02, "stiffness": 1e7}
    drive["sprockets"][1]["center"] = [CENTERS + 2.6e-3, 0.0]  # where it just fits
    return Drive(**drive).with_values(values)
