"""Seating angles beyond their limit."""

import argparse
import math
import warnings
from collections.abc import Iterator

from common.cases import Line, case
from common.drives import equal, pair

from warpchain import Drive, Record, simulate
from warpchain.drive.tooth_shape import default_seat_angle, releasing_seat_angle

PITCH = 0.05
OFFSETS = (3.0, 0.0, -2.0, -5.0, -8.0)


def drive(teeth: int, seat_angle: float) -> Drive:
    """Two equal sprockets 20 pitches apart, slow, without gravity: the tight strand should pull load / R."""
    return pair(
        equal(teeth, teeth + 40, PITCH, 0.002 * PITCH)
        | {
            "sprockets.driver.prescribed.speed": 40.0 / teeth,
            "sprockets.driven.load": {"torque": 5.0 * teeth, "viscous": 10.0},
            "contact.sprocket.seat_angle": seat_angle,
            "run": {"duration": 1.0, "step": 5e-6, "sample_rate": 1000.0, "gravity": [0.0, 0.0]},
        }
    )


@case()
def seat_angle(asked: argparse.Namespace) -> Iterator[Line]:
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
    yield ("teeth", "limit [deg]", "seat angle [deg]", "driver [N m]", "driven [N m]", "slack strand [N]")
    for (teeth, limit, angle), row in zip(cases, run.metrics.to_pylist(), strict=True):
        moments = (f"{row[f'{name}.moment_mean']:.1f}" for name in ("driver", "driven"))
        yield (teeth, f"{limit:.1f}", f"{angle:.1f}", *moments, f"{row['driver->driven.tension_mean']:.0f}")
