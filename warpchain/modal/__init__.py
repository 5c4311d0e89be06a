"""Modes of a drive: natural frequencies, damping, shapes, and how they move with its speed."""

from warpchain.modal.eigenmodes import Modes, modes

__all__ = ["Modes", "modes"]
