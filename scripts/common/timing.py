"""Times: of jobs in turns, of functions where they are called, and on what machine."""

import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any
from unittest.mock import patch


def machine_line() -> Iterator[str]:
    """The machine and the versions that times are of, as lines."""
    import warp as wp

    from warpchain.engine.devices import processor_name, usable_gpus
    from warpchain.version import installed_version

    gpus = [wp.get_device(gpu).name for gpu in usable_gpus()]
    yield f"cpu: {processor_name()}, cores: {os.cpu_count()}, gpus: {gpus}"
    yield f"warpchain: {installed_version()}, warp: {wp.__version__}"


def run_in_turns(jobs: Mapping[str, Callable[[], float]], rounds: int) -> dict[str, list[float]]:
    """Numbers that jobs return, round by round: a slow spell of the machine slows all of them."""
    found: dict[str, list[float]] = {name: [] for name in jobs}
    for _ in range(rounds):
        for name, job in jobs.items():
            found[name].append(job())
    return found


def job_seconds(job: Callable[[], object]) -> float:
    """Seconds that a job takes."""
    begin = time.perf_counter()
    job()
    return time.perf_counter() - begin


def least_seconds(jobs: Mapping[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """The least time of each job [s], in turns."""
    timed = {name: lambda job=job: job_seconds(job) for name, job in jobs.items()}
    return {name: min(times) for name, times in run_in_turns(timed, rounds).items()}


def second_best_rate(rates: Sequence[float]) -> float:
    """The second best of some rates, or the best of fewer than three, 0 of none."""
    return sorted([0.0, *rates])[-2 if len(rates) > 2 else -1]


@contextmanager
def function_times(clock: Callable[[], float], *parts: tuple[Any, str]) -> Iterator[list[float]]:
    """Times [s] by a clock of each call of functions in a `with` block, each given by its owner and its name there."""
    found: list[float] = []

    def timed_function(called: Any) -> Any:
        """The function, whose calls' times are noted."""

        def call(*args: Any, **options: Any) -> Any:
            begin = clock()
            result = called(*args, **options)
            found.append(clock() - begin)
            return result

        return call

    with ExitStack() as stack:
        for owner, name in parts:
            stack.enter_context(patch.object(owner, name, timed_function(getattr(owner, name))))
        yield found
