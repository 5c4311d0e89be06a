"""Runs ensembles of drives on CPUs and GPUs; the only users of Warp beside the kernels."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from warpchain.errors import WarpchainError

KERNELS = Path(__file__).resolve().parent.parent / "kernels"
if KERNELS.is_file():
    raise WarpchainError(
        f"{KERNELS}: is a text file, not a link to the folder kernels: git made this checkout without symbolic links; "
        "set core.symlinks to true and check out again (on Windows in WSL), or install a wheel"
    )


def _started() -> bool:
    """Whether Warp runs already, which it says nowhere in public; False where a version keeps it elsewhere.

    To start it twice does no more than set how much it says.
    """
    return getattr(sys.modules.get("warp._src.context"), "runtime", None) is not None


def start_warp(precompiled: bool = True) -> None:
    """Starts Warp, once. Its messages on devices, caches and modules are left out: bars and summaries speak.

    A program that wants them starts Warp itself (`warp.init()`) or sets `warp.config.log_level` before its first run.

    Args:
        precompiled: False does without precompiled headers, of which the CUDA compiler warns where they do not match.
    """
    import warp as wp

    if _started():
        return
    if wp.config.log_level == wp.LOG_INFO:
        wp.config.log_level = wp.LOG_ERROR
    if not precompiled:
        wp.config.use_precompiled_headers = False
    if wp.config.log_level < wp.LOG_ERROR:
        wp.init()
        return
    sys.stderr.flush()
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        wp.init()
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)
