"""Modes as metrics of a study: those of the base drive, found again in each variant."""

from __future__ import annotations

from functools import lru_cache

from warpchain.drive import Drive
from warpchain.errors import SimulationError
from warpchain.modal.campbell import SPARE, matched
from warpchain.modal.modes import Modes, modes_of
from warpchain.modal.system import system

PREFIX = "modes."


@lru_cache(maxsize=4)
def base_modes(drive: Drive, count: int) -> Modes:
    """The lowest modes of a study's base drive, at rest."""
    return modes_of(system(drive), count)


def mode_metrics(base: Modes, drive: Drive) -> dict[str, float]:
    """`modes.NAME.frequency` [Hz] and `.damping_ratio` of a variant, NAME a mode of the base drive.

    Modes are the same where their shapes agree best, one to one; with another number of links, where they have the same
    name. One that is not found again is left out, all are if the variant does not settle at rest.
    """
    try:
        found = system(drive)
    except SimulationError:
        return {}
    own = modes_of(found, len(base) + SPARE)
    if own.shape.shape[1:] == base.shape.shape[1:]:
        which = matched(base, own, found).tolist()
    else:
        which = [own.names.index(name) if name in own.names else -1 for name in base.names]
    result = {}
    for name, k in zip(base.names, which, strict=True):
        if k >= 0:
            result[f"{PREFIX}{name}.frequency"] = float(own.frequency[k])
            result[f"{PREFIX}{name}.damping_ratio"] = float(own.damping_ratio[k])
    return result
