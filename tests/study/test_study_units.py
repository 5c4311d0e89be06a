"""Numbers with units in study files, and the units that pages show: those of the paths that factors set."""

import math

import pytest
from study_helpers import LIMITS, STUDY, tiny_drive

from warpchain.drive import Drive, dumps_drive
from warpchain.drive.path_units import path_unit
from warpchain.drive.quantities import unit_of_key
from warpchain.errors import StudyError
from warpchain.study.design.design_table import make_design
from warpchain.study.results import read_results
from warpchain.study.spec import dumps_study, load_study, loads_study

TEXT = STUDY.replace("points = {points}", "points = 3").replace("shard = {shard}", "shard = 4")


def study(old="", new="", more=""):
    assert old in TEXT
    return loads_study(TEXT.replace(old, new, 1) + more)


@pytest.mark.parametrize(
    ("path", "unit"),
    [
        ("sprockets.camshaft.load.torque", "N m"),
        ("sprockets.load.load.torque", "N m"),  # a sprocket that is called like a key
        ("sprockets.wheel.center.0", "m"),
        ("chains.primary.stiffness", "N/m"),
        ("arms.blade.pivot.1", "m"),
        ("run.duration", "s"),
        ("chain.damping_ratio", "-"),
        ("chain.links", ""),
        ("chain.nothing", ""),
        ("", ""),
    ],
)
def test_units_of_paths(path, unit):
    assert path_unit(Drive, path) == unit


def test_every_number_of_a_drive_has_the_unit_of_its_part():
    """By way of the parts that a drive has, and by that of the kinds that it may have."""
    drive, checked = tiny_drive(), 0
    for path in drive.paths():
        *way, key = path.split(".")
        owner = drive
        for word in way:
            owner = (
                next(part for part in owner if part.name == word)
                if isinstance(owner, tuple) and not word.isdigit()
                else owner[int(word)]
                if isinstance(owner, tuple)
                else getattr(owner, word, None)
            )
        if isinstance(drive.get_value(path), float) and not key.isdigit():
            assert path_unit(Drive, path) == unit_of_key(type(owner), key), path
            checked += 1
    assert checked > 10


RANGE = "range = [0.0, 1.0]\npoints = 3"


@pytest.mark.parametrize(
    ("new", "key", "value"),
    [
        ('range = ["1 N m", "2000 N mm"]\npoints = 3', "range", (1.0, 2.0)),
        ('range = [0.5, "1 kNm"]\npoints = 3', "range", (0.5, 1000.0)),
        ('levels = ["1 Nm", "2 Nm"]', "levels", (1.0, 2.0)),
        ('choice = ["1 Nm", 2.0]', "choice", (1.0, 2.0)),
        ('distribution = "normal"\nmean = "1 Nm"\nstd = "10 N cm"\npoints = 3', "std", 0.1),
        ('distribution = "empirical"\nsample = ["1 Nm", "2 Nm"]\npoints = 2', "sample", (1.0, 2.0)),
        ('relative = true\nrange = ["90 %", 1.1]\npoints = 3', "range", (0.9, 1.1)),
    ],
)
def test_values_of_factors_may_have_units(new, key, value):
    found = study(RANGE, new)
    assert getattr(found.factors[0], key) == value  # decimal fractions, converted as such and rounded once
    assert loads_study(dumps_study(found)) == found


def test_a_shift_is_in_meters_and_a_speed_may_be_in_revolutions():
    found = study(
        'path = "sprockets.s1.load.torque"\n' + RANGE, 'shift = "guides.a"\nrange = ["1 mm", "2 mm"]\npoints = 2'
    )
    assert found.factors[0].range == (0.001, 0.002)
    found = study(
        'path = "sprockets.s1.load.torque"\n' + RANGE,
        'path = "sprockets.s0.prescribed.speed"\nlevels = ["30 rpm", "60 rpm"]',
    )
    assert found.factors[0].levels == pytest.approx((math.pi, 2.0 * math.pi), rel=1e-15)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            RANGE,
            'range = ["1 mm", "2 mm"]\npoints = 3',
            r'value 1 of factors\.torque\.range = "1 mm": must be .* that fits: N m',
        ),
        (
            RANGE,
            'levels = ["1 rpm", 2.0]',
            r'value 1 of factors\.torque\.levels = "1 rpm": must be a number, or one with a unit',
        ),
        (
            RANGE,
            'distribution = "normal"\nmean = 1.0\nstd = "1 N"\npoints = 2',
            r'factors\.torque\.std = "1 N": must be',
        ),
        ("levels = [44, 45]", 'levels = ["44 mm", 45]', r"factors\.links\.levels"),  # links have no unit
        (RANGE, f'{RANGE}\nunit = "N"', r'factors\.torque\.unit = "N": the values are in N m: leave it out'),
        (
            RANGE,
            'relative = true\nrange = ["1 N m", 2.0]\npoints = 3',
            r'value 1 of factors\.torque\.range = "1 N m": must be',
        ),
        (
            LIMITS,
            '[[limits]]\nmetric = "tension_max"\nmax = "5 mm"\n',
            r'limit on "tension_max": max = "5 mm": must be .* that fits: N, mN, kN',
        ),
        (
            LIMITS,
            '[[limits]]\nmetric = "q95(tension_max)"\nmax = "5 s"\n',
            r'limit on "q95\(tension_max\)": max = "5 s": must be',
        ),
        ("energy_residual = inf", 'energy_residual = "1 N"', r'limits\.energy_residual = "1 N": must be'),
    ],
)
def test_a_unit_that_does_not_fit_is_refused(old, new, said):
    with pytest.raises(StudyError, match=said):
        study(old, new)


@pytest.mark.parametrize(
    ("require", "plain"),
    [
        ("torque <= 500 N mm", "torque <= 0.5"),
        ("0.1 N m < torque < 1 kNm and links > 44", "0.1 < torque < 1000.0 and links > 44"),
        ("not (torque > 90 %2)", "not (torque > 90 %2)"),  # a remainder
        ("torque > 90 % links", "torque > 90 % links"),
    ],
)
def test_constraints_may_compare_a_factor_with_a_quantity(require, plain):
    found = study(more=f'\n[[constraints]]\nrequire = "{require}"\n').constraints[0].require
    assert found.split() == plain.split()


@pytest.mark.parametrize(
    ("require", "said"),
    [
        ("torque <= 5 mm", "5 mm must have a unit that fits: N m, Nm, kNm"),
        ("links <= 5 mm", "5 mm must be compared with a factor alone, whose values have a unit"),
        ("2 * torque <= 5 Nm", "5 Nm must be compared with a factor alone"),
    ],
)
def test_quantities_of_constraints_that_do_not_fit(require, said):
    with pytest.raises(StudyError) as caught:
        study(more=f'\n[[constraints]]\nrequire = "{require}"\n')
    assert f'constraint 1: require = "{require}": {said}' in str(caught.value)


def test_limits_may_have_units():
    found = study(
        LIMITS,
        '[[limits]]\nmetric = "tension_max"\nmin = "10 N"\nmax = "5 kN"\n\n[[limits]]\nenergy_residual = "1.5 %"\n',
    )
    assert (found.bounds[0].min, found.bounds[0].max) == (10.0, 5000.0)
    assert found.limits.energy_residual == 0.015


def test_tables_have_the_unit_of_the_path(tmp_path):
    """It is what pages and figures show; a unit that a study states is the same, or of a quantity without a path."""
    (tmp_path / "tiny.toml").write_text(dumps_drive(tiny_drive()))
    source = tmp_path / "study.toml"
    source.write_text(TEXT)
    table = make_design(study(), source)
    assert table.schema.field("torque").metadata[b"unit"] == b"N m"
    assert table.schema.field("links").metadata[b"unit"] == b""
    found = study(RANGE, f'{RANGE}\nunit = "Nm"')
    assert found.factors[0].display_unit == "Nm"
    assert study(RANGE, f"{RANGE}\nrelative = true").factors[0].display_unit == ""


def test_a_ratio_is_shown_without_a_unit(tmp_path):
    """The path's unit is "-", as in metadata; pages and lines have the number alone."""
    mu = '[[factors]]\nname = "mu"\npath = "contact.sprocket.restitution"\nrange = [0.1, 0.3]\npoints = 2\n'
    (tmp_path / "tiny.toml").write_text(dumps_drive(tiny_drive()))
    source = tmp_path / "study.toml"
    source.write_text(STUDY.format(points=2, shard=1) + mu)
    results = read_results(make_design(load_study(source), source).drop_columns(["status", "reason"]))
    assert [results.column_unit(name) for name in ("torque", "mu")] == ["N m", ""]
