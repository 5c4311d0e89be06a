"""Motions of a drive that `run.phase` turns on at the start."""

from __future__ import annotations

import math
from typing import Any, TypeVar

from warpchain.drive.motion_table import Table
from warpchain.drive.shafts import Motor, Shaft
from warpchain.drive.sprocket import Harmonic, Load, Prescribed, Sprocket
from warpchain.drive.stack_math import Number, is_true_somewhere
from warpchain.model.trains import turns_per_roller

TurningMotion = TypeVar("TurningMotion", Prescribed, Load, Motor)


def start_phase_angle(model: Any, name: str) -> Number:
    """Forward start angle of a named sprocket or shaft by `run.phase` [rad]."""
    phase = model.run.phase
    if phase is None or not is_true_somewhere(phase):
        return 0.0
    teeth: dict[str, float] = {other.name: other.teeth for other in model.sprockets}
    if model.shafts:
        turns = turns_per_roller(model)[len(model.sprockets) :]
        teeth |= {shaft.name: 1.0 / abs(each) for shaft, each in zip(model.shafts, turns, strict=True)}
    return phase * 2.0 * math.pi / teeth[name]


def motion_from_start_phase(model: Any, turned: Sprocket | Shaft, motion: TurningMotion) -> TurningMotion:
    """Motion, load or motor of a body, its harmonics and tables as `run.phase` starts it."""
    phase = model.run.phase
    if phase is None or not is_true_somewhere(phase):
        return motion

    def angle(part: Harmonic | Table) -> Number:
        """Start angle that counts for a harmonic or table [rad]."""
        return start_phase_angle(model, turned.name if part.shaft is None else part.shaft)

    changes: dict[str, Any] = {}
    if not isinstance(motion, Motor):
        moved = [h.model_copy(update={"phase": h.phase + h.order * angle(h)}) for h in motion.harmonics]
        changes["harmonics"] = tuple(moved)
    table = motion.table
    if table is not None and table.angle is not None:
        table = table.model_copy(update={"angle": tuple(x - angle(table) for x in table.angle)})
    return motion.model_copy(update=changes | {"table": table})
