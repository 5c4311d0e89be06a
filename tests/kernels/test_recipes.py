"""Recipes of CONTRIBUTING.md: a law, a moment in the joints, a force on links, an integrator, all at once on blocks."""

import re

import numpy as np
import pytest
from drives import example, two_sprockets
from grown import CONTRIBUTING, followed, grown, recipe, run_in

from warpchain import dumps_drive

TITLES = [line.removeprefix("## ") for line in CONTRIBUTING.read_text().splitlines() if line.startswith("## A new ")]
LIGHTLY = """
import warp

warp.config.optimization_level = 1
warp.config.cpu_compiler_flags = "-march=native"
"""
"""Has the CPU's compiler do little for kernels, in half of the time: a recipe has its own, and few steps are taken."""
ON_FIBERS = """
import sys
import warp as wp
from blocks import assert_steps_of_the_cpu
from warpchain import load_drive

wp.config.enable_cpu_blocks = True
new = {"contact.sprocket.law": "anagnostopoulos", "contact.sprocket.restitution_means": "rebound", "run.step": 1e-5}
new |= {"chain.joint": {"friction": 0.1, "pin_radius": 0.02, "seal": 0.5}, "run.integrator": "heun3"}
new |= {"chain.pull_stiffness": 1e6}
assert_steps_of_the_cpu(lambda: [load_drive(path).with_values(new) for path in sys.argv[2:]], True, sys.argv[1])
"""
DRIVE = """
from drives import two_sprockets
from warpchain import loads_drive, dumps_drive, simulate

law = {"contact.sprocket.law": "anagnostopoulos", "contact.sprocket.restitution_means": "rebound"}
drive = loads_drive(dumps_drive(two_sprockets(duration=0.005, settle="false").with_values(law)))
print(drive.contact.sprocket.law, simulate(drive, device="cpu")[0].tension.max() > 0.0)
"""
SEALED = """
import sys
import numpy as np
from warpchain import Record, load_drive, simulate
from warpchain.results.channels import CHANNEL_NAMES

mu = float(sys.argv[2])
drive = load_drive(sys.argv[1]).with_values({"chain.joint": {"friction": mu, "pin_radius": 0.0075, "seal": 0.5}})
record = Record(rate=20000.0, channels=CHANNEL_NAMES)
run = simulate(drive, duration=0.005, device="cpu", window=(0.0, 0.005), record=record)
one = run[0]
d, w = (np.roll(values, -1, axis=1) - values for values in (one.position, one.velocity))
turning = (d[..., 0] * w[..., 1] - d[..., 1] * w[..., 0]) / (d * d).sum(axis=2)
rate = np.abs(turning - np.roll(turning, 1, axis=1))
pressed = np.maximum(np.abs(one.tension), np.abs(np.roll(one.tension, 1, axis=1)))
moment = mu * 4 / np.pi * 0.0075 * pressed + 0.5
power = one.joint_friction_power
# whatever the bristle holds, its damper slides from twice the moment on; it is never more
inertia = 0.6 * 1.0 * 0.05**2 / 6
stiffness = min(0.8 * 12.0 * drive.chain.stiffness * 0.0075**2, 0.2 * inertia / run.info.step**2)
slides = 0.5 * np.sqrt(stiffness * inertia / 0.2) * rate > 2.0 * moment
assert slides.any() and not slides.all()
# rk4 has positions, velocities and forces of the frame's instant: round-off of differences of positions
np.testing.assert_allclose(power[slides], (moment * rate)[slides], rtol=1e-8, atol=1e-9)
assert (np.abs(power) <= moment * rate * (1.0 + 1e-8) + 1e-9).all()
(row,) = run.metrics.to_pylist()
assert row["joints.friction"] > 0.0 and abs(row["energy_residual_relative"]) < 1e-5
# steps in which the largest moment bends a joint by a tooth's angle
bend, most = 2.0 * np.pi / 20 * 0.05**2 / 6.0, mu * 4 / np.pi * 0.0075 * row["tension_q999"] + 0.5
assert np.isclose(row["joints.resolution"], np.sqrt(bend / most) / run.info.step)
"""
PULLED = """
import sys
import numpy as np
from warpchain import load_drive, modes, simulate
from warpchain.assembly.statics import at_rest, at_work
from warpchain.assembly.timestep import step_limit
from warpchain.model import Model

base = load_drive(sys.argv[1])
new = base.with_values({"chain.stiffness": 3e7, "chain.pull_stiffness": 2e7})
old, stiff = base.with_values({"chain.stiffness": 3e7}), base.with_values({"chain.stiffness": 5e7})
assert step_limit(new) == step_limit(stiff)
for steady in (at_rest, at_work):  # links that are all pulled: of a chain as stiff as both together, and not of one
    pulled, one_as_stiff, one = (steady(Model(drive).chain).tension for drive in (new, stiff, old))
    np.testing.assert_allclose(pulled, one_as_stiff, rtol=1e-6)
    assert pulled.min() > 1.2 * one.min() > 0.0
for speed in (0.0, 20.0):  # by the kernel's forces
    one, other = (modes(drive, 6, speed).frequency for drive in (new, stiff))
    np.testing.assert_allclose(one, other, rtol=1e-6)
loose = new.with_values({"sprockets.driven.center": [0.9999, 0.0], "chain.outer": {"stiffness": 4e7}})
run = simulate(loose, device="cpu")
assert run[0].tension.min() < 0.0 < run[0].tension.max()
assert abs(run.metrics["energy_residual_relative"][0].as_py()) < 1e-5
"""


def passed(folder, *words):
    """The number of tests that pass in a copy; none fails."""
    printed = run_in(folder, "-m pytest -q -p no:cacheprovider --rootdir .", *words)
    assert "failed" not in printed
    return int(re.search(r"(\d+) passed", printed).group(1))


@pytest.mark.long
def test_the_recipe_of_a_law(tmp_path):
    paths = ["kernels/physics/impact.py", "warpchain/drive/laws.py", "tests/drive/test_laws.py"]
    folder = followed(tmp_path, "A new contact law", paths)
    assert run_in(folder, LIGHTLY + DRIVE).split()[-2:] == ["anagnostopoulos", "True"]
    # its rebound against the closed form, also as what it is asked for, and the energy balance of a drive
    assert passed(folder, "-k", "anagnostopoulos and not cuda", "tests/drive/test_laws.py") == 10


@pytest.mark.long
def test_the_recipe_of_an_integrator(tmp_path):
    """Its order of convergence."""
    paths = ["kernels/integrate.py", "warpchain/drive/run_settings.py", "tests/kernels/test_chain_physics.py"]
    folder = followed(tmp_path, "A new integrator", paths)
    assert passed(folder, "-k", "order_of_convergence and heun3", "tests/kernels/test_chain_physics.py") == 1


@pytest.mark.long
def test_the_recipe_of_a_moment_in_the_joints(tmp_path):
    """Against its closed form, joint by joint, beside friction and without any."""
    paths = ["kernels/physics/friction.py", "kernels/structs.py", "warpchain/drive/chain.py"]
    paths += ["warpchain/drive/chain.py", "warpchain/engine/struct_rows.py", "warpchain/results/step_resolution.py"]
    (tmp_path / "drive.toml").write_text(dumps_drive(two_sprockets(integrator="rk4", settle="false")))
    folder = followed(tmp_path / "tree", "A new moment in the joints", paths)
    for friction in (0.1, 0.0):
        run_in(folder, LIGHTLY + SEALED, tmp_path / "drive.toml", friction)


@pytest.mark.long
def test_the_recipe_of_a_force_on_links(tmp_path):
    """Runs, `check`, modes and the step's limit follow it; where links are pushed the energy balance closes."""
    paths = ["kernels/physics/link.py"] * 4 + ["kernels/structs.py", "warpchain/drive/chain.py"]
    paths += [f"warpchain/{name}.py" for name in ("engine/struct_rows", "assembly/potential", "assembly/timestep")]
    taut = two_sprockets(span=20.02, step=2e-6, duration=0.005, torque=100.0)
    (tmp_path / "drive.toml").write_text(dumps_drive(taut))
    folder = followed(tmp_path / "tree", "A new force on links", paths)
    run_in(folder, LIGHTLY + PULLED, tmp_path / "drive.toml")


@pytest.mark.long
@pytest.mark.parametrize("precision", ["float64", pytest.param("float32", marks=pytest.mark.thorough)])
def test_blocks_follow_every_recipe(tmp_path, precision):
    # metrics, frames of every channel and the state, to round-off; the bar on springs is pressed 3 cm into the chain
    assert len(TITLES) == 7
    marine = example("marine")
    bar = {f"guides.0.{end}": np.add(getattr(marine.guides[0], end), (0.03, 0.0)).tolist() for end in ("start", "end")}
    files = [tmp_path / "one.toml", tmp_path / "other.toml"]
    for file, torque in zip(files, (9e3, 6e3), strict=True):
        file.write_text(dumps_drive(marine.with_values(bar | {"sprockets.camshaft.load.torque": torque})))
    tree = grown(tmp_path / "tree", [change for title in TITLES for change in recipe(title)])
    run_in(tree, LIGHTLY + ON_FIBERS, precision, *files)
