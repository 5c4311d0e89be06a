"""From a drive as data to a chain in place: path, seats, initial state, time step, set-up help."""

from warpchain.assembly.assembly import (
    Assembly,
    assemble,
)

__all__ = [
    "Assembly",
    "assemble",
]
