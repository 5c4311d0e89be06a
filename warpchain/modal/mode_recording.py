"""Rerun recording of modes, each swinging in a tab of its own."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpchain.errors import ArchiveError
from warpchain.files import refusals_as_errors, whole_file
from warpchain.modal.eigenmodes import Modes
from warpchain.modal.mode_figures import carried_part_lines, fixed_part_lines, mode_swing
from warpchain.results.outlines import chain_line
from warpchain.view.rerun.streams import flipped_points

if TYPE_CHECKING:
    import rerun as rr
    import rerun.blueprint as rrb

CYCLE_FRAMES = 48
CYCLES = 4
CYCLE_SECONDS = 2.0
CHAIN, STEEL, RUBBER, REST = (90, 160, 255), (150, 155, 165), (190, 120, 60), (90, 90, 95)


def write_mode_recording(modes: Modes, path: str | Path) -> Path:
    """Writes modes as a Rerun recording; returns its path.

    Raises:
        ArchiveError: a file that cannot be written.
    """
    import rerun as rr

    target = Path(path)
    stream = rr.RecordingStream("warpchain modes")
    with refusals_as_errors(target, ArchiveError), whole_file(target) as file:
        stream.save(file.name)
        stream.send_blueprint(mode_blueprint(modes))
        log_modes(stream, modes)
        stream.flush()
        stream.disconnect()
    return target


def mode_entity(modes: Modes, k: int) -> str:
    """Entity path of mode k in its Rerun recording."""
    return f"modes/{k + 1:02d}"


def mode_title(modes: Modes, k: int) -> str:
    """Title of mode k's tab in a Rerun recording."""
    return f"{k + 1}: {modes.frequency[k]:.4g} Hz {modes.names[k]}"


def mode_blueprint(modes: Modes) -> rrb.Blueprint:
    """Rerun's layout of modes, a tab each."""
    import rerun.blueprint as rrb

    low, high = flipped_points(modes.position).min(axis=0), flipped_points(modes.position).max(axis=0)
    margin = 0.12 * float((high - low).max())
    bounds = rrb.VisualBounds2D(
        x_range=[float(low[0]) - margin, float(high[0]) + margin],
        y_range=[float(low[1]) - margin, float(high[1]) + margin],
    )
    tabs = [
        rrb.Spatial2DView(
            origin="/",
            contents=["+ /drive/**", f"+ /{mode_entity(modes, k)}/**"],
            name=mode_title(modes, k),
            visual_bounds=bounds,
        )
        for k in range(len(modes))
    ]
    return rrb.Blueprint(
        rrb.Tabs(*tabs), rrb.TimePanel(state="collapsed", timeline="sim_time", loop_mode="all", play_state="playing")
    )


def log_modes(stream: rr.RecordingStream, modes: Modes) -> None:
    """Logs a drive and swinging modes to Rerun."""
    import rerun as rr

    chains = modes.of_chains()
    width = 0.08 * min(own.model.chain.pitch for own in chains)
    rest = rr.LineStrips2D(
        [flipped_points(chain_line(own.model, own.position)) for own in chains], colors=[REST], radii=[0.5 * width]
    )
    stream.log("drive/chain", rest, static=True)
    still = [flipped_points(line) for own in chains for line in fixed_part_lines(own.model)]
    if still:
        stream.log("drive/still", rr.LineStrips2D(still, colors=[RUBBER], radii=[width]), static=True)
    for frame in range(CYCLES * CYCLE_FRAMES + 1):
        stream.set_time("sim_time", duration=frame * CYCLE_SECONDS / CYCLE_FRAMES)
        for k in range(len(modes)):
            strips: list[Any] = []
            colors, radii = [], []
            for own, rollers, bodies in mode_swing(modes, k, 2.0 * np.pi * frame / CYCLE_FRAMES):
                steel = _sprocket_rims(own, bodies)
                carried = [flipped_points(line) for line in carried_part_lines(own.model, bodies)]
                strips += [flipped_points(chain_line(own.model, rollers)), *steel, *carried]
                colors += [CHAIN] + [STEEL] * len(steel) + [RUBBER] * len(carried)
                radii += [width] + [0.6 * width] * (len(steel) + len(carried))
            stream.log(mode_entity(modes, k), rr.LineStrips2D(strips, colors=colors, radii=radii))


def _sprocket_rims(modes: Modes, bodies: NDArray[np.float64]) -> list[Any]:
    """Rerun lines of sprocket rims in a mode's swing."""
    strips, chain = [], np.exp(2j * np.pi * np.linspace(0.0, 1.0, 61))
    for s in range(len(modes.model.sprockets)):
        x, y, angle = bodies[s]
        radius = 0.82 * modes.model.pitch_radius(s)
        turned = chain * np.exp(1j * (angle - modes.placed[s, 2]))
        rim = np.stack([x + radius * turned.real, y + radius * turned.imag], axis=1)
        strips += [flipped_points(rim), flipped_points(np.array([[x, y], rim[0]]))]
    return strips
