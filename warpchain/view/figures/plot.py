"""Figures of runs by name, drawn or written: those of one variant, and Campbell diagrams of several."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from warpchain.errors import SimulationError
from warpchain.results.chains import chain_trajectories
from warpchain.results.run import Run, Trajectory
from warpchain.view.figures.chain_figures import (
    contact_angle_figure,
    guide_force_figure,
    hardest_pressed_roller,
    link_tension_figure,
    order_spectrum_figure,
    roller_contact_figure,
    strand_displacement_figure,
    tension_waterfall_figure,
)
from warpchain.view.figures.drive_figure import drive_figure
from warpchain.view.figures.figure_style import save_figures
from warpchain.view.figures.sweep import STRAND_SIGNALS, campbell_figure, speed_sweeps
from warpchain.view.palette import ScaleTop, tension_scale_top
from warpchain.view.recorded_variants import recorded_variant

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FIGURES: dict[str, Callable[[Trajectory, int, float], Figure | None]] = {
    "drive": lambda t, _, top: drive_figure(t, top=top),
    "strand-displacement": lambda t, *_: strand_displacement_figure(t),
    "link-tension": lambda t, roller, _: link_tension_figure(t, roller),
    "contact-forces": lambda t, roller, _: roller_contact_figure(t, roller),
    "guide-force": lambda t, *_: guide_force_figure(t) if t.parts.guides else None,
    "tension-waterfall": lambda t, _, top: tension_waterfall_figure(t, top),
    "order-spectrum": lambda t, *_: order_spectrum_figure(t),
    "contact-angle": lambda t, *_: contact_angle_figure(t),
}
"""Functions of figures by name, from trajectory, roller and color limit [N]."""

RESONANCE_MULTIPLE = 8.0
"""Highest marked resonance over the highest transverse frequency."""


def draw_figures(
    source: Run | str | Path,
    variant: int | None = None,
    only: Sequence[str] = (),
    roller: int | None = None,
    scale: ScaleTop = None,
) -> dict[str, Figure]:
    """Figures of a variant by name; arguments and errors as of `plot_figures`."""
    for name in only:
        if name not in FIGURES:
            raise SimulationError(f"figure {name!r}: allowed are {', '.join(FIGURES)}")
    whole = recorded_variant(source, variant).trajectory
    return _figures_by_chain(whole, only, roller, scale)


def _figures_by_chain(whole: Trajectory, only: Sequence[str], roller: int | None, scale: ScaleTop) -> dict[str, Figure]:
    """Figures of each chain by "CHAIN NAME", of an only one by "NAME"."""
    drawn: dict[str, Figure] = {}
    chosen = only or tuple(FIGURES)
    if "drive" in chosen:
        drawn["drive"] = drive_figure(whole, top=tension_scale_top([whole], scale))
    rest = [name for name in chosen if name != "drive"]
    for chain, trajectory in chain_trajectories(whole).items() if rest else ():
        found = _figures_of_chain(trajectory, rest, roller, scale)
        drawn |= {f"{chain} {name}" if chain else name: figure for name, figure in found.items()}
    return drawn


def _figures_of_chain(
    trajectory: Trajectory, only: Sequence[str], roller: int | None, scale: ScaleTop
) -> dict[str, Figure]:
    """Figures of a chain's trajectory by name, `only` some or all."""
    if roller is None:
        roller = hardest_pressed_roller(trajectory)
    if not 0 <= roller < trajectory.parts.links:
        raise SimulationError(f"roller {roller}: allowed are 0 to {trajectory.parts.links - 1}")
    top = tension_scale_top([trajectory], scale)
    drawn = {name: FIGURES[name](trajectory, roller, top) for name in only or FIGURES}
    return {name: figure for name, figure in drawn.items() if figure is not None}


def plot_figures(
    source: Run | str | Path,
    folder: str | Path,
    variant: int | None = None,
    kind: str | Sequence[str] = "png",
    only: Sequence[str] = (),
    roller: int | None = None,
    scale: ScaleTop = None,
) -> list[Path]:
    """Writes a variant's figures as image files; returns their paths.

    Args:
        source: a run, or an archive's path.
        variant: None is the first recorded.
        kind: "png" or "svg", or both.
        only: names of `FIGURES` to draw; () is all.
        roller: whose contact forces and link's tension are drawn; None takes the hardest pressed one.
        scale: link tension at the red end of the color scale, as of `warpchain.view.rerun.view`.

    Raises:
        ArchiveError: an archive that cannot be read, or a folder that cannot be written.
        SimulationError: a variant or channel that was not recorded, an unknown figure, format or roller.
    """
    return save_figures(draw_figures(source, variant, only, roller, scale), folder, kind)


def plot_sweep(
    sources: Sequence[Run | str | Path], folder: str | Path, kind: str | Sequence[str] = "png"
) -> list[Path]:
    """Writes the Campbell diagrams of `draw_sweep` as image files; returns their paths.

    Raises:
        ArchiveError, SimulationError: as of `draw_sweep`, or a folder that cannot be written.
    """
    return save_figures(draw_sweep(sources), folder, kind)


def draw_sweep(sources: Sequence[Run | str | Path]) -> dict[str, Figure]:
    """Campbell diagrams by name, of strands' displacement and tension in all recorded variants of runs.

    Raises:
        ArchiveError: an archive that cannot be read.
        SimulationError: fewer than two speeds, drives of unlike topology, or a channel that was not recorded.
    """
    figures = {}
    for signal in STRAND_SIGNALS:
        found = speed_sweeps(sources, signal)
        figures[f"campbell-{signal}"] = campbell_figure(found)
        natural = max(float(sweep.natural.max()) for sweep in found if sweep.natural is not None)
        if signal == "displacement" and natural > 0.0:
            figures["campbell-resonance"] = campbell_figure(found, RESONANCE_MULTIPLE * natural)
    return figures
