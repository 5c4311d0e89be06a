"""Pieces of a self-contained HTML page: sections, tables, numbers, figures as data."""

from __future__ import annotations

import base64
import io
import math
import re
from collections.abc import Iterable, Sequence
from html import escape
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAGE_STYLE = """
:root { color-scheme: light; }
body { font: 16px/1.5 system-ui, "DejaVu Sans", Arial, sans-serif; margin: 0; }
body { color: #22303c; background: #f6f7f9; }
main { max-width: 1180px; margin: 0 auto; padding: 1.2rem 1.5rem 4rem; }
h1 { font-size: 1.7rem; margin: 0.6rem 0 0.2rem; }
h2 { font-size: 1.25rem; margin: 0 0 0.4rem; }
h3 { font-size: 1rem; margin: 1.2rem 0 0.3rem; }
section { background: white; border: 1px solid #dde2e7; border-radius: 8px; padding: 1rem 1.3rem; margin: 1rem 0; }
nav a { margin-right: 1rem; white-space: nowrap; }
a { color: #1f5f8b; }
p, ul { margin: 0.4rem 0; max-width: 75ch; }
.muted { color: #5d6b78; font-size: 0.92rem; }
.counts { display: flex; gap: 0.8rem; flex-wrap: wrap; margin: 0.6rem 0; }
.counts div { border-radius: 8px; padding: 0.5rem 1.1rem; background: #eef2f6; min-width: 7rem; }
.counts b { font-size: 1.6rem; display: block; }
.counts .ok { background: #e3f3e8; }
.counts .suspect { background: #fdeed8; }
.counts .infeasible { background: #fdf3d8; }
.counts .diverged { background: #fbe3e4; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-size: 0.9rem; margin: 0.5rem 0; }
th, td { border-bottom: 1px solid #e4e8ec; padding: 0.25rem 0.7rem; text-align: left; vertical-align: top; }
th { background: #f1f4f7; font-weight: 600; }
td.n, th.n { text-align: right; font-variant-numeric: tabular-nums; }
"""
"""CSS that HTML pages of a run and of a study share."""
PRINT_STYLE = """
img { max-width: 100%; height: auto; display: block; margin: 0.6rem 0; }
@media print { img, tr { break-inside: avoid; } h2, h3 { break-after: avoid; } }
@media print { body { background: white; } section { border: 0; padding: 0; } nav { display: none; } }
"""
"""CSS of an HTML page without a script."""


class PageSection(NamedTuple):
    """A section of an HTML page: anchor, title, and parts as HTML."""

    name: str
    title: str
    parts: tuple[str, ...]

    def section_html(self) -> str:
        """The page section as HTML."""
        inside = "\n".join(part for part in self.parts if part)
        return f'<section id="{escape(self.name)}">\n<h2>{escape(self.title)}</h2>\n{inside}\n</section>'


def page_html(title: str, sections: Sequence[PageSection], style: str = PRINT_STYLE, end: str = "") -> str:
    """A whole HTML page of sections, with links to them, and `end`."""
    links = " ".join(f'<a href="#{escape(s.name)}">{escape(s.title)}</a>' for s in sections)
    body = "\n".join([f"<h1>{escape(title)}</h1>", f"<nav>{links}</nav>", *(s.section_html() for s in sections)])
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<title>{escape(title)}</title>\n'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<style>{PAGE_STYLE}{style}</style>\n</head>\n"
        f"<body>\n<main>\n{body}\n</main>\n{end}</body>\n</html>\n"
    )


def page_section(name: str, title: str, *parts: str) -> PageSection:
    """A section of an HTML page from anchor, title and nonempty parts."""
    return PageSection(name, title, parts)


def heading_html(words: str) -> str:
    """A heading inside a section, as HTML."""
    return f"<h3>{escape(words)}</h3>"


def paragraph_html(words: str, muted: bool = False) -> str:
    """A paragraph as HTML."""
    return f'<p class="muted">{escape(words)}</p>' if muted else f"<p>{escape(words)}</p>"


def bullets_html(lines: Iterable[str]) -> str:
    """A bulleted list as HTML."""
    return "<ul>\n" + "\n".join(f"<li>{escape(line)}</li>" for line in lines) + "\n</ul>"


def engineering_number(value: float, digits: int = 5) -> str:
    """A number as a page's text: plain from 0.001 to a million, else with a power of ten."""
    if value != value:
        return "\N{EN DASH}"
    size = abs(value)
    if not 1e-3 <= size < 1e6:
        return f"{value:.{digits}g}"
    decimals = max(0, digits - 1 - math.floor(math.log10(size)))
    plain = f"{value:.{decimals}f}"
    return plain.rstrip("0").rstrip(".") if decimals else plain


def column_number(value: float, decimals: int) -> str:
    """A number as text with its table column's decimals, at least two digits."""
    return (
        engineering_number(value, significant_digits(value, decimals))
        if math.isfinite(value)
        else engineering_number(value)
    )


def significant_digits(value: float, decimals: int) -> int:
    """Significant digits (2 to 15) of a table's number with so many decimals."""
    return max(2, min(15, decimals + 1 + math.floor(math.log10(abs(value))))) if value else 2


def _cell_text(value: Any) -> str:
    """An HTML table cell's value as text, a dash for None."""
    if value is None:
        return "\N{EN DASH}"
    return engineering_number(value) if isinstance(value, float) else str(value)


_NUMBER_PATTERN = re.compile(r"-?\d+(\.\d+)?(e[-+]\d+)?|\N{EN DASH}")


def _is_number_cell(value: Any) -> bool:
    """Whether an HTML table cell is a number, or empty."""
    return isinstance(value, int | float) or bool(_NUMBER_PATTERN.fullmatch(_cell_text(value)))


def _breakable_name(word: str) -> str:
    """A column's name as HTML that may break behind dots and underscores."""
    return re.sub(r"([._])", r"\1<wbr>", escape(word))


def table_html(heads: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """A table as HTML, columns of numbers on the right."""
    rows = [list(row) for row in rows]
    right = [bool(rows) and all(_is_number_cell(row[k]) for row in rows) for k in range(len(heads))]
    kinds = [' class="n"' if r else "" for r in right]
    head = "".join(f"<th{kind}>{_breakable_name(word)}</th>" for word, kind in zip(heads, kinds, strict=True))
    lines = (
        "<tr>" + "".join(f"<td{k}>{escape(_cell_text(v))}</td>" for v, k in zip(row, kinds, strict=True)) + "</tr>"
        for row in rows
    )
    top = f"<thead><tr>{head}</tr></thead>"  # which a table's every page has in print
    return f'<div class="wide"><table>\n{top}\n' + "\n".join(lines) + "\n</table></div>"


def picture_html(figure: Figure, words: str, kind: str = "svg+xml") -> str:
    """A figure as an HTML image of SVG or PNG, described by `words`."""
    import matplotlib

    buffer = io.BytesIO()
    with matplotlib.rc_context({"svg.hashsalt": "warpchain", "svg.fonttype": "path"}):
        figure.savefig(buffer, format=kind[:3], metadata={"Date": None} if kind[:3] == "svg" else None, dpi=110)
    data = base64.b64encode(buffer.getvalue()).decode()
    width = int(72 * figure.get_figwidth() * 1.25)
    return f'<img src="data:image/{kind};base64,{data}" width="{width}" alt="{escape(words)}">'
