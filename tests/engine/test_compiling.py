"""Kernels compiled in processes of their own, for a GPU that is not here."""

import sys
from dataclasses import replace
from types import SimpleNamespace

import pytest
import warp as wp
from drives import MARINE, two_sprockets

from warpchain import load_drive, progress
from warpchain.engine import buckets, compiling
from warpchain.engine.buckets import COLLECTING, GpuKernels
from warpchain.engine.compiling import Wanted, compile_in_processes, compile_job, jobs_of
from warpchain.engine.gpu import compile_lacking
from warpchain.engine.pack import pack
from warpchain.engine.settling import cushion, elastic
from warpchain.kernels.gpu.statistics import collect_kernel
from warpchain.progress import Stop
from warpchain.results.schedule import Schedule

COLLECT = [Wanted(collect_kernel, (real,), COLLECTING) for real in (wp.float64, wp.float32)]


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
    monkeypatch.setattr(buckets, "wp", order)
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(tmp_path))
    return tmp_path


def compiled(jobs, cores=2, stop=None, report=lambda *_: None):
    """Whether each kernel is in the cache thereafter."""
    compile_in_processes(jobs, cores, report, stop or Stop())
    return [job.path.exists() for job in jobs]


def test_a_process_compiles_what_the_caller_looks_for(cache, monkeypatch):
    monkeypatch.setattr(wp.config, "use_precompiled_headers", True)  # the process does without
    jobs, seen = list(jobs_of(COLLECT, "cuda:0")), []
    assert all(compiled([*jobs, jobs[0]], report=lambda *told: seen.append(told)))
    assert {told[0] for told in seen} == {"compiling"} and seen[-1] == ("compiling", 2, 2)
    assert {path.suffix for path in cache.glob("*/*.sm90.*")} == {".cubin"}
    assert {path.name for path in cache.iterdir()} == {job.path.parent.name for job in jobs}  # nothing unfinished
    assert not list(jobs_of(COLLECT, "cuda:0"))
    for job in jobs:
        options = job.wanted.module.resolved_options[COLLECTING]
        assert not job.wanted.module._compile(None, None, job.path.name, 90, False, options=options)  # Warp finds it


def test_where_processes_gain_nothing_there_are_none(cache, monkeypatch):
    monkeypatch.setattr(compiling, "_started", lambda job: pytest.fail("started"))
    jobs = list(jobs_of(COLLECT, "cuda:0"))
    assert not any(compiled([]) or compiled(jobs[:1]) or compiled(jobs, cores=1))
    monkeypatch.setattr(sys, "executable", "")
    assert not any(compiled(jobs))


@pytest.mark.parametrize("program", ["/bin/false", "/nowhere"])
def test_a_process_that_fails_leaves_its_kernel_to_the_caller(cache, monkeypatch, program):
    monkeypatch.setattr(sys, "executable", program)
    assert not any(compiled(list(jobs_of(COLLECT, "cuda:0"))))


def test_what_is_not_the_kernel_that_was_meant_is_not_compiled(cache):
    (job,) = jobs_of(COLLECT[:1], "cuda:0")
    compile_job(replace(job, path=cache / "wp_of_other_laws" / job.path.name))
    assert not list(cache.iterdir())


def test_a_stop_ends_processes_and_leaves_nothing_unfinished(cache, monkeypatch):
    stop, processes, start = Stop(), [], compiling._started
    monkeypatch.setattr(compiling, "_started", lambda job: processes.append(start(job)) or processes[-1])
    compiled(list(jobs_of(COLLECT, "cuda:0")), stop=stop, report=lambda *_: list(cache.glob("*_p*")) and stop.ask())
    assert len(processes) == 2 and all(process.returncode is not None for process in processes)
    assert not list(cache.glob("*_p*"))


@pytest.mark.parametrize("settles", [True, False])
def test_all_that_a_run_needs_is_compiled_at_once(cache, monkeypatch, settles):
    """Settling's kernel in float64, and as the settling of the ensemble asks for it."""
    drives = [load_drive(MARINE), two_sprockets()]
    packed = pack(drives, [Schedule(1e-6, 500, 250, 500, 0)] * 2)
    still = elastic(packed)
    cushion(still)
    asked = []
    monkeypatch.setattr("warpchain.engine.gpu.compile_in_processes", lambda jobs, *_: asked.extend(jobs))
    compile_lacking([("cuda:0", packed)], "float32", settles, 2, print, Stop())
    steps = GpuKernels(packed.at_precision("float32"), "cuda:0").wanted()
    assert len(steps) == 5
    relax = GpuKernels(still, "cuda:0").wanted("relax") if settles else []
    assert [job.wanted for job in asked] == [*steps, *relax]


def test_bars_follow_phases_that_come_again(capsys, monkeypatch):
    monkeypatch.setattr(progress, "EVERY", 0.0)
    with progress.reporter(True) as report:
        for told in (("simulating", 0, 8), ("compiling", 1, 2), ("simulating", 4, 8)):
            report(*told)
    _, compiling_line, last = capsys.readouterr().err.splitlines()
    assert compiling_line.startswith("compiling: 50 % of 2 kernel, ")
    assert last.startswith("simulating: 50 % of 8 roller-step, ")
