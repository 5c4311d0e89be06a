"""A matplotlib figure that reads no formulas in texts."""

from __future__ import annotations

from typing import Any

from matplotlib.figure import Figure
from matplotlib.text import Text


class PlainFigure(Figure):
    """A matplotlib figure whose texts may hold any character."""

    def draw(self, renderer: Any) -> None:
        """Draws the figure, all texts but ticks as plain text."""
        ticks = {
            text
            for axis in self.axes
            for line in (axis.xaxis, axis.yaxis)
            for text in (*line.get_ticklabels(which="both"), line.get_offset_text())
        }
        for text in self.findobj(Text):
            text.set_parse_math(text in ticks)
        super().draw(renderer)
