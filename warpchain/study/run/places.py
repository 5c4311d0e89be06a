"""Where a row's values go in the drive: in place of its own, times or beside its own, or as the shift of a part."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from warpchain.drive import Drive, Guide
from warpchain.errors import StudyError
from warpchain.study.spec import Study
from warpchain.study.spec.factor import Factor


def placed(study: Study, base: Drive, row: Mapping[str, Any]) -> Drive:
    """The drive of a row, before anything is adjusted: values first, then shifts from where parts then stand.

    Raises:
        DriveError: a value that the drive refuses.
        StudyError: a part that cannot be shifted.
    """
    values = {
        path: _value(factor, base.get_value(path) if factor.relative or factor.offset else None, row)
        for factor in study.factors
        for _, path in factor.targets()
    }
    drive = base.with_values(values)
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
        x, y = _normal(part)
    else:
        raise StudyError(f"factors.{factor.name}.along: missing; {path} has no normal")
    size = math.hypot(x, y)
    step = by * x / size, by * y / size
    names = ("start", "end") if isinstance(part, Guide) else ("center",)
    points = {f"{path}.{name}": getattr(part, name) for name in names}
    return drive.with_values({name: [own[0] + step[0], own[1] + step[1]] for name, own in points.items()})


def _normal(guide: Guide) -> tuple[float, float]:
    """Towards the chain, which rides on the left of start to end."""
    (x, y), (u, v) = guide.start, guide.end
    return -(v - y), u - x
