"""Where the work that goes into a drive stays: energy dissipated over the window, by what dissipates it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from warpchain.drive import Drive

JOINTS, TEETH, BARS, LINKS, MOUNTS = "joints", "sprocket contacts", "guides", "links", "mounts"
ARMS = "arms and tensioners"
"""The groups: friction in the joints; damping and friction of rollers on teeth and on guides; damping of the links, of
mounts, and of arms and tensioners with what gap and valve take of the oil's energy."""


def losses(drive: Drive, metrics: Mapping[str, Any]) -> dict[str, float]:
    """Energy dissipated over the window by group [J], the largest first; groups that the drive has not are left out.

    Together with `output_work`, `energy_change` and `energy_residual` they are the `input_work`.

    Args:
        metrics: a variant's row.
    """
    teeth = [s.name for s in drive.sprockets]
    bars = [g.name for g in drive.guides]
    pushed = [arm.name for arm in drive.arms] + [tensioner.name for tensioner in drive.tensioners]
    columns = {
        JOINTS: ["joints.friction"],
        TEETH: [f"{name}.{kind}" for name in teeth for kind in ("dissipated", "friction")],
        BARS: [f"{name}.{kind}" for name in bars for kind in ("dissipated", "friction")],
        LINKS: ["links.dissipated"],
        MOUNTS: [f"{name}.mount_dissipated" for name in teeth],
        ARMS: [f"{name}.{kind}" for name in pushed for kind in ("damping_loss", "oil_loss")],
    }
    found = {
        group: [float(metrics[name]) for name in names if metrics.get(name) is not None]
        for group, names in columns.items()
    }
    totals = {group: sum(values) for group, values in found.items() if values}
    return dict(sorted(totals.items(), key=lambda item: -item[1]))
