"""A drive that runs the other way: every sprocket turns against its `wrap`, the chain visits them in opposite order.

Nothing moves from its place. A load that stores energy over the angle, as cams do, has the moment M(phi) = dE/dphi
against forward rotation; against the other way, phi' = -phi, it is dE/dphi', so that each of its harmonics becomes

    M_h cos(h phi + psi)  ->  M_h cos(h phi' + pi - psi).                                                           (a)

A fluctuation of speed goes by the place alone: cos(h phi' - psi). Tables go on as they are written.
"""

from __future__ import annotations

import math
from typing import Any, TypeVar

from warpchain.drive.drive import Drive
from warpchain.drive.shafts import Shaft
from warpchain.drive.sprocket import Load, Prescribed, Sprocket
from warpchain.errors import DriveError

Part = TypeVar("Part", Sprocket, Shaft)
Motion = TypeVar("Motion", Load, Prescribed)


def reverse(drive: Drive) -> Drive:
    """The drive as it runs backward.

    Raises:
        DriveError: a shaft without sprockets, for which no drive file says which way is forward.
    """
    on = {sprocket.shaft for sprocket in drive.sprockets}
    bare = next((shaft.name for shaft in drive.shafts if shaft.name not in on), None)
    if bare is not None:
        raise DriveError(f"shafts.{bare}: has no sprocket; only drives whose shafts all have one can run in reverse")
    first, *rest = (_backward(sprocket, _turned(sprocket)) for sprocket in drive.sprockets)
    shafts = tuple(_backward(shaft, {}) for shaft in drive.shafts)
    return drive.model_copy(update={"sprockets": (first, *reversed(rest)), "shafts": shafts})


def _turned(sprocket: Sprocket) -> dict[str, Any]:
    return {"wrap": "cw" if sprocket.wrap == "ccw" else "ccw"}


def _backward(part: Part, changes: dict[str, Any]) -> Part:
    """A sprocket or a shaft with the harmonics of its motion and load mirrored, (a), and with changes."""
    found: dict[str, Any] = dict(changes)
    if part.load is not None:
        found["load"] = _mirrored(part.load, math.pi)
    if part.prescribed is not None:
        found["prescribed"] = _mirrored(part.prescribed, 0.0)
    return part.model_copy(update=found)


def _mirrored(motion: Motion, shift: float) -> Motion:
    harmonics = tuple(h.model_copy(update={"phase": shift - h.phase}) for h in motion.harmonics)
    return motion.model_copy(update={"harmonics": harmonics})
