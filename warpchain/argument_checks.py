"""Checks of public functions' arguments by their annotations; a misfit is an error of one line.

Numbers of numpy are numbers, its arrays are sequences, and neither True nor False is a number.
"""

from __future__ import annotations

import builtins
import inspect
import math
import operator
import reprlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, wraps
from numbers import Integral, Real
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin

CheckedFunction = TypeVar("CheckedFunction", bound=Callable[..., Any])
ValueTest = Callable[[Any], bool]


@dataclass(frozen=True)
class AllowedRange:
    """Range of numbers that an argument allows, in words and as a test."""

    words: str
    holds: ValueTest


FiniteNumber = Annotated[float, AllowedRange("a finite number", math.isfinite)]
NonNegativeNumber = Annotated[float, AllowedRange("a finite number of at least 0", lambda x: 0.0 <= x < math.inf)]
PositiveNumber = Annotated[float, AllowedRange("a finite number above 0", lambda x: 0.0 < x < math.inf)]
Count = Annotated[int, AllowedRange("a whole number of at least 1", lambda n: n >= 1)]
Index = Annotated[int, AllowedRange("a whole number of at least 0", lambda n: n >= 0)]
MOST_WORKERS = 1024
Workers = Annotated[int, AllowedRange(f"a whole number from 1 to {MOST_WORKERS}", lambda n: 1 <= n <= MOST_WORKERS)]

_PLAIN_KINDS: Mapping[Any, tuple[str, type]] = {
    float: ("a number", Real),
    int: ("a whole number", Integral),
    str: ("a text", str),
    bytes: ("bytes", bytes),
    bool: ("True or False", bool),
    NoneType: ("None", NoneType),
}


def number_text(value: float) -> str:
    """Text of a number in messages, to 12 digits."""
    return repr(float(f"{value:.12g}"))


class _ShortRepr(reprlib.Repr):
    """Texts of arguments in messages, cut short."""

    def repr_float(self, value: float, level: int) -> str:
        """Text of a float argument, by `number_text`."""
        return number_text(value)

    repr_float64 = repr_float32 = repr_float


_SHORT_REPR = _ShortRepr()


def check_arguments(error: type[Exception], prefix: str = "") -> Callable[[CheckedFunction], CheckedFunction]:
    """Decorator that raises `error`, `NAME = VALUE: must be WHAT`, for an argument outside its annotation."""

    def wrap(function: Any) -> Any:
        """Function or dataclass with checks of its arguments."""
        if isinstance(function, type):
            function.__init__ = wrap(function.__init__)  # type: ignore[misc]
            return function
        signature = inspect.signature(function)

        @cache
        def tests_by_name() -> dict[str, tuple[str, ValueTest]]:
            """Words and test of each checked argument, by name."""
            names = _AnnotationNames(inspect.unwrap(function).__globals__)
            notes = {name: note for name, note in function.__annotations__.items() if name != "return"}
            return {name: _kind_of_annotation(eval(note, {}, names)) for name, note in notes.items()}

        @wraps(function)
        def call(*args: Any, **named: Any) -> Any:
            """Checks arguments, then calls the function."""
            given = signature.bind(*args, **named).arguments
            for name, (words, test) in tests_by_name().items():
                if name in given and not test(given[name]):
                    raise error(f"{prefix}{name} = {_SHORT_REPR.repr(given[name])}: must be {words}")
            return function(*args, **named)

        return call

    return wrap


class _UnimportedType(type):
    """Type that stands for names that only type checkers import."""

    def __getattr__(cls, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        return _UnimportedType(name, (), {})


class _AnnotationNames(dict[str, Any]):
    """Names for evaluating annotations: a module's, builtins, or an empty class."""

    def __missing__(self, name: str) -> Any:
        return getattr(builtins, name) if hasattr(builtins, name) else _UnimportedType(name, (), {})


def _kind_of_annotation(note: Any) -> tuple[str, ValueTest]:
    """Words for the values that an argument's annotation allows, and their test."""
    origin, inner = get_origin(note), get_args(note)
    if hasattr(origin or note, "__value__"):  # a type alias of Python 3.12, as NumPy's NDArray is since 2.5
        return _kind_of_annotation((origin or note).__value__)
    if note in _PLAIN_KINDS:
        words, plain = _PLAIN_KINDS[note]
        return words, lambda value: isinstance(value, plain) and (plain is bool or not _is_no_number(value))
    if note in (Any, object):
        return "anything", lambda value: True
    if origin is Literal:
        return " or ".join(map(repr, inner)), lambda value: isinstance(value, str) and value in inner
    if origin is Annotated:
        (_, number), values = _kind_of_annotation(inner[0]), inner[1]
        return values.words, lambda value: number(value) and values.holds(value)
    kinds = [_kind_of_annotation(part) for part in inner if part is not Ellipsis] if origin is not Callable else []
    tests = [test for _, test in kinds]
    if origin in (Union, UnionType):
        words = " or ".join(dict.fromkeys(words for words, _ in kinds if words != "None"))
        return words, lambda value: any(test(value) for test in tests)
    if origin is tuple:
        words = f"{len(kinds)} values, {', '.join(words for words, _ in kinds)}"
        return (
            words,
            lambda value: _is_sequence(value) and len(value) == len(tests) and all(map(operator.call, tests, value)),
        )
    if origin is Sequence:
        return f"a sequence, each {kinds[0][0]}", lambda value: _is_sequence(value) and all(map(tests[0], value))
    if origin is Mapping:
        (key, _), (value, _) = kinds
        return (
            f"a mapping from {key} to {value}",
            lambda found: (
                isinstance(found, Mapping) and all(map(tests[0], found)) and all(map(tests[1], found.values()))
            ),
        )
    if origin is Callable:
        return "a function", callable
    kind = origin or note
    name = kind.__name__
    words = "a path" if name in ("Path", "PathLike") else f"a {name}"
    return words, lambda value: isinstance(value, kind) or any(of.__name__ == name for of in type(value).__mro__)


def _is_sequence(value: Any) -> bool:
    """Whether an argument is a sequence, or an array of one axis."""
    return (isinstance(value, Sequence) and not isinstance(value, str | bytes)) or getattr(value, "ndim", 0) == 1


def _is_no_number(value: Any) -> bool:
    """Whether an argument is True, False, or an integer beyond 63 bits."""
    return isinstance(value, bool) or (isinstance(value, int) and value.bit_length() > 63)
