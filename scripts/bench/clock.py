"""Which parts of a run take how long: functions of its modules, timed where they are called."""

import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any, NamedTuple
from unittest.mock import patch


class Part(NamedTuple):
    """A call: what it does in words, when it began and ended (`time.perf_counter`), and its thread's CPU time [s]."""

    word: str
    begin: float
    end: float
    cpu: float


@contextmanager
def noted(parts: Sequence[tuple[Any, str, str]]) -> Iterator[list[Part]]:
    """Notes the calls of functions: each by its owner, its name there, and what it does in words."""
    found: list[Part] = []

    def noting(called: Any, word: str) -> Any:
        def call(*args: Any, **options: Any) -> Any:
            begin, cpu = time.perf_counter(), time.thread_time()
            result = called(*args, **options)
            found.append(Part(word, begin, time.perf_counter(), time.thread_time() - cpu))
            return result

        return call

    with ExitStack() as stack:
        for owner, name, word in parts:
            stack.enter_context(patch.object(owner, name, noting(getattr(owner, name), word)))
        yield found
