"""Kernels that Warp's cache lacks: the CPU's compiled in threads, a GPU's in processes of their own.

CUDA's compiler takes one kernel after the other within a process, however many threads ask. Here each kernel gets a
process, which makes it anew, compiles it for the caller's GPU without using one, and puts it into Warp's cache, where
the caller finds it. A process that fails leaves its kernel to the caller, who compiles what is not in the cache when it
is loaded, and tells what is wrong.
"""

from __future__ import annotations

import contextlib
import pickle
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from warpchain.progress import COMPILING, ProgressReport, StopRequest
from warpchain.python_process import can_start_python, start_python

if TYPE_CHECKING:
    import warp as wp

EVERY = 0.05
"""Seconds between two looks at the processes."""


@contextlib.contextmanager
def loading_on_cpu(modules: Sequence[Any], report: ProgressReport) -> Iterator[None]:
    """Loads the CPU's kernels side by side, all but the last before what stands within, which does without that one.

    The last, that of steps, takes longest to compile and begins first.
    """
    import warp as wp

    lacking = sum(not in_cache(module, "cpu", 1) for module in modules)
    with ThreadPoolExecutor(len(modules)) as pool:
        last_first = [pool.submit(wp.load_module, module, device="cpu", block_dim=1) for module in reversed(modules)]
        loads = last_first[::-1]

        def wait_for(some: Sequence[Future[Any]]) -> None:
            going = True
            while going:
                going = bool(wait(some, timeout=EVERY).not_done)
                if lacking:
                    report(COMPILING, max(0, lacking - sum(not load.done() for load in loads)), lacking)
            for load in some:
                load.result()

        wait_for(loads[:-1])
        yield
        wait_for(loads)


class Wanted(NamedTuple):
    """A kernel by what makes it.

    Attributes:
        factory: gives the same kernel whenever it is asked for the same.
        form: what it is asked for.
        threads: of a block.
    """

    factory: Callable[..., wp.Kernel]
    form: tuple[Any, ...]
    threads: int

    @property
    def module(self) -> Any:
        """The kernel's module, of which it is the only one."""
        return self.factory(*self.form).module


def in_cache(module: Any, device: str, threads: int) -> bool:
    """Whether Warp finds a module compiled, for a device and blocks of so many threads.

    True where this version of Warp does not tell.
    """
    try:
        return _path(module, device, threads).exists()
    except (AttributeError, TypeError):
        return True


def _path(module: Any, device: str, threads: int) -> Path:
    """Where Warp's cache keeps a module."""
    import warp as wp

    name = module._get_compile_output_name(wp.get_device(device), block_dim=threads)
    return Path(str(wp.config.kernel_cache_dir)) / module.get_module_identifier(threads) / name


@dataclass(frozen=True)
class Job:
    """A kernel to compile: for which architecture, whether to intermediate code, and to which file of the cache."""

    wanted: Wanted
    arch: int
    ptx: bool
    path: Path


def jobs_of(wanted: Iterable[Wanted], device: str) -> Iterator[Job]:
    """The kernels that a GPU needs and Warp's cache lacks."""
    import warp as wp

    for of in wanted:
        module, gpu = of.module, wp.get_device(device)
        if not in_cache(module, device, of.threads):
            yield Job(of, module._get_compile_arch(gpu), module._use_ptx(gpu), _path(module, device, of.threads))


def compile_in_processes(jobs: Sequence[Job], cores: int, report: ProgressReport, stop: StopRequest) -> None:
    """Compiles kernels, at most one on a core at a time, until a stop is asked for.

    A single one, which gains nothing, is left to the caller, but reported.

    Args:
        jobs: those that take longest first; what is there twice is done once.
        cores: of this machine.
        report, stop: of the run.
    """
    left = list({job.path: job for job in jobs}.values())
    processes: list[tuple[Job, subprocess.Popen[bytes]]] = []
    count, running = len(left), 0
    if count:
        report(COMPILING, 0, count)
    if min(count, cores) < 2 or not can_start_python():
        return
    try:
        while (left or running) and not stop.is_asked:
            for job in left[: cores - running]:
                with contextlib.suppress(OSError):  # no process, or no memory for one
                    processes.append((job, _started(job)))
            del left[: cores - running]
            running = sum(process.poll() is None for _, process in processes)
            report(COMPILING, count - len(left) - running, count)
            time.sleep(EVERY)
    finally:
        for job, process in processes:
            process.kill()
            process.wait()
            for unfinished in job.path.parents[1].glob(f"{job.path.parent.name}_p{process.pid}_*"):
                shutil.rmtree(unfinished, ignore_errors=True)


def _started(job: Job) -> subprocess.Popen[bytes]:
    """A process that compiles a kernel."""
    process = start_python(__name__)
    assert process.stdin is not None
    with contextlib.suppress(BrokenPipeError), process.stdin as pipe:  # it may have ended
        pipe.write(pickle.dumps(job))
    return process


def compile_job(job: Job) -> None:
    """Compiles a kernel, unless it is not the one that was meant, as where laws have been added at runtime."""
    import warp as wp

    from warpchain.engine import start_warp

    start_warp(precompiled=False)
    wp.config.kernel_cache_dir = str(job.path.parents[1])
    module, threads = job.wanted.module, job.wanted.threads
    if module.get_module_identifier(threads) == job.path.parent.name:
        options = module.resolved_options[threads]
        module._compile(None, None, job.path.name, job.arch, job.ptx, options=options)


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # the compiler would not hear of it
    compile_job(pickle.load(sys.stdin.buffer))
