"""Drives that tests share, as data and as values to be spoiled, and what errors they make."""

import math
import tomllib

import numpy as np
import pytest
from parts import coupling, shaft

from warpchain import Limits, Record, dumps_drive, load_drive, loads_drive, simulate
from warpchain.drive import Drive
from warpchain.drive.examples import FOLDER, drive_path, example_names
from warpchain.errors import DriveError

MARINE = FOLDER / "marine.toml"
ONE_CHAIN = [name for name in example_names() if not load_drive(drive_path(name)).chains]
"""Names of the example drives of one chain."""
LARGE = ("balance_shafts", "car", "derailleur", "motorcycle_drivetrain", "v6")
"""Example drives that take longest."""
STEEL = {"youngs_modulus": 2.1e11, "poissons_ratio": 0.3}
POSITIVE = "must be a positive number"
NOT_NEGATIVE = "must be a number of at least 0"

BLADE = """
[chain]
size = "06B"
links = 96
stiffness = "estimate"
damping_ratio = 0.02
[[sprockets]]
name = "crank"
teeth = 19
center = [0.0, 0.0]
wrap = "cw"
prescribed = { speed = 200.0 }
[[sprockets]]
name = "cam"
teeth = 38
center = [0.02, 0.30]
wrap = "cw"
inertia = 1.0e-3
load = { torque = 5.0 }
[[guides]]
name = "blade"
points = [[-0.050, 0.24], [-0.032, 0.15], [-0.045, 0.05]]
radius = 0.25
arm = "tensioner arm"
[[guides]]
name = "fixed rail"
start = [0.055, 0.22]
end = [0.04, 0.08]
end_radius = 0.03
side = "right"
offset = 0.004
[[arms]]
name = "tensioner arm"
pivot = [-0.055, 0.25]
mass = 0.09
center = [-0.05, 0.15]
inertia = 1.0e-3
free_angle = 5.0
stops = [-10.0, 12.0]
[[tensioners]]
name = "chain tensioner"
on = "tensioner arm"
at = [-0.055, 0.08]
direction = [2.0, 0.0]
kind = "hydraulic"
spring = { stiffness = 3500.0, preload = 90.0 }
plunger = { diameter = 0.016, mass = 0.033, gap = 5.0e-5, length = 0.007, eccentricity = 0.9 }
chamber = { volume = 1.0e-6 }
valve = { ball_radius = 0.003, seat_diameter = 0.0014, lift = 0.001, stiffness = 75.0, preload = 0.075 }
oil = { viscosity = 8.0e-5, supply = 3.0e5 }
ratchet = { pitch = 0.001, backlash = 2.0e-4 }
[contact.sprocket]
clearance = 1.0e-4
restitution = 0.3
impact_speed_floor = 0.02
stiffness = 1.0e8
[contact.guide]
restitution = 0.3
impact_speed_floor = 0.02
stiffness = 1.0e7
[run]
duration = 0.1
step = "auto"
sample_rate = 1000.0
"""
"""Two sprockets, a fixed rail on the tight strand, a sprung arm with a hydraulic tensioner on the slack one."""

SPRUNG = BLADE[: BLADE.index("[[tensioners]]")] + BLADE[BLADE.index("[contact.sprocket]") :]
SPRUNG = SPRUNG.replace("free_angle = 5.0", "free_angle = 8.0\nstiffness = 20.0").replace("stops = [-10.0, 12.0]\n", "")
SPRUNG = SPRUNG.replace("links = 96", "links = 92")
"""The same with a torsion spring in the arm in place of tensioner and stops."""


UPPER = {"name": "upper", "pivot": [-0.055, 0.25], "mass": 0.05, "center": [-0.05, 0.2], "inertia": 3e-4,
         "stiffness": 20.0, "free_angle": 8.0, "damping": 0.05}  # fmt: skip
LOWER = {"name": "lower", "arm": "upper", "pivot": [-0.042, 0.15], "mass": 0.04, "center": [-0.045, 0.1],
         "inertia": 2e-4, "stiffness": 8.0, "free_angle": 6.0, "damping": 0.02}  # fmt: skip


def of_long(*values):
    """Values of a parameter, or tuples of several's, whose tests are marked `long`."""
    return [pytest.param(*(v if isinstance(v, tuple) else (v,)), marks=pytest.mark.long) for v in values]


def but(values, long):
    """Values of a parameter, some of which have their tests marked `long`."""
    return [value for value in values if value not in long] + of_long(*(value for value in values if value in long))


def jointed_blade():
    """The values of two sprockets, a fixed rail, and the slack strand on a blade of two segments."""
    found = tomllib.loads(SPRUNG)
    blade = found["guides"][0]
    first = blade | {
        "name": "upper blade",
        "points": [[-0.050, 0.24], [-0.040, 0.195], [-0.034, 0.155]],
        "arm": "upper",
    }
    last = blade | {"name": "lower blade", "points": [[-0.0335, 0.145], [-0.038, 0.10], [-0.047, 0.05]], "arm": "lower"}
    return found | {"guides": [first, last, found["guides"][1]], "arms": [UPPER, LOWER]}


def example(name):
    """One of the package's example drives."""
    return load_drive(drive_path(name))


def marine_values():
    """The marine drive as plain values."""
    return tomllib.loads(MARINE.read_text())


def numbers(drive):
    """Every path of a drive that leads to a number."""
    return [path for path in drive.paths() if type(drive.get_value(path)) in (int, float)]


def put(values, path, value):
    """Sets (or with None takes away) a value in nested lists and tables."""
    *above, last = path.split("/")
    node = values
    for key in above:
        node = node[int(key)] if isinstance(node, list) else node.setdefault(key, {})
    if value is None:
        del node[last]
    elif isinstance(node, list):
        node[int(last)] = value
    else:
        node[last] = value


def errors_of(values):
    with pytest.raises(DriveError) as caught:
        Drive(**values)
    assert str(caught.value) == "\n".join(caught.value.errors)
    return caught.value.errors


def two_sprockets(teeth=20, links=40 + 20, span=20.0, stiffness=5e7, contact=2e8, damping=2000.0, torque=300.0,
inertia=2.0, speed=10.0, restitution=0.5, step=5e-6, duration=0.2, gravity=0.0, integrator="leapfrog",
                  clearance=1e-4, mass=1.0, settle="true", floor=0.02, seat_angle=125.0, viscous=0.0, ramp=0.0,
                  load_ramp=0.0):  # fmt: skip
    """Two equal sprockets `span` pitches apart."""
    return loads_drive(
        f"""
        [chain]
        pitch = 0.05
        links = {links}
        roller_mass = {mass}
        stiffness = {stiffness}
        damping = {damping}
        roller_radius = 0.015
        [[sprockets]]
        name = "driver"
        teeth = {teeth}
        center = [0.0, 0.0]
        wrap = "ccw"
        prescribed = {{ speed = {speed}, ramp_time = {ramp} }}
        [[sprockets]]
        name = "driven"
        teeth = {teeth}
        center = [{span * 0.05}, 0.0]
        wrap = "ccw"
        inertia = {inertia}
        load = {{ torque = {torque}, viscous = {viscous}, ramp_time = {load_ramp} }}
        [contact.sprocket]
        seat_angle = {seat_angle}
        clearance = {clearance}
        restitution = {restitution}
        impact_speed_floor = {floor}
        stiffness = {contact}
        [run]
        settle = {settle}
        duration = {duration}
        step = {step}
        integrator = "{integrator}"
        sample_rate = 20000.0
        gravity = [0.0, {gravity}]
        """
    )


def with_bar(start, end, end_radius=0.02):
    """Two sprockets 1 m apart and a guide-bar."""
    bar = {"name": "bar", "start": start, "end": end, "end_radius": end_radius}
    contact = {"restitution": 0.5, "impact_speed_floor": 0.02, "stiffness": 1e6}
    return two_sprockets().with_values({"contact.guide": contact, "guides": (bar,)})


STARTING = Limits(energy_change=math.inf, start=math.inf)
"""Limits of runs that end while their start still dies away."""


AT_REST = {"torque": 0.0, "speed": 0.0, "settle": "false", "step": 2e-6}
"""Two sprockets that stand."""


def with_parts(text, **values):
    """Two sprockets with shafts and what ties them, from TOML text."""
    return loads_drive(dumps_drive(two_sprockets(**(AT_REST | values))) + text)


def ran(drive, rate=1e4, **options):
    """The run of a drive on the device of the test, all of it recorded and in the window, and its row."""
    whole = {"window": (0.0, drive.run.duration)} | options
    run = simulate(drive, record=Record(rate=rate), limits=STARTING, **whole)
    return run, run.metrics.to_pylist()[0]


def swing(**values):
    """Two inertias on a coupling, one of which turns at first."""
    shafts = shaft("a", inertia=0.5, initial_speed=2.0) + shaft("b", inertia=0.3, initial_speed=0.0)
    return shafts + coupling("link", ["a", "b"], 3e5, **({"damping": 0.0} | values))


def periods(time, value):
    """Times between crossings of zero upward, each found to the second order of the frames' distance."""
    at = np.flatnonzero((value[:-1] < 0.0) & (value[1:] >= 0.0))
    crossing = time[at] - value[at] * (time[at + 1] - time[at]) / (value[at + 1] - value[at])
    return np.diff(crossing)


def assert_same_frames(one, other, channels=()):
    """Trajectories, bitwise, in some channels, or in all that the first holds."""
    for name in channels or one.channels():
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


def assert_alone_as_in_a_crowd(drives, channels=(), **options):
    """Each drive's trajectory bitwise the same in a run of its own; returns the run of all."""
    crowd = simulate(drives, **options)
    for v, drive in enumerate(drives):
        assert_same_frames(simulate(drive, **options)[0], crowd[v], channels)
    return crowd


def row(drive, **options):
    return simulate(drive, record=Record(variants="none"), **options).metrics.to_pylist()[0]


TIMING = """
[chain]
size = "06B"
links = 108
stiffness = 1.5e7
damping_ratio = 0.02
joint = { friction = 0.07 }

[[sprockets]]
name = "crank"
teeth = 19
center = [0.0, 0.0]
wrap = "cw"
prescribed = { speed = 209.44, ramp_time = 0.0 }

[[sprockets]]
name = "intake cam"
teeth = 38
center = [-0.062, 0.3026]
wrap = "cw"
inertia = 1.2e-3
load = { torque = 4.0 }

[[sprockets]]
name = "exhaust cam"
teeth = 38
center = [0.062, 0.3026]
wrap = "cw"
inertia = 1.2e-3
load = { torque = 4.0 }

[[guides]]
name = "blade"
arcs = [{ center = [-0.356744, 0.052224], radius = 0.30, from = 38.8807, to = -5.0461 }]
arm = "arm"

[[guides]]
name = "fixed guide"
arcs = [{ center = [0.647589, -0.036238], radius = 0.60, from = 173.5869, to = 152.5784 }]

[[arms]]
name = "arm"
pivot = [-0.04498, 0.00722]
mass = 0.12
center = [-0.07743, 0.13870]
inertia = 2.5e-3
stops = [-12.0, 12.0]

[[tensioners]]
name = "tensioner"
on = "arm"
at = [-0.09975, 0.21075]
direction = [0.95673, 0.29099]
kind = "hydraulic"
spring = { stiffness = 3500.0, preload = 90.0 }
plunger = { diameter = 0.016, mass = 0.033, gap = 5.0e-5, length = 0.007, eccentricity = 0.9 }
chamber = { volume = 1.0e-6 }
valve = { ball_radius = 0.003, seat_diameter = 0.0014, lift = 0.001, stiffness = 75.0, preload = 0.075 }
oil = { density = 800.0, viscosity = 8.0e-5, bulk_modulus = 8.0e8, air = 0.01, supply = 3.0e5, ambient = 1.0e5 }

[contact.sprocket]
law = "lankarani-nikravesh"
stiffness = 2.0e8
restitution = 0.2
profile = "iso606"
gap = "minimum"
impact_speed_floor = 0.01
friction = 0.05

[contact.guide]
law = "lankarani-nikravesh"
stiffness = 1.0e7
restitution = 0.3
impact_speed_floor = 0.01
friction = 0.1

[run]
duration = 0.1
step = 1.0e-6
sample_rate = 2000.0
"""
"""A timing drive with a sprung arm, its hydraulic tensioner, and a fixed curved guide."""


def timing(**changes):
    """The drive of `TIMING` with changes by path, "__" for the dots."""
    drive = loads_drive(TIMING)
    return drive.with_values({name.replace("__", "."): value for name, value in changes.items()}) if changes else drive
