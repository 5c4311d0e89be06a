"""Units as engineers write them."""

import pytest

from warpchain.results.units import display_unit


@pytest.mark.parametrize(
    ("unit", "largest", "shown", "factor"),
    [
        ("m", 0.0123, "mm", 1e3),
        ("m", -0.0123, "mm", 1e3),
        ("m", 4200.0, "m", 1.0),  # no kilometers
        ("N", 18_300.0, "kN", 1e-3),
        ("N", 0.02, "N", 1.0),  # no millinewtons
        ("N", 1000.0, "kN", 1e-3),
        ("N", 999.0, "N", 1.0),
        ("N m", 12_000.0, "kN m", 1e-3),
        ("Pa", 3.1e6, "MPa", 1e-6),
        ("W", 0.0, "W", 1.0),
        ("1", 1e6, "1", 1.0),
        ("N", float("nan"), "N", 1.0),
        ("N", float("inf"), "N", 1.0),
    ],
)
def test_the_largest_value_is_between_one_and_a_thousand(unit, largest, shown, factor):
    assert display_unit(unit, largest) == (shown, pytest.approx(factor, rel=1e-15))
