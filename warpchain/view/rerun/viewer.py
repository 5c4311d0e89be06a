"""Rerun's viewer as a process: native, in the browser or headless."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Literal, Self
from urllib.parse import quote

from warpchain.errors import SimulationError

if TYPE_CHECKING:
    import rerun as rr

WATCHER_CODE = """
import os, select, signal, subprocess, sys
viewer = subprocess.Popen(sys.argv[1:], stdin=subprocess.DEVNULL)
while viewer.poll() is None:
    if select.select([0], [], [], 0.2)[0] and not os.read(0, 1):
        os.killpg(0, signal.SIGTERM)
sys.exit(viewer.returncode)
"""
"""Program that ends Rerun's viewer with this process."""
DATA_PORT, PAGE_PORT = 9876, 9090
"""Ports tried first by Rerun's viewer."""
LISTEN_PATIENCE = 30.0
"""Time for Rerun's viewer to listen [s]."""
FLUSH_TIMEOUT = 0.5
"""Time between checks that a viewer still runs [s]."""
OPENING_SECONDS = 1.5
"""Time in which a viewer without a window ends [s]."""
OTHER_WAYS = "use --web for a browser, --save OUT.rrd for a file, or a machine with a display"


def viewer_program() -> str:
    """Path of Rerun's viewer program; raises SimulationError without one."""
    beside = Path(sys.executable).with_name("rerun")
    found = str(beside) if beside.exists() else shutil.which("rerun")
    if found is None:
        raise SimulationError("Rerun's viewer is not installed here; use --save OUT.rrd, or pip install rerun-sdk")
    return found


def free_port(address: str, wanted: int) -> int:
    """Port for Rerun's viewer, `wanted` or a free one; raises SimulationError for a foreign address."""
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    for port in (wanted, 0):
        try:
            with socket.create_server((address, port), family=family) as probe:
                return int(probe.getsockname()[1])
        except OSError as error:
            reason = error
    raise SimulationError(f"--bind {address}: this machine cannot listen there ({reason.strerror or reason})")


def has_display() -> bool:
    """Whether Rerun's viewer can open windows, by a Linux process's environment."""
    return not sys.platform.startswith("linux") or any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))


class Viewer:
    """Process of Rerun's viewer, within a `with` block; a native one stays open after it.

    `kind` is "native", "web" (served until interrupted) or "headless" (for pictures). `data` is the URL that recordings
    are sent to, `page` that of the web viewer.

    Raises:
        SimulationError: no display, no viewer, an address that cannot be listened at, or a viewer that ends at once.
    """

    def __init__(self, address: str = "127.0.0.1", kind: Literal["native", "web", "headless"] = "native") -> None:
        if kind == "native" and not has_display():
            raise SimulationError(f"the Rerun viewer does not open (no display here); {OTHER_WAYS}")
        self.kind = kind
        port, page_port = free_port(address, DATA_PORT), free_port(address, PAGE_PORT)
        host = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(address, address)
        shown = f"[{host}]" if ":" in host else host
        self.data = f"rerun+http://{shown}:{port}/proxy"
        self.page = f"http://{shown}:{page_port}/?url={quote(self.data, safe='')}"
        options = {
            "native": ["--expect-data-soon", "--hide-welcome-screen"],
            "web": ["--serve-web", "--web-viewer-port", str(page_port)],
            "headless": ["--headless", "--hide-welcome-screen"],
        }
        self._said = tempfile.TemporaryFile()  # noqa: SIM115 (read when the viewer has ended)
        words = [viewer_program(), "--bind", address, "--port", str(port), *options[kind]]
        watched = kind != "native"
        self._process = subprocess.Popen(
            [sys.executable, "-c", WATCHER_CODE, *words] if watched else words,
            stdin=subprocess.PIPE if watched else subprocess.DEVNULL,
            stdout=self._said,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            env={"RUST_LOG": "error", **os.environ},
        )
        for needed in (port, page_port) if kind == "web" else (port,):
            self._wait_for_port(host, needed)

    def _wait_for_port(self, host: str, port: int) -> None:
        """Waits until Rerun's viewer listens at a port; raises its error."""
        end = time.monotonic() + LISTEN_PATIENCE
        while time.monotonic() < end and self._process.poll() is None:
            try:
                socket.create_connection((host, port), timeout=1.0).close()
                return
            except OSError:
                time.sleep(0.05)
        self.close()
        raise self._viewer_error("the Rerun viewer does not open")

    def _viewer_error(self, what: str) -> SimulationError:
        """Error of a Rerun viewer that has ended, with its reason."""
        self._said.seek(0)
        lines = [line.strip() for line in self._said.read().decode(errors="replace").splitlines() if line.strip()]
        errors = [line for line in lines if "error" in line.lower()] or lines
        reason = f" ({errors[-1]})" if errors else ""
        return SimulationError(f"{what}{reason}; {OTHER_WAYS}")

    @contextlib.contextmanager
    def connection(self, stream: rr.RecordingStream) -> Iterator[None]:
        """Context that sends what is logged to Rerun's viewer; raises SimulationError if that ends."""
        stream.connect_grpc(self.data)
        yield
        while True:
            if self._process.poll() is not None:
                raise self._viewer_error("the Rerun viewer ended before it had the recording")
            try:
                stream.flush(timeout_sec=FLUSH_TIMEOUT)
                break
            except RuntimeError:  # not yet taken, or the connection is lost: then the process has ended or will
                time.sleep(0.05)
        if self.kind == "native":  # one that cannot open its window ends with what it was sent
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(OPENING_SECONDS)
            if self._process.poll():
                raise self._viewer_error("the Rerun viewer ended")
        stream.disconnect()

    def wait(self) -> None:
        """Waits until Rerun's viewer ends or the user interrupts."""
        with contextlib.suppress(KeyboardInterrupt):
            self._process.wait()

    def close(self) -> None:
        """Ends Rerun's viewer and the process that watches it."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGTERM)
        self._process.wait()
        if self._process.stdin is not None:
            self._process.stdin.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if self.kind == "web" and kind is None:
            print(f"{self.page}\nserved until Ctrl-C", flush=True)
            self.wait()
        if self.kind != "native" or kind is not None:
            self.close()
