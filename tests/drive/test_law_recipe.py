"""What a new contact law takes: the recipe in CONTRIBUTING.md, followed, passes the tests of every law."""

import re

import pytest
from grown import grown, recipe, run_in

DRIVE = """
from drives import two_sprockets
from warpchain import loads_drive, dumps_drive, simulate

law = {"contact.sprocket.law": "anagnostopoulos", "contact.sprocket.restitution_means": "rebound"}
drive = loads_drive(dumps_drive(two_sprockets(duration=0.005).with_values(law)))
print(drive.contact.sprocket.law, simulate(drive, device="cpu")[0].tension.max() > 0.0)
"""


@pytest.mark.long
def test_the_recipe_of_a_law(tmp_path):
    changes = recipe("A new contact law")
    paths = ["kernels/physics/impact.py", "warpchain/drive/laws.py", "tests/drive/test_laws.py"]
    assert [path for path, _, _ in changes] == paths
    folder = grown(tmp_path, changes)
    assert run_in(folder, DRIVE).split()[-2:] == ["anagnostopoulos", "True"]
    # its rebound against the closed form, also as what it is asked for, and the energy balance of a drive
    tests = ("-k", "anagnostopoulos and not cuda", "tests/drive/test_laws.py")
    printed = run_in(folder, "-m pytest -q -p no:cacheprovider --rootdir .", *tests)
    assert int(re.search(r"(\d+) passed", printed).group(1)) == 10
    assert "failed" not in printed
