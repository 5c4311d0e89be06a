"""A piece of an archive is an archive of its own: the same bits, whole, read by other programs."""

import dataclasses

import mcap_protobuf.decoder
import numpy as np
import pytest
from archives import unlike
from blocks import trains
from command import refused
from command import run as command
from drives import timing
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory as RosDecoders
from rerun_check import rerun_accepts

from warpchain import Record, read_archive, simulate, write_archive
from warpchain.archive import ArchiveOptions
from warpchain.archive.cut import cut_archive
from warpchain.archive.recover import recover_archive
from warpchain.errors import ArchiveError


def several():
    """A run of three variants in a study's numbers, with an attachment."""
    run = simulate([*unlike(), unlike()[0].with_values({"run.duration": 0.004})])
    return run, {"numbers": [3, 5, 17], "attachments": {"study.toml": b"a study"}, "seed": 7}


@pytest.fixture(scope="module")
def run():
    return several()


def assert_piece(piece, whole, variants, start, end):
    """Trajectories of the piece have the bits that the whole has between two times."""
    assert list(piece) == variants
    for variant in variants:
        mine, theirs = piece[variant], whole.read(variant, start, end)
        np.testing.assert_array_equal(mine.time, theirs.time)
        assert mine.channels().keys() == theirs.channels().keys() and len(mine.time)
        for name, values in mine.channels().items():
            assert values.dtype == theirs.channels()[name].dtype
            np.testing.assert_array_equal(values, theirs.channels()[name], err_msg=name)
        assert piece.drives[piece.row_of(variant)] == whole.drives[whole.row_of(variant)]


@pytest.mark.parametrize(
    "options",
    [{}, {"values": "float32"}, {"values": "float32", "exact_positions": True}, {"split_variants": 1}],
    ids=["float64", "packed", "exact positions", "a set"],
)
def test_some_variants_between_two_times(run, tmp_path, options):
    found, given = run
    source = write_archive(found, tmp_path / "a.mcap", options=ArchiveOptions(**given, **options))
    whole = read_archive(source)
    frames = cut_archive(source, tmp_path / "b.mcap", 0.001, 0.0025, [17, 3])
    piece = read_archive(tmp_path / "b.mcap")
    assert_piece(piece, whole, [3, 17], 0.001, 0.0025)
    assert frames == {variant: len(piece[variant].time) for variant in (3, 17)}
    # drives, metrics, attachments and the record of the run, of the variants that are kept
    assert piece.metrics.equals(whole.metrics.take([0, 2])) and list(piece.numbers) == [3, 17]
    assert piece.metrics.schema.equals(whole.metrics.schema, check_metadata=True)
    assert piece.attachment("study.toml") == b"a study" and piece.attachments == whole.attachments
    assert piece.info == whole.info and piece.info.seed == 7


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_channels_of_every_kind_and_precision(tmp_path, precision):
    record = Record(rate=1e4)
    for k, drive in enumerate((timing(**{"run.duration": 2e-3}), trains()[0].with_values({"run.duration": 2e-3}))):
        source = tmp_path / f"{k}.mcap"
        simulate(drive, record=record, device="cpu", precision=precision, archive=source)
        cut_archive(source, tmp_path / f"piece{k}.mcap", start=1e-3)
        assert_piece(read_archive(tmp_path / f"piece{k}.mcap"), read_archive(source), [0], 1e-3, None)


def test_all_of_it_again(run, tmp_path):
    """Without times and variants nothing is missing, variants that were not recorded included."""
    found, _ = run
    kept = dataclasses.replace(found, trajectories={1: found[1]})
    source = write_archive(kept, tmp_path / "a.mcap")
    cut_archive(source, tmp_path / "b.mcap")
    piece, whole = read_archive(tmp_path / "b.mcap"), read_archive(source)
    assert_piece(piece, whole, [1], None, None)
    assert len(piece.drives) == 3 and piece.metrics.equals(whole.metrics)


def test_other_readers_read_every_message(run, tmp_path):
    """The decoders of Foxglove and ROS, and Rerun; frames count from 0."""
    found, given = run
    source = write_archive(found, tmp_path / "a.mcap", options=ArchiveOptions(**given))
    cut_archive(source, tmp_path / "b.mcap", 0.001, 0.002, [5])
    count = len(read_archive(tmp_path / "b.mcap")[5].time)
    with (tmp_path / "b.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[mcap_protobuf.decoder.DecoderFactory(), RosDecoders()])
        seen = {}
        for _, channel, message, _ in reader.iter_decoded_messages():
            seen.setdefault(channel.topic, []).append(message)
    assert seen.keys() == {
        f"/variant/00005/{topic}" for topic in ("rollers", "state", "sprockets", "transforms", "scene")
    }
    for topic, messages in seen.items():
        if not topic.endswith("scene"):
            assert [message.sequence for message in messages] == list(range(count))
            assert 1_000_000 <= messages[0].log_time <= messages[-1].log_time <= 2_000_000
    assert rerun_accepts(tmp_path / "b.mcap")


def test_a_piece_that_is_damaged_is_recovered(run, tmp_path):
    found, given = run
    source = write_archive(found, tmp_path / "a.mcap", options=ArchiveOptions(**given))
    cut_archive(source, tmp_path / "b.mcap", 0.001)
    (tmp_path / "c.mcap").write_bytes((tmp_path / "b.mcap").read_bytes()[:-100])
    recover_archive(tmp_path / "c.mcap", tmp_path / "d.mcap")
    assert_piece(read_archive(tmp_path / "d.mcap"), read_archive(source), [3, 5, 17], 0.001, None)


def test_commands_read_the_piece(run, capsys, tmp_path):
    found, given = run
    source = write_archive(found, tmp_path / "a.mcap", options=ArchiveOptions(**given))
    piece = tmp_path / "b.mcap"
    status, out, err = command(capsys, "cut", source, "-o", piece, "--time", "1ms", 0.002, "--variants", 3, 17)
    count = sum(len(trajectory.time) for trajectory in read_archive(piece).trajectories.values())
    assert (status, out, err) == (0, [f"{piece}: {count} frames of 2 variants"], [])
    assert command(capsys, "export", piece, "-o", tmp_path / "b.csv", "--variant", 17)[0] == 0
    assert command(capsys, "view", piece, "--save", tmp_path / "b.rrd")[0] == 0
    status, _, err = command(capsys, "cut", source, "-o", piece)
    assert status == 2 and "exists" in err[0] and list(read_archive(piece)) == [3, 17]
    assert command(capsys, "cut", source, "-o", piece, "--overwrite")[0] == 0


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["--time", 1, 2], "variant 3 has no frame from 1 s to 2 s; it has 0 to 0.003 s"),
        (["--time", 0.002, 0.001], "--time 0.002 0.001: must be START END with START at most END"),
        (["--time", "nan", 1], "'nan': must be a finite number of s"),
        (["--variants", 4], "variant 4"),
        (["--variants", -1], "variant -1"),
        (["--variants", "x"], "invalid int value: 'x'"),
    ],
)
def test_mistakes_are_one_line_and_leave_nothing(run, capsys, tmp_path, words, line):
    found, given = run
    source = write_archive(found, tmp_path / "a.mcap", options=ArchiveOptions(**given))
    assert line in refused(capsys, "cut", source, "-o", tmp_path / "b.mcap", *words)
    assert [path.name for path in tmp_path.iterdir() if "mcap" in path.name and "lock" not in path.name] == ["a.mcap"]


def test_an_archive_is_not_cut_into_itself(run, tmp_path):
    found, given = run
    source = write_archive(found, tmp_path / "a.mcap", options=ArchiveOptions(**given))
    before = source.read_bytes()
    with pytest.raises(ArchiveError, match="is the archive that is cut"):
        cut_archive(source, source, overwrite=True)
    assert source.read_bytes() == before


def test_a_damaged_chunk_is_told_and_leaves_nothing(run, tmp_path):
    found, given = run
    source = write_archive(found, tmp_path / "a.mcap", options=ArchiveOptions(**given, compression="none"))
    data = bytearray(source.read_bytes())
    data[len(data) // 2] ^= 1
    (tmp_path / "broken.mcap").write_bytes(data)
    with pytest.raises(ArchiveError, match="damaged"):
        cut_archive(tmp_path / "broken.mcap", tmp_path / "b.mcap")
    assert not (tmp_path / "b.mcap").exists()
