"""Recordings for Rerun."""

import argparse
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from common.cases import Line, case, case_option
from common.drives import equal_sprocket_values, two_sprockets

from warpchain import Record, Trajectory, simulate

LONG = equal_sprocket_values(30, 150, 0.05) | {
    "sprockets.driver.prescribed.speed": 30.0,
    "contact.sprocket.seat_angle": 137.0,
    "run": {"duration": 0.4995, "step": 1e-5, "sample_rate": 2000.0},
}


def log_frame_by_frame(stream: Any, trajectory: Trajectory) -> None:
    """The chain's rollers and colors through Rerun's own archetypes, logged one frame after the other."""
    import rerun as rr

    from warpchain.view.rerun.streams import TIMELINE, flipped_points

    assert trajectory.position is not None
    points, colors = (
        flipped_points(trajectory.position),
        np.full((trajectory.drive.chain.links, 4), 255, dtype=np.uint8),
    )
    for time_now, x in zip(trajectory.time.tolist(), points, strict=True):
        stream.set_time(TIMELINE, duration=time_now)
        stream.log("reference/loop", rr.Points2D(x, colors=colors))


@case(case_option("--rounds", type=int, default=7, help="of which the best counts (default 7)"))
def playback(asked: argparse.Namespace) -> Iterator[Line]:
    """Milliseconds to build a recording of a variant of 1,000 frames and 150 rollers.

    python scripts/bench.py playback

    The parts are timed on their own, in turns, and the best of each is printed: the moving drive (chain, rollers,
    sprockets, contact forces), the curves, the tension image. The reference is the chain alone, logged frame by frame.
    The recording goes to a file in a temporary folder.
    """
    import rerun as rr

    from warpchain.view.palette import curve_colors, tension_scale_top
    from warpchain.view.recorded_variants import recorded_variant
    from warpchain.view.rerun.drive_scene import log_drive
    from warpchain.view.rerun.run_playback import log_recording, log_variant
    from warpchain.view.rerun.signal_charts import log_curves, log_spectrum_charts, log_tension_image, spectrum_lines

    one = recorded_variant(simulate(two_sprockets(LONG), record=Record()), None)
    trajectory, frames = one.trajectory, len(one.trajectory.time)
    top, colors = tension_scale_top([trajectory]), curve_colors(trajectory.drive)
    parts: dict[str, Callable[[Any], object]] = {
        "drive in motion": lambda stream: log_drive(stream, "a", trajectory, top),
        "curves": lambda stream: log_curves(stream, "a", trajectory, frames, colors),
        "tension image": lambda stream: log_tension_image(stream, "a", trajectory, trajectory, frames, top),
        "a variant (the three)": lambda stream: log_variant(stream, one, frames, top),
        "spectra": lambda stream: log_spectrum_charts(stream, spectrum_lines(trajectory, colors), [30]),
        "whole recording with layout": lambda stream: log_recording(stream, [one], frames),
        "rollers frame by frame": lambda stream: log_frame_by_frame(stream, trajectory),
    }
    best = dict.fromkeys(parts, np.inf)
    with tempfile.TemporaryDirectory() as folder:
        for turn in range(asked.rounds):
            for name, part in parts.items():
                stream = rr.RecordingStream("warpchain")
                stream.save(Path(folder) / f"{turn}.rrd")
                begin = time.perf_counter()
                part(stream)
                stream.flush()
                best[name] = min(best[name], time.perf_counter() - begin)
                stream.disconnect()
    yield ("part", "ms")
    yield from ((name, f"{1e3 * least:.1f}") for name, least in best.items())
