"""Shards on a Dask cluster: the executor of a scheduler (extra `dask`).

Dask runs the shard of a worker that died again on another one, up to its `distributed.scheduler.allowed-failures`.
"""

from __future__ import annotations

import socket
import warnings
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager

from warpchain.errors import StudyError

REACH = 5.0
"""Seconds in which its machine has to take a connection."""
TIMEOUT = 30.0
"""Seconds that a scheduler has to answer."""


@contextmanager
def dask_executor(address: str) -> Iterator[tuple[Executor, int]]:
    """The executor of a Dask scheduler, and how many workers it has now.

    Args:
        address: such as "tcp://10.0.0.1:8786".

    Raises:
        StudyError: dask.distributed is not installed, no scheduler answers, or a shard has ended several workers.
    """
    try:
        from distributed import Client, KilledWorker
    except ImportError:
        raise StudyError("--scheduler needs dask.distributed: pip install 'warpchain[dask]'") from None
    _check_listens(address)
    try:
        client = Client(address, timeout=TIMEOUT)
    except (OSError, ValueError) as error:
        raise StudyError(f"--scheduler {address}: no Dask scheduler answers ({_line(error)})") from None
    try:
        workers = len(client.nthreads())
        if not workers:
            warnings.warn(f"--scheduler {address}: has no workers yet; shards wait for them", stacklevel=3)
        yield client.get_executor(pure=False), workers
    except KilledWorker as error:
        raise StudyError(f"--scheduler {address}: {_line(error)}; run again to go on") from None
    finally:
        client.close()


def _check_listens(address: str) -> None:
    """Refuses an address of TCP that nobody listens at, which Dask tries again and again until its time is up."""
    scheme, _, place = address.rpartition("://")
    host, _, port = place.strip("/").rpartition(":")
    if scheme not in ("", "tcp", "tls") or not (host and port.isdecimal()):
        return
    try:
        socket.create_connection((host.strip("[]"), int(port)), timeout=REACH).close()
    except (OSError, OverflowError) as error:
        raise StudyError(f"--scheduler {address}: no Dask scheduler answers ({_line(error)})") from None


def _line(error: Exception) -> str:
    return (str(error).strip() or type(error).__name__).splitlines()[0]
