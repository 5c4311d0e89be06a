"""Quantities in words."""

import pytest

from warpchain.results.units import quantity, shown_unit


def test_words_have_unit_and_deviation():
    assert quantity(5612.3, "N", 83.0) == "5.612 ± 0.083 kN"
    assert quantity(-0.0075, "m") == "-7.5 mm"
    assert quantity(0.95, "1", float("nan")) == "0.95"


def test_the_largest_value_decides():
    assert shown_unit("N", 3.0, -4e3, float("nan")) == ("kN", pytest.approx(1e-3))
    assert shown_unit("1", 3e-5) == ("", 1.0)
    assert shown_unit("m") == ("m", 1.0)
