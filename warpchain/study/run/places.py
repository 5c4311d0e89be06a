"""Where a row's values go in the drive: in place of its own, times or beside its own, or as the shift of a part."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from warpchain.drive import Drive, Guide
from warpchain.drive.changes import Changes
from warpchain.errors import StudyError
from warpchain.study.spec import Study
from warpchain.study.spec.factor import Factor


def placed(study: Study, base: Drive, row: Mapping[str, Any], changes: Changes | None = None) -> Drive:
    """The drive of a row, before anything is adjusted: values first, then shifts from where parts then stand.

    Args:
        study: whose factors say where values go.
        base: the base drive.
        row: values of the factors.
        changes: of the base drive, where many rows are placed.

    Raises:
        DriveError: a value that the drive refuses.
        StudyError: a part that cannot be shifted.
    """
    values = {
        path: _value(factor, base.get_value(path) if factor.relative or factor.offset else None, row)
        for factor in study.factors
        for _, path in factor.targets()
    }
    drive = base.with_values(values) if changes is None else changes.drive(values)
    for factor in study.factors:
        if factor.shift is not None:
            drive = _shifted(drive, factor, factor.shift, float(row[factor.name]))
    return drive


def _value(factor: Factor, own: Any, row: Mapping[str, Any]) -> Any:
    """What a factor sets a place of the drive to; whole numbers stay whole."""
    value = factor.value_of(row[factor.name])
    if not (factor.relative or factor.offset):
        return value
    value = own * value if factor.relative else own + value
    return round(value) if isinstance(own, int) else value


def _shifted(drive: Drive, factor: Factor, path: str, by: float) -> Drive:
    """The drive with a guide-bar or a sprocket moved by a distance [m]."""
    part = drive.get_value(path)
    if factor.along is not None and factor.along != "normal":
        x, y = factor.along
    elif isinstance(part, Guide):
        x, y = _normal(drive, part)
    else:
        raise StudyError(f"factors.{factor.name}.along: missing; {path} has no normal")
    size = math.hypot(x, y)
    step = by * x / size, by * y / size
    moved = _guide_moved(part, step) if isinstance(part, Guide) else {"center": _moved(part.center, step)}
    return drive.with_values({f"{path}.{name}": value for name, value in moved.items()})


def _moved(point: Sequence[float], step: Sequence[float]) -> list[float]:
    """A point [m] by a step [m]."""
    return [point[0] + step[0], point[1] + step[1]]


def _guide_moved(guide: Guide, step: Sequence[float]) -> dict[str, Any]:
    """What of a guide changes where it is shifted, whatever gives its face."""
    found: dict[str, Any] = {}
    for name in ("start", "end"):
        if (own := getattr(guide, name)) is not None:
            found[name] = _moved(own, step)
    for name in ("points", "profile"):
        if (line := getattr(guide, name)) is not None:
            found[name] = [_moved(own, step) for own in line]
    if guide.arcs:
        found["arcs"] = [arc.model_dump() | {"center": _moved(arc.center, step)} for arc in guide.arcs]
    return found


def _normal(drive: Drive, guide: Guide) -> tuple[float, float]:
    """From the middle of a guide's face towards the chain."""
    profile = drive.profile(drive.guides.index(guide))
    _, heading = profile.at(0.5 * profile.face_length)
    return -math.sin(heading), math.cos(heading)
