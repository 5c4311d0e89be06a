"""The catalogue of ISO 606 chains, and drives that name a size."""

import math
from itertools import pairwise

import pytest
from drives import errors_of

from warpchain import cli
from warpchain.assembly.summary import derive, report
from warpchain.drive import Chain, Drive, dumps_drive, loads_drive
from warpchain.drive.catalogue import CHAINS
from warpchain.errors import DriveError

SIZED = {"size": "16B", "links": 100, "stiffness": "estimate", "damping_ratio": 0.02}


def sized(values, size="72B", stiffness="estimate"):
    """The marine drive's values with a size instead of dimensions."""
    for key in ("pitch", "roller_radius", "roller_mass"):
        del values["chain"][key]
    values["chain"] |= {"size": size, "stiffness": stiffness}
    return values


def test_sizes_are_sixteenths_of_an_inch():
    """The number of a size is its pitch in sixteenths of an inch; 05B, 8 mm, is the metric exception."""
    assert CHAINS["05B"].pitch == 0.008
    for size, chain in CHAINS.items():
        assert size == chain.size
        if size != "05B":
            assert chain.pitch == pytest.approx(int(size[:-1]) * 25.4e-3 / 16, rel=1e-12)


def test_series_a_has_the_strength_of_asme_b29_1():
    """12,500 lbf for each square inch of pitch; ISO 606 rounds to three figures."""
    for size, chain in CHAINS.items():
        if size.endswith("A"):
            load = 12500 * 4.4482216 * (chain.pitch / 25.4e-3) ** 2
            assert chain.breaking_load == pytest.approx(load, rel=4e-3), size


def test_pins_of_series_a_are_those_of_asme_b29_1():
    """Inches of ANSI 40, 50, 60, 80, ..., 240; ISO 606 gives the largest, by at most 0.03 mm more."""
    inches = (0.156, 0.200, 0.234, 0.312, 0.375, 0.437, 0.500, 0.562, 0.687, 0.781, 0.937)
    pins = [chain.pin_diameter for size, chain in CHAINS.items() if size.endswith("A")]
    assert pins == pytest.approx([25.4e-3 * inch for inch in inches], abs=0.03e-3)


def test_a_size_gives_the_pin_radius(values):
    drive = Drive(**sized(values)).with_values({"chain.joint": {"friction": 0.1}})
    assert drive.chain.pin_radius == pytest.approx(22.24e-3, abs=1e-12)
    assert drive.with_values({"chain.size": "64B", "chain.stiffness": "estimate"}).chain.pin_radius == 19.7e-3
    assert drive.with_values({"chain.joint.pin_radius": 0.02}).chain.pin_radius == 0.02
    assert "joints: friction 0.1, pins of 22.24 mm radius" in report(derive(drive))


@pytest.mark.parametrize("series", ["A", "B"])
def test_sizes_grow_alike(series):
    """Everything grows with the pitch; rollers fit between pitch and half of it; masses follow width and height."""
    chains = [chain for chain in CHAINS.values() if chain.size.endswith(series)]
    for small, large in pairwise(chains):
        for name in ("pitch", "roller_diameter", "pin_diameter", "mass_per_length", "breaking_load"):
            assert getattr(small, name) < getattr(large, name)
    for chain in chains:
        assert 0.5 < chain.roller_diameter / chain.pitch < 0.7
        assert 0.35 < chain.inner_width / chain.pitch < 0.73
        assert 0.28 < chain.pin_diameter / chain.pitch < 0.4
        # a chain of one shape weighs and carries with the square of its size
        assert 2800 < chain.mass_per_length / chain.pitch**2 < 5200
        assert 6e7 < chain.breaking_load / chain.pitch**2 < 1.2e8


def test_size_fills_and_explicit_keys_override():
    chain = Chain(**SIZED)
    assert (chain.pitch, chain.roller_radius, chain.mass_per_length) == (0.0254, 0.00794, 2.71)
    assert chain.breaking_load == 60e3
    # 1 % of 25.4 mm at 60 kN
    assert chain.stiffness == pytest.approx(60e3 / 0.254e-3)
    assert chain.stiffness_is_estimate
    own = Chain(**SIZED | {"roller_mass": 0.07, "pitch": 0.0255, "roller_radius": 0.0079, "stiffness": 1e8})
    assert (own.pitch, own.roller_radius, own.mass, own.stiffness) == (0.0255, 0.0079, 0.07, 1e8)
    assert own.mass_per_length is None and not own.stiffness_is_estimate


def test_sized_drive_round_trips_and_changes(values):
    drive = Drive(**sized(values))
    assert loads_drive(dumps_drive(drive)) == drive
    other = drive.with_values({"chain.size": "64B", "chain.stiffness": "estimate"})
    assert other.chain.pitch == 0.1016 and other.chain.mass_per_length == 46.0
    assert other.chain.stiffness == CHAINS["64B"].estimated_stiffness
    with pytest.raises(DriveError, match=r'^chain\.stiffness: missing; must be a positive number, or "estimate"'):
        drive.with_values({"chain.size": "64B"})


def test_size_errors_name_size_and_sizes(values):
    (line,) = errors_of(sized(values, size="17B", stiffness=1e9))
    assert line.startswith('chain.size = "17B": must be a size of ISO 606: 05B, 06B, 08B, ')


def test_check_says_that_the_stiffness_is_an_estimate(values):
    drive = Drive(**sized(values))
    text = report(derive(drive))
    assert "size: 72B (ISO 606), breaking load 1400 kN" in text and "an ESTIMATE" in text
    measured = report(derive(drive.with_values({"chain.stiffness": 1.5e9})))
    assert "size: 72B" in measured and "ESTIMATE" not in measured


def test_chains_command_lists_every_size(capsys):
    assert cli.main(["chains"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[1 : 1 + len(CHAINS)]] == list(CHAINS)
    row = next(line for line in lines if line.startswith("16B")).split()
    assert [float(row[i]) for i in (1, 2, 3, 4, 6, 8)] == [25.4, 15.88, 17.02, 8.28, 2.71, 60.0]
    assert math.isclose(float(row[10]), CHAINS["16B"].estimated_stiffness, rel_tol=1e-2)
