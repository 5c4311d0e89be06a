"""Rules that tie the tables of a study file together.

Each takes the study, or the mapping that should become one if a value somewhere is wrong.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any

from warpchain.drive.part import BARE, Problem, elements, get
from warpchain.errors import StudyError
from warpchain.results.replicates import COPY, COUNT
from warpchain.study.spec.expression import Expression, parse
from warpchain.study.spec.factor import NEEDS, kind_of


def _targets(factor: Any) -> list[str]:
    paths = get(factor, "paths")
    found = [get(factor, "path"), *(paths if isinstance(paths, (list, tuple)) else ())]
    return [path for path in found if isinstance(path, str)]


def fatigue_rules(node: Any) -> Iterator[Problem]:
    """Fatigue takes recorded tensions."""
    record = get(node, "record")
    if get(node, "fatigue") is None:
        return
    if not any(get(record, key) for key in ("variants", "every", "worst")):
        yield Problem(("fatigue",), None, "needs record.variants, record.every or record.worst", BARE)
    channels = get(record, "channels")
    if isinstance(channels, (list, tuple)) and "tension" not in channels:
        yield Problem(("record", "channels"), channels, 'must hold "tension", which fatigue counts')


def name_rules(node: Any) -> Iterator[Problem]:
    """Names are unique, no two factors set the same value, and every factor has a use."""
    factors = elements(node, "factors")
    if get(node, "factors") is not None and not factors:
        yield Problem(("factors",), get(node, "factors"), "must be a list of at least 1 factor")
    names: set[str] = set()
    taken: dict[str, Any] = {}
    used = {name for _, expression in _expressions(node) for name in expression.names}
    for i, factor in enumerate(factors):
        name = get(factor, "name")
        if not isinstance(name, str):
            continue  # its own rule says so
        if name in names:
            yield Problem(("factors", i, "name"), name, "must be unique among factors")
        if name in (COPY, COUNT) and get(get(node, "design"), "replicates") is not None:
            yield Problem(("factors", i, "name"), name, "is a column of studies with design.replicates")
        names.add(name)
        for path in _targets(factor):
            if path in taken:
                yield Problem(("factors", i, "path"), path, f'is set by factor "{taken[path]}" already')
            taken[path] = name
        if not _targets(factor) and get(factor, "shift") is None and name not in used:
            text = (
                "missing; must be a key path into the drive; needed unless an expression or constraint uses the factor"
            )
            yield Problem(("factors", i, "path"), None, text, BARE)


def _texts(node: Any) -> Iterator[tuple[tuple[str | int, ...], str]]:
    """Key path and text of every expression."""
    for i, factor in enumerate(elements(node, "factors")):
        yield ("factors", i, "expression"), get(factor, "expression")
    for i, constraint in enumerate(elements(node, "constraints")):
        yield ("constraints", i, "require"), get(constraint, "require")
    for key in ("strain", "preload"):
        yield ("adjust", key), get(get(node, "adjust"), key)


def _expressions(node: Any) -> Iterator[tuple[tuple[str | int, ...], Expression]]:
    """Every expression that parses."""
    for path, text in _texts(node):
        if isinstance(text, str):
            try:
                yield path, parse(text)
            except StudyError:
                continue


def expression_rules(node: Any) -> Iterator[Problem]:
    """Expressions are arithmetic of known factors, and none needs itself."""
    factors = [str(get(factor, "name")) for factor in elements(node, "factors")]
    for path, text in _texts(node):
        if not isinstance(text, str):
            continue
        try:
            unknown = [name for name in parse(text).names if name not in factors]
        except StudyError as error:
            yield Problem(path, text, str(error))
            continue
        if unknown:
            known = ", ".join(str(name) for name in factors)
            yield Problem(path, text, f"{unknown[0]} is not a factor; factors are {known}")
    needs = {factors[int(i)]: found.names for (head, i, *_), found in _expressions(node) if head == "factors"}
    for i, (name, factor) in enumerate(zip(factors, elements(node, "factors"), strict=True)):
        if name in needs and name in _reached(name, needs):
            yield Problem(("factors", i, "expression"), get(factor, "expression"), "needs itself")


def _reached(name: str, needs: Mapping[str, tuple[str, ...]]) -> set[str]:
    """All names that an expression's names lead to."""
    reached: set[str] = set()
    front = list(needs[name])
    while front:
        following = front.pop()
        if following not in reached:
            reached.add(following)
            front.extend(needs.get(following, ()))
    return reached


def design_rules(node: Any) -> Iterator[Problem]:
    """The factors' values are such as the design takes, and factors of a group agree."""
    kind = get(get(node, "design"), "kind")
    factors = elements(node, "factors")
    for i, factor in enumerate(factors):
        given = kind_of(factor)
        if given == "expression":
            continue
        if kind == "table":
            if get(factor, "points") is not None:
                yield Problem(("factors", i, "points"), get(factor, "points"), "only in a factorial design")
            continue
        if given is None:
            text = "missing; give range, a distribution, levels, choice or expression"
            yield Problem(("factors", i, "range"), None, text, BARE)
        yield from _grid_rules(i, factor, given, kind)
    yield from _group_rules(factors)


def _grid_rules(i: int, factor: Any, given: str | None, kind: Any) -> Iterator[Problem]:
    values = get(factor, str(given)) if given in ("levels", "choice") else None
    if values is not None and not isinstance(values, (list, tuple)):
        return  # its own rule says so
    points = get(factor, "points")
    if kind == "factorial" and given in NEEDS and points is None:
        text = "missing; must be an integer of at least 2; needed in a factorial design"
        yield Problem(("factors", i, "points"), None, text, BARE)
    if kind != "factorial" and points is not None:
        yield Problem(("factors", i, "points"), points, "only in a factorial design")
    if kind == "central-composite" and values is not None:
        yield Problem(("factors", i, str(given)), values, "a central composite design takes ranges or distributions")
    if kind == "plackett-burman" and values is not None and len(values) != 2:
        yield Problem(("factors", i, str(given)), values, "a Plackett-Burman design takes two values")


def _size(factor: Any) -> Any:
    values = get(factor, "levels") or get(factor, "choice")
    return len(values) if isinstance(values, (list, tuple)) else get(factor, "points")


def _group_rules(factors: Any) -> Iterator[Problem]:
    groups = [get(factor, "group") for factor in factors]
    members = Counter(group for group in groups if isinstance(group, str))
    sizes: dict[str, Any] = {}
    for i, (factor, group) in enumerate(zip(factors, groups, strict=True)):
        if not isinstance(group, str):
            continue  # none, or its own rule says so
        if members[group] < 2:
            yield Problem(("factors", i, "group"), group, "has no other factor")
        size = _size(factor)
        if size is not None and sizes.setdefault(group, size) != size:
            text = "factors of a group must have equally many levels, choices or points"
            yield Problem(("factors", i, "group"), group, text)
