"""Another Python process for a module of this package, on one core and without a GPU.

Unlike `multiprocessing` it does not import the program that runs here, so scripts need no guard.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping

ONE_CORE = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""Environment that keeps numpy's libraries to one core."""


def can_start_python() -> bool:
    """Whether this Python can start another one."""
    return bool(sys.executable) and not getattr(sys, "frozen", False)


def start_python(
    module: str, answers: int = subprocess.DEVNULL, environment: Mapping[str, str] | None = None
) -> subprocess.Popen[bytes]:
    """Starts a Python process that runs a module of this package on its input.

    Args:
        answers: its output.
        environment: variables that it has beside this process's.
    """
    paths = os.pathsep.join(filter(None, map(str, sys.path)))
    return subprocess.Popen(
        [sys.executable, "-P", "-m", module],
        env=os.environ | ONE_CORE | {"PYTHONPATH": paths, "CUDA_VISIBLE_DEVICES": ""} | dict(environment or {}),
        stdin=subprocess.PIPE,
        stdout=answers,
        stderr=subprocess.DEVNULL,
    )
