"""The chain's force on sprockets in the frames of block kernels, which sum it only where frames or metrics want it."""

from dataclasses import replace

import numpy as np
import pytest
from blocks import equal_sprockets, kind_of, run_blocks, shape_of
from raw import stepped

from warpchain.engine.pack import pack
from warpchain.results.channels import CHANNEL_NAMES, PartCounts, drive_frame_width, frame_with_channels
from warpchain.results.schedule import Schedule

FOREVER = 10**8


@pytest.mark.long
def test_blocks_write_the_force_that_the_cpu_writes_without_metrics(fibers):
    variants = [equal_sprockets()[0].with_values({"chain.elongation": -1e-3})]
    schedules = [Schedule(drive.run.step, 200, FOREVER, FOREVER, 20) for drive in variants]
    packed = replace(pack(variants, schedules), frame=frame_with_channels(CHANNEL_NAMES))
    size = 11 * drive_frame_width(variants[0], packed.frame)
    serial, theirs = stepped(packed, 201, values=size)
    ours = serial.frame_buffer(size)
    ours.fill_(np.nan)
    run_blocks(packed, kind_of(packed, shape_of(variants, 1), measuring=False), [201], [0], ours)
    forces = [
        packed.frame.split_frames(frames.numpy()[:size].reshape(11, -1), PartCounts.of_drive(variants[0]))["hub_force"]
        for frames in (ours, theirs)
    ]
    assert np.abs(forces[1][1:]).max() > 100.0
    # the same forces in another order of summing, contacts amplify its round-off
    np.testing.assert_allclose(*forces, atol=1e-9 * np.abs(forces[1]).max())
