"""How a GPU's launches are cut: every variant once, every step once, in order."""

import pytest

from warpchain.engine.gpu import PARTS, cut, groups


@pytest.mark.parametrize("count", [1, 1584, 1585, 16_896, 10_001])
def test_every_variant_is_in_one_group(count):
    parts = groups(count, 1584)
    covered = [v for first, size in parts for v in range(first, first + size)]
    assert covered == list(range(count))
    assert len(parts) == (1 if count <= 1584 else 2)
    assert max(size for _, size in parts) - min(size for _, size in parts) <= 1


@pytest.mark.parametrize(
    "phases", [[("advance", 3072, 0)], [("advance", 960, 0), ("measure", 2112, 960)], [("a", 7, 0)]]
)
def test_every_step_is_taken_once_and_in_order(phases):
    launches = cut(phases, 32)
    taken = [(name, step) for name, steps, before in launches for step in range(before, before + steps)]
    assert taken == [(name, step) for name, steps, before in phases for step in range(before, before + steps)]
    # results do not depend on where launches end where they are whole units long
    assert all(steps % 32 == 0 for _, steps, _ in launches) or phases == [("a", 7, 0)]
    assert len(launches) <= PARTS + len(phases)


def test_short_launches_stay_whole():
    assert cut([("advance", 32, 0)], 32) == [("advance", 32, 0)]
    assert cut([], 32) == []
