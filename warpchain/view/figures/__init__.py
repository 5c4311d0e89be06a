"""Figures of runs as files."""

from warpchain.view.figures.plot import draw_figures, draw_sweep, plot_figures, plot_sweep

__all__ = ["draw_figures", "draw_sweep", "plot_figures", "plot_sweep"]
