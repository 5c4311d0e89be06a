"""Seating angles beyond their limit."""

import argparse
import math
import warnings

from common.cases import case

from warpchain import Drive, Record, loads_drive, simulate
from warpchain.drive.tooth_shape import default_seat_angle, releasing_seat_angle

PITCH = 0.05
OFFSETS = (3.0, 0.0, -2.0, -5.0, -8.0)


def drive(teeth: int, seat_angle: float) -> Drive:
    """Two equal sprockets 20 pitches apart, slow, without gravity: the tight strand should pull load / R."""
    return loads_drive(
        f"""
        [chain]
        pitch = {PITCH}
        links = {teeth + 40}
        roller_mass = 1.0
        stiffness = 5e7
        damping = 2e3
        roller_radius = 0.015
        [[sprockets]]
        name = "driver"
        teeth = {teeth}
        center = [0.0, 0.0]
        wrap = "ccw"
        prescribed = {{ speed = {40.0 / teeth} }}
        [[sprockets]]
        name = "driven"
        teeth = {teeth}
        center = [{20.002 * PITCH}, 0.0]
        wrap = "ccw"
        inertia = 2.0
        load = {{ torque = {5.0 * teeth}, viscous = 10.0 }}
        [contact.sprocket]
        seat_angle = {seat_angle}
        clearance = 1e-4
        restitution = 0.5
        impact_speed_floor = 0.02
        stiffness = 2e8
        [run]
        duration = 1.0
        step = 5e-6
        sample_rate = 1000.0
        gravity = [0.0, 0.0]
        """
    )


@case()
def seat_angle(asked: argparse.Namespace) -> None:
    """Seating angles on both sides of the limit of `warpchain.drive.teeth`: slack tension and moments.

    python scripts/figures.py seat-angle
    """
    warnings.simplefilter("ignore")
    cases = []
    for teeth in (9, 12, 16, 20, 25, 40):
        radius = PITCH / (2.0 * math.sin(math.pi / teeth))
        limit = math.degrees(releasing_seat_angle(radius, PITCH))
        angles = [limit + offset for offset in OFFSETS] + [math.degrees(default_seat_angle(teeth, radius, PITCH))]
        cases += [(teeth, limit, angle) for angle in angles]
    run = simulate([drive(teeth, angle) for teeth, _, angle in cases], record=Record("none"), window=(0.3, 1.0))
    print("teeth  limit [deg]  seat angle [deg]  driver moment [N m]  driven moment [N m]  slack strand [N]")
    for (teeth, limit, angle), row in zip(cases, run.metrics.to_pylist(), strict=True):
        moments = f"{row['driver.moment_mean']:20.1f} {row['driven.moment_mean']:20.1f}"
        print(f"{teeth:5d} {limit:12.1f} {angle:17.1f} {moments} {row['driver->driven.tension_mean']:17.0f}")
