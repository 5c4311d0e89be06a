"""Rated powers by size, teeth and speed, against published tables; lubrication, strands, elongation."""

import math

import numpy as np
import pytest

from warpchain.drive.catalogue import CHAINS
from warpchain.model.power_rating import (
    HORSEPOWER,
    SERVICE_FACTORS,
    elongation_limit,
    lubrication_class,
    lubrication_limits,
    rated_power,
    size_rating,
)

RPM = math.pi / 30.0
NUMBER_40 = {
    11: {50: 0.23, 1000: 3.42, 1600: 5.22, 1800: 4.66},
    17: {50: 0.37, 100: 0.69, 200: 1.29, 500: 2.93, 1000: 5.48, 1400: 7.41, 1600: 8.36, 1800: 8.96},
}
"""Horsepower of No. 40 by teeth and rpm (ASME B29.1, American Chain Association)."""


@pytest.mark.parametrize(("teeth", "rpm"), [(teeth, rpm) for teeth, row in NUMBER_40.items() for rpm in row])
def test_the_published_table_of_number_40_to_its_last_digit(teeth, rpm):
    found = rated_power("08A", teeth, rpm * RPM)
    assert f"{found.least / HORSEPOWER:.2f}" == f"{NUMBER_40[teeth][rpm]:.2f}"
    assert found.limited_by == ("rollers and bushings" if rpm == 1800 else "link plates")


def test_coefficients_of_sizes():
    """K_s and K_r of the American Chain Association; several strands 1.7 and 2.5 times, the heavy series as A."""
    assert size_rating("08A")[:2] == size_rating("60H")[:2] == size_rating("48A")[:2] == (0.004, 17.0)
    assert size_rating("04C")[:2] == size_rating("06C")[:2] == (0.004, 29.0) and size_rating("085")[:2] == (0.0022, 3.4)
    assert size_rating("16A-2")[:2] == pytest.approx((1.7 * 0.004, 1.7 * 17.0), rel=1e-15)
    assert size_rating("16A-3")[:2] == pytest.approx((2.5 * 0.004, 2.5 * 17.0), rel=1e-15)
    # 60 kN of 16B for 55.6 kN of 12,500 lbf at one inch
    assert size_rating("16B").plates == pytest.approx(0.004 * 60.0 / 55.602777, rel=1e-6)
    assert [size for size, chain in CHAINS.items() if size_rating(size) is None and chain.kind == "roller"] == [
        "081", "083", "084", "415", "420", "428", "520", "525", "530", "630", "bush-7", "bush-8", "219H",
    ]  # fmt: skip
    assert not any(size_rating(size) for size, chain in CHAINS.items() if chain.kind == "silent")
    assert size_rating(None) is None and size_rating("none") is None


def test_the_estimate_of_series_b_beside_a_published_value():
    """10B, 17 teeth, 1400 rpm: 11.67 kW (Bhandari, Design of Machine Elements, Table 14.2)."""
    assert rated_power("10B", 17, 1400 * RPM).least == pytest.approx(11.67e3, rel=0.06)


def test_arrays_have_the_bits_of_numbers():
    speeds = np.linspace(1.0, 400.0, 97)
    assert rated_power("16B-2", 19, speeds).least.tolist() == [
        rated_power("16B-2", 19, x).least for x in speeds.tolist()
    ]


def test_lubrication_by_the_table_of_machinerys_handbook():
    """Feet a minute of No. 40 and 80; halfway between in logarithms."""
    assert lubrication_limits(0.0127) == pytest.approx((300 * 0.00508, 2300 * 0.00508), rel=1e-12)
    assert lubrication_limits(0.0254) == pytest.approx((170 * 0.00508, 1500 * 0.00508), rel=1e-12)
    middle = math.sqrt(0.75) * 0.0254
    assert lubrication_limits(middle)[0] == pytest.approx(math.sqrt(220 * 170) * 0.00508, rel=1e-12)
    assert [lubrication_class(0.0254, speed) for speed in (0.86, 0.87, 7.6, 7.7)] == ["A", "B", "B", "C"]


def test_elongation_and_service():
    """3 % up to 67 teeth, 200/z % above; factors of makers from smooth to heavy."""
    assert [elongation_limit(z) for z in (19, 67, 68, 100)] == [0.03, 0.03, 2.0 / 68.0, 0.02]
    assert [row["motor"] for row in SERVICE_FACTORS.values()] == [1.0, 1.3, 1.5]
    assert [row["engine"] for row in SERVICE_FACTORS.values()] == [1.2, 1.4, 1.7]
