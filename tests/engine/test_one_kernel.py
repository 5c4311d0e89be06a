"""One CPU kernel steps drives of every kind with any channels, and one settles them; several chains have another."""

import numpy as np
import pytest
from drives import example, timing, two_sprockets

from warpchain import Record, simulate
from warpchain.engine.cpu import cpu_kernel
from warpchain.engine.pack import pack
from warpchain.results.channels import CHANNEL_NAMES
from warpchain.results.schedule import Schedule

SHORT = Schedule(3e-6, 100, 50, 100, 0)
PAIR = two_sprockets(duration=0.002)
LED = {"kind": "prescribed", "direction": [0.0, 1.0], "amplitude": 1e-4, "frequency": 30.0}
KINDS = {
    "a pair": PAIR,
    "rk4": two_sprockets(integrator="rk4", duration=0.002),
    "a straight guide": example("marine"),
    "arms and a tensioner": timing(),
    "a led center": PAIR.with_values({"sprockets.driven.mount": LED}),
}


@pytest.mark.parametrize("name", ["advance", "relax"])
def test_all_kinds_of_drives_share_a_kernel(name):
    kernels = {cpu_kernel(name, pack([drive], [SHORT]), "float64") for drive in KINDS.values()}
    assert len(kernels) == 1


def test_a_run_has_the_same_bits_whatever_is_recorded_and_beside_another_kind():
    alone = simulate(PAIR, device="cpu")
    beside = simulate([PAIR, timing(run__duration=1e-5)], device="cpu", record=Record(channels=CHANNEL_NAMES))
    row = beside.metrics.to_pylist()[0]
    assert alone.metrics.to_pylist()[0] == {name: row[name] for name in alone.metrics.column_names}
    for channel in ("position", "velocity", "tension"):
        np.testing.assert_array_equal(getattr(alone[0], channel), getattr(beside[0], channel))
