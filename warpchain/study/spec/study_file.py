"""Study file as data: base drive, factors, design, constraints, run settings, what to keep; TOML in and out."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

from warpchain.drive import Drive
from warpchain.drive import toml as drive_toml
from warpchain.drive.json_schema import file_schema
from warpchain.drive.parts_by_chain import shaft_of_sprocket
from warpchain.drive.schema import BARE, Allowed, Part, Problem, Text, node_list, node_value
from warpchain.errors import DriveError, StudyError
from warpchain.files import read_text_file
from warpchain.results.judgement import Limits
from warpchain.results.replicate_metrics import COPY_COLUMN, COUNT_COLUMN
from warpchain.study.spec.calibration_tables import Calibrate, Measurement, calibration_rules
from warpchain.study.spec.expression import Expression, parse_expression
from warpchain.study.spec.factor import DISTRIBUTION_KEYS, Factor, factor_unit, value_source_of
from warpchain.study.spec.key_path_names import key_path_namer
from warpchain.study.spec.noise_table import (
    NOISE,
    Noise,
    factor_with_sample,
    metric_from_name,
    noise_factor_names,
    noise_table_rules,
)
from warpchain.study.spec.study_tables import (
    Adjust,
    Bound,
    Constraint,
    Design,
    Fatigue,
    Keep,
    Objective,
    Recording,
    Risk,
    RunOptions,
    Search,
    adjustment_rules,
    condition_without_units,
    fields_from_file,
    file_from_fields,
    named_adjustments,
    objective_rules,
)

MOST_FACTORS = 1000


def factor_count_complaint(study: Any) -> str:
    """Complaint about a study's number of factors, or ""."""
    count = len(node_list(study, "factors"))
    return f"{count} of them; must be at most {MOST_FACTORS}" if count > MOST_FACTORS else ""


def _factor_paths(factor: Any) -> list[str]:
    """Key paths of drive values that a factor sets."""
    paths = node_value(factor, "paths")
    found = [node_value(factor, "path"), *(paths if isinstance(paths, (list, tuple)) else ())]
    return [path for path in found if isinstance(path, str)]


def fatigue_rules(node: Any) -> Iterator[Problem]:
    """Problems of a study's table `fatigue`."""
    record = node_value(node, "record")
    if node_value(node, "fatigue") is None:
        return
    if not any(node_value(record, key) for key in ("variants", "every", "worst")):
        yield Problem(("fatigue",), None, "needs record.variants, record.every or record.worst", BARE)
    channels = node_value(record, "channels")
    if isinstance(channels, (list, tuple)) and "tension" not in channels:
        yield Problem(("record", "channels"), channels, 'must hold "tension", which fatigue counts')


def factor_name_rules(node: Any) -> Iterator[Problem]:
    """Problems of factors' names, targets and uses."""
    factors = node_list(node, "factors")
    if node_value(node, "factors") is not None and not factors:
        yield Problem(("factors",), node_value(node, "factors"), "must be a list of at least 1 factor")
    names: set[str] = set()
    taken: dict[str, Any] = {}
    used = {name for _, expression in _parsed_expressions(node) for name in expression.names}
    for i, factor in enumerate(factors):
        name = node_value(factor, "name")
        if not isinstance(name, str):
            continue  # its own rule says so
        if name in names:
            yield Problem(("factors", i, "name"), name, "must be unique among factors")
        if name in (COPY_COLUMN, COUNT_COLUMN) and node_value(node_value(node, "design"), "replicates") is not None:
            yield Problem(("factors", i, "name"), name, "is a column of studies with design.replicates")
        names.add(name)
        for path in _factor_paths(factor):
            if path in taken:
                yield Problem(("factors", i, "path"), path, f'is set by factor "{taken[path]}" already')
            taken[path] = name
        if not _factor_paths(factor) and node_value(factor, "shift") is None and name not in used:
            text = (
                "missing; must be a key path into the drive; needed unless an expression or constraint uses the factor"
            )
            yield Problem(("factors", i, "path"), None, text, BARE)


def _expression_texts(node: Any) -> Iterator[tuple[tuple[str | int, ...], str]]:
    """Key path and text of each expression in a study."""
    for i, factor in enumerate(node_list(node, "factors")):
        yield ("factors", i, "expression"), node_value(factor, "expression")
    for i, constraint in enumerate(node_list(node, "constraints")):
        yield ("constraints", i, "require"), node_value(constraint, "require")
    for k, adjust in enumerate(node_list(node, "adjust")):
        for key in ("strain", "preload"):
            yield ("adjust", k, key), node_value(adjust, key)


def _parsed_expressions(node: Any) -> Iterator[tuple[tuple[str | int, ...], Expression]]:
    """Key path and expression of each text that parses."""
    for path, text in _expression_texts(node):
        if isinstance(text, str):
            try:
                yield path, parse_expression(text)
            except StudyError:
                continue


def expression_rules(node: Any) -> Iterator[Problem]:
    """Problems of a study's expressions and their names."""
    factors = [str(node_value(factor, "name")) for factor in node_list(node, "factors")]
    for path, text in _expression_texts(node):
        if not isinstance(text, str):
            continue
        try:
            unknown = [name for name in parse_expression(text).names if name not in factors]
        except StudyError as error:
            yield Problem(path, text, str(error))
            continue
        if unknown:
            known = ", ".join(str(name) for name in factors)
            yield Problem(path, text, f"{unknown[0]} is not a factor; factors are {known}")
    needs = {factors[int(i)]: found.names for (head, i, *_), found in _parsed_expressions(node) if head == "factors"}
    for i, (name, factor) in enumerate(zip(factors, node_list(node, "factors"), strict=True)):
        if name in needs and name in _expression_dependencies(name, needs):
            yield Problem(("factors", i, "expression"), node_value(factor, "expression"), "needs itself")


def _expression_dependencies(name: str, needs: Mapping[str, tuple[str, ...]]) -> set[str]:
    """Names of all factors that a factor's expression needs."""
    reached: set[str] = set()
    front = list(needs[name])
    while front:
        following = front.pop()
        if following not in reached:
            reached.add(following)
            front.extend(needs.get(following, ()))
    return reached


def design_rules(node: Any) -> Iterator[Problem]:
    """Problems of factors with the kind of design."""
    kind = node_value(node_value(node, "design"), "kind")
    factors = node_list(node, "factors")
    for i, factor in enumerate(factors):
        given = value_source_of(factor)
        if given == "expression" or node_value(factor, "kind") == NOISE:
            continue
        if kind == "table":
            if node_value(factor, "points") is not None:
                yield Problem(("factors", i, "points"), node_value(factor, "points"), "only in a factorial design")
            continue
        if given is None:
            text = "missing; give range, a distribution, levels, choice or expression"
            yield Problem(("factors", i, "range"), None, text, BARE)
        yield from _design_factor_rules(i, factor, given, kind)
    yield from _group_rules(factors)


def _design_factor_rules(i: int, factor: Any, given: str | None, kind: Any) -> Iterator[Problem]:
    """Problems of one factor with the kind of design."""
    values = node_value(factor, str(given)) if given in ("levels", "choice") else None
    if values is not None and not isinstance(values, (list, tuple)):
        return  # its own rule says so
    points = node_value(factor, "points")
    if kind == "factorial" and given in DISTRIBUTION_KEYS and points is None:
        text = "missing; must be an integer from 2 to 100000; needed in a factorial design"
        yield Problem(("factors", i, "points"), None, text, BARE)
    if kind != "factorial" and points is not None:
        yield Problem(("factors", i, "points"), points, "only in a factorial design")
    if kind == "central-composite" and values is not None:
        yield Problem(("factors", i, str(given)), values, "a central composite design takes ranges or distributions")
    if kind == "plackett-burman" and values is not None and len(values) != 2:
        yield Problem(("factors", i, str(given)), values, "a Plackett-Burman design takes two values")


def _listed_count(factor: Any) -> Any:
    """Number of a factor's listed values or grid points."""
    values = node_value(factor, "levels") or node_value(factor, "choice")
    return len(values) if isinstance(values, (list, tuple)) else node_value(factor, "points")


def _group_rules(factors: Any) -> Iterator[Problem]:
    """Problems of groups of factors."""
    groups = [node_value(factor, "group") for factor in factors]
    members = Counter(group for group in groups if isinstance(group, str))
    sizes: dict[str, Any] = {}
    for i, (factor, group) in enumerate(zip(factors, groups, strict=True)):
        if not isinstance(group, str):
            continue  # none, or its own rule says so
        if members[group] < 2:
            yield Problem(("factors", i, "group"), group, "has no other factor")
        size = _listed_count(factor)
        if size is not None and sizes.setdefault(group, size) != size:
            text = "factors of a group must have equally many levels, choices or points"
            yield Problem(("factors", i, "group"), group, text)


class Subject(Part):
    """The subject of a study.

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
        constraints: conditions on factors that a row must satisfy.
        adjust: what keeps the drive assembled; of several chains, one after the other.
        run: run settings.
        metrics: which metrics are kept.
        record: which variants are recorded in full.
        fatigue: Woehler curve of a link, which adds the objectives of `results.objectives` to recorded variants.
        limits: what a variant may come to and still be ok.
        objectives: what should be small or large.
        bounds: limits on metrics, the entries of a list `limits` that name one.
        optimize: settings of the search for designs.
        risk: settings of `warpchain risk`.
        measured: what was measured on a rig, for `warpchain calibrate`.
        calibrate: settings of it.
        noise: rows of noise, and the share of them in which limits must be kept.

    Raises:
        DriveError: a line for each value that is wrong (`load_study` makes it a StudyError).
    """

    study: Subject
    design: Design
    factors: Annotated[tuple[Factor, ...], Allowed("must be a list of at least 1 factor")]
    constraints: Annotated[tuple[Constraint, ...], Allowed("must be a list of constraints")] = ()
    adjust: Annotated[tuple[Adjust, ...], Allowed("must be a table, or a list of tables")] = ()
    run: RunOptions = RunOptions()
    metrics: Keep = Keep()
    record: Recording = Recording()
    fatigue: Fatigue | None = None
    limits: Limits = Limits()
    objectives: Annotated[tuple[Objective, ...], Allowed("must be a list of objectives")] = ()
    bounds: Annotated[tuple[Bound, ...], Allowed("must be a list of limits on metrics")] = ()
    optimize: Search | None = None
    noise: Noise | None = None
    risk: Risk | None = None
    measured: Annotated[tuple[Measurement, ...], Allowed("must be a list of measured values and signals")] = ()
    calibrate: Calibrate | None = None

    @property
    def named_metrics(self) -> tuple[str, ...]:
        """Metrics and factors in objectives, limits and calibration."""
        named = [*(objective.metric for objective in self.objectives), *(bound.metric for bound in self.bounds)]
        named += [of.metric for of in self.measured if of.metric is not None]
        named += self.calibrate.predict if self.calibrate is not None else ()
        return tuple(dict.fromkeys(map(metric_from_name, named)))

    @property
    def noise_names(self) -> tuple[str, ...]:
        """Names of the study's noise factors and their dependents."""
        return noise_factor_names(self)

    @property
    def design_study(self) -> Study:
        """Study of the design factors alone; itself without noise."""
        noise = self.noise_names
        kept = tuple(factor for factor in self.factors if factor.name not in noise)
        return self if len(kept) == len(self.factors) else self.model_copy(update={"factors": kept})

    @property
    def noise_study(self) -> Study:
        """Study of the noise factors alone."""
        return self.model_copy(update={"factors": tuple(f for f in self.factors if f.kind == NOISE)})

    @classmethod
    def _source(cls) -> str:
        """Begin of messages on a study: none."""
        return ""

    @classmethod
    def _places(cls, values: Any) -> Callable[[Sequence[str | int]], str]:
        """Function that names a study's key paths in messages."""
        return key_path_namer(values)

    @classmethod
    def _complete_values(cls, values: Any) -> Any:
        """Fields of a study from a file's values."""
        return fields_from_file(values)

    @classmethod
    def _values_in_units(cls, values: Any) -> tuple[Any, list[Problem]]:
        """Values of a study as plain numbers, and problems."""
        values, problems = super()._values_in_units(values)
        units = {str(node_value(factor, "name")): factor_unit(factor) for factor in node_list(values, "factors")}
        constraints = list(node_list(values, "constraints"))
        for i, constraint in enumerate(constraints):
            require = node_value(constraint, "require")
            if isinstance(constraint, Mapping) and isinstance(require, str):
                text, complaint = condition_without_units(require, units)
                constraints[i] = {**constraint, "require": text}
                if complaint:
                    problems.append(Problem(("constraints", i, "require"), require, complaint))
        return ({**values, "constraints": constraints} if constraints else values), problems

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        """Problems of a study's tables with each other."""
        if complaint := factor_count_complaint(node):
            yield Problem(("factors",), None, complaint, BARE)
            return
        yield from factor_name_rules(node)
        yield from adjustment_rules(node)
        yield from expression_rules(node)
        yield from design_rules(node)
        yield from fatigue_rules(node)
        yield from objective_rules(node)
        yield from noise_table_rules(node)
        yield from calibration_rules(node)


def loads_study(text: str, source: str = "<text>") -> Study:
    """Study read from TOML text.

    Raises:
        StudyError: a line for each error of the text.
    """
    try:
        values = drive_toml.parse_toml(text, source)
    except DriveError as error:
        raise StudyError(str(error)) from None
    if complaint := factor_count_complaint(values):  # before each of them is read
        raise StudyError(f"{source}: factors: {complaint}")
    try:
        study = Study(**values)
        factors = tuple(factor_with_sample(factor, Path(source).parent) for factor in study.factors)
        return study if factors == study.factors else study.model_copy(update={"factors": factors})
    except DriveError as error:
        raise StudyError("\n".join(f"{source}: {line}" for line in error.errors)) from None


def load_study(path: str | os.PathLike[str]) -> Study:
    """Study read from a file (TOML, UTF-8).

    Raises:
        StudyError: if it cannot be read, or a line for each of its errors.
    """
    return loads_study(read_text_file(path, "TOML", lambda reason: StudyError(f"{path}: {reason}")), str(path))


def study_schema() -> dict[str, Any]:
    """JSON schema of study files."""
    schema = file_schema(Study, "warpchain study file")
    bounds, limits = schema["properties"].pop("bounds"), schema["properties"]["limits"]
    table = {"$ref": limits.pop("$ref")}
    entries = {"type": "array", "items": {"anyOf": [bounds["items"], table]}}
    schema["properties"]["limits"] = limits | {"anyOf": [table, entries]}
    adjust = schema["properties"]["adjust"]
    array = {key: adjust.pop(key) for key in ("type", "items")}
    adjust["anyOf"] = [array["items"], array]
    return schema


def dumps_study(study: Study) -> str:
    """TOML text of a study, which `loads_study` reads back equal."""
    return drive_toml.toml_text(file_from_fields(_plain_values(study)))


def _plain_values(value: Any) -> Any:
    """Values of a study's part, without empty tables."""
    if isinstance(value, Part):
        fields = type(value).model_fields
        inner = {name: _plain_values(getattr(value, name)) for name in fields}
        said = {name for name, field in fields.items() if field.default != () and inner[name] == []}
        return {name: part for name, part in inner.items() if name in said or part not in (None, [], {})}
    return [_plain_values(part) for part in value] if isinstance(value, tuple) else value


def check_base_drive(study: Study, drive: Drive, source: str) -> None:
    """Raises StudyError if a study does not fit its drive."""
    lines = []
    for factor in study.factors:
        for key, path in [*factor.target_paths(), *([("shift", factor.shift)] if factor.shift else [])]:
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
            given = (
                getattr(study.run, path.removeprefix("run."))
                if path in ("run.step", "run.duration", "run.start")
                else None
            )
            if given is not None:
                lines.append(
                    f'{path} = {drive_toml.value_text(given)}: not together with factor "{factor.name}", which sets it'
                )
    named = named_adjustments(study.adjust)
    wrong = [line for key, _, adjust in named for line in _adjustment_complaints(key, adjust, drive)]
    lines += wrong or [line for k in range(len(named)) for line in _order_complaints(named[: k + 1], drive)]
    if lines:
        raise StudyError("\n".join(f"{source}: {line}" for line in lines))


def _adjustment_complaints(key: str, adjust: Adjust, drive: Drive) -> list[str]:
    """Complaints about sprocket and chain of an adjustment."""
    of = {sprocket.name: sprocket.chain for sprocket in drive.sprockets}
    chains, chain = [chain.name for chain in drive.chains], adjust.chain
    if adjust.sprocket is not None and adjust.sprocket not in of:
        known = ", ".join(of)
        return [f"{key}.sprocket = {drive_toml.value_text(adjust.sprocket)}: must be a sprocket of the drive: {known}"]
    if chain is None:
        named = adjust.sprocket is not None or not chains
        return [] if named else [f"{key}.chain: missing; must be a chain of the drive: {', '.join(chains)}"]
    said = f"{key}.chain = {drive_toml.value_text(chain)}"
    if chain not in chains:
        known = f"a chain of the drive: {', '.join(chains)}"
        return [f"{said}: must be {known}" if chains else f"{said}: must not be given where there is one chain"]
    if adjust.sprocket is not None and of[adjust.sprocket] != chain:
        return [f'{said}: must be that of the sprocket, "{of[adjust.sprocket]}"']
    return []


def _order_complaints(named: Sequence[tuple[str, str, Adjust]], drive: Drive) -> list[str]:
    """Complaints about adjustments that undo earlier ones."""
    *earlier, (key, _, adjust) = named
    shafts = [shaft_of_sprocket(sprocket) for sprocket in drive.sprockets if sprocket.name == adjust.sprocket]
    moved = [sprocket for sprocket in drive.sprockets if shaft_of_sprocket(sprocket) in shafts]
    said = f"{key}.sprocket = {drive_toml.value_text(adjust.sprocket)}: moves"
    for before, _, other in earlier:
        if other.chain in (None, adjust.chain):
            continue  # a rule of the study says so
        if other.sprocket in [sprocket.name for sprocket in moved]:
            return [f'{said} shaft "{moved[0].shaft}", which {before} moves already']
        if other.chain in [sprocket.chain for sprocket in moved]:
            return [f'{said} a sprocket of chain "{other.chain}", which {before} has adjusted; put it before {before}']
    return []
