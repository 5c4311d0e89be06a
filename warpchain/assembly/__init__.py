"""Chains of a drive in place: path, seating of rollers, initial state, statics, time step, set-up help."""

from warpchain.assembly.assembly import (
    Assembly,
    assemble,
)

__all__ = [
    "Assembly",
    "assemble",
]
