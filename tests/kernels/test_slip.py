"""Slips and batches as the kernels follow them, by hand-made looks."""

import numpy as np
import pytest
import warp as wp
from own_kernels import kernel

from warpchain.engine.window_sums import batch_durations
from warpchain.kernels.statistics import NOTES, follow_slip, notes_due
from warpchain.kernels.structs import Drive, SlipSums


@kernel
def look(slip: wp.array[SlipSums], roller: wp.array[int], seat: wp.array[int], teeth: int, sign: wp.float64, n: int):
    for k in range(roller.shape[0]):
        slip[0] = follow_slip(slip[0], roller[k], seat[k], teeth, sign, n)


def slips(chain, sprocket, *, teeth, links, sign, missing=()):
    """Slips seen when chain and sprocket have gone on by these many pitches and teeth at each look.

    On a sprocket that turns counter-clockwise the seats stand in the order of the rollers, else against it; in mid-wrap
    is the roller that the chain has brought there.
    """
    roller = -np.asarray(chain)  # along the chain from where it began
    seat = sign * (roller + np.asarray(chain) - np.asarray(sprocket))
    seat = np.where(np.isin(np.arange(len(roller)), missing), -1, seat % teeth)
    slip = wp.zeros(1, dtype=SlipSums, device="cpu")
    arrays = [wp.array(values, dtype=int, device="cpu") for values in (roller % links, seat)]
    wp.launch(look, dim=1, inputs=[slip, *arrays, teeth, wp.float64(sign), links], device="cpu")
    return int(slip.numpy()[0]["slips"])


LOOKS = 3 * np.arange(2000) // 10  # pitches that have passed at each look: ten revolutions of 60 links


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("teeth", [19, 20, 7])
@pytest.mark.parametrize("way", [1, -1], ids=["forward", "back"])
def test_only_jumps_count(sign, teeth, way):
    """Whether or not the teeth divide the links, and whichever way the drive runs; jumps of one and of two teeth."""
    of = dict(teeth=teeth, links=60, sign=sign)
    chain, steps = way * LOOKS, np.arange(len(LOOKS))
    assert slips(chain, chain, **of) == 0
    jumped = chain + (steps > 700) + 2 * (steps > 1200)
    assert slips(chain, jumped, **of) == 3
    assert slips(chain, chain - (steps > 700) + (steps > 1500), **of) == 2  # back, and again forward
    assert slips(chain, jumped, **of, missing=range(690, 720)) == 3  # nobody in mid-wrap while it jumps
    assert slips(chain, chain + (steps == 900), **of) == 0  # rode up, fell back
    assert slips(chain, chain, **of, missing=steps) == 0


@kernel
def due(drive: wp.array[Drive], steps: wp.array[int], notes: wp.array2d[int]):
    k = wp.tid()
    first, end = notes_due(drive[0], steps[k])
    notes[k, 0] = first
    notes[k, 1] = end


@pytest.mark.parametrize(
    ("start", "end", "every"),
    [(0, 2560, 32), (111, 4711, 32), (500, 3060, 32), (7, 100_000_007, 32), (7, 5127, 64), (40, 100_000_007, 64)],
)
def test_batches_end_where_their_durations_say(start, end, every):
    """Every note is taken once, at the first look that is not before its share of the window."""
    drive = np.zeros(1, dtype=Drive.numpy_dtype())
    drive["window_start"], drive["window_end"], drive["step"] = start, end, 1.0
    drive["sample_interval"] = every
    shares = start + (end - start) * np.arange(1, 80) / 80
    expected = (-(-shares // every) * every).astype(int)
    steps = np.unique(np.concatenate([expected + every * k for k in (-2, -1, 0, 1, 2)]))
    steps = steps[(steps > start) & (steps <= end)]
    notes = wp.zeros((len(steps), 2), dtype=int, device="cpu")
    rows = wp.array(drive, dtype=Drive, device="cpu")
    wp.launch(due, dim=len(steps), inputs=[rows, wp.array(steps, dtype=int, device="cpu"), notes], device="cpu")
    taken = [(k, step) for step, (first, last) in zip(steps, notes.numpy(), strict=True) for k in range(first, last)]
    assert taken == list(zip(range(int(NOTES)), expected, strict=True))
    durations = batch_durations(drive)[0]
    assert durations.sum() == end - start
    np.testing.assert_array_equal(np.cumsum(durations)[:-1], expected - start - 0.5)  # the first step counts half
