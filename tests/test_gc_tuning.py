"""Python looks for garbage rarely while runs and studies are prepared, and as before after them."""

import gc
from collections.abc import Iterator

import pytest
from drives import two_sprockets

from warpchain import simulate
from warpchain.gc_tuning import RARE_THRESHOLD, rare_collections


@pytest.fixture(autouse=True)
def usual() -> Iterator[None]:
    before = gc.get_threshold()
    gc.set_threshold(700, 10, 10)
    yield
    gc.set_threshold(*before)


def test_it_looks_rarely_inside_and_as_before_after_errors_too():
    with pytest.raises(ValueError, match="inside"), rare_collections():
        assert gc.get_threshold() == (RARE_THRESHOLD, 10, 10)
        raise ValueError("inside")
    assert gc.get_threshold() == (700, 10, 10)


@pytest.mark.parametrize("own", [0, RARE_THRESHOLD + 1])
def test_whoever_wants_it_more_rarely_or_never_is_left_alone(own):
    gc.set_threshold(own)
    with rare_collections():
        assert gc.get_threshold()[0] == own
    assert gc.get_threshold()[0] == own


def test_a_run_does_so():
    seen = []

    def report(*_: object) -> None:
        seen.append(gc.get_threshold()[0])

    simulate(two_sprockets(), duration=1e-4, progress=report)
    assert set(seen) == {RARE_THRESHOLD}
    assert gc.get_threshold() == (700, 10, 10)
