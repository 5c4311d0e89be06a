"""The result of a factory: the Warp functions and structs that it made for one kind of kernels, by their own names."""

from types import SimpleNamespace
from typing import Any


def namespace(*members: Any, **values: Any) -> SimpleNamespace:
    """Functions and structs as attributes of their own names, and values (constants, vector types) of those given.

    `namespace(move, fetch, X=X)` has `.move`, `.fetch` and `.X`.
    """
    return SimpleNamespace(**{member.__name__: member for member in members}, **values)
