"""The block kernel on cooperative fibers: drives of several chains, all on one block."""

from itertools import product

import chains
import numpy as np
import pytest
import warp as wp
from blocks import (
    assert_steps_of_the_cpu,
    flat,
    light_stages,
    pack_for,
    run_blocks,
    shape_of,
    some_of,
    stages_of_two_chains,
    stages_rk4,
    unjoined,
    v6,
    ways,
)

from warpchain.engine.arrays import TABLE, rows_of
from warpchain.results.channels import frame_width
from warpchain.results.schedule import Schedule

KINDS = v6, stages_of_two_chains, light_stages, stages_rk4, unjoined
USUAL = [(v6, True, "float64"), (light_stages, False, "float64"), (stages_rk4, True, "float32")]


@pytest.mark.parametrize(**ways(*KINDS, usual=USUAL))
def test_block_kernel_takes_the_steps_of_the_cpu_kernel(fibers, drives, many, precision):
    assert_steps_of_the_cpu(drives, many, precision)
