"""The table of channels: what follows from it, and what a new channel takes."""

import dataclasses
import inspect
import subprocess
import sys

import numpy as np
import pytest
from drives import two_sprockets
from grown import ROOT, followed, run_in

from warpchain import Record, Trajectory, dumps_drive, simulate
from warpchain.results.channels import (
    CHANNEL_NAMES,
    CHANNELS,
    DEFAULT_CHANNELS,
    DEFAULT_FRAME,
    ROLLER_CHANNELS,
    Channel,
    FrameLayout,
    PartCounts,
    drive_frame_width,
    frame_with_channels,
)

USED = """
import sys
import numpy as np
import pyarrow.types
import warpchain
from warpchain import Record, load_drive, read_archive, simulate

drive = load_drive(sys.argv[1])
run = simulate(drive, duration=0.005, device="cpu", record=Record(rate=20000.0))
one = run[0]
x, v = one.position, one.velocity
d, w = np.roll(x, -1, axis=1) - x, np.roll(v, -1, axis=1) - v
stretching = (d * w).sum(axis=2) / np.linalg.norm(d, axis=2)
assert one.elongation_rate.shape == one.tension.shape
# rk4 has positions and velocities of the frame's instant: only sums of two products are rounded apart
np.testing.assert_allclose(one.elongation_rate, stretching, rtol=0.0, atol=1e-12)
assert np.abs(one.elongation_rate).max() > 0.0
assert one.to_arrow().schema.field("elongation_rate").metadata == {b"unit": b"m/s"}
assert one.to_xarray()["elongation_rate"].dims == ("time", "link")
warpchain.write_archive(run, "grown.mcap")
back = read_archive("grown.mcap")
for name, values in one.channels().items():
    np.testing.assert_array_equal(getattr(back[0], name), values)
assert "elongation_rate" in back[0].channels()
part = simulate(drive, duration=0.005, device="cpu", record=Record(channels=["elongation_rate"]))
assert list(part[0].channels()) == ["elongation_rate"]
np.savez("was.npz", **one.channels())
"""


@pytest.mark.long
def test_the_recipe_of_a_channel(tmp_path):
    folder = followed(tmp_path, "A new channel", ["warpchain/results/channels.py", "kernels/frames.py"])
    drive = two_sprockets(integrator="rk4", settle="false")
    (tmp_path / "drive.toml").write_text(dumps_drive(drive))
    run_in(folder, USED, tmp_path / "drive.toml")
    mine = simulate(drive, duration=0.005, device="cpu", record=Record(rate=20000.0))[0]
    with np.load(tmp_path / "was.npz") as theirs:  # the others stay as they are
        for name, values in mine.channels().items():
            np.testing.assert_array_equal(theirs[name], values)


def test_a_trajectory_holds_every_channel():
    names = [field.name for field in dataclasses.fields(Trajectory)]
    assert names == ["drive", "time", *CHANNEL_NAMES, "window", "chain"]
    for channel in CHANNELS:
        held = Trajectory(two_sprockets(), np.zeros(1), **{channel.name: np.zeros((1, 1))}).channels()
        assert list(held) == [channel.name]
        assert f"    {channel.name}: (F, " in inspect.getdoc(Trajectory)


def test_what_is_on_request_takes_no_room_unless_asked_for():
    assert tuple(name for name in CHANNEL_NAMES if name not in DEFAULT_CHANNELS) == (
        "joint_friction_power",
        "hub_force",
    )
    assert frame_with_channels(DEFAULT_CHANNELS) == DEFAULT_FRAME
    assert Record().channels == DEFAULT_CHANNELS
    drive = two_sprockets()
    assert (
        drive_frame_width(drive, frame_with_channels(CHANNEL_NAMES)) - drive_frame_width(drive)
        == drive.chain.links + 2 * 2
    )


def test_channels_of_rollers_share_no_field():
    fields = [field for channel in ROLLER_CHANNELS for field in channel.value_names]
    assert len(set(fields)) == len(fields)


def test_places_of_a_frame():
    small = FrameLayout(
        (
            Channel("a", "m", "roller", "", ("x", "y")),
            Channel("b", "rad", "sprocket", ""),
            Channel("c", "N", "link", ""),
            Channel("d", "m", "sprocket", "", ("x", "y")),
        )
    )
    assert (small.values("roller"), small.values("sprocket"), small.frame_width(PartCounts(4, 2))) == (3, 3, 18)
    assert [small.place(name) for name in "abcd"] == [0, 0, 2, 1]
    found = small.split_frames(np.arange(36).reshape(2, 18), PartCounts(4, 2))
    np.testing.assert_array_equal(found["a"][1], 18 + np.array([[0, 4], [1, 5], [2, 6], [3, 7]]))
    np.testing.assert_array_equal(found["c"][0], [8, 9, 10, 11])
    np.testing.assert_array_equal(found["b"][0], [12, 15])
    np.testing.assert_array_equal(found["d"][0], [[13, 14], [16, 17]])
    assert hash(small) != hash(DEFAULT_FRAME)


@pytest.mark.parametrize(
    ("asked", "names"), [((), DEFAULT_CHANNELS), (CHANNEL_NAMES, CHANNEL_NAMES)], ids=["default", "all"]
)
def test_frames_have_room_for_every_channel(asked, names):
    drive, frame = two_sprockets(), frame_with_channels(asked)
    width = drive_frame_width(drive, frame)
    found = frame.split_frames(np.arange(2 * width).reshape(2, -1), PartCounts.of_drive(drive))
    assert list(found) == list(names)
    for channel in CHANNELS:
        if channel.name not in names:
            assert channel.on_request
            continue
        assert found[channel.name].shape == (2, *channel.shape(PartCounts.of_drive(drive)))
        assert len(channel.dimensions) == found[channel.name].ndim
    every = np.concatenate([values.reshape(-1) for values in found.values()])
    np.testing.assert_array_equal(np.sort(every), np.arange(2 * width))  # each value once


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_kernels_write_every_value_of_a_frame(precision):
    from warpchain.engine.cpu import CpuEngine
    from warpchain.engine.pack import pack
    from warpchain.results.schedule import Schedule

    drive = two_sprockets()
    engine = CpuEngine(pack([drive], [Schedule(drive.run.step, 20, 0, 20, 10)]).at_precision(precision), 1)
    frames = engine.frame_buffer(3 * drive_frame_width(drive) + 1)
    frames.fill_(np.nan)
    for future in engine.advance(21, frames):
        future.result()
    engine.close()
    assert np.isfinite(frames.numpy()[:-1]).all()
    assert np.isnan(frames.numpy()[-1])


def test_the_tables_in_the_documents_are_up_to_date():
    script = ROOT.parent / "scripts" / "docs.py"
    done = subprocess.run([sys.executable, script, "tables", "--check"], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "")
