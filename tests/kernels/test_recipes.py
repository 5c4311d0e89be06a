"""All recipes of CONTRIBUTING.md at once: block kernels then take the steps of the CPU's, at both precisions."""

import numpy as np
import pytest
from drives import example
from grown import CONTRIBUTING, grown, recipe, run_in

from warpchain import dumps_drive

TITLES = [line.removeprefix("## ") for line in CONTRIBUTING.read_text().splitlines() if line.startswith("## A new ")]
ON_FIBERS = """
import sys
import warp as wp
from blocks import assert_steps_of_the_cpu
from warpchain import load_drive

wp.config.enable_cpu_blocks = True
new = {"contact.sprocket.law": "anagnostopoulos", "contact.sprocket.restitution_means": "rebound", "run.step": 1e-5}
new |= {"chain.joint": {"friction": 0.1, "pin_radius": 0.02, "seal": 0.5}, "run.integrator": "heun3"}
assert_steps_of_the_cpu(lambda: [load_drive(path).with_values(new) for path in sys.argv[2:]], True, sys.argv[1])
"""


@pytest.mark.long
@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_blocks_follow_every_recipe(tmp_path, precision):
    # metrics, frames of every channel and the state, to round-off; the bar on springs is pressed 3 cm into the chain
    assert len(TITLES) == 6
    marine = example("marine")
    bar = {f"guides.0.{end}": np.add(getattr(marine.guides[0], end), (0.03, 0.0)).tolist() for end in ("start", "end")}
    files = [tmp_path / "one.toml", tmp_path / "other.toml"]
    for file, torque in zip(files, (9e3, 6e3), strict=True):
        file.write_text(dumps_drive(marine.with_values(bar | {"sprockets.camshaft.load.torque": torque})))
    tree = grown(tmp_path / "tree", [change for title in TITLES for change in recipe(title)])
    run_in(tree, ON_FIBERS, precision, *files)
