"""What is wanted of a study: objectives, limits on metrics, and how `warpchain optimize` looks for it.

A study file's `limits` is a table, what a variant may come to and still be ok, or a list: entries with `metric` are
limits on metrics (`Study.bounds`), the others together are that table.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import Field

from warpchain.drive.part import BARE, Finite, Part, Problem, Text, Value, elements, get, numbers

ENGINES = ("bayes", "population")
_Few = Annotated[int, Field(strict=True, ge=1, le=1_000_000), Value("must be an integer from 1 to 1000000")]
_Seed = Annotated[int, Field(strict=True, ge=0), Value("must be an integer of at least 0")]


class Objective(Part):
    """What should be small or large.

    Attributes:
        metric: a metric, or a factor.
        sense: "min" or "max".
    """

    metric: Text
    sense: Annotated[Literal["min", "max"], Value('must be "min" or "max"')] = "min"


class Bound(Part):
    """What a metric must keep to; at least one of both ends.

    Attributes:
        metric: a metric.
        min, max: in its unit.
    """

    metric: Text
    min: Finite | None = None
    max: Finite | None = None

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        low, high = get(node, "min"), get(node, "max")
        if low is None and high is None:
            yield Problem(("max",), None, "missing; must be a finite number; give max, min or both", BARE)
        if numbers(low, high) and low >= high:
            yield Problem(("max",), high, f"must be above min, which is {low:g}")


class Search(Part):
    """How `warpchain optimize` looks for designs.

    Attributes:
        engine: "bayes", few costly runs, or "population", many at once.
        count: rows in all, those of the design among them; the last round is run whole.
        batch: rows of a round, or of a generation.
        seed: of everything that is drawn.
        recommend: most designs that are recommended.
    """

    engine: Annotated[Literal[*ENGINES], Value('must be "bayes" or "population"')] = "bayes"  # type: ignore[valid-type]
    count: _Few = 64
    batch: _Few = 8
    seed: _Seed = 0
    recommend: _Few = 4


_OF_BOUNDS = ("metric", "min", "max")


def _is_bound(entry: Any) -> bool:
    return not isinstance(entry, Mapping) or any(key in entry for key in _OF_BOUNDS)


def split_limits(values: Any) -> Any:
    """A study's values with a list of limits as `bounds` and, of what is left, the table `limits`."""
    limits = values.get("limits") if isinstance(values, Mapping) else None
    if not isinstance(limits, (list, tuple)):
        return values
    judged: dict[str, Any] = {}
    for entry in limits:
        if not _is_bound(entry):
            judged |= entry
    return {**values, "bounds": tuple(entry for entry in limits if _is_bound(entry)), "limits": judged}


def joined_limits(values: dict[str, Any]) -> dict[str, Any]:
    """The other way round, for a file."""
    if not values.get("bounds"):
        return values
    rest = {key: value for key, value in values.items() if key != "bounds"}
    judged = values.get("limits") or {}
    return rest | {"limits": (*values["bounds"], *((judged,) if judged else ()))}


def as_written(line: str, values: Any) -> str:
    """An error line about `bounds.K` as one about the entry of the file's list `limits`."""
    limits = values.get("limits") if isinstance(values, Mapping) else None
    if isinstance(limits, list) and line.startswith("bounds."):
        number, dot, rest = line.removeprefix("bounds.").partition(".")
        places = [i for i, entry in enumerate(limits) if _is_bound(entry)]
        if number.isdecimal() and int(number) < len(places):
            return f"limits.{places[int(number)]}{dot}{rest}"
    return line


def objective_rules(node: Any) -> Iterator[Problem]:
    """No metric is wanted twice, and limits and a search need something that is wanted."""
    for key in ("objectives", "bounds"):
        names: set[Any] = set()
        for i, entry in enumerate(elements(node, key)):
            name = get(entry, "metric")
            if name in names and isinstance(name, str):
                yield Problem((key, i, "metric"), name, f"must be unique among {key}")
            names.add(name)
    if get(node, "optimize") is not None and not elements(node, "objectives"):
        yield Problem(("optimize",), None, "needs at least one entry of objectives", BARE)
