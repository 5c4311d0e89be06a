"""Factor of a study: the places in the drive that it sets, and its values."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, BeforeValidator, Field

from warpchain.drive import Drive
from warpchain.drive.path_units import path_unit
from warpchain.drive.quantities import unit_from_text
from warpchain.drive.schema import (
    BARE,
    Direction,
    Finite,
    Part,
    Positive,
    Problem,
    Switch,
    Text,
    Value,
    allowed_text,
    are_numbers,
    node_list,
    node_value,
    plain_sequence,
)
from warpchain.study.results import BOOKKEEPING_COLUMNS
from warpchain.study.spec.expression import RESERVED_NAMES

FORBIDDEN_NAMES = frozenset(RESERVED_NAMES) | frozenset(BOOKKEEPING_COLUMNS) | {"shard", "and", "or", "not"}
_IDENTIFIER = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
AUTO_STEP = "auto"
NAME_HELP = "must be a word of letters, digits and underscores that is no function, constant or column of the results"


def _check_factor_name(value: str) -> str:
    """Factor name; raises for no identifier or a taken one."""
    if not _IDENTIFIER.fullmatch(value) or value in FORBIDDEN_NAMES:
        raise ValueError("not a word")
    return value


def _check_distinct(values: tuple[Any, ...]) -> tuple[Any, ...]:
    """Factor values; raises unless two or more and distinct."""
    if len(set(values)) < max(2, len(values)):
        raise ValueError("not distinct")
    return values


def _check_one_type(values: tuple[Any, ...]) -> tuple[Any, ...]:
    """Factor values; raises if repeated or of several types."""
    kinds = {
        float if isinstance(value, (int, float)) and not isinstance(value, bool) else type(value)
        for value in values
        if value != AUTO_STEP
    }
    if len(kinds) > 1:
        raise ValueError("of several kinds")
    return _check_distinct(values)


_Number = Annotated[int, Field(strict=True)] | Annotated[float, Field(strict=True, allow_inf_nan=False)]
_Scalar = Annotated[bool, Field(strict=True)] | _Number | Annotated[str, Field(strict=True)]

FactorName = Annotated[str, Field(strict=True), AfterValidator(_check_factor_name), Value(NAME_HELP)]
DistinctNumbers = Annotated[
    tuple[_Number, ...],
    AfterValidator(_check_distinct),
    BeforeValidator(plain_sequence),
    Value("must be a list of at least 2 different finite numbers"),
]
DistinctChoices = Annotated[
    tuple[_Scalar, ...],
    AfterValidator(_check_one_type),
    BeforeValidator(plain_sequence),
    Value('must be a list of at least 2 different values of one kind: numbers (with "auto"), texts or true and false'),
]
Texts = Annotated[
    tuple[Annotated[str, Field(strict=True, min_length=1)], ...],
    BeforeValidator(plain_sequence),
    Value("must be a list of texts that are not empty"),
]
Sample = Annotated[
    tuple[_Number, ...],
    Field(min_length=2),
    BeforeValidator(plain_sequence),
    Value("must be a list of at least 2 finite numbers"),
]
Range = Annotated[
    tuple[_Number, _Number],
    BeforeValidator(plain_sequence),
    Value("must be two finite numbers [low, high], low below high"),
]
Distribution = Annotated[
    Literal["uniform", "log-uniform", "normal", "truncated-normal", "lognormal", "empirical"],
    Value('must be "uniform", "log-uniform", "normal", "truncated-normal", "lognormal" or "empirical"'),
]
ShiftDirection = Annotated[
    Literal["normal"] | Direction, Value('must be "normal", or two finite numbers [x, y], not both 0')
]
WholeNumber = Annotated[int, Field(strict=True, ge=0), Value("must be an integer of at least 0")]
GridPoints = Annotated[int, Field(strict=True, ge=2, le=100_000), Value("must be an integer from 2 to 100000")]

DISTRIBUTION_KEYS = {
    "uniform": ("range",),
    "log-uniform": ("range",),
    "normal": ("mean", "std"),
    "truncated-normal": ("mean", "std", "range"),
    "lognormal": ("mean", "std"),
    "empirical": (),
}


class Factor(Part):
    """A factor of a study: a quantity that varies, and its values.

    Exactly one of these says which values: a distribution (its default is uniform over `range`), `levels`, `choice` or
    `expression`; none does where the design is a table.

    Attributes:
        name: its column in the results, and its name in expressions.
        path: key path into the drive, such as "sprockets.camshaft.load.torque".
        paths: key paths that all take the value, instead of `path`; neither for a quantity that only expressions use.
        shift: key path of a guide-bar or sprocket that is moved by the value [m], such as "guides.upper".
        along: direction of the shift; "normal" is a guide-bar's, towards the chain (default).
        relative: the value multiplies the drive's own.
        offset: the value is added to the drive's own.
        hidden: varied, but no factor of the results: what it does is scatter.
        kind: "design", what an engineer chooses (default), or "noise", what nobody can: designs are compared over it.
        distribution: "uniform", "log-uniform", "normal", "truncated-normal", "lognormal" or "empirical".
        range: (low, high): the ends of a distribution, or of a grid.
        mean, std: those of a normal or lognormal distribution (of the value, not of its logarithm).
        sample: measured numbers of an empirical distribution, each as likely.
        file, column: a CSV or Parquet file, relative to the study file, and its column that holds them instead.
        levels: numbers in the order of a grid.
        choice: numbers, texts or switches without an order.
        expression: arithmetic of other factors.
        integer: whether values are rounded to whole numbers; of a uniform range, each is as likely.
        points: number of grid points between the range's ends, for a full factorial design.
        group: factors of one group vary together, as one dimension of the design.
        unit: unit of the values in tables and figures; None is that of the path.
    """

    _quantities: ClassVar[frozenset[str]] = frozenset({"range", "mean", "std", "sample", "levels", "choice"})

    name: FactorName
    path: Text | None = None
    paths: Texts = ()
    shift: Text | None = None
    along: ShiftDirection | None = None
    relative: Switch = False
    offset: Switch = False
    hidden: Switch = False
    kind: Annotated[Literal["design", "noise"], Value('must be "design" or "noise"')] | None = None
    distribution: Distribution | None = None
    range: Range | None = None
    mean: Finite | None = None
    std: Positive | None = None
    sample: Sample | None = None
    file: Text | None = None
    column: Text | None = None
    levels: DistinctNumbers | None = None
    choice: DistinctChoices | None = None
    expression: Text | None = None
    integer: Switch = False
    points: GridPoints | None = None
    group: Text | None = None
    unit: Text | None = None

    @property
    def display_unit(self) -> str:
        """Unit of the factor's values in tables and figures."""
        return self.unit or _target_unit(self)

    @classmethod
    def _unit(cls, key: str, values: Mapping[str, Any]) -> str:
        """Unit of a number in a factor's key."""
        if key not in cls._quantities:
            return ""
        return factor_unit(values) or ("-" if node_value(values, "relative") is True else "")

    @property
    def value_source(self) -> str | None:
        """Source of the factor's values, such as "levels"."""
        return value_source_of(self)

    @property
    def listed_values(self) -> tuple[Any, ...] | None:
        """Levels or choices of the factor, or None."""
        return self.levels if self.levels is not None else self.choice

    def cells_from_values(self, values: Iterable[Any]) -> list[Any]:
        """Table cells of the factor's values."""
        return [str(value) for value in values] if self._has_auto_step else list(values)

    def value_from_cell(self, cell: Any) -> Any:
        """Value of the factor from a table's cell."""
        return {str(value): value for value in self.choice or ()}.get(cell, cell) if self._has_auto_step else cell

    @property
    def _has_auto_step(self) -> bool:
        """Whether the factor's choice has numbers and "auto"."""
        return self.choice is not None and AUTO_STEP in self.choice and not all(isinstance(v, str) for v in self.choice)

    def target_paths(self) -> Iterator[tuple[str, str]]:
        """Keys and paths of drive values that the factor sets."""
        if self.path is not None:
            yield "path", self.path
        yield from ((f"paths.{i}", path) for i, path in enumerate(self.paths))

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        """Problems of a factor's keys."""
        if node_value(node, "path") is not None and node_value(node, "paths"):
            yield Problem(("paths",), node_value(node, "paths"), "not together with path; give one of the two")
        own, given = _target_unit(node), node_value(node, "unit")
        if own and isinstance(given, str) and unit_from_text(given) != unit_from_text(own):
            text = f'the values are in {own}: leave it out; values may have units of their own, such as "1 {own}"'
            yield Problem(("unit",), given, text)
        yield from _target_rules(node)
        yield from _value_source_rules(cls, node)
        yield from _noise_factor_rules(node)
        yield from _sample_rules(node)
        ends = node_value(node, "range")
        if isinstance(ends, (list, tuple)) and len(ends) == 2 and are_numbers(*ends):
            if ends[0] >= ends[1]:
                yield Problem(("range",), ends, "must be two finite numbers [low, high], low below high")
            elif node_value(node, "distribution") == "log-uniform" and ends[0] <= 0:
                yield Problem(("range",), ends, "must be two positive numbers with a log-uniform distribution")


def _target_unit(node: Any) -> str:
    """Unit of what a factor sets, or ""."""
    if node_value(node, "shift") is not None:
        return "m"
    paths = [path for path in (node_value(node, "path"), *node_list(node, "paths")) if isinstance(path, str)]
    units = {path_unit(Drive, path) for path in paths}
    return units.pop() if len(units) == 1 and node_value(node, "relative") is not True else ""


def factor_unit(node: Any) -> str:
    """Unit of a factor's values, or ""."""
    given = node_value(node, "unit")
    return _target_unit(node) or (given if isinstance(given, str) and unit_from_text(given) else "")


def value_source_of(node: Any) -> str | None:
    """Source of values of a factor or mapping."""
    for key in ("expression", "levels", "choice"):
        if node_value(node, key) is not None:
            return key
    given = node_value(node, "distribution")
    if given is not None:
        return str(given)
    return "uniform" if node_value(node, "range") is not None else None


def _target_rules(node: Any) -> Iterator[Problem]:
    """Problems of a factor's targets in the drive."""
    shift, placed = node_value(node, "shift"), node_value(node, "path") is not None or bool(node_value(node, "paths"))
    if shift is not None and placed:
        yield Problem(("shift",), shift, "not together with path; give one of the two")
    if isinstance(shift, str) and not (shift.count(".") == 1 and shift.startswith(("guides.", "sprockets."))):
        yield Problem(("shift",), shift, 'must be a guide-bar or a sprocket, such as "guides.upper"')
    if node_value(node, "along") is not None and shift is None:
        yield Problem(("along",), node_value(node, "along"), "only together with shift")
    if isinstance(shift, str) and shift.startswith("sprockets.") and node_value(node, "along") in (None, "normal"):
        yield Problem(
            ("along",), node_value(node, "along"), "must be two numbers [x, y]: a sprocket has no normal", BARE
        )
    if node_value(node, "relative") is True and node_value(node, "offset") is True:
        yield Problem(("offset",), True, "not together with relative; give one of the two")
    for key in ("relative", "offset"):
        if node_value(node, key) is True and not placed:
            yield Problem((key,), True, "only together with path or paths")
        if node_value(node, key) is True and any(isinstance(v, (str, bool)) for v in node_list(node, "choice")):
            yield Problem((key,), True, "needs numbers as choice")


def _value_source_rules(cls: type[Part], node: Any) -> Iterator[Problem]:
    """Problems of keys with a factor's source of values."""
    kind = value_source_of(node)
    if kind in ("expression", "levels", "choice"):
        for key in ("levels", "choice", "distribution", "range", "mean", "std", "points"):
            if key != kind and node_value(node, key) is not None:
                yield Problem((key,), node_value(node, key), f"not together with {kind}")
        if kind != "expression" and node_value(node, "integer") is True:
            yield Problem(("integer",), True, f"not together with {kind}, whose values are given")
        if kind == "expression" and node_value(node, "group") is not None:
            yield Problem(("group",), node_value(node, "group"), "not together with expression")
        return
    needed = DISTRIBUTION_KEYS.get(kind or "", ())
    for key in ("range", "mean", "std"):
        given = node_value(node, key)
        if kind in DISTRIBUTION_KEYS and key in needed and given is None:
            yield Problem((key,), None, f'missing; {allowed_text(cls, key)}; needed with distribution "{kind}"', BARE)
        elif key == "mean" and kind == "lognormal" and are_numbers(given) and given <= 0:
            yield Problem((key,), given, "must be a positive number with a lognormal distribution")
        elif key not in needed and given is not None:
            text = f'not with distribution "{kind}"' if kind else 'needs distribution "normal" or "truncated-normal"'
            yield Problem((key,), given, text)


def _noise_factor_rules(node: Any) -> Iterator[Problem]:
    """Problems of a noise factor's values."""
    if node_value(node, "kind") != "noise":
        return
    for key in ("expression", "points"):
        if node_value(node, key) is not None:
            yield Problem((key,), node_value(node, key), 'not with kind "noise"')
    if node_value(node, "hidden") is True:
        yield Problem(("hidden",), True, 'not with kind "noise"')
    if value_source_of(node) is None:
        text = 'missing; needed with kind "noise": give range, a distribution, levels or choice'
        yield Problem(("distribution",), None, text, BARE)


def _sample_rules(node: Any) -> Iterator[Problem]:
    """Problems of an empirical factor's sample, file and column."""
    sample, file, column = (node_value(node, key) for key in ("sample", "file", "column"))
    if value_source_of(node) != "empirical":
        for key in ("sample", "file", "column"):
            if node_value(node, key) is not None:
                yield Problem((key,), node_value(node, key), 'only with distribution "empirical"')
    elif sample is None and file is None:
        yield Problem(("sample",), None, "missing; give sample, or file and column", BARE)
    elif sample is not None and (file is not None or column is not None):
        yield Problem(("sample",), sample, "not together with file or column")
    elif sample is None and column is None:
        yield Problem(("column",), None, "missing; the column of the file that holds the sample", BARE)
