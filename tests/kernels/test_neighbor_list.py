"""The CPU kernel looks only at rollers that can come near a partner soon: what it gives does not hang on that."""

import numpy as np
import pytest
from drives import example, two_sprockets
from raw import chain, stepped

from warpchain.engine.arrays import ARRAYS
from warpchain.engine.pack import pack
from warpchain.kernels.cpu.rollers import rows
from warpchain.results.schedule import Schedule


def alike(packed, steps):
    """Two engines after the same steps, in one launch and in launches of one, which look at all rollers each time."""
    return [stepped(packed, *launches)[0] for launches in ([steps], [1] * steps)]


def assert_alike(once, often, sums=tuple(ARRAYS["sums"])):
    np.testing.assert_array_equal(once.rollers(), often.rollers())
    np.testing.assert_array_equal(once.fetch_array("state", "seat"), often.fetch_array("state", "seat"))
    np.testing.assert_array_equal(once.fetch_array("state", "impact_speed"), often.fetch_array("state", "impact_speed"))
    for name in sums:
        np.testing.assert_array_equal(once.sums()[name], often.sums()[name], err_msg=name)


@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("name", ["marine", "engine", "car"])
def test_runs_that_are_kept_give_what_new_ones_give(name, precision):
    # sprockets that move, guide-bars, profiles on arms; bitwise, but for the tallies of links, which each launch merges
    drive = example(name)
    packed = pack([drive], [Schedule(5e-6, 800, 0, 800, 0)]).at_precision(precision)
    assert_alike(*alike(packed, 400), sums=("contact", "sprocket", "mount"))


def test_runs_hold_few_rollers_for_many_steps():
    # half of either sprocket of 20 teeth has 11 rollers, a band of half a pitch and a quarter around it 5 more at most,
    # in whole lanes of 4 at either end
    drive = two_sprockets()
    engine, _ = stepped(pack([drive], [Schedule(1e-6, 10**6, 10**6, 10**6, 0)]), 100)
    row = rows(engine.capacity)
    scratch = engine._scratch.get().numpy()[0]
    counted = []
    for p in range(2):
        count = int(scratch[row.runs + p])
        first = p * 3  # 60 rollers are at most one group, and two runs beside it
        counted.append(scratch[row.run_rollers + first : row.run_rollers + first + count].sum())
    assert all(8 <= count <= 32 for count in counted)
    assert scratch[row.lifetime] > 0


@pytest.mark.parametrize("speed", [3e3, 3e5])
def test_a_roller_that_flies_is_seen_in_time(speed):
    # in a step of 2e-5 s it passes the margin, a quarter of a pitch, which it cannot while runs hold
    drive = two_sprockets()
    packed = pack([drive], [Schedule(2e-5, 400, 0, 400, 0)])
    n = drive.chain.links
    places = packed.rollers.reshape(6, n)[:2]
    far = int(np.argmax(np.abs(places[0] - places[0].mean()) < 0.1 * np.ptp(places[0])))
    toward = np.array(drive.sprockets[0].center) - places[:, far]
    packed.rollers.reshape(6, n)[2:4, far] = speed * toward / np.hypot(*toward)
    once, often = alike(packed, 60)
    assert_alike(once, often, sums=("contact", "sprocket"))
    moved = once.rollers().reshape(6, n)[:2, far] - places[:, far]
    assert not np.isfinite(moved).all() or np.hypot(*moved) > drive.chain.pitch


def test_where_there_is_no_room_for_runs_all_rollers_are_looked_at():
    # 70 sprockets far away of 6 runs each do not fit rows of 264 values: all rollers are looked at, in whole groups
    around = 2.0 * np.pi * np.arange(200) / 200
    place = np.stack([np.cos(around), np.sin(around)], axis=1)
    still = np.zeros_like(place)
    far = {"center": (50.0, 0.0), "prescribed": 1, "stiffness": 1e8, "teeth": 10}
    made = {"mass": 1.0, "pitch": 2.0 * np.sin(np.pi / 200), "stiffness": 1e6, "step": 1e-5, "steps": 50}
    few, many = (chain(place, still, sprockets=[far] * count, gravity=(0.0, -9.81), **made) for count in (1, 70))
    np.testing.assert_array_equal(*(stepped(packed, 50)[0].rollers() for packed in (few, many)))
