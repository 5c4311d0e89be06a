"""Recovery of cut archives: whole chunks come back bitwise, nothing is made up, and nothing is silently empty."""

import os
import signal
import struct
import subprocess
import sys
import zlib

import numpy as np
import pytest
from archives import assert_same, unlike
from command import run as command
from drives import of_long, two_sprockets
from rerun_check import rerun_accepts
from small_disk import small_disk
from waiting import bytes_in, wait_for

from warpchain import Record, read_archive, simulate, write_archive
from warpchain.archive import ArchiveOptions
from warpchain.archive.mcap_write import McapWriter
from warpchain.archive.recover import recover_archive
from warpchain.errors import ArchiveError, WarpchainError


@pytest.fixture(scope="module")
def run():
    return simulate(unlike(), record=Record(rate=1e5))


@pytest.fixture(scope="module")
def whole(run, tmp_path_factory):
    """An archive of many chunks, and where each of them ends."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("warpchain.archive.writer.CHUNK_BYTES", 2**16)
        path = write_archive(run, tmp_path_factory.mktemp("whole") / "a.mcap")
    file = read_archive(path).trajectories.files[0]
    assert len(file.chunks) > 20
    return path.read_bytes(), [chunk.offset + chunk.length for chunk in file.chunks if len(chunk.channels) > 1]


def frames_of(path, run):
    """Frames of each variant, after a check that they are the run's own."""
    back = read_archive(path)
    assert back.info.ended == "recovered"
    for variant in back:
        count = len(back[variant].time)
        np.testing.assert_array_equal(back[variant].time, run[variant].time[:count])
        for name, values in back[variant].channels().items():
            np.testing.assert_array_equal(values, getattr(run[variant], name)[:count], err_msg=name)
    return [len(back[variant].time) for variant in back]


def test_cut_anywhere_everything_up_to_the_last_whole_chunk_comes_back(run, whole, tmp_path):
    data, ends = whole
    broken, before = tmp_path / "broken.mcap", 0
    rng = np.random.default_rng(1)
    special = {ends[0] - 1, ends[0], ends[3], len(data) - 1, len(data)}
    for offset in sorted({*rng.integers(0, len(data), 40).tolist(), *special}):
        broken.write_bytes(data[:offset])
        if offset < len(data):
            with pytest.raises(ArchiveError) as caught:
                read_archive(broken)
            assert "\n" not in str(caught.value)
        held = sum(end <= offset for end in ends)
        if not held:
            with pytest.raises(ArchiveError) as caught:
                recover_archive(broken, tmp_path / "fixed.mcap", overwrite=True)
            assert "\n" not in str(caught.value)
            assert not (tmp_path / "fixed.mcap").exists()
            continue
        result = recover_archive(broken, tmp_path / "fixed.mcap", overwrite=True)
        assert result.chunks == held
        assert result.damaged == 0
        frames = frames_of(result.path, run)
        assert sum(frames) == sum(result.frames.values()) >= before
        before = sum(frames)
    assert frames == [len(run[0].time), len(run[1].time)]
    assert read_archive(result.path).metrics.equals(run.metrics)


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_a_damaged_chunk_is_told_and_left_out(run, tmp_path, compression):
    path = write_archive(run, tmp_path / "a.mcap", options=ArchiveOptions(compression=compression))
    chunk = read_archive(path).trajectories.files[0].chunks[1]
    damaged = bytearray(path.read_bytes())
    damaged[chunk.offset + chunk.length // 2] ^= 0x10  # one bit, which only the checksum tells
    path.write_bytes(damaged)
    back = read_archive(path)
    with pytest.raises(ArchiveError, match=r"a\.mcap: is damaged .*see warpchain recover"):
        back[0]
    result = recover_archive(path, tmp_path / "fixed.mcap")
    assert result.damaged == 1
    assert "1 damaged chunk left out" in str(result)
    fixed = read_archive(result.path)
    assert fixed.metrics.equals(run.metrics)
    kept = np.isin(run[0].time, fixed[0].time)
    assert 0 < kept.sum() < len(run[0].time)
    np.testing.assert_array_equal(fixed[0].position, run[0].position[kept])


@pytest.mark.parametrize("compression", ["zstd", "none"])
def test_whatever_is_damaged_the_frames_are_right_or_one_line_tells(run, tmp_path, compression):
    small = simulate(two_sprockets(duration=0.001, settle="false"))
    data = write_archive(small, tmp_path / "a.mcap", options=ArchiveOptions(compression=compression)).read_bytes()
    (frames,) = (c for c in read_archive(tmp_path / "a.mcap").trajectories.files[0].chunks if len(c.channels) > 1)
    rng, told = np.random.default_rng(3), 0
    # outside of the frames' chunk, most is not protected by a CRC
    rest = np.r_[0 : frames.offset + 60, frames.offset + frames.length : len(data)]
    for offset in [*rng.choice(rest, 100), *rng.integers(len(data), size=20)]:
        damaged = bytearray(data)
        damaged[offset : offset + 4] = rng.bytes(min(4, len(data) - offset))
        (tmp_path / "b.mcap").write_bytes(damaged)
        for recover in (False, True):
            try:
                if recover:
                    recover_archive(tmp_path / "b.mcap", tmp_path / "c.mcap", overwrite=True)
                back = read_archive(tmp_path / ("c.mcap" if recover else "b.mcap"))
                np.testing.assert_array_equal(back[0].position, small[0].position)
                assert tuple(back.drives) == small.drives
            except WarpchainError as error:
                assert "\n" not in str(error)
                told += 1
    assert 20 < told < 240


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    """A run of two variants with equal numbers of frames, its archive's bytes, and where its data and summary end."""
    first = two_sprockets(duration=0.001, settle="false")
    second = first.with_values({"sprockets.driver.prescribed.speed": 12.0})
    run = simulate([first, second], record=Record(rate=2e4))
    path = write_archive(run, tmp_path_factory.mktemp("pair") / "a.mcap")
    data = path.read_bytes()
    from mcap.reader import make_reader

    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    return run, data, summary_start(data), summary


def check_recovered(path, run, result, cut):
    """Every frame is its variant's own, and whatever is not there was told."""
    back = read_archive(path)
    counts = {variant: 0 for variant in run}
    for variant in back:
        try:
            found = back[variant]
        except ArchiveError as error:  # its drive is damaged
            assert any(name in str(error) for name in result.left_out[0].split())
            continue
        kept = np.isin(run[variant].time, found.time)
        counts[variant] = len(found.time)
        assert kept.sum() == len(found.time)
        for name, values in found.channels().items():
            np.testing.assert_array_equal(values, getattr(run[variant], name)[kept], err_msg=name)
    if result.is_complete and not cut and not result.lost:
        assert counts == {variant: len(run[variant].time) for variant in run}
        assert back.info.step == run.info.step
        assert back.info.created == run.info.created


@pytest.mark.parametrize("cut", [False, True], ids=["whole", "cut"])
def test_one_flipped_bit_never_gives_a_variant_anothers_frames(pair, tmp_path, cut):
    """Of every byte outside of chunks' data, one bit: in a whole file, and in one that lost its summary."""
    run, data, start, summary = pair
    if cut:
        data = data[:start]
    inside = np.zeros(len(data), dtype=bool)
    for chunk in summary.chunk_indexes:
        inside[chunk.chunk_start_offset + 60 : chunk.chunk_start_offset + chunk.chunk_length] = True
    rng, refused, told = np.random.default_rng(8), 0, 0
    for offset in rng.choice(np.flatnonzero(~inside), 120, replace=False):
        damaged = bytearray(data)
        damaged[offset] ^= 1 << rng.integers(8)
        (tmp_path / "b.mcap").write_bytes(damaged)
        try:
            result = recover_archive(tmp_path / "b.mcap", tmp_path / "c.mcap", overwrite=True)
        except ArchiveError:
            refused += 1
            continue
        told += not result.is_complete
        check_recovered(tmp_path / "c.mcap", run, result, cut)
    assert told > 5
    if not cut:
        assert refused <= 10  # only its opening magic is beyond repair


def summary_start(data):
    return int.from_bytes(data[-28:-20], "little")


def sealed(data, summary):
    """An archive with another summary, whose checksum is right again."""
    return data[: summary_start(data)] + summary + struct.pack("<I", zlib.crc32(summary)) + data[-8:]


@pytest.fixture
def recovered(tmp_path):
    """Recovers an archive from bytes: what was done, and what is read back."""

    def recover(data):
        (tmp_path / "b.mcap").write_bytes(data)
        result = recover_archive(tmp_path / "b.mcap", tmp_path / "c.mcap", overwrite=True)
        return result, read_archive(tmp_path / "c.mcap")

    return recover


def flip(data, text, at, bit=1):
    """Bytes in which one bit of a place in the first occurrence of a text is another."""
    damaged = bytearray(data)
    damaged[data.index(text) + at] ^= bit
    return bytes(damaged)


@pytest.mark.parametrize("digests", [True, False])
def test_a_topic_that_names_another_variant_is_not_believed(pair, tmp_path, monkeypatch, recovered, digests):
    """One bit of variant 1's state topic makes it variant 0's: its frames come back as its own, or are left out."""
    run, data, *_ = pair
    if not digests:
        data = old_archive(run, tmp_path, monkeypatch)
    for whole in (True, False):
        cut = data if whole else data[: summary_start(data)]
        result, back = recovered(flip(cut, b"/variant/00001/state", len("/variant/0000")))
        assert list(back) == ([0, 1] if whole else [0])
        assert result.is_complete == whole
        for variant in back:
            np.testing.assert_array_equal(back[variant].position, run[variant].position)
        if not whole:
            assert result.damaged == (1 if digests else 2)  # frames; without digests the outlines, too
            assert result.left_out == ["a record"]


@pytest.mark.parametrize("swapped", [("rollers",), ("state",), ("rollers", "state")])
def test_topics_that_change_places_under_a_right_checksum_are_not_believed(pair, tmp_path, recovered, swapped):
    """In the summary two variants' topics are each other's, and its checksum is made right: only digests tell."""
    run, data, start, _ = pair
    summary = data[start:-12]
    for topic in swapped:
        one, other = (f"/variant/0000{v}/{topic}".encode() for v in range(2))
        assert summary.count(one) == summary.count(other) == 1
        summary = summary.replace(one, b"#" * len(one)).replace(other, one).replace(b"#" * len(one), other)
    _, back = recovered(sealed(data, summary))  # by the channels that stand among the frames
    with pytest.raises(ArchiveError, match="its digest is wrong"):
        list(read_archive(tmp_path / "b.mcap"))
    assert list(back) == list(run)
    for variant in back:
        np.testing.assert_array_equal(back[variant].position, run[variant].position)


def test_two_channels_of_a_topic_are_refused(pair, tmp_path, monkeypatch):
    """In an archive without digests, one variant's topics named as the other's would hide it."""
    data = old_archive(pair[0], tmp_path, monkeypatch)
    summary = data[summary_start(data) : -12].replace(b"/variant/00001/", b"/variant/00000/")
    (tmp_path / "b.mcap").write_bytes(sealed(data, summary))
    with pytest.raises(ArchiveError, match="has two channels /variant/00000/"):
        list(read_archive(tmp_path / "b.mcap"))


def old_archive(run, folder, monkeypatch):
    """Bytes of an archive as versions without digests wrote it."""
    from warpchain.archive import archive_format as schema
    from warpchain.archive import mcap_write

    with monkeypatch.context() as patch:
        patch.setattr(mcap_write, "channel_digest", lambda *_: "")
        patch.setattr(mcap_write, "metadata_digest", lambda *_: "")
        patch.setattr(schema, "end_with_start_copy", lambda end, head: dict(end))
        patch.setattr(mcap_write, "_record_bytes", undigested(mcap_write._record_bytes))
        return write_archive(run, folder / "old.mcap").read_bytes()


def undigested(plain):
    def encode(record):
        if hasattr(record, "metadata"):
            record.metadata.pop("digest", None)
        return plain(record)

    return encode


def test_archives_without_digests_are_read_and_recovered(pair, tmp_path, monkeypatch, recovered):
    run = pair[0]
    data = old_archive(run, tmp_path, monkeypatch)
    assert b"digest" not in data
    assert_same(run, read_archive(tmp_path / "old.mcap"))
    for broken in (data, data[: summary_start(data)]):
        result, back = recovered(broken)
        assert result.is_complete
        assert_same(run, back)
    assert b"digest" in (tmp_path / "c.mcap").read_bytes()


def test_metadata_that_changed_are_told(pair, tmp_path, recovered):
    """A step of 5e-06 that reads 4e-06, say: the reader refuses it, and recover takes the copy at the end."""
    run, data, _, _ = pair
    result, back = recovered(flip(data, b"5e-06", 0))
    with pytest.raises(ArchiveError, match="metadata warpchain: their digest is wrong"):
        read_archive(tmp_path / "b.mcap")
    assert result.left_out == ["metadata warpchain"]
    assert back.info.step == run.info.step == 5e-6


def test_a_chunk_that_is_there_twice_counts_once(pair, recovered):
    run, data, start, summary = pair
    chunk = max(summary.chunk_indexes, key=lambda chunk: chunk.chunk_start_offset)
    twice = data[chunk.chunk_start_offset :][: chunk.chunk_length]
    result, back = recovered(data[: start - 13] + twice)
    assert result.damaged == 1
    assert list(back) == list(run)
    for variant in run:
        np.testing.assert_array_equal(back[variant].time, run[variant].time)


def test_frames_missing_between_others_are_told(run, whole, tmp_path, recovered):
    """A chunk cut out of a file without a summary leaves nothing behind but the numbers of its frames."""
    data, _ = whole
    (tmp_path / "a.mcap").write_bytes(data)
    chunks = [c for c in read_archive(tmp_path / "a.mcap").trajectories.files[0].chunks if len(c.channels) > 1]
    result, back = recovered(data[: chunks[2].offset] + data[chunks[3].offset : summary_start(data) - 13])
    assert result.missing > 0
    assert f"{result.missing} frames are missing between others" in str(result)
    assert len(back[0].time) + result.missing == len(run[0].time)


def test_a_damaged_drive_costs_its_variant_alone_where_its_copy_is_damaged_too(pair, tmp_path, capsys):
    run, data, _, _ = pair
    for word in (b"drives/00001.toml", b"drives/00001.copy.toml"):
        data = flip(data, word, 200, 4)
        (tmp_path / "b.mcap").write_bytes(data)
        assert command(capsys, "recover", tmp_path / "b.mcap", "-o", tmp_path / "c.mcap", "--overwrite")[0] == 1
        back = read_archive(tmp_path / "c.mcap")
        np.testing.assert_array_equal(back[0].position, run[0].position)
        if b"copy" not in word:
            assert_same(back, run)
            assert_same(read_archive(tmp_path / "b.mcap"), run)
    with pytest.raises(ArchiveError, match=r"lacks its attachment drives/00001\.toml"):
        back[1]


WRITE = """
import sys
from archives import assert_same
from command import run as command
from drives import two_sprockets
from warpchain import Record, simulate
from warpchain.archive import ArchiveOptions, writer as write
write.CHUNK = 2**16
options = ArchiveOptions(**eval(sys.argv[2]))
simulate(two_sprockets(duration=5.0, settle="false"), record=Record(rate=1e5), archive=sys.argv[1],
         archive_options=options)
"""


@pytest.mark.parametrize("options", [{}, *of_long({"split_size": 300_000})], ids=["one", "split"])
def test_a_killed_process_leaves_what_it_had_written(tmp_path, options):
    path = tmp_path / "killed.mcap"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    process = subprocess.Popen([sys.executable, "-c", WRITE, str(path), repr(options)], env=environment)
    wait_for(lambda: bytes_in(tmp_path) > 2_000_000)
    process.send_signal(signal.SIGKILL)
    process.wait()
    left = [file.name for file in tmp_path.iterdir() if not file.name.startswith(".")]
    assert "killed.mcap" not in left
    with pytest.raises(ArchiveError, match="warpchain recover"):
        read_archive(path)
    result = recover_archive(path, tmp_path / "fixed.mcap")
    back = read_archive(tmp_path / "fixed.mcap")
    assert back.info.ended == "recovered"
    assert len(left) - 1 <= len(back.files) <= len(left)  # a part that had only just begun is left out
    assert (len(left) > 1) == ("split_size" in options)
    assert len(back[0].time) == result.frames[0] > 100
    np.testing.assert_allclose(np.diff(back[0].time), 1e-5, rtol=1e-9)  # of the samples' rate, none lost between
    assert np.isfinite(back[0].position).all()
    assert all(rerun_accepts(file) for file in back.files)


def test_full_disk_when_written_afterwards_leaves_nothing(run, tmp_path):
    with small_disk(400_000), pytest.raises(ArchiveError, match=r"a\.mcap: cannot be written \(File too large\)"):
        write_archive(run, tmp_path / "a.mcap")
    assert list(tmp_path.iterdir()) == []


def test_full_disk_while_running_keeps_what_was_written(run, tmp_path, monkeypatch):
    monkeypatch.setattr("warpchain.archive.writer.CHUNK_BYTES", 2**16)
    with small_disk(400_000), pytest.raises(ArchiveError) as caught:
        simulate(run.drives[0], record=Record(rate=1e5), archive=tmp_path / "a.mcap")
    (left,) = tmp_path.iterdir()
    assert str(caught.value).startswith(f"{tmp_path / 'a.mcap'}: cannot be written (File too large); what was written")
    assert str(left) in str(caught.value)
    with small_disk(800_000):  # the mended file needs a little room of its own
        (frames,) = frames_of(recover_archive(left, tmp_path / "fixed.mcap").path, run)
    assert 0 < frames < len(run[0].time)


@pytest.mark.parametrize(("whole", "chunks"), [(1, 2), (1, 0), (3, 1), (0, 3)])
def test_a_full_disk_under_a_split_archive_names_what_is_whole(run, tmp_path, monkeypatch, whole, chunks):
    """Parts that are whole stay with what there is of the last one; the archive's name and the first part's restore
    them."""
    monkeypatch.setattr("warpchain.archive.writer.CHUNK_BYTES", 2**15)
    monkeypatch.setattr(McapWriter, "add_chunk", full_after(whole, chunks))
    options = ArchiveOptions(split_size=100_000, encoders=1)
    with pytest.raises(ArchiveError, match="No space left on device") as caught:
        simulate(run.drives, record=Record(rate=1e5), archive=tmp_path / "a.mcap", archive_options=options)
    monkeypatch.undo()
    left = sorted(tmp_path.iterdir())
    assert [file.suffix for file in left] == [".mcap"] * whole + [".partial"] * (chunks > 0)
    assert all(str(file) in str(caught.value) for file in left[:1] + left[whole:]) and "recover" in str(caught.value)
    assert ("whole" in str(caught.value)) == (whole > 0)
    assert "\n" not in str(caught.value)
    frames = frames_of(recover_archive(tmp_path / "a.mcap", tmp_path / "fixed.mcap").path, run)
    assert sum(frames) > 0
    assert frames == frames_of(recover_archive(left[0], tmp_path / "first.mcap").path, run)


def full_after(parts, chunks):
    """`McapWriter.add_chunk` on a disk that has room for so many parts, and so many chunks of the next one."""
    plain = McapWriter.add_chunk

    def write(file, chunk):
        if f".part{parts:04d}." in file.path.name and file.chunks_written == chunks:
            raise ArchiveError(f"{file.path}: cannot be written (No space left on device)")
        plain(file, chunk)

    return write


@pytest.mark.parametrize("moment", ["take", "finish"])
def test_a_second_ctrl_c_keeps_what_was_written(run, tmp_path, monkeypatch, capsys, moment):
    """It ends the run at once, while frames are taken or while the archive is ended, and costs no more than kill -9."""
    from warpchain.archive.archive_parts import ArchiveParts
    from warpchain.engine.recorder import Recorder

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("warpchain.archive.writer.CHUNK_BYTES", 2**14)
    monkeypatch.setattr("warpchain.engine.subensemble.LAUNCH_WORK", 60 * 101)
    if moment == "finish":
        monkeypatch.setattr(ArchiveParts, "finish_archive", interrupted)
    else:
        plain, left = Recorder.take_frames, [3]

        def take(*words):
            left[0] -= 1
            plain(*words)
            if not left[0]:
                words[0]._archive._send_all_waiting()
                wait_for(lambda: bytes_in(tmp_path) > 30_000)
                interrupted()

        monkeypatch.setattr(Recorder, "take_frames", take)
    told = pytest.warns(UserWarning, match=r"a\.mcap: was not finished; what was written until then is in .*recover")
    with told, pytest.raises(KeyboardInterrupt):
        simulate(run.drives[0], record=Record(rate=1e5), archive=tmp_path / "a.mcap")
    (left_file,) = tmp_path.iterdir()
    assert left_file.suffix == ".partial"
    (frames,) = frames_of(recover_archive(tmp_path / "a.mcap", tmp_path / "fixed.mcap").path, run)
    assert frames == len(run[0].time) if moment == "finish" else frames > 0


def test_folder_that_refuses(run, tmp_path, monkeypatch):
    with pytest.raises(ArchiveError, match=r"cannot be written \(No such file or directory\)"):
        write_archive(run, tmp_path / "absent" / "a.mcap")
    if os.geteuid() == 0:  # root may write anywhere but in /proc
        with pytest.raises(ArchiveError, match=r"/proc/a\.mcap: cannot be written"):
            write_archive(run, "/proc/a.mcap")
    else:
        tmp_path.chmod(0o500)
        with pytest.raises(ArchiveError, match=r"cannot be written \(Permission denied\)"):
            write_archive(run, tmp_path / "a.mcap")


def test_what_is_no_archive_is_refused(tmp_path):
    from mcap.writer import Writer

    other = tmp_path / "other.mcap"

    def refused(line):
        for read in (read_archive, lambda path: recover_archive(path, tmp_path / "new.mcap")):
            with pytest.raises(ArchiveError, match=line):
                read(other)

    refused("cannot be read")
    for text in ("", "no archive, but a text that is long enough to look into"):
        other.write_text(text)
        refused("is not an archive of warpchain|is not an MCAP file")
    with other.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        writer.add_metadata("other", {})
        writer.finish()
    refused("not an archive of warpchain")
    assert [file.name for file in tmp_path.iterdir()] == ["other.mcap"]


def test_refusals_of_recover(whole, tmp_path):
    broken, fixed = tmp_path / "broken.mcap", tmp_path / "fixed.mcap"
    broken.write_bytes(whole[0][:-10])
    fixed.write_text("mine")
    with pytest.raises(ArchiveError, match="exists already"):
        recover_archive(broken, fixed)
    assert fixed.read_text() == "mine"
    with pytest.raises(ArchiveError, match="is a folder"):
        recover_archive(broken, tmp_path, overwrite=True)


def test_recover_on_the_command_line(whole, tmp_path, capsys):
    broken, fixed = tmp_path / "broken.mcap", tmp_path / "fixed.mcap"
    line = f"warpchain: error: {broken}: cannot be read (No such file or directory)"
    assert command(capsys, "recover", broken, "-o", fixed) == (2, [], [line])
    line = f"warpchain: error: {tmp_path}: cannot be read (Is a directory)"
    assert command(capsys, "recover", tmp_path, "-o", fixed) == (2, [], [line])
    broken.write_bytes(whole[0][: whole[1][3] + 100])
    status, out, _ = command(capsys, "recover", broken, "-o", fixed)
    assert status == 0 and "frames of 1 variant in 4 chunks; " in out[0]
    assert "bytes after the last whole record lost" in "".join(out)
    assert len(read_archive(fixed)[0].time) == int(out[0].split()[0])
