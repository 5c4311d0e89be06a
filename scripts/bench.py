"""Benchmarks: lists the cases, or runs one.

    python scripts/bench.py
    python scripts/bench.py CASE [OPTIONS]

With `--help` after its name a case says what it measures and its options. The first line printed is the machine.
A speed is worth something as a ratio taken in one run on one machine. The cases are in `benches/`.
"""

from functools import partial

from common.cases import cases_of, cases_parser, run_case
from common.timing import machine_line

CASES = cases_of("benches")
parser = partial(cases_parser, __doc__, CASES)
main = partial(run_case, __doc__, CASES, machine_line)

if __name__ == "__main__":
    main()
