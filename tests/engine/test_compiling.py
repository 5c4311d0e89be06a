"""Kernels compiled in processes of their own, for a GPU that is not here."""

import os
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
import warp as wp
from command import run as command
from drives import example, two_sprockets
from own_files import LAW, write_plugin
from study_helpers import write_study

from warpchain import load_plugin, progress, run_study, simulate
from warpchain.engine import compilation, gpu_kernels
from warpchain.engine.compilation import KernelSpec, compile_in_processes, compile_job, compile_jobs, load_cpu_kernels
from warpchain.engine.gpu import compile_missing_kernels
from warpchain.engine.gpu_kernels import TALLY_SUM_THREADS, GpuKernels
from warpchain.engine.own_laws import add_laws
from warpchain.engine.pack import pack
from warpchain.engine.settling import damp_arm_contacts, settling_ensemble
from warpchain.kernels.gpu.statistics import tally_sum_kernel
from warpchain.progress import StopRequest
from warpchain.results.schedule import Schedule

TELLS = "compiling kernels (the first time only, some 10 s on two free cores): "
COLLECT = [KernelSpec(tally_sum_kernel, (real,), TALLY_SUM_THREADS) for real in (wp.float64, wp.float32)]


@pytest.fixture
def cache(monkeypatch, tmp_path):
    """An empty kernel cache, and a GPU "cuda:0" of architecture 9.0."""
    gpu = SimpleNamespace(
        is_cpu=False,
        sm_count=132,
        max_shared_memory_per_block=232_448,
        get_cuda_compile_arch=lambda: 90,
        get_cuda_output_format=lambda wanted: "cubin",
        _get_cuda_arch_suffix=lambda arch: "",
    )
    monkeypatch.setattr(wp, "get_device", lambda name: gpu)
    order = SimpleNamespace(get_device=wp.get_device, array=lambda values, **_: values, int32=wp.int32)
    monkeypatch.setattr(gpu_kernels, "wp", order)
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(tmp_path))
    return tmp_path


def compiled(jobs, cores=2, stop=None, report=lambda *_: None):
    """Whether each kernel is in the cache thereafter."""
    compile_in_processes(jobs, cores, report, stop or StopRequest())
    return [job.path.exists() for job in jobs]


@pytest.mark.long
def test_a_process_compiles_what_the_caller_looks_for(cache, monkeypatch):
    monkeypatch.setattr(wp.config, "use_precompiled_headers", True)  # the process does without
    jobs, seen = list(compile_jobs(COLLECT, "cuda:0")), []
    assert all(compiled([*jobs, jobs[0]], report=lambda *told: seen.append(told)))
    assert {told[0] for told in seen} == {"compiling"} and seen[-1] == ("compiling", 2, 2)
    assert {path.suffix for path in cache.glob("*/*.sm90.*")} == {".cubin"}
    assert {path.name for path in cache.iterdir()} == {job.path.parent.name for job in jobs}  # nothing unfinished
    assert not list(compile_jobs(COLLECT, "cuda:0"))
    for job in jobs:
        options = job.spec.module.resolved_options[TALLY_SUM_THREADS]
        assert not job.spec.module._compile(None, None, job.path.name, 90, False, options=options)  # Warp finds it


@pytest.mark.long
@pytest.mark.usefixtures("own_plugins")
def test_a_process_knows_the_laws_of_plugins(request, tmp_path_factory):
    load_plugin(write_plugin(tmp_path_factory.mktemp("own"), LAW))
    add_laws(["approach"])  # tried on the CPU, before there is but the GPU
    request.getfixturevalue("cache")
    jobs = list(compile_jobs(COLLECT, "cuda:0"))
    assert all(job.laws == ("approach",) for job in jobs)
    assert all(compiled(jobs))


def test_where_processes_gain_nothing_there_are_none(cache, monkeypatch):
    monkeypatch.setattr(compilation, "_start_compiler", lambda job: pytest.fail("started"))
    jobs, seen = list(compile_jobs(COLLECT, "cuda:0")), []
    assert not any(compiled([]) or compiled(jobs, cores=1))
    assert not any(compiled(jobs[:1], report=lambda *told: seen.append(told)))
    assert seen == [("compiling", 0, 1)]  # the caller compiles it
    monkeypatch.setattr(sys, "executable", "")
    assert not any(compiled(jobs))


@pytest.mark.parametrize("program", ["/bin/false", "/nowhere"])
def test_a_process_that_fails_leaves_its_kernel_to_the_caller(cache, monkeypatch, program):
    monkeypatch.setattr(sys, "executable", program)
    assert not any(compiled(list(compile_jobs(COLLECT, "cuda:0"))))


def test_what_is_not_the_kernel_that_was_meant_is_not_compiled(cache):
    (job,) = compile_jobs(COLLECT[:1], "cuda:0")
    compile_job(replace(job, path=cache / "wp_of_other_laws" / job.path.name))
    assert not list(cache.iterdir())


def test_a_stop_ends_processes_and_leaves_nothing_unfinished(cache, monkeypatch):
    stop, processes, start = StopRequest(), [], compilation._start_compiler
    monkeypatch.setattr(compilation, "_start_compiler", lambda job: processes.append(start(job)) or processes[-1])
    compiled(
        list(compile_jobs(COLLECT, "cuda:0")),
        stop=stop,
        report=lambda *_: list(cache.glob("*_p*")) and stop.ask_to_stop(),
    )
    assert len(processes) == 2 and all(process.returncode is not None for process in processes)
    assert not list(cache.glob("*_p*"))


@pytest.mark.parametrize("settles", [True, False])
def test_all_that_a_run_needs_is_compiled_at_once(cache, monkeypatch, settles):
    """Settling's kernel in float64, and as the settling of the ensemble asks for it."""
    drives = [example("marine"), two_sprockets()]
    packed = pack(drives, [Schedule(1e-6, 500, 250, 500, 0)] * 2)
    still = settling_ensemble(packed)
    damp_arm_contacts(still)
    asked = []
    monkeypatch.setattr("warpchain.engine.gpu.compile_in_processes", lambda jobs, *_: asked.extend(jobs))
    compile_missing_kernels("cuda:0", packed, "float32", settles, 2, print, StopRequest())
    steps = GpuKernels(packed.at_precision("float32"), "cuda:0").kernel_specs()
    assert len(steps) == 5
    relax = GpuKernels(still, "cuda:0").kernel_specs("relax") if settles else []
    assert [job.spec for job in asked] == [*steps, *relax]


def test_bars_follow_phases_that_come_again(capsys, monkeypatch):
    monkeypatch.setattr(progress, "LINE_INTERVAL", 0.0)
    with progress.progress_reporter(True) as report:
        for told in (("simulating", 0, 0.8), ("compiling", 1, 2), ("settling", 1, 4), ("simulating", 0.4, 0.8)):
            report(*told)
    _, *lines = (line.partition(" elapsed")[0].rpartition(", ")[0] for line in capsys.readouterr().err.splitlines())
    assert lines == [
        f"{TELLS}1 of 2 done",
        "settling: 25 % of 4 drives",
        "simulating: 50 %, 0.4 of 0.8 s of simulated time",
    ]


def test_compiling_is_told_at_once_where_other_phases_wait(capsys):
    with progress.progress_reporter(True) as report:
        for told in (("compiling", 0, 2), ("compiling", 1, 2), ("simulating", 0.1, 0.8)):
            report(*told)
    assert capsys.readouterr().err == f"{TELLS}0 of 2 done, 0 s elapsed\n"


def test_a_phase_that_comes_again_goes_on_with_its_time(capsys, monkeypatch):
    """As where a kernel is compiled still while drives settle."""
    now = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    with progress.progress_reporter(True) as report:
        for now[0], phase, done in ((0.0, "compiling", 0), (20.0, "settling", 1), (30.0, "compiling", 1)):
            report(phase, done, 2)
    lines = capsys.readouterr().err.splitlines()
    assert lines == [f"{TELLS}0 of 2 done, 0 s elapsed", f"{TELLS}1 of 2 done, 30 s elapsed"]


def test_the_cpu_tells_of_kernels_that_it_compiles(monkeypatch):
    """Settling's kernel is there before settling begins, that of steps may follow; counts never fall."""
    loaded, seen, settled = [], [], threading.Event()

    def load(module, **_):
        if module == "advance":
            assert settled.wait(30.0)
        loaded.append(module)

    monkeypatch.setattr(wp, "load_module", load)
    monkeypatch.setattr(compilation, "is_cached", lambda *_: False)
    with load_cpu_kernels(["relax", "advance"], lambda *told: seen.append(told)):
        assert loaded == ["relax"] and seen[-1][1] >= 1.0
        settled.set()
    assert {(phase, total) for phase, _, total in seen} == {("compiling", 2)}
    done = [done for _, done, _ in seen]
    assert done == sorted(done) and done[-1] == 2.0 and loaded == ["relax", "advance"]
    seen.clear()
    monkeypatch.setattr(compilation, "is_cached", lambda *_: True)
    with load_cpu_kernels(["relax"], lambda *told: seen.append(told)):
        pass
    assert not seen


def test_a_run_and_a_study_say_that_they_compile(capsys, monkeypatch, tmp_path):
    """With a cache that is said to be empty: the kernels of settling and of steps; a command's bars, and a study's."""
    monkeypatch.setattr(compilation, "is_cached", lambda *_: False)
    seen = []
    simulate(two_sprockets(duration=0.001), progress=lambda *told: seen.append(told))
    assert seen[0][0] == "compiling" and seen[0][2] == 2 and seen[-1][0] == "simulating"
    assert command(capsys, "run", "industrial", "--duration", "1e-3", "-o", tmp_path / "a.mcap")[2][0].startswith(TELLS)
    run_study(write_study(tmp_path), tmp_path / "out", progress=True)
    assert capsys.readouterr().err.startswith(TELLS)


def test_a_cache_that_cannot_be_written_gives_way_to_a_temporary_one(tmp_path):
    """Where no folder can be made, as in a home that is read-only: said once, with the variable, and removed after."""
    (tmp_path / "file").touch()
    code = "import warpchain.engine as e, warp; e.start_warp(); e.start_warp(); print(warp.config.kernel_cache_dir)"
    variables = {name: value for name, value in os.environ.items() if name != "WARP_CACHE_PATH"}
    variables |= {"XDG_CACHE_HOME": str(tmp_path / "file"), "TMPDIR": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", code], env=variables, capture_output=True, text=True, check=True)
    assert Path(done.stdout.strip()).is_relative_to(tmp_path)
    assert done.stderr == (
        "warpchain: the folder of compiled kernels cannot be written; set WARP_CACHE_PATH to one that keeps them\n"
    )
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
