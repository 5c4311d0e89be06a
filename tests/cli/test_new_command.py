"""`warpchain new` writes a drive file that is read, fits and passes `check`, from a size, teeth and centers."""

import math
import tomllib

import pytest
from command import refused
from command import run as command
from drives import of_long

from warpchain import load_drive, simulate
from warpchain.assembly import assemble
from warpchain.drive.catalogue import CHAINS
from warpchain.drive.json_schema import drive_schema, file_schema, schema_text
from warpchain.model import Model
from warpchain.model.power_rating import rated_power

TWO = ["--teeth", 19, 57, "--centers", 0, 0, 1.0, 0]
TIMING = ["--size", "06B", "--teeth", 19, 38, 38, "--centers", 0, 0, 0.062, 0.3, -0.062, 0.3]
NOTCHED = ["--size", "08B", "--teeth", 14, 13, 45, "--centers", 0, 0, -0.25, -0.1, -0.58, -0.03]


@pytest.mark.parametrize("words", [["--size", "16B", *TWO], TIMING, NOTCHED], ids=["two", "timing", "notched"])
def test_the_file_passes_check(capsys, tmp_path, words):
    path = tmp_path / "drive.toml"
    status, out, err = command(capsys, "new", path, *words)
    assert (status, err) == (0, []) and out[-1].startswith(f"written: {path}")
    assert command(capsys, "check", path)[0] == 0
    assert any(line.startswith("fit: ") for line in out)
    # without strain to what centers are rounded to, 1e-10 m on strands of some 0.1 m
    drive = load_drive(path)
    assert abs(assemble(drive).strain) < 1e-8 and drive.chain.links % 2 == 0
    assert {sprocket.name for sprocket in drive.sprockets} >= {"driver", "driven"}
    # the window, which is the latter half of the run, has all links pass the driver once
    driver = drive.sprockets[drive.driver]
    assert 0.5 * drive.run.duration >= drive.chain.links / driver.teeth * math.tau / Model(drive).driver_speed
    # and nothing but the last center moved, by less than a pitch
    asked = words[words.index("--centers") + 1 :]
    held = [x for sprocket in drive.sprockets for x in sprocket.center]
    assert held[:-2] == pytest.approx(asked[:-2], abs=0.0)
    assert math.dist(held[-2:], asked[-2:]) < drive.chain.pitch


@pytest.mark.parametrize("size", ["05B", "16B-3", "bush-7", *of_long("72B", "48A", "04C", "520")])
def test_sizes_of_every_kind_do(capsys, tmp_path, size):
    """Centers at thirty pitches."""
    path = tmp_path / "drive.toml"
    words = ["--size", size, "--teeth", 17, 25, "--centers", 0, 0, 0, 30.0 * CHAINS[size].pitch]
    status, out, err = command(capsys, "new", path, *words)
    assert (status, err) == (0, []) and not [line for line in out if line.startswith(("LAYOUT", "LOOK AT"))]


def test_a_silent_drive_asks_for_nothing_of_rollers(capsys, tmp_path):
    path = tmp_path / "drive.toml"
    words = ["--size", "SC404", "--teeth", 17, 25, "--centers", 0, 0, 0, 0.381]
    status, out, err = command(capsys, "new", path, *words)
    assert (status, err) == (0, []) and not [line for line in out if line.startswith(("LAYOUT", "LOOK AT"))]
    contact = tomllib.loads(path.read_text())["contact"]["sprocket"]
    assert not contact.keys() & {"profile", "clearance", "seat_angle"} and "a free roller" not in path.read_text()
    drive = load_drive(path)
    assert drive.chain.is_silent and drive.chain.pitch == 0.0127 and abs(assemble(drive).strain) < 1e-8
    assert contact["width"] == pytest.approx(0.93 * 0.0254, rel=1e-2)


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["--teeth", 16, 25, "--centers", 0, 0, 0, 0.381], "--teeth 16: must be at least 17 with a silent chain"),
        (["--teeth", 17, 17, 17, 17, "--centers", 0, 0, 0, 0.5, 0.5, 0.5, 0.2, 0.3],
         "--centers: a silent chain must go around all sprockets the same way, on a convex polygon"),
    ],
)  # fmt: skip
def test_wheels_that_a_silent_chain_cannot_go_around_are_refused(capsys, tmp_path, words, line):
    assert refused(capsys, "new", tmp_path / "drive.toml", "--size", "SC404", *words) == f"warpchain: error: {line}"


def test_comments_say_what_is_an_estimate_and_values_what_was_asked(capsys, tmp_path):
    path = tmp_path / "drive.toml"
    words = ["--size", "16B", *TWO, "--speed", "300rpm", "--torque", 900]
    assert command(capsys, "new", path, *words)[0] == 0
    text = path.read_text()
    values = tomllib.loads(text)
    assert values["sprockets"][1]["load"]["torque"] == 900
    assert Model(load_drive(path)).driver_speed == pytest.approx(300 * math.pi / 30, rel=1e-6)
    for key in ("stiffness", "damping_ratio", "joint", "mass", "inertia", "clearance", "bush_stiffness", "friction"):
        (line,) = [line for line in text.splitlines() if line.startswith(f"{key} = ")]
        assert "# ESTIMATE" in line
    # a disk of steel: pi r^2 w rho, to two figures
    radius, width = 0.5 * 0.0254 / math.sin(math.pi / 57), 0.93 * 0.01702
    assert values["sprockets"][1]["mass"] == pytest.approx(7850 * math.pi * radius**2 * width, rel=0.05)
    assert file_schema(type(load_drive(path)), "")["properties"].keys() >= values.keys()
    assert "so that 118 links fit" in text


def test_a_chain_goes_the_other_way_around_a_notch(capsys, tmp_path):
    """Centers clockwise: sprockets turn so, but for one that stands inward of the line between its neighbors."""
    path = tmp_path / "drive.toml"
    words = ["--size", "08B", "--teeth", 17, 17, 17, 17, "--centers", 0, 0, 0, 0.5, 0.5, 0.5, 0.2, 0.3]
    assert command(capsys, "new", path, *words, "--keep-centers")[0] == 0
    assert [sprocket.wrap for sprocket in load_drive(path).sprockets] == ["cw", "cw", "cw", "ccw"]


def test_centers_can_be_kept(capsys, tmp_path):
    path = tmp_path / "drive.toml"
    status, out, _ = command(capsys, "new", path, "--size", "16B", *TWO, "--keep-centers")
    assert status == 0 and out[0] == "118 links"
    assert load_drive(path).sprockets[1].center == (1.0, 0.0) and "moved" not in path.read_text()


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_the_drive_runs(capsys, tmp_path):
    path = tmp_path / "drive.toml"
    assert command(capsys, "new", path, "--size", "06B", "--teeth", 15, 21, "--centers", 0, 0, 0.1, 0)[0] == 0
    metrics = simulate(load_drive(path), duration=0.05).metrics.to_pylist()[0]
    assert not metrics["diverged"] and 0.0 < metrics["tension_max"] < 8900.0
    # power of the driver over the rated power of its 15 teeth at that speed
    moment, speed = metrics["driver.moment_mean"], metrics["driver.speed_mean"]
    assert metrics["rated_use"] == pytest.approx(-moment * speed / rated_power("06B", 15, speed).least, rel=1e-12)


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["--size", "16b", *TWO], "--size 16b: not in the catalog; did you mean 16B?"),
        (["--size", "16B", "--teeth", 19, "--centers", 0, 0], "--teeth: must be at least two numbers"),
        (["--size", "16B", "--teeth", 19, 57, "--centers", 0, 0, 1], "--centers: must be X Y for each of the 2"),
        (["--size", "16B", "--teeth", 19, 57, "--centers", 0, 0, 0.1, 0], "pitch circles overlap"),
        (["--size", "16B", "--teeth", 19, 4, "--centers", 0, 0, 1, 0], "at least 5 teeth"),
        (["--size", "16B", *TWO, "--speed", 0], "a speed and a moment above 0"),
        (["--size", "16B", *TWO, "--torque", -1], "a speed and a moment above 0"),
        (["--size", "16B", "--teeth", 19, 57, "--centers", 0, 0, "x", 0], "'x' is not a number"),
    ],
)
def test_mistakes_are_one_line(capsys, tmp_path, words, line):
    assert line in refused(capsys, "new", tmp_path / "drive.toml", *words)
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_is_there_stays(capsys, tmp_path):
    path = tmp_path / "drive.toml"
    path.write_text("mine")
    status, _, err = command(capsys, "new", path, "--size", "16B", *TWO)
    assert status == 2 and "exists; --overwrite replaces it" in err[0] and path.read_text() == "mine"
    assert command(capsys, "new", path, "--size", "16B", *TWO, "--overwrite")[0] == 0


def test_editors_find_the_schema_beside_the_file(capsys, tmp_path):
    path, schema = tmp_path / "drive.toml", tmp_path / "drive.schema.json"
    words = ["new", path, "--size", "16B", *TWO]
    assert command(capsys, *words)[0] == 0
    assert path.read_text().startswith("#:schema ./drive.schema.json\n# ")
    assert schema.read_text() == schema_text(drive_schema())
    schema.write_text("{}")
    path.unlink()
    assert command(capsys, *words)[0] == 0 and schema.read_text() == "{}"  # a file that is there stays
    assert command(capsys, *words, "--overwrite")[0] == 0 and schema.read_text() == schema_text(drive_schema())
