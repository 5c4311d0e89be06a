"""A matplotlib figure that reads no formulas in texts, and is laid out once for each file."""

from __future__ import annotations

import re
import textwrap
from typing import Any

from matplotlib import rcParams
from matplotlib.artist import Artist
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.layout_engine import LayoutEngine
from matplotlib.text import Text
from matplotlib.transforms import ScaledTranslation

LETTER_WIDTH = 0.0089
"""Mean width of a letter over its font's size [in/pt]."""
TITLE_ROOM, HEAD_ROOM, LEGEND_ROW, FOOT_ROOM = 0.62, 0.24, 0.17, 0.52
"""Heights [in] of title, panel's head, further legend row, last axis."""
SIDE_ROOM, TICK_ROOM, LINE_ROOM = 0.16, 0.17, 1.3
"""Widths beside all and of ticks [in]; line's height over its font's size."""


MATH_MARKS = re.compile(r"\\[a-z]+|[${}^]")
"""Marks of formulas in ticks' texts."""


class PlainFigure(Figure):
    """Matplotlib figure whose texts may hold any character."""

    is_laid_out = False
    """Whether the file being written is laid out."""

    def get_layout_engine(self) -> LayoutEngine | None:
        """Layout of the figure, None while a laid-out one is written."""
        return None if self.is_laid_out else super().get_layout_engine()

    def draw(self, renderer: Any) -> None:
        """Draws the figure, texts but ticks without formulas."""
        self._read_no_formulas()
        super().draw(renderer)

    def _read_no_formulas(self) -> None:
        """Makes texts but ticks stand as they are written."""
        for artist in self.get_children():
            for text in _texts_without_ticks(artist):
                text.set_parse_math(False)

    def savefig(self, *args: Any, **settings: Any) -> None:
        """Writes the figure to a file, laid out once; arguments as of matplotlib's `Figure.savefig`."""
        engine, own = self.get_layout_engine(), self.dpi
        if engine is None:
            super().savefig(*args, **settings)
            return
        dpi = settings.get("dpi", rcParams["savefig.dpi"])
        self.dpi = own if dpi == "figure" else dpi
        self._read_no_formulas()  # the layout measures texts
        engine.execute(self)
        self.dpi, self.is_laid_out = own, True
        try:
            super().savefig(*args, **settings)
        finally:
            self.is_laid_out = False
            self.set_layout_engine(engine)


def _texts_without_ticks(artist: Artist) -> list[Text]:
    """Texts in a part of a figure, those of ticks left out."""
    if isinstance(artist, Text):
        return [artist]
    inner = [artist.label] if isinstance(artist, Axis) else artist.get_children()
    return [text for child in inner for text in _texts_without_ticks(child)]


class PanelLayout(LayoutEngine):
    """Layout of panels one below the other by inches, without measuring texts.

    Args:
        panels: axes from above.
        right: width [in] beside the panels, of a color bar or of a second axis.

    Attributes:
        legend_rows: most rows of a panel's legend above it.
    """

    _adjust_compatible, _colorbar_gridspec = True, True

    def __init__(self, panels: list[Any], right: float = SIDE_ROOM) -> None:
        super().__init__()
        self.panels, self.right, self.legend_rows = panels, right, 1

    def execute(self, fig: Figure) -> None:
        """Places a figure's panels, and their labels at one distance."""
        width, height = fig.get_size_inches()
        count, apart = len(self.panels), self.panels[-1].get_shared_x_axes().joined(self.panels[0], self.panels[-1])
        top = TITLE_ROOM if fig.get_suptitle() else 0.06
        head = HEAD_ROOM + LEGEND_ROW * (self.legend_rows - 1) if self._has_heads() else 0.08
        gap = head + (0.1 if apart else 0.3)
        each = max((height - top - head - FOOT_ROOM - gap * (count - 1)) / count, 0.2)
        fig.subplots_adjust(
            bottom=FOOT_ROOM / height, top=1.0 - (top + head) / height, hspace=gap / each if count > 1 else None
        )
        size = self.panels[0].yaxis.label.get_fontsize()
        lines = 0
        for axis in self.panels:
            label = axis.yaxis.label
            most = int((each + 0.8 * gap) / (LETTER_WIDTH * size))
            words = [part for line in label.get_text().split("\n") for part in textwrap.wrap(line, max(most, 8))]
            label.set_text("\n".join(words))
            lines = max(lines, len(words))
        ticks = max(tick_label_width(axis) for axis in self.panels) + TICK_ROOM
        fig.subplots_adjust(
            left=(SIDE_ROOM + lines * LINE_ROOM * size / 72.0 + ticks) / width, right=1.0 - self.right / width
        )
        for axis in self.panels:
            beside = ScaledTranslation(-ticks, 0.0, fig.dpi_scale_trans)
            axis.yaxis.set_label_coords(0.0, 0.5, axis.transAxes + beside)
            axis.xaxis.set_label_coords(0.5, 0.0, axis.transAxes + ScaledTranslation(0.0, -0.29, fig.dpi_scale_trans))

    def _has_heads(self) -> bool:
        """Whether a panel has a title or legend above it."""
        return any(axis.get_title("left") or axis.get_legend() is not None for axis in self.panels)


def tick_label_width(axis: Any) -> float:
    """Width [in] of the longest tick at an upright axis."""
    low, high = sorted(axis.get_ylim())
    places = [place for place in axis.yaxis.get_majorticklocs() if low <= place <= high]
    words = [MATH_MARKS.sub("", word) for word in axis.yaxis.get_major_formatter().format_ticks(places)]
    size = axis.yaxis.get_tick_params().get("labelsize", rcParams["ytick.labelsize"])
    points = size if isinstance(size, (int, float)) else 10.0
    return LETTER_WIDTH * points * max((len(word) for word in words), default=0)
