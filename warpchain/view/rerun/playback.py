"""Playback in Rerun: the drive in motion, tension along the chain, contact forces, speeds, spectra, the ensemble.

docs/playback.md describes what is shown and how long recordings are thinned out. Rerun's 2D views have y pointing
down; everything is logged with its y turned around, so that pictures have y up as engineers draw. Rerun's usage
analytics are Rerun's own setting (`rerun analytics disable`); nothing here turns them on.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from warpchain.errors import ArchiveError, SimulationError
from warpchain.results.run import Run
from warpchain.results.signals import TENSION
from warpchain.view.chosen import NEEDED, Recorded, to_compare
from warpchain.view.colors import CURVES, Color, thing_colors
from warpchain.view.rerun.chart import Chart
from warpchain.view.rerun.columns import entity
from warpchain.view.rerun.drive import log_drive, log_outline, shown_frames
from warpchain.view.rerun.ensemble import log_ensemble
from warpchain.view.rerun.layout import blueprint
from warpchain.view.rerun.save import saved
from warpchain.view.rerun.series import (
    Line,
    log_curves,
    log_measured,
    log_spectra,
    log_tension_image,
    spectra,
)
from warpchain.view.scale import Scale, scale_top

if TYPE_CHECKING:
    import rerun as rr
    import rerun.blueprint as rrb

    from warpchain.results.measured import Comparison

FRAMES = 1000
"""Frames that a recording is shown with, unless another number is given."""


def view(
    source: Run | str | Path,
    variant: int | None = None,
    save: str | Path | None = None,
    spawn: bool = True,
    compare: Sequence[str | int | Run | Path] = (),
    frames: int = FRAMES,
    web: bool = False,
    bind: str = "127.0.0.1",
    tab: str | None = None,
    scale: Scale = None,
    measured: Sequence[Comparison] = (),
) -> None:
    """Shows recorded variants in Rerun: in its viewer, in a browser, or saved as a Rerun recording.

    Args:
        source: a run, or an archive's path.
        variant: which variant; None is the first recorded.
        save: file (.rrd) to write instead of opening a viewer; it appears under this name only when whole.
        spawn: open the viewer on this machine; False only builds the recording.
        compare: further variants to lay beside it and over it: numbers in `source`, other runs or archives (their
            first recorded variant), or "ARCHIVE:NUMBER".
        frames: budget of frames to draw; longer recordings are thinned out without losing peaks (docs/playback.md).
        web: serve the web viewer until interrupted, instead of the native one.
        bind: address that the viewer listens at.
        tab: the tab that is open at first, by its name or the beginning of it; None is the first.
        scale: link tension at the red end of the color scale [N], or "breaking", the chain's breaking load; None takes
            99.9 % of the tensions in the latter half of the recording.
        measured: signals from a rig (`warpchain.results.measured`) that are drawn over the first variant's curves.

    Raises:
        ArchiveError: an archive that cannot be read, or a recording that cannot be written.
        SimulationError: a variant or channel that was not recorded, a budget below 2, an unknown tab or scale,
            no viewer.
    """
    if frames < 2:
        raise SimulationError(f"frames = {frames}: allowed is a whole number of at least 2")
    shown = to_compare(source, variant, compare, (*NEEDED, "sprocket_speed"))
    if save is not None:
        stream = _stream()
        with saved(stream, Path(save), ArchiveError):
            stream.send_blueprint(log_recording(stream, shown, frames, tab, scale, measured))
    elif spawn:
        from warpchain.view.rerun.viewer import Viewer

        with Viewer(bind, "web" if web else "native") as viewer:
            stream = _stream()
            viewer.connect(stream)
            stream.send_blueprint(log_recording(stream, shown, frames, tab, scale, measured))
            stream.flush()
            stream.disconnect()
    else:
        log_recording(_stream(), shown, frames, tab, scale, measured)


def log_recording(
    stream: rr.RecordingStream,
    shown: Sequence[Recorded],
    frames: int = FRAMES,
    tab: str | None = None,
    scale: Scale = None,
    measured: Sequence[Comparison] = (),
) -> rrb.Blueprint:
    """Logs the variants, with what compares them and the ensemble of the first one's run; returns the layout."""
    several = len(shown) > 1
    top = scale_top([one.trajectory for one in shown], scale)
    images, lines = [], dict[str, list[Line]]()
    for k, one in enumerate(shown):
        color = CURVES[k % len(CURVES)]
        images.append(log_variant(stream, one, frames, top, color if several else None))
        colors = thing_colors(one.trajectory.drive, color if several else None)
        for title, found in spectra(one.trajectory, colors).items():
            named = [line._replace(name=f"{one.label}: {line.name}") if several else line for line in found]
            lines.setdefault(title, []).extend(named)
        if several:
            outline = shown_frames(one.trajectory, frames)
            log_outline(stream, entity("overlaid", one.label), outline, color)
    for line in log_measured(stream, shown[0].label, measured, frames):
        lines.setdefault(TENSION, []).append(line)
    teeth = [one.trajectory.drive.sprockets[one.trajectory.drive.driver].teeth for one in shown]
    run = shown[0].run
    scatters = log_ensemble(stream, run, [one.index for one in shown if one.run is run])
    return blueprint(shown, images, log_spectra(stream, lines, teeth), scatters, top, tab)


def log_variant(
    stream: rr.RecordingStream, one: Recorded, frames: int, top: float, color: Color | None = None
) -> Chart:
    """Logs one variant below its label: drive, curves and tension image, whose chart is returned.

    Args:
        frames: the budget.
        top: tension at which the color scale ends [N].
        color: the variant's among others, None if it is alone.
    """
    drawn = shown_frames(one.trajectory, frames)
    colors = thing_colors(one.trajectory.drive, color)
    log_drive(stream, one.label, drawn, top, colors)
    log_curves(stream, one.label, one.trajectory, frames, colors, color is not None)
    return log_tension_image(stream, one.label, one.trajectory, drawn, frames, top)


def _stream() -> rr.RecordingStream:
    import rerun as rr

    return rr.RecordingStream("warpchain", recording_id=None)
