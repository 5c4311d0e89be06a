"""Published results beside those of warpchain: docs/validation.md and docs/validation-published.md."""

import argparse
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import product
from pathlib import Path
from typing import Any

from common.cases import ROOT, Line, case, case_option

from drawings.car import engines
from drawings.closed_forms import EXACT, ValidationRow
from drawings.efficiency import joint_losses
from drawings.guides import AMPLITUDE, CYCLES, drive_text_of_document
from drawings.marine import marine
from drawings.other_codes import other_codes
from drawings.silent import silent_beside_roller
from drawings.vibration import vibration
from warpchain import loads_drive
from warpchain.drive.examples import drive_path
from warpchain.engine.tensioner_bench import PlungerMotion, shake_tensioner


def tensioner_work() -> ValidationRow:
    """Work of a cycle of a hydraulic tensioner over its plunger's diameter, gap and length."""
    drive = loads_drive(drive_path("engine").read_text() + drive_text_of_document("tensioners.md"))
    name, plunger = drive.tensioners[-1].name, drive.tensioners[-1].plunger
    keys, ranges = ("diameter", "gap", "length"), (0.05, 0.1, 0.2)

    def cycle_work(parts: tuple[float, ...]) -> float:
        """Work of a ride [J] with the plunger's sizes times parts."""
        scaled = {key: part * getattr(plunger, key) for key, part in zip(keys, parts, strict=True)}
        changed = drive.with_values({f"tensioners.{name}.plunger.{key}": value for key, value in scaled.items()})
        return float(
            shake_tensioner(changed, name, [PlungerMotion(AMPLITUDE, 100.0)], CYCLES, False).rides["work"][0].as_py()
        )

    base = cycle_work((1.0, 1.0, 1.0))
    gains = [max(map(cycle_work, product((1.0 - part, 1.0 + part), repeat=3))) / base - 1.0 for part in ranges]
    return ValidationRow(
        name="hydraulic tensioner",
        gives=", ".join(f"{100.0 * gain:+.0f} %" for gain in gains),
    )


PARTS: dict[str, Callable[[], Iterable[Line]]] = {
    "closed-forms": lambda: (row() for row in EXACT),
    "vibration": vibration,
    "joints": joint_losses,
    "marine": marine,
    "tensioner": lambda: [tensioner_work()],
    "engines": lambda: [engines()],
    "silent": silent_beside_roller,
    "codes": other_codes,
}
USUAL = [part for part in PARTS if part != "codes"]
"""Parts that need no other codes."""
PAGES = tuple(ROOT / "docs" / f"{name}.md" for name in ("validation", "validation-published"))
LABELS = ("Source", "States", "Drive here", "warpchain gives", "Difference", "Verdict")
"""Items of a result's list on the page, in the order of the fields of `ValidationRow` after its name."""


def renewed_page(row: ValidationRow, pages: Mapping[Path, str]) -> tuple[Path, str, str]:
    """The page that has the section of a row, the section, and the same with what is computed.

    Raises:
        SystemExit: a row that no page has.
    """
    title = row.name[0].upper() + row.name[1:]
    for path, page in pages.items():
        found = re.search(rf"^### {re.escape(title)}\n\n((?:- .*\n)+)", page, re.M)
        if found is not None:
            stated = dict(line.removeprefix("- ").split(": ", 1) for line in found[1].splitlines())
            items = (f"- {label}: {mine or stated[label]}\n" for label, mine in zip(LABELS, row[1:], strict=True))
            return path, found[0], f"### {title}\n\n{''.join(items)}"
    raise SystemExit(f"docs/validation.md: no section {row.name!r}; write its words there")


@case(
    case_option("--part", nargs="+", choices=PARTS, default=USUAL, help="only these rows and figures"),
    case_option("--write", action="store_true", help="put the results into the pages"),
)
def validation(asked: argparse.Namespace) -> Iterator[Line]:
    """Closed forms and published results, beside those of warpchain.

    python scripts/figures.py validation [--write]
    python scripts/figures.py validation --part codes [--write]

    Prints the results of docs/validation.md and validation-published.md and draws their figures. Nothing is tuned:
    values that a source does not state are swept. Helpers of tests/ compute the closed forms; they need the extra
    `dev`. The part `codes` is left out unless it is named; it needs the extra `codes`.
    """
    figures: dict[str, Any] = {}
    pages = {path: path.read_text() for path in PAGES}
    for part in asked.part:
        for line in PARTS[part]():
            if isinstance(line, Mapping):
                figures |= line
            elif isinstance(line, ValidationRow):
                path, stated, made = renewed_page(line, pages)
                pages[path] = pages[path].replace(stated, made)
                yield made
    for path, page in pages.items() if asked.write else ():
        path.write_text(page)
    yield figures
