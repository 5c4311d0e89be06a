"""Archives: the same trajectories back, bitwise; whole files only; one line for each refusal."""

import importlib.util

import numpy as np
import pytest
from archives import assert_same, unlike
from blocks import trains
from drives import timing, two_sprockets
from rerun_check import rerun_accepts

from warpchain import Record, read_archive, simulate, write_archive
from warpchain.archive import ArchiveOptions
from warpchain.archive.recover import recover_archive
from warpchain.errors import ArchiveError, SimulationError
from warpchain.model import single_chain
from warpchain.results.channels import BODY_CHANNELS, CHANNEL_NAMES, DEFAULT_CHANNELS


@pytest.fixture(scope="module")
def run():
    return simulate(unlike())


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_float64_comes_back_bitwise(run, tmp_path, compression):
    path = write_archive(run, tmp_path / "a.mcap", options=ArchiveOptions(compression=compression))
    back = read_archive(path)
    assert_same(run, back)
    assert back.info == run.info


BODIES = tuple(channel.name for channel in BODY_CHANNELS if channel.per != "sprocket")
SOME = Record(variants=[1], channels=("tension", "sprocket_speed"))


@pytest.mark.parametrize(
    ("settings", "variants", "channels"),
    [
        ({"precision": "float32"}, [0, 1], DEFAULT_CHANNELS),
        ({"record": SOME}, [1], SOME.channels),
        ({"record": Record("none")}, [], ()),
    ],
    ids=["float32", "some", "metrics alone"],
)
def test_whatever_was_recorded_comes_back_bitwise(tmp_path, settings, variants, channels):
    kept = simulate(unlike(), **settings)
    back = read_archive(write_archive(kept, tmp_path / "a.mcap"))
    assert_same(kept, back)
    assert list(back) == variants
    for variant in variants:
        assert {name for name in CHANNEL_NAMES if getattr(back[variant], name) is not None} == set(channels) - set(
            BODIES
        )
        assert back[variant].tension.dtype == settings.get("precision", "float64")


@pytest.mark.parametrize("variant", [7, -1])
def test_a_variant_that_is_not_there_is_one_line(run, tmp_path, variant):
    back = read_archive(write_archive(run, tmp_path / "a.mcap"))
    for read in (back.__getitem__, back.read):
        with pytest.raises(SimulationError, match=f"variant {variant} was not recorded"):
            read(variant)


def test_streamed_while_running_equals_written_afterwards(run, tmp_path, monkeypatch):
    monkeypatch.setattr("warpchain.engine.subensemble.LAUNCH_WORK", 60 * 101)
    streamed = simulate(unlike(), archive=tmp_path / "s.mcap")
    assert_same(run, streamed)
    assert [path.name for path in tmp_path.iterdir()] == ["s.mcap"]


def test_rerun_accepts_the_file(run, tmp_path):
    assert rerun_accepts(write_archive(run, tmp_path / "a.mcap"))


def test_foxglove_and_ros_decoders_read_every_message(run, tmp_path):
    from mcap.reader import make_reader
    from mcap_protobuf.decoder import DecoderFactory as Protobuf
    from mcap_ros2.decoder import DecoderFactory as Ros2

    path = write_archive(run, tmp_path / "a.mcap")
    trajectory, clouds, joints = run[0], [], []
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[Protobuf(), Ros2()])
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            if channel.topic == "/variant/00000/rollers":
                assert schema.name == "foxglove.PointCloud"
                clouds.append((message.log_time, decoded))
            elif channel.topic == "/variant/00000/sprockets":
                joints.append(decoded)
    assert len(clouds) == len(joints) == len(trajectory.time)
    last, cloud = clouds[-1]
    assert last == round(trajectory.time[-1] * 1e9)
    assert cloud.timestamp.ToNanoseconds() == last
    assert [field.name for field in cloud.fields][:3] == ["x", "y", "z"]
    x = np.ndarray((60,), "<f8", cloud.data, 0, (cloud.point_stride,))
    np.testing.assert_array_equal(x, trajectory.position[-1, :, 0])
    assert list(joints[-1].name) == ["driver", "driven"]
    np.testing.assert_array_equal(joints[-1].velocity, trajectory.sprocket_speed[-1])


def test_foxglove_draws_the_outlines(run, tmp_path):
    from google.protobuf.descriptor_pb2 import FileDescriptorSet
    from mcap.reader import make_reader
    from mcap_protobuf.decoder import DecoderFactory

    path = write_archive(run, tmp_path / "a.mcap")
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        scenes = list(reader.iter_decoded_messages(topics=["/variant/00001/scene"]))
        turns = [part[3].transforms for part in reader.iter_decoded_messages(topics=["/variant/00001/transforms"])]
    ((schema, _, message, scene),) = scenes
    described = {file.name for file in FileDescriptorSet.FromString(schema.data).file}
    assert {"foxglove/SceneUpdate.proto", "foxglove/LinePrimitive.proto", "google/protobuf/duration.proto"} <= described
    assert (schema.name, message.log_time) == ("foxglove.SceneUpdate", 0)
    drive, trajectory = run.drives[1], run[1]
    assert [entity.id for entity in scene.entities] == ["sprocket/driver", "sprocket/driven"]
    assert len(turns) == len(trajectory.time)
    for s, entity in enumerate(scene.entities):
        teeth, circle = (np.array([(p.x, p.y) for p in line.points]) for line in entity.lines)
        turn = turns[-1][s]
        assert (turn.parent_frame_id, turn.child_frame_id) == ("drive", entity.frame_id)
        assert turn.timestamp.ToNanoseconds() == round(trajectory.time[-1] * 1e9)
        assert (turn.translation.x, turn.translation.y) == drive.sprockets[s].center
        twist = complex(turn.rotation.w, turn.rotation.z) ** 2  # a unit quaternion about z
        assert twist == pytest.approx(np.exp(1j * trajectory.sprocket_angle[-1, s]), abs=1e-14)
        teeth = teeth @ np.array([[twist.real, twist.imag], [-twist.imag, twist.real]]) + drive.sprockets[s].center
        radius = np.hypot(*circle.T)
        np.testing.assert_allclose(radius, single_chain(drive).pitch_radius(s), rtol=1e-14)
        # a seated roller plays in its seat arc, whose radius is the roller's and the clearance
        play = drive.contact.sprocket.clearance
        seat = drive.chain.roller_radius + play
        away = np.hypot(*(trajectory.position[-1, :, None] - teeth).transpose(2, 0, 1)).min(axis=1)
        assert away.min() == pytest.approx(seat, abs=play)
        assert sum(away < 1.01 * seat) >= drive.sprockets[s].teeth // 2 - 2


def test_descriptors_are_those_that_foxglove_publishes():
    messages = pytest.importorskip("foxglove.messages")
    from google.protobuf.descriptor_pb2 import FileDescriptorSet

    from warpchain.archive.archive_format import descriptor_set_bytes, message_class

    for name in ("foxglove.PointCloud", "foxglove.SceneUpdate"):
        published = FileDescriptorSet.FromString(getattr(messages, name.split(".")[1]).get_schema().data)
        mine = {
            file.name: file for file in FileDescriptorSet.FromString(descriptor_set_bytes(message_class(name))).file
        }
        assert published.file
        for file in published.file:
            for field in (*file.message_type[0].field, *mine[file.name].message_type[0].field):
                field.ClearField("json_name")  # what a compiler adds
            assert file.message_type == mine[file.name].message_type, file.name


def test_metadata_tells_how_the_run_was_made(run, tmp_path):
    from dataclasses import replace

    told = replace(run, info=replace(run.info, seed=7))
    back = read_archive(write_archive(told, tmp_path / "a.mcap"))
    assert back.info == told.info
    assert back.info.step == run.drives[0].run.step
    options = ArchiveOptions(seed=8)
    assert read_archive(write_archive(told, tmp_path / "b.mcap", options=options)).info.seed == 8
    held = back.metadata
    assert held["step"] == repr(run.info.step)
    assert (held["device"], held["precision"], held["seed"]) == ("cpu", "float64", "7")
    assert "warp-lang " in held["versions"] and "python " in held["versions"]


def test_existing_file_is_kept_unless_told_otherwise(run, tmp_path):
    path = tmp_path / "a.mcap"
    path.write_text("mine")
    with pytest.raises(ArchiveError, match=r"exists already.*overwrite"):
        write_archive(run, path)
    assert path.read_text() == "mine"
    with pytest.raises(ArchiveError, match="is a folder"):
        write_archive(run, tmp_path, overwrite=True)
    write_archive(run, path, overwrite=True)
    assert_same(run, read_archive(path))


def test_an_error_on_the_way_leaves_nothing(run, tmp_path):
    from warpchain.archive import ArchiveWriter

    with pytest.raises(ZeroDivisionError), ArchiveWriter(tmp_path / "a.mcap", run.drives, [0], run.info) as writer:
        writer.append(0, run[0])
        1 / 0  # noqa: B018
    assert list(tmp_path.iterdir()) == []


def test_a_run_refused_for_memory_leaves_nothing(tmp_path):
    with pytest.raises(SimulationError, match="memory budget"):
        simulate(unlike(), archive=tmp_path / "a.mcap", memory=1000)
    assert list(tmp_path.iterdir()) == []


@pytest.fixture(scope="module")
def with_bodies(tmp_path_factory):
    """A run in memory, and the same one archived."""
    drive, archive = timing(**{"run.duration": 2e-3}), tmp_path_factory.mktemp("bodies") / "a.mcap"
    kept = simulate(drive, record=Record(rate=1e4), device="cpu")
    simulate(drive, record=Record(rate=1e4), device="cpu", archive=archive)
    return kept, archive


def test_channels_of_bodies_come_back(with_bodies):
    kept, archive = with_bodies
    assert_same(kept, read_archive(archive))
    found = read_archive(archive)[0]
    assert {name for name in BODIES if not name.startswith(("shaft", "coupling", "valve"))} <= set(found.channels())
    assert found.arm_angle.shape == found.chamber_pressure.shape == (21, 1)
    assert np.ptp(found.arm_angle) > 0.0 and found.chamber_pressure.min() > 1e5


def test_a_recovered_archive_has_them_too(with_bodies, tmp_path):
    kept, archive = with_bodies
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(archive.read_bytes()[:-200])
    recover_archive(cut, tmp_path / "whole.mcap")
    np.testing.assert_array_equal(read_archive(tmp_path / "whole.mcap")[0].arm_angle, kept[0].arm_angle)


def test_channels_of_shafts_and_couplings_come_back(tmp_path):
    kept = simulate(trains()[0].with_values({"run.duration": 2e-3}), record=Record(rate=1e4), device="cpu")
    found = read_archive(write_archive(kept, tmp_path / "a.mcap"))
    assert_same(kept, found)
    assert found[0].shaft_speed.shape == (len(found[0].time), 3)
    assert found[0].coupling_twist.shape == (len(found[0].time), 2)
    assert np.ptp(found[0].coupling_torque[:, 1]) > 0.0
    table = found[0].to_xarray() if importlib.util.find_spec("xarray") else None
    assert table is None or list(table["coupling"].values) == ["cush", "slack"]


def test_a_drive_without_bodies_has_no_such_channel(tmp_path):
    run = simulate(two_sprockets(duration=1e-4), record=Record(rate=1e5), device="cpu")
    assert not set(BODIES) & set(run[0].channels()) and run[0].arm_angle is None
