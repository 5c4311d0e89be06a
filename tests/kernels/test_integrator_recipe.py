"""An integrator, made as the recipe in CONTRIBUTING.md says: its order; on blocks see `test_recipes`."""

import re

import pytest
from grown import grown, recipe, run_in


@pytest.mark.long
def test_the_recipe_of_an_integrator(tmp_path):
    changes = recipe("A new integrator")
    paths = ["kernels/integrate.py", "warpchain/drive/run_settings.py", "tests/kernels/test_chain_physics.py"]
    assert [path for path, _, _ in changes] == paths
    tests = ("-k", "order_of_convergence and heun3", "tests/kernels/test_chain_physics.py")
    printed = run_in(grown(tmp_path, changes), "-m pytest -q -p no:cacheprovider --rootdir .", *tests)
    assert re.search(r"^1 passed", printed, re.M) and "failed" not in printed
