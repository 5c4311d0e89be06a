"""Mistakes of users, refusals of machines and attacks, on the command line: one line, exit status 2, at once."""

import datetime
import os
import re
import resource
import struct
import subprocess
import sys
import time
import zlib

import lz4.frame
import numpy as np
import pyarrow as pa
import pytest
import zstandard
from command import refused as refusal
from command import run as command
from drives import BLADE, of_long, two_sprockets
from parts import part, shaft
from pyarrow import parquet
from small_disk import small_disk
from study_helpers import write_study

from warpchain import Record, read_archive, simulate, write_archive
from warpchain.archive import ArchiveOptions, mcap_write
from warpchain.archive import archive_parts as parts
from warpchain.archive.export import TRAJECTORY_WRITERS
from warpchain.archive.mcap_read import MOST_CHUNK_BYTES, McapIndex
from warpchain.archive.mcap_write import McapWriter, PackedChunk
from warpchain.archive.untrusted_arrow import ARROW_MAGIC, table_from_untrusted_bytes
from warpchain.drive import dumps_drive
from warpchain.errors import ArchiveError, StudyError, WarpchainError
from warpchain.study.spec.factor import Factor
from warpchain.study.spec.noise_table import factor_with_sample

SMALL = ["--set", "run.settle=false", "--set", "run.duration=0.0005", "--quiet"]


@pytest.fixture(scope="module")
def run():
    return simulate(two_sprockets(duration=0.001, settle="false"), record=Record(rate=2e4))


@pytest.fixture
def archive(run, tmp_path):
    return write_archive(run, tmp_path / "a.mcap")


def refused(capsys, *words, limit=30.0):
    """The one line that a command is refused with, at once."""
    begin = time.perf_counter()
    line = refusal(capsys, *words)
    assert time.perf_counter() - begin < limit
    assert line.startswith("warpchain: error: ")
    return line


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--duration", "50000"], "allowed are at most 2147483646"),
        (["--duration", "1e308"], "allowed are at most 2147483646"),
        (["--step", "1e-300"], "allowed are at most 2147483646"),
        (["--rate", "1e-6"], "--rate 1e-06 Hz"),
        (["--rate", "1e-300"], "--rate 1e-300 Hz"),
        (["--set", "run.duration=" + "9" * 5000], "run.duration"),
        (["--set", "sprockets." + "9" * 5000 + ".teeth=20"], "unknown path"),
        (["--memory", "1e300"], "must be a finite number above 0 (GiB)"),
        (["--split-size", "1e304"], "must be a finite number above 0 (MiB)"),
        (["--set", "sprockets.0.center=[1e8, 0.0]"], "must be within 10000 m of the origin"),
        (["--set", "sprockets.0.center=[1e300, 0.0]"], "must be within 1e+30 of 0"),
        (["--set", "sprockets.0.center=[1e30, 1e30]"], "must be within 10000 m of the origin"),
        (["--set", "guides.0.offset=1e300"], "guides.tight strand.offset = 1e+300: must be within 1e+30 of 0"),
    ],
)
def test_numbers_beyond_all_bounds(capsys, tmp_path, words, told):
    assert told in refused(capsys, "run", "marine", "-o", tmp_path / "a.mcap", "--quiet", *words)
    assert list(tmp_path.iterdir()) == []


def writing(verb, archive, target):
    """The words of a command that writes `target`."""
    words = {"run": ["run", "marine", *SMALL, "-o"], "view": ["view", archive, "--save"]}
    return [*words.get(verb, [verb, archive, "-o"]), target]


@pytest.mark.parametrize("kind", ["pipe", "nowhere", "folder", "/dev/null", "absent/a"])
@pytest.mark.parametrize("verb", ["run", "export", "view", "recover"])
def test_an_output_that_is_no_file_is_refused_and_stays(capsys, archive, tmp_path, kind, verb):
    ending = {"export": ".npz", "view": ""}.get(verb, ".mcap")
    target = tmp_path / (kind if kind.startswith("/") else f"{kind}{ending}")
    if kind == "pipe":
        os.mkfifo(target)
    elif kind == "nowhere":
        target.symlink_to(tmp_path / "gone" / "a")
    elif kind == "folder":
        target.mkdir()
    before = target.lstat() if target.is_symlink() or target.exists() else None
    refused(capsys, *writing(verb, archive, target), *(["--overwrite"] if verb in ("run", "recover") else []))
    if before is not None:
        after = target.lstat()
        assert (after.st_mode, after.st_ino) == (before.st_mode, before.st_ino)


@pytest.mark.parametrize("verb", ["run", "recover"])
def test_an_archive_is_written_to_an_archive_s_name_alone(capsys, archive, tmp_path, verb):
    line = refusal(capsys, *writing(verb, archive, tmp_path / "a.txt"))
    assert f"'{tmp_path}/a.txt': must end in .mcap" in line


@pytest.mark.parametrize("kind", ["pipe", "/dev/zero", "large"])
@pytest.mark.parametrize("verb", ["check", "study plan", "view", "recover", "import"])
def test_an_input_that_has_no_end_is_refused_at_once(capsys, archive, tmp_path, kind, verb):
    source = tmp_path / kind
    if kind == "pipe":
        os.mkfifo(source)
    elif kind == "large":
        source.touch()
        os.truncate(source, 2**40)
    more = {
        "view": ["--save", "x.rrd"],
        "recover": ["-o", "x.mcap"],
        "import": [archive, "--as", "driver->driven.tension"],
    }
    line = refused(capsys, *verb.split(), source, *more.get(verb, []))
    assert re.search("cannot be read|is not an MCAP file", line)


@pytest.mark.parametrize("verb", ["view", "export", "recover", "plot"])
def test_a_full_disk_is_one_line_and_leaves_nothing(capsys, archive, tmp_path, verb):
    target = tmp_path / {"export": "new.npz", "recover": "new.mcap", "run": "new.mcap"}.get(verb, "new")
    with small_disk(20_000):
        line = refused(capsys, *writing(verb, archive, target), limit=60.0)
    assert "cannot be written (File too large)" in line
    assert [file.name for file in tmp_path.rglob("*") if file.is_file()] == ["a.mcap"]


@pytest.mark.parametrize("ending", sorted(TRAJECTORY_WRITERS))
def test_a_full_disk_is_one_line_in_every_format(capsys, archive, tmp_path, ending):
    """A library that writes by itself must not end the process, nor show its own words."""
    with small_disk(2_000):
        line = refused(capsys, "export", archive, "-o", tmp_path / f"new{ending}", limit=60.0)
    assert f"new{ending}: cannot be written (File too large)" in line
    assert [file.name for file in tmp_path.rglob("*") if file.is_file()] == ["a.mcap"]


def test_a_viewer_without_a_display_says_what_to_do(capsys, archive, monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    line = refused(capsys, "view", archive)
    assert "--web for a browser, --save OUT.rrd for a file" in line


@pytest.mark.parametrize("verb", ["view", "export", "recover", "run"])
def test_a_read_only_file_system_is_one_line(capsys, archive, tmp_path, monkeypatch, verb):
    """Nothing can be made there, nor removed while it is cleaned up."""
    plain = os.open

    def refuse(*_, **__):
        raise OSError(30, "Read-only file system")

    def read_only(path, flags, *more, **named):
        ours = flags & os.O_CREAT and str(path).startswith(str(tmp_path))
        return (refuse if ours else plain)(path, flags, *more, **named)

    monkeypatch.setattr(os, "open", read_only)
    monkeypatch.setattr(os, "unlink", refuse)
    target = tmp_path / {"export": "new.npz", "recover": "new.mcap", "run": "new.mcap"}.get(verb, "new")
    assert "(Read-only file system)" in refused(capsys, *writing(verb, archive, target))


@pytest.mark.parametrize("words", [["check", "marine"], ["chains"], ["--version"], ["check", "marine", "--json"]])
def test_output_on_a_full_device_is_one_line(words):
    with open("/dev/full", "w") as full:
        done = subprocess.run([sys.executable, "-m", "warpchain", *words], stdout=full, stderr=-1, text=True)
    assert done.stderr == "warpchain: error: No space left on device\n"
    assert done.returncode == 2


def test_a_reader_that_has_gone_is_no_error():
    command = f"{sys.executable} -m warpchain check marine | true; exit ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", command], stderr=-1, text=True)
    assert done.stderr == ""
    assert done.returncode in (0, 1)


def test_faults_of_native_code_are_told():
    code = "import faulthandler; from warpchain import cli; cli.main(['chains']); print(faulthandler.is_enabled())"
    done = subprocess.run([sys.executable, "-c", code], stdout=-1, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "True"


def written(path, run, change):
    """An archive that some other program made, whose parts are right but for what `change` does to the writer."""
    with pytest.MonkeyPatch.context() as patch:
        change(patch)
        parts.ArchiveParts(path, run.drives, [0], run.info, ArchiveOptions(), True, False).finish_archive(
            run.metrics, run.info
        )
    return path


@pytest.mark.parametrize(("compression", "encode"), [("zstd", zstandard.compress), ("lz4", lz4.frame.compress)])
@pytest.mark.parametrize("size", [0, 2**10, 2**32])
def test_a_small_file_that_opens_to_gigabytes_is_refused(tmp_path, compression, encode, size):
    """Whatever it says of its size: at most that is ever made, and at most the cap of chunks."""
    data = encode(bytes(2**30 if size == 2**32 else 2**26))
    file = McapWriter(tmp_path / "b.mcap", "test")
    file.add_schema(1, "s", "", b"")
    file.add_channel(1, 1, "/a", "", {})
    file.add_chunk(PackedChunk(compression, data, size, 0, 0, 0, {1: np.zeros((1, 2), dtype=np.uint64)}))
    file.finish_file()
    index = McapIndex(tmp_path / "b.mcap")
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(ArchiveError, match="is damaged"):
        index.read_chunk(index.chunks[0])
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 2**20 // 8  # kilobytes: 128 MiB
    assert MOST_CHUNK_BYTES == 2**28


@pytest.mark.parametrize("variants", ["0", "-1", "9" * 30, "x"])
def test_wrong_numbers_of_variants(run, tmp_path, variants):
    def change(patch):
        plain = mcap_write.McapWriter.add_metadata
        other = lambda held: held | {"variants": variants} if "variants" in held else held  # noqa: E731
        patch.setattr(mcap_write.McapWriter, "add_metadata", lambda self, name, held: plain(self, name, other(held)))

    with pytest.raises(ArchiveError) as caught:
        read_archive(written(tmp_path / "b.mcap", run, change))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("key", "value"), [("precision", "float16"), ("values", "V9"), ("channels", "mass mass")])
def test_wrong_metadata_of_a_channel(run, tmp_path, key, value):
    plain = mcap_write.McapWriter.add_channel
    with pytest.MonkeyPatch.context() as patch:
        other = lambda *words: plain(*words[:-1], words[-1] | ({key: value} if words[-1] else {}))  # noqa: E731
        patch.setattr(mcap_write.McapWriter, "add_channel", other)
        path = write_archive(run, tmp_path / "b.mcap")
    with pytest.raises(ArchiveError, match="has wrong metadata"):
        read_archive(path)[0]


def resealed(data, place, new):
    """A file with other bytes in its summary, whose checksum is right again."""
    start = int.from_bytes(data[-28:-20], "little")
    damaged = bytearray(data)
    damaged[place : place + len(new)] = new
    damaged[-12:-8] = struct.pack("<I", zlib.crc32(damaged[start:-12]))
    return bytes(damaged)


def test_every_number_of_a_summary_made_huge(run, archive, tmp_path):
    """Offsets and lengths of 2^63 and more, and topics of variants that are not there."""
    data = archive.read_bytes()
    start = int.from_bytes(data[-28:-20], "little")
    rng = np.random.default_rng(5)
    told = 0
    for place in rng.choice(np.arange(start, len(data) - 37), 150, replace=False):
        (tmp_path / "b.mcap").write_bytes(resealed(data, place, b"\xff" * 8))
        try:
            back = read_archive(tmp_path / "b.mcap")
            for variant in back:
                np.testing.assert_array_equal(back[variant].position, run[0].position)
        except WarpchainError as error:
            assert "\n" not in str(error)
            told += 1
    assert told > 20
    topic = data.rindex(b"/variant/00000/rollers")
    (tmp_path / "b.mcap").write_bytes(resealed(data, topic, b"/variant/00007/rollers"))
    with pytest.raises(WarpchainError):
        read_archive(tmp_path / "b.mcap")[0]


def test_a_damaged_table_of_metrics(run, tmp_path):
    """Where the attachment's checksum is right, the table may still be anything."""
    plain, rng, told = parts._arrow_bytes(run.metrics), np.random.default_rng(6), 0
    for _ in range(150):
        data = bytearray(plain)
        data[rng.integers(len(data))] ^= 1 << rng.integers(8)
        path = tmp_path / "b.mcap"
        written(path, run, lambda patch, data=bytes(data): patch.setattr(parts, "_arrow_bytes", lambda table: data))
        try:
            read_archive(path).metrics.to_pylist()
        except ArchiveError as error:
            assert "\n" not in str(error)
            told += 1
    assert told > 30


BOMB = """
import sys, pyarrow as pa
kind, path = sys.argv[1:]
words = pa.dictionary(pa.int32(), pa.string()) if kind == "dictionary" else pa.string()
schema = pa.schema([("variant", pa.int64()), ("status", words)])
columns = [pa.array([0]), pa.array(["x" * 2**29])]
if kind == "dictionary":
    columns[1] = columns[1].dictionary_encode()
options = pa.ipc.IpcWriteOptions(compression="lz4" if kind == "lz4" else "zstd")
with pa.OSFile(path, "wb") as sink, pa.ipc.new_file(sink, schema, options=options) as file:
    file.write_table(pa.table(columns, schema=schema))
"""
"""Writes half a gigabyte of one letter, in some 50 kB."""


@pytest.mark.parametrize("kind", ["zstd", *of_long("lz4", "dictionary")])
def test_a_small_table_of_metrics_that_opens_to_gigabytes_is_refused(run, tmp_path, kind):
    """Its columns' sizes are Arrow's to open; warpchain's own have no compression."""
    subprocess.run([sys.executable, "-c", BOMB, kind, tmp_path / "bomb"], check=True)
    data = (tmp_path / "bomb").read_bytes()
    assert len(data) < 2**22
    path = written(tmp_path / "b.mcap", run, lambda patch: patch.setattr(parts, "_arrow_bytes", lambda table: data))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(ArchiveError, match=r"its metrics are damaged .its columns are compressed"):
        read_archive(path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 2**20 // 8  # kilobytes: 128 MiB


def test_columns_that_share_their_bytes_are_refused():
    """Thirty columns in the place of two: a small file of many more would keep its reader busy for long."""
    table = pa.table({f"c{k}": np.zeros(1000) for k in range(30)})
    sink = pa.BufferOutputStream()
    with pa.ipc.new_file(sink, table.schema) as file:
        file.write_table(table)
    data = sink.getvalue().to_pybytes()
    assert table_from_untrusted_bytes(data).equals(table)
    schema, batch = list(pa.ipc.MessageReader.open_stream(pa.py_buffer(data)[len(ARROW_MAGIC) :]))
    head = batch.metadata.to_pybytes().replace(struct.pack("<q", 240_000), struct.pack("<q", 16_000))
    for k in range(2, 30):
        place = struct.pack("<qq", 8000 * k, 8000)
        assert head.count(place) == 1
        head = head.replace(place, struct.pack("<qq", 0, 8000))
    told = struct.pack("<iI", -1, len(head)) + head + batch.body.to_pybytes()[:16_000] + struct.pack("<ii", -1, 0)
    with pytest.raises(ValueError, match="share bytes"):
        table_from_untrusted_bytes(ARROW_MAGIC + schema.serialize().to_pybytes() + told)


FACTORIAL, TWO_LEVEL, LEVELS = 'kind = "factorial"', 'kind = "plackett-burman"', "levels = [44, 45]"
MASS = '[[factors]]\nname = "mass"\npath = "chain.roller_mass"\nchoice = 0'
STUDIES = {
    "name-list": ('name = "torque"', "name = []", "factor 1: name"),
    "channels": ("[run]", "[record]\nevery = 1\nchannels = 1.0\n[run]", "record.channels"),
    "center": (FACTORIAL, f"{TWO_LEVEL}\ncenter = 1000000000", "allowed are at most"),
    "choice": (LEVELS, "choice = 0", "must be a list of at least 2"),
    "choice of two-level designs": (FACTORIAL, f"{TWO_LEVEL}\n{MASS}", "choice = 0: must be a list of at least 2"),
    "group": (LEVELS, "levels = [44, 45]\ngroup = []", "factors.1.group|factors.links.group"),
    "count": (FACTORIAL, 'kind = "sobol"\ncount = 1000000000', "at most 100000000"),
    "a text and a number": (LEVELS, "expression = \"44 + 'x'\"", None),
    "a list and a number": (LEVELS, 'expression = "[1] + 44.0"', "only numbers"),
    "numbers and switches": (LEVELS, 'expression = "44 if torque > 0.5 else torque > 0.5"', "several kinds"),
    "power": ('path = "chain.links"\nlevels = [44, 45]', 'path = "chain.links"\nexpression = "10000**16"', None),
    "kinds": (LEVELS, "choice = [44, true]", "of one kind"),
    "zero": ('drive = "tiny.toml"', 'drive = "a\\u0000b.toml"', "zero byte|null byte|must be"),
    "factors": (
        "[run]",
        999 * f"{MASS.replace('0', '[6, 7]')}\n" + "[run]",
        "factors: 1001 of them; must be at most 1000",
    ),
    "digits": ("duration = 0.0005", "duration = " + "9" * 5000, "TOML"),
}


@pytest.mark.parametrize("case", STUDIES)
def test_study_files_that_make_no_sense(capsys, tmp_path, case):
    source, (old, new, told) = write_study(tmp_path, points=2), STUDIES[case]
    assert old in source.read_text()
    text = source.read_text().replace(old, new, 1)
    source.write_text(text.replace("points = 2\n", "") if "factorial" not in text else text)
    status, out, err = command(capsys, "study", "run", source, "-o", tmp_path / "out", "--quiet")
    if told is None:  # a row that makes no drive is infeasible, with its reason
        assert (status, err) == (1, [])  # no row is ok
        assert "4 infeasible" in out[0] or "2 infeasible" in out[0]
    else:
        assert status == 2 and all(line.startswith("warpchain: error: ") for line in err)
        assert re.search(told, "\n".join(err))


def test_a_study_of_22000_factors_is_refused_at_once(capsys, tmp_path):
    factor = '[[factors]]\nname = "f{}"\npath = "chain.roller_mass"\nrange = [1.0, 2.0]\n'
    source = write_study(tmp_path, "".join(factor.format(k) for k in range(22_000)))
    told = f"warpchain: error: {source}: factors: 22002 of them; must be at most 1000"
    assert refused(capsys, "study", "plan", source, limit=30.0) == told


TABLES = {
    "mixed": ("torque,links\n1.0,44\nx,45\n", 'sprockets.s1.load.torque = "x": must be a finite number'),
    "huge": ("torque,links\n1.0," + "9" * 40 + "\n", "chain.links = 1e+40: must be an integer"),
    "cell": ("torque,links\n" + "x" * 200_000 + ",44\n", " ...: must be a finite number"),
    "zero": ("torque,links\n1.0,4\x004\n", "must be an integer"),
    "list": ("torque,links\n[1],44\n", 'sprockets.s1.load.torque = "[1]": must be a finite number'),
}
"""Rows that make no drive are infeasible, each with its reason."""
REFUSED_TABLES = {
    "date": ("rows.csv", "torque,links\n2024-01-01,44\n2024-01-02,45\n", "column torque: holds date32"),
    "twice": (
        "rows.csv",
        "torque,links,torque\n1.0,44,2.0\n",
        "columns 1 and 3 are both named torque; rename or remove",
    ),
    "semicolons": ("rows.csv", "torque;links\n1;44\n", "'torque;links': cells are separated by commas, and numbers"),
    "commas": ("rows.csv", 'torque,links\n1.249,44\n"2,5",44\n', "column torque, row 1: '2,5': cells are separated"),
    "none": ("rows.csv", "", "not a table"),
    "dates": ("rows.parquet", [datetime.date(2024, 1, 1)] * 2, "column torque: holds date32"),
    "times": ("rows.parquet", [datetime.datetime(2024, 1, 1)] * 2, "column torque: holds timestamp"),
    "lists": ("rows.parquet", [[1.0], [2.0]], "column torque: holds list"),
    "tables": ("rows.parquet", [{"a": 1}] * 2, "column torque: holds struct"),
    "bytes": ("rows.parquet", [b"1", b"2"], "column torque: holds binary"),
    "nulls": ("rows.parquet", [None, None], "column torque, row 0: empty"),
}


def of_a_table(folder, name):
    """A study whose rows stand in a table."""
    source = write_study(folder)
    text = source.read_text().replace('kind = "factorial"', f'kind = "table"\nfile = "{name}"')
    source.write_text(text.replace("range = [0.0, 1.0]\npoints = 6\n", "").replace("levels = [44, 45]\n", ""))
    return source


@pytest.mark.parametrize("case", TABLES)
def test_rows_of_design_tables_that_make_no_sense(capsys, tmp_path, case):
    rows, told = TABLES[case]
    source = of_a_table(tmp_path, "rows.csv")
    (tmp_path / "rows.csv").write_text(rows)
    status, out, err = command(capsys, "study", "run", source, "-o", tmp_path / "out", "--quiet")
    assert (status, err) == (1, [])  # no row is ok
    assert f"{rows.count(chr(10)) - 1} infeasible" in out[0]
    assert any(told in line for line in out) and max(map(len, out)) < 1000


@pytest.mark.parametrize("case", REFUSED_TABLES)
def test_design_tables_that_make_no_sense(capsys, tmp_path, case):
    name, rows, told = REFUSED_TABLES[case]
    source = of_a_table(tmp_path, name)
    if name.endswith(".csv"):
        (tmp_path / name).write_text(rows)
    else:
        parquet.write_table(pa.table({"torque": rows, "links": [44, 45]}), tmp_path / name)
    assert told in refused(capsys, "study", "run", source, "-o", tmp_path / "out", "--quiet")


def test_small_tables_of_many_rows_are_refused_before_they_are_read(capsys, tmp_path, monkeypatch):
    """Equal rows take no room in Parquet; its footer says how many there are."""
    monkeypatch.setattr("warpchain.study.store.MOST_ROWS", 10**6)
    monkeypatch.setattr("pyarrow.parquet.ParquetFile.read", lambda *_: pytest.fail("it was read"))
    rows = 10**6 + 1
    parquet.write_table(pa.table({"torque": np.zeros(rows), "links": np.zeros(rows, int)}), tmp_path / "rows.parquet")
    assert (tmp_path / "rows.parquet").stat().st_size < 10**4
    told = "rows.parquet: 1000001 rows of 2 columns; allowed are at most 1000000 rows"
    assert told in refused(capsys, "study", "run", of_a_table(tmp_path, "rows.parquet"), "-o", tmp_path / "out")
    sample = Factor(name="k", path="x.k", kind="noise", distribution="empirical", file="rows.parquet", column="torque")
    with pytest.raises(StudyError, match=told):
        factor_with_sample(sample, tmp_path)


def with_table(tmp_path, table):
    """A drive file whose driver's speed is a CSV file."""
    text, led = dumps_drive(two_sprockets(duration=0.001, settle="false")), "{ speed = 10.0, ramp_time = 0.0 }"
    assert text.count(led) == 1
    (tmp_path / "t.csv").write_bytes(table)
    (tmp_path / "d.toml").write_text(text.replace(led, '{ table = { file = "t.csv" } }'))
    return tmp_path / "d.toml"


def test_a_table_of_a_drive_is_read(capsys, tmp_path):
    """The tables below differ from it by one cell."""
    status, _, err = command(capsys, "check", with_table(tmp_path, b"time,speed\n0,1\n1,2\n"))
    assert (status, err) == (0, [])


DIGITS = "line 3: is not CSV (field larger than field limit"
SPEEDS = {
    "131,073 digits": (b"time,speed\n0,1\n1," + b"1" * 131_073 + b"\n", DIGITS),
    "400 digits": (b"time,speed\n0,1\n1," + b"1" * 400 + b"\n", "line 3: "),  # a number, but not a finite one
    "head": (b"time," + b"s" * 200_000 + b"\n0,1\n1,2\n", "line 1: is not CSV"),
    "zero byte": (b"time,speed\n0,1\n1,2\0\n", "line 3: has a zero byte"),
    "zero byte in the head": (b"time,sp\0eed\n0,1\n1,2\n", "line 1: has a zero byte"),
    "zero": (b"\0", "line 1: has a zero byte"),
    "bytes": (b"time,speed\n0,1\n1,\xff\n", 'line 3: "ÿ" is not a finite number'),  # as Windows-1252
    "date": (b"time,speed\n0,1\n2024-01-01,2\n", '"2024-01-01" is not a finite number'),
    "empty": (b"", "must have a line of names and lines of numbers below it"),
}


@pytest.mark.parametrize(("table", "told"), SPEEDS.values(), ids=SPEEDS)
def test_tables_of_a_drive_that_make_no_sense(capsys, tmp_path, table, told):
    line = refused(capsys, "check", with_table(tmp_path, table))
    assert 'driver.prescribed.table.file = "t.csv": ' in line and told in line
    assert len(line) < 1000


FILE, SPRING = {"file": "t.csv"}, {"preload": 100.0, "stiffness": 2e4}
VALVES = part("valves", "inlets", on="driven", mass=0.1, spring=SPRING, table=FILE)
CRANK = shaft("crank", inertia=0.2, motor={"table": FILE})
ENGINES = {
    "lift jumps": (VALVES, "angle_deg,lift_mm\n0,0\n90,9\n180,9\n360,0\n", "jumps from 0; must change by at most"),
    "lift open": (VALVES, "angle_deg,lift_mm\n0,0\n90,1\n180,2\n360,1\n", "must repeat the first element, 0, where"),
    "lift short": (VALVES, "angle_deg,lift_mm\n0,0\n90,1\n180,2\n350,0\n", "spans 350 degrees of the cams' shaft"),
    "gas open": (CRANK, "angle_deg,torque\n0,0\n180,80\n720,5\n", "torque.2 = 5.0: must repeat the first element, 0"),
    "gas short": (CRANK, "angle_deg,torque\n0,0\n180,80\n700,0\n", "must be a whole number of revolutions"),
}  # fmt: skip


@pytest.mark.parametrize(("part", "table", "told"), ENGINES.values(), ids=ENGINES)
def test_lifts_and_gas_torques_that_make_no_sense(capsys, tmp_path, part, table, told):
    (tmp_path / "t.csv").write_text(table)
    (tmp_path / "d.toml").write_text(dumps_drive(two_sprockets()) + part)
    assert told in refused(capsys, "check", tmp_path / "d.toml")


@pytest.mark.parametrize(
    "verb", [["check", "car"], ["run", "car", "-o", "a.mcap"], ["modes", "car"]], ids=lambda words: words[0]
)
@pytest.mark.parametrize("temperature", [-80, 230])
def test_oil_that_turns_to_glass_or_to_gas(capsys, verb, temperature):
    oil = [f"tensioners.tensioner.oil.viscosity_{at}={nu} mm^2/s" for at, nu in ((40, 62), (100, 10.3))]
    words = [*verb, *(word for value in (f"temperature={temperature}", *oil) for word in ("--set", value))]
    assert "must be from -74 to 222 degrees C" in refused(capsys, *words)


def test_a_drawing_with_an_open_contour(capsys, tmp_path):
    document = pytest.importorskip("ezdxf").new("R2010", units=4)
    for ends in (((0, 0), (50, 0)), ((50.5, 0), (100, 3))):
        document.modelspace().add_line(*ends)
    document.saveas(tmp_path / "blade.dxf")
    shape = "points = [[-0.050, 0.24], [-0.032, 0.15], [-0.045, 0.05]]\nradius = 0.25"
    (tmp_path / "d.toml").write_text(BLADE.replace(shape, 'profile = "blade.dxf"'))
    assert "the contour is open: LINE" in refused(capsys, "check", tmp_path / "d.toml")


@pytest.mark.long
def test_a_sprocket_may_be_named_anything_that_can_be_printed(capsys, tmp_path):
    text = dumps_drive(two_sprockets(duration=0.002, settle="false")).replace('"driver"', '"$x^{$"')
    (tmp_path / "d.toml").write_text(text)
    archive = tmp_path / "a.mcap"
    ran = ["run", tmp_path / "d.toml", "-o", archive, "--quiet", "--limit", "energy_change=inf"]
    drawn = [["plot", archive, "-o", tmp_path / "plots"], ["report", archive, "-o", tmp_path / "a.html"]]
    for words in (ran, *drawn, ["modes", tmp_path / "d.toml", "-o", tmp_path / "modes.png"]):
        status, _, err = command(capsys, *words)
        assert (status, err) == (0, [])
