"""Stiffness from materials and the restitution of an impact, against closed forms."""

import math

import pytest
from drives import example
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq

from warpchain.assembly.timestep import highest_frequency
from warpchain.drive import Material
from warpchain.drive.stiffness import compliance, hertz_stiffness, rebound_ratio
from warpchain.errors import DriveError
from warpchain.model import single_chain
from warpchain.model.friction_coefficients import (
    FrictionCoefficients,
    guide_friction_coefficients,
    tooth_friction_coefficients,
)

STEEL = Material(youngs_modulus=210e9, poissons_ratio=0.3)
RUBBER = Material(youngs_modulus=10e6, poissons_ratio=0.49)


def drive(**changes):
    """The marine drive without friction and bushes, on a bar of soft rubber, both contacts by a load of 10 kN."""
    plain = {"chain.joint": None, "contact.sprocket.friction": None, "contact.sprocket.bush_stiffness": None}
    plain |= {"contact.guide.friction": None, "contact.guide.rolling": False, "contact.guide.reference_load": 10e3}
    plain |= {"contact.guide.partner": {"youngs_modulus": 10e6, "poissons_ratio": 0.49}, "guides.0.name": "bar"}
    return example("marine").with_values(plain).with_values(changes)


def test_steel_seat_of_a_72b_roller():
    # eq. (20): 1.62e9 N/m at 10 kN, to the three digits stated
    assert single_chain(drive()).sprocket_stiffness(0) == pytest.approx(1.62e9, rel=0.003)
    direct = hertz_stiffness(10e3, 0.063, 0.0362, 0.0366, compliance(STEEL, STEEL))
    assert single_chain(drive()).sprocket_stiffness(1) == pytest.approx(direct, rel=1e-12)


def test_bush_and_tooth_in_series():
    # 1/K = 1/K_tooth + 1/K_bush, given or from materials;
    # the limit of the step, 2 / sqrt((4 k + K) / m + K (z - 1) R^2 / J), follows
    tooth = single_chain(drive()).sprocket_stiffness(0)
    both = drive(**{"contact.sprocket.bush_stiffness": 8e8})
    series = 1.0 / (1.0 / tooth + 1.0 / 8e8)
    assert single_chain(both).sprocket_stiffness(0) == pytest.approx(series, rel=1e-15)
    turns = [(s, both.sprockets[s]) for s in (1, 2)]  # freely: the fastest of them counts
    turning = max(series * (of.teeth - 1) * single_chain(both).pitch_radius(s) ** 2 / of.inertia for s, of in turns)
    longest = 2.0 / math.sqrt((4 * 1.5e9 + series) / 6.95 + turning)
    assert 2.0 / highest_frequency(both, damped_links=False) == pytest.approx(longest, rel=1e-12)
    assert single_chain(drive(**{"contact.sprocket.bush_stiffness": 1e30})).sprocket_stiffness(0) == pytest.approx(
        tooth, rel=1e-12
    )


def test_what_rubs_is_what_is_given():
    given = {"contact.sprocket.friction": 0.06, "contact.guide.friction": 0.1}
    given |= {"guides.bar.contact": {"friction": 0.2, "static_friction": 0.3, "stribeck_speed": 0.05}}
    assert tooth_friction_coefficients(single_chain(drive(**given))) == FrictionCoefficients(0.06, 0.06, 1.0)
    assert guide_friction_coefficients(single_chain(drive(**given)), 0) == FrictionCoefficients(0.2, 0.3, 0.05)
    assert (
        not tooth_friction_coefficients(single_chain(drive())).has_friction
        and not guide_friction_coefficients(single_chain(drive()), 0).has_friction
    )


def test_flat_rubber():
    # eq. (20) with R2 -> infinity: 6.0e5 N/m at 10 kN, to the two digits stated
    assert single_chain(drive()).guide_stiffness(0) == pytest.approx(6.0e5, rel=0.005)
    far = hertz_stiffness(10e3, 0.063, 0.0362, 1e9, compliance(STEEL, RUBBER))
    assert single_chain(drive()).guide_stiffness(0) == pytest.approx(far, rel=1e-9)


@given(
    load=st.floats(1.0, 1e5), width=st.floats(0.005, 0.2), r1=st.floats(1e-3, 0.1), r2=st.floats(1e-3, 1.0)
)  # fmt: skip
def test_stiffness_is_load_over_the_published_penetration(load, width, r1, r2):
    # eq. (20) as printed, with materials written out
    each = (1 - 0.3**2) / 210e9
    bracket = math.log(math.pi * width**3 * (r1 + r2) / (load * r1 * r2 * 2 * each)) + 1
    penetration = load / (math.pi * width) * 2 * each * bracket
    stiffness = hertz_stiffness(load, width, r1, r2, compliance(STEEL, STEEL))
    assert stiffness == pytest.approx(load / penetration, rel=1e-9)


def test_exponent_keeps_the_load_at_the_reference_penetration():
    linear = hertz_stiffness(10e3, 0.063, 0.0362, 0.0366, compliance(STEEL, STEEL))
    penetration = 10e3 / linear
    power = hertz_stiffness(10e3, 0.063, 0.0362, 0.0366, compliance(STEEL, STEEL), exponent=1.5)
    assert power * penetration**1.5 == pytest.approx(10e3, rel=1e-12)


def test_given_stiffness_is_used():
    changed = drive(**{"contact.sprocket.stiffness": 2e9, "guides.bar.contact.stiffness": 3e6})
    assert single_chain(changed).sprocket_stiffness(0) == 2e9
    assert single_chain(changed).guide_stiffness(0) == 3e6


def test_materials_of_one_bar():
    changed = drive(**{"guides.bar.contact.partner": STEEL})
    direct = hertz_stiffness(10e3, 0.063, 0.0362, math.inf, compliance(STEEL, STEEL))
    assert single_chain(changed).guide_stiffness(0) == pytest.approx(direct, rel=1e-12)


def test_load_where_the_bracket_vanishes_is_the_limit():
    body = compliance(STEEL, RUBBER)
    limit = math.e * 0.063**3 / (0.0362 * body)  # the bracket is ln(limit / P)
    assert hertz_stiffness(0.99 * limit, 0.063, 0.0362, math.inf, body) > 0
    for load in (1.01 * limit, 0.0, -1.0, math.nan):
        with pytest.raises(DriveError, match=r"^reference_load = .*: must be above 0 and below 776.* N"):
            hertz_stiffness(load, 0.063, 0.0362, math.inf, body)


@pytest.mark.parametrize("key", ["contact.guide.reference_load", "guides.bar.contact.reference_load"])
def test_a_load_beyond_the_formula_names_its_key(key):
    with pytest.raises(DriveError, match=rf"^{key} = 1000000\.0: must be below"):
        drive(**{key: 1e6})


def test_a_stiffness_beyond_all_numbers_names_its_key():
    changed = drive(**{"contact.sprocket.exponent": 100.0})
    with pytest.raises(DriveError, match=r"^contact\.sprocket\.reference_load = 10000\.0: must give a stiffness that"):
        single_chain(changed).sprocket_stiffness(0)


@pytest.mark.parametrize(("restitution", "ratio"), [(0.3, 0.68422), (0.5, 0.72524), (0.8, 0.84710), (1.0, 1.0)])
def test_rebound_ratio_of_stated_cases(restitution, ratio):
    assert rebound_ratio(restitution) == pytest.approx(ratio, abs=5e-6)


@given(st.floats(1e-9, 0.999))
def test_rebound_ratio_solves_its_equation(restitution):
    d = 0.75 * (1 - restitution**2)
    reference = brentq(lambda r: -d * r - math.log1p(-d * r) - (d - math.log1p(d)), 0.1, 1.0, xtol=1e-15, rtol=1e-14)
    assert rebound_ratio(restitution) == pytest.approx(reference, rel=1e-9)


def test_rebound_ratio_joins_its_series_smoothly():
    # both sides of d = 1e-4 against r = 1 - 2 d/3 + 4 d^2/9 - ..., whose next term is below d^3
    for d in (0.9e-4, 1.1e-4, 1e-3):
        series = 1 - 2 * d / 3 + 4 * d * d / 9
        assert rebound_ratio(math.sqrt(1 - d / 0.75)) == pytest.approx(series, abs=d**3 + 1e-11)


@pytest.mark.parametrize("restitution", [0.0, -0.1, 1.0001, math.nan])
def test_rebound_ratio_of_an_impossible_restitution(restitution):
    with pytest.raises(DriveError, match=r"^restitution = .*: must be a number above 0, at most 1$"):
        rebound_ratio(restitution)
