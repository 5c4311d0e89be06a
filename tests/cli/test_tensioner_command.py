"""`warpchain tensioner`: what it prints, writes and refuses."""

import numpy as np
import pyarrow.csv
import pyarrow.parquet
import pytest
from command import refused
from command import run as command
from tensioner_rig import TEXT

from warpchain import bench_tensioner, load_drive
from warpchain.results.arrow_tables import table_without_unit_heads

HEATED, OIL = ["element", "--sweep", "temperature"], "tensioners.element.oil"


@pytest.fixture
def path(tmp_path):
    file = tmp_path / "drive.toml"
    file.write_text(TEXT)
    return file


def test_it_prints_the_last_cycle(capsys, path):
    status, out, err = command(capsys, "tensioner", path, "element", "--amplitude", "2e-4", "--frequency", "100")
    assert (status, err) == (0, [])
    table = bench_tensioner(load_drive(path), "element", amplitude=2e-4, frequency=100.0)
    force = np.asarray(table["force"])[-501:]
    assert out[0] == "100 Hz, 0.2 mm about 0 mm, oil of 80 mm\N{SUPERSCRIPT TWO}/s; cycle 10:"
    assert f"{force.min():.4g} to {force.max():.4g} N; work on the plunger" in out[1]
    assert "pressure" in out[2] and "opens 1 times" in out[3]


def test_a_spring_has_no_oil_to_tell_of(capsys, path):
    status, out, _ = command(capsys, "tensioner", path, "plain")
    assert status == 0 and len(out) == 2 and "oil" not in out[0]


@pytest.mark.parametrize("kind", ["png", "svg"])
@pytest.mark.parametrize(
    "words",
    [["element"], ["plain"], ["element", "--frequency", "10", "100", "--viscosity", "1e-5", "8e-5"]],
    ids=["one", "spring", "four"],
)
def test_it_draws_loops(capsys, path, tmp_path, kind, words):
    picture = tmp_path / f"loop.{kind}"
    status, out, err = command(capsys, "tensioner", path, *words, "--cycles", "2", "-o", picture)
    assert (status, err) == (0, []) and out[-1] == str(picture)
    assert picture.stat().st_size > 10_000


@pytest.mark.parametrize(
    "words",
    [["frequency", "--range", "5", "50", "--viscosity", "1e-5", "8e-5"], ["temperature", "--frequency", "50", "100"]],
    ids=["frequency", "temperature"],
)
def test_it_draws_sweeps(capsys, path, tmp_path, words):
    picture = tmp_path / "sweep.png"
    line = ["tensioner", path, "element", "--sweep", *words, "--points", "3", "--cycles", "2"]
    status, out, _ = command(capsys, *line, "-o", picture)
    assert status == 0 and picture.stat().st_size > 10_000
    assert len(out) == 2 * (2 + 3) + 1  # two curves: a name, a head and three lines each
    table = tmp_path / "sweep.csv"
    assert command(capsys, *line, "-o", table)[0] == 0
    found = pyarrow.csv.read_csv(table)
    assert len(found) == 6 and ("temperature [degC]" in found.column_names) == (words[0] == "temperature")


def test_it_writes_tables(capsys, path, tmp_path):
    wanted = bench_tensioner(load_drive(path), "element", amplitude=1e-4, frequency=50.0, cycles=2)
    for kind, read in (("csv", pyarrow.csv.read_csv), ("parquet", pyarrow.parquet.read_table)):
        file = tmp_path / f"ride.{kind}"
        words = ["--amplitude", "1e-4", "--frequency", "50", "--cycles", "2", "-o", file]
        assert command(capsys, "tensioner", path, "element", *words)[0] == 0
        found = table_without_unit_heads(read(file)) if kind == "csv" else read(file)
        assert found.column_names == wanted.column_names
        assert np.asarray(found["force"]) == pytest.approx(np.asarray(wanted["force"]), rel=1e-12)
        assert found.schema.field("force").metadata[b"unit"] == b"N"


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["nobody"], "tensioner 'nobody': allowed are element, plain"),
        (["element", "--amplitude", "0"], "--amplitude 0: must be a number above 0, at most 1 m"),
        (["element", "--amplitude", "x"], "'x' is not a number"),
        (["element", "--frequency", "nan"], "--frequency nan"),
        (["element", "--frequency", "1e300"], "--frequency 1e+300: must be from 0.0001 to 100000 Hz"),
        (["element", "--frequency", "1e-300"], "--frequency 1e-300: must be from 0.0001 to 100000 Hz"),
        (["element", "--cycles", "9999", "--frequency", "1", "2"], "2 rides of 9999 cycles: must be 10000"),
        ([*HEATED, "--set", f"{OIL}.viscosity=1e-7"], f"{OIL}.viscosity = 1e-07: must be from 2e-06 to 20 m^2/s"),
        (["element", "--cycles", "0"], "'0': must be a whole number above 0"),
        (["element", "--viscosity", "-1"], "--viscosity -1: must be"),
        (["element", "--viscosity", "1e308"], "--viscosity 1e+308: must be from 1e-08 to 20 m^2/s"),
        (["element", "--at", "-300"], "--at: only with --sweep temperature"),
        ([*HEATED, "--at", "-300"], "--at -300: must be a temperature"),
        (["plain", "--viscosity", "1e-5"], "tensioner 'plain' has no oil"),
        (["plain", "--sweep", "temperature"], "tensioner 'plain' has no oil"),
        (["element", "--sweep", "pressure"], "invalid choice"),
        (["element", "--range", "1", "2"], "--range: only with --sweep"),
        (["element", "--sweep", "frequency", "--range", "5", "1"], "--range 5 1: must be two frequencies above 0"),
        (["element", "--sweep", "frequency", "--range", "0", "1"], "--range 0 1: must be two frequencies above 0"),
        ([*HEATED, "--range", "20", "900"], "--range 20 900: must be two temperatures"),
        ([*HEATED, "--at", "900"], "--at 900: must be a temperature"),
        (["element", "--sweep", "frequency", "--points", "1"], "--points 1: must be 2 to 1000"),
        (["element", "--sweep", "frequency", "--points", "1001"], "--points 1001: must be 2 to 1000"),
        ([*HEATED, "--viscosity", "1e-5"], "--viscosity: not with --sweep temperature"),
        (["element", "-o", "loop.pdf"], "-o loop.pdf: must end in .png, .svg, .csv, .parquet"),
        (["element", "--frequency", "1", "2", "-o", "a.csv"], "-o a.csv: holds one ride, not 2"),
        (["element", "-o", "no/such/loop.png"], "no/such/loop.png"),
    ],
)
def test_mistakes_are_one_line(capsys, path, words, told):
    line = refused(capsys, "tensioner", path, *words)
    assert line.startswith("warpchain: error: ") and told in line
