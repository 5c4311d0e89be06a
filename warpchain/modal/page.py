"""Modes as one HTML page that needs nothing else: tables, shapes, and the Campbell diagram where there is one."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING

from warpchain.modal.campbell import Campbell
from warpchain.modal.figures import campbell_figure, shapes_figure
from warpchain.modal.modes import Modes
from warpchain.modal.text import pushed, remarks
from warpchain.view.figures.style import rpm

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STYLE = (
    "body{font:15px/1.45 system-ui,sans-serif;max-width:1150px;margin:2em auto;padding:0 1em;color:#222}"
    "table{border-collapse:collapse;font-variant-numeric:tabular-nums}"
    "td,th{padding:.15em .7em;border-bottom:1px solid #ddd;text-align:right}"
    "td:first-child,th:first-child,td.words{text-align:left}img{max-width:100%}"
)


def page(modes: Modes, found: Campbell | None = None) -> str:
    """The page's text."""
    drive = modes.drive
    where = "at rest" if modes.speed == 0.0 else f"with the driver at {rpm(modes.speed):.4g} rpm"
    links = f"{drive.chain.links} links of {1e3 * drive.chain.pitch:g} mm"
    tension = f"link tension {modes.tension.min():.4g} to {modes.tension.max():.4g} N"
    body = [
        f"<h1>Modes {escape(where)}</h1>",
        f"<p>{links}; {tension}. Shares are of the mode's kinetic energy; across is what of the rollers' is "
        "transverse to the chain.</p>",
        _modes_table(modes),
        *(f"<p>{escape(line)}</p>" for line in remarks(modes)),
        _picture(shapes_figure(modes), "mode shapes"),
    ]
    if found is not None:
        body += [
            "<h2>Campbell diagram</h2>",
            _picture(campbell_figure(found), "Campbell diagram"),
            "<h2>Where orders meet modes</h2>",
            _crossings_table(found),
            "<h2>Where the tooth frequency is twice that of a mode</h2>",
            "<p>A strand whose tension swings by the share e at the tooth frequency swings ever more there, once e "
            "exceeds 4 zeta.</p>",
            _tongues_table(found),
        ]
    inner = "\n".join(body)
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<title>Modes</title>\n'
        f"<style>{STYLE}</style>\n</head>\n<body>\n{inner}\n</body>\n</html>\n"
    )


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    top = "".join(f"<th>{escape(word)}</th>" for word in head)
    lines = ["<tr>" + "".join(f"<td>{escape(word)}</td>" for word in row) + "</tr>" for row in rows]
    return f"<table><tr>{top}</tr>\n" + "\n".join(lines) + "\n</table>"


def _modes_table(modes: Modes) -> str:
    shown = [p for p in range(len(modes.parts)) if len(modes) and modes.participation[:, p].max() >= 0.005]
    head = ["mode", "Hz", "damping", "across", *(modes.parts[p] for p in shown)]
    tensioned = bool(modes.drive.tensioners)
    if tensioned:
        head.append("of stiffness and damping")
    rows = []
    for k, name in enumerate(modes.names):
        share = [f"{modes.participation[k, p]:.0%}" if modes.participation[k, p] >= 0.005 else "" for p in shown]
        first = [f"{k + 1}: {name}", f"{modes.frequency[k]:.4g}", f"{100.0 * modes.damping_ratio[k]:.2g} %"]
        held = ["; ".join(pushed(modes, k))] if tensioned else []
        rows.append([*first, f"{modes.across[k]:.0%}", *share, *held])
    return _table(head, rows)


def _crossings_table(found: Campbell) -> str:
    rows = [
        [c.mode, f"{rpm(c.speed):.4g}", f"{c.speed:.4g}", f"{c.frequency:.4g}", f"{100.0 * c.damping_ratio:.2g} %",
         f"{c.order.value:.4g}", c.order.cause]
        for c in found.crossings()
    ]  # fmt: skip
    return _table(["mode", "rpm", "rad/s", "Hz", "damping", "order", "cause"], rows)


def _tongues_table(found: Campbell) -> str:
    rows = [
        [t.mode, f"{rpm(t.speed):.4g}", f"{t.speed:.4g}", f"{t.frequency:.4g}", f"{t.threshold:.2g}"]
        for t in found.tongues()
    ]
    return _table(["mode", "rpm", "rad/s", "Hz of the mode", "e = 4 zeta"], rows)


def _picture(figure: Figure, words: str) -> str:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110)
    data = base64.b64encode(buffer.getvalue()).decode()
    return f'<p><img src="data:image/png;base64,{data}" alt="{escape(words)}"></p>'
