"""Compilation of kernels that Warp's cache lacks: the CPU's in threads, a GPU's in processes."""

from __future__ import annotations

import contextlib
import gc
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

from warpchain.drive.plugins import load_plugins_of_parent, plugins_environment
from warpchain.progress import COMPILING, ProgressReport, StopRequest
from warpchain.python_process import can_start_python, start_python

if TYPE_CHECKING:
    import warp as wp

POLL_INTERVAL = 0.05
"""Seconds between polls of compiling threads or processes."""


@contextlib.contextmanager
def load_cpu_kernels(modules: Sequence[Any], report: ProgressReport) -> Iterator[None]:
    """Context that compiles and loads the CPU's kernels in threads."""
    import warp as wp

    lacking = sum(not is_cached(module, "cpu", 1) for module in modules)
    with ThreadPoolExecutor(len(modules)) as pool:
        last_first = [pool.submit(wp.load_module, module, device="cpu", block_dim=1) for module in reversed(modules)]
        loads = last_first[::-1]

        def wait_for(some: Sequence[Future[Any]]) -> None:
            """Waits for kernels' modules, reporting progress; raises their errors."""
            going = True
            while going:
                going = bool(wait(some, timeout=POLL_INTERVAL).not_done)
                if lacking:
                    report(COMPILING, max(0, lacking - sum(not load.done() for load in loads)), lacking)
            for load in some:
                load.result()

        wait_for(loads[:-1])
        yield
        wait_for(loads)


PORTABLE_PROCESSOR = "x86-64-v3"
"""Processors of a portable object file: with AVX2, FMA and BMI2."""


def portable_object(kernel: wp.Kernel) -> tuple[Path, str]:
    """Object file, compiled if need be, of a CPU kernel for `PORTABLE_PROCESSOR`, and its symbol."""
    import warp as wp

    module = kernel.module
    flags = str(wp.config.cpu_compiler_flags or "-march=native")
    before = {name: module.options[name] for name in ("cpu_compiler_flags", "block_dim")}
    portable = flags.replace("-march=native", f"-target-cpu {PORTABLE_PROCESSOR}")
    wp.set_module_options({"cpu_compiler_flags": portable, "block_dim": 1}, module)
    try:
        (path,) = wp.compile_aot_module(module, "cpu")
        return path, f"{kernel.get_mangled_name()}_cpu_forward"
    finally:
        wp.set_module_options(before, module)


class KernelSpec(NamedTuple):
    """Specification of a kernel to compile."""

    factory: Callable[..., wp.Kernel]  # gives the same kernel for the same arguments
    arguments: tuple[Any, ...]
    threads: int  # of a block

    @property
    def module(self) -> Any:
        """Warp module of the specified kernel alone."""
        return self.factory(*self.arguments).module


def is_cached(module: Any, device: str, threads: int) -> bool:
    """Whether Warp's cache has a kernel's module."""
    try:
        return _cache_path(module, device, threads).exists()
    except (AttributeError, TypeError):
        return True


def _cache_path(module: Any, device: str, threads: int) -> Path:
    """File of Warp's cache for a kernel's module."""
    import warp as wp

    name = module._get_compile_output_name(wp.get_device(device), block_dim=threads)
    return Path(str(wp.config.kernel_cache_dir)) / module.get_module_identifier(threads) / name


@dataclass(frozen=True)
class CompileJob:
    """Job to compile a kernel to a cache file."""

    spec: KernelSpec
    arch: int
    ptx: bool
    path: Path
    laws: tuple[str, ...]  # plug-ins', that kernels know


def compile_jobs(wanted: Iterable[KernelSpec], device: str) -> Iterator[CompileJob]:
    """Compile jobs for the GPU kernels that Warp's cache lacks."""
    import warp as wp

    from warpchain.engine.own_laws import added_laws

    for of in wanted:
        module, gpu = of.module, wp.get_device(device)
        if not is_cached(module, device, of.threads):
            yield CompileJob(
                of,
                module._get_compile_arch(gpu),
                module._use_ptx(gpu),
                _cache_path(module, device, of.threads),
                added_laws(),
            )


def compile_in_processes(jobs: Sequence[CompileJob], cores: int, report: ProgressReport, stop: StopRequest) -> None:
    """Compiles kernels in processes, longest jobs first, until a stop is asked for; the caller has a single one."""
    left = list({job.path: job for job in jobs}.values())
    processes: list[tuple[CompileJob, subprocess.Popen[bytes]]] = []
    count, running = len(left), 0
    if count:
        report(COMPILING, 0, count)
    if min(count, cores) < 2 or not can_start_python():
        return
    try:
        while (left or running) and not stop.is_asked:
            for job in left[: cores - running]:
                with contextlib.suppress(OSError):  # no process, or no memory for one
                    processes.append((job, _start_compiler(job)))
            del left[: cores - running]
            running = sum(process.poll() is None for _, process in processes)
            report(COMPILING, count - len(left) - running, count)
            time.sleep(POLL_INTERVAL)
    finally:
        for job, process in processes:
            process.kill()
            process.wait()
            for unfinished in job.path.parents[1].glob(f"{job.path.parent.name}_p{process.pid}_*"):
                shutil.rmtree(unfinished, ignore_errors=True)


def _start_compiler(job: CompileJob) -> subprocess.Popen[bytes]:
    """Process that compiles a kernel."""
    process = start_python(__name__, environment=plugins_environment())
    assert process.stdin is not None
    with contextlib.suppress(BrokenPipeError), process.stdin as pipe:  # it may have ended
        pipe.write(pickle.dumps(job))
    return process


def compile_job(job: CompileJob) -> None:
    """Compiles a kernel to Warp's cache."""
    import warp as wp

    from warpchain.engine import start_warp
    from warpchain.engine.own_laws import add_laws

    start_warp(precompiled=False)
    if job.laws:
        load_plugins_of_parent()
        add_laws(job.laws)
    wp.config.kernel_cache_dir = str(job.path.parents[1])
    module, threads = job.spec.module, job.spec.threads
    if module.get_module_identifier(threads) == job.path.parent.name:
        options = module.resolved_options[threads]
        module._compile(None, None, job.path.name, job.arch, job.ptx, options=options)


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # the compiler would not hear of it
    gc.disable()  # a short life, whose many objects stay
    compile_job(pickle.load(sys.stdin.buffer))
