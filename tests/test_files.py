"""Whole-file writing: whatever ends it, and wherever, the old file is there whole, or the new one."""

import contextlib
import itertools
import os
import socket
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from archives import assert_same
from drives import two_sprockets
from hypothesis import given
from hypothesis import strategies as st

import warpchain
from warpchain import ArchiveOptions, Record, files, read_archive, simulate, write_archive
from warpchain.archive import ArchiveWriter
from warpchain.archive.archive_names import unfinished_files
from warpchain.archive.export import export
from warpchain.archive.mcap_write import McapWriter
from warpchain.errors import ArchiveError, DriveError
from warpchain.files import read_text_file, refusals_as_errors, whole_file, write_text_file
from warpchain.study.store import write_study_text as write_study_text

OLD, NEW = b"old", b"new" * 100_000


class Breaks:
    """Stands for the system and ends in its n-th call, before or after it does its work."""

    def __init__(self, at, after, end):
        self.calls, self.at, self.after, self.end = 0, at, after, end

    def wrap(self, plain):
        def call(*args, **more):
            mine, self.calls = self.calls, self.calls + 1
            if mine == self.at and not self.after:
                self.end()
            result = plain(*args, **more)
            if mine == self.at:
                self.end()
            return result

        return call


class Stream:
    """A binary file whose writing, flushing and closing can break."""

    def __init__(self, file, breaks):
        self.file, self.fileno = file, file.fileno
        self.write, self.flush = breaks.wrap(file.write), breaks.wrap(file.flush)
        self.close = breaks.wrap(file.close)


def write_and_break(path, overwrite, breaks, patch):
    """Writes NEW to a path on a system that breaks."""
    plain = Path.open
    patch(Path, "open", lambda self, mode: Stream(breaks.wrap(plain)(self, mode), breaks))
    for name in ("fsync", "replace", "link", "unlink"):
        patch(files.os, name, breaks.wrap(getattr(os, name)))
    with whole_file(path, overwrite) as file:
        file.write(NEW[:7])
        file.write(NEW[7:])


def refuse():
    raise OSError(28, "No space left on device")


def interrupt():
    raise KeyboardInterrupt


CASES = list(itertools.product([True, False], [True, False], [refuse, interrupt]))


@pytest.mark.parametrize(("overwrite", "after", "end"), CASES)
def test_an_error_at_any_step_leaves_a_whole_file_and_nothing_else(tmp_path, overwrite, after, end):
    for step in itertools.count():
        path = tmp_path / str(step) / "file"
        path.parent.mkdir()
        if overwrite:
            path.write_bytes(OLD)
        breaks = Breaks(step, after, end)
        with pytest.MonkeyPatch.context() as patch, contextlib.suppress(OSError, KeyboardInterrupt):
            write_and_break(path, overwrite, breaks, patch.setattr)
        names = (file for file in path.parent.iterdir() if file.name not in ("file", ".file.lock"))
        there = {file.name: file.read_bytes() for file in names}  # a lock that nobody holds is in nobody's way
        if not (step == 0 and after):  # the system opened the file and told nobody: only a system may do that
            assert there == {}
        now = path.read_bytes() if path.exists() else None
        assert now in (OLD if overwrite else None, NEW)
        if breaks.calls <= step:
            break
    assert step >= 8  # open, write twice, flush, fsync, close, rename, the folder's fsync
    assert now == NEW


KILL = """
import os, signal, sys
from pathlib import Path
from test_files import Breaks, write_and_break
step, after, overwrite = (int(word) for word in sys.argv[2:])
end = lambda: os.kill(os.getpid(), signal.SIGKILL)
write_and_break(Path(sys.argv[1]), bool(overwrite), Breaks(step, bool(after), end), setattr)
"""


KILLS = [(1, 1, 1), (3, 0, 1), (4, 1, 1), (6, 0, 1), (6, 1, 0), (6, 1, 1)]


@pytest.mark.parametrize(("step", "after", "overwrite"), KILLS)
def test_a_kill_at_any_step_leaves_a_whole_file(tmp_path, step, after, overwrite):
    path = tmp_path / "file"
    if overwrite:
        path.write_bytes(OLD)
    words = [sys.executable, "-c", KILL, str(path), str(step), str(after), str(overwrite)]
    done = subprocess.run(words, env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}, capture_output=True)
    assert done.returncode == -9, done.stderr
    now = path.read_bytes() if path.exists() else None
    assert now in (OLD if overwrite else None, NEW)
    assert {file.suffix for file in tmp_path.iterdir()} <= {"", ".partial", ".lock"}
    write_text_file(path, "next")  # what is left is in nobody's way
    assert path.read_text() == "next"


@given(st.binary(max_size=100), st.binary(max_size=100), st.booleans())
def test_what_is_written_is_there(tmp_path_factory, old, new, overwrite):
    path = tmp_path_factory.mktemp("files") / "ü 1"
    path.write_bytes(old)
    with contextlib.nullcontext() if overwrite else pytest.raises(FileExistsError), whole_file(path, overwrite) as file:
        file.write(new)
    assert path.read_bytes() == (new if overwrite else old)
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.parametrize("links", [True, False])
def test_without_overwrite_one_of_many_writers_wins(tmp_path, monkeypatch, links):
    """A file that appears while another is written stays, on file systems with and without links."""
    if not links:
        monkeypatch.setattr(files.os, "link", lambda *_: refuse())
    path = tmp_path / "a"
    with pytest.raises(FileExistsError), whole_file(path, overwrite=False) as late:
        late.write(b"late")
        path.write_text("first")  # by another program, which knows nothing of locks
    assert path.read_text() == "first"
    assert list(tmp_path.iterdir()) == [path]


def test_writers_at_once_leave_one_whole_file(tmp_path):
    path = tmp_path / "a"
    texts = [str(k) * 200_000 for k in range(8)]
    threads = [threading.Thread(target=write_text_file, args=(path, text)) for text in texts]
    threads += [threading.Thread(target=write_study_text, args=(tmp_path / "b", text, True)) for text in texts]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert path.read_text() in texts
    assert (tmp_path / "b").read_text() in texts
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a", "b"]


def test_the_longest_name_can_be_written(tmp_path):
    path = tmp_path / ("ü" * 127)
    write_text_file(path, "x")
    assert path.read_text() == "x"


@pytest.fixture(scope="module")
def run():
    return simulate(two_sprockets(duration=0.001, settle="false"), record=Record(rate=1e4))


def test_two_exports_to_one_target_at_once(run, tmp_path, monkeypatch):
    """The second one is told who writes; the first one ends well."""
    archive, target = write_archive(run, tmp_path / "a.mcap"), tmp_path / "a.npz"
    plain, said = np.savez_compressed, []

    def slow(file, **arrays):
        with pytest.raises(ArchiveError) as caught:
            export(archive, target)
        said.append(str(caught.value))
        plain(file, **arrays)

    monkeypatch.setattr(np, "savez_compressed", slow)
    export(archive, target)
    who = f"process {os.getpid()} on {socket.gethostname()} is writing it, since "
    assert said[0].startswith(f"{target}: cannot be written ({who}")
    with np.load(target) as held:
        np.testing.assert_array_equal(held["position"], run[0].position)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a.mcap", "a.npz"]


@pytest.mark.parametrize("split", [None, 1])
def test_two_archives_of_one_name_at_once(run, tmp_path, split):
    """The second writer of a file or a set is told who writes, also where it may overwrite and in another form."""
    path = tmp_path / "a.mcap"
    with ArchiveWriter(path, run.drives, [0], run.info, ArchiveOptions(split_variants=split)) as first:
        for other in (None, 1):
            with pytest.raises(ArchiveError, match=rf"process {os.getpid()} on .* is writing it"):
                write_archive(run, path, overwrite=True, options=ArchiveOptions(split_variants=other))
        with pytest.raises(ArchiveError, match=r"No such file or directory\); a run is writing it"):
            read_archive(path)
        first.append(0, run[0])
        first.finish(run.metrics, run.info)
    assert_same(run, read_archive(path))
    assert len(list(tmp_path.iterdir())) == 1


HOLD = """
import sys, time
from pathlib import Path
from warpchain.files import WholeFile
file = WholeFile(Path(sys.argv[1]), hidden=False)
file.stream.write(b"to be recovered")
file.stream.flush()
print("writing", flush=True)
time.sleep(600)
"""


def test_a_killed_writer_holds_nothing_and_its_file_stays(tmp_path):
    """While it lives it keeps others out; killed, the next one writes, beside what it left, whatever its number was."""
    path = tmp_path / "a.mcap"
    words = [sys.executable, "-c", HOLD, str(path)]
    with subprocess.Popen(words, env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}, stdout=-1) as process:
        assert process.stdout.readline() == b"writing\n"
        with pytest.raises(OSError, match=f"process {process.pid} on"):
            write_text_now(path, "mine")
        (left,) = unfinished_files(path)
        assert files.is_being_written(left)
        files.remove_leftovers([left, *tmp_path.glob(".*")])
        assert left.read_bytes() == b"to be recovered"
        process.kill()
    assert not files.is_being_written(left)
    write_text_now(path, "mine")
    assert path.read_text() == "mine"
    assert left.read_bytes() == b"to be recovered"
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a.mcap", left.name]
    files.remove_leftovers([left])
    assert list(tmp_path.iterdir()) == [path]


def write_text_now(path, text):
    with whole_file(path) as file:
        file.write(text.encode())


def test_without_locks_files_are_written_all_the_same(tmp_path, monkeypatch):
    monkeypatch.setattr(files.fcntl, "flock", lambda *_: refuse())
    write_text_file(tmp_path / "a", "text")
    assert [(file.name, file.read_text()) for file in tmp_path.iterdir()] == [("a", "text")]
    left = tmp_path / ".a.1.partial"
    left.write_text("whose?")
    files.remove_leftovers([left])
    assert left.exists()  # nobody can tell whether it is being written


def test_only_files_are_replaced(tmp_path):
    """What is no regular file is refused and stays; a symbolic link to a file stays one."""
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "nowhere").symlink_to(tmp_path / "absent")
    (tmp_path / "real").write_text("old")
    (tmp_path / "link").symlink_to(tmp_path / "real")
    (tmp_path / "folder").mkdir()
    told = {"pipe": "a device or a pipe", "nowhere": "a symbolic link to nothing", "folder": "Is a directory"}
    for name, reason in told.items():
        with pytest.raises(OSError, match=reason):
            write_text_file(tmp_path / name, "x")
    with pytest.raises(OSError, match="a device or a pipe"):
        write_text_file(Path("/dev/null"), "x")
    write_text_file(tmp_path / "link", "new")
    assert (tmp_path / "real").read_text() == "new"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["folder", "link", "nowhere", "pipe", "real"]
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "nowhere").is_symlink()


def test_an_archive_that_appears_meanwhile_stays(run, tmp_path):
    path = tmp_path / "a.mcap"
    file = McapWriter(path, "test", overwrite=False)
    path.write_text("mine")
    with pytest.raises(ArchiveError, match=r"a\.mcap: exists already; give another name, or overwrite=True"):
        file.finish_file()
    file.close_unfinished()
    assert path.read_text() == "mine"
    assert list(tmp_path.iterdir()) == [path]


def test_temporary_names_are_nobody_elses(tmp_path, monkeypatch):
    """Processes of containers that share a folder may have the same number."""
    monkeypatch.setattr(files.os, "getpid", lambda: 1)
    names = [files.temporary_name(tmp_path / "a.mcap", hidden).name for hidden in (True, False) for _ in range(1000)]
    assert len(set(names)) == 2000
    assert all(name.startswith((".a.mcap.1-", "a.mcap.1-")) for name in names)


def test_refusals_are_one_line(tmp_path):
    with (
        pytest.raises(ArchiveError) as caught,
        refusals_as_errors("a", ArchiveError),
        whole_file(tmp_path / "none" / "a"),
    ):
        pass
    assert str(caught.value) == "a: cannot be written (No such file or directory)"
    with pytest.raises(ArchiveError) as caught, refusals_as_errors("a", ArchiveError):
        raise OSError("two\nlines")
    assert str(caught.value) == "a: cannot be written (two)"
    with pytest.raises(DriveError, match=r"^cannot be read: is a directory$"):
        read_text_file(tmp_path, "TOML", DriveError)
    (tmp_path / "a").write_bytes(b"abc\xff")
    with pytest.raises(DriveError, match=r"^not TOML: byte 3 is not UTF-8$"):
        read_text_file(tmp_path / "a", "TOML", DriveError)
    (tmp_path / "a").write_bytes(b"\xef\xbb\xbfa\r\n")
    assert read_text_file(tmp_path / "a", "TOML", DriveError) == "a\r\n"


@pytest.mark.parametrize("word", ["tempfile.NamedTemp", "os.replace(", "os.rename(", "os.fsync(", "os.link("])
def test_nobody_else_writes_files(word):
    root = Path(warpchain.__file__).parent
    users = [path.name for path in root.rglob("*.py") if word in path.read_text()]
    assert users in ([], ["files.py"])
