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
:root {
  color-scheme: light dark;
  --ink: #22303c; --soft: #5d6b78; --ground: #f6f7f9; --card: #ffffff; --edge: #dde2e7; --line: #e4e8ec;
  --head: #f1f4f7; --link: #1f5f8b; --box: #eef2f6; --ok: #dcf1e3; --warn: #fdeed8; --bad: #fbe3e4; --hit: #e08a00;
  --mark: #d1495b; --accent: #1f77b4; --pale: #b4bcc4; --other: #6a4c93; --figure: #33475b; --grid: #e8ecef;
}
@media (prefers-color-scheme: dark) {
  :root {
    --ink: #dbe2e8; --soft: #9aa8b4; --ground: #11171d; --card: #1b232b; --edge: #33404c; --line: #2c3843;
    --head: #25303a; --link: #7fbce8; --box: #26313b; --ok: #1d4630; --warn: #57401a; --bad: #5c2529; --hit: #f0a63a;
    --mark: #f0717f; --accent: #58a9e0; --pale: #5e6c79; --other: #b392e0; --figure: #d3dce4; --grid: #2f3b46;
  }
}
body { font: 16px/1.5 system-ui, "DejaVu Sans", Arial, sans-serif; margin: 0; }
body { color: var(--ink); background: var(--ground); }
main { max-width: 1180px; margin: 0 auto; padding: 1.2rem 1.5rem 4rem; }
h1 { font-size: 1.7rem; margin: 0.6rem 0 0.2rem; }
h2 { font-size: 1.25rem; margin: 0 0 0.4rem; }
h3 { font-size: 1rem; margin: 1.2rem 0 0.3rem; }
section { background: var(--card); border: 1px solid var(--edge); border-radius: 8px; padding: 1rem 1.3rem; }
section { margin: 1rem 0; }
section section { padding: 0.6rem 0.9rem; margin: 0.5rem 0; }
section:has(> details:not([open], .figure)) { padding-top: 0.55rem; padding-bottom: 0.55rem; margin: 0.55rem 0; }
details > summary { cursor: pointer; color: var(--link); }
summary h2, summary h3 { display: inline; color: var(--ink); }
nav { display: flex; flex-wrap: wrap; gap: 0.1rem 1rem; }
nav a { white-space: nowrap; }
a { color: var(--link); }
p, ul { margin: 0.4rem 0; max-width: 75ch; }
.muted, .about { color: var(--soft); font-size: 0.92rem; }
.about { overflow-wrap: anywhere; max-width: none; }
.about span { display: inline-block; margin-right: 1.2rem; }
.counts { display: flex; gap: 0.8rem; flex-wrap: wrap; margin: 0.6rem 0; }
.counts div { border-radius: 8px; padding: 0.5rem 1.1rem; background: var(--box); min-width: 7rem; }
.counts b { font-size: 1.6rem; display: block; }
.counts .ok { background: var(--ok); }
.counts .suspect, .counts .infeasible { background: var(--warn); }
.counts .diverged { background: var(--bad); }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-size: 0.9rem; margin: 0.5rem 0; }
th, td { border-bottom: 1px solid var(--line); padding: 0.25rem 0.7rem; text-align: left; vertical-align: top; }
th { background: var(--head); font-weight: 600; }
td.n, th.n { text-align: right; font-variant-numeric: tabular-nums; }
details.figure { display: block; margin: 0.6rem 0; }
details.figure summary { list-style: none; cursor: zoom-in; }
details.figure summary::-webkit-details-marker { display: none; }
details.figure img { max-width: 100%; height: auto; display: block; }
details.figure[open] summary { position: fixed; inset: 0; z-index: 9; overflow: auto; background: var(--card); }
details.figure[open] summary { cursor: zoom-out; padding: 0.5rem; }
details.figure[open] img { max-width: none; }
@media screen and (max-width: 40rem) {
  main { padding: 0.8rem 0.5rem 3rem; }
  section { padding: 0.7rem 0.8rem; }
  h1 { font-size: 1.35rem; }
  p, li, h1, h2, h3, code, label { overflow-wrap: anywhere; }
  nav a { white-space: normal; }
  ul { padding-left: 1.2rem; }
  .counts { gap: 0.4rem; }
  .counts div { min-width: 4.5rem; flex: 1; padding: 0.4rem 0.6rem; }
  .counts b { font-size: 1.15rem; }
  details.figure:not([open]) summary { overflow-x: auto; }
  details.figure:not([open]) img { max-width: none; width: 40rem; }
}
@media print { details::details-content { content-visibility: visible; display: block; } summary { list-style: none; } }
"""
"""CSS of HTML pages, light and dark."""
PRINT_STYLE = """
@media print { img, tr { break-inside: avoid; } h2, h3 { break-after: avoid; } }
@media print { body { background: white; } section { border: 0; padding: 0; } nav { display: none; } }
@media screen and (max-width: 40rem) {
  table { font-size: 0.8rem; }
  th, td { padding: 0.25rem 0.4rem; }
  .wide th:first-child, .wide td:first-child { position: sticky; left: 0; overflow-wrap: anywhere; min-width: 7rem; }
  .wide td:first-child { background: var(--card); }
  .wide td:last-child:not(.n, :first-child) { min-width: 15rem; }
}
"""
"""CSS of an HTML page without a script."""
MOST_LINKS = 12


class PageSection(NamedTuple):
    """Section of an HTML page: anchor, title, and parts as HTML.

    Attributes:
        folded: whether only its title shows until it is clicked.
    """

    name: str
    title: str
    parts: tuple[str, ...]
    folded: bool = False

    @property
    def is_empty(self) -> bool:
        """Whether the page section has nothing below its title."""
        return not any(self.parts)

    def section_html(self) -> str:
        """HTML of the page section."""
        inside, title = "\n".join(part for part in self.parts if part), f"<h2>{escaped_words(self.title)}</h2>"
        head = f"<details>\n<summary>{title}</summary>" if self.folded else title
        foot = "\n</details>" if self.folded else ""
        return f'<section id="{escape(self.name)}">\n{head}\n{inside}{foot}\n</section>'


def page_html(
    title: str,
    sections: Sequence[PageSection],
    style: str = PRINT_STYLE,
    end: str = "",
    about: Sequence[str] = (),
) -> str:
    """HTML page of sections that are not empty, with links to them, and `end`.

    Args:
        about: what the page is about, below its title: names, digests, dates.
    """
    shown = [section for section in sections if not section.is_empty]
    linked = shown if len(shown) <= MOST_LINKS else shown[: MOST_LINKS - 1]
    links = [f'<a href="#{escape(s.name)}">{escaped_words(s.title)}</a>' for s in linked]
    if len(linked) < len(shown):
        links.append(f'<a href="#{escape(shown[len(linked)].name)}">and {len(shown) - len(linked)} more</a>')
    known = " ".join(f"<span>{escaped_words(words)}</span>" for words in about)
    known = f'<p class="about">{known}</p>' if about else ""
    top = [f"<h1>{escaped_words(title)}</h1>", known, f"<nav>{' '.join(links)}</nav>"]
    body = "\n".join([*(part for part in top if part), *(s.section_html() for s in shown)])
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<title>{escape(title)}</title>\n'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<style>{PAGE_STYLE}{style}</style>\n</head>\n"
        f"<body>\n<main>\n{body}\n</main>\n{end}</body>\n</html>\n"
    )


def page_section(name: str, title: str, *parts: str, folded: bool = False) -> PageSection:
    """Section of an HTML page from anchor, title and nonempty parts."""
    return PageSection(name, title, parts, folded)


def folded_html(words: str, *parts: str) -> str:
    """HTML of parts that show when `words` above them are clicked, or ""."""
    inside = "\n".join(part for part in parts if part)
    return f'<details class="fold">\n<summary>{escaped_words(words)}</summary>\n{inside}\n</details>' if inside else ""


def escaped_words(words: str) -> str:
    """HTML of words, arrows kept with the words beside them."""
    return escape(words).replace(" \N{RIGHTWARDS ARROW} ", "&nbsp;\N{RIGHTWARDS ARROW}&nbsp;")


def key_numbers_html(boxes: Iterable[tuple[str, str, str]]) -> str:
    """HTML of boxes, each of a status (or ""), a value and words."""
    cells = "".join(
        f'<div class="{escape(kind)}"><b>{escaped_words(value)}</b>{escaped_words(words)}</div>'
        for kind, value, words in boxes
    )
    return f'<div class="counts">{cells}</div>'


def heading_html(words: str) -> str:
    """HTML of a heading inside a page section."""
    return f"<h3>{escaped_words(words)}</h3>"


def paragraph_html(words: str, muted: bool = False) -> str:
    """HTML of a paragraph."""
    return f'<p class="muted">{escaped_words(words)}</p>' if muted else f"<p>{escaped_words(words)}</p>"


def bullets_html(lines: Iterable[str]) -> str:
    """HTML of a bulleted list."""
    return "<ul>\n" + "\n".join(f"<li>{escaped_words(line)}</li>" for line in lines) + "\n</ul>"


def engineering_number(value: float, digits: int = 5) -> str:
    """Text of a number on an HTML page: plain from 0.001 to a million."""
    if value != value:
        return "\N{EN DASH}"
    size = abs(value)
    if not 1e-3 <= size < 1e6:
        return f"{value:.{digits}g}"
    decimals = max(0, digits - 1 - math.floor(math.log10(size)))
    plain = f"{value:.{decimals}f}"
    return plain.rstrip("0").rstrip(".") if decimals else plain


def column_number(value: float, decimals: int) -> str:
    """Text of a number in an HTML table, with its column's decimals."""
    return (
        engineering_number(value, significant_digits(value, decimals))
        if math.isfinite(value)
        else engineering_number(value)
    )


def significant_digits(value: float, decimals: int) -> int:
    """Significant digits (2 to 15) of an HTML table's number with so many decimals."""
    return max(2, min(15, decimals + 1 + math.floor(math.log10(abs(value))))) if value else 2


def _cell_text(value: Any) -> str:
    """Text of an HTML table's cell, a dash for None."""
    if value is None:
        return "\N{EN DASH}"
    return engineering_number(value) if isinstance(value, float) else str(value)


_NUMBER_PATTERN = re.compile(r"-?\d+(\.\d+)?(e[-+]\d+)?|\N{EN DASH}")


def _is_number_cell(value: Any) -> bool:
    """Whether an HTML table's cell is a number, or empty."""
    return isinstance(value, int | float) or bool(_NUMBER_PATTERN.fullmatch(_cell_text(value)))


def _breakable_name(word: str) -> str:
    """HTML of a column's name that may break at dots and underscores."""
    return re.sub(r"([._])", r"\1<wbr>", escaped_words(word))


def table_html(heads: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """HTML of a table, columns of numbers on the right; "" without rows."""
    rows = [list(row) for row in rows]
    if not rows:
        return ""
    right = [all(_is_number_cell(row[k]) for row in rows) for k in range(len(heads))]
    kinds = [' class="n"' if r else "" for r in right]
    head = "".join(f"<th{kind}>{_breakable_name(word)}</th>" for word, kind in zip(heads, kinds, strict=True))
    lines = (
        "<tr>"
        + "".join(f"<td{k}>{escaped_words(_cell_text(v))}</td>" for v, k in zip(row, kinds, strict=True))
        + "</tr>"
        for row in rows
    )
    top = f"<thead><tr>{head}</tr></thead>"  # which a table's every page has in print
    return f'<div class="wide"><table>\n{top}\n' + "\n".join(lines) + "\n</table></div>"


def picture_html(figure: Figure, words: str, kind: str = "svg+xml") -> str:
    """HTML image (SVG or PNG) of a figure, described by `words`; an SVG one is dark where the page is."""
    import matplotlib

    buffer = io.BytesIO()
    with matplotlib.rc_context({"svg.hashsalt": "warpchain", "svg.fonttype": "path"}):
        figure.savefig(buffer, format=kind[:3], metadata={"Date": None} if kind[:3] == "svg" else None, dpi=110)
    content = buffer.getvalue() if kind[:3] == "png" else _svg_of_both_schemes(buffer.getvalue().decode()).encode()
    data = base64.b64encode(content).decode()
    width = int(72 * figure.get_figwidth() * 1.25)
    return f'<img src="data:image/{kind};base64,{data}" width="{width}" alt="{escape(words)}">'


def zoomed_picture_html(figure: Figure, words: str) -> str:
    """HTML of a figure that opens at full size when it is clicked."""
    return f'<details class="figure"><summary>{picture_html(figure, words)}</summary></details>'


DARK_GROUND, DARK_INK = (0x1B, 0x23, 0x2B), (0xDB, 0xE2, 0xE8)
"""Colors of white and black on dark pages."""
DARK_COLORS = {
    "#1f77b4": "#58a9e0", "#d62728": "#ef6b6b", "#9467bd": "#b392e0", "#8c564b": "#c99284",
    "#2ca02c": "#4fc04f", "#8b5fbf": "#b392e0", "#c9302c": "#ef6b6b",
}  # fmt: skip
"""Colors too dark for dark pages, and what they become."""


def _svg_of_both_schemes(text: str) -> str:
    """SVG of a figure for HTML that is dark where the reader prefers that."""
    turned = {color: DARK_COLORS[color] for color in DARK_COLORS if color in text}
    for found in {found for found in re.findall(r"#([0-9a-f]{6})\b", text) if found[:2] == found[2:4] == found[4:]}:
        share = int(found[:2], 16) / 255.0
        ends = zip(DARK_INK, DARK_GROUND, strict=True)
        turned[f"#{found}"] = "#" + "".join(f"{round(ink + share * (ground - ink)):02x}" for ink, ground in ends)
    rules = ["svg{{fill:#{:02x}{:02x}{:02x}}}".format(*DARK_INK)]
    for color, dark in sorted(turned.items()):
        rules += [f'[style*="{key}: {color}"]{{{key}:{dark}!important}}' for key in ("fill", "stroke")]
    style = f"<style>@media (prefers-color-scheme: dark) {{ {' '.join(rules)} }}</style>"
    return re.sub(r"(<svg[^>]*>)", lambda found: found[1] + style, text, count=1)
