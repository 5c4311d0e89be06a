"""How things show themselves in notebooks: each asks for what stands higher in the package only when it is shown."""

from __future__ import annotations

from importlib import import_module
from typing import Any


def html(thing: Any) -> str:
    """A drive, run or trajectory as HTML (`warpchain.view.notebook`): its picture, and tables with units."""
    return str(import_module("warpchain.view.notebook").html(thing))
