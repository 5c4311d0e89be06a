"""The blueprint: which views Rerun opens, and on which tabs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from warpchain.errors import SimulationError
from warpchain.results.run import Trajectory
from warpchain.results.signals import forward
from warpchain.view.chosen import Recorded
from warpchain.view.rerun.chart import BACKGROUND, Chart
from warpchain.view.rerun.columns import TIMELINE, entity
from warpchain.view.rerun.series import GROUPS, axis_range

if TYPE_CHECKING:
    import rerun.blueprint as rrb

TURN = 2.0
"""Seconds in which playback shows a revolution of the driver."""
LEAST, MOST = 5.0, 30.0
"""Seconds that playback takes at least and at most."""


def blueprint(
    shown: Sequence[Recorded],
    images: Sequence[Chart],
    spectra: Sequence[Chart],
    ensemble: tuple[Sequence[Chart], int],
    top: float,
    tab: str | None = None,
) -> rrb.Blueprint:
    """Tabs for the drive, the tension along the chain, contact, speeds, spectrum and the ensemble.

    Several variants stand side by side on the first tab and over each other on the second.

    Args:
        images: each variant's tension along the chain.
        ensemble: scatters row by row, and the number of columns.
        top: tension at which the color scale ends [N].
        tab: which tab is open at first, by its name or how it begins; None is the first.

    Raises:
        SimulationError: a tab that is not there.
    """
    import rerun.blueprint as rrb

    roots = [one.label for one in shown]
    scale = f"from blue (0 N) to red ({top:,.0f} N)".replace(",", " ")

    def curves(*groups: str) -> list[rrb.TimeSeriesView]:
        return [
            rrb.TimeSeriesView(
                name=GROUPS[group],
                origin="/",
                contents=[f"+ {entity(root, 'curves', group)}/**" for root in roots],
                axis_y=_axis(shown, group),
            )
            for group in groups
        ]

    bounds = _bounds(shown)
    drives = [
        rrb.Spatial2DView(
            origin=entity(root, "drive"),
            name=f"{root}: link tension {scale}",
            visual_bounds=bounds,
            background=BACKGROUND,
        )
        for root in roots
    ]
    beside = rrb.Vertical(*curves("tension", "contact", "displacement"))
    tabs: list[rrb.Container | rrb.View] = []
    if len(roots) == 1:
        tabs.append(rrb.Horizontal(drives[0], beside, column_shares=[2, 3], name="drive"))
    else:
        tabs.append(rrb.Horizontal(*drives, name="side by side"))
        overlay = rrb.Spatial2DView(
            origin="/",
            contents=["+ /overlaid/**", f"+ {entity(roots[0], 'drive', 'sprockets')}/**"],
            name="chains overlaid (zoom in to tell them apart)",
            visual_bounds=bounds,
        )
        tabs.append(rrb.Horizontal(overlay, beside, column_shares=[2, 3], name="overlaid"))
    pictures = [chart.view(f"{root}: link tension {scale}") for chart, root in zip(images, roots, strict=True)]
    tabs.append(rrb.Vertical(*pictures, *curves("strand tension"), name="tension along the chain"))
    rubs = ("friction",) if any(one.trajectory.joint_friction_power is not None for one in shown) else ()
    tabs.append(rrb.Vertical(*curves("contact", "moment", *rubs), name="contact forces"))
    tabs.append(rrb.Vertical(*curves("ratio", "error", "speed"), name="speed ratio and transmission error"))
    if spectra:
        tabs.append(rrb.Vertical(*(chart.view(f"spectrum of {chart.path[-1]}") for chart in spectra), name="spectrum"))
    charts, columns = ensemble
    if charts:
        views = [chart.view(chart.path[-1]) for chart in charts]
        tabs.append(rrb.Grid(*views, grid_columns=columns, name="ensemble"))
    names = [str(part.name) for part in tabs]
    opened = next((k for k, name in enumerate(names) if name.startswith(tab or "")), None)
    if opened is None:
        raise SimulationError(f"tab {tab!r}: allowed are {', '.join(names)}")
    return rrb.Blueprint(
        rrb.Tabs(*tabs, active_tab=opened),
        time_panel([one.trajectory for one in shown]),
        auto_views=False,
        collapse_panels=True,
    )


def watched(trajectory: Trajectory) -> float:
    """Seconds in which a recording is played: `TURN` for every revolution of the driver, within `LEAST` and `MOST`."""
    turns = 0.0
    if trajectory.sprocket_angle is not None:
        angle = forward(trajectory.drive, trajectory.sprocket_angle, trajectory.drive.driver)
        turns = float(np.abs(np.diff(angle)).sum()) / (2.0 * np.pi)
    return float(np.clip(TURN * turns, LEAST, MOST)) if np.isfinite(turns) else LEAST


def time_panel(shown: Sequence[Trajectory]) -> rrb.TimePanel:
    """Plays all of the longest recording, over and over, at a speed at which the driver can be seen to turn."""
    import rerun.blueprint as rrb

    longest = max(shown, key=lambda trajectory: float(trajectory.time[-1]))
    speed = float(f"{float(longest.time[-1]) / watched(longest):.2g}")
    return rrb.TimePanel(
        state="collapsed", timeline=TIMELINE, playback_speed=speed, loop_mode="all", play_state="playing"
    )


def _axis(shown: Sequence[Recorded], group: str) -> rrb.ScalarAxis | None:
    """The vertical axis of a group of curves."""
    import rerun.blueprint as rrb

    ends = axis_range([one.trajectory for one in shown], group)
    return None if ends is None else rrb.ScalarAxis(range=ends)


def _bounds(shown: Sequence[Recorded]) -> rrb.VisualBounds2D:
    """What holds every variant's sprockets and chain, y turned around."""
    import rerun.blueprint as rrb

    corners = []
    for one in shown:
        drive, position = one.trajectory.drive, one.trajectory.position
        assert position is not None
        corners += [position[:: max(len(position) // 100, 1)].reshape(-1, 2)]
        corners += [
            np.add(s.center, drive.tip_radius(k) * np.array([[-1], [1]])) for k, s in enumerate(drive.sprockets)
        ]
    points = np.concatenate(corners)
    points = points[np.isfinite(points).all(axis=1)]
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.05 * float((high - low).max())
    return rrb.VisualBounds2D(
        x_range=[low[0] - margin, high[0] + margin], y_range=[-high[1] - margin, -low[1] + margin]
    )
