"""Trajectories compared, for the tests of archives, and two drives unlike each other."""

import numpy as np
from drives import two_sprockets


def unlike():
    """Two drives of other lengths, that run for other times."""
    other = two_sprockets(duration=0.002, settle="false", teeth=24, links=64)
    return [two_sprockets(duration=0.003, settle="false"), other]


def assert_same(one, other):
    assert list(one) == list(other)
    assert one.drives == other.drives
    assert one.metrics.equals(other.metrics)
    assert one.metrics.schema.equals(other.metrics.schema, check_metadata=True)
    for variant in one:
        np.testing.assert_array_equal(one[variant].time, other[variant].time)
        mine, theirs = one[variant].channels(), other[variant].channels()
        assert mine.keys() == theirs.keys()
        for name, values in mine.items():
            assert values.dtype == theirs[name].dtype
            np.testing.assert_array_equal(values, theirs[name], err_msg=name)
