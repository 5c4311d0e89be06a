"""Whole-file writing: whatever ends it, and wherever, the old file is there whole, or the new one."""

import contextlib
import itertools
import os
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from drives import two_sprockets
from hypothesis import given
from hypothesis import strategies as st

import warpchain
from warpchain import Record, files, simulate, write_archive
from warpchain.archive.export import export_npz
from warpchain.archive.mcap_write import McapFile
from warpchain.errors import ArchiveError, DriveError
from warpchain.files import WholeFile, read_text, refusals, whole_file, write_text
from warpchain.study.store import write_text as write_study_text

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
        there = {file.name: file.read_bytes() for file in path.parent.iterdir() if file.name != "file"}
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
    assert {file.suffix for file in tmp_path.iterdir()} <= {"", ".partial"}
    write_text(path, "next")  # what is left is in nobody's way
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
        write_text(path, "first", overwrite=False)
    assert path.read_text() == "first"
    assert list(tmp_path.iterdir()) == [path]


def test_writers_at_once_leave_one_whole_file(tmp_path):
    path = tmp_path / "a"
    texts = [str(k) * 200_000 for k in range(8)]
    threads = [threading.Thread(target=write_text, args=(path, text)) for text in texts]
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
    write_text(path, "x")
    assert path.read_text() == "x"


@pytest.fixture(scope="module")
def run():
    return simulate(two_sprockets(duration=0.001, settle="false"), record=Record(rate=1e4))


def test_two_exports_to_one_target_at_once(run, tmp_path, monkeypatch):
    """Both have their temporary file open when either goes on; each ends well and the target is one of them."""
    archive = write_archive(run, tmp_path / "a.mcap")
    plain, both, problems = np.savez_compressed, threading.Barrier(2, timeout=60), []

    def slow(file, **arrays):
        both.wait()
        plain(file, **arrays)
        both.wait()

    def export():
        try:
            export_npz(archive, tmp_path / "a.npz")
        except BaseException as error:
            problems.append(error)

    monkeypatch.setattr(np, "savez_compressed", slow)
    threads = [threading.Thread(target=export) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not problems
    with np.load(tmp_path / "a.npz") as held:
        np.testing.assert_array_equal(held["position"], run[0].position)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a.mcap", "a.npz"]


def test_an_archive_that_appears_meanwhile_stays(run, tmp_path):
    path = tmp_path / "a.mcap"
    file = McapFile(path, "test", overwrite=False)
    path.write_text("mine")
    with pytest.raises(ArchiveError, match=r"a\.mcap: exists already; give another name, or --overwrite"):
        file.finish()
    file.close()
    assert path.read_text() == "mine"
    assert list(tmp_path.iterdir()) == [path]


def test_what_a_killed_process_of_the_same_number_left_stays(tmp_path):
    left = tmp_path / f"a.mcap.{os.getpid()}.partial"
    left.write_text("to be recovered")
    file = McapFile(tmp_path / "a.mcap", "test")
    assert file.partial.name.removeprefix("a.mcap.").removesuffix(".partial").isdigit()
    file.finish()
    assert left.read_text() == "to be recovered"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.mcap", left.name]


def test_a_temporary_name_that_is_taken_is_refused(tmp_path):
    (tmp_path / "p").write_text("mine")
    with pytest.raises(FileExistsError):
        WholeFile(tmp_path / "a", partial=tmp_path / "p")
    assert (tmp_path / "p").read_text() == "mine"


def test_refusals_are_one_line(tmp_path):
    with pytest.raises(ArchiveError) as caught, refusals("a", ArchiveError), whole_file(tmp_path / "none" / "a"):
        pass
    assert str(caught.value) == "a: cannot be written (No such file or directory)"
    with pytest.raises(ArchiveError) as caught, refusals("a", ArchiveError):
        raise OSError("two\nlines")
    assert str(caught.value) == "a: cannot be written (two)"
    with pytest.raises(DriveError, match=r"^cannot be read: is a directory$"):
        read_text(tmp_path, "TOML", DriveError)
    (tmp_path / "a").write_bytes(b"abc\xff")
    with pytest.raises(DriveError, match=r"^not TOML: byte 3 is not UTF-8$"):
        read_text(tmp_path / "a", "TOML", DriveError)
    (tmp_path / "a").write_bytes(b"\xef\xbb\xbfa\r\n")
    assert read_text(tmp_path / "a", "TOML", DriveError) == "a\r\n"


@pytest.mark.parametrize("word", ["tempfile.NamedTemp", "os.replace(", "os.rename(", "os.fsync(", "os.link("])
def test_nobody_else_writes_files(word):
    root = Path(warpchain.__file__).parent
    users = [path.name for path in root.rglob("*.py") if word in path.read_text()]
    assert users in ([], ["files.py"])
