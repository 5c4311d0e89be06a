"""Benchmarks: lists the cases, or runs one.

    python scripts/bench.py
    python scripts/bench.py CASE [OPTIONS]

With `--help` after its name a case says what it measures and its options. The first line printed is the machine.
A speed is worth something as a ratio taken in one run on one machine. The cases are in `benches/`.
"""

import argparse

from common.cases import cases_of, parser_of, run
from common.timing import environment

CASES = cases_of("benches")


def parser() -> argparse.ArgumentParser:
    """The command line."""
    return parser_of(__doc__, CASES)


def main() -> None:
    """Lists the cases or runs one."""
    run(__doc__, CASES, environment)


if __name__ == "__main__":
    main()
