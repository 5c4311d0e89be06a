"""Drives that tests share, as data and as values to be spoiled, and what errors they make."""

import tomllib

import pytest

from warpchain import Record, loads_drive, simulate
from warpchain.drive import Drive
from warpchain.drive.examples import FOLDER
from warpchain.errors import DriveError

MARINE = FOLDER / "marine.toml"
STEEL = {"youngs_modulus": 2.1e11, "poissons_ratio": 0.3}
POSITIVE = "must be a positive number"
NOT_NEGATIVE = "must be a number of at least 0"


def marine_values():
    """The marine drive as plain values."""
    return tomllib.loads(MARINE.read_text())


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


def row(drive, **options):
    return simulate(drive, record=Record(variants="none"), **options).metrics.to_pylist()[0]
