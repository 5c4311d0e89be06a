"""What is left of a cut archive: whole chunks come back bitwise, nothing is made up, and nothing is silently empty."""

import os
import resource
import signal
import subprocess
import sys

import numpy as np
import pytest
from drives import two_sprockets
from rerun_check import rerun_accepts
from waiting import bytes_in, wait_for

from warpchain import Record, read_archive, simulate, write_archive
from warpchain.archive import ArchiveOptions
from warpchain.archive.recover import recover_archive
from warpchain.errors import ArchiveError, WarpchainError


@pytest.fixture(scope="module")
def run():
    drives = [
        two_sprockets(duration=0.003, settle="false"),
        two_sprockets(duration=0.002, settle="false", teeth=24, links=64),
    ]
    return simulate(drives, record=Record(rate=1e5))


@pytest.fixture(scope="module")
def whole(run, tmp_path_factory):
    """An archive of many chunks, and where each of them ends."""
    from warpchain.archive import write as archive

    patch = pytest.MonkeyPatch()
    patch.setattr(archive, "CHUNK", 2**16)
    path = write_archive(run, tmp_path_factory.mktemp("whole") / "a.mcap")
    patch.undo()
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
    offsets = sorted(
        {*rng.integers(0, len(data), 40).tolist(), ends[0] - 1, ends[0], ends[3], len(data) - 1, len(data)}
    )
    for offset in offsets:
        broken.write_bytes(data[:offset])
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


def test_rerun_accepts_what_was_recovered(whole, tmp_path):
    data, _ = whole
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(data[: int(0.7 * len(data))])
    assert rerun_accepts(recover_archive(broken, tmp_path / "fixed.mcap").path)


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


WRITE = """
import sys
from drives import two_sprockets
from warpchain import Record, simulate
from warpchain.archive import ArchiveOptions, write
write.CHUNK = 2**16
options = ArchiveOptions(**eval(sys.argv[2]))
simulate(two_sprockets(duration=5.0, settle="false"), record=Record(rate=1e5), archive=sys.argv[1],
         archive_options=options)
"""


@pytest.mark.parametrize("options", [{}, {"split_size": 300_000}], ids=["one", "split"])
def test_a_killed_process_leaves_what_it_had_written(tmp_path, options):
    path = tmp_path / "killed.mcap"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    process = subprocess.Popen([sys.executable, "-c", WRITE, str(path), repr(options)], env=environment)
    wait_for(lambda: bytes_in(tmp_path) > 2_000_000)
    process.send_signal(signal.SIGKILL)
    process.wait()
    left = [file.name for file in tmp_path.iterdir()]
    assert "killed.mcap" not in left
    with pytest.raises(ArchiveError, match="warpchain recover"):
        read_archive(path)
    result = recover_archive(path, tmp_path / "fixed.mcap")
    back = read_archive(tmp_path / "fixed.mcap")
    assert back.info.ended == "recovered"
    assert len(left) - 1 <= len(back.files) <= len(left)  # a part that had only just begun is left out
    assert (len(left) > 1) == ("split_size" in options)
    time_step = np.diff(back[0].time)
    assert len(back[0].time) == result.frames[0] > 100
    np.testing.assert_allclose(time_step, 1e-5, rtol=1e-9)  # every frame of the samples' rate, none lost between
    assert np.isfinite(back[0].position).all()
    assert all(rerun_accepts(file) for file in back.files)


@pytest.fixture
def small_disk():
    """No file may grow past 400 kB: the system answers as a full disk does."""
    kept = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (400_000, kept[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, kept)


def test_full_disk_when_written_afterwards_leaves_nothing(run, tmp_path, small_disk):
    with pytest.raises(ArchiveError, match=r"a\.mcap: cannot be written \(File too large\)"):
        write_archive(run, tmp_path / "a.mcap")
    assert list(tmp_path.iterdir()) == []


def test_full_disk_while_running_keeps_what_was_written(run, tmp_path, small_disk, monkeypatch):
    monkeypatch.setattr("warpchain.archive.write.CHUNK", 2**16)
    with pytest.raises(ArchiveError) as caught:
        simulate(run.drives[0], record=Record(rate=1e5), archive=tmp_path / "a.mcap")
    (left,) = tmp_path.iterdir()
    assert str(caught.value).startswith(f"{tmp_path / 'a.mcap'}: cannot be written (File too large); what was written")
    assert str(left) in str(caught.value)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2 * soft, hard))  # the mended file needs a little room of its own
    (frames,) = frames_of(recover_archive(left, tmp_path / "fixed.mcap").path, run)
    assert 0 < frames < len(run[0].time)


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


def test_refusals_of_recover(whole, tmp_path):
    broken, fixed = tmp_path / "broken.mcap", tmp_path / "fixed.mcap"
    with pytest.raises(ArchiveError, match="cannot be read"):
        recover_archive(broken, fixed)
    broken.write_bytes(whole[0][:-10])
    fixed.write_text("mine")
    with pytest.raises(ArchiveError, match="exists already"):
        recover_archive(broken, fixed)
    assert fixed.read_text() == "mine"
    with pytest.raises(ArchiveError, match="is a folder"):
        recover_archive(broken, tmp_path, overwrite=True)
    for text in ("", "no archive, but some text"):
        broken.write_text(text)
        with pytest.raises(ArchiveError, match=r"is not an archive of warpchain|is not an MCAP file"):
            recover_archive(broken, tmp_path / "new.mcap")
    from mcap.writer import Writer

    with broken.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        writer.add_metadata("other", {})
        writer.finish()
    with pytest.raises(ArchiveError, match="is not an archive of warpchain"):
        recover_archive(broken, tmp_path / "new.mcap")
    assert not list(tmp_path.glob("*.partial"))


def test_recover_on_the_command_line(whole, tmp_path, capsys):
    from warpchain import cli

    broken, fixed = tmp_path / "broken.mcap", tmp_path / "fixed.mcap"
    assert cli.main(["recover", str(broken), "-o", str(fixed)]) == 2
    assert capsys.readouterr().err == f"warpchain: error: {broken}: cannot be read (No such file or directory)\n"
    broken.write_bytes(whole[0][: whole[1][3] + 100])
    assert cli.main(["recover", str(broken), "-o", str(fixed)]) == 0
    out = capsys.readouterr().out
    assert "frames of 1 variant in 4 chunks; " in out
    assert "bytes after the last whole record lost" in out
    assert len(read_archive(fixed)[0].time) == int(out.split()[0])
