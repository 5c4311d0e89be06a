"""Rerun's viewer as a process: native or in the browser, listening at a given address."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import sys
import time
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self
from urllib.parse import quote

from warpchain.errors import SimulationError

if TYPE_CHECKING:
    import rerun as rr

DATA_PORT, PAGE_PORT = 9876, 9090
"""Ports that are tried first: of the data, of the web page."""
PATIENCE = 30.0
"""Seconds that the viewer may take to listen."""


def executable() -> str:
    """The `rerun` program: the one beside this Python, or else of the search path.

    Raises:
        SimulationError: there is none.
    """
    beside = Path(sys.executable).with_name("rerun")
    found = str(beside) if beside.exists() else shutil.which("rerun")
    if found is None:
        raise SimulationError("Rerun's viewer is not installed here; use --save OUT.rrd, or pip install rerun-sdk")
    return found


def free_port(address: str, wanted: int) -> int:
    """`wanted`, or a free port where that is taken.

    Raises:
        SimulationError: an address that this machine does not have.
    """
    for port in (wanted, 0):
        try:
            with socket.create_server((address, port), family=_family(address)) as probe:
                return int(probe.getsockname()[1])
        except OSError as error:
            reason = error
    raise SimulationError(f"--bind {address}: this machine cannot listen there ({reason.strerror or reason})")


def _family(address: str) -> socket.AddressFamily:
    return socket.AF_INET6 if ":" in address else socket.AF_INET


class Viewer:
    """A viewer that outlives a `with` block: native ones stay open; the web viewer is served until interrupted.

    Args:
        address: IP address to listen at, such as "127.0.0.1".
        web: serve the web viewer instead of opening the native one.

    Raises:
        SimulationError: no viewer, an address that cannot be listened at, or a viewer that ends at once.
    """

    def __init__(self, address: str = "127.0.0.1", web: bool = False) -> None:
        self.web, self.address = web, address
        self.port = free_port(address, DATA_PORT)
        host = f"[{address}]" if ":" in address else address
        self.reached = {"0.0.0.0": "127.0.0.1", "[::]": "[::1]"}.get(host, host)
        command = [executable(), "--bind", address, "--port", str(self.port)]
        if web:
            self.page_port = free_port(address, PAGE_PORT)
            command += ["--serve-web", "--web-viewer-port", str(self.page_port)]
        else:
            command += ["--expect-data-soon", "--hide-welcome-screen"]
        self.process = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE if not web else subprocess.DEVNULL,
            start_new_session=not web, env=os.environ | {"RUST_LOG": "error"},
        )  # fmt: skip
        self._wait_for(self.port)
        if web:
            self._wait_for(self.page_port)

    @property
    def data(self) -> str:
        """URL that recordings are sent to."""
        return f"rerun+http://{self.reached}:{self.port}/proxy"

    @property
    def page(self) -> str:
        """URL of the web viewer with the recording."""
        return f"http://{self.reached}:{self.page_port}/?url={quote(self.data, safe='')}"

    def _wait_for(self, port: int) -> None:
        host, end = self.reached.strip("[]"), time.monotonic() + PATIENCE
        while time.monotonic() < end:
            if self.process.poll() is not None:
                break
            try:
                socket.create_connection((host, port), timeout=1.0).close()
                return
            except OSError:
                time.sleep(0.05)
        said = ""
        if self.process.poll() is None:
            self.process.kill()
        elif self.process.stderr is not None:
            lines = [line for line in self.process.stderr.read().decode(errors="replace").splitlines() if line.strip()]
            said = f" ({lines[-1].strip()})" if lines else ""
        self.process.wait()
        raise SimulationError(f"the Rerun viewer does not open{said}; use --save OUT.rrd")

    def connect(self, stream: rr.RecordingStream) -> None:
        """Sends a recording to the viewer."""
        stream.connect_grpc(self.data)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: BaseException | TracebackType | None) -> None:
        if not self.web:
            return
        try:
            if kind is None:
                print(f"{self.page}\nserved until Ctrl-C", flush=True)
                self.process.wait()
        except KeyboardInterrupt:
            pass
        finally:
            self.process.terminate()
            self.process.wait()
