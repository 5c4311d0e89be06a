"""Studies that are killed, spread over processes, and spread over a Dask cluster end in the same table, bit by bit."""

import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import suppress
from multiprocessing import get_context
from pathlib import Path

import pytest
from drives import of_long
from stopping import Killed, interruptions, killed_at_file_operation
from study_helpers import STUDY, write_study
from waiting import wait_for

from warpchain import cli
from warpchain.errors import StudyError
from warpchain.study.run import merge_study, run_study, runner, study_status
from warpchain.study.run.runner import read_runs
from warpchain.study.run.study_folder import open_folder

RECORD = '[record]\nevery = 5\nworst = { metric = "tension_max", count = 2 }\n'
SLOW = "[record]\nevery = 7\n"


def whole_files(folder):
    """Content of every Parquet file of a study's folder."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.glob("**/*.parquet"))}


def shards_done(folder):
    return len(list(folder.glob("shards/[0-9]*.parquet")))


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory):
    """A study file, and the files of its uninterrupted run."""
    home = tmp_path_factory.mktemp("study")
    source = write_study(home, RECORD)
    run_study(source, home / "out")
    return source, whole_files(home / "out")


def test_killed_at_any_file_operation_it_goes_on_to_the_same_bytes(tmp_path, monkeypatch):
    source = write_study(tmp_path, RECORD, points=2)
    run_study(source, tmp_path / "whole")
    wanted = whole_files(tmp_path / "whole")
    left = killed_at_file_operation(monkeypatch)
    for operation in range(1, 200):
        out = tmp_path / str(operation)
        left[0] = operation
        try:
            run_study(source, out)
        except Killed:
            left[0] = 7  # and killed once more on the way, where that comes to so many operations
            with suppress(Killed):
                run_study(source, out)
            left[0] = 0
            run_study(source, out)
            assert whole_files(out) == wanted
            assert not list(out.glob("**/.*"))
        else:
            break
    # four files to begin with, two shards, the worst and the results, of two operations each at least
    assert 2 * (4 + 2 + 1 + 1) < operation < 199


def command(source, out):
    return [sys.executable, "-m", "warpchain", "study", "run", str(source), "-o", str(out), "--quiet"]


@pytest.mark.long
def test_killed_by_signal_it_goes_on_to_the_same_bytes(tmp_path):
    source = write_study(tmp_path, SLOW, points=16, text=STUDY.replace("duration = 0.0005", "duration = 0.02"))
    out = tmp_path / "killed"
    for shards in (1, 6):
        process = subprocess.Popen(command(source, out), stderr=subprocess.PIPE)
        wait_for(lambda p=process, n=shards: shards_done(out) >= n or p.poll() is not None)
        process.send_signal(signal.SIGKILL)
        assert process.wait() == -signal.SIGKILL, process.stderr.read().decode()
        process.stderr.close()
        assert shards <= shards_done(out) < 16
        assert not (out / "results.parquet").exists()
    done = subprocess.run(command(source, out), capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    run_study(source, tmp_path / "whole")
    assert whole_files(out) == whole_files(tmp_path / "whole")


def test_ctrl_c_keeps_what_is_done(tmp_path):
    out = tmp_path / "out"
    source = write_study(tmp_path, points=16, text=STUDY.replace("duration = 0.0005", "duration = 0.3"))
    process = subprocess.Popen(command(source, out), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    wait_for(lambda: shards_done(out) >= 1 or process.poll() is not None)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 1
    assert err == "warpchain: interrupted; the shards that are done are kept: run again to go on\n"
    assert 1 <= study_status(out).shards[0] < 16


def test_ctrl_c_while_a_study_is_merged_ends_it_between_two_parts(tmp_path, monkeypatch):
    out, went_on = tmp_path / "out", []
    run_study(write_study(tmp_path, points=2), out)

    def interrupted(folder):
        signal.raise_signal(signal.SIGINT)
        went_on.append(folder)
        return read_runs(folder)

    monkeypatch.setattr(runner, "read_runs", interrupted)
    with pytest.raises(KeyboardInterrupt):
        merge_study(out)
    assert went_on


@pytest.mark.long
def test_ctrl_c_at_any_moment_ends_a_study_as_asked(tmp_path, capfd):
    source, ended = write_study(tmp_path, RECORD, points=2), set()
    run_study(source, tmp_path / "whole")
    for out, status, told in interruptions(["study", "run", str(source), "--quiet", "-o"], tmp_path, 12, capfd):
        ended.add(status)
        if status == 1:
            assert "interrupted" in told.err and told.err.count("\n") == 1, (out, told)
        else:  # all was done but the table, which needs no time
            assert (status, told.err) == (0, "") and (out / "results.parquet").exists(), (out, told)
        run_study(source, out)
        assert whole_files(out) == whole_files(tmp_path / "whole")
    assert 1 in ended


def test_parts_of_a_job_array_come_to_the_same_bytes(tmp_path, uninterrupted):
    source, wanted = uninterrupted
    for part in (2, 0, 1, 3, 7, 4, 5, 6):
        run_study(source, tmp_path / "out", part=(part, 8))
    assert not (tmp_path / "out" / "results.parquet").exists()
    assert cli.main(["study", "merge", str(tmp_path / "out")]) == 0
    assert whole_files(tmp_path / "out") == wanted


@pytest.mark.parametrize("kind", ["threads", *of_long("processes")])
def test_any_executor_comes_to_the_same_bytes(tmp_path, uninterrupted, kind):
    source, wanted = uninterrupted
    pool = ThreadPoolExecutor(2) if kind == "threads" else ProcessPoolExecutor(1, mp_context=get_context("spawn"))
    calls = []
    with pool:
        run_study(source, tmp_path / "out", executor=pool, workers=1, progress=lambda *told: calls.append(told))
    assert whole_files(tmp_path / "out") == wanted
    assert calls == [("running", 2.0 * n, 12.0) for n in range(1, 7)]


class Breaking(Executor):
    """Loses its worker at the third task, for good."""

    def __init__(self):
        self.tasks = 0

    def submit(self, function, /, *arguments, **settings):
        self.tasks += 1
        future = Future()
        if self.tasks < 3:
            future.set_result(function(*arguments, **settings))
        else:
            future.set_exception(BrokenExecutor("a process ended abruptly"))
        return future


def test_a_lost_worker_is_one_line_and_loses_nothing(tmp_path, uninterrupted):
    source, wanted = uninterrupted
    with pytest.raises(StudyError) as caught:
        run_study(source, tmp_path / "out", executor=Breaking())
    assert str(caught.value).endswith("a worker ended before its shard (a process ended abruptly); run again to go on")
    assert study_status(tmp_path / "out").shards == (2, 6)
    run_study(source, tmp_path / "out")
    assert whole_files(tmp_path / "out") == wanted


@pytest.mark.long
def test_a_dask_cluster_that_loses_a_worker_comes_to_the_same_bytes(tmp_path, monkeypatch):
    distributed = pytest.importorskip("distributed")
    root = Path(cli.__file__).parents[1]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(root), os.environ.get("PYTHONPATH", "")]))
    source = write_study(tmp_path, SLOW, points=16, text=STUDY.replace("duration = 0.0005", "duration = 0.02"))
    out = tmp_path / "out"
    settings = {"n_workers": 2, "threads_per_worker": 1, "processes": True, "dashboard_address": None}
    with distributed.LocalCluster(**settings) as cluster, distributed.Client(cluster) as client:
        first, second = client.run(os.getpid).values()
        assert len({first, second, os.getpid()}) == 3
        seen = []

        def kill():
            wait_for(lambda: shards_done(out) >= 2)
            os.kill(first, signal.SIGKILL)
            seen.append(shards_done(out))

        killer = threading.Thread(target=kill)
        killer.start()
        words = ["study", "run", str(source), "-o", str(out), "--scheduler", cluster.scheduler_address]
        assert cli.main([*words, "--workers", "1", "--quiet"]) == 0
        killer.join()
        assert 2 <= seen[0] < 16  # it died in the middle
    run_study(source, tmp_path / "whole")
    assert open_folder(out).shard_size == 2
    assert whole_files(out) == whole_files(tmp_path / "whole")


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nonsense://"])
def test_a_scheduler_that_does_not_answer_is_one_line(tmp_path, capsys, address):
    pytest.importorskip("distributed")
    words = ["study", "run", str(write_study(tmp_path)), "-o", str(tmp_path / "out"), "--scheduler", address]
    begin = time.perf_counter()
    assert cli.main(words) == 2
    assert time.perf_counter() - begin < 5.0  # a refused connection; it was 32 s
    (line,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("warpchain: error")]
    assert f"--scheduler {address}: no Dask scheduler answers" in line
