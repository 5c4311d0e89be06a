"""Drives that a motor speeds up, written with `warpchain new` and given a motor: an electric bicycle and a kart."""

from warpchain.drive import loads_drive

CONTACT = """
[contact.sprocket]
profile = "circular"
restitution = 0.3
restitution_means = "rebound"
friction = 0.06
impact_speed_floor = 0.02
roller = { youngs_modulus = 210e9, poissons_ratio = 0.3 }
partner = { youngs_modulus = 210e9, poissons_ratio = 0.3 }
"""

BICYCLE = f"""
[chain]
size = "081"
links = 98
stiffness = "estimate"
damping_ratio = 0.02
joint = {{ friction = 0.1 }}

[[sprockets]]
name = "driver"
teeth = 42
center = [0.0, 0.0]
wrap = "ccw"
shaft = "crank"

[[sprockets]]
name = "driven"
teeth = 16
center = [0.4349658373, 0.0]
wrap = "ccw"
mass = 0.08
inertia = 4.2e-5
shaft = "hub"

[[shafts]]
name = "crank"
inertia = 0.05
motor = {{ torque = 88.0, ramp_time = 0.1 }}

[[shafts]]
name = "hub"                  # wheel, bicycle and rider, 100 kg at 0.34 m, at 24 km/h
inertia = 11.5
initial_speed = 20.0
load = {{ torque = 2.0, quadratic = 0.012 }}
{CONTACT}
clearance = 5.1e-5
bush_stiffness = 6.4e7
width = 0.00307
reference_load = 150

[run]
duration = 0.5
step = "auto"
sample_rate = 2000
"""

KART = f"""
[chain]
size = "06B"
links = 106
stiffness = "estimate"
damping_ratio = 0.02
joint = {{ friction = 0.1 }}

[[sprockets]]
name = "driver"
teeth = 11
center = [0.0, 0.0]
wrap = "ccw"
shaft = "engine"

[[sprockets]]
name = "driven"
teeth = 70
center = [0.2984309057, 0.0]
wrap = "ccw"
mass = 1.0
inertia = 0.008
shaft = "axle"

[[shafts]]
name = "engine"
inertia = 0.003
motor = {{ table = {{ speed = [0.0, 200.0, 600.0, 1000.0, 1400.0], torque = [14.0, 18.0, 22.0, 16.0, 0.0] }} }}

[[shafts]]
name = "axle"                 # kart and driver, 170 kg at 0.14 m
inertia = 3.4
load = {{ torque = 5.0, quadratic = 0.0015 }}
{CONTACT}
clearance = 3.8e-5
bush_stiffness = 4.8e7
width = 0.00532
reference_load = 560

[run]
duration = 0.5
step = "auto"
sample_rate = 2000
"""


def bicycle(**values):
    """An electric bicycle that rolls at 20 rad/s of its hub as the motor comes on, with values by key paths."""
    return loads_drive(BICYCLE).with_values(values)


def kart(**values):
    """A kart that starts from rest, its motor's torque over speed, with values by key paths."""
    return loads_drive(KART).with_values(values)
