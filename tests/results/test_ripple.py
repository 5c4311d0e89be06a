"""Ripples and changes that a drive's own motions, loads, valves and tables cause, told from a start that swings."""

import math

import numpy as np
import pytest
from drives import example, two_sprockets

from warpchain import simulate
from warpchain.model import single_chain
from warpchain.results.judgement import has_table_change
from warpchain.results.ripple import slowest_ripple_periods

FOUR = [50.0 + 20.0 * math.cos(4.0 * math.tau * k / 720) for k in range(721)]
ANGLES = [math.tau * k / 720 for k in range(721)]
VALVES = {
    "name": "valves",
    "on": "driven",
    "phases": (0.0, 90.0, 180.0, 270.0),
    "mass": 0.1,
    "spring": {"preload": 100.0},
    "profile": {"lift": 0.005, "rise": 60.0, "fall": 60.0},
}


@pytest.mark.parametrize(
    ("changes", "periods"),
    [
        ({}, 0.0),
        ({"sprockets.driven.load.harmonics": ({"order": 0.5, "amplitude": 1.0},)}, 1.5),
        ({"sprockets.driven.load.harmonics": ({"order": 0.5, "amplitude": 0.0},)}, 0.0),
        ({"sprockets.driven.load.harmonics": ({"order": 0.5, "amplitude": 1.0, "shaft": "driver"},)}, 2.0),
        ({"sprockets.driven.load.table": {"angle": ANGLES, "torque": [*FOUR[:-1], FOUR[0]]}}, 12.0),  # not one a turn
        ({"sprockets.driven.load.table": {"angle": (0.0, math.tau), "torque": (5.0, 5.0)}}, 0.0),
        ({"sprockets.driven.load.table": {"angle": (0.0, 3.0, 2.0 * math.tau), "torque": (1.0, 5.0, 1.0)}}, 1.5),
        ({"sprockets.driven.load.table": {"time": (0.0, 0.1), "torque": (1.0, 5.0)}}, 0.0),
        ({"valves": (VALVES,)}, 12.0),
        ({"valves": (VALVES | {"phases": (0.0, 90.0)},)}, 3.0),
        (
            {
                "sprockets.driver.mount": {
                    "kind": "prescribed",
                    "direction": (1, 0),
                    "amplitude": 1e-6,
                    "frequency": 10.0,
                }
            },
            5.0,
        ),
    ],
)
def test_periods_of_the_slowest_ripple(changes, periods):
    drive = two_sprockets().with_values(changes)
    assert slowest_ripple_periods(single_chain(drive), np.array([4.0, 3.0]), 0.5) == pytest.approx(periods)


def test_a_drive_whose_ripple_was_asked_for_can_still_be_changed():
    load = {"sprockets.driven.load.table": {"angle": ANGLES, "torque": [*FOUR[:-1], FOUR[0]]}, "valves": (VALVES,)}
    drive = two_sprockets().with_values(load)
    assert slowest_ripple_periods(single_chain(drive), np.array([4.0, 3.0]), 0.5) > 0.0
    assert drive.with_values({"run.phase": 0.1, "valves.valves.phase": 1.0}).valves[0].slowest_order == 4.0


def test_shafts_and_their_motors_count():
    drive = example("conveyor").with_values({"shafts.drum.load.harmonics": ({"order": 1.0, "amplitude": 5.0},)})
    ratio = drive.sprockets[0].teeth / drive.sprockets[1].teeth
    assert slowest_ripple_periods(single_chain(drive), np.array([4.0, 4.0 * ratio]), 0.5) == pytest.approx(4.0 * ratio)


@pytest.mark.parametrize(
    ("changes", "seen"),
    [
        ({}, False),
        ({"sprockets.driven.load.table": {"time": (0.0, 0.1, 0.3), "torque": (1.0, 5.0, 5.0)}}, False),
        ({"sprockets.driven.load.table": {"time": (0.0, 0.12, 0.3), "torque": (1.0, 5.0, 5.0)}}, True),
        ({"sprockets.driven.load.table": {"time": (0.0, 0.19, 0.21), "torque": (5.0, 5.0, 1.0)}}, True),
        ({"sprockets.driven.load.table": {"time": (0.0, 0.2, 0.21), "torque": (5.0, 5.0, 1.0)}}, False),
        ({"sprockets.driver.prescribed": {"table": {"time": (0.0, 1.0), "speed": (1.0, 2.0)}}}, True),
        ({"sprockets.driver.mount": {"kind": "prescribed", "table": {"time": (0.0, 0.15), "x": (0.0, 1e-6)}}}, True),
    ],
)
def test_what_a_table_over_time_changes_within_a_window(changes, seen):
    assert has_table_change(two_sprockets().with_values(changes), 0.1, 0.2) == seen


def test_gear_changes_are_seen():
    drive = example("motorcycle_drivetrain")
    times = next(coupling.ratios for coupling in drive.couplings if coupling.ratios).time
    assert has_table_change(drive, times[1] - 0.01, times[1] + 0.01)
    assert not has_table_change(drive, 9.0, 9.1)


def test_a_load_that_falls_within_the_window_is_no_start_that_swings():
    drive = example("engine")
    load = {"sprockets.intake cam.load.table": {"time": (0.0, 0.05, 0.06), "torque": (8.0, 8.0, 0.0)}}
    run = simulate([drive, drive.with_values(load)], duration=0.08, window=(0.04, 0.08))
    falling = run.metrics.to_pylist()[1]
    assert abs(falling["tension_drift"]) > 0.07 * falling["tension_mean"]
    assert "still swings" not in falling["reason"]
