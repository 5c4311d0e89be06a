"""Functions of numbers or a stack's arrays, with the same bits of a variant alone as among others."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from functools import partial, reduce, wraps
from operator import add
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


_PAIRWISE_COUNT = 8
_NUMBER_TYPES = frozenset((float, int, bool))


Number = Any
"""A number, or an array (V,) of one of each variant of a stack."""

Condition = Any
"""Whether something holds: true or false, or an array (V,) of that of each variant of a stack."""


class UnlikeVariants(Exception):
    """Raised where variants of a stack take different branches.

    Attributes:
        way: (V,) equal for variants of one branch.
    """

    def __init__(self, way: NDArray[Any]) -> None:
        super().__init__()
        self.way = way

    def at_places(self, places: Any, count: int) -> UnlikeVariants:
        """The exception for `count` variants with those at `places` apart."""
        import numpy as np

        way = np.full(count, self.way[0])
        way[places] = self.way
        return UnlikeVariants(way)


def shared_value(value: Number) -> Number:
    """Value that all variants of a stack share.

    Raises:
        UnlikeVariants: they differ.
    """
    if not has_arrays(value):
        return value
    if (value != value[0]).any():
        raise UnlikeVariants(value)
    return value[0].item()


def has_arrays(*values: Number) -> bool:
    """Whether any value is an array."""
    for value in values:  # noqa: SIM110  a loop takes half the time of any()
        if type(value) not in _NUMBER_TYPES and getattr(value, "ndim", None):
            return True
    return False


def elementwise(function: Callable[..., float]) -> Callable[..., Any]:
    """A function of numbers, for arrays element by element."""

    @wraps(function)
    def apply(*values: Any, **named: Any) -> Any:
        """The function of numbers, or of arrays element by element."""
        if not has_arrays(*values):
            return function(*values, **named)
        import numpy as np

        alike = len({getattr(value, "shape", None) for value in values}) == 1
        columns = values if alike else np.broadcast_arrays(*values)
        numbers = (column.ravel().tolist() for column in columns)
        found = map(partial(function, **named) if named else function, *numbers)
        return np.fromiter(found, float, columns[0].size).reshape(columns[0].shape)

    return apply


power = elementwise(pow)
hypot = elementwise(math.hypot)
cbrt = elementwise(math.cbrt)
radians = elementwise(math.radians)
arcsin = elementwise(math.asin)


def _numpy_function(name: str) -> Callable[..., Any]:
    """A numpy function for numbers and arrays, rounding alike."""

    def apply(*values: Number) -> Number:
        """The numpy function of numbers or arrays."""
        import numpy as np

        found = getattr(np, name)(*values)
        return found if has_arrays(found) else float(found)

    return apply


sin = _numpy_function("sin")
cos = _numpy_function("cos")
arctan2 = _numpy_function("arctan2")
quick_arcsin = _numpy_function("arcsin")
rint = _numpy_function("rint")


def cos_sin(angle: Number) -> tuple[Number, Number]:
    """Cosine and sine of a number or an array."""
    return cos(angle), sin(angle)


def _python_or_numpy_function(function: Callable[..., float], name: str) -> Callable[..., Any]:
    """Python's function for numbers, numpy's of a name for arrays."""

    def apply(*values: Number) -> Number:
        """Python's function of numbers, or numpy's of arrays."""
        if not has_arrays(*values):
            return function(*values)
        import numpy as np

        return getattr(np, name)(*values)

    return apply


sqrt = _python_or_numpy_function(math.sqrt, "sqrt")  # these numpy rounds as Python does
copysign = _python_or_numpy_function(math.copysign, "copysign")
quick_sin = _python_or_numpy_function(math.sin, "sin")
quick_cos = _python_or_numpy_function(math.cos, "cos")


def quick_hypot(x: Number, y: Number) -> Number:
    """sqrt(x^2 + y^2) of numbers or arrays, overflow aside."""
    return sqrt(x * x + y * y)


def floor(value: Number) -> Number:
    """Largest whole numbers not above numbers or arrays."""
    if not has_arrays(value):
        return math.floor(value)
    import numpy as np

    return np.floor(value).astype(np.int64)


def ceil(value: Number) -> Number:
    """Smallest whole numbers not below numbers or arrays."""
    return -floor(-value)


def where(condition: Condition, yes: Number, no: Number) -> Number:
    """One value where a condition holds, else the other, elementwise."""
    if not has_arrays(condition):
        return yes if condition else no
    import numpy as np

    return np.where(condition, yes, no)


def pairwise_sum(values: Sequence[Number]) -> Number:
    """Sum of numbers or arrays as numpy adds, pairwise."""
    return reduce(add, values) if len(values) < _PAIRWISE_COUNT else array_of_columns(values).sum(axis=-1)


def ordered_sum(values: Iterable[Number]) -> Number:
    """Sum of numbers or arrays from first to last."""
    return reduce(add, values, 0.0)


def maximum(*values: Number) -> Number:
    """Largest of numbers, or of arrays elementwise."""
    if not has_arrays(*values):
        return max(values)
    import numpy as np

    return reduce(np.maximum, values)


def minimum(*values: Number) -> Number:
    """Smallest of numbers, or of arrays elementwise."""
    if not has_arrays(*values):
        return min(values)
    import numpy as np

    return reduce(np.minimum, values)


def index_of_maximum(values: Sequence[Number]) -> Number:
    """Index of the first largest number, of arrays elementwise."""
    if not has_arrays(*values):
        return max(range(len(values)), key=values.__getitem__)
    return array_of_columns(values).argmax(axis=-1)


def is_true_somewhere(condition: Condition) -> bool:
    """Whether a condition holds, of arrays anywhere."""
    return bool(condition.any() if has_arrays(condition) else condition)


def is_true_everywhere(condition: Condition) -> bool:
    """Whether a condition holds, of arrays everywhere."""
    return bool(condition.all() if has_arrays(condition) else condition)


def array_of_columns(values: Sequence[Number]) -> NDArray[np.float64]:
    """Numbers or arrays (...) as one array (..., len(values))."""
    import numpy as np

    if not has_arrays(*values):
        return np.array(values, dtype=float)
    return np.stack(np.broadcast_arrays(*(np.asarray(value, dtype=float) for value in values)), axis=-1)


def columns_of_table(table: NDArray[Any]) -> list[Any]:
    """Columns (V,) of a table (V, K), or a row's numbers."""
    return table[0].tolist() if len(table) == 1 else list(table.T.copy())


def table_of_columns(values: Sequence[Any], rows: int) -> NDArray[Any]:
    """Table (rows, K) of K numbers or arrays (rows,)."""
    import numpy as np

    if rows == 1 and not has_arrays(*values):
        return np.array([values])
    return np.stack([np.broadcast_to(value, rows) for value in values], axis=1)


def pick_places(value: Any, places: Any) -> Any:
    """Elements of an array at some places; a number stays."""
    return value[places] if has_arrays(value) else value


def with_last_axis(value: Number) -> Number:
    """An array (...) as (..., 1); a number stays."""
    return value[..., None] if has_arrays(value) else value
