"""HTML of drives, runs and trajectories for notebooks, by a registered function."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

_renderers: list[Callable[[Any], str]] = []


def register_renderer(renderer: Callable[[Any], str]) -> None:
    """Registers the function that `rendered_html` calls."""
    _renderers[:] = [renderer]


def rendered_html(thing: Any) -> str:
    """HTML of a drive, run or trajectory for notebooks, by the registered renderer."""
    return _renderers[0](thing)
