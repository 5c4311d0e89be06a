"""The drive as data: reading, writing, value semantics, and the document of its file."""

import copy
import math
import pickle
import re
import subprocess
import sys
from pathlib import Path

import pytest
from drives import BLADE, MARINE, errors_of, example, put

from warpchain.drive import Drive, Load, dumps_drive, load_drive, loads_drive, save_drive
from warpchain.drive.schema import Part
from warpchain.errors import DriveError
from warpchain.model import single_chain
from warpchain.model.parts_between_chains import LedSprocket, SprocketShaft

DOCS = Path(__file__).parents[2] / "docs"


def test_marine_file_loads_as_it_stands(marine):
    assert [s.name for s in marine.sprockets] == ["crankshaft", "tightener", "camshaft"]
    assert [s.sign for s in marine.sprockets] == [1, -1, 1]
    assert (marine.chain.links, marine.chain.mass, marine.chain.link_damping) == (162, 6.95, 1.0e5)
    assert marine.sprockets[2].load == Load(
        torque=9000.0, viscous=50.0, ramp_time=0.3, harmonics=[{"order": 6, "amplitude": 2500.0}]
    )
    assert marine.run.settle is True and marine.run.integrator == "leapfrog"
    assert marine.driver == 0
    assert marine.strand_names == ("crankshaft->tightener", "tightener->camshaft", "camshaft->crankshaft")


def test_derived_geometry(marine):
    assert single_chain(marine).pitch_radius(1) == pytest.approx(0.1143 / (2 * math.sin(math.pi / 25)), rel=1e-15)
    assert single_chain(marine).seat_angle(1) == pytest.approx(math.radians(138.0), rel=1e-15)
    assert single_chain(marine).tip_radius(1) == pytest.approx(
        single_chain(marine).pitch_radius(1) + 0.1143 / 2 - 0.0362, rel=1e-15
    )
    other = marine.with_values({"sprockets.tightener.pitch": 0.115, "contact.sprocket.seat_angle": None})
    assert single_chain(other).pitch_radius(1) == pytest.approx(0.115 / (2 * math.sin(math.pi / 25)), rel=1e-15)
    assert single_chain(other).seat_angle(0) == pytest.approx(math.radians(140 - 90 / 57), rel=1e-15)
    assert single_chain(other).tip_radius(1) - single_chain(other).pitch_radius(1) == pytest.approx(
        0.1143 / 2 - 0.0362, rel=1e-12
    )


def test_resolved_mass_and_damping(marine):
    chain = marine.with_values({"chain.mass_per_length": 60.8, "chain.damping_ratio": 0.1}).chain
    assert chain.mass == pytest.approx(60.8 * 0.1143, rel=1e-15)
    assert chain.link_damping == pytest.approx(0.2 * math.sqrt(1.5e9 * 60.8 * 0.1143), rel=1e-15)


def test_text_reads_back_equal_and_needs_no_defaults(marine):
    text = dumps_drive(marine)
    assert loads_drive(text) == marine
    assert 'integrator = "leapfrog"' in text  # defaults stay with the file
    assert dumps_drive(loads_drive(text)) == text


@pytest.mark.parametrize("drive", [example("marine"), loads_drive(BLADE)], ids=["marine", "blade"])
def test_save_replaces_whole_and_leaves_nothing_behind(drive, tmp_path):
    path = tmp_path / "my drive.toml"
    path.write_text("old")
    save_drive(drive, path)
    again = load_drive(path)
    assert again == drive and hash(again) == hash(drive) and again is not drive
    assert pickle.loads(pickle.dumps(drive)) == copy.deepcopy(drive) == drive
    assert list(tmp_path.iterdir()) == [path]


def test_files_that_cannot_be_written_or_read_are_one_line(marine, tmp_path):
    absent, latin = tmp_path / "none" / "x.toml", tmp_path / "latin.toml"
    latin.write_bytes(b'[chain]\nname = "\xe4"\n')
    for call, line in (
        (lambda: save_drive(marine, absent), f"{absent}: cannot be written: no such file or directory"),
        (lambda: load_drive(absent), f"{absent}: cannot be read: no such file or directory"),
        (lambda: load_drive(latin), f"{latin}: not TOML: byte 16 is not UTF-8"),
    ):
        with pytest.raises(DriveError) as caught:
            call()
        assert caught.value.errors == (line,)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("[chain]\npitch = 0.1.2\n", "x.toml: line 2, column 12: not TOML: "),
        ("[chain]\npitch =", "x.toml: end of document: not TOML: "),
        ("[chain]\npitch = 1\npitch = 2\n", "x.toml: line 3, column 10: not TOML: "),
        ("a = " + "9" * 5000, "x.toml: not TOML: "),
        ("a = " + "[" * 100_000, "x.toml: not TOML that can be read: nested too deeply"),
    ],
)
def test_what_is_not_toml_is_one_line_with_its_place(text, line):
    with pytest.raises(DriveError) as caught:
        loads_drive(text, "x.toml")
    assert len(caught.value.errors) == 1
    assert caught.value.errors[0].startswith(line)


def test_byte_order_mark_and_windows_line_ends_are_fine(marine, tmp_path):
    path = tmp_path / "windows.toml"
    path.write_bytes(b"\xef\xbb\xbf" + MARINE.read_bytes().replace(b"\n", b"\r\n"))
    assert load_drive(path) == marine


def test_value_semantics(marine):
    assert marine.with_values({"chain.links": 164}) != marine
    with pytest.raises(ValueError, match="frozen"):
        marine.chain.links = 3


def test_errors_can_be_pickled(values):
    put(values, "chain/pitch", -1)
    with pytest.raises(DriveError) as caught:
        Drive(**values)
    assert pickle.loads(pickle.dumps(caught.value)).errors == caught.value.errors


def parts(cls=Part):
    """All classes of parts of a drive that files hold."""
    own = {cls} if cls.__module__.startswith("warpchain.drive") and cls not in (LedSprocket, SprocketShaft) else set()
    return {inner for sub in cls.__subclasses__() for inner in parts(sub)} | own


@pytest.mark.parametrize(
    ("document", "names", "pieces"),
    [("drive-file.md", ["motor", "fan"], [1]), ("guides-and-tensioners.md", ["crank", "cam"], [3, 2])],
)
def test_document_has_an_example_that_loads(document, names, pieces):
    text, *shorter = re.findall(r"```toml\n(.*?)```", (DOCS / document).read_text(), re.DOTALL)
    drive = loads_drive(text)
    assert all(len(loads_drive(short).sprockets) == 2 for short in shorter)
    assert [sprocket.name for sprocket in drive.sprockets] == names
    assert [len(single_chain(drive).profile(g).face) for g in range(len(drive.guides))] == pieces
    assert loads_drive(dumps_drive(drive)) == drive


def test_document_names_every_key_with_its_default():
    text = (DOCS / "drive-file.md").read_text()
    for part in parts():
        for key, field in part.model_fields.items():
            rows = [line for line in text.splitlines() if line.startswith("|") and f"`{key}`" in line]
            assert rows or re.search(rf"`{key}`|\[{key}[].]|\.{key}\]", text), (part, key)
            if key == "teeth":  # needed but for an end, which has none
                continue
            if rows and not field.is_required() and field.default in (0.0, 1.0) and not isinstance(field.default, bool):
                assert any(f"| {field.default:g} |" in row for row in rows), (part, key)


def test_document_quotes_errors_as_they_are(values):
    put(values, "chain/roller_mass", None)
    put(values, "chain/rollermass", 6.95)
    put(values, "sprockets/2/teeth", 3)
    found = sorted(f"mine.toml: {line}" for line in errors_of(values))
    assert sorted(re.findall(r"^mine\.toml: .*$", (DOCS / "drive-file.md").read_text(), re.MULTILINE)) == found


def test_import_needs_nothing_heavy():
    code = "import sys, warpchain.drive; print(*(m for m in ('warp', 'scipy', 'numpy', 'pyarrow') if m in sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""
