"""Writing of archives: threads, splits, precision of the values, numbers that variants have in studies."""

import os
import signal
import threading
from dataclasses import replace

import numpy as np
import pytest
from archives import assert_same, unlike
from command import refused
from command import run as command
from drives import of_long
from mcap.reader import make_reader
from rerun_check import rerun_accepts
from study_helpers import tiny_drive
from waiting import wait_for

from warpchain import ArchiveOptions, Record, read_archive, simulate, write_archive
from warpchain.archive import ArchiveWriter
from warpchain.archive.ordered_work import OrderedWork
from warpchain.archive.recover import recover_archive
from warpchain.errors import ArchiveError, SimulationError
from warpchain.results.engineering_report import engineering_report


@pytest.fixture(scope="module")
def run():
    first, other = unlike()
    return simulate([first, other, other, first, first], record=Record(variants=[0, 1, 3, 4], rate=5e4))


@pytest.fixture
def small_chunks(monkeypatch):
    monkeypatch.setattr("warpchain.archive.writer.CHUNK_BYTES", 2**16)


def test_results_are_handed_on_in_order_whatever_the_work_takes():
    out, finished, ended = [], [], [threading.Event() for _ in range(100)]

    def work(job):
        # four are under way at once: the last of every four ends first
        assert job % 4 == 3 or ended[job + 1].wait(60)
        finished.append(job)
        ended[job].set()
        return job

    pipeline = OrderedWork(work, out.append, threads=4, room=8)
    for job in range(100):
        pipeline.submit_job(job)
    pipeline.wait_for_jobs()
    assert finished[:8] == [3, 2, 1, 0, 7, 6, 5, 4]
    assert out == list(range(100))


def test_no_more_jobs_are_under_way_than_there_is_room():
    gates, taken, handed, most = [threading.Event() for _ in range(50)], [], [], []
    pipeline = OrderedWork(lambda job: gates[job].wait(60), lambda result: handed.append(result), threads=2, room=3)

    def feed():
        for job in range(50):
            pipeline.submit_job(job)
            taken.append(job)
            most.append(len(taken) - len(handed))

    feeder = threading.Thread(target=feed)
    feeder.start()
    for job in range(50):  # a job ends only when as many as may be are under way
        wait_for(lambda job=job: len(taken) >= min(job + 4, 50))
        gates[job].set()
        wait_for(lambda job=job: len(handed) > job)
    feeder.join(60)
    pipeline.wait_for_jobs()
    assert max(most) == 3 + 1  # those that wait, and the one that the sink waits for
    assert handed == [True] * 50


@pytest.mark.parametrize("place", ["work", "sink"])
def test_an_error_comes_out_on_the_callers_side(place):
    done = []

    def fail(job):
        if job == 5:
            raise OSError(28, "No space left on device")
        return job

    work, sink = (fail, done.append) if place == "work" else (lambda job: job, lambda job: done.append(fail(job)))
    pipeline = OrderedWork(work, sink, threads=2, room=4)
    with pytest.raises(OSError, match="No space left"):
        for job in range(10_000):
            pipeline.submit_job(job)
    with pytest.raises(OSError, match="No space left"):
        pipeline.wait_for_jobs()
    assert done == [0, 1, 2, 3, 4]  # nothing after the failure
    pipeline.wait_for_jobs(drop=True)


def test_files_do_not_depend_on_the_number_of_encoders(run, tmp_path, small_chunks):
    sizes = set()
    for encoders in (1, 3):
        path = write_archive(run, tmp_path / f"{encoders}.mcap", options=ArchiveOptions(encoders=encoders))
        assert_same(run, read_archive(path))
        sizes.add(path.stat().st_size)
    assert len(sizes) == 1


@pytest.mark.parametrize(
    ("options", "files"),
    [
        (ArchiveOptions(split_variants=1), 4),
        (ArchiveOptions(split_variants=3, compression="lz4"), 2),
        (ArchiveOptions(split_variants=9), 1),
        (ArchiveOptions(split_size=200_000), None),
        (ArchiveOptions(split_size=10**9, compression="none"), 1),
    ],
)
@pytest.mark.parametrize("streamed", [False, True])
def test_a_split_set_opens_as_one(run, tmp_path, small_chunks, options, files, streamed, monkeypatch):
    path = tmp_path / "set.mcap"
    if streamed:
        monkeypatch.setattr("warpchain.engine.subensemble.LAUNCH_WORK", 60 * 101)
        record = Record(variants=[0, 1, 3, 4], rate=5e4)
        assert_same(run, simulate(run.drives, record=record, archive=path, archive_options=options))
    else:
        assert write_archive(run, path, options=options) == path
    parts = sorted(tmp_path.iterdir())
    assert not path.exists()
    assert len(parts) == files or (files is None and len(parts) > 2)
    for name in (path, *parts):
        back = read_archive(name)
        assert list(back.files) == parts
        assert_same(run, back)
    assert rerun_accepts(parts[-1])
    with pytest.raises(ArchiveError, match=r"part0000\.mcap: exists already"):
        write_archive(run, path, options=options)


def test_a_set_with_a_part_missing_or_foreign_is_told(run, tmp_path):
    path = write_archive(run, tmp_path / "set.mcap", options=ArchiveOptions(split_variants=1))
    other = write_archive(run, tmp_path / "other.mcap", options=ArchiveOptions(split_variants=1))
    middle = tmp_path / "set.part0001.mcap"
    middle.unlink()
    with pytest.raises(ArchiveError, match="part 1 is missing"):
        read_archive(path)
    (tmp_path / "other.part0001.mcap").rename(middle)
    with pytest.raises(ArchiveError, match="belongs to another archive"):
        read_archive(path)
    (tmp_path / "other.part0003.mcap").unlink()
    (tmp_path / "other.part0002.mcap").unlink()
    with pytest.raises(ArchiveError, match="has no end"):
        read_archive(other)


def dying(path, run, options, operation):
    """Overwrites an archive in a process that is killed at its n-th change of the folder; whether it was."""
    child = os.fork()
    if not child:
        left = [operation]
        for name in ("replace", "link", "unlink"):
            plain = getattr(os, name)

            def call(*words, plain=plain, **more):
                left[0] -= 1
                if left[0] < 0:
                    os.kill(os.getpid(), signal.SIGKILL)
                plain(*words, **more)

            setattr(os, name, call)
        try:
            write_archive(run, path, overwrite=True, options=options)
        finally:
            os._exit(0)
    return os.waitpid(child, 0)[1] == signal.SIGKILL


@pytest.mark.parametrize("before", [None, 3, *of_long(1)])
@pytest.mark.parametrize("after", [None, 3, *of_long(1)])
def test_an_archive_being_replaced_is_the_old_one_or_the_new_one(run, tmp_path, before, after):
    """Killed at any step of overwriting, in any form: the name stands for one of them, whole, and can be rewritten."""
    old = replace(run, info=replace(run.info, created="before"))
    for operation in range(99):
        path = tmp_path / str(operation) / "set.mcap"
        path.parent.mkdir()
        write_archive(old, path, options=ArchiveOptions(split_variants=before))
        killed = dying(path, run, ArchiveOptions(split_variants=after), operation)
        back = read_archive(path)
        assert_same(run, back)
        assert back.info.created == ("before" if operation == 0 else back.info.created)
        if not killed:
            break
        write_archive(run, path, overwrite=True, options=ArchiveOptions(split_variants=after))
        assert read_archive(path).info.created == run.info.created
        assert len([file for file in path.parent.iterdir() if file.suffix == ".mcap"]) == len(read_archive(path).files)
    assert operation >= {None: 1, 1: 4, 3: 2}[after]  # a step for each file at least
    assert read_archive(path).info.created == run.info.created
    assert len(list(path.parent.iterdir())) == len(read_archive(path).files)


def test_a_set_that_failed_leaves_the_old_one_alone(run, tmp_path, small_chunks):
    path = write_archive(run, tmp_path / "set.mcap", options=ArchiveOptions(split_size=200_000))
    there = sorted(file.name for file in tmp_path.iterdir())
    options = ArchiveOptions(split_size=200_000)
    with ArchiveWriter(path, run.drives, list(run), run.info, options, overwrite=True) as writer:
        for variant in run:
            writer.append(variant, run[variant])
    assert sorted(file.name for file in tmp_path.iterdir()) == there
    assert_same(run, read_archive(path))


def test_what_a_killed_set_left_is_recovered_beside_the_old_one(run, tmp_path):
    """Both can be named: the archive's name is the old set until the new one is whole."""
    path = write_archive(run, tmp_path / "set.mcap", options=ArchiveOptions(split_variants=1))
    assert dying(path, run, ArchiveOptions(split_variants=1), 2)
    assert_same(run, read_archive(path))
    with pytest.raises(ArchiveError, match=r"several runs were cut; name one of .*set\.part0000-2\.mcap"):
        recover_archive(path, tmp_path / "fixed.mcap")
    result = recover_archive(tmp_path / "set.part0000-2.mcap", tmp_path / "fixed.mcap")
    assert sorted(result.frames) == [0, 1, 3, 4]
    recover_archive(tmp_path / "set.part0000.mcap", path, overwrite=True)
    assert read_archive(path).info.ended == "recovered"


def test_float32_values_and_exact_positions(run, tmp_path):
    half = read_archive(write_archive(run, tmp_path / "h.mcap", options=ArchiveOptions(values="float32")))
    both = ArchiveOptions(values="float32", exact_positions=True)
    exact = read_archive(write_archive(run, tmp_path / "e.mcap", options=both))
    for variant in run:
        for back in (half, exact):
            np.testing.assert_array_equal(back[variant].tension, run[variant].tension.astype(np.float32))
            np.testing.assert_array_equal(back[variant].sprocket_angle, run[variant].sprocket_angle)
            np.testing.assert_array_equal(back[variant].time, run[variant].time)
        assert half[variant].position.dtype == np.float32
        np.testing.assert_array_equal(exact[variant].position, run[variant].position)
    topics = {channel.topic for channel in exact.trajectories.files[0].channels.values()}
    assert "/variant/00003/positions" in topics
    assert rerun_accepts(exact.files[0])
    assert half.files[0].stat().st_size < 0.7 * write_archive(run, tmp_path / "f.mcap").stat().st_size


@pytest.mark.parametrize(
    ("values", "line"),
    [
        ({"compression": "gzip"}, "compression = 'gzip'"),
        ({"values": "float16"}, "values = 'float16'"),
        ({"split_size": 0}, "split_size = 0"),
        ({"split_variants": 2, "split_size": 5}, "give one of them"),
        ({"encoders": 1.5}, "encoders = 1.5"),
        ({"exact_positions": True}, "exact_positions"),
        ({"attachments": {"metrics.arrow": b""}}, "archive's own"),
        ({"attachments": {"study.toml": "text"}}, "a mapping from a text to bytes"),
    ],
)
def test_refusals_of_the_options(values, line):
    with pytest.raises(ArchiveError, match=line):
        ArchiveOptions(**values)


def test_more_variants_than_a_file_numbers_are_refused_before_it_is_begun(run, tmp_path):
    """MCAP has 65535 channels, of which a variant has six."""
    with pytest.raises(ArchiveError, match="10923 recorded variants do not fit one file, which holds 10922; split the"):
        ArchiveWriter(tmp_path / "a.mcap", run.drives[:1] * 10_923, range(10_923), run.info)
    with pytest.raises(ArchiveError, match="split_variants = 10923: allowed is up to 10922"):
        write_archive(run, tmp_path / "a.mcap", options=ArchiveOptions(split_variants=10_923))
    assert list(tmp_path.iterdir()) == []


def test_options_of_the_command_line(capsys, tmp_path):
    words = ["run", "marine", "-o", tmp_path / "m.mcap", "--duration", "0.004", "--rate", "1e5", "--quiet"]
    words += ["--set", "run.settle=false", "--compression", "lz4", "--values", "float32", "--split-size", "0.5"]
    assert command(capsys, *words)[0] == 0
    back = read_archive(tmp_path / "m.mcap")
    assert len(back.files) > 1
    assert back[0].tension.dtype == np.float32
    for more, told in ((["--exact-positions"], "exists already"), (["--split-size", "-1"], "above 0 (MiB)")):
        assert told in refused(capsys, *words, *more)


NUMBERS = (40, 7, 123456)
DRIVES = [tiny_drive().with_values({"sprockets.s1.load.torque": torque}) for torque in (0.1, 0.2, 0.3)]
RECORD = Record((0, 2), rate=1e5)


@pytest.fixture
def path(tmp_path):
    """The first and the last of three variants, in an archive that was written while the run went on."""
    path = tmp_path / "numbered.mcap"
    options = ArchiveOptions(numbers=NUMBERS)
    run = simulate(DRIVES, duration=5e-4, step=1e-5, record=RECORD, archive=path, archive_options=options)
    assert list(run) == [40, 123456]
    return path


def test_topics_drives_metrics_and_trajectories_have_the_numbers(path):
    with path.open("rb") as file:
        reader = make_reader(file)
        named = {channel.topic for channel in reader.get_summary().channels.values()}
        attached = {attachment.name for attachment in reader.iter_attachments()}
    assert {topic.split("/")[2] for topic in named} == {"00040", "123456"}
    assert {"drives/00040.toml", "drives/00007.toml", "drives/123456.toml"} <= attached
    archive = read_archive(path)
    plain = simulate(DRIVES, duration=5e-4, step=1e-5, record=RECORD)
    assert list(archive) == [40, 123456] and tuple(archive.numbers) == NUMBERS
    assert archive.metrics["variant"].to_pylist() == list(NUMBERS)
    assert [archive.row_of(v) for v in NUMBERS] == [0, 1, 2] and list(plain.numbers) == [0, 1, 2]
    assert archive.drives == plain.drives == tuple(DRIVES)
    for number, v in ((40, 0), (123456, 2)):
        assert archive[number].drive == DRIVES[v]
        np.testing.assert_array_equal(archive[number].position, plain[v].position)
        assert archive.read(number, channels=["tension"]).tension.shape == plain[v].tension.shape
        assert engineering_report(archive, number).metrics() == engineering_report(plain, v).metrics()
    with pytest.raises(SimulationError, match=r"variant 7 was not recorded \(recorded: 40, 123456\)"):
        archive[7]


def test_they_are_kept_when_it_is_written_again_and_recovered(path, tmp_path):
    archive = read_archive(path)
    assert_same(read_archive(write_archive(archive, tmp_path / "again.mcap")), archive)
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(path.read_bytes()[:-300])
    recover_archive(cut, tmp_path / "whole.mcap")
    whole = read_archive(tmp_path / "whole.mcap")
    assert list(whole) == [40, 123456] and tuple(whole.numbers) == NUMBERS
    assert whole.metrics["variant"].to_pylist() == list(NUMBERS)
    np.testing.assert_array_equal(whole[123456].position, archive[123456].position)


@pytest.mark.parametrize(
    ("numbers", "line"),
    [
        ((1, 1, 2), ": must be different from each other"),
        ((0, -1, 2), r" = \(0, -1, 2\): must be a sequence, each a whole number of at least 0"),
        ((5, 6), ": there are 2 for 3"),
    ],
)
def test_numbers_that_do_not_fit_are_refused(tmp_path, numbers, line):
    with pytest.raises(ArchiveError, match=f"numbers{line}"):
        options = ArchiveOptions(numbers=numbers)
        simulate(DRIVES, duration=5e-4, step=1e-5, record=RECORD, archive=tmp_path / "a.mcap", archive_options=options)
    assert not list(tmp_path.glob("*.mcap"))


def test_a_name_longer_than_the_system_allows_is_one_line(run, tmp_path):
    path = tmp_path / ("a" * 300 + ".mcap")
    with pytest.raises(ArchiveError, match=r"a\.mcap: cannot be written \(File name too long\)$"):
        write_archive(run, path)
    with pytest.raises(ArchiveError, match=r"a\.mcap: cannot be read \(No such file or directory\)$"):
        read_archive(path)
    assert list(tmp_path.iterdir()) == []
