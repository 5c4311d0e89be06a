"""A drive with a tensioner on its slider, against the slider's own spring, and its energy."""

import numpy as np
import pytest
from tensioner_rig import TEXT

from warpchain import Record, loads_drive, simulate

MOUNT = "stiffness = 2.0e3, damping = 300.0, preload = 200.0"
BARE = "stiffness = 0.0, damping = 0.0, preload = 0.0"
SPRING = """
[[tensioners]]
name = "plain"
on = "tensioner"
at = [0.038317, 0.18]
direction = [-1.0, 0.0]
kind = "spring"
spring = { stiffness = 2.0e3, preload = 200.0, damping = 300.0 }
"""


def test_a_spring_tensioner_is_the_slider_s_own_spring():
    plain = TEXT.split("\n[[tensioners]]")[0]
    assert MOUNT in plain
    texts = plain, plain.replace(MOUNT, BARE) + SPRING
    drives = [loads_drive(text).with_values({"run.settle": False}) for text in texts]
    record = Record(rate=1e4, channels=("position", "sprocket_center"))
    run = simulate(drives, duration=0.003, record=record, device="cpu")
    own, other = run[0], run[1]
    moved = np.abs(own.sprocket_center - own.sprocket_center[0]).max()
    assert moved > 1e-3
    # the same force on the slider, summed in another order
    assert other.sprocket_center == pytest.approx(own.sprocket_center, abs=1e-9 * moved)
    assert other.position == pytest.approx(own.position, abs=1e-9 * moved)


def test_oil_leaves_the_energy_balance_as_good_as_without():
    plain, oiled, _ = TEXT.split("\n[[tensioners]]")
    drives = [loads_drive(plain), loads_drive(f"{plain.replace(MOUNT, BARE)}\n[[tensioners]]{oiled}")]
    without, with_oil = simulate(drives, duration=0.03, device="cpu").metrics.to_pylist()
    assert with_oil["element.pressure_max"] > 5e5 > with_oil["element.pressure_min"]  # its valve closes and opens
    assert with_oil["element.oil_loss"] > 0.0
    # what contacts leave over, first order in the step, and 1e-3 of what the oil takes
    assert (
        abs(with_oil["energy_residual"]) < 2.0 * abs(without["energy_residual"]) + 1e-3 * with_oil["element.oil_loss"]
    )
