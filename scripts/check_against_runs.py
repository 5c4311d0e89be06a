"""The table of docs/check.md: mean strand tensions that `warpchain check` prints, and those of runs.

python scripts/check_against_runs.py [NAME ...]
"""

from __future__ import annotations

import argparse
import sys

import numpy as np

from warpchain import Record, load_drive, simulate
from warpchain.assembly.statics import running
from warpchain.drive.examples import drive_path

RUNS = {"engine": (0.1, 0.2), "industrial": (0.5, 1.0), "marine": (1.0, 2.0), "motorcycle": (0.15, 0.3)}
"""Window of each run's metrics [s]."""


def parser() -> argparse.ArgumentParser:
    """The command's words."""
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("name", nargs="*", help="example drives; all of them if none is named")
    return words


def main(words: list[str] | None = None) -> int:
    """Prints the table, a row a strand; returns the exit status."""
    names = parser().parse_args(words).name or list(RUNS)
    print("| strand | `check` | a run | off, of the tightest |\n|---|---|---|---|")
    for name in names:
        drive, window = load_drive(drive_path(name)), RUNS[name]
        (row,) = simulate(drive, record=Record("none"), duration=window[1], window=window).metrics.to_pylist()
        found = np.array([row[f"{strand}.tension_mean"] for strand in drive.strand_names])
        for strand, said, seen in zip(drive.strand_names, running(drive).tension, found, strict=True):
            off = 100.0 * (said - seen) / found.max()
            print(f"| {name}: {strand} | {said:.4g} N | {seen:.4g} N | {off:+.1f} % |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
