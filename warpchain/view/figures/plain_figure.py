"""A figure whose texts mean themselves; imported where a figure is made, as it loads matplotlib."""

from __future__ import annotations

from typing import Any

from matplotlib.figure import Figure
from matplotlib.text import Text


class PlainFigure(Figure):
    """A figure without formulas: names of parts may hold any character. Numbers at ticks keep their powers of ten."""

    def draw(self, renderer: Any) -> None:
        """Draws it, also to lay it out, so that no text is read as a formula before it is drawn."""
        ticks = {
            text
            for axis in self.axes
            for line in (axis.xaxis, axis.yaxis)
            for text in (*line.get_ticklabels(which="both"), line.get_offset_text())
        }
        for text in self.findobj(Text):
            text.set_parse_math(text in ticks)
        super().draw(renderer)
