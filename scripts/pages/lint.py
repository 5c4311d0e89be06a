"""The prose of the documents: proselint with rules of the house."""

import argparse
import json
import re
from collections.abc import Iterable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

from common.cases import ROOT, Line, case, case_option

if TYPE_CHECKING:
    from proselint.registry.checks import Check, CheckResult

MOST_WORDS = 30
MOST_PAGE_WORDS = 2500
REFERENCES = {"drive-file", "scripts"}
"""Pages that list every key, however many there are."""
WORDS = {
    "anew": "again",
    "foresee": "predict",
    "handed in": "delivered",
    "heft": "effective mass",
    "hurry": "invalidate",
    "manieth": "number of the",
    "nudge": "perturb",
    "of today": "current",
    "runs away": "is unstable",
    "standing drive": "steady state",
    "stood": "was",
    "told": "stated",
    "touched": "changed",
}
"""Words that say less than the field's own terms do, and what to write instead."""
OF_PROSELINT = [
    "archaism", "cliches", "hedging", "industrial_language", "lexical_illusions", "malapropisms", "mixed_metaphors",
    "mondegreens", "needless_variants", "nonwords", "oxymorons", "redundancy", "spelling", "terms", "uncomparables",
    "weasel_words",
]  # fmt: skip
"""Proselint's own checks that technical English can keep."""


def document_pages() -> list[Path]:
    """README, CONTRIBUTING, the pages of docs/ and the tutorials."""
    docs = ROOT / "docs"
    tutorials = [path for path in (docs / "tutorials").iterdir() if path.suffix in (".md", ".ipynb")]
    return [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(docs.glob("*.md")), *sorted(tutorials)]


def page_texts(path: Path) -> Iterator[tuple[str, str]]:
    """The Markdown of a page with the place at which it is: the page's, or that of each cell of a notebook."""
    name = str(path.relative_to(ROOT) if path.is_relative_to(ROOT) else path)
    if path.suffix != ".ipynb":
        yield name, path.read_text()
        return
    for k, cell in enumerate(json.loads(path.read_text())["cells"]):
        if cell["cell_type"] == "markdown":
            yield f"{name}, cell {k + 1}", "".join(cell["source"])


def page_blocks(text: str) -> Iterator[tuple[int, bool, str]]:
    """Headings, paragraphs and cells of tables: line, whether it is a heading, and its words.

    Code is one word, and so is a link, which names its page; pictures are none.
    """
    from markdown_it import MarkdownIt

    tokens = MarkdownIt("commonmark").enable("table").parse(text)
    for before, token in pairwise(tokens):
        if token.type == "inline":
            line = (token.map or before.map or [0])[0] + 1
            yield line, before.type == "heading_open", "".join(inline_text(token.children or ()))


def inline_text(children: Iterable[Any]) -> Iterator[str]:
    """Texts of inline tokens, code and links as one word each."""
    within = False
    for child in children:
        if child.type in ("link_open", "link_close"):
            within = child.type == "link_open"
        elif child.type in ("softbreak", "hardbreak"):
            yield "\n"
        elif child.type == "code_inline":
            yield "`code`"
        elif child.type == "text":
            thousands = re.sub(r"(?<=\d) (?=\d{3})", "_", child.content)
            yield child.content.replace(" ", "_") if within else thousands


def long_sentences(text: str, check: "Check") -> Iterator["CheckResult"]:
    """Sentences of too many words; numbers are none."""
    for sentence in re.finditer(r"\S.*?(?:[.!?](?=\s+[^a-z\s])|\Z)", text, re.DOTALL):
        if (count := len(re.findall(r"\S*[^\W\d_]\S*", sentence[0]))) > MOST_WORDS:
            begin = " ".join(sentence[0].split()[:6])
            yield lint_result(check, sentence, f"a sentence of {count} words, at most {MOST_WORDS}: {begin} ...")


def nested_parentheses(text: str, check: "Check") -> Iterator["CheckResult"]:
    """Parentheses within parentheses; those of formulas have signs."""
    for found in re.finditer(r"(?<!\S)\((?=[A-Za-z])[^()+*/^]*\s\([^()+*/^]*\)", text):
        yield lint_result(check, found, "parentheses within parentheses")


def question_headings(text: str, check: "Check") -> Iterator["CheckResult"]:
    """Headings that ask."""
    if found := re.match(r"\s*((?:What|How)\b.*)", text):
        yield lint_result(check, found, f'a heading that begins with "{found[1].split()[0]}"; name the thing')


def lint_result(check: "Check", found: "re.Match[str]", message: str) -> "CheckResult":
    """Result of a check for a match, with a message."""
    from proselint.registry.checks import CheckResult

    return CheckResult(check.path, message, found.span(), None)


def register_rules() -> None:
    """Registers proselint's checks and those of the house, once."""
    from proselint.checks import __register__
    from proselint.registry import CheckRegistry
    from proselint.registry.checks import Check, types

    registry = CheckRegistry()
    if registry.checks:
        return
    registry.register_many(__register__)
    preferred = types.PreferredFormsSimple(WORDS)
    registry.register_many(
        (
            Check(check_type=preferred, path="house.words", message="'{1}'; write '{0}'"),
            Check(check_type=long_sentences, path="house.sentences"),
            Check(check_type=nested_parentheses, path="house.parentheses"),
            Check(check_type=question_headings, path="headings"),
        )
    )


def page_faults(path: Path) -> Iterator[str]:
    """The faults of a page, a line each: place, rule and fault."""
    from proselint.config import Config
    from proselint.tools import LintFile

    register_rules()
    enabled = dict.fromkeys(("house", *OF_PROSELINT), True)
    count, name = 0, ""
    for name, text in page_texts(path):
        for line, heading, words in page_blocks(text):
            count += len(words.split())
            if not words.strip():
                continue
            config = Config(max_errors=100, checks=enabled | {"headings": heading})
            for result, _ in LintFile(name, words).lint(config):
                row = words.count("\n", 0, max(result.span[0] - 1, 0))  # the linter puts a line before the text
                yield f"{name}:{line + row}: {result.check_path}: {result.message}"
    if count > MOST_PAGE_WORDS and path.stem not in REFERENCES:
        yield f"{name}:1: house.pages: a page of {count} words, at most {MOST_PAGE_WORDS}: make two of it"


@case(case_option("pages", nargs="*", type=Path, help="default: all"))
def lint(asked: argparse.Namespace) -> Iterator[Line]:
    """Checks the prose of the documents: short sentences, plain words, headings that name things.

    python scripts/docs.py lint [PAGE ...]

    Proselint's checks, and those of the house: no sentence over 30 words, no parentheses within parentheses, no heading
    that begins with "What" or "How", no word of `WORDS` in pages/lint.py, no page over 2,500 words but lists of keys.
    A line of output is a fault; status 1 if there is any. Needs the extra `dev`.
    """
    found = [fault for path in asked.pages or document_pages() for fault in page_faults(path.resolve())]
    yield from found
    if found:
        raise SystemExit(1)
