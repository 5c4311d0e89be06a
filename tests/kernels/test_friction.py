"""The law of dry friction: a block on a plane against closed forms."""

import numpy as np
import pytest
import warp as wp
from own_kernels import kernel

from warpchain.kernels.physics.friction import DAMPER, SPRING, bristle_friction, friction_coefficient
from warpchain.kernels.structs import types

KINDS = types(wp.float64)


@kernel
def slide(law: KINDS.Friction, pull: wp.float64, speed: wp.float64, h: wp.float64, out: wp.array[wp.vec3d]):
    """A block of 1 kg pressed on a plane by 10 N, by leapfrog: place, speed, friction's work after each step."""
    x = wp.float64(0.0)
    v = speed
    held = wp.float64(0.0)
    work = wp.float64(0.0)
    for i in range(out.shape[0]):
        most = friction_coefficient(wp.abs(v), law) * wp.float64(10.0)
        drag, held = bristle_friction(most, v, held, wp.float64(SPRING) / h, wp.float64(DAMPER) / h, wp.float64(1.0))
        before = v
        v += h * (pull - drag)
        x += h * v
        work += h * drag * wp.float64(0.5) * (before + v)
        out[i] = wp.vec3d(x, v, work)


def slides(dynamic, static=None, pull=0.0, speed=1.0, h=1e-3, steps=2000):
    law = KINDS.Friction()
    law.mu_dynamic, law.mu_static, law.stribeck_speed = dynamic, static or dynamic, 0.1
    out = wp.zeros(steps, dtype=wp.vec3d, device="cpu")
    wp.launch(slide, dim=1, inputs=[law, pull, speed, h, out], device="cpu")
    return out.numpy()


def test_a_block_slows_down_evenly_and_stops():
    x, v, work = slides(0.1).T  # deceleration mu N / m = 1 m/s^2: it stops after 1 s, 1000 steps
    # the bristle is stretched within the first step and slack within the last few, of speeds 1 / (s + t) times mu N h
    assert v[:990] == pytest.approx(1.0 - 1e-3 * np.arange(1, 991), abs=1e-12)
    assert np.abs(v[1010:]).max() < 2e-3 and abs(v[-1]) < 1e-12
    # mu N times the way, to round-off, while it slides
    before = np.concatenate([[1.0], v[:989]])
    assert work[989] == pytest.approx(0.5e-3 * (before + v[:990]).sum(), rel=1e-12)


@pytest.mark.parametrize("h", [1e-2, 1e-3, 1e-5])
def test_a_block_that_is_pulled_by_less_than_friction_holds_does_not_move(h):
    # it gives way by what stretches the bristle to the pull, pull h^2 / (s m), and stays there
    x, v, _ = slides(0.1, pull=0.5, speed=0.0, h=h, steps=1_000_000).T
    assert x[200] == pytest.approx(0.5 * h * h / SPRING, rel=1e-9)
    assert x[-1] == x[200] and abs(v[-1]) < 1e-15 * h


def test_a_bristle_never_chatters():
    # s + 2 t is well below 4, where leapfrog's oscillator with a damper taken half a step late becomes unstable
    assert SPRING + 2.0 * DAMPER < 4.0
    v = slides(1e6, speed=1.0, steps=100)[:, 1]  # sticks at once: decays, by more than a half each two steps
    assert np.abs(v[20:]).max() < 2e-3


def test_a_block_that_is_pulled_by_more_slides():
    assert slides(0.1, pull=1.5, speed=0.0)[-1, 1] == pytest.approx(0.5 * 2.0, rel=5e-3)  # a few steps to break loose


def test_static_friction_falls_to_the_dynamic_one_with_the_square_of_the_speed():
    v = slides(0.1, 0.2, speed=0.3, h=1e-6, steps=2)[:, 1]
    mu = 0.1 + 0.1 * np.exp(-((0.3 / 0.1) ** 2))
    assert (0.3 - v[0]) / 1e-6 == pytest.approx(10.0 * mu, rel=1e-9)
