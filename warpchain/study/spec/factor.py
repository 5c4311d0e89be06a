"""A factor of a study: where it goes in the drive, and which values it takes."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, BeforeValidator, Field

from warpchain.drive import Drive
from warpchain.drive.path_units import path_unit
from warpchain.drive.quantities import unit
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
    allowed,
    elements,
    get,
    numbers,
    plain_sequence,
)
from warpchain.study.results import BOOKKEEPING_COLUMNS
from warpchain.study.spec.expression import RESERVED

TAKEN = frozenset(RESERVED) | frozenset(BOOKKEEPING_COLUMNS) | {"shard", "and", "or", "not"}
"""Words that no factor can be called."""
_IDENTIFIER = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
AUTO = "auto"
"""The text that may be among numbers of a choice: an automatic step."""
NAME_TEXT = "must be a word of letters, digits and underscores that is no function, constant or column of the results"


def _check_word(value: str) -> str:
    if not _IDENTIFIER.fullmatch(value) or value in TAKEN:
        raise ValueError("not a word")
    return value


def _distinct(values: tuple[Any, ...]) -> tuple[Any, ...]:
    if len(set(values)) < max(2, len(values)):
        raise ValueError("not distinct")
    return values


def _one_kind(values: tuple[Any, ...]) -> tuple[Any, ...]:
    kinds = {
        float if isinstance(value, (int, float)) and not isinstance(value, bool) else type(value)
        for value in values
        if value != AUTO
    }
    if len(kinds) > 1:
        raise ValueError("of several kinds")
    return _distinct(values)


_Number = Annotated[int, Field(strict=True)] | Annotated[float, Field(strict=True, allow_inf_nan=False)]
_Scalar = Annotated[bool, Field(strict=True)] | _Number | Annotated[str, Field(strict=True)]

Word = Annotated[str, Field(strict=True), AfterValidator(_check_word), Value(NAME_TEXT)]
Numbers = Annotated[
    tuple[_Number, ...],
    AfterValidator(_distinct),
    BeforeValidator(plain_sequence),
    Value("must be a list of at least 2 different finite numbers"),
]
Scalars = Annotated[
    tuple[_Scalar, ...],
    AfterValidator(_one_kind),
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
Along = Annotated[Literal["normal"] | Direction, Value('must be "normal", or two finite numbers [x, y], not both 0')]
Whole = Annotated[int, Field(strict=True, ge=0), Value("must be an integer of at least 0")]
Points = Annotated[int, Field(strict=True, ge=2, le=100_000), Value("must be an integer from 2 to 100000")]

NEEDS = {
    "uniform": ("range",),
    "log-uniform": ("range",),
    "normal": ("mean", "std"),
    "truncated-normal": ("mean", "std", "range"),
    "lognormal": ("mean", "std"),
    "empirical": (),
}
"""The keys that each distribution takes."""


class Factor(Part):
    """A factor of a study: a quantity that varies, and its values.

    Exactly one of these says which values: a distribution (its default is uniform over `range`), `levels`, `choice` or
    `expression`; none does where the design is a table.

    Attributes:
        name: its column in the results, and its name in expressions.
        path: key path into the drive, such as "sprockets.camshaft.load.torque".
        paths: key paths that all take the same value, instead of `path`; neither for a quantity that only expressions
            use.
        shift: key path of a guide-bar or a sprocket that the factor moves by its value [m], such as "guides.upper".
        along: direction in which it moves; "normal" is a guide-bar's, towards the chain (default).
        relative: the value multiplies the drive's own.
        offset: the value is added to the drive's own.
        hidden: varied, but no factor of the results: what it does is scatter.
        kind: "design", what an engineer chooses (default), or "noise", what nobody can: designs are compared over it.
        distribution: "uniform", "log-uniform", "normal", "truncated-normal", "lognormal" or "empirical".
        range: (low, high): the ends of a distribution, or of a grid.
        mean, std: those of a normal distribution, or a lognormal one (of the value, not of its logarithm).
        sample: numbers that were measured, each as likely, of an empirical distribution.
        file, column: a CSV or Parquet file, relative to the study file, and its column that holds them instead.
        levels: numbers in the order of a grid.
        choice: numbers, texts or switches without an order.
        expression: arithmetic of other factors.
        integer: whether values are rounded to whole numbers; of a uniform range, each is as likely.
        points: number of grid points between the ends of the range, for a full factorial design.
        group: factors of one group vary together, as one dimension of the design.
        unit: unit of the values, for tables and figures; None is that of the path.
    """

    _quantities: ClassVar[frozenset[str]] = frozenset({"range", "mean", "std", "sample", "levels", "choice"})

    name: Word
    path: Text | None = None
    paths: Texts = ()
    shift: Text | None = None
    along: Along | None = None
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
    levels: Numbers | None = None
    choice: Scalars | None = None
    expression: Text | None = None
    integer: Switch = False
    points: Points | None = None
    group: Text | None = None
    unit: Text | None = None

    @property
    def shown_unit(self) -> str:
        """The unit that tables and figures show, "" for none."""
        return self.unit or _own_unit(self)

    @classmethod
    def _unit(cls, key: str, values: Mapping[str, Any]) -> str:
        if key not in cls._quantities:
            return ""
        return values_unit(values) or ("-" if get(values, "relative") is True else "")

    @property
    def form(self) -> str | None:
        """The distribution's name, "levels", "choice" or "expression"; None if a table gives the values."""
        return form_of(self)

    @property
    def values(self) -> tuple[Any, ...] | None:
        """The values of levels or a choice."""
        return self.levels if self.levels is not None else self.choice

    def cells(self, values: Iterable[Any]) -> list[Any]:
        """Values as a column of a table holds them: of a choice of numbers and "auto", as texts."""
        return [str(value) for value in values] if self._mixed else list(values)

    def value_of(self, cell: Any) -> Any:
        """The value behind a cell of that column."""
        return {str(value): value for value in self.choice or ()}.get(cell, cell) if self._mixed else cell

    @property
    def _mixed(self) -> bool:
        return self.choice is not None and AUTO in self.choice and not all(isinstance(v, str) for v in self.choice)

    def targets(self) -> Iterator[tuple[str, str]]:
        """(key, path) of each place in the drive that the factor sets."""
        if self.path is not None:
            yield "path", self.path
        yield from ((f"paths.{i}", path) for i, path in enumerate(self.paths))

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        if get(node, "path") is not None and get(node, "paths"):
            yield Problem(("paths",), get(node, "paths"), "not together with path; give one of the two")
        own, given = _own_unit(node), get(node, "unit")
        if own and isinstance(given, str) and unit(given) != unit(own):
            text = f'the values are in {own}: leave it out; values may have units of their own, such as "1 {own}"'
            yield Problem(("unit",), given, text)
        yield from _place_rules(node)
        yield from _form_rules(cls, node)
        yield from _noise_rules(node)
        yield from _sample_rules(node)
        ends = get(node, "range")
        if isinstance(ends, (list, tuple)) and len(ends) == 2 and numbers(*ends):
            if ends[0] >= ends[1]:
                yield Problem(("range",), ends, "must be two finite numbers [low, high], low below high")
            elif get(node, "distribution") == "log-uniform" and ends[0] <= 0:
                yield Problem(("range",), ends, "must be two positive numbers with a log-uniform distribution")


def _own_unit(node: Any) -> str:
    """The unit of a factor's values by what it sets; "" where that has none, or not all of it has the same."""
    if get(node, "shift") is not None:
        return "m"
    paths = [path for path in (get(node, "path"), *elements(node, "paths")) if isinstance(path, str)]
    units = {path_unit(Drive, path) for path in paths}
    return units.pop() if len(units) == 1 and get(node, "relative") is not True else ""


def values_unit(node: Any) -> str:
    """The unit of a factor's values, by what it sets or else by what it says; "" for none that has quantities."""
    given = get(node, "unit")
    return _own_unit(node) or (given if isinstance(given, str) and unit(given) else "")


def form_of(node: Any) -> str | None:
    """The source of a factor's values (see `Factor.form`), also of a mapping that should become one."""
    for key in ("expression", "levels", "choice"):
        if get(node, key) is not None:
            return key
    given = get(node, "distribution")
    if given is not None:
        return str(given)
    return "uniform" if get(node, "range") is not None else None


def _place_rules(node: Any) -> Iterator[Problem]:
    """A factor sets, scales, offsets or shifts one thing."""
    shift, placed = get(node, "shift"), get(node, "path") is not None or bool(get(node, "paths"))
    if shift is not None and placed:
        yield Problem(("shift",), shift, "not together with path; give one of the two")
    if isinstance(shift, str) and not (shift.count(".") == 1 and shift.startswith(("guides.", "sprockets."))):
        yield Problem(("shift",), shift, 'must be a guide-bar or a sprocket, such as "guides.upper"')
    if get(node, "along") is not None and shift is None:
        yield Problem(("along",), get(node, "along"), "only together with shift")
    if isinstance(shift, str) and shift.startswith("sprockets.") and get(node, "along") in (None, "normal"):
        yield Problem(("along",), get(node, "along"), "must be two numbers [x, y]: a sprocket has no normal", BARE)
    if get(node, "relative") is True and get(node, "offset") is True:
        yield Problem(("offset",), True, "not together with relative; give one of the two")
    for key in ("relative", "offset"):
        if get(node, key) is True and not placed:
            yield Problem((key,), True, "only together with path or paths")
        if get(node, key) is True and any(isinstance(v, (str, bool)) for v in elements(node, "choice")):
            yield Problem((key,), True, "needs numbers as choice")


def _form_rules(cls: type[Part], node: Any) -> Iterator[Problem]:
    """Each form of factor takes its own keys."""
    kind = form_of(node)
    if kind in ("expression", "levels", "choice"):
        for key in ("levels", "choice", "distribution", "range", "mean", "std", "points"):
            if key != kind and get(node, key) is not None:
                yield Problem((key,), get(node, key), f"not together with {kind}")
        if kind != "expression" and get(node, "integer") is True:
            yield Problem(("integer",), True, f"not together with {kind}, whose values are given")
        if kind == "expression" and get(node, "group") is not None:
            yield Problem(("group",), get(node, "group"), "not together with expression")
        return
    needed = NEEDS.get(kind or "", ())
    for key in ("range", "mean", "std"):
        given = get(node, key)
        if kind in NEEDS and key in needed and given is None:
            yield Problem((key,), None, f'missing; {allowed(cls, key)}; needed with distribution "{kind}"', BARE)
        elif key == "mean" and kind == "lognormal" and numbers(given) and given <= 0:
            yield Problem((key,), given, "must be a positive number with a lognormal distribution")
        elif key not in needed and given is not None:
            text = f'not with distribution "{kind}"' if kind else 'needs distribution "normal" or "truncated-normal"'
            yield Problem((key,), given, text)


def _noise_rules(node: Any) -> Iterator[Problem]:
    """Noise has a distribution of its own."""
    if get(node, "kind") != "noise":
        return
    for key in ("expression", "points"):
        if get(node, key) is not None:
            yield Problem((key,), get(node, key), 'not with kind "noise"')
    if get(node, "hidden") is True:
        yield Problem(("hidden",), True, 'not with kind "noise"')
    if form_of(node) is None:
        text = 'missing; needed with kind "noise": give range, a distribution, levels or choice'
        yield Problem(("distribution",), None, text, BARE)


def _sample_rules(node: Any) -> Iterator[Problem]:
    """An empirical distribution has a sample, or a file and a column that hold it."""
    sample, file, column = (get(node, key) for key in ("sample", "file", "column"))
    if form_of(node) != "empirical":
        for key in ("sample", "file", "column"):
            if get(node, key) is not None:
                yield Problem((key,), get(node, key), 'only with distribution "empirical"')
    elif sample is None and file is None:
        yield Problem(("sample",), None, "missing; give sample, or file and column", BARE)
    elif sample is not None and (file is not None or column is not None):
        yield Problem(("sample",), sample, "not together with file or column")
    elif sample is None and column is None:
        yield Problem(("column",), None, "missing; the column of the file that holds the sample", BARE)
