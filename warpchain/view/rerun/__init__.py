"""Playback in Rerun."""

from warpchain.view.rerun.run_playback import view

__all__ = ["view"]
