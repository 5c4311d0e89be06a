"""A factor of a study: where it goes in the drive, and which values it takes."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field

from warpchain.drive.part import BARE, Finite, Part, Positive, Problem, Switch, Text, Value, allowed, get, numbers
from warpchain.study.columns import BOOKKEEPING
from warpchain.study.spec.expression import RESERVED

TAKEN = frozenset(RESERVED) | frozenset(BOOKKEEPING) | {"shard", "and", "or", "not"}
"""Words that no factor can be called."""
_IDENTIFIER = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
NAME_TEXT = "must be a word of letters, digits and underscores that is no function, constant or column of the results"


def _check_word(value: str) -> str:
    if not _IDENTIFIER.fullmatch(value) or value in TAKEN:
        raise ValueError("not a word")
    return value


def _plain(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


def _distinct(values: tuple[Any, ...]) -> tuple[Any, ...]:
    if len(set(values)) < max(2, len(values)):
        raise ValueError("not distinct")
    return values


def _one_kind(values: tuple[Any, ...]) -> tuple[Any, ...]:
    kinds = {
        float if isinstance(value, (int, float)) and not isinstance(value, bool) else type(value) for value in values
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
    BeforeValidator(_plain),
    Value("must be a list of at least 2 different finite numbers"),
]
Scalars = Annotated[
    tuple[_Scalar, ...],
    AfterValidator(_one_kind),
    BeforeValidator(_plain),
    Value("must be a list of at least 2 different values of one kind: numbers, texts or true and false"),
]
Texts = Annotated[
    tuple[Annotated[str, Field(strict=True, min_length=1)], ...],
    BeforeValidator(_plain),
    Value("must be a list of texts that are not empty"),
]
Range = Annotated[
    tuple[_Number, _Number], BeforeValidator(_plain), Value("must be two finite numbers [low, high], low below high")
]
Distribution = Annotated[
    Literal["uniform", "log-uniform", "normal", "truncated-normal"],
    Value('must be "uniform", "log-uniform", "normal" or "truncated-normal"'),
]
Points = Annotated[int, Field(strict=True, ge=2, le=100_000), Value("must be an integer of at least 2")]

NEEDS = {
    "uniform": ("range",),
    "log-uniform": ("range",),
    "normal": ("mean", "std"),
    "truncated-normal": ("mean", "std", "range"),
}
"""The keys that each distribution takes."""


class Factor(Part):
    """What varies, and how.

    Exactly one of these says which values: a distribution (its default is uniform over `range`), `levels`, `choice` or
    `expression`; none does where the design is a table.

    Attributes:
        name: its column in the results, and its name in expressions.
        path: key path into the drive, such as "sprockets.camshaft.load.torque".
        paths: key paths that all take the same value, instead of `path`; neither for a quantity that only expressions
            use.
        distribution: "uniform", "log-uniform", "normal" or "truncated-normal".
        range: (low, high): the ends of a distribution, or of a grid.
        mean, std: of a normal distribution.
        levels: numbers in the order of a grid.
        choice: numbers, texts or switches without an order.
        expression: arithmetic of other factors.
        integer: whether values are rounded to whole numbers; of a uniform range, each is as likely.
        points: number of grid points between the ends of the range, for a full factorial design.
        group: factors of one group vary together, as one dimension of the design.
        unit: for tables and figures.
    """

    name: Word
    path: Text | None = None
    paths: Texts = ()
    distribution: Distribution | None = None
    range: Range | None = None
    mean: Finite | None = None
    std: Positive | None = None
    levels: Numbers | None = None
    choice: Scalars | None = None
    expression: Text | None = None
    integer: Switch = False
    points: Points | None = None
    group: Text | None = None
    unit: Text | None = None

    @property
    def kind(self) -> str | None:
        """The distribution's name, "levels", "choice" or "expression"; None if a table gives the values."""
        return kind_of(self)

    @property
    def values(self) -> tuple[Any, ...] | None:
        """The values of levels or a choice."""
        return self.levels if self.levels is not None else self.choice

    def targets(self) -> Iterator[tuple[str, str]]:
        """(key, path) of each place in the drive that the factor sets."""
        if self.path is not None:
            yield "path", self.path
        yield from ((f"paths.{i}", path) for i, path in enumerate(self.paths))

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        if get(node, "path") is not None and get(node, "paths"):
            yield Problem(("paths",), get(node, "paths"), "not together with path; give one of the two")
        yield from _kind_rules(cls, node)
        ends = get(node, "range")
        if isinstance(ends, (list, tuple)) and len(ends) == 2 and numbers(*ends):
            if ends[0] >= ends[1]:
                yield Problem(("range",), ends, "must be two finite numbers [low, high], low below high")
            elif get(node, "distribution") == "log-uniform" and ends[0] <= 0:
                yield Problem(("range",), ends, "must be two positive numbers with a log-uniform distribution")


def kind_of(node: Any) -> str | None:
    """What gives a factor's values (see `Factor.kind`), also of a mapping that should become one."""
    for key in ("expression", "levels", "choice"):
        if get(node, key) is not None:
            return key
    given = get(node, "distribution")
    if given is not None:
        return str(given)
    return "uniform" if get(node, "range") is not None else None


def _kind_rules(cls: type[Part], node: Any) -> Iterator[Problem]:
    """Each kind of factor takes its own keys."""
    kind = kind_of(node)
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
        elif key not in needed and given is not None:
            text = f'not with distribution "{kind}"' if kind else 'needs distribution "normal" or "truncated-normal"'
            yield Problem((key,), given, text)
