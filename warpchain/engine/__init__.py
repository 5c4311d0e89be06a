"""Runs ensembles of drives on CPUs and GPUs: packing, settling, stepping, recording. Only this folder uses kernels."""

from __future__ import annotations

import atexit
import contextlib
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from warpchain.errors import WarpchainError

KERNELS = Path(__file__).resolve().parent.parent / "kernels"
if KERNELS.is_file():
    raise WarpchainError(
        f"{KERNELS}: is a text file, not a link to the folder kernels: git made this checkout without symbolic links; "
        "set core.symlinks to true and check out again (on Windows in WSL), or install a wheel"
    )


def _is_warp_started() -> bool:
    """Whether Warp runs already."""
    return getattr(sys.modules.get("warp._src.context"), "runtime", None) is not None


CACHE_VARIABLE = "WARP_CACHE_PATH"
"""Environment variable of Warp's folder of compiled kernels."""


def _init_warp() -> None:
    """Starts Warp, with a temporary kernel cache if need be."""
    import warp as wp

    with contextlib.suppress(OSError):
        wp.init()
    kept = Path(str(wp.config.kernel_cache_dir))
    if os.access(kept, os.W_OK):
        return
    temporary = tempfile.mkdtemp(prefix="warpchain-kernels-")
    atexit.register(shutil.rmtree, temporary, ignore_errors=True)
    os.environ[CACHE_VARIABLE] = wp.config.kernel_cache_dir = temporary
    folder = Path(temporary, wp.config.version)
    folder.mkdir()
    with contextlib.suppress(OSError):  # there is no cache at all
        for module in kept.iterdir():
            (folder / module.name).symlink_to(module)
    wp.init()
    wp.config.kernel_cache_dir = str(folder)  # where it had started already, too


def start_warp(precompiled: bool = True) -> None:
    """Starts Warp, once, silently; CUDA's compiler may warn of `precompiled` headers."""
    import warp as wp

    if _is_warp_started():
        return
    if wp.config.log_level == wp.LOG_INFO:
        wp.config.log_level = wp.LOG_ERROR
    if not precompiled:
        wp.config.use_precompiled_headers = False
    before = os.environ.get(CACHE_VARIABLE)
    with _silenced_stderr() if wp.config.log_level >= wp.LOG_ERROR else contextlib.nullcontext():
        _init_warp()
    if os.environ.get(CACHE_VARIABLE) != before:
        line = f"the folder of compiled kernels cannot be written; set {CACHE_VARIABLE} to one that keeps them"
        print(f"warpchain: {line}", file=sys.stderr, flush=True)


@contextlib.contextmanager
def _silenced_stderr() -> Iterator[None]:
    """Context that discards this process's stderr."""
    sys.stderr.flush()
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)
