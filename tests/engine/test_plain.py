"""Plain drives have CPU kernels of their own, without arms, tensioners, profiles, led centers, rk4: the same bits."""

import numpy as np
import pytest
import warp as wp
from drives import example, timing, two_sprockets

from warpchain import simulate
from warpchain.engine.cpu import kernel_of
from warpchain.engine.pack import pack
from warpchain.kernels.cpu.relax import relax_kernel
from warpchain.kernels.cpu.serial import advance_kernel
from warpchain.results.schedule import Schedule

SHORT = Schedule(3e-6, 100, 50, 100, 0)
RK4 = two_sprockets(integrator="rk4", duration=0.002)
PLAIN = two_sprockets(duration=0.002)
LED = {"kind": "prescribed", "direction": [0.0, 1.0], "amplitude": 1e-4, "frequency": 30.0}


@pytest.mark.parametrize(
    ("drives", "settles_plainly", "steps_plainly"),
    [
        ([PLAIN], True, True),
        ([example("marine")], True, True),  # its guide is a straight bar
        ([RK4], True, False),  # settling knows no integrator
        ([timing()], False, False),
        ([example("engine")], True, True),  # so is its guide, and it has a mount
        ([PLAIN.with_values({"sprockets.driven.mount": LED})], True, False),
        ([PLAIN, RK4], True, False),
    ],
)
def test_plain_drives_have_kernels_of_their_own(drives, settles_plainly, steps_plainly):
    packed = pack(drives, [SHORT] * len(drives))
    form = wp.float64, 264
    assert kernel_of("relax", packed, "float64") is relax_kernel(*form, settles_plainly)
    assert kernel_of("advance", packed, "float64") is advance_kernel(*form, packed.frame, steps_plainly)


def test_a_plain_drive_takes_the_same_steps_beside_one_that_is_not():
    """Bitwise: beside another it settles and runs with the kernels that have everything."""
    alone = simulate(PLAIN, device="cpu")
    beside = simulate([PLAIN, timing(run__duration=1e-5)], device="cpu")
    row = beside.metrics.to_pylist()[0]
    assert alone.metrics.to_pylist()[0] == {name: row[name] for name in alone.metrics.column_names}
    for channel in ("position", "velocity", "tension"):
        np.testing.assert_array_equal(getattr(alone[0], channel), getattr(beside[0], channel))
