"""The study file as data: base drive, factors, design, constraints, run settings, what to keep; TOML in and out.

A study never changes. Its tables are checked like a drive's (`warpchain.drive.part`): all errors at once, one line
each, with file, key and value. What it says is documented in `docs/studies.md`.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import Annotated, Any

from warpchain.drive import Drive
from warpchain.drive import toml as drive_toml
from warpchain.drive.part import Allowed, Part, Problem, Text
from warpchain.errors import DriveError, StudyError
from warpchain.files import read_text
from warpchain.results.judgement import Limits
from warpchain.study.spec.factor import Factor
from warpchain.study.spec.objectives import (
    Bound,
    Objective,
    Search,
    as_written,
    joined_limits,
    objective_rules,
    split_limits,
)
from warpchain.study.spec.parts import Adjust, Constraint, Design, Fatigue, Keep, Recording, RunOptions
from warpchain.study.spec.rules import design_rules, expression_rules, fatigue_rules, name_rules

__all__ = ["Study", "Subject", "check_drive", "dumps_study", "load_study", "loads_study"]


class Subject(Part):
    """What is studied.

    Attributes:
        drive: file of the base drive, relative to the study file, or the name of an example drive.
        name: heading of reports.
    """

    drive: Text
    name: Text | None = None


class Study(Part):
    """A whole study: immutable, compared by value.

    Attributes:
        study: the base drive and the study's name.
        design: how rows are chosen.
        factors: what varies; at least one.
        constraints: conditions on factors that a row must meet.
        adjust: what keeps the drive assembled.
        run: run settings.
        metrics: which metrics are kept.
        record: which variants are recorded in full.
        fatigue: of a link; with it, recorded variants have the objectives of `results.objectives` in the table.
        limits: what a variant may come to and still be ok.
        objectives: what should be small or large.
        bounds: limits on metrics, the entries of a list `limits` that name one.
        optimize: how to look for designs.

    Raises:
        DriveError: with one line for each value that is wrong (`load_study` makes it a StudyError).
    """

    study: Subject
    design: Design
    factors: Annotated[tuple[Factor, ...], Allowed("must be a list of at least 1 factor")]
    constraints: Annotated[tuple[Constraint, ...], Allowed("must be a list of constraints")] = ()
    adjust: Adjust | None = None
    run: RunOptions = RunOptions()
    metrics: Keep = Keep()
    record: Recording = Recording()
    fatigue: Fatigue | None = None
    limits: Limits = Limits()
    objectives: Annotated[tuple[Objective, ...], Allowed("must be a list of objectives")] = ()
    bounds: Annotated[tuple[Bound, ...], Allowed("must be a list of limits on metrics")] = ()
    optimize: Search | None = None

    @property
    def wanted(self) -> tuple[str, ...]:
        """The metrics and factors that objectives and limits name."""
        return tuple(dict.fromkeys([*(o.metric for o in self.objectives), *(b.metric for b in self.bounds)]))

    @classmethod
    def _source(cls) -> str:
        return ""

    @classmethod
    def _completed(cls, values: Any) -> Any:
        return split_limits(values)

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        yield from name_rules(node)
        yield from expression_rules(node)
        yield from design_rules(node)
        yield from fatigue_rules(node)
        yield from objective_rules(node)


def loads_study(text: str, source: str = "<text>") -> Study:
    """Reads a study from TOML text.

    Raises:
        StudyError: with one line for each error of the text, all of them.
    """
    try:
        values = drive_toml.parse(text, source)
    except DriveError as error:
        raise StudyError(str(error)) from None
    try:
        return Study(**values)
    except DriveError as error:
        raise StudyError("\n".join(f"{source}: {as_written(line, values)}" for line in error.errors)) from None


def load_study(path: str | os.PathLike[str]) -> Study:
    """Reads a study file (TOML, UTF-8).

    Raises:
        StudyError: if it cannot be read, in one line, or with one line for each of its errors.
    """
    return loads_study(read_text(path, "TOML", lambda reason: StudyError(f"{path}: {reason}")), str(path))


def dumps_study(study: Study) -> str:
    """A study as TOML text, which `loads_study` reads back equal."""
    return drive_toml.dumps(joined_limits(_given(study)))


def _given(value: Any) -> Any:
    """A part as plain values, without empty tables, and without empty lists where they are the default."""
    if isinstance(value, Part):
        fields = type(value).model_fields
        inner = {name: _given(getattr(value, name)) for name in fields}
        said = {name for name, field in fields.items() if field.default != () and inner[name] == []}
        return {name: part for name, part in inner.items() if name in said or part not in (None, [], {})}
    return [_given(part) for part in value] if isinstance(value, tuple) else value


def check_drive(study: Study, drive: Drive, source: str) -> None:
    """Checks what a study says of its base drive: what factors set, and the sprocket that `adjust` moves.

    Raises:
        StudyError: one line for each error.
    """
    lines = []
    for factor in study.factors:
        for key, path in [*factor.targets(), *([("shift", factor.shift)] if factor.shift else [])]:
            try:
                own = drive.get_value(path)
            except DriveError as error:
                reason = str(error).partition(": ")[2]
                lines.append(f"factors.{factor.name}.{key} = {drive_toml.value_text(path)}: {reason}")
                continue
            if (factor.relative or factor.offset) and (isinstance(own, bool) or not isinstance(own, (int, float))):
                word = "relative" if factor.relative else "offset"
                shown = "nothing" if own is None else drive_toml.value_text(own)
                lines.append(
                    f"factors.{factor.name}.{word} = true: needs a number at {path}, which is {shown} in the drive"
                )
            given = getattr(study.run, path.removeprefix("run.")) if path in ("run.step", "run.duration") else None
            if given is not None:
                lines.append(
                    f'{path} = {drive_toml.value_text(given)}: not together with factor "{factor.name}", which sets it'
                )
    names = [sprocket.name for sprocket in drive.sprockets]
    if study.adjust is not None and study.adjust.sprocket is not None and study.adjust.sprocket not in names:
        lines.append(
            f"adjust.sprocket = {drive_toml.value_text(study.adjust.sprocket)}: must be a sprocket of the drive: "
            + ", ".join(names)
        )
    if lines:
        raise StudyError("\n".join(f"{source}: {line}" for line in lines))
