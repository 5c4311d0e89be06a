"""Units that values are shown in, and quantities in words."""

import math

import pytest

from warpchain.results.metric_columns import COLUMN_BY_NAME
from warpchain.results.units import DISPLAY_UNITS, display_unit, display_unit_word, quantity_words


@pytest.mark.parametrize(
    "unit, largest, expected",
    [
        ("m", 0.0075, ("mm", 1e3)),
        ("m", -0.0075, ("mm", 1e3)),
        ("m", 7.5, ("m", 1.0)),
        ("m", 2e-6, ("\N{MICRO SIGN}m", 1e6)),
        ("N", 42e3, ("kN", 1e-3)),
        ("N", 999.0, ("N", 1.0)),
        ("N/m", 1.5e9, ("GN/m", 1e-9)),
        ("N/m", 4e8, ("MN/m", 1e-6)),
        ("rad", 0.01, ("degrees", 180.0 / math.pi)),
        ("rad", 7.0, ("degrees", 180.0 / math.pi)),
        ("N", 0.0, ("N", 1.0)),
        ("N", float("nan"), ("N", 1.0)),
        ("1", 1e9, ("1", 1.0)),
        ("furlong", 1e9, ("furlong", 1.0)),
    ],
)
def test_units_fit_the_size_of_the_values(unit, largest, expected):
    assert display_unit(unit, largest) == expected


def test_shown_values_stay_readable():
    """From a tenth of the second step to the last one's 900-fold, no value is shown below 0.1 or above 10,000."""
    for unit, steps in DISPLAY_UNITS.items():
        if len(steps) == 1:  # angles, in degrees whatever their size
            continue
        least, most = max(steps[1][0] * 1e-1, 1e-12), steps[-1][0] * 900.0
        value = least
        while value < most:
            word, factor = display_unit(unit, value)
            assert 0.099 <= value * factor < 1e4, (unit, value, word)
            value *= 1.3


def test_units_of_metrics_are_known_where_they_scale():
    assert {"N", "m", "J", "N m", "N s", "rad"} <= {column.unit for column in COLUMN_BY_NAME.values()} & set(
        DISPLAY_UNITS
    )


def test_words_have_unit_and_deviation():
    assert quantity_words(5612.3, "N", 83.0) == "5.612 ± 0.083 kN"
    assert quantity_words(-0.0075, "m") == "-7.5 mm"
    assert quantity_words(0.95, "1", float("nan")) == "0.95"


def test_the_largest_value_decides():
    assert display_unit_word("N", 3.0, -4e3, float("nan")) == ("kN", pytest.approx(1e-3))
    assert display_unit_word("1", 3e-5) == ("", 1.0)
    assert display_unit_word("m") == ("m", 1.0)
