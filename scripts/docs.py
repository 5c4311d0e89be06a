"""The documents: lists the cases, or makes one of tables, notebooks and site.

    python scripts/docs.py
    python scripts/docs.py CASE [OPTIONS]

With `--help` after its name a case says what it makes and its options. The cases are in `pages/`.
"""

from functools import partial

from common.cases import cases_of, cases_parser, run_case

CASES = cases_of("pages")
parser = partial(cases_parser, __doc__, CASES)
main = partial(run_case, __doc__, CASES)

if __name__ == "__main__":
    main()
