"""The page of a study: what `view.html` has, with figures and rows as data, style and script. Nothing is fetched."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from warpchain.errors import StudyError
from warpchain.files import read_text
from warpchain.view.html import STYLE, Section, bullets, heading, number, section, table, text

__all__ = [
    "Section",
    "bullets",
    "chart",
    "data",
    "heading",
    "hint",
    "number",
    "page",
    "place",
    "section",
    "table",
    "text",
]

_HERE = Path(__file__).parent


def page(title: str, sections: Sequence[Section], rows: Mapping[str, Any] | None = None) -> str:
    """A whole HTML document: heading, links to the sections, sections, the rows and the script that shows them."""
    links = " ".join(f'<a href="#{escape(s.name)}">{escape(s.title)}</a>' for s in sections)
    body = "\n".join([f"<h1>{escape(title)}</h1>", f"<nav>{links}</nav>", *(s.html() for s in sections)])
    style, script = (read_text(_HERE / name, "text", StudyError) for name in ("page.css", "page.js"))
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<title>{escape(title)}</title>\n'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<style>{STYLE}{style}</style>\n</head>\n"
        f'<body>\n<main>\n{body}\n</main>\n<div id="tip"></div>\n'
        f'<script type="application/json" id="report-data">{data(rows)}</script>\n<script>\n{script}</script>\n'
        f"</body>\n</html>\n"
    )


def data(values: Any) -> str:
    """Values as JSON that can stand in a script element."""
    text = json.dumps(values, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return text.replace("<", "\\u003c")


def chart(panels: Sequence[Mapping[str, Any]], words: str) -> str:
    """Panels that the page's script draws; `words` is what they are called by those who cannot see them."""
    if not panels:
        return ""
    inside = f'<script type="application/json">{data(panels)}</script>'
    return f'<div class="panels" role="group" aria-label="{escape(words)}">{inside}</div>'


def hint(words: str) -> str:
    """What one can do with the page, which is not printed."""
    return f'<p class="muted screen">{escape(words)}</p>'


def place(name: str, words: str = "") -> str:
    """An empty place that the page's script fills."""
    return f'<div id="{escape(name)}" aria-label="{escape(words)}"></div>'
