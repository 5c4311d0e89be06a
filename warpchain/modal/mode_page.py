"""Modes as lines of text and as an HTML page, with their Campbell diagram."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from warpchain.modal.mode_figures import mode_campbell_figure, mode_shapes_figure
from warpchain.view import html
from warpchain.view.figures.figure_style import rpm_of_speed

if TYPE_CHECKING:
    from warpchain.modal.campbell import Campbell
    from warpchain.modal.eigenmodes import Modes

LEAST_SHARE = 0.005
MOST_PARTS = 4
DAMPING_REMARKS = (
    "damping is that of links, mounts, arms, tensioners with their oil, loads, and contacts (hysteretic ones at the "
    "floor of their impact speed)",
    "friction of joints, teeth and guides is left out: it does not grow with the speed, so its damping ratio hangs on "
    "the amplitude",
)


def mode_lines(modes: Modes) -> list[str]:
    """Lines of text on modes and their state."""
    state = "at rest, loads at their constant parts" if modes.speed == 0.0 else f"driver at {modes.speed:g} rad/s"
    tension = modes.tension
    result = [
        f"{len(modes)} modes about the steady state ({state}); link tension "
        f"{tension.min():.4g} to {tension.max():.4g} N",
        "",
    ]
    width = max([4, *map(len, modes.names)])
    result.append(f"{'':>3}  {'mode':<{width}}  {'Hz':>9}  {'damping':>8}  {'across':>6}  share of the kinetic energy")
    rows = zip(modes.names, modes.frequency, modes.damping_ratio, modes.across, modes.participation, strict=True)
    for k, (name, frequency, ratio, across, share) in enumerate(rows, 1):
        result.append(
            f"{k:>3}  {name:<{width}}  {frequency:>9.4g}  {100.0 * ratio:>7.2g}%  {across:>6.0%}  "
            + ", ".join(
                f"{modes.parts[p]} {share[p]:.0%}" for p in np.argsort(-share)[:MOST_PARTS] if share[p] >= LEAST_SHARE
            )
            + "".join(f"; {words}" for words in tensioner_share_texts(modes, k - 1))
        )
    return [*result, *state_remarks(modes)]


def tensioner_share_texts(modes: Modes, k: int) -> list[str]:
    """Texts on tensioners' shares of mode k's stiffness and damping."""
    return [
        f"{tensioner.name} holds {modes.stored[k, t]:.0%}, damps {modes.lost[k, t]:.0%}"
        for t, tensioner in enumerate(modes.drive.tensioners)
        if modes.stored[k, t] >= LEAST_SHARE
    ]


def state_remarks(modes: Modes) -> list[str]:
    """Lines of text on the state that modes are of."""
    result = [*modes.standing, *DAMPING_REMARKS]
    if modes.rotations:
        many = "" if modes.rotations == 1 else f", of {modes.rotations} groups"
        result.append(f"rigid rotation at 0 Hz{many}, as nothing prescribes a speed there: left out")
    if modes.zeros:
        result.append(
            f"{modes.zeros} motions have no restoring force (rollers without contact or tension, a sprocket that turns "
            "freely): left out"
        )
    if len(modes.growing):
        result.append(f"{len(modes.growing)} motions run away, the fastest at {modes.growing[-1]:.3g} 1/s: left out")
    creeping = modes.creeping[modes.creeping <= np.abs(modes.eigenvalue).max(initial=0.0)]
    if len(creeping):
        slow = 1.0 / creeping[0]
        result.append(
            f"{len(creeping)} motions no faster than these come back without swinging (oil that leaks, rollers "
            f"on seats that damp), the slowest in {slow:.3g} s: left out"
        )
    return result


def campbell_lines(found: Campbell) -> list[str]:
    """Lines of text on a Campbell diagram."""
    width = max(4, *map(len, found.names))
    result = ["", f"{'meets':<{width}}  {'rad/s':>8}  {'Hz':>8}  {'damping':>8}  {'order':>8}  cause"]
    for c in found.crossings():
        result.append(
            f"{c.mode:<{width}}  {c.speed:>8.4g}  {c.frequency:>8.4g}  {100.0 * c.damping_ratio:>7.2g}%  "
            f"{c.order.value:>8.4g}  {c.order.cause}"
        )
    result += [
        "",
        f"{'tooth frequency twice that of':<{width}}  {'rad/s':>8}  {'Hz':>8}  unstable above a ripple of 4 zeta",
    ]
    for t in found.tongues():
        result.append(f"{t.mode:<{width}}  {t.speed:>8.4g}  {t.frequency:>8.4g}  {t.threshold:.2g}")
    return result


def modes_page(modes: Modes, found: Campbell | None = None) -> str:
    """HTML page of modes and their Campbell diagram."""
    drive = modes.drive
    where = "at rest" if modes.speed == 0.0 else f"with the driver at {rpm_of_speed(modes.speed):.4g} rpm"
    links = " and ".join(f"{chain.links} links of {1e3 * chain.pitch:g} mm" for chain in drive.each_chain)
    tension = f"link tension {modes.tension.min():.4g} to {modes.tension.max():.4g} N"
    shares = "Shares are of the mode's kinetic energy; across is what of the rollers' is transverse to the chain."
    sections = [
        html.page_section(
            "modes", "Frequencies", html.paragraph_html(f"{links}; {tension}. {shares}"), _modes_table(modes)
        ),
        html.page_section("shapes", "Shapes", html.zoomed_picture_html(mode_shapes_figure(modes), "mode shapes")),
        html.page_section("state", "State and damping", html.bullets_html(state_remarks(modes))),
    ]
    if found is not None:
        swings = "A strand whose tension swings by the share e at the tooth frequency swings ever more there, once e"
        swings += " exceeds 4 zeta."
        sections += [
            html.page_section(
                "campbell",
                "Campbell diagram",
                html.zoomed_picture_html(mode_campbell_figure(found), "Campbell diagram"),
            ),
            html.page_section("crossings", "Where orders meet modes", _crossings_table(found)),
            html.page_section(
                "tongues",
                "Where the tooth frequency is twice that of a mode",
                html.paragraph_html(swings),
                _tongues_table(found),
            ),
        ]
    return html.page_html(f"Modes {where}", sections)


def _modes_table(modes: Modes) -> str:
    """HTML table of modes."""
    shown = [p for p in range(len(modes.parts)) if len(modes) and modes.participation[:, p].max() >= LEAST_SHARE]
    head = ["mode", "Hz", "damping", "across", *(modes.parts[p] for p in shown)]
    tensioned = bool(modes.drive.tensioners)
    if tensioned:
        head.append("of stiffness and damping")
    rows = []
    for k, name in enumerate(modes.names):
        share = [f"{modes.participation[k, p]:.0%}" if modes.participation[k, p] >= LEAST_SHARE else "" for p in shown]
        first = [f"{k + 1}: {name}", f"{modes.frequency[k]:.4g}", f"{100.0 * modes.damping_ratio[k]:.2g} %"]
        held = ["; ".join(tensioner_share_texts(modes, k))] if tensioned else []
        rows.append([*first, f"{modes.across[k]:.0%}", *share, *held])
    return html.table_html(head, rows)


def _crossings_table(found: Campbell) -> str:
    """HTML table of a Campbell diagram's crossings."""
    rows = [
        [c.mode, f"{rpm_of_speed(c.speed):.4g}", f"{c.speed:.4g}", f"{c.frequency:.4g}",
         f"{100.0 * c.damping_ratio:.2g} %", f"{c.order.value:.4g}", c.order.cause]
        for c in found.crossings()
    ]  # fmt: skip
    return html.table_html(["mode", "rpm", "rad/s", "Hz", "damping", "order", "cause"], rows)


def _tongues_table(found: Campbell) -> str:
    """HTML table of a Campbell diagram's instability tongues."""
    rows = [
        [t.mode, f"{rpm_of_speed(t.speed):.4g}", f"{t.speed:.4g}", f"{t.frequency:.4g}", f"{t.threshold:.2g}"]
        for t in found.tongues()
    ]
    return html.table_html(["mode", "rpm", "rad/s", "Hz of the mode", "e = 4 zeta"], rows)
