"""Playback in Rerun."""

from warpchain.view.rerun.playback import view

__all__ = ["view"]
