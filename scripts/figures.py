"""Figures and tables of the documents: lists the cases, or draws one.

    python scripts/figures.py
    python scripts/figures.py CASE [OPTIONS]

With `--help` after its name a case says what it draws and its options. The cases are in `drawings/`.
"""

import argparse

from common.cases import cases_of, parser_of, run

CASES = cases_of("drawings")


def parser() -> argparse.ArgumentParser:
    """The command line."""
    return parser_of(__doc__, CASES)


def main() -> None:
    """Lists the cases or draws one."""
    run(__doc__, CASES)


if __name__ == "__main__":
    main()
