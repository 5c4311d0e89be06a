"""Schedules of many variants as columns: each is what the variant has alone."""

import numpy as np
import pytest
from drives import two_sprockets

from warpchain import Record
from warpchain.engine.simulation import schedules_of
from warpchain.errors import SimulationError
from warpchain.results.schedule import Schedule, Schedules, join_schedules, schedules_as_columns

DRIVES = [two_sprockets(step=step, duration=duration) for step, duration in ((1e-6, 0.1), (3e-6, 0.1), (1e-6, 0.0025))]
EACH = [Schedule(1e-6 * (v + 1), 100 + v, v, 50 + v, v % 3, 32 << v % 2) for v in range(5)]


def test_columns_hold_each_schedule():
    held = schedules_as_columns(EACH)
    assert list(held) == EACH and len(held) == 5 and schedules_as_columns(held) is held
    assert isinstance(held[1:3], Schedules) and list(held[1:3]) == EACH[1:3]
    assert list(held[np.array([4, 0])]) == [EACH[4], EACH[0]]
    assert list(join_schedules([held[3:], EACH[:2]])) == [*EACH[3:], *EACH[:2]]
    assert {type(value) for value in vars(held[0]).values()} == {int, float}  # as archives and checkpoints write them


def test_variants_are_scheduled_as_alone():
    together = schedules_of(DRIVES, None, None, Record((0, 2), rate=1e4), None)
    records = [Record("all", rate=1e4), Record("none"), Record("all", rate=1e4)]
    alone = [schedules_of([drive], None, None, of, None)[0] for drive, of in zip(DRIVES, records, strict=True)]
    assert list(together) == alone
    assert [schedule.frame_interval for schedule in together] == [100, 0, 100]
    assert [(of.steps, of.window_start, of.window_end) for of in together][:2] == [
        (100_000, 50_000, 100_000),
        (33_333, 16_667, 33_333),
    ]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"window": (0.001, 0.01)}, r"duration = 0\.0025 s \(variant 2\)"),
        ({"duration": 4000.0}, r"duration = 4000 s at a step of 1e-06 s is 4e\+09 steps"),
        ({"record": Record("all", rate=1e-5)}, "sample's period at a step of 1e-06 s is 1e"),
    ],
)
def test_the_first_variant_that_is_refused_is_named(options, message):
    given = {"duration": None, "step": None, "record": Record("none"), "window": None} | options
    with pytest.raises(SimulationError, match=message):
        schedules_of(DRIVES, **given)
