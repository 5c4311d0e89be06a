"""A moment in the joints, made as the recipe in CONTRIBUTING.md says, against its closed form joint by joint."""

import pytest
from drives import two_sprockets
from grown import grown, recipe, run_in

from warpchain import dumps_drive

SEALED = """
import sys
import numpy as np
from warpchain import Record, load_drive, simulate
from warpchain.results.channels import NAMES

drive = load_drive(sys.argv[1]).with_values({"chain.joint": {"friction": 0.1, "pin_radius": 0.0075, "seal": 0.5}})
run = simulate(drive, duration=0.005, device="cpu", window=(0.0, 0.005), record=Record(rate=20000.0, channels=NAMES))
one = run[0]
d, w = (np.roll(values, -1, axis=1) - values for values in (one.position, one.velocity))
turning = (d[..., 0] * w[..., 1] - d[..., 1] * w[..., 0]) / (d * d).sum(axis=2)
rate = np.abs(turning - np.roll(turning, 1, axis=1))
pressed = np.maximum(np.abs(one.tension), np.abs(np.roll(one.tension, 1, axis=1)))
moment = 0.1 * 4 / np.pi * 0.0075 * pressed + 0.5
power = one.joint_friction_power
# whatever the bristle holds, its damper slides from twice the moment on; it is never more
slides = 0.5 * 0.6 * 1.0 * 0.05**2 / 6 * rate / run.info.step > 2.0 * moment
assert slides.any() and not slides.all()
# rk4 has positions, velocities and forces of the frame's instant: round-off of differences of positions
np.testing.assert_allclose(power[slides], (moment * rate)[slides], rtol=1e-8, atol=1e-9)
assert (np.abs(power) <= moment * rate * (1.0 + 1e-8) + 1e-9).all()
assert abs(run.metrics["energy_residual_relative"][0].as_py()) < 1e-5
"""


@pytest.mark.long
def test_the_recipe_of_a_moment_in_the_joints(tmp_path):
    changes = recipe("A new moment in the joints")
    paths = [
        "kernels/physics/friction.py",
        "kernels/structs.py",
        "warpchain/drive/chain.py",
        "warpchain/engine/fill.py",
    ]
    assert [path for path, _, _ in changes] == paths
    (tmp_path / "drive.toml").write_text(dumps_drive(two_sprockets(integrator="rk4", settle="false")))
    run_in(grown(tmp_path, changes), SEALED, tmp_path / "drive.toml")
