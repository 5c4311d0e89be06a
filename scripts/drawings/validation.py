"""Published results beside those of warpchain: the table of docs/validation.md."""

import argparse
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import product
from typing import Any

from common.cases import ROOT, Line, case, option

from drawings.closed_forms import EXACT, Row
from drawings.efficiency import joints
from drawings.engines import engines
from drawings.guides import AMPLITUDE, CYCLES, text_of
from drawings.marine import marine
from drawings.other_codes import other_codes
from drawings.vibration import vibration
from warpchain import loads_drive
from warpchain.drive.examples import drive_path
from warpchain.engine.rig import Shake, shake


def tensioner_work() -> Row:
    """Work of a cycle of a hydraulic tensioner over its plunger's diameter, gap and length."""
    drive = loads_drive(drive_path("engine").read_text() + text_of("tensioners.md"))
    name, plunger = drive.tensioners[-1].name, drive.tensioners[-1].plunger
    keys, ranges = ("diameter", "gap", "length"), (0.05, 0.1, 0.2)

    def work(parts: tuple[float, ...]) -> float:
        scaled = {key: part * getattr(plunger, key) for key, part in zip(keys, parts, strict=True)}
        changed = drive.with_values({f"tensioners.{name}.plunger.{key}": value for key, value in scaled.items()})
        return float(shake(changed, name, [Shake(AMPLITUDE, 100.0)], CYCLES, False).rides["work"][0].as_py())

    base = work((1.0, 1.0, 1.0))
    gains = [max(map(work, product((1.0 - part, 1.0 + part), repeat=3))) / base - 1.0 for part in ranges]
    return Row(
        name="hydraulic tensioner",
        source="Song (2015), master's thesis, abstract",
        states="orthogonal experiment over plunger diameter, gap and its length: damping energy +59.7 %",
        drive="[tensioner of a passenger car](tensioners.md), 0.2 mm at 100 Hz; all three by 5, 10, 20 % up or down",
        gives=", ".join(f"{100.0 * gain:+.0f} %" for gain in gains),
        differs="the source's ranges and base are not public",
        verdict="the band covers it; no more can be said",
    )


DETERMINISM = Row(
    name="determinism",
    source="promises of this project",
    states="a variant has the same bits alone, in any crowd, after a kill, in shards",
    drive="test drives, examples, studies",
    gives="holds, with the exceptions that [devices](devices.md#reproducible-results) lists",
    differs="none",
    verdict="held by tests; more than Warp and Newton promise (below)",
)


def closed_forms() -> Iterator[Line]:
    """Rows with exact results."""
    for row in EXACT:
        yield row()


PARTS: dict[str, Callable[[], Iterable[Line]]] = {
    "closed-forms": closed_forms,
    "vibration": vibration,
    "joints": joints,
    "marine": marine,
    "tensioner": lambda: [tensioner_work()],
    "engines": engines,
    "determinism": lambda: [DETERMINISM],
    "codes": other_codes,
}
USUAL = [part for part in PARTS if part != "codes"]
"""Parts that need no other codes."""


PAGE = ROOT / "docs" / "validation.md"


def with_rows(page: str, rows: Iterable[Row]) -> str:
    """The page with its rows of these names replaced; a new one goes below the row before it."""
    lines = page.split("\n")
    at = max(k for k, line in enumerate(lines) if line.startswith("| polygon action |"))
    for row in rows:
        found = [k for k, line in enumerate(lines) if line.startswith(f"| {row.name} |")]
        at = found[0] if found else at + 1
        lines[at : at + len(found)] = [f"| {' | '.join(row)} |"]
    return "\n".join(lines)


@case(
    option("--part", nargs="+", choices=PARTS, default=USUAL, help="only these rows and figures"),
    option("--write", action="store_true", help="put the rows into docs/validation.md"),
)
def validation(asked: argparse.Namespace) -> Iterator[Line]:
    """Closed forms and published results, beside those of warpchain.

    python scripts/figures.py validation [--write]
    python scripts/figures.py validation --part codes [--write]

    Prints the table of docs/validation.md and draws its figures. Nothing is tuned: values that a source does not state
    are swept. Helpers of tests/ compute the closed forms; they need the extra `dev`. The part `codes` is left out
    unless it is named; it needs the extra `codes`.
    """
    figures: dict[str, Any] = {}
    rows: list[Row] = []
    yield ("", "source", "states", "drive here", "warpchain gives", "difference", "verdict")
    for part in asked.part:
        for line in PARTS[part]():
            if isinstance(line, Mapping):
                figures |= line
            else:
                rows += [line] if isinstance(line, Row) else []
                yield line
    if asked.write:
        PAGE.write_text(with_rows(PAGE.read_text(), rows))
    yield figures
