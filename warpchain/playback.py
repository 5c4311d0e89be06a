"""Playback in Rerun: the moving chain colored by tension, turning sprockets, guide-bars, contact forces, time plots.

Rerun's 2D views have y pointing down; everything is logged with its y turned around, so that the picture has y up as
engineers draw. Rerun's usage analytics are Rerun's own setting (`rerun analytics disable`); nothing here turns them on.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from warpchain.archive_schema import tension_color
from warpchain.errors import ArchiveError, SimulationError
from warpchain.plots import NEEDED, chosen_variant
from warpchain.record import Run, Trajectory
from warpchain.scene import contact_arrows, guide_outline, strand_displacement, tooth_outline

if TYPE_CHECKING:
    import rerun as rr
    import rerun.blueprint as rrb

FRAMES = 1000
"""Most frames that the drive is drawn at; time plots keep every frame."""
TIMELINE = "sim_time"
UP = np.array([1.0, -1.0])
"""Turns y around for Rerun's 2D views."""
ARROW = 0.12
"""Length of the longest contact-force arrow, as a part of the drive's size."""


def view(
    source: Run | str | Path,
    variant: int | None = None,
    save: str | Path | None = None,
    spawn: bool = True,
) -> None:
    """Shows one recorded variant in the Rerun viewer, or saves it as a Rerun recording.

    Args:
        source: a run, or an archive's path.
        variant: which variant; None is the first recorded.
        save: file (.rrd) to write instead of opening the viewer; it appears under this name only when whole.
        spawn: open a viewer on this machine, bound to 127.0.0.1.

    Raises:
        ArchiveError: an archive that cannot be read, or a recording that cannot be written.
        SimulationError: a variant or channel that was not recorded, or no viewer to open.
    """
    import rerun as rr

    index, trajectory = chosen_variant(source, variant, (*NEEDED, "sprocket_speed"))
    stream = rr.RecordingStream("warpchain", recording_id=None)
    blueprint = _blueprint(trajectory)
    if save is None:
        if spawn:
            try:
                rr.spawn(connect=True, recording=stream, default_blueprint=blueprint, detach_process=True)
            except Exception as error:  # the viewer is another program: whatever it says is for the user
                raise SimulationError(f"the Rerun viewer does not open ({error}); use --save OUT.rrd") from None
        log_variant(stream, trajectory, index)
        stream.flush()
        return
    target = Path(save)
    partial = target.with_name(f".{target.stem}.{os.getpid()}{target.suffix or '.rrd'}")
    try:
        partial.touch()
        stream.save(partial, default_blueprint=blueprint)
        log_variant(stream, trajectory, index)
        stream.flush()
        stream.disconnect()
        partial.replace(target)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise ArchiveError(f"{target}: cannot be written ({error.strerror or error})") from None


def shown_frames(trajectory: Trajectory) -> np.ndarray[Any, np.dtype[np.intp]]:
    """Frames at which the drive is drawn: all, or evenly spaced ones within the budget, first and last among them."""
    count = len(trajectory.time)
    return np.unique(np.linspace(0, count - 1, min(count, FRAMES)).round().astype(np.intp))


def log_variant(stream: rr.RecordingStream, trajectory: Trajectory, index: int = 0) -> None:
    """Logs one variant's drive and time plots."""
    frames = shown_frames(trajectory)
    shown = Trajectory(
        trajectory.drive, trajectory.time[frames], **{n: v[frames] for n, v in trajectory.channels().items()}
    )
    _log_chain(stream, shown)
    _log_sprockets(stream, shown)
    _log_guides(stream, shown)
    _log_arrows(stream, shown)
    _log_series(stream, trajectory)


def _path(*parts: str) -> str:
    """An entity's path; names may hold blanks."""
    import rerun as rr

    return rr.new_entity_path(list(parts))


def _times(trajectory: Trajectory) -> list[rr.TimeColumn]:
    import rerun as rr

    return [rr.TimeColumn(TIMELINE, duration=trajectory.time)]


def _log_chain(stream: rr.RecordingStream, shown: Trajectory) -> None:
    import rerun as rr

    assert shown.position is not None
    assert shown.tension is not None
    frames, rollers = shown.tension.shape
    x = (np.asarray(shown.position, dtype=np.float32) * UP).astype(np.float32)
    top = max(float(np.percentile(shown.tension, 99.9)), 1.0)
    colors = tension_color(shown.tension, top).reshape(-1, 4)
    links = np.stack([x, np.roll(x, -1, axis=1)], axis=2).reshape(-1, 2, 2)
    lengths = [rollers] * frames
    pitch = shown.drive.chain.pitch
    line = rr.LineStrips2D.columns(strips=links, colors=colors).partition(lengths)
    stream.send_columns("drive/chain", _times(shown), line)
    stream.log("drive/chain", rr.LineStrips2D.from_fields(radii=[0.12 * pitch]), static=True)
    points = rr.Points2D.columns(positions=x.reshape(-1, 2), colors=colors).partition(lengths)
    stream.send_columns("drive/rollers", _times(shown), points)
    stream.log("drive/rollers", rr.Points2D.from_fields(radii=[shown.drive.chain.roller_radius]), static=True)


def _log_sprockets(stream: rr.RecordingStream, shown: Trajectory) -> None:
    import rerun as rr

    assert shown.sprocket_angle is not None
    assert shown.sprocket_center is not None
    for s, sprocket in enumerate(shown.drive.sprockets):
        outline = tooth_outline(shown.drive, s, arc_points=5)
        spoke = np.array([[0.0, 0.0], [0.8 * shown.drive.pitch_radius(s), 0.0]])
        cosine, sine = np.cos(shown.sprocket_angle[:, s, None]), np.sin(shown.sprocket_angle[:, s, None])
        strips = []
        for part in (outline, spoke):
            turned = np.stack([part[:, 0] * cosine - part[:, 1] * sine, part[:, 0] * sine + part[:, 1] * cosine], -1)
            strips.append(((turned + shown.sprocket_center[:, s, None]) * UP).astype(np.float32))
        both = [strip for frame in zip(*strips, strict=True) for strip in frame]
        columns = rr.LineStrips2D.columns(strips=both).partition([2] * len(shown.time))
        path = _path("drive", "sprockets", sprocket.name)
        stream.send_columns(path, _times(shown), columns)
        stream.log(path, rr.LineStrips2D.from_fields(colors=[(150, 155, 165)], radii=[0.004]), static=True)
        label = rr.Points2D(
            [np.asarray(sprocket.center) * UP], labels=[sprocket.name], radii=[0.02], colors=[(150, 155, 165)]
        )
        stream.log(_path("drive", "names", sprocket.name), label, static=True)


def _log_guides(stream: rr.RecordingStream, shown: Trajectory) -> None:
    import rerun as rr

    for g, guide in enumerate(shown.drive.guides):
        line = rr.LineStrips2D([guide_outline(shown.drive, g) * UP], colors=[(190, 120, 60)], radii=[0.012])
        stream.log(_path("drive", "guides", guide.name), line, static=True)


def _log_arrows(stream: rr.RecordingStream, shown: Trajectory) -> None:
    """Contact forces, only those above a hundredth of the longest arrow."""
    import rerun as rr

    assert shown.position is not None
    kinds = contact_arrows(shown)
    sizes = [np.hypot(arrows[..., 0], arrows[..., 1]) for arrows in kinds]
    pressed = np.concatenate([size[size > 0.0] for size in sizes])
    if not len(pressed):
        return
    largest = float(np.percentile(pressed, 99.0))  # rare impacts may reach further
    scale = ARROW * float(np.ptp(shown.position.reshape(-1, 2), axis=0).max()) / largest
    for name, arrows, size, color in zip(
        ("sprocket forces", "guide-bar forces"), kinds, sizes, ((240, 240, 240), (255, 80, 80)), strict=True
    ):
        drawn = size > 0.01 * largest
        columns = rr.Arrows2D.columns(
            vectors=(arrows[drawn] * scale * UP).astype(np.float32),
            origins=(shown.position[drawn] * UP).astype(np.float32),
        ).partition(drawn.sum(axis=1).tolist())
        stream.send_columns(_path("drive", name), _times(shown), columns)
        stream.log(_path("drive", name), rr.Arrows2D.from_fields(colors=[color], radii=[0.006]), static=True)


def _log_series(stream: rr.RecordingStream, trajectory: Trajectory) -> None:
    """Time plots, at every recorded frame."""
    import rerun as rr

    assert trajectory.tension is not None
    assert trajectory.sprocket_force is not None
    assert trajectory.guide_force is not None
    assert trajectory.sprocket_speed is not None
    drive = trajectory.drive
    series = {
        "tension/largest [N]": trajectory.tension.max(axis=1),
        "tension/mean [N]": trajectory.tension.mean(axis=1),
        "tension/link 0 [N]": trajectory.tension[:, 0],
        "contact/largest of sprockets [N]": trajectory.sprocket_force.max(axis=1),
        "contact/largest of guide-bars [N]": trajectory.guide_force.max(axis=1),
    }
    for s, sprocket in enumerate(drive.sprockets):
        speed = np.asarray(trajectory.sprocket_speed[:, s], dtype=float)
        series[f"speed/{sprocket.name} [rad/s]"] = speed
        if speed.mean() != 0.0:
            series[f"deviation/{sprocket.name} [%]"] = 100.0 * (speed / speed.mean() - 1.0)
    for k, name in enumerate(drive.strand_names):
        series[f"displacement/{name} [mm]"] = 1e3 * strand_displacement(trajectory, k)
    for path, values in series.items():
        group, name = path.split("/", 1)
        entity = _path(group, name.rsplit(" [", 1)[0])
        stream.log(entity, rr.SeriesLines(names=[name]), static=True)
        stream.send_columns(entity, _times(trajectory), rr.Scalars.columns(scalars=np.asarray(values, dtype=float)))


def _blueprint(trajectory: Trajectory) -> rrb.Blueprint:
    """The drive on the left, time plots on the right."""
    import rerun.blueprint as rrb

    drive = trajectory.drive
    assert trajectory.position is not None
    low, high = trajectory.position.min(axis=(0, 1)), trajectory.position.max(axis=(0, 1))
    margin = 0.05 * float((high - low).max())
    centers = np.array([sprocket.center for sprocket in drive.sprockets])
    low = np.minimum(low, centers.min(axis=0)) - margin
    high = np.maximum(high, centers.max(axis=0)) + margin
    bounds = rrb.VisualBounds2D(x_range=[low[0], high[0]], y_range=[-high[1], -low[1]])
    tension, contact, speed, deviation, displacement = (
        rrb.TimeSeriesView(origin=f"/{name}", name=title)
        for name, title in (
            ("tension", "link tension [N]"),
            ("contact", "contact force [N]"),
            ("speed", "sprocket speed [rad/s]"),
            ("deviation", "sprocket speed, deviation from its mean [%]"),
            ("displacement", "strand displacement [mm]"),
        )
    )
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Spatial2DView(origin="/drive", name="drive", visual_bounds=bounds),
            rrb.Vertical(tension, contact, rrb.Tabs(deviation, speed), displacement),
            column_shares=[2, 3],
        ),
        rrb.TimePanel(state="collapsed"),
        collapse_panels=True,
    )
