"""Functions of numbers and arrays: a value has the same bits as a number and in an array, wherever it stands there."""

import numpy as np
import pytest

from warpchain.drive import stack_math

FUNCTIONS = {
    name: getattr(stack_math, name)
    for name in ("sin", "cos", "arcsin", "arctan2", "rint", "hypot", "sqrt", "cbrt", "power", "radians", "copysign")
} | {name: getattr(stack_math, name) for name in ("quick_sin", "quick_cos", "quick_arcsin", "quick_hypot")}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_value_has_the_same_bits_alone_and_among_others(name):
    random, function = np.random.default_rng(5), FUNCTIONS[name]
    low, high = {"arcsin": (-1.0, 1.0), "quick_arcsin": (-1.0, 1.0)}.get(name, (0.0, 10.0))
    two = name in ("arctan2", "hypot", "power", "copysign", "quick_hypot")
    for size in (*range(1, 20), 20_000):  # whole vectors of the processor, and what is left over
        columns = [random.uniform(low, high, size) for _ in range(1 + two)]
        alone = [function(*values) for values in zip(*(column.tolist() for column in columns), strict=True)]
        np.testing.assert_array_equal(function(*columns), alone)


def test_sums_are_those_of_arrays():
    values = [0.1, 1e16, -1e16, 0.2]
    assert stack_math.ordered_sum(values) == stack_math.ordered_sum([np.full(3, value) for value in values])[0] == 0.2
    assert stack_math.ordered_sum([]) == 0.0
