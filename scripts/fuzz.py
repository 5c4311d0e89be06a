"""Feeds files and folders of studies that were changed at random to what reads them.

    python scripts/fuzz.py --kind drives silent studies tables conventions archives folders --count 1000 --seed 0
    python scripts/fuzz.py --kind drives --drives v6 balance_shafts --count 10000

Each case starts from something right and changes it: bits, bytes, lines, numbers, pieces of others. It is accepted,
refused (by a `WarpchainError`), or broken: any other exception, or an archive or a study's table that reads back with
other values than were written; that, or more than `PATIENCE` seconds, ends it all. Study files also get factors and
expressions made up of all kinds of values, conventions are tables as spreadsheets write them, archives get records in
another order and topics that change places, folders files copied over one another. Prints how many cases of each kind
were which; of broken ones Hypothesis prints the smallest that it finds, and the exit status is 1.
"""

import argparse
import contextlib
import datetime
import faulthandler
import math
import re
import shutil
import struct
import tempfile
import warnings
import zlib
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from common.cases import SCRIPTS, described_parser
from common.drives import example_drive
from hypothesis import HealthCheck, given, seed, settings
from hypothesis import strategies as st
from pyarrow import parquet

from warpchain import ArchiveOptions, Drive, Record, read_archive, run_study, simulate, write_archive
from warpchain.archive.archive_format import TOPICS
from warpchain.archive.mcap_read import RECORD_HEAD, iterate_records
from warpchain.archive.recover import recover_archive
from warpchain.assembly.crossings import assemble_chains
from warpchain.assembly.timestep import resolve_step
from warpchain.drive import Guide, dumps_drive, load_drive, loads_drive
from warpchain.drive.file_columns import columns_of, read_columns, read_points
from warpchain.drive.motion_table import MotorTable, TorqueTable
from warpchain.errors import WarpchainError
from warpchain.model import Model
from warpchain.results.measured_columns import MeasuredColumns
from warpchain.results.measured_file import read_signal
from warpchain.study.design import make_design
from warpchain.study.results import read_results
from warpchain.study.run import merge_study, study_status
from warpchain.study.run.recordings import recorded_trajectories
from warpchain.study.spec import Study, check_base_drive, dumps_study, load_study, loads_study
from warpchain.study.spec.factor import Factor
from warpchain.study.spec.study_tables import Design
from warpchain.study.store import read_table, write_table

PATIENCE = 60
"""Seconds that a case may take on a busy machine."""
NUMBERS = (
    *("0", "-1", "1", "0.0", "-0.0", "0.5", "65536", "1e9", "1e-300", "1e300", "1e308", "-1e308", "inf", "-inf", "nan"),
    *("2147483648", "9223372036854775808", "-9223372036854775809", "9" * 40, "true", '"x"', "[]", "{}"),
)
VALUES = [
    *NUMBERS,
    *("2024-01-01", "2024-01-01T00:00:00Z", "07:32:00", "[2024-01-01, 2024-01-02]", "[1, 2]", "[1.0, 2]", "[[1], [2]]"),
    *('[1, "x"]', "[true, false]", '["x", "y"]', "{ a = 1 }", "[{}, {}]", "[1e308, 2e308]"),
    *('""', '"uniform"', '"normal"', "x", "", "1500.0", '"a,b"', '"', "1\0", "1;2", "\ufeff1"),
]
"""Values of a key or a cell, right or wrong."""
KEYS = [*Factor.model_fields, *Design.model_fields]
RULES = "2 * torque + max(double, 3) ** 2", "both < 1e9 and torque > 0"
NAMES = (
    "marine", "engine", "motorcycle", "conveyor", "swing_idler", "v6", "motorcycle_drivetrain", "balance_shafts",
    "hoist", "fork_lift", "bucket_elevator", "chain_conveyor", "silent_timing",
)  # fmt: skip
"""Example drives whose files are changed; `--drives` names others, or files of one's own.

Studies and runs are those of the first.
"""
SILENT = SCRIPTS / "common" / "silent.toml", SCRIPTS / "drawings" / "silent.toml"
"""Drive files with silent chains that are changed as they are."""
STUDY = """
[study]
drive = "marine"
[design]
kind = "{kind}"
{more}
[[factors]]
name = "torque"
path = "sprockets.camshaft.load.torque"
{first}
[[factors]]
name = "double"
path = "sprockets.crankshaft.teeth"
{second}
[[factors]]
name = "both"
path = "chain.roller_mass"
expression = "2 * torque + max(double, 3) ** 2"
[[constraints]]
require = "both < 1e9 and torque > 0"
[run]
duration = 0.001
[record]
every = 2
channels = ["position"]
"""
TORQUES, ENDS, TEETH = "levels = [1e4, 2e4]", "range = [1000.0, 2000.0]", "levels = [74, 76]"
DESIGNS = (
    ("factorial", "", f"{ENDS}\npoints = 3", TEETH),
    ("sobol", "count = 8\nseed = 1", ENDS, TEETH),
    ("halton", "count = 8", 'distribution = "normal"\nmean = 1000.0\nstd = 10.0', "choice = [74, 76]"),
    ("central-composite", 'axial = "face"\ncenter = 2', ENDS, "range = [70, 80]\ninteger = true"),
    ("plackett-burman", "", ENDS, "range = [70, 80]\ninteger = true"),
    ("plackett-burman", "", 'choice = [1000.0, 2000.0]\ngroup = "g"', 'choice = [74, 76]\ngroup = "g"'),
    ("factorial", "", 'choice = ["x", "y"]', TEETH),
    ("table", 'file = "t.csv"', "", ""),
)
Draw = Callable[[st.SearchStrategy[Any]], Any]


def one_of(values: Any) -> st.SearchStrategy[Any]:
    """One of some values."""
    return st.sampled_from(values.split() if isinstance(values, str) else values)


def number_below(count: int) -> st.SearchStrategy[int]:
    """A number from 0 on."""
    return st.integers(0, count - 1)


ATOMS = one_of("torque double 1 0 2.5 -1 1e308 10000 999999999999999999999999999999 pi true 'x'")
WRONG = one_of("'' [1] both x.y x[0] {} None 1j b'x' f'{1}' len(torque) max lambda:1")
CALLS = one_of("abs ceil exp floor log max min round sin sqrt tan")
EXPRESSIONS = st.recursive(
    st.one_of(*[ATOMS] * 9, WRONG),
    lambda inner: st.one_of(
        st.builds("({} {} {})".format, inner, one_of("+ - * / // % ** < <= == != and or"), inner),
        st.builds("{}({})".format, CALLS, st.lists(inner, max_size=3).map(", ".join)),
        st.builds("({} if {} else {})".format, inner, inner, inner),
    ),
    max_leaves=12,
) | st.builds(lambda sign, count: sign * count + "torque", one_of(["-", "not ", "(", "abs("]), st.integers(1, 1000))
"""Arithmetic of factors, numbers, texts and what is no arithmetic; now and then deep."""


@st.composite
def changed_bytes(draw: Draw, data: bytes) -> bytes:
    """Bytes with a few changes of any kind."""
    out = bytearray(data)
    for _ in range(draw(st.integers(1, 3))):
        at, size = draw(st.integers(0, len(out))), draw(st.integers(1, 128))
        match draw(number_below(6)):
            case 0 if at < len(out):
                out[at] ^= 1 << draw(number_below(8))
            case 1:
                out[at : at + size] = draw(st.binary(min_size=size, max_size=size))
            case 2:
                del out[at : at + size]
            case 3:
                out[at:at] = out[draw(st.integers(0, len(out))) :][:size]
            case 4:
                out[at : at + 8] = draw(one_of([b"\xff" * 8, b"\0" * 8, b"\xff" * 7 + b"\x7f"]))
            case 5:
                del out[at:]
    return bytes(out)


@st.composite
def changed_text(draw: Draw, text: str) -> bytes:
    """Text with other numbers, without or with repeated lines, or with other bytes."""
    lines = text.splitlines()
    for _ in range(draw(st.integers(1, 3))):
        at, word = draw(number_below(len(lines))), draw(one_of(VALUES))
        head, mark, _ = lines[at].partition("=")
        match draw(number_below(5)):
            case 0:
                lines[at] = f"{head}{mark} {word}" if mark else word
            case 1:
                cells = lines[at].split(",")
                cells[draw(number_below(len(cells)))] = word
                lines[at] = ",".join(cells)
            case 2:
                lines.insert(at, draw(one_of(lines)))
            case 3 if len(lines) > 1:
                del lines[at]
            case 4:
                return draw(changed_bytes("\n".join(lines).encode()))
    return "\n".join(lines).encode("utf-8", "replace")


@st.composite
def changed_study(draw: Draw, text: str) -> bytes:
    """A study file with other expressions, or with keys that are there or not given values of any kind."""
    if draw(st.booleans()):
        text = text.replace(draw(one_of(RULES)), draw(EXPRESSIONS))
    else:
        at = draw(one_of([match.end() for match in re.finditer(r"\]\n", text)]))
        text = f"{text[:at]}{draw(one_of(KEYS))} = {draw(one_of(VALUES))}\n{text[at:]}"
    return text.encode("utf-8", "replace")


@st.composite
def odd_csv_cells(draw: Draw, head: str) -> bytes:
    """A CSV table of odd cells; now and then a huge one, zero bytes, or rows of unlike lengths."""
    row = st.lists(one_of(VALUES), min_size=2, max_size=2) | st.lists(
        one_of([*VALUES, "x" * 140_000]), min_size=1, max_size=3
    )
    rows = draw(st.lists(row.map(",".join), min_size=1, max_size=3))
    text = "\n".join([head, *rows, ""]).encode()
    return draw(st.just(text) | changed_bytes(text))


NUMBER_FORMS = "{:.3f}", "{:.1f}", "{:g}", "{:.4e}", "{:+.2f}"


@st.composite
def written_table(draw: Draw) -> tuple[list[list[float]], str, str]:
    """Numbers of speed and torque, their text in one of the conventions of spreadsheets and rigs, and its encoding."""
    separator, form = draw(one_of([";", "\t", ",", "  "])), draw(one_of(NUMBER_FORMS))
    decimal = "." if separator == "," else draw(one_of([".", ","]))
    speeds = draw(st.lists(st.integers(0, 9_000), min_size=2, max_size=6, unique=True).map(sorted))
    torques = draw(st.lists(st.integers(-9_000_000, 9_000_000), min_size=6, max_size=6))
    words = [[form.format(speed), form.format(torque / 1000.0)] for speed, torque in zip(speeds, torques, strict=False)]
    rows = [[float(cell) for cell in row] for row in words]
    lines = [separator.join(row).replace(".", decimal) for row in words]
    heads = ["speed [rpm]", "torque [Nm]"], ["n / rpm", "M / Nm"], ["rpm", "Nm"], ["speed_rpm", "torque_Nm"]
    above = [separator.join(draw(one_of(heads)))]
    if draw(st.booleans()):
        above = [
            separator.join(["Drehzahl", "Moment"]),
            separator.join(draw(one_of([["U/min", "Nm"], ["(1/min)", "[N·m]"]]))),
        ]
    preamble = draw(one_of([[], ["Prüfstand 7"], ["Rate 1000", ""], ["# speed,torque"], ['Name;"Öl"', "", "Kanal\t2"]]))
    end = draw(one_of(["\n", "\r\n", "\r"]))
    encoding = draw(one_of("utf-8 utf-8-sig utf-16 utf-16-le cp1252 latin-1"))
    return rows, end.join([*preamble, *above, *lines, *draw(one_of([[], [""], [separator]]))]), encoding


DAY, NOON = datetime.date(2024, 1, 1), datetime.datetime(2024, 1, 1)
COLUMNS = [
    *(pa.array(pair) for pair in ([1e3, 1.5e3], [74, 76], [1.5, None], [DAY, DAY], [NOON, NOON], [[1], [2, 3]])),
    *(pa.array(pair) for pair in ([{"a": 1}, None], [b"x", b"\0"], [True, False], [datetime.timedelta(1)] * 2)),
    *(pa.array(pair) for pair in ([2**63 - 1, -(2**63)], [np.nan, np.inf], ["x" * 200_000, ""])),
    *(pa.array(pair, pa.uint64()) for pair in ([74, 76], [2**64 - 1, 0])),
    *(pa.nulls(2), pa.array(["a", "b"]).dictionary_encode(), pa.array([1, 2], pa.decimal128(38, 3))),
]
"""Columns of anything that Parquet can hold."""


@st.composite
def changed_records(draw: Draw, data: bytes) -> bytes:
    """An archive whose records come in another order, twice or not at all, or whose topics have changed places.

    Now and then the checksum of the summary, which shows it, is made right.
    """
    start = int.from_bytes(data[-28:-20], "little")
    if draw(st.booleans()):
        names = [f"/variant/0000{v}/{draw(one_of(tuple(TOPICS)))}".encode() for v in (0, 1)]
        out = bytearray(data)
        for match in re.finditer(b"|".join(map(re.escape, names)), data):
            if draw(number_below(3)):
                new = names[match.group() == names[0]]
                out[match.start() : match.end()] = (new + match.group()[len(new) :])[: len(match.group())]
        if draw(st.booleans()):
            out[-12:-8] = struct.pack("<I", zlib.crc32(out[start:-12]))
        return bytes(out)
    pieces = [data[begin - RECORD_HEAD.size : end] for _, begin, end in iterate_records(data[:start], 8)]
    i, j = draw(number_below(len(pieces))), draw(number_below(len(pieces)))
    match draw(number_below(3)):
        case 0:
            pieces[i], pieces[j] = pieces[j], pieces[i]
        case 1:
            pieces.insert(j, pieces[i])
        case 2:
            del pieces[i]
    return data[:8] + b"".join(pieces) + (data[start:] if draw(st.booleans()) else b"")


def build_drives(drive: Drive, study: Study, rows: pa.Table) -> None:
    """Makes drives of the first rows, or has them refused as a study refuses them."""
    for row in rows.slice(0, 4).to_pylist():
        values = {path: row[factor.name] for factor in study.factors for _, path in factor.target_paths()}
        if row["reason"] is None:
            with contextlib.suppress(WarpchainError):
                drive.with_values(values)


class Fuzz:
    """Files to change, and what reads them; the method of each kind takes one case."""

    def __init__(self, folder: Path, chosen: Sequence[str] = NAMES) -> None:
        self.folder, self.home = folder, folder / "home"
        self.base = example_drive(NAMES[0])
        self.texts = [
            dumps_drive(load_drive(name) if name.endswith(".toml") else example_drive(name)) for name in chosen
        ]
        names = ("kind", "more", "first", "second")
        self.texts_of_studies = [STUDY.format(**dict(zip(names, design, strict=True))) for design in DESIGNS]
        (folder / "t.csv").write_text("torque,double\n1000.0,74\n1500.0,76\n")
        softer = {"chain.stiffness": 0.9 * self.base.chain.stiffness}
        record = Record("all", 5000.0, ("position", "tension", "sprocket_angle"))
        both = [self.base, self.base.with_values(softer)]
        self.run = simulate(both, device="cpu", duration=1e-3, step=1e-5, record=record)
        options = [ArchiveOptions("zstd"), ArchiveOptions("lz4"), ArchiveOptions("none")]
        files = [write_archive(self.run, folder / f"{of.compression}.mcap", options=of) for of in options]
        self.files = [path.read_bytes() for path in files]
        write_table(folder / "table.parquet", self.run.metrics)
        self.parquet = (folder / "table.parquet").read_bytes()
        text = STUDY.format(kind="factorial", more="", first=TORQUES, second=TEETH)
        (folder / "home.toml").write_text(text.replace("[run]", '[run]\nshard = 2\ndevice = "cpu"'))
        run_study(folder / "home.toml", self.home, workers=1)
        self.results = read_results(self.home / "results.parquet")
        self.recorded = recorded_trajectories(self.results, self.home)

    def drives(self, draw: Draw) -> None:
        """A changed drive file: read, assembled, and written and read again."""
        self.read_changed(draw(changed_text(draw(one_of(self.texts)))))

    def silent(self, draw: Draw) -> None:
        """A changed file of a drive with a silent chain."""
        self.read_changed(draw(changed_text(draw(one_of(SILENT)).read_text())))

    def read_changed(self, data: bytes) -> None:
        """Reads and assembles a drive, and writes and reads it again."""
        path = self.folder / "case.toml"
        path.write_bytes(data)
        drive = load_drive(path)
        resolve_step(drive)
        assemble_chains(Model(drive))
        assert loads_drive(dumps_drive(drive)) == drive

    def studies(self, draw: Draw) -> None:
        """A changed study file: read, its drives built, and written and read again."""
        path, text = self.folder / "study.toml", draw(one_of(self.texts_of_studies))
        path.write_bytes(draw(changed_study(text) | changed_text(text)))
        study = load_study(path)
        check_base_drive(study, self.base, "study.toml")
        if study.design.count is None or study.design.count < 10_000:
            build_drives(self.base, study, make_design(study, path))
        assert loads_study(dumps_study(study)) == study

    def tables(self, draw: Draw) -> None:
        """A changed table of a drive, study or signal."""
        path, file = self.folder / "case.csv", self.folder / "case.toml"
        match draw(number_below(7)):
            case 0 | 1:
                path = self.folder / "table.parquet"
                path.write_bytes(draw(changed_bytes(self.parquet)))
                assert read_table(path).equals(self.run.metrics)
            case 2:
                path.write_bytes(draw(changed_text("time,torque\n0,1\n0.5,2\n1,1\n")))
                read_columns(path, {}, columns_of(TorqueTable))
            case 3:
                path.write_bytes(draw(odd_csv_cells("time,torque")))
                table = self.base.with_values({"sprockets.camshaft.load.torque": 0.0})
                file.write_text(dumps_drive(table).replace("torque = 0.0", 'table = { file = "case.csv" }'))
                load_drive(file)
            case 4:
                path.write_bytes(draw(changed_text("x_mm,y_mm\n0,0\n100,5\n200,8\n300,5\n")))
                Guide(name="guide", profile=tuple((x, y) for x, y in read_points(path, {})))
            case kind:
                name = "t.csv" if kind == 5 else "t.parquet"
                if kind == 5:
                    (self.folder / name).write_bytes(draw(odd_csv_cells("torque,double")))
                else:
                    columns = {
                        of: draw(one_of(COLUMNS)) for of in draw(one_of(["torque double", "torque double x"])).split()
                    }
                    parquet.write_table(pa.table(columns), self.folder / name)
                file.write_text(self.texts_of_studies[-1].replace("t.csv", name))
                study = load_study(file)
                build_drives(self.base, study, make_design(study, file))

    def conventions(self, draw: Draw) -> None:
        """A text table in any convention, whose numbers must come back."""
        rows, text, encoding = draw(written_table())
        path, data = self.folder / "case.txt", text.encode(encoding)
        is_changed = draw(st.booleans())
        path.write_bytes(draw(changed_text(text) | changed_bytes(data)) if is_changed else data)
        if draw(st.booleans()):
            found = read_columns(path, {}, columns_of(MotorTable))
            columns: list[Any] = list(found.values()) if is_changed else [found["speed"], found["torque"]]
            wanted = [[math.pi / 30.0 * row[0] for row in rows], [row[1] for row in rows]]
        else:
            signal = read_signal(path, "a.torque", "N m", MeasuredColumns(time_unit="s"))
            columns, wanted = [signal.time, signal.values], [list(of) for of in zip(*rows, strict=True)]
        for column, values in zip(columns, wanted, strict=True):
            assert is_changed or np.allclose(column, values, rtol=1e-12, atol=0.0), "other numbers than were written"

    def archives(self, draw: Draw) -> None:
        """A changed archive: recovered and read."""
        path, fixed, data = self.folder / "case.mcap", self.folder / "fixed.mcap", draw(one_of(self.files))
        path.write_bytes(draw(changed_bytes(data) | changed_bytes(data) | changed_records(data)))
        with contextlib.suppress(WarpchainError):  # a lost drive
            recover_archive(path, fixed, overwrite=True)
            self.compare(fixed, whole=False)
        self.compare(path, whole=True)

    def folders(self, draw: Draw) -> None:
        """A study's folder with changed files."""
        home = self.folder / "case"
        shutil.rmtree(home, ignore_errors=True)
        shutil.copytree(self.home, home)
        files = [path for path in sorted(home.rglob("*")) if path.is_file()]
        for _ in range(draw(st.integers(1, 2))):
            file = draw(one_of(files))
            alike = [path for path in files if path.suffix == file.suffix and path != file and path.exists()]
            match draw(number_below(5)):
                case 0 | 1 if file.exists():
                    file.write_bytes(draw(changed_bytes(file.read_bytes())))
                case 2 | 3 if alike:
                    shutil.copy(draw(one_of(alike)), file)
                case 4:
                    file.unlink(missing_ok=True)
        study_status(home)
        merge_study(home)
        results = read_results(home / "results.parquet")
        assert results.table.equals(self.results.table)
        for variant, trajectory in recorded_trajectories(results, home).items():
            assert np.array_equal(trajectory.channels()["position"], self.recorded[variant].channels()["position"])

    def compare(self, path: Path, whole: bool) -> None:
        """Holds every frame that is read against its variant's own, and its place."""
        back = read_archive(path)
        back.metrics.to_pylist()
        if whole:
            assert (list(back), back.info, back.drives) == (list(self.run), self.run.info, self.run.drives)
        for variant in back:
            found, own = back[variant], self.run[variant]
            kept = np.isin(own.time, found.time)
            assert kept.sum() == len(found.time) and (kept.all() or not whole), "frames are missing or were made up"
            for name, values in found.channels().items():
                assert np.array_equal(values, getattr(own, name)[kept]), f"{name} of {variant} are other values"


KINDS = ("drives", "silent", "studies", "tables", "conventions", "archives", "folders")


def fuzz(case: Callable[[Draw], None], count: int, first: int) -> Counter[str]:
    """Runs `count` cases from a seed on; returns how many were accepted and refused.

    Raises:
        Exception: whatever a broken case raises, the smallest that is found.
    """
    found: Counter[str] = Counter()

    @seed(first)
    @settings(max_examples=count, database=None, deadline=None, suppress_health_check=list(HealthCheck))
    @given(st.data())
    def attempt(data: st.DataObject) -> None:
        faulthandler.dump_traceback_later(PATIENCE, exit=True)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                case(data.draw)
            found["accepted"] += 1
        except WarpchainError:
            found["refused"] += 1
        finally:
            faulthandler.cancel_dump_traceback_later()

    attempt()
    return found


def parser() -> argparse.ArgumentParser:
    """The command's words."""
    words = described_parser(__doc__)
    words.add_argument("--kind", nargs="+", choices=KINDS, default=list(KINDS))
    words.add_argument("--drives", nargs="+", metavar="DRIVE", default=NAMES, help="examples or drive files to change")
    words.add_argument("--count", type=int, default=1000)
    words.add_argument("--seed", type=int, default=0)
    return words


def main() -> None:
    """Tries cases of each kind."""
    asked = parser().parse_args()
    for kind in asked.kind:
        with tempfile.TemporaryDirectory() as folder:
            found = fuzz(getattr(Fuzz(Path(folder), asked.drives), kind), asked.count, asked.seed)
        print(f"{kind}: {found.total()} tried, {found['refused']} refused, {found['accepted']} accepted", flush=True)


if __name__ == "__main__":
    main()
