"""The CPU kernel takes rollers in groups and adds tensions up link by link: where these are cut does not matter."""

from dataclasses import replace

import numpy as np
import pytest
from drives import example, two_sprockets
from raw import stepped

from warpchain.engine.arrays import ARRAYS
from warpchain.engine.pack import pack
from warpchain.results.schedule import Schedule


def test_where_launches_end_does_not_matter():
    # launches of whole rounds of 16 steps merge the links' tallies where one launch does: bitwise the same
    drive = two_sprockets()
    packed = pack([drive], [Schedule(drive.run.step, 2100, 1000, 2100, 0)])
    once, twice = stepped(packed, 2101)[0], stepped(packed, 1024, 1024, 53)[0]
    np.testing.assert_array_equal(once.rollers(), twice.rollers())
    for name in ARRAYS["sums"]:
        np.testing.assert_array_equal(once.sums()[name], twice.sums()[name], err_msg=name)


@pytest.mark.parametrize("by", [1, 50, 63])
def test_where_groups_begin_does_not_matter(by):
    # 162 rollers are three groups; whichever number a roller has, it moves alike, to the round-off of the sums of
    # moments (1e-16 of 1e5 N m), which 300 steps of 1e-5 s turn into less than 1e-12 m
    drive = example("marine")
    packed = pack([drive], [Schedule(1e-5, 300, 0, 300, 0)])
    n = drive.chain.links
    turned = replace(
        packed,
        rollers=np.roll(packed.rollers.reshape(6, n), by, axis=1).ravel(),
        seat=np.roll(packed.seat.reshape(-1, n), by, axis=1).ravel(),
    )
    here, there = (stepped(of, 301)[0] for of in (packed, turned))
    x, y = (engine.rollers().reshape(6, n) for engine in (here, there))
    np.testing.assert_allclose(y[:2], np.roll(x, by, axis=1)[:2], rtol=0.0, atol=1e-11)
    for field in ("impulse", "dissipated", "friction", "impacts", "contacts", "force_max"):
        mine, theirs = (engine.sums()["contact"][field] for engine in (here, there))
        np.testing.assert_allclose(theirs, mine, rtol=1e-7, err_msg=field)
    assert (here.sums()["contact"]["contacts"][:3] > 0).all()
