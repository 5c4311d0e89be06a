#!/usr/bin/env python
"""Feeds files, folders of studies and command lines that were changed at random to what reads them.

    python scripts/fuzz.py --kind drives studies tables archives folders commands --count 1000 --seed 0

Each case starts from something right and changes it: bits, bytes, lines, numbers, pieces of others. It is accepted,
refused (by a `WarpchainError`), or broken: any other exception, more than `PATIENCE` seconds, or an archive or a
study's table that reads back with other values than were written. Study files also get factors and expressions made up
of all kinds of values, archives records in another order and topics that change places, folders files copied over one
another. Prints how many cases of each kind were which; a
broken one with its seed, by which `--seed S --count 1` repeats it. Exit status 1 if there is any.
"""

from __future__ import annotations

import argparse
import contextlib
import datetime
import faulthandler
import io
import re
import shutil
import signal
import struct
import sys
import tempfile
import traceback
import warnings
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from pyarrow import parquet

from warpchain.archive import read_archive, write_archive
from warpchain.archive.archive_format import TOPICS as SCHEMAS
from warpchain.archive.mcap_read import RECORD, records
from warpchain.archive.options import ArchiveOptions
from warpchain.archive.recover import recover_archive
from warpchain.assembly import assemble
from warpchain.assembly.timestep import resolve_step
from warpchain.cli import main as command_line
from warpchain.drive import Drive, Guide, dumps_drive, load_drive, loads_drive
from warpchain.drive.csv_files import read_points
from warpchain.drive.examples import drive_path
from warpchain.drive.motion_table import read_csv
from warpchain.errors import WarpchainError
from warpchain.results.metrics import table_of
from warpchain.results.run import Run, RunInfo, Trajectory
from warpchain.study.design import make_design
from warpchain.study.results import read_results
from warpchain.study.run import merge_study, study_status
from warpchain.study.run.folder import make_folder
from warpchain.study.run.recordings import recorded_variants
from warpchain.study.run.row_drives import Variant
from warpchain.study.run.shards import results_table
from warpchain.study.spec import Study, check_drive, dumps_study, load_study, loads_study
from warpchain.study.store import read_table, write_table

TOPICS = tuple(SCHEMAS)

PATIENCE = 30
"""Seconds that a case may take on a busy machine."""
NUMBERS = (
    *("0", "-1", "1", "0.0", "-0.0", "0.5", "65536", "1e9", "1e-300", "1e300", "1e308", "-1e308", "inf", "-inf", "nan"),
    *("2147483648", "9223372036854775808", "-9223372036854775809", "9" * 40, "true", '"x"', "[]", "{}"),
)
VALUES = (
    *NUMBERS,
    *("2024-01-01", "2024-01-01T00:00:00Z", "07:32:00", "[2024-01-01, 2024-01-02]", "[1, 2]", "[1.0, 2]", "[[1], [2]]"),
    *('[1, "x"]', "[true, false]", '["x", "y"]', "{ a = 1 }", "[{}, {}]", "[1e308, 2e308]"),
    *('""', '"uniform"', '"normal"'),
)
"""What a key may be given, right or wrong."""
KEYS = (
    *("choice", "levels", "range", "points", "mean", "std", "distribution", "integer", "group", "expression", "unit"),
    *("path", "paths", "name", "count", "seed", "center", "axial", "kind", "file", "require"),
)
ATOMS = ("torque", "torque", "double", "double", "1", "0", "2.5", "-1", "1e308", "10000", "9" * 30, "pi", "true", "'x'")
WRONG = ("''", "[1]", "both", "x.y", "x[0]", "lambda: 1", "{}", "None", "1j", "b'x'", "f'{1}'", "len(torque)", "max")
OPERATORS = ("+", "-", "*", "/", "//", "%", "**", "<", "<=", "==", "!=", "and", "or")
CALLS = ("abs", "ceil", "exp", "floor", "log", "max", "min", "round", "sin", "sqrt", "tan")
CELLS = (
    *("1.0", "1500.0", "74", "76", "x", "", "1e400", "nan", "9" * 40, "2024-01-01", "true"),
    *('"a,b"', '"', "[1]", "1\0", "1;2", "\ufeff1"),
)
COMMANDS = (
    "check marine --set run.duration=1.0",
    "check engine --json --set run.step=1e-6",
    "check {folder}/case.toml",
    "chains",
    "fit {folder}/case.toml --sprocket camshaft --along 1,0 --preload 1000 -o {folder}/fit.toml --overwrite",
    "fit {folder}/case.toml --links --overwrite -o {folder}/fit.toml",
    "export {folder}/zstd.mcap -o {folder}/out.npz --variant 1",
    "recover {folder}/zstd.mcap -o {folder}/new.mcap --overwrite",
    "study status {folder}/home",
    "study merge {folder}/home",
)
WORDS = (
    *NUMBERS,
    *(
        "9" * 5000,
        "x" * 5000,
        "",
        "=",
        ".",
        "..",
        "/",
        "-",
        "--",
        "--json",
        "--set",
        "-o",
        "a=b=c",
        "\udc80",
        "\n",
        "[1",
        "{}",
    ),
    *("1,0,0", "nan,1", "1e308,1e308", "0,0", "/dev/null", "marine", "camshaft", "chain.links=0", "chain=1"),
)
PATHS = (
    *("chain.links", "chain.pitch", "run.step", "run.gravity", "sprockets.0.center", "sprockets.camshaft.load.torque"),
    *("sprockets", "chain", "guides.0.start", "contact.sprocket.law", "x", "sprockets.9", "chain.worn_links", ""),
)
STUDY = """
[study]
drive = "{drive}"
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
channels = ["tension"]
"""
Random = np.random.Generator


class Broken(Exception):
    """Read back as something else than was written."""


def changed(data: bytes, rng: Random) -> bytes:
    """Bytes with a few changes of any kind."""
    out = bytearray(data)
    for _ in range(int(rng.integers(1, 4))):
        at = int(rng.integers(len(out) + 1))
        size = int(rng.integers(1, 2 ** int(rng.integers(1, 8))))
        match int(rng.integers(7)):
            case 0 | 1 if at < len(out):
                out[at] ^= 1 << int(rng.integers(8))
            case 2:
                out[at : at + size] = rng.bytes(size)
            case 3:
                del out[at : at + size]
            case 4:
                out[at:at] = out[int(rng.integers(len(out) + 1)) :][:size]
            case 5:
                out[at : at + 8] = rng.choice([b"\xff" * 8, b"\0" * 8, b"\xff" * 7 + b"\x7f"])
            case 6:
                del out[at:]
    return bytes(out)


def changed_text(text: str, rng: Random) -> bytes:
    """Text with other numbers, without or with repeated lines, or with other bytes."""
    lines = text.splitlines()
    for _ in range(int(rng.integers(1, 4))):
        at = int(rng.integers(len(lines)))
        line, word = lines[at], str(rng.choice(VALUES))
        match int(rng.integers(6)):
            case 0 | 1:
                head, mark, _ = line.partition("=")
                lines[at] = f"{head}{mark} {word}" if mark else word
            case 2:
                cells = line.split(",")
                cells[int(rng.integers(len(cells)))] = word
                lines[at] = ",".join(cells)
            case 3:
                lines.insert(at, lines[int(rng.integers(len(lines)))])
            case 4 if len(lines) > 1:
                del lines[at]
            case 5:
                return changed("\n".join(lines).encode(), rng)
    return "\n".join(lines).encode("utf-8", "replace")


def expression(rng: Random, depth: int = 4) -> str:
    """Arithmetic of factors, numbers, texts and what is no arithmetic; now and then deep."""
    if rng.integers(60) == 0:
        return str(rng.choice(["-", "not ", "(", "abs("])) * int(rng.integers(1, 1000)) + "torque"
    match int(rng.integers(6)) if depth else 0:
        case 0 | 1:
            return str(rng.choice(WRONG if rng.integers(60) == 0 else ATOMS))
        case 2 | 3:
            return f"({expression(rng, depth - 1)} {rng.choice(OPERATORS)} {expression(rng, depth - 1)})"
        case 4:
            given = ", ".join(expression(rng, depth - 1) for _ in range(int(rng.integers(4))))
            return f"{rng.choice(CALLS)}({given})"
    first, test, last = (expression(rng, depth - 1) for _ in range(3))
    return f"({first} if {test} else {last})"


def changed_study(text: str, rng: Random) -> bytes:
    """A study file with other expressions, or with keys that are there or not given values of any kind."""
    lines, arithmetic = text.splitlines(), rng.integers(2)
    for _ in range(int(rng.integers(1, 3))):
        tables = [i for i, line in enumerate(lines) if line.startswith("[")]
        at = int(rng.choice(tables))
        match 1 if arithmetic else int(rng.integers(4)):
            case 0:
                lines.insert(at + 1, f"{rng.choice(KEYS)} = {rng.choice(VALUES)}")
            case 1:
                held = [i for i, line in enumerate(lines) if line.startswith(("expression", "require"))]
                i = int(rng.choice(held))
                lines[i] = f'{lines[i].partition(" ")[0]} = "{expression(rng)}"'
            case 2:
                held = [i for i, line in enumerate(lines) if " = " in line]
                i = int(rng.choice(held))
                lines[i] = f"{lines[i].partition(' ')[0]} = {rng.choice(VALUES)}"
            case 3:
                name = f'name = "x{rng.integers(3)}"'
                lines += ["[[factors]]", name, 'path = "chain.pitch"', f"choice = {rng.choice(VALUES)}"]
    return "\n".join(lines).encode("utf-8", "replace")


def cells(rng: Random, head: str) -> bytes:
    """A CSV table of odd cells; now and then a huge one, zero bytes, or rows of unlike lengths."""
    rows = [[str(rng.choice(CELLS)) for _ in head.split(",")] for _ in range(int(rng.integers(1, 4)))]
    row = rows[int(rng.integers(len(rows)))]
    match int(rng.integers(5)):
        case 0:
            row[int(rng.integers(len(row)))] = str(rng.choice(["x", "1", '"', "\0", "1,"])) * 140_000
        case 1:
            row.append("1")
    text = "\n".join([head, *map(",".join, rows)]) + "\n"
    return text.encode() if rng.integers(4) else changed(text.encode(), rng)


def odd_columns(rng: Random) -> pa.Table:
    """A design table whose columns hold anything that Parquet can."""
    day, noon = datetime.date(2024, 1, 1), datetime.datetime(2024, 1, 1)
    kinds = [
        *(
            pa.array(pair)
            for pair in ([1000.0, 1500.0], [74, 76], [1.5, None], [day, day], [noon, noon], [[1], [2, 3]])
        ),
        *(pa.array(pair) for pair in ([{"a": 1}, None], [b"x", b"\0"], [True, False], [datetime.timedelta(1)] * 2)),
        *(pa.array(pair) for pair in ([2**63 - 1, -(2**63)], [np.nan, np.inf], ["x" * int(rng.integers(200_000)), ""])),
        *(pa.array(pair, pa.uint64()) for pair in ([74, 76], [2**64 - 1, 0])),
        *(pa.nulls(2), pa.array(["a", "b"]).dictionary_encode(), pa.array([1, 2], pa.decimal128(38, 3))),
    ]
    names = ["torque", "double", *(["more"] if rng.integers(8) == 0 else [])]
    return pa.table([kinds[int(rng.integers(len(kinds)))] for _ in names], names=names)


def changed_records(data: bytes, rng: Random) -> bytes:
    """An archive whose records come in another order, twice or not at all, or whose topics have changed places.

    Now and then the checksum of the summary, which tells of it, is made right.
    """
    if rng.integers(2):
        one, other = (f"/variant/0000{v}/{rng.choice(TOPICS)}".encode() for v in (0, 1))
        out = bytearray(data)
        for match in re.finditer(re.escape(one) + b"|" + re.escape(other), data):
            if rng.integers(3):
                new = other if match.group() == one else one
                out[match.start() : match.end()] = (new + match.group()[len(new) :])[: len(match.group())]
        return resealed(bytes(out)) if rng.integers(2) else bytes(out)
    start = int.from_bytes(data[-28:-20], "little")
    pieces = [data[begin - RECORD.size : end] for _, begin, end in records(data[:start], 8)]
    i, j = (int(rng.integers(len(pieces))) for _ in range(2))
    match int(rng.integers(4)):
        case 0:
            pieces[i], pieces[j] = pieces[j], pieces[i]
        case 1:
            pieces.insert(j, pieces[i])
        case 2:
            del pieces[i]
        case 3:
            pieces[i] = pieces[j]
    end = data[start:] if rng.integers(2) else b""
    return data[:8] + b"".join(pieces) + end


def resealed(data: bytes) -> bytes:
    """An archive whose summary's checksum is right."""
    start = int.from_bytes(data[-28:-20], "little")
    return data[:-12] + struct.pack("<I", zlib.crc32(data[start:-12])) + data[-8:]


class Fuzz:
    """What there is to change, and what reads it; each method takes one case."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.drives = [load_drive(drive_path(name)) for name in ("marine", "engine", "motorcycle")]
        self.texts = [dumps_drive(drive) for drive in self.drives]
        ends, levels = "range = [1000.0, 2000.0]", "levels = [74, 76]"
        self.studies = [
            STUDY.format(drive="marine", kind=kind, more=more, first=first, second=second)
            for kind, more, first, second in (
                ("factorial", "", f"{ends}\npoints = 3", levels),
                ("sobol", "count = 8\nseed = 1", ends, levels),
                ("halton", "count = 8", 'distribution = "normal"\nmean = 1000.0\nstd = 10.0', "choice = [74, 76]"),
                ("central-composite", 'axial = "face"\ncenter = 2', ends, "range = [70, 80]\ninteger = true"),
                ("plackett-burman", "", ends, "range = [70, 80]\ninteger = true"),
                ("plackett-burman", "", 'choice = [1000.0, 2000.0]\ngroup = "g"', 'choice = [74, 76]\ngroup = "g"'),
                ("factorial", "", 'choice = ["x", "y"]', levels),
                ("factorial", "", "choice = [true, false]", levels),
                ("table", 'file = "t.csv"', "", ""),
            )
        ]
        (folder / "t.csv").write_text("torque,double\n1000.0,74\n1500.0,76\n")
        self.run = small_run(self.drives[0])
        self.archives = []
        for compression in ("zstd", "lz4", "none"):
            path = write_archive(self.run, folder / f"{compression}.mcap", options=ArchiveOptions(compression))
            self.archives.append(path.read_bytes())
        self.table = self.run.metrics
        write_table(folder / "table.parquet", self.table)
        self.parquet = (folder / "table.parquet").read_bytes()
        self.with_table = dumps_drive(self.drives[0].with_values({"sprockets.camshaft.load.torque": 0.0}))
        self.design = self.studies[-1].replace("t.csv", "odd.{kind}")
        self.home = a_folder(folder / "home", self.run)
        (folder / "case.toml").write_text(self.texts[0])

    def drive(self, rng: Random) -> None:
        text = changed_text(str(rng.choice(self.texts)), rng)
        path = self.folder / "case.toml"
        path.write_bytes(text)
        drive = load_drive(path)
        resolve_step(drive)
        assemble(drive)
        if loads_drive(dumps_drive(drive)) != drive:
            raise Broken("the drive's text reads back as another drive")

    def study(self, rng: Random) -> None:
        path, change = self.folder / "study.toml", changed_study if rng.integers(2) else changed_text
        path.write_bytes(change(str(rng.choice(self.studies)), rng))
        study = load_study(path)
        check_drive(study, self.drives[0], "study.toml")
        if study.design.count is None or study.design.count < 10_000:
            self._built(study, make_design(study, path))
        if loads_study(dumps_study(study)) != study:
            raise Broken("the study's text reads back as another study")

    def _built(self, study: Study, rows: pa.Table) -> None:
        """The first rows become drives, or are refused as a study refuses them."""
        for row in rows.slice(0, 4).to_pylist():
            values = {path: row[factor.name] for factor in study.factors for _, path in factor.targets()}
            if row["reason"] is None:
                with contextlib.suppress(WarpchainError):
                    self.drives[0].with_values(values)

    def a_table(self, rng: Random) -> None:
        match int(rng.integers(8)):
            case 0 | 1:
                path = self.folder / "table.parquet"
                path.write_bytes(changed(self.parquet, rng))
                if not read_table(path).equals(self.table):
                    raise Broken("the table reads back as another one")
            case 2:
                path = self.folder / "case.csv"
                path.write_bytes(changed_text("torque,double\n1.0,74\n2.0,76\n", rng))
                read_table(path)
            case 3:
                path = self.folder / "case.csv"
                path.write_bytes(changed_text("time,torque\n0,1\n0.5,2\n1,1\n", rng))
                read_csv(path)
            case 4:
                (self.folder / "case.csv").write_bytes(cells(rng, "time,torque"))
                path = self.folder / "case.toml"
                path.write_text(self.with_table.replace("torque = 0.0", 'table = { file = "case.csv" }'))
                load_drive(path)
            case 5:
                (self.folder / "odd.csv").write_bytes(cells(rng, "torque,double"))
                self._designed("csv")
            case 6:
                parquet.write_table(odd_columns(rng), self.folder / "odd.parquet")
                self._designed("parquet")
            case 7:
                path = self.folder / "case.csv"
                path.write_bytes(changed_text("x_mm,y_mm\n0,0\n100,5\n200,8\n300,5\n", rng))
                Guide(name="guide", profile=tuple((x, y) for x, y in read_points(path)))

    def _designed(self, kind: str) -> None:
        """A study whose rows are those of a table."""
        path = self.folder / "study.toml"
        path.write_text(self.design.format(kind=kind))
        study = load_study(path)
        self._built(study, make_design(study, path))

    def archive(self, rng: Random) -> None:
        path, fixed = self.folder / "case.mcap", self.folder / "fixed.mcap"
        change = changed_records if rng.integers(3) == 0 else changed
        path.write_bytes(change(self.archives[int(rng.integers(len(self.archives)))], rng))
        refused: WarpchainError | None = None
        try:
            self._compare(path, whole=True)
        except WarpchainError as error:
            refused = error
        recover_archive(path, fixed, overwrite=True)
        with contextlib.suppress(WarpchainError):  # a lost drive
            self._compare(fixed, whole=False)
        if refused is not None:
            raise refused

    def a_folder(self, rng: Random) -> None:
        """A study's folder with files changed, gone, or copied over one another, merged and read."""
        home = self.folder / "case"
        shutil.rmtree(home, ignore_errors=True)
        shutil.copytree(self.home[0], home)
        files = [path for path in sorted(home.rglob("*")) if path.is_file()]
        for _ in range(int(rng.integers(1, 3))):
            one, other = (files[int(rng.integers(len(files)))] for _ in range(2))
            alike = [path for path in files if path.suffix == one.suffix and path != one and path.exists()]
            match int(rng.integers(5)):
                case 0 | 1 if one.exists():
                    one.write_bytes(changed(one.read_bytes(), rng))
                case 2 | 3 if alike:
                    shutil.copy(alike[int(rng.integers(len(alike)))], one)
                case 4:
                    other.unlink(missing_ok=True)
        study_status(home)
        merge_study(home)
        results = read_results(home / "results.parquet")
        if not results.table.equals(self.home[1]):
            raise Broken("the study's table reads back as another one")
        for variant, trajectory in recorded_variants(results, home).items():
            if trajectory.position is None or not np.array_equal(trajectory.position, self.home[2][variant]):
                raise Broken(f"variant {variant} of the study has other frames")

    def command(self, rng: Random) -> None:
        """A command line whose words are right or not; those that simulate or show are left out."""
        words = [word.format(folder=self.folder) for word in COMMANDS[int(rng.integers(len(COMMANDS)))].split()]
        for _ in range(int(rng.integers(3))):
            at, word = int(rng.integers(len(words))), str(rng.choice(WORDS))
            head, mark, _ = words[at].partition("=")
            match int(rng.integers(4)):
                case 0 if at:
                    words[at] = f"{head}={word}" if mark else word
                case 1:
                    words.insert(at + 1, word)
                case 2 if mark and "." in head:
                    words[at] = head.rpartition(".")[0] + "." + word + mark + "1"
                case 3:
                    words += ["--set", f"{rng.choice(PATHS)}={word}"]
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()) as said:
            try:
                status = command_line(words)
            except SystemExit as ended:
                status = int(ended.code or 0)
        if status == 2:
            raise WarpchainError("refused")
        if status not in (0, 1) or "Traceback" in said.getvalue():
            raise Broken(f"status {status} of {words}")

    def _compare(self, path: Path, whole: bool) -> None:
        """Every frame that is read is its variant's own, and in its place."""
        back = read_archive(path)
        back.metrics.to_pylist()
        if whole and (list(back) != list(self.run) or back.info != self.run.info or back.drives != self.run.drives):
            raise Broken("the archive reads back as another run")
        for variant in back:
            found, own = back[variant], self.run[variant]
            kept = np.isin(own.time, found.time)
            if kept.sum() != len(found.time) or (whole and not kept.all()):
                raise Broken("frames are missing or were made up")
            for name, values in found.channels().items():
                if not np.array_equal(values, getattr(own, name)[kept]):
                    raise Broken(f"{name} of variant {variant} are other values")


def small_run(drive: Drive, seed: int = 0) -> Run:
    """A run of two variants whose frames are random numbers."""
    rng, frames, links, sprockets = np.random.default_rng(seed), 6, drive.chain.links, len(drive.sprockets)
    trajectories = {
        variant: Trajectory(
            drive,
            (np.arange(frames) * 1e-4).astype(np.float64),
            position=rng.random((frames, links, 2)),
            tension=rng.random((frames, links)),
            sprocket_angle=rng.random((frames, sprockets)),
        )
        for variant in range(2)
    }
    info = RunInfo(
        version="0", device="cpu", precision="float64", created="2026-01-01T00:00:00+00:00", ended="complete",
        wall_time=1.0, step=1e-5, seed=1,
    )  # fmt: skip
    return Run((drive, drive), table_of([{"tension_max": 1.0}, {"tension_max": 2.0}]), trajectories, info)


def a_folder(path: Path, run: Run) -> tuple[Path, pa.Table, dict[int, Any]]:
    """A study's folder of two shards whose results are made up; its table, and the positions that it recorded."""
    source = path.with_suffix(".toml")
    first, second = "levels = [1000.0, 2000.0]", "levels = [74, 76]"
    source.write_text(STUDY.format(drive="marine", kind="factorial", more="", first=first, second=second))
    study = load_study(source)
    folder = make_folder(path, study, run.drives[0], make_design(study, source), 2)
    rows, kept = folder.design(), {}
    for shard in folder.shards:
        recorded = small_run(run.drives[0], shard)
        archive = folder.archive_path(shard)
        write_archive(recorded, archive, options=ArchiveOptions(attachments=folder.mark(shard)))
        measured = table_of([{"tension_max": float(shard), "status": "ok", "reason": ""}] * 2)
        found = [Variant(row, measured=(measured, i)) for i, row in enumerate(rows.slice(2 * shard, 2).to_pylist())]
        found[0].archive = (archive.name, 0)
        folder.write(folder.table_path(shard), results_table(study, rows.slice(2 * shard, 2), found))
        kept[2 * shard] = recorded[0].position
    merge_study(path)
    return path, read_results(path / "results.parquet").table, kept


@contextlib.contextmanager
def in_time() -> Iterator[None]:
    """Raises TimeoutError in what takes too long."""

    def late(*_: object) -> None:
        raise TimeoutError(f"more than {PATIENCE} s")

    previous = signal.signal(signal.SIGALRM, late)
    signal.alarm(PATIENCE)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, previous)


def attempt(case: Callable[[Random], None], seed: int) -> str:
    """Runs one case; returns what became of it, and tells a broken one on standard error."""
    try:
        with in_time(), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            case(np.random.default_rng(seed))
    except WarpchainError:
        return "refused"
    except Exception:
        print(f"broken: seed {seed}\n{traceback.format_exc(limit=-4)}", file=sys.stderr)
        return "broken"
    return "accepted"


def fuzz(kinds: list[str], count: int, seed: int, folder: Path) -> dict[str, Counter[str]]:
    """Runs `count` cases of each kind from a seed on; returns how many were accepted, refused and broken."""
    state = Fuzz(folder)
    cases: dict[str, Any] = {
        "drives": state.drive, "studies": state.study, "tables": state.a_table, "archives": state.archive,
        "folders": state.a_folder, "commands": state.command,
    }  # fmt: skip
    return {kind: Counter(attempt(cases[kind], seed + k) for k in range(count)) for kind in kinds}


KINDS = ("drives", "studies", "tables", "archives", "folders", "commands")


def parser() -> argparse.ArgumentParser:
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("--kind", nargs="+", choices=KINDS, default=list(KINDS))
    words.add_argument("--count", type=int, default=1000)
    words.add_argument("--seed", type=int, default=0)
    return words


def main() -> int:
    arguments = parser().parse_args()
    faulthandler.enable()
    broken = 0
    for kind in arguments.kind:
        with tempfile.TemporaryDirectory() as folder:
            found = fuzz([kind], arguments.count, arguments.seed, Path(folder))[kind]
        words = ", ".join(f"{found[word]} {word}" for word in ("refused", "accepted", "broken"))
        print(f"{kind}: {arguments.count} tried, {words}", flush=True)
        broken += found["broken"]
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
