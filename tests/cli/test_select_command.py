"""`warpchain select` lists sizes that are rated for a power, and writes a drive file that passes `check`."""

import math

import pytest
from command import refused
from command import run as command

from warpchain import load_drive
from warpchain.assembly.summary import derived_quantities
from warpchain.drive.catalogue import CHAINS
from warpchain.model.power_rating import rated_power

ASKED = ["--power", "7.5kW", "--speed", "300rpm", "--ratio", 3]


def rows(out):
    """The cells of the printed table by size."""
    return {line.split()[0]: line.split() for line in out if line[:2] == "  " and line.split()[0] in CHAINS}


def test_sizes_that_are_rated_for_the_power_times_the_factor(capsys):
    status, out, err = command(capsys, "select", *ASKED, "--service", "moderate")
    assert (status, err) == (0, []) and out[0].startswith("7.5 kW times 1.3, 19 teeth at 300 rpm to 57 at 100 rpm")
    found = rows(out)
    assert list(found) == ["12A-3", "12B-3", "16A", "16B", "20A", "20B"]
    for size, cells in found.items():
        rated = rated_power(size, 19, 300 * math.pi / 30).least
        assert cells[1] == f"{1e-3 * rated:.3g}" and 7.5e3 * 1.3 <= rated <= 4.0 * 7.5e3 * 1.3
    # 19 teeth of an inch at 5 a second; 2 a + (19 + 57)/2 + (38 / (2 pi))^2 / a is 118.9 at 40 pitches
    assert found["16A"][6:9] == ["2.41", "m/s", "118"] and "DIN 8196" in "\n".join(out)
    assert any(line.startswith("left out: acceleration, shocks") and "silent chains" in line for line in out)


def test_fewer_strands_would_be_too_weak(capsys):
    for size in rows(command(capsys, "select", *ASKED)[1]):
        base, _, strands = size.partition("-")
        weaker = {"": None, "2": base, "3": f"{base}-2"}[strands]
        assert weaker is None or rated_power(weaker, 19, 10.0 * math.pi).least < 7.5e3


@pytest.mark.parametrize("words", [[], ["--size", "12A-3", "--centers", "900mm"], ["--ratio", 0.5]])
def test_the_drive_file_passes_check(capsys, tmp_path, words):
    path = tmp_path / "drive.toml"
    status, out, err = command(capsys, "select", *ASKED, "--service", 1.3, "-o", path, *words)
    assert (status, err) == (0, []) and out[-1].startswith(f"the dynamic run beside it: warpchain run {path}")
    drive = load_drive(path)
    found = derived_quantities(drive)["rating"]
    # the power that was asked for, without the factor; the chain's mean speed is that of its teeth
    assert found["power"] == pytest.approx(7.5e3, rel=0.005) and found["use"] <= 1.0 / 1.3 * 1.005
    assert drive.chain.size == ("12A-3" if "--size" in words else drive.chain.size)
    assert [sprocket.teeth for sprocket in drive.sprockets] == ([38, 19] if "--ratio" in words else [19, 57])
    assert command(capsys, "check", path)[0] == 0


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["--power", "7.5kg"], "'7.5kg': must be a finite number of W, or one with W, kW or hp"),
        (["--power", -1], "--power -1: must be a finite number above 0"),
        (["--power", 0], "--power 0: must be"),
        (["--power", "inf"], "must be a finite number of W"),
        (["--power", "1e9"], "no size does"),
        (["--speed", "0rpm"], "--speed 0: must be"),
        (["--ratio", "nan"], "--ratio nan: must be"),
        (["--ratio", 11], "--ratio 11: must be 0.1 to 10"),
        (["--ratio", "1e308"], "--ratio 1e+308: must be"),
        (["--teeth", 4], "--teeth 4: must be from 9, and with the ratio 3 to 150"),
        (["--teeth", "9" * 400], "must be from 9"),
        (["--centers", "1e-3"], "no size does"),
        (["--centers", "1 kg"], "must be a finite number of m"),
        (["--service", "much"], "must be a number, or smooth or moderate or heavy"),
        (["--service", "heavy,horse"], "with or without a comma and motor or hydraulic or engine"),
        (["--size", "08B", "-o", "x.toml"], "--size 08B: does not; 10A-3, 10B-3, 12A-2, "),
        (["--size", "16B"], "--size: only with -o"),
    ],
)
def test_mistakes_are_one_line(capsys, tmp_path, monkeypatch, words, line):
    monkeypatch.chdir(tmp_path)
    assert line in refused(capsys, "select", *ASKED, *words)
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_is_there_stays(capsys, tmp_path):
    path = tmp_path / "drive.toml"
    path.write_text("mine")
    status, _, err = command(capsys, "select", *ASKED, "-o", path)
    assert status == 2 and "exists; --overwrite replaces it" in err[0] and path.read_text() == "mine"
