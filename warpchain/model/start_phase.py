"""Angles, motions, loads and motors of drives whose start `run.phase` turns on by some teeth."""

from __future__ import annotations

import math
from typing import Any, TypeVar

from warpchain.drive.motion_table import Table
from warpchain.drive.shafts import Motor, Shaft
from warpchain.drive.sprocket import Harmonic, Load, Prescribed, Sprocket
from warpchain.drive.stack_math import is_true_somewhere
from warpchain.model.trains import turns_per_roller

TurningMotion = TypeVar("TurningMotion", Prescribed, Load, Motor)


def start_phase_angle(model: Any, name: str) -> Any:
    """Forward angle [rad] by which a named sprocket or shaft has turned on where `run.phase` begins the drive."""
    phase = model.run.phase
    if phase is None or not is_true_somewhere(phase):
        return 0.0
    teeth: dict[str, float] = {other.name: other.teeth for other in model.sprockets}
    if model.shafts:
        turns = turns_per_roller(model)[len(model.sprockets) :]
        teeth |= {shaft.name: 1.0 / abs(each) for shaft, each in zip(model.shafts, turns, strict=True)}
    return phase * 2.0 * math.pi / teeth[name]


def motion_from_start_phase(model: Any, turned: Sprocket | Shaft, motion: TurningMotion) -> TurningMotion:
    """A motion, load or motor of a sprocket or shaft as it goes on from where `run.phase` begins the drive.

    Every shaft of z teeth has turned on by phase 2 pi / z: the phases of harmonics of its order h grow by h times that,
    and tables over its angle move back by it.
    """
    phase = model.run.phase
    if phase is None or not is_true_somewhere(phase):
        return motion

    def angle(part: Harmonic | Table) -> Any:
        return start_phase_angle(model, turned.name if part.shaft is None else part.shaft)

    changes: dict[str, Any] = {}
    if not isinstance(motion, Motor):
        moved = [h.model_copy(update={"phase": h.phase + h.order * angle(h)}) for h in motion.harmonics]
        changes["harmonics"] = tuple(moved)
    table = motion.table
    if table is not None and table.angle is not None:
        table = table.model_copy(update={"angle": tuple(x - angle(table) for x in table.angle)})
    return motion.model_copy(update=changes | {"table": table})
