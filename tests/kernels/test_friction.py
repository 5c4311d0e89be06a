"""The law of dry friction: a block on a plane against closed forms."""

import numpy as np
import pytest
import warp as wp

from warpchain.kernels.physics.friction import coefficient, friction
from warpchain.kernels.structs import types

KINDS = types(wp.float64)


@wp.kernel(enable_backward=False)
def slide(law: KINDS.Friction, pull: wp.float64, speed: wp.float64, h: wp.float64, out: wp.array[wp.float64]):
    """A block of 1 kg pressed on a plane by 10 N: its speed after each step of h [s]."""
    v = speed
    for i in range(out.shape[0]):
        f = friction(coefficient(wp.abs(v), law), wp.float64(10.0), wp.abs(v), wp.float64(0.5) / h)
        v += h * (pull - wp.sign(v) * f)
        out[i] = v


def speeds(dynamic, static=None, pull=0.0, speed=1.0, h=1e-3, steps=2000):
    law = KINDS.Friction()
    law.mu_dynamic, law.mu_static, law.stribeck_speed = dynamic, static or dynamic, 0.1
    out = wp.zeros(steps, dtype=wp.float64, device="cpu")
    wp.launch(slide, dim=1, inputs=[law, pull, speed, h, out], device="cpu")
    return out.numpy()


def test_a_block_slows_down_evenly_and_stops_without_reversing():
    v = speeds(0.1)  # deceleration mu N / m = 1 m/s^2: it stops after 1 s, 1000 steps
    assert v[:990] == pytest.approx(1.0 - 1e-3 * np.arange(1, 991), abs=1e-12)
    assert (v >= 0.0).all() and v[-1] < 1e-12


def test_a_block_that_is_pulled_by_less_than_friction_holds_rests():
    # it creeps at the speed whose half a step takes away: 0.5 v / h = pull, v = 2 h pull / m
    assert speeds(0.1, pull=0.5, speed=0.0)[-1] == pytest.approx(2e-3 * 0.5, rel=1e-9)
    assert speeds(0.1, pull=0.5, speed=0.0, h=1e-5, steps=5000)[-1] == pytest.approx(2e-5 * 0.5, rel=1e-9)


def test_a_block_that_is_pulled_by_more_slides():
    assert speeds(0.1, pull=1.5, speed=0.0)[-1] == pytest.approx(0.5 * 2.0, rel=5e-3)  # a few steps to break loose


def test_static_friction_falls_to_the_dynamic_one_with_the_square_of_the_speed():
    v = speeds(0.1, 0.2, speed=0.3, h=1e-6, steps=2)
    mu = 0.1 + 0.1 * np.exp(-((0.3 / 0.1) ** 2))
    assert (0.3 - v[0]) / 1e-6 == pytest.approx(10.0 * mu, rel=1e-9)
