"""What a variant gives hangs on nothing but the variant: not on those beside it, its window, or what is recorded."""

from functools import partial

import numpy as np
import pytest
import warp as wp
from drives import STARTING, assert_same_frames, example, two_sprockets

from warpchain import Record, simulate
from warpchain.drive.examples import example_names

DEVICES = ["cpu", pytest.param("cuda", marks=pytest.mark.gpu)]
PRECISIONS = ["float64", "float32"]
NAMES = [pytest.param(name, marks=() if name in ("car", "marine") else pytest.mark.long) for name in example_names()]
OF_THE_RUN = ("variant", "wall_time")
DURATION = 1e-3


def row(run, v, names):
    """A variant's metrics of these names."""
    values = run.metrics.to_pylist()[v]
    return {name: values[name] for name in names if name not in OF_THE_RUN}


def crowd_of(drive, device):
    """The drive first, and after it copies, others and one that diverges."""
    count = 3 * wp.get_device("cuda:0").sm_count if device == "cuda" else 17
    torn = two_sprockets().with_values({"sprockets.driver.prescribed": {"speed": 1e5, "ramp_time": 0.0}})
    return [drive, *[drive] * count, two_sprockets(), torn, example("marine"), two_sprockets(teeth=24, links=64)]


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("name", NAMES)
def test_a_variant_has_its_bits_alone_and_in_a_crowd(name, device, precision):
    drive = example(name)
    run = partial(simulate, device=device, precision=precision, duration=DURATION, limits=STARTING)
    alone, crowd = run(drive, record=Record(rate=5e3)), run(crowd_of(drive, device), record=Record(variants="none"))
    assert crowd.metrics["diverged"].to_pylist().count(True) == 1
    names = alone.metrics.column_names
    for v in (0, 1):
        np.testing.assert_equal(row(crowd, v, names), row(alone, 0, names))
    few = run([drive, two_sprockets()], record=Record(rate=5e3))
    assert_same_frames(few[0], alone[0])


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("name", NAMES)
def test_a_window_leaves_the_motion_its_bits(name, device, precision):
    run = partial(simulate, device=device, precision=precision, duration=DURATION, record=Record(rate=5e3))
    begun, late = (run(example(name), window=(start, DURATION), limits=STARTING) for start in (0.0, 0.7 * DURATION))
    assert_same_frames(begun[0], late[0])
