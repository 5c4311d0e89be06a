"""Pieces of a self-contained HTML page: tables, figures and rows as data, style and script. Nothing is fetched."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any, NamedTuple

from warpchain.errors import StudyError
from warpchain.files import read_text

_HERE = Path(__file__).parent


class Section(NamedTuple):
    """A part of the page with an anchor."""

    name: str
    title: str
    parts: tuple[str, ...]

    def html(self) -> str:
        """The section as HTML."""
        inside = "\n".join(part for part in self.parts if part)
        return f'<section id="{escape(self.name)}">\n<h2>{escape(self.title)}</h2>\n{inside}\n</section>'


def page(title: str, sections: Sequence[Section], rows: Mapping[str, Any] | None = None) -> str:
    """A whole HTML document: heading, links to the sections, sections, the rows and the script that shows them."""
    links = " ".join(f'<a href="#{escape(s.name)}">{escape(s.title)}</a>' for s in sections)
    body = "\n".join([f"<h1>{escape(title)}</h1>", f"<nav>{links}</nav>", *(s.html() for s in sections)])
    style, script = (read_text(_HERE / name, "text", StudyError) for name in ("page.css", "page.js"))
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<title>{escape(title)}</title>\n'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">\n<style>{style}</style>\n</head>\n'
        f'<body>\n<main>\n{body}\n</main>\n<div id="tip"></div>\n'
        f'<script type="application/json" id="report-data">{data(rows)}</script>\n<script>\n{script}</script>\n'
        f"</body>\n</html>\n"
    )


def data(values: Any) -> str:
    """Values as JSON that can stand in a script element."""
    text = json.dumps(values, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return text.replace("<", "\\u003c")


def section(name: str, title: str, *parts: str) -> Section:
    """A section of these parts; empty ones are left out."""
    return Section(name, title, parts)


def heading(words: str) -> str:
    """A heading inside a section."""
    return f"<h3>{escape(words)}</h3>"


def text(words: str, muted: bool = False) -> str:
    """A paragraph."""
    return f'<p class="muted">{escape(words)}</p>' if muted else f"<p>{escape(words)}</p>"


def bullets(lines: Iterable[str]) -> str:
    """A list."""
    return "<ul>\n" + "\n".join(f"<li>{escape(line)}</li>" for line in lines) + "\n</ul>"


def number(value: float, digits: int = 5) -> str:
    """A number as engineers write it: plain from 0.001 to a million, with a power of ten beyond."""
    if value != value:
        return "\N{EN DASH}"
    size = abs(value)
    if not 1e-3 <= size < 1e6:
        return f"{value:.{digits}g}"
    decimals = max(0, digits - 1 - math.floor(math.log10(size)))
    plain = f"{value:.{decimals}f}"
    return plain.rstrip("0").rstrip(".") if decimals else plain


def _cell(value: Any) -> str:
    if value is None:
        return "\N{EN DASH}"
    return number(value) if isinstance(value, float) else str(value)


def _breakable(word: str) -> str:
    """A column's name that may be broken behind its dots and underscores."""
    return re.sub(r"([._])", r"\1<wbr>", escape(word))


def table(heads: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """A table; columns of numbers are set to the right."""
    rows = [list(row) for row in rows]
    right = [
        bool(rows) and all(isinstance(row[k], int | float) or row[k] is None for row in rows) for k in range(len(heads))
    ]
    kinds = [' class="n"' if r else "" for r in right]
    head = "".join(f"<th{kind}>{_breakable(word)}</th>" for word, kind in zip(heads, kinds, strict=True))
    lines = (
        "<tr>" + "".join(f"<td{k}>{escape(_cell(v))}</td>" for v, k in zip(row, kinds, strict=True)) + "</tr>"
        for row in rows
    )
    return f'<div class="wide"><table>\n<tr>{head}</tr>\n' + "\n".join(lines) + "\n</table></div>"


def chart(panels: Sequence[Mapping[str, Any]], words: str) -> str:
    """Panels that the page's script draws; `words` is what they are called by those who cannot see them."""
    if not panels:
        return ""
    inside = f'<script type="application/json">{data(panels)}</script>'
    return f'<div class="panels" role="group" aria-label="{escape(words)}">{inside}</div>'


def place(name: str, words: str = "") -> str:
    """An empty place that the page's script fills."""
    return f'<div id="{escape(name)}" aria-label="{escape(words)}"></div>'
