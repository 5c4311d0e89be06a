"""`Part`, the base of every part of a drive or study file: frozen and checked."""

from __future__ import annotations

import difflib
import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, is_dataclass
from functools import cache
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NamedTuple, Self, TypeVar, get_args

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    ModelWrapValidatorHandler,
    ValidationError,
    model_validator,
)
from pydantic_core import CoreSchema, InitErrorDetails, PydanticCustomError, core_schema

from warpchain.drive.quantities import LONGEST, converted_number, equivalent_units, match_quantity, unit_of_key
from warpchain.drive.toml import key_text, value_text
from warpchain.errors import drive_error

# ---------------------------------------------------------------------------------------------------------- kinds


@dataclass(frozen=True)
class Allowed:
    """Error sentence on allowed values of a table or list of tables."""

    text: str


class Value(Allowed):
    """Error sentence on allowed values of a single value."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        inner = core_schema.custom_error_schema(
            handler(source), custom_error_type=WRONG, custom_error_message=self.text, custom_error_context={}
        )
        return core_schema.no_info_after_validator_function(_check_magnitude, inner)


HUGE = 1e30
"""Largest magnitude of a drive file's numbers."""


def _check_magnitude(value: Any) -> Any:
    """The value, if none of its numbers is too large."""
    rest = [value]
    while rest:
        of = rest.pop()
        if isinstance(of, tuple):
            rest.extend(of)
        elif isinstance(of, float) and HUGE < abs(of) < math.inf:
            raise PydanticCustomError(WRONG, f"must be within {HUGE:g} of 0")
    return value


WRONG, BARE = "wrong_value", "bare_key"
"""Kinds of error lines: with value, or key path alone."""


def plain_sequence(value: Any) -> Any:
    """Lists and numpy arrays as tuples."""
    if isinstance(value, list):
        return tuple(value)
    return tuple(value.tolist()) if getattr(value, "ndim", 0) == 1 else value


def _check_direction(value: tuple[float, float]) -> tuple[float, float]:
    """A direction, if it is not zero."""
    if value[0] == 0.0 and value[1] == 0.0:
        raise ValueError("no direction")
    return value


def is_name(value: object) -> bool:
    """Whether a text can be a name in key paths, columns and files."""
    return (
        isinstance(value, str)
        and value.isprintable()
        and value == value.strip()
        and value != ""
        and not any(mark in value for mark in (".", "->", "=", "/", "\\"))
        and not value.lstrip("+-").isdigit()
    )


def _check_name(value: str) -> str:
    """A name, if `is_name`."""
    if not is_name(value):
        raise ValueError("not a name")
    return value


def _check_text(value: str) -> str:
    """A text, if it is printable and not empty."""
    if not value.isprintable() or not value:
        raise ValueError("not a text")
    return value


NAME_TEXT = (
    'must be a text that is not empty and not a whole number, without ".", "->", "=", "/", "\\", control characters '
    "or blanks at its ends"
)

_Real = Annotated[float, Field(strict=True, allow_inf_nan=False)]
_RealPair = Annotated[tuple[_Real, _Real], Field(strict=True)]
_NotNegative = Annotated[_Real, Field(ge=0)]
_MoreThanZero = Annotated[_Real, Field(gt=0)]

Finite = Annotated[_Real, Value("must be a finite number")]
Positive = Annotated[_MoreThanZero, Value("must be a positive number")]
NonNegative = Annotated[_NotNegative, Value("must be a number of at least 0")]
Switch = Annotated[bool, Field(strict=True), Value("must be true or false")]
Text = Annotated[str, Field(strict=True), AfterValidator(_check_text), Value("must be a text that is not empty")]
Name = Annotated[str, Field(strict=True), AfterValidator(_check_name), Value(NAME_TEXT)]
Pair = Annotated[_RealPair, BeforeValidator(plain_sequence), Value("must be two finite numbers [x, y]")]
Direction = Annotated[
    _RealPair,
    AfterValidator(_check_direction),
    BeforeValidator(plain_sequence),
    Value("must be two finite numbers [x, y], not both 0"),
]
PositivePair = Annotated[
    tuple[_MoreThanZero, _MoreThanZero],
    Field(strict=True),
    BeforeValidator(plain_sequence),
    Value("must be two positive numbers [x, y]"),
]
NonNegativePair = Annotated[
    tuple[_NotNegative, _NotNegative],
    Field(strict=True),
    BeforeValidator(plain_sequence),
    Value("must be two numbers [x, y] of at least 0"),
]
Column = Annotated[
    tuple[_Real, ...],
    Field(strict=True, min_length=2),
    BeforeValidator(plain_sequence),
    Value("must be a list of at least 2 finite numbers"),
]

# ------------------------------------------------------------------------------------------------------- problems


class Problem(NamedTuple):
    """One error of a drive file: key path, value, sentence, kind."""

    path: tuple[str | int, ...]
    value: Any
    text: str
    kind: str = WRONG

    def nested_under(self, *keys: str | int) -> Problem:
        """The problem with `keys` in front of its path."""
        return self._replace(path=(*keys, *self.path))


Rule = Callable[[Any], Iterable[Problem]]
"""Yields problems of a part, or of a mapping for one."""


def node_value(node: Any, key: str) -> Any:
    """Value of a part's or mapping's key, or None."""
    kind: Any = type(node)
    part, mapping = _part_or_mapping(kind)
    if part:
        return getattr(node, key, None)
    return node.get(key) if mapping else None


@cache
def _part_or_mapping(kind: type) -> tuple[bool, bool]:
    """Whether a type's values are parts or models, and mappings."""
    return issubclass(kind, Part) or is_dataclass(kind), issubclass(kind, Mapping)


def node_list(node: Any, key: str) -> Sequence[Any]:
    """List of a part's or mapping's key, or empty."""
    value = node_value(node, key)
    if type(value) is tuple:
        return value
    return value if isinstance(value, Sequence) and not isinstance(value, str) else ()


def are_numbers(*values: Any) -> bool:
    """Whether all values are finite numbers."""
    return all(
        isinstance(value, (int, float)) and not isinstance(value, bool) and -HUGE <= value <= HUGE for value in values
    )


FARTHEST = 1e4
"""Farthest place of a drive [m]."""


def place_rule(path: tuple[str | int, ...], point: Any) -> Iterator[Problem]:
    """Problem of a place beyond `FARTHEST`."""
    if not isinstance(point, (list, tuple)):
        return
    for x in point:
        if are_numbers(x) and abs(x) > FARTHEST:
            yield Problem(path, list(point), f"must be within {FARTHEST:g} m of the origin")
            return


def nearest_key_text(key: str, known: Iterable[str], most: int | None = None) -> str:
    """End of an error sentence with nearest or known keys."""
    names = list(known)
    close = difflib.get_close_matches(key, names, n=1)
    return f"did you mean {close[0]}?" if close else f"allowed are {names_text(names, most or len(names))}"


def names_text(names: Iterable[str], most: int) -> str:
    """First names in an error message, and how many more."""
    names = list(names)
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def at_most_rule(node: Any, key: str, most: int) -> Iterator[Problem]:
    """Problem of a key's number above an upper end."""
    value = node_value(node, key)
    if isinstance(value, int) and value > most:
        yield Problem((key,), value, f"must be at most {most}")


def exactly_one_rule(node: Any, first: str, second: str, text: str = "must be a positive number") -> Iterator[Problem]:
    """Problem of two keys of which not exactly one is given."""
    if node_value(node, first) is None and node_value(node, second) is None:
        yield Problem((first,), None, f"missing; {text}, or give {second} instead", BARE)
    if node_value(node, first) is not None and node_value(node, second) is not None:
        yield Problem((second,), node_value(node, second), f"not together with {first}; give one of the two")


# ---------------------------------------------------------------------------------------------------------- parts

PartType = TypeVar("PartType", bound="Part")


class Part(BaseModel):
    """A table of a drive or study file: immutable, compared and hashed by value.

    Raises:
        DriveError: one line for each value that is missing, unknown or not allowed.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    _replaces: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    """Keys for the same that setting a key removes."""
    _renamed: ClassVar[Mapping[str, str]] = {}
    """Present names of former keys."""
    _elsewhere: ClassVar[Mapping[str, str]] = {}
    """Keys that the part lacks, with the remedy."""
    _like: ClassVar[type[Part] | None] = None
    """Part whose keys it overrides."""
    _quantities: ClassVar[frozenset[str]] = frozenset()
    """Keys whose unit other values give."""
    _unsaid: ClassVar[Mapping[str, Any]] = {}
    """Values for keys left out, which files cannot have."""
    _judged: ClassVar[frozenset[str] | None] = None
    """Keys of numbers that the part's rules compare, or any."""

    if not TYPE_CHECKING:  # the type checker derives the signature from the fields

        def __init__(self, /, **values: Any) -> None:
            try:
                super().__init__(**values)
            except ValidationError as error:
                raise drive_error(error_lines(error, self._places(values)), self._source()) from None

        # pydantic calls a model's own __init__ for every nested part unless it is marked as not the user's: without
        # this mark the first wrong part would hide the errors of the others
        __init__.__pydantic_base_init__ = True

    @classmethod
    def _source(cls) -> str:
        """Prefix of the part's error lines."""
        return cls.__name__

    @classmethod
    def _places(cls, values: Any) -> Callable[[Sequence[str | int]], str]:
        """Function of a key path to its text in error lines."""
        known = dict[int, Counter[str]]()
        return lambda path: path_text(path, values, known)

    @classmethod
    def _with_current_keys(cls, values: Any) -> Any:
        """Values of a part with former keys renamed."""
        if not isinstance(values, Mapping) or cls._renamed.keys().isdisjoint(values):
            return values
        now = {key: cls._renamed.get(key, key) for key in values}
        return {key if now[key] != key and now[key] in values else now[key]: value for key, value in values.items()}

    @classmethod
    def _unit(cls, key: str, values: Mapping[str, Any]) -> str:
        """Unit of a key's numbers, "" for none."""
        return unit_of_key(cls, key)

    @classmethod
    def _values_in_units(cls, values: Any) -> tuple[Any, list[Problem]]:
        """Values of a part with quantities as numbers, and problems."""
        problems: list[Problem] = []

        def number(value: Any, key: str, path: tuple[str | int, ...]) -> Any:
            if isinstance(value, (list, tuple)) and any(isinstance(x, (str, list, tuple)) for x in value):
                inner = [number(x, key, (*path, k)) for k, x in enumerate(value)]
                return inner if isinstance(value, list) else tuple(inner)
            if isinstance(value, str) and len(value) > LONGEST and value.lstrip("+-.")[:1].isdecimal():
                problems.append(
                    Problem(path, value, f"must be a number, or one with a unit, of at most {LONGEST} characters")
                )
            if not isinstance(value, str) or not match_quantity(value):
                return value
            found = converted_number(value, units_of[key])
            if found is None:
                units = ", ".join(equivalent_units(units_of[key]))
                problems.append(Problem(path, value, f"must be a number, or one with a unit that fits: {units}"))
            elif abs(found) > HUGE:
                problems.append(Problem(path, value, f"must be within {HUGE:g} {units_of[key]} of 0"))
                return value
            return value if found is None else found

        if not isinstance(values, Mapping):
            return values, problems
        given = (key for key, x in values.items() if isinstance(x, (str, list, tuple)))
        units_of = {key: unit for key in given if (unit := cls._unit(key, values))}
        if not units_of:
            return values, problems
        return dict(values) | {key: number(values[key], key, (key,)) for key in units_of}, problems

    @classmethod
    def _unsaid_values(cls, values: Mapping[str, Any]) -> Mapping[str, Any]:
        """Values by key that files do not say."""
        return cls._unsaid

    @classmethod
    def _complete_values(cls, values: Any) -> Any:
        """Values of a part with those that follow from others."""
        return values

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        """Problems of several values of a part or mapping."""
        return ()

    @classmethod
    def _number_rules(cls, changed: Mapping[str, Any]) -> Sequence[Rule]:
        """Rules of the part that changed numbers can break.

        Args:
            changed: keys and list indices, nested.
        """
        return (cls._rules,) if cls._judged is None or not cls._judged.isdisjoint(changed) else ()

    @classmethod
    def _missing_key_problem(cls, key: str, node: Any) -> Problem:
        """Problem of a missing key."""
        return Problem((key,), None, f"missing; {allowed_text(cls, key)}", BARE)

    @model_validator(mode="wrap")
    @classmethod
    def _check(cls, values: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        """Part of checked values; raises all its problems together."""
        if isinstance(values, cls):
            return values
        values, problems = cls._values_in_units(cls._complete_values(cls._with_current_keys(values)))
        part = None
        try:
            part = handler(values)
        except ValidationError as error:
            details = error.errors(include_url=False, include_context=False)
            wrong = {problem.path[0] for problem in problems}
            problems += [cls._problem(detail, values) for detail in details if not wrong & set(detail["loc"][:1])]
        if part is not None or isinstance(values, Mapping):
            problems.extend(cls._rules(values if part is None else part))
        if part is None or problems:
            raise ValidationError.from_exception_data(
                cls.__name__,
                [
                    InitErrorDetails(type=PydanticCustomError(p.kind, p.text), loc=p.path, input=p.value)
                    for p in problems
                ],
            )
        return part

    @classmethod
    def _problem(cls, detail: Any, values: Any) -> Problem:
        """A validator's error as a problem of the part."""
        path, value, kind = detail["loc"], detail["input"], detail["type"]
        if not path:
            return Problem((), value, "must be a table")
        key = path[0]
        tagged = cls.model_fields[key].discriminator if key in cls.model_fields else None
        if kind in (WRONG, BARE):
            inside = path if tagged is None or len(path) < 2 else (key, *path[2:])  # without the union's tag
            return Problem(inside, value, detail["msg"], kind)
        if kind == "missing":
            return cls._missing_key_problem(key, values)
        if kind == "extra_forbidden":
            instead = cls._elsewhere.get(str(key)) or nearest_key_text(str(key), cls.model_fields)
            return Problem(path, value, f"unknown key; {instead}")
        if tagged is not None and isinstance(value, Mapping):
            given = value.get(str(tagged))
            text = allowed_text(cls, key)
            if given is None:
                return Problem((key, str(tagged)), None, f"missing; {text}", BARE)
            return Problem((key, str(tagged)), given, text)
        return Problem(path, value, allowed_text(cls, key))


@cache
def allowed_text(cls: type[Part], key: str) -> str:
    """Words for the values that a part's field allows."""

    def search(source: Any) -> Iterator[str]:
        for extra in (*getattr(source, "metadata", ()), *getattr(source, "__metadata__", ())):
            if isinstance(extra, Allowed):
                yield extra.text
        for inner in get_args(getattr(source, "annotation", source)):
            yield from search(inner)

    return next(search(cls.model_fields[key]), "must be a table")


def valid_part(cls: type[PartType], value: Any) -> PartType | None:
    """Part of a valid value; otherwise None."""
    if isinstance(value, cls):
        return value
    try:
        return cls.model_validate(value)
    except ValidationError:
        return None


# --------------------------------------------------------------------------------------------------------- report


def path_text(path: Sequence[str | int], values: Any, known: dict[int, Counter[str]]) -> str:
    """Key path as users write it; `known` caches counts of names."""
    words: list[str] = []
    node = values
    for key in path:
        if isinstance(key, int) and isinstance(node, Sequence):
            if id(node) not in known:
                known[id(node)] = Counter(
                    name for name in (node_value(element, "name") for element in node) if is_name(name)
                )
            names, node = known[id(node)], node[key] if key < len(node) else None
            name = node_value(node, "name")
            words.append(str(name) if is_name(name) and names[name] == 1 else str(key))
        else:
            node = node_value(node, str(key))
            words.append(key_text(str(key)))
    return ".".join(words)


def error_lines(error: ValidationError, place: Callable[[Sequence[str | int]], str]) -> list[str]:
    """Lines `key.path = value: what is allowed` of a validation error."""
    lines = []
    for detail in error.errors(include_url=False, include_context=False):
        shown = "" if detail["type"] == BARE else f" = {value_text(detail['input'])}"
        lines.append(f"{place(detail['loc'])}{shown}: {detail['msg']}")
    return lines
