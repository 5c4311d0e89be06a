"""The page on validation has the rows that its script makes, and its quick rows hold what it states."""

import re

import numpy as np
import pytest
from loading import SCRIPTS, load_script

DOCS = SCRIPTS.parent / "docs"
PAGES = {path: path.read_text() for path in (DOCS / "validation.md", DOCS / "validation-published.md")}
SECTIONS = {
    title: dict(line.removeprefix("- ").split(": ", 1) for line in items.splitlines())
    for page in PAGES.values()
    for title, items in re.findall(r"^### (.+)\n\n((?:- .*\n)+)", page, re.M)
}
"""Items of each result's list, by the result's title."""
QUICK = {
    "string_modes": 1e-5,  # printed to 1e-4 Hz of 5 to 14
    "restitution": 1e-5,  # printed to five digits
    "sag": 1e-3,  # settling ends within 1e-3 of its way
    "centrifugal_tension": 1e-8,  # printed to eight digits; rounding alone is 1e-14
    "load_of_an_arc": 1e-3,  # printed to four digits
    "silent_arc": 1e-3,  # printed to four digits
    "silent_backs": 1e-3,  # printed to four digits
    "orders": 5e-3,  # printed to 0.01; half of rk4's error is rounding, which differs between compilers
    "center_distance": 1e-8,  # centers are rounded to 1e-10 m, 3e-10 of the distance
}


def numbers(text):
    return np.array(re.findall(r"\d+(?:\.\d+)?", text), dtype=float)


@pytest.mark.parametrize("name", QUICK)
def test_a_row_holds_what_the_page_states(name):
    made = getattr(load_script("drawings.closed_forms"), name)()
    stated = SECTIONS[made.name[0].upper() + made.name[1:]]
    pairs = [(made.gives, stated["warpchain gives"])] + ([(made.states, stated["States"])] if made.states else [])
    for found, said in pairs:
        np.testing.assert_allclose(numbers(found), numbers(said), rtol=QUICK[name])


def test_the_stated_differences_are_small():
    """A closed form is met within its own verdict: ringing 1e-3, seats 1 % (`modal/test_campbell.py`), sag 1 %."""
    bound = {"polygon action": 1e-3, "string modes": 2e-6, "wave speed": 1e-2, "restitution": 2e-4, "sag": 1e-2}
    for name, most in (bound | {"centrifugal tension": 1e-8}).items():
        assert abs(float(re.match(r"[-+.\de]+", SECTIONS[name.capitalize()]["Difference"])[0])) < most, name


def test_rigid_links_close_as_the_source_has_it():
    """The source's value, which its tests hold to 1e-9 mm, begins at a tangent point: within the scatter of all places.

    Equal wheels with strands of a whole number of pitches close at these strands' length exactly, from anywhere there.
    """
    module = load_script("drawings.closed_forms")
    centers = 1e3 * np.array(module.rigid_centers((11, 20), 0.0254, 47))
    assert centers.min() < 398.338658801 < centers.max() < centers.min() + 0.011
    assert module.rigid_centers((20, 20), 0.05, 60, 1) == pytest.approx([1.0], abs=1e-12)


def test_every_result_has_all_items():
    labels = list(load_script("drawings.validation").LABELS)
    assert len(SECTIONS) == 31 and all(list(items) == labels for items in SECTIONS.values())


def test_results_are_written_in_place_and_keep_the_words_of_the_page():
    made, renewed = load_script("drawings.closed_forms").ValidationRow, load_script("drawings.validation").renewed_page
    path, stated, written = renewed(made("restitution", gives="other"), PAGES)
    lines, new = stated.splitlines(), written.splitlines()
    assert path.name == "validation.md" and stated in PAGES[path]
    assert new == [*lines[:5], "- warpchain gives: other", *lines[6:]]
    with pytest.raises(SystemExit, match=r"^docs/validation.md: no section 'new'; write its words there$"):
        renewed(made("new", gives="other"), PAGES)
