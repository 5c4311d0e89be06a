"""Archives that another program wrote anew: whatever index it leaves out, which MCAP permits, the run is the same."""

import resource
import struct
import zlib

import numpy as np
import pytest
import zstandard
from archives import assert_same
from command import run as command
from drives import of_long, two_sprockets
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType, Writer

from warpchain import Record, read_archive, simulate, write_archive
from warpchain.archive.archive_parts import _arrow_bytes
from warpchain.archive.recover import _FileCopy, recover_archive
from warpchain.errors import ArchiveError, WarpchainError


def rewrite(source, target, keep=lambda name: True, counted=True, early=False, metrics=None, **options):
    """Writes an archive anew with the mcap package: topics, attachments and metadata that `keep` lets pass.

    Its own reader gives messages in order of time: variants and topics are mixed; the rest comes behind, or `early`.
    """
    with source.open("rb") as stream, target.open("wb") as out:
        reader, writer, numbers = make_reader(stream), Writer(out, **{"chunk_size": 20_000} | options), {}
        writer.start()

        def add_rest():
            for attachment in filter(lambda attached: keep(attached.name), reader.iter_attachments()):
                data = metrics if metrics and attachment.name == "metrics.arrow" else attachment.data
                writer.add_attachment(0, 0, attachment.name, attachment.media_type, data)
            for record in filter(lambda metadata: keep(metadata.name), reader.iter_metadata()):
                writer.add_metadata(record.name, record.metadata)

        if early:
            add_rest()
        for schema, channel, message in reader.iter_messages():
            if not keep(channel.topic):
                continue
            if channel.id not in numbers:
                kind = writer.register_schema(schema.name, schema.encoding, schema.data)
                told = (channel.topic, channel.message_encoding, kind, channel.metadata)
                numbers[channel.id] = writer.register_channel(*told)
            held = (message.log_time, message.data, message.publish_time, message.sequence * counted)
            writer.add_message(numbers[channel.id], *held)
        if not early:
            add_rest()
        writer.finish()
    return target


@pytest.fixture(scope="module")
def run():
    first = two_sprockets(duration=0.001, settle="false")
    second = first.with_values({"sprockets.driver.prescribed.speed": 12.0})
    return simulate([first, second], record=Record(rate=2e4))


@pytest.fixture(scope="module")
def archive(run, tmp_path_factory):
    return write_archive(run, tmp_path_factory.mktemp("rewritten") / "a.mcap")


NOTHING = {
    "index_types": IndexType.NONE,
    "use_statistics": False,
    "repeat_channels": False,
    "repeat_schemas": False,
    "use_summary_offsets": False,
}
OPTIONS = {
    "all": {},
    "no chunks": {"use_chunking": False},
    "no chunks, one checksum": {"use_chunking": False, "enable_data_crcs": True},
    "no channels": {"repeat_channels": False},
    "no schemas": {"repeat_schemas": False},
    "no channels, no schemas": {"repeat_channels": False, "repeat_schemas": False},
    **{f"no {kind.name} index": {"index_types": IndexType.ALL & ~kind} for kind in IndexType if kind & IndexType.ALL},
    "no index": {"index_types": IndexType.NONE},
    "no statistics": {"use_statistics": False},
    "no offsets": {"use_summary_offsets": False},
    "no checksums": {"enable_crcs": False},
    "checksum of the data": {"enable_data_crcs": True},
    "no compression": {"compression": CompressionType.NONE},
    "lz4": {"compression": CompressionType.LZ4},
    "no summary": NOTHING,
    "no summary, no chunks": NOTHING | {"use_chunking": False},
    "no summary, no checksums, lz4": NOTHING | {"enable_crcs": False, "compression": CompressionType.LZ4},
}
"""What mcap's writer may leave out of a file, or write otherwise."""


@pytest.mark.parametrize("options", OPTIONS.values(), ids=OPTIONS.keys())
def test_whatever_the_writer_leaves_out_the_run_is_the_same(run, archive, tmp_path, options):
    other = rewrite(archive, tmp_path / "b.mcap", **options)
    back = read_archive(other)
    assert_same(run, back)
    part, whole = (read_archive(path).read(1, 0.0004, 0.0006) for path in (other, archive))
    np.testing.assert_array_equal(part.time, whole.time)
    np.testing.assert_array_equal(part.position, whole.position)
    result = recover_archive(other, tmp_path / "c.mcap")
    assert result.is_complete and not result.lost
    assert result.frames == {variant: len(run[variant].time) for variant in run}
    assert_same(run, read_archive(tmp_path / "c.mcap"))


@pytest.mark.parametrize("options", ["all", "no chunks", "no index", "no summary"])
def test_messages_without_numbers_are_counted(run, archive, tmp_path, options):
    """`sequence` is optional in MCAP, too: frames are told apart by their times."""
    other = rewrite(archive, tmp_path / "b.mcap", counted=False, **OPTIONS[options])
    assert_same(run, read_archive(other))
    assert recover_archive(other, tmp_path / "c.mcap").is_complete
    assert_same(run, read_archive(tmp_path / "c.mcap"))


@pytest.mark.parametrize("options", ["no chunks", *of_long("no index", "no summary")])
def test_commands_take_what_another_program_wrote(run, archive, tmp_path, capsys, options):
    other = rewrite(archive, tmp_path / "b.mcap", **OPTIONS[options])
    tables = []
    for path in (archive, other):
        table, page, scene = (tmp_path / f"{path.stem}.{ending}" for ending in ("csv", "html", "rrd"))
        assert command(capsys, "export", path, "--variant", "1", "-o", table)[0] == 0
        assert command(capsys, "view", path, "--save", scene)[0] == 0
        assert command(capsys, "report", path, "-o", page)[0] == 0
        tables.append(table.read_text())
        assert scene.stat().st_size > 10_000 and page.stat().st_size > 10_000
    assert tables[0] == tables[1]


def check_told(path, run, folder):
    """Whatever is read of a damaged file is the run's own, and whatever is not is told; returns how often it was."""
    told = 0
    for recover in (False, True):
        try:
            result = recover_archive(path, folder / "c.mcap", overwrite=True) if recover else None
            back = read_archive(folder / "c.mcap" if recover else path)
            for variant in run:
                frames = back[variant].channels()
                kept = np.isin(run[variant].time, back[variant].time)
                assert kept.all() or (result and not result.is_complete)
                for name, values in frames.items():
                    np.testing.assert_array_equal(values, getattr(run[variant], name)[kept], err_msg=name)
        except WarpchainError as error:
            assert "\n" not in str(error)
            told += 1
    return told


@pytest.mark.parametrize("options", ["no chunks, one checksum", "no index", "no summary"])
def test_one_flipped_bit_of_a_rewritten_file_is_told(run, archive, tmp_path, options):
    """Of messages outside of chunks only the one checksum of all data tells; a chunk has its own."""
    data = rewrite(archive, tmp_path / "b.mcap", **OPTIONS[options]).read_bytes()
    rng, told = np.random.default_rng(4), 0
    for offset in rng.choice(len(data), 40, replace=False):
        damaged = bytearray(data)
        damaged[offset] ^= 1 << rng.integers(8)
        (tmp_path / "b.mcap").write_bytes(damaged)
        told += check_told(tmp_path / "b.mcap", run, tmp_path)
    assert told > 20


@pytest.mark.parametrize("bit", range(4))
def test_a_topic_whose_number_changed_takes_no_frames_of_another(run, archive, tmp_path, bit):
    """Without any checksum: channels are renumbered, so that no digest knows the right number."""
    options = {"use_chunking": False, "enable_crcs": False, "repeat_channels": False}
    data = bytearray(rewrite(archive, tmp_path / "b.mcap", **options).read_bytes())
    place = data.index(b"/variant/00001/rollers") - 8  # behind the channel's and its schema's numbers, a length
    data[place] ^= 1 << bit
    (tmp_path / "b.mcap").write_bytes(data)
    with pytest.raises(ArchiveError, match=r"two channels of the number|no record describes the channel"):
        read_archive(tmp_path / "b.mcap")
    with pytest.raises(ArchiveError, match="nothing can be restored"):
        recover_archive(tmp_path / "b.mcap", tmp_path / "c.mcap")


def test_messages_that_their_checksum_denies_are_not_restored(run, archive, tmp_path):
    """The frames of one bit, in the middle of a file of which only a whole checksum speaks."""
    data = bytearray(rewrite(archive, tmp_path / "b.mcap", **OPTIONS["no chunks, one checksum"]).read_bytes())
    data[data.index(b"/variant/00000/rollers") + 50_000] ^= 1
    (tmp_path / "b.mcap").write_bytes(data)
    with pytest.raises(ArchiveError, match=r"is damaged .the checksum .CRC. of its data is wrong"):
        read_archive(tmp_path / "b.mcap")
    with pytest.raises(ArchiveError, match="holds no whole chunk of frames"):
        recover_archive(tmp_path / "b.mcap", tmp_path / "c.mcap")


@pytest.mark.parametrize("options", [{"use_chunking": False}, {"repeat_channels": False}], ids=["loose", "chunks"])
def test_a_cut_file_gives_what_is_whole(run, archive, tmp_path, options):
    """A frame lies in several messages here; one of which not all are there is left out."""
    data = rewrite(archive, tmp_path / "b.mcap", early=True, **options).read_bytes()
    for part in (0.55, 0.7, 0.85):
        (tmp_path / "b.mcap").write_bytes(data[: int(part * len(data))])
        result = recover_archive(tmp_path / "b.mcap", tmp_path / "c.mcap", overwrite=True)
        back = read_archive(tmp_path / "c.mcap")
        for variant in run:
            count = len(back[variant].time)
            assert result.frames[variant] == count < len(run[variant].time)
            np.testing.assert_array_equal(back[variant].position, run[variant].position[:count])
    assert count > 10


def test_mixed_messages_are_sorted_in_bounded_memory(run, archive, tmp_path, monkeypatch):
    """What is held is written whenever it exceeds the bound, here after each chunk, in which all variants are mixed."""
    held = []

    def noting(copy, owners):
        held.append(sum(map(len, copy._mixed.values())))
        plain(copy, owners)

    plain = _FileCopy._write_mixed_chunks
    monkeypatch.setattr(_FileCopy, "_write_mixed_chunks", noting)
    monkeypatch.setattr("warpchain.archive.recover.MOST_MIXED_BYTES", 2**14)
    rewrite(archive, tmp_path / "b.mcap")
    assert_same(run, read_archive(recover_archive(tmp_path / "b.mcap", tmp_path / "whole.mcap").path))
    assert len(held) > 4 and max(held) < 2**17  # the bound, a chunk, and a message that exceeds it


def test_a_small_file_without_index_that_opens_to_gigabytes_is_refused(tmp_path):
    """Where chunks are read through to find what is in them, each is bounded as ever."""
    bomb = zstandard.compress(bytes(2**30))
    for size in (2**30, 2**28, 1000):
        chunk = struct.pack("<QQQII", 0, 0, size, 0, 4) + b"zstd" + struct.pack("<Q", len(bomb)) + bomb
        data = b"\x89MCAP0\r\n" + struct.pack("<BQ", 6, len(chunk)) + chunk + struct.pack("<BQI", 15, 4, 0)
        footer = struct.pack("<BQQQ", 2, 20, 0, 0)
        data += footer + struct.pack("<I", zlib.crc32(footer)) + data[:8]
        (tmp_path / "b.mcap").write_bytes(data)
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        with pytest.raises(ArchiveError, match="is damaged"):
            read_archive(tmp_path / "b.mcap")
        assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 2**20 // 8  # kilobytes: 128 MiB


LEFT_OUT = {
    "drives": (lambda name: not name.startswith("drives/"), None),
    "a drive": (lambda name: not name.startswith("drives/00001"), "lacks its attachment drives/00001.toml"),
    "frames": (lambda name: "/variant/00001/" not in name, "lacks its frames"),
    "states": (lambda name: name != "/variant/00001/state", "lacks its frames"),
    "rollers": (lambda name: name != "/variant/00001/rollers", "lacks its frames"),
}


@pytest.mark.parametrize(("keep", "why"), LEFT_OUT.values(), ids=LEFT_OUT.keys())
@pytest.mark.parametrize("options", ["all", "no index"])
def test_what_cannot_be_read_is_never_called_restored(run, archive, tmp_path, capsys, keep, why, options):
    other = rewrite(archive, tmp_path / "b.mcap", keep, **OPTIONS[options])
    status, out, err = command(capsys, "recover", other, "-o", tmp_path / "c.mcap")
    if why is None:  # nothing can be opened, so nothing is written
        assert status == 2 and "no variant of it can be read" in err[0] and "drives/00000.toml" in err[0]
        assert not (tmp_path / "c.mcap").exists()
        return
    assert status == 1 and f"; lost: variant 1 ({why})" in out[0]
    assert out[0].startswith(f"{len(run[0].time)} frames of 1 variant in")
    back = read_archive(tmp_path / "c.mcap")
    np.testing.assert_array_equal(back[0].position, run[0].position)
    with pytest.raises(WarpchainError):
        back[1]
    if "frames" in why:
        with pytest.raises(ArchiveError, match="lacks the frames of variant 1, which the run recorded"):
            read_archive(other)[1]


@pytest.mark.parametrize("metrics", [None, b"no table", "of another run"])
def test_metrics_that_are_missing_or_wrong_cost_nothing_else(run, archive, tmp_path, metrics):
    if metrics == "of another run":
        metrics = _arrow_bytes(run.metrics.take([0, 1, 1]))
    keep = (lambda name: name != "metrics.arrow") if metrics is None else (lambda name: True)
    other = rewrite(archive, tmp_path / "b.mcap", keep, metrics=metrics)
    with pytest.raises(ArchiveError, match="metrics"):
        read_archive(other)
    result = recover_archive(other, tmp_path / "c.mcap")
    assert result.left_out == ["attachment metrics.arrow"]
    back = read_archive(tmp_path / "c.mcap")
    assert back.metrics.column_names == ["variant"]
    np.testing.assert_array_equal(back[1].position, run[1].position)
