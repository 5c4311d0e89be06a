"""Making a run's page and writing it."""

from __future__ import annotations

from pathlib import Path

from warpchain.errors import ArchiveError
from warpchain.files import refusals, write_text
from warpchain.results.handed_in import HandedIn, Wear, window_of
from warpchain.results.run import Run
from warpchain.view import html
from warpchain.view.chosen import recorded
from warpchain.view.report.sections import heading, sections


def report_html(
    source: Run | str | Path, variant: int | None = None, title: str | None = None, wear: Wear | None = None
) -> str:
    """The page of a recorded variant, as text; `report` has the arguments."""
    chosen = recorded(source, variant)
    row = chosen.run.metrics.to_pylist()[chosen.run.row_of(chosen.index)]
    found = HandedIn(chosen.trajectory, *window_of(row, chosen.trajectory), wear)
    return html.page(title or heading(found), list(sections(found, row, chosen.run)))


def report(
    source: Run | str | Path,
    path: str | Path,
    variant: int | None = None,
    title: str | None = None,
    wear: Wear | None = None,
) -> Path:
    """Writes what engineers hand in of a recorded run as one HTML page that needs nothing else.

    Args:
        source: a run, or an archive's path.
        path: the page's; one of that name is replaced.
        variant: which variant; None is the first recorded.
        title: heading of the page; None says what was run.
        wear: how the joints wear; None takes the defaults.

    Returns:
        The page's path.

    Raises:
        ArchiveError: an archive that cannot be read, or a page that cannot be written.
        SimulationError: a variant that was not recorded, or a channel without which no drive can be drawn.
    """
    text = report_html(source, variant, title, wear)
    target = Path(path)
    with refusals(target, ArchiveError):
        write_text(target, text)
    return target
