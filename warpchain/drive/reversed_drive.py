"""A drive that runs the other way: opposite `wrap` and order of sprockets.

Loads that store energy over the angle have M(phi) = dE/dphi; with phi' = -phi,

    M_h cos(h phi + psi)  ->  M_h cos(h phi' + pi - psi).                                                           (a)
"""

from __future__ import annotations

import math
from typing import Any, TypeVar

from warpchain.drive.drive import Drive
from warpchain.drive.shafts import Shaft
from warpchain.drive.sprocket import Load, Prescribed, Sprocket
from warpchain.errors import DriveError

TurningPart = TypeVar("TurningPart", Sprocket, Shaft)
HarmonicMotion = TypeVar("HarmonicMotion", Load, Prescribed)


def reversed_drive(drive: Drive) -> Drive:
    """The drive as it runs backward.

    Raises:
        DriveError: a shaft without sprockets.
    """
    on = {sprocket.shaft for sprocket in drive.sprockets}
    bare = next((shaft.name for shaft in drive.shafts if shaft.name not in on), None)
    if bare is not None:
        raise DriveError(f"shafts.{bare}: has no sprocket; only drives whose shafts all have one can run in reverse")
    first, *rest = (_reversed_part(sprocket, _opposite_wrap(sprocket)) for sprocket in drive.sprockets)
    shafts = tuple(_reversed_part(shaft, {}) for shaft in drive.shafts)
    return drive.model_copy(update={"sprockets": (first, *reversed(rest)), "shafts": shafts})


def _opposite_wrap(sprocket: Sprocket) -> dict[str, Any]:
    """Key `wrap` of a sprocket that turns the other way."""
    return {"wrap": "cw" if sprocket.wrap == "ccw" else "ccw"}


def _reversed_part(part: TurningPart, changes: dict[str, Any]) -> TurningPart:
    """A sprocket or shaft with its harmonics mirrored, (a)."""
    found: dict[str, Any] = dict(changes)
    if part.load is not None:
        found["load"] = _mirrored_motion(part.load, math.pi)
    if part.prescribed is not None:
        found["prescribed"] = _mirrored_motion(part.prescribed, 0.0)
    return part.model_copy(update=found)


def _mirrored_motion(motion: HarmonicMotion, shift: float) -> HarmonicMotion:
    """A motion or load, phases mirrored to `shift` less their own."""
    harmonics = tuple(h.model_copy(update={"phase": shift - h.phase}) for h in motion.harmonics)
    return motion.model_copy(update={"harmonics": harmonics})
