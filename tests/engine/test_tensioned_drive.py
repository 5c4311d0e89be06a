"""A drive with a tensioner on its slider, against the slider's own spring, and its energy."""

import numpy as np
import pytest
from tensioner_rig import engine

from warpchain import Record, simulate

BARE = {f"sprockets.tensioner.mount.{name}": 0.0 for name in ("stiffness", "damping", "preload")}
"""The engine's slider without the spring of its own."""


def test_a_spring_tensioner_is_the_slider_s_own_spring():
    plain = engine().with_values({"tensioners": [], "run.settle": False})
    spring = {name: getattr(plain.sprockets[1].mount, name) for name in ("stiffness", "preload", "damping")}
    assert min(spring.values()) > 0.0
    drives = [
        plain,
        plain.with_values(BARE | {"tensioners": [engine().tensioners[1].model_dump() | {"spring": spring}]}),
    ]
    record = Record(rate=1e4, channels=("position", "sprocket_center"))
    run = simulate(drives, duration=0.003, record=record, device="cpu")
    own, other = run[0], run[1]
    moved = np.abs(own.sprocket_center - own.sprocket_center[0]).max()
    assert moved > 1e-3
    # the same force on the slider, summed in another order
    assert other.sprocket_center == pytest.approx(own.sprocket_center, abs=1e-9 * moved)
    assert other.position == pytest.approx(own.position, abs=1e-9 * moved)


def test_oil_leaves_the_energy_balance_as_good_as_without():
    oiled = engine()
    drives = [oiled.with_values({"tensioners": []}), oiled.with_values(BARE | {"tensioners": [oiled.tensioners[0]]})]
    without, with_oil = simulate(drives, duration=0.03, step=5e-7, device="cpu").metrics.to_pylist()
    assert with_oil["element.pressure_max"] > 5e5 > with_oil["element.pressure_min"]  # its valve closes and opens
    assert with_oil["element.oil_loss"] > 0.0
    # what contacts leave over, first order in the step, and 1e-3 of what the oil takes
    assert (
        abs(with_oil["energy_residual"]) < 2.0 * abs(without["energy_residual"]) + 1e-3 * with_oil["element.oil_loss"]
    )
