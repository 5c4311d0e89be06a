"""Figures of runs as files."""

from warpchain.view.figures.write import plot_figures, plot_sweep

__all__ = ["plot_figures", "plot_sweep"]
