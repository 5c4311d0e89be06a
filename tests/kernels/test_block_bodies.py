"""The block kernel against the CPU kernel on cooperative fibers: bodies that move, arms, tensioners, rk4."""

import pytest
from blocks import (
    arms,
    arms_rk4,
    assert_steps_of_the_cpu,
    bending_rk4,
    fed,
    folded,
    folded_light,
    gear_changes,
    gear_changes_rk4,
    led,
    led_light,
    led_rk4,
    light_trains,
    moving_sprockets,
    pushed_slider,
    rk4,
    rubbing_on_moving_sprockets,
    rubbing_rk4,
    segments,
    segments_rk4,
    swung,
    swung_light,
    swung_rk4,
    swung_trains,
    trains,
    trains_rk4,
    valves,
    valves_rk4,
    ways,
)

USUAL = [
    (moving_sprockets, False, "float64"),
    (arms_rk4, True, "float64"),
    (bending_rk4, True, "float32"),
    (swung_light, True, "float32"),
    (led_light, False, "float32"),
    (trains, True, "float64"),
    (gear_changes, True, "float64"),
    (valves, False, "float32"),
]
LONG = [
    (arms, False, "float64"),
    (rubbing_on_moving_sprockets, False, "float32"),
    (pushed_slider, True, "float32"),
    (rubbing_rk4, False, "float32"),
    (rk4, True, "float64"),
    (swung, False, "float64"),
    (swung_rk4, True, "float64"),
    (swung_trains, True, "float64"),
    (led, True, "float64"),
    (led_rk4, True, "float64"),
    (trains, False, "float32"),
    (gear_changes, False, "float32"),
    (trains_rk4, True, "float32"),
    (gear_changes_rk4, True, "float32"),
    (light_trains, False, "float32"),
    (valves, True, "float64"),
    (valves_rk4, False, "float64"),
    (fed, False, "float64"),
    (fed, True, "float32"),
    (segments, True, "float64"),
    (segments_rk4, True, "float32"),
    (folded, False, "float64"),
    (folded_light, False, "float32"),
]


@pytest.mark.parametrize(**ways(USUAL, LONG))
def test_block_kernel_takes_the_steps_of_the_cpu_kernel(fibers, drives, many, precision):
    assert_steps_of_the_cpu(drives, many, precision)
