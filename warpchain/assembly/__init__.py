"""Chains of a drive in place, before a run: path, seating, initial state, statics, set-up help."""

from warpchain.assembly.assembly import (
    Assembly,
    assemble,
)

__all__ = [
    "Assembly",
    "assemble",
]
