"""Quantities with units in drive files: what they are in SI units, and the units that fit where one does not."""

import math
import time
from argparse import ArgumentTypeError

import pytest
from drives import example
from loading import load_script

from warpchain.cli import main
from warpchain.cli.shared_options import angular_speed_from_word
from warpchain.drive import Drive
from warpchain.drive.quantities import QUANTITY, converted_number, unit_of_key
from warpchain.errors import DriveError
from warpchain.study.spec.study_tables import condition_without_units

sections = load_script("pages.reference").file_sections
CAR = example("car")


@pytest.mark.parametrize(
    ("path", "given", "value"),
    [
        ("sprockets.crank.prescribed.speed", "540 rpm", 540 * math.pi / 30),
        ("sprockets.crank.center", ["12.7 mm", 0], (0.0127, 0.0)),
        ("sprockets.crank.center.1", "1in", 0.0254),
        ("arms.arm.free_angle", "15 deg", 15.0),
        ("arms.arm.stops", ["-0.05 rad", 4.0], (-0.05 * 180 / math.pi, 4.0)),
        ("chain.stiffness", "10 kN/mm", 1e7),
        ("guides.blade.contact.friction", "5 %", 0.05),
        ("guides.blade.contact.width", "6e0 mm", 0.006),
        ("tensioners.tensioner.oil.viscosity", "80 mm^2/s", 8e-5),
        ("guides.blade.points", [["-50 mm", 0.24], [-0.032, 0.15]], ((-0.05, 0.24), (-0.032, 0.15))),
        ("run.step", "auto", "auto"),
    ],
)
def test_a_quantity_is_its_number_in_the_keys_unit(path, given, value):
    found = CAR.with_values({path: given}).get_value(path)
    assert found == (pytest.approx(value, rel=1e-15) if isinstance(value, float) else value)


@pytest.mark.parametrize(
    ("path", "given", "units"),
    [
        ("sprockets.crank.prescribed.speed", "540 Hz", "rad/s, rpm"),
        ("sprockets.crank.center.0", "3 kg", "m, mm, cm, um, in, inch"),
        ("chain.damping_ratio", "2 mm^99999999", "-, %"),
    ],
)
def test_another_unit_is_refused_with_those_that_fit(path, given, units):
    with pytest.raises(DriveError) as caught:
        CAR.with_values({path: given})
    assert caught.value.errors == (f'{path} = "{given}": must be a number, or one with a unit that fits: {units}',)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ("9e999 rpm", "must be within 1e+30 rad/s of 0"),
        ("-9e999 rpm", "must be within 1e+30 rad/s of 0"),
        ("1e31 rad/s", "must be within 1e+30 rad/s of 0"),
        ("1" * 5000 + " rpm", "must be a number, or one with a unit, of at most 100 characters"),
        ("1 " + "rpm s/" * 25_000 + "rpm", "must be a number, or one with a unit, of at most 100 characters"),
    ],
    ids=["9e999", "-9e999", "1e31", "5000 digits", "150 kB"],
)
def test_a_quantity_beyond_all_bounds_is_told_at_once(given, told):
    """A unit of 150 kB took 12 s of the processor, other quantities take milliseconds: 1 s is far from both."""
    begin = time.process_time()
    with pytest.raises(DriveError) as caught:
        CAR.with_values({"sprockets.crank.prescribed.speed": given})
    assert time.process_time() - begin < 1.0
    (line,) = caught.value.errors
    assert line.startswith("sprockets.crank.prescribed.speed = ") and line.endswith(f": {told}") and len(line) < 200


def test_a_condition_compares_with_no_number_beyond_all_numbers():
    assert condition_without_units("torque <= 9e999 N m", {"torque": "N m"})[1] == (
        "9e999 N m must be a finite number of N m"
    )


@pytest.mark.parametrize("word", ["nan", "inf", "9e999rpm", "1e400"])
def test_a_speed_on_the_command_line_is_finite(word):
    with pytest.raises(ArgumentTypeError, match="must be a finite number of rad/s, or one with rad/s or rpm"):
        angular_speed_from_word(word)


def test_on_the_command_line_units_need_no_quotes(capsys):
    assert main(["check", "car", "--json", "--set", "sprockets.crank.prescribed.speed=540rpm"]) == 0
    assert main(["check", "car", "--set", "run.duration=3 m"]) == 2
    assert "a unit that fits: s, ms, us, min" in capsys.readouterr().err
    with pytest.raises(ArgumentTypeError, match="'3000Hz': must be a finite number of rad/s, or one with rad/s or rpm"):
        angular_speed_from_word("3000Hz")
    assert angular_speed_from_word("30rpm") == math.pi and angular_speed_from_word("2.5") == 2.5


def test_every_number_of_a_drive_file_has_a_unit():
    """But directions, factors, ratios, a stiffness whose unit its exponent makes, degrees C and 1/K."""
    keys = {key for kind in sections(Drive) for key, field in kind.model_fields.items()
            if "float" in str(field.annotation) and not unit_of_key(kind, key)}  # fmt: skip
    assert keys == {"factor", "most", "direction", "ratio", "stiffness", "temperature", "block", "wheels", "chain"}
    assert converted_number("2 N s/m", "N s/m") == 2.0 and converted_number("2 kNm", "N m") == 2000.0


@pytest.mark.parametrize("text", ["1e-6 * torque", "2.5E3*x", "1e-6 / 2", "0.001 * torque"])
def test_an_expression_of_factors_is_no_quantity(text):
    assert QUANTITY.fullmatch(text) is None
