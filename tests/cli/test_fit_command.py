"""`warpchain fit` says what was asked for and cannot be had."""

import pytest
from command import refused, run
from drives import timing, two_sprockets

from warpchain.drive import load_drive, save_drive


@pytest.fixture
def file(tmp_path):
    """Writes the timing drive with some values changed; 106 links leave its arm at 0.75 degrees, 108 at -4.72."""

    def write(**changes):
        path = tmp_path / "drive.toml"
        save_drive(timing(**changes), path)
        return path

    return write


def looks(lines):
    return [line for line in lines if line.startswith(("LOOK AT", "LAYOUT"))]


def test_an_angle_that_no_number_of_links_gives_is_refused(file, capsys):
    # between stops of 1 and 3 degrees all numbers of links leave the arm on the lower one; the file stays as it was
    path = file(**{"arms.arm.stops": [1.0, 3.0]})
    before = path.read_text()
    line = refused(capsys, "fit", path, "--links", "--angle", 2)
    assert 'chain.links: no number of links gives 2 degrees of arm "arm": with 106 "arm" stands at 0.9997, on' in line
    assert path.read_text() == before
    status, out, _ = run(capsys, "fit", path, "--links", "--angle", 1)  # the stop itself can be had, and is told
    assert status == 0 and looks(out)[0].startswith("LAYOUT: arms.arm: stands on its lower stop")


def test_an_angle_that_links_come_only_near_is_told(file, capsys):
    status, out, _ = run(capsys, "fit", file(), "--links", "--angle", -3)
    assert status == 0 and out[0] == "nothing changed: as it is, it is the nearest to what was asked"
    (line,) = looks(out)
    assert line.startswith("LOOK AT arms.arm: stands at -4.721 degrees, where -3 was asked: --sprocket with --angle")
    status, out, _ = run(capsys, "fit", file(), "--links", "--angle", -4.5)  # a fifth of a degree is near
    assert status == 0 and looks(out) == []


def test_a_chain_that_breaks_at_assembly_is_told(file, capsys):
    # 106 links leave the arm nearest to 1 degree, at a strain of 2.56 %: k p of that is the preload
    path = file()
    status, out, _ = run(capsys, "fit", path, "--links", "--angle", 1)
    drive = load_drive(path)
    assert status == 0 and drive.chain.links == 106
    (line,) = looks(out)
    assert line.startswith("LOOK AT chain: strain +2.56 % at assembly, a preload of 3657 N, where chains break at")
    assert line in run(capsys, "check", path)[1]


def test_sags_are_those_that_check_shows(tmp_path, capsys):
    """Beside an idler the strands differ in length: free sprockets turn until tensions are equal."""
    path = tmp_path / "drive.toml"
    words = ["--size", "08B", "--teeth", 19, 17, 38, "--centers", 0, 0, 0.35, 0.15, 0.7, 0]
    assert run(capsys, "new", path, *words)[0] == 0
    status, out, _ = run(capsys, "fit", path, "--sprocket", "idler", "--along", "0,1", "--sag", 0.002)
    free, held = (line for line in out if line.startswith("sag "))
    assert status == 0 and held.startswith("sag while all sprockets are held, as --sag means it: driver->idler ")
    assert held.endswith("driven->driver 2 mm")
    (checked,) = [line for line in run(capsys, "check", path)[1] if line.startswith("sag: ")]
    strand, sag = checked.removeprefix('sag: slack strand "').split(" mm at rest")[0].split('", ')
    assert f"{strand} {sag} mm" in free and f"{strand} {sag} mm" not in held


@pytest.mark.parametrize("name", ["hoist", "bucket_elevator", "v6"])
def test_sags_of_open_upright_and_several_chains(tmp_path, capsys, name):
    """Of an open chain the strands, of an upright one next to nothing, of several each chain behind its name."""
    words = ["--links", *(["--chain", "left"] if name == "v6" else [])]
    status, out, _ = run(capsys, "fit", name, "-o", tmp_path / "drive.toml", *words)
    assert status == 0 and any("sag at rest, as check has it: " in line for line in out)


def test_links_without_an_arm_tell_it_too(tmp_path, capsys):
    # two sprockets of 20 teeth 20.3 pitches apart: 60 links are taut by 0.3 / 20, odd numbers are not asked for
    path = tmp_path / "drive.toml"
    save_drive(two_sprockets(links=60, span=20.3), path)
    status, out, _ = run(capsys, "fit", path, "--links")
    (line,) = looks(out)
    assert status == 0 and line.startswith("LOOK AT chain: strain +1.50 % at assembly")


def test_a_file_written_elsewhere_stands_alone_and_keeps_units(tmp_path, capsys):
    """The CSV file is beside the first drive file; a center in mm is written in mm."""
    given, other = tmp_path / "drive.toml", tmp_path / "elsewhere" / "drive.toml"
    other.parent.mkdir()
    save_drive(two_sprockets(links=60, span=20.3), given)
    (tmp_path / "load.csv").write_text("time,torque\n0,0\n0.1,5\n")
    drive = load_drive(given)
    x = drive.sprockets[1].center[0]
    text = given.read_text().replace(f"center = [{x}", f'center = ["{1e3 * x:.10g} mm"')
    head, mark, rest = text.partition('name = "driven"')
    text = head + mark + rest.replace("load = {", 'load = { table = { file = "load.csv" },', 1)
    assert '"load.csv"' in text and " mm" in text
    given.write_text("# ours\n" + text)
    assert run(capsys, "fit", given, "-o", other, "--sprocket", "driven", "--along", "1,0", "--strain", 0)[0] == 0
    written = other.read_text()
    assert written.startswith("# ours\n") and ' mm"' in written and "load.csv" not in written
    moved, was = load_drive(other), load_drive(given)
    assert moved.sprockets[1].load == was.sprockets[1].load and moved.sprockets[1].center[0] != x
