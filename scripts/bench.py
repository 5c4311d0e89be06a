"""Benchmarks: lists the cases, or runs one.

    python scripts/bench.py
    python scripts/bench.py CASE [OPTIONS]

With `--help` after its name a case says what it measures and its options. The first line printed is the machine.
A speed is worth something as a ratio taken in one run on one machine. The cases are in `benches/`.
"""

from functools import partial

from common.cases import cases_of, parser_of, run
from common.timing import environment

CASES = cases_of("benches")
parser = partial(parser_of, __doc__, CASES)
main = partial(run, __doc__, CASES, environment)

if __name__ == "__main__":
    main()
