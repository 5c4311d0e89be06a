"""Numbers, or arrays of them over the variants of a stack (`warpchain.drive.batch`): what takes either.

A variant's value has the same bits alone as among others: where numpy's own function could round otherwise than
Python's, arrays are worked through number by number, or numbers go through numpy's.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from functools import partial, reduce, wraps
from operator import add
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


_IN_PAIRS = 8
_PLAIN = frozenset((float, int, bool))


class Unlike(Exception):
    """Variants of a stack go unlike ways in a calculation, each of which is then worked out by itself.

    Attributes:
        way: (V,) what is the same for those that go the same way.
    """

    def __init__(self, way: NDArray[Any]) -> None:
        super().__init__()
        self.way = way

    def among(self, places: Any, count: int) -> Unlike:
        """The same among `count` variants, of which these are the ones at `places`."""
        import numpy as np

        way = np.full(count, self.way[0])
        way[places] = self.way
        return Unlike(way)


def same(value: Any) -> Any:
    """The value that decides which way a calculation goes, which all variants of a stack must share.

    Raises:
        Unlike: where they do not.
    """
    if not many(value):
        return value
    if (value != value[0]).any():
        raise Unlike(value)
    return value[0].item()


def many(*values: Any) -> bool:
    """Whether any of some values is an array (...) of numbers."""
    for value in values:  # noqa: SIM110  a loop takes half the time of any()
        if type(value) not in _PLAIN and getattr(value, "ndim", None):
            return True
    return False


def each(function: Callable[..., float]) -> Callable[..., Any]:
    """A function of numbers as one of numbers or arrays (...), applied to each."""

    @wraps(function)
    def over(*values: Any, **named: Any) -> Any:
        if not many(*values):
            return function(*values, **named)
        import numpy as np

        alike = len({getattr(value, "shape", None) for value in values}) == 1
        columns = values if alike else np.broadcast_arrays(*values)
        numbers = (column.ravel().tolist() for column in columns)
        found = map(partial(function, **named) if named else function, *numbers)
        return np.fromiter(found, float, columns[0].size).reshape(columns[0].shape)

    return over


power = each(pow)
hypot = each(math.hypot)
cbrt = each(math.cbrt)
radians = each(math.radians)
arcsin = each(math.asin)


def _rounded_as_numpy(name: str) -> Callable[..., Any]:
    """A function of numpy's, which a number goes through too, since Python's own may round otherwise."""

    def over(*values: Any) -> Any:
        import numpy as np

        found = getattr(np, name)(*values)
        return found if many(found) else float(found)

    return over


sin = _rounded_as_numpy("sin")
cos = _rounded_as_numpy("cos")
arctan2 = _rounded_as_numpy("arctan2")
quick_arcsin = _rounded_as_numpy("arcsin")
rint = _rounded_as_numpy("rint")


def _either(function: Callable[..., float], name: str) -> Callable[..., Any]:
    """A function of Python's for numbers, numpy's of that name for arrays."""

    def over(*values: Any) -> Any:
        if not many(*values):
            return function(*values)
        import numpy as np

        return getattr(np, name)(*values)

    return over


sqrt = _either(math.sqrt, "sqrt")  # these numpy rounds as Python does
copysign = _either(math.copysign, "copysign")
quick_sin = _either(math.sin, "sin")
quick_cos = _either(math.cos, "cos")


def quick_hypot(x: Any, y: Any) -> Any:
    """sqrt(x^2 + y^2), of ordinary size."""
    return sqrt(x * x + y * y)


def floor(value: Any) -> Any:
    """The whole number below, or numbers."""
    if not many(value):
        return math.floor(value)
    import numpy as np

    return np.floor(value).astype(np.int64)


def ceil(value: Any) -> Any:
    """The whole number above, or numbers."""
    return -floor(-value)


def where(condition: Any, yes: Any, no: Any) -> Any:
    """One where a condition holds, else the other."""
    if not many(condition):
        return yes if condition else no
    import numpy as np

    return np.where(condition, yes, no)


def total(values: Sequence[Any]) -> Any:
    """The sum as numpy adds up, from the first to the last, and eight or more in pairs.

    Python's own sum of numbers keeps what it rounds off.
    """
    return reduce(add, values) if len(values) < _IN_PAIRS else joined(values).sum(axis=-1)


def summed(values: Iterable[Any]) -> Any:
    """The sum from the first to the last, 0 of none; as `total` of a few."""
    return reduce(add, values, 0.0)


def largest(*values: Any) -> Any:
    """The largest of numbers, or of arrays at each place."""
    if not many(*values):
        return max(values)
    import numpy as np

    return reduce(np.maximum, values)


def smallest(*values: Any) -> Any:
    """The smallest of numbers, or of arrays at each place."""
    if not many(*values):
        return min(values)
    import numpy as np

    return reduce(np.minimum, values)


def first_largest(values: Sequence[Any]) -> Any:
    """Which of some values is the largest, the first of several; of arrays at each place."""
    if not many(*values):
        return max(range(len(values)), key=values.__getitem__)
    return joined(values).argmax(axis=-1)


def some(condition: Any) -> bool:
    """Whether a condition holds, or holds anywhere."""
    return bool(condition.any() if many(condition) else condition)


def every(condition: Any) -> bool:
    """Whether a condition holds, or holds everywhere."""
    return bool(condition.all() if many(condition) else condition)


def joined(values: Sequence[Any]) -> NDArray[np.float64]:
    """Numbers or arrays (...) as one array with a last axis more, (..., len(values))."""
    import numpy as np

    if not many(*values):
        return np.array(values, dtype=float)
    return np.stack(np.broadcast_arrays(*(np.asarray(value, dtype=float) for value in values)), axis=-1)


def columns(table: NDArray[Any]) -> list[Any]:
    """The columns of a table (V, K), each an array (V,); of one with a single row, its numbers."""
    return table[0].tolist() if len(table) == 1 else list(table.T.copy())


def table_of(values: Sequence[Any], rows: int) -> NDArray[Any]:
    """A table (rows, K) of as many numbers or arrays (rows,): `columns` backwards."""
    import numpy as np

    if rows == 1 and not many(*values):
        return np.array([values])
    return np.stack([np.broadcast_to(value, rows) for value in values], axis=1)


def taken(value: Any, places: Any) -> Any:
    """Some of an array (V,) of numbers; a number stays, as it is that of all."""
    return value[places] if many(value) else value


def along(value: Any) -> Any:
    """A number as it is, an array (...) with a last axis of 1: what multiplies the rows of another array."""
    return value[..., None] if many(value) else value
