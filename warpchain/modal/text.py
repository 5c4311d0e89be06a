"""Modes as lines of text."""

from __future__ import annotations

import numpy as np

from warpchain.modal.campbell import Campbell
from warpchain.modal.modes import Modes

SHOWN = 0.005
"""Shares of the kinetic energy below this are not listed."""
MOST = 4
"""Parts listed for a mode at most, by their shares."""


def lines(modes: Modes) -> list[str]:
    """The mode table, and what else there is to say of the state, line by line."""
    state = "at rest, loads at their constant parts" if modes.speed == 0.0 else f"driver at {modes.speed:g} rad/s"
    tension = modes.tension
    result = [
        f"{len(modes)} modes about the standing drive ({state}); link tension "
        f"{tension.min():.4g} to {tension.max():.4g} N",
        "",
    ]
    width = max([4, *map(len, modes.names)])
    result.append(f"{'':>3}  {'mode':<{width}}  {'Hz':>9}  {'damping':>8}  {'across':>6}  share of the kinetic energy")
    rows = zip(modes.names, modes.frequency, modes.damping_ratio, modes.across, modes.participation, strict=True)
    for k, (name, frequency, ratio, across, share) in enumerate(rows, 1):
        result.append(
            f"{k:>3}  {name:<{width}}  {frequency:>9.4g}  {100.0 * ratio:>7.2g}%  {across:>6.0%}  "
            + ", ".join(f"{modes.parts[p]} {share[p]:.0%}" for p in np.argsort(-share)[:MOST] if share[p] >= SHOWN)
            + "".join(f"; {words}" for words in pushed(modes, k - 1))
        )
    return [*result, *remarks(modes)]


def pushed(modes: Modes, k: int) -> list[str]:
    """What of mode k's stiffness and damping is in each tensioner that holds any of it worth mentioning."""
    return [
        f"{tensioner.name} holds {modes.stored[k, t]:.0%}, damps {modes.lost[k, t]:.0%}"
        for t, tensioner in enumerate(modes.drive.tensioners)
        if modes.stored[k, t] >= SHOWN
    ]


def remarks(modes: Modes) -> list[str]:
    """Lines on how arms and tensioners stand, and on motions that are no modes, where there are any."""
    result = list(modes.standing)
    if modes.zeros:
        result.append(
            f"{modes.zeros} motions have no restoring force (rollers without contact or tension, a sprocket that turns "
            "freely): left out"
        )
    if len(modes.growing):
        result.append(f"{len(modes.growing)} motions run away, the fastest at {modes.growing[-1]:.3g} 1/s: left out")
    if len(modes.creeping):
        slow = 1.0 / modes.creeping[0]
        result.append(
            f"{len(modes.creeping)} motions come back without swinging, the slowest in {slow:.3g} s: left out"
        )
    return result


def campbell_lines(found: Campbell) -> list[str]:
    """Where orders meet modes, and where the tooth frequency is twice that of a mode, line by line."""
    width = max(4, *map(len, found.names))
    result = ["", f"{'meets':<{width}}  {'rad/s':>8}  {'Hz':>8}  {'damping':>8}  {'order':>8}  cause"]
    for c in found.crossings():
        result.append(
            f"{c.mode:<{width}}  {c.speed:>8.4g}  {c.frequency:>8.4g}  {100.0 * c.damping_ratio:>7.2g}%  "
            f"{c.order.value:>8.4g}  {c.order.cause}"
        )
    result += ["", f"{'tooth frequency twice that of':<{width}}  {'rad/s':>8}  {'Hz':>8}  runs away from e = 4 zeta ="]
    for t in found.tongues():
        result.append(f"{t.mode:<{width}}  {t.speed:>8.4g}  {t.frequency:>8.4g}  {t.threshold:.2g}")
    return result
