"""Figures and tables of the documents: lists the cases, or draws one.

    python scripts/figures.py
    python scripts/figures.py CASE [OPTIONS]

With `--help` after its name a case says what it draws and its options. Figures go to docs/images, or to the folder that
`-o` names. The cases are in `drawings/`.
"""

from functools import partial

from common.cases import cases_of, cases_parser, run_case

CASES = cases_of("drawings")
parser = partial(cases_parser, __doc__, CASES)
main = partial(run_case, __doc__, CASES)

if __name__ == "__main__":
    main()
