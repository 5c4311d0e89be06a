"""The block kernel against the CPU kernel on cooperative fibers: bodies that move, arms, tensioners, rk4."""

import pytest
from blocks import (
    ARMS_RK4,
    OF_THREE_RK4,
    OF_TWO_RK4,
    PUSHED,
    SWUNG,
    SWUNG_LIGHT,
    TRAINS,
    TRAINS_RK4,
    arms,
    assert_steps_of_the_cpu,
    bending_rk4,
    fed,
    folded,
    led,
    moving_sprockets,
    pushed_slider,
    rubbing_rk4,
    swung,
    swung_trains,
    together,
    ways,
)

USUAL = [
    ((swung, led, arms, fed), False, "float64"),
    ((*SWUNG, *SWUNG_LIGHT, arms, fed), False, "float32"),
    (TRAINS, True, "float64"),
    (TRAINS, False, "float32"),
    (ARMS_RK4, True, "float64"),
    (OF_THREE_RK4, True, "float32"),
]
LONG = [
    (OF_TWO_RK4, True, "float32"),
    ((folded, swung_trains), False, "float64"),
    (PUSHED, False, "float64"),
    ((*PUSHED, *TRAINS), True, "float32"),
    (TRAINS_RK4, False, "float64"),
    ((bending_rk4, rubbing_rk4), False, "float32"),
]


@pytest.mark.parametrize(**together(USUAL, LONG))
def test_block_kernel_takes_the_steps_of_the_cpu_kernel(fibers, drives, many, precision, family):
    assert_steps_of_the_cpu(drives, many, precision, family)


ALL = (*SWUNG, swung_trains, *SWUNG_LIGHT, arms, fed, *PUSHED, *TRAINS, *OF_THREE_RK4, *OF_TWO_RK4)


ALONE = ways(
    ALL,
    [(moving_sprockets, False, "float64")],
    [(arms, False, "float64"), (pushed_slider, True, "float32")],
)


@pytest.mark.parametrize(**ALONE)
def test_a_kernel_of_its_own_takes_the_steps_of_the_cpu_kernel(fibers, drives, many, precision):
    assert_steps_of_the_cpu(drives, many, precision)
