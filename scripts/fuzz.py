#!/usr/bin/env python
"""Feeds drive files, study files, tables and archives that were changed at random to what reads them.

    python scripts/fuzz.py --kind drives studies tables archives --count 1000 --seed 0

Each case starts from something right and changes it: bits, bytes, lines, numbers, pieces of others. It is accepted,
refused (by a `WarpchainError`), or broken: any other exception, more than `PATIENCE` seconds, or an archive or a
study's table that reads back with other values than were written. Prints how many cases of each kind were which; a
broken one with its seed, by which `--seed S --count 1` repeats it. Exit status 1 if there is any.
"""

from __future__ import annotations

import argparse
import contextlib
import faulthandler
import signal
import sys
import tempfile
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from warpchain.archive import read_archive, write_archive
from warpchain.archive.options import ArchiveOptions
from warpchain.archive.recover import recover_archive
from warpchain.assembly import assemble
from warpchain.assembly.timestep import resolve_step
from warpchain.drive import Drive, Guide, dumps_drive, load_drive, loads_drive
from warpchain.drive.attached import read_points
from warpchain.drive.examples import drive_path
from warpchain.drive.table import read_csv
from warpchain.errors import WarpchainError
from warpchain.results.metrics import table_of
from warpchain.results.run import Run, RunInfo, Trajectory
from warpchain.study.design import make_design
from warpchain.study.spec import check_drive, load_study
from warpchain.study.store import read_table, write_table

PATIENCE = 30
"""Seconds that a case may take on a busy machine."""
NUMBERS = (
    *("0", "-1", "1", "0.0", "-0.0", "0.5", "65536", "1e9", "1e-300", "1e300", "1e308", "-1e308", "inf", "-inf", "nan"),
    *("2147483648", "9223372036854775808", "-9223372036854775809", "9" * 40, "true", '"x"', "[]", "{}"),
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
        line, word = lines[at], str(rng.choice(NUMBERS))
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
        path = self.folder / "study.toml"
        path.write_bytes(changed_text(str(rng.choice(self.studies)), rng))
        study = load_study(path)
        check_drive(study, self.drives[0], "study.toml")
        if study.design.count is None or study.design.count < 10_000:
            make_design(study, path)

    def a_table(self, rng: Random) -> None:
        match int(rng.integers(4)):
            case 0:
                path = self.folder / "table.parquet"
                path.write_bytes(changed(self.parquet, rng))
                if not read_table(path).equals(self.table):
                    raise Broken("the table reads back as another one")
            case 1:
                path = self.folder / "case.csv"
                path.write_bytes(changed_text("torque,double\n1.0,74\n2.0,76\n", rng))
                read_table(path)
            case 2:
                path = self.folder / "case.csv"
                path.write_bytes(changed_text("time,torque\n0,1\n0.5,2\n1,1\n", rng))
                read_csv(path)
            case 3:
                path = self.folder / "case.csv"
                path.write_bytes(changed_text("x_mm,y_mm\n0,0\n100,5\n200,8\n300,5\n", rng))
                Guide(name="guide", profile=tuple((x, y) for x, y in read_points(path)))

    def archive(self, rng: Random) -> None:
        path, fixed = self.folder / "case.mcap", self.folder / "fixed.mcap"
        path.write_bytes(changed(self.archives[int(rng.integers(len(self.archives)))], rng))
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


def small_run(drive: Drive) -> Run:
    """A run of two variants whose frames are random numbers."""
    rng, frames, links, sprockets = np.random.default_rng(0), 6, drive.chain.links, len(drive.sprockets)
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
    }  # fmt: skip
    return {kind: Counter(attempt(cases[kind], seed + k) for k in range(count)) for kind in kinds}


KINDS = ("drives", "studies", "tables", "archives")


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
