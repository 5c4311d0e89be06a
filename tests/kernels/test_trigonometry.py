"""Sine and cosine of the kernels against the C library's, and the literals that they are made of."""

import ast
from pathlib import Path

import numpy as np
import pytest
import warp as wp
from own_kernels import kernel

from warpchain.kernels.number import sine_cosine
from warpchain.kernels.physics.body import pose_with_heading, turned_pose
from warpchain.kernels.structs import Pose

KERNELS = sorted((Path(__file__).resolve().parents[2] / "kernels").rglob("*.py"))


@kernel
def both(angle: wp.array[wp.float64], sine: wp.array[wp.float64], cosine: wp.array[wp.float64]):
    i = wp.tid()
    s, c = sine_cosine(angle[i])
    sine[i] = s
    cosine[i] = c


@kernel
def turn(start: wp.float64, angle: wp.array[wp.float64], out: wp.array[wp.vec2d]):
    i = wp.tid()
    turned = turned_pose(pose_with_heading(Pose(), wp.cos(start), wp.sin(start)), angle[i])
    out[i] = wp.vec2d(turned.cosine, turned.sine)


@pytest.mark.parametrize("largest", [0.8, 10.0, 1e4, 1.6e6])
def test_sine_and_cosine_are_exact_to_a_unit_of_the_last_place_of_one(largest):
    angle = np.random.default_rng(1).uniform(-largest, largest, 100_000)
    given = wp.array(angle, dtype=wp.float64, device="cpu")
    sine, cosine = wp.empty_like(given), wp.empty_like(given)
    wp.launch(both, len(angle), inputs=[given, sine, cosine], device="cpu")
    # two roundings of half a unit of one each, 1.1e-16; what the reduction leaves of pi/2 is below them up to k = 2^20
    np.testing.assert_allclose(sine.numpy(), np.sin(angle), rtol=0, atol=2.3e-16)
    np.testing.assert_allclose(cosine.numpy(), np.cos(angle), rtol=0, atol=2.3e-16)


def test_a_small_turn_is_exact_to_its_order():
    # the sine's next term is a^7 / 5040, the cosine's a^6 / 720: 1.4e-15 at a hundredth of a radian
    angle = np.linspace(-0.01, 0.01, 2001)
    out = wp.empty(len(angle), dtype=wp.vec2d, device="cpu")
    wp.launch(turn, len(angle), inputs=[0.7, wp.array(angle, dtype=wp.float64, device="cpu"), out], device="cpu")
    exact = np.stack([np.cos(0.7 + angle), np.sin(0.7 + angle)], axis=1)
    np.testing.assert_allclose(out.numpy(), exact, rtol=0, atol=0.01**6 / 720 + 4e-16)


@pytest.mark.parametrize("path", KERNELS, ids=lambda path: path.stem)
def test_no_quotient_of_literals_is_left_to_a_kernel(path):
    # Warp takes the literals of a function's body as float32 where they are operands
    tree = ast.parse(path.read_text())
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call) and ast.unparse(node.func) == "wp.static"]
    static = {id(inner) for call in calls for inner in ast.walk(call)}
    operations = [node for node in ast.walk(tree) if isinstance(node, ast.BinOp) and id(node) not in static]
    floats = [
        ast.unparse(node)
        for node in operations
        if all(isinstance(side, ast.Constant) and isinstance(side.value, float) for side in (node.left, node.right))
    ]
    assert not floats
