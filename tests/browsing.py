"""A browser without a screen, in which tests look at pages."""

import base64
import contextlib
import fcntl
import json
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

SIZE = (1920, 1080)
_BOX = "const [a, b] = [e, e.ownerSVGElement].map((of) => of.getBoundingClientRect());"
BESIDE = (
    "[...document.querySelectorAll('p, li, h1, h2, h3, code, td, caption, figcaption, label, button, select, a, b')]"
    ".filter((e) => e.getBoundingClientRect().right > innerWidth + 1)"
    ".map((e) => e.tagName + ' ' + e.textContent.slice(0, 40)).join('; ')"
)
"""Script: words that end right of the screen."""
CUT = (
    f"[...document.querySelectorAll('svg text')].filter((e) => {{ {_BOX} return a.left < b.left - 1 || "
    "a.right > b.right + 1 || a.top < b.top - 1 || a.bottom > b.bottom + 1; }).map((e) => e.textContent).join('; ')"
)
"""Script: words of pictures that are cut off at a picture's edge."""


def no_browser() -> str | None:
    """Why the web viewer cannot be looked at here, or None."""
    return None if shutil.which("chromium") else "no browser (Debian: chromium)"


class Browser:
    """Headless Chromium, driven by its DevTools protocol over the pipes that it has at 3 and 4."""

    def __init__(self, profile: Path) -> None:
        to_browser, self._out = os.pipe()
        self._in, from_browser = os.pipe()
        ends = [fcntl.fcntl(end, fcntl.F_DUPFD_CLOEXEC, 10) for end in (to_browser, from_browser)]
        command = [
            *("chromium", "--headless=new", "--no-sandbox", "--remote-debugging-pipe", f"--user-data-dir={profile}"),
            *("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"),
            *("--disable-dev-shm-usage", "--no-first-run", "--hide-scrollbars"),
            *(f"--window-size={SIZE[0]},{SIZE[1]}", "about:blank"),
        ]
        self._process = subprocess.Popen(
            command,
            preexec_fn=lambda: [os.dup2(end, number) for end, number in zip(ends, (3, 4), strict=True)],
            close_fds=False,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        for end in (to_browser, from_browser, *ends):
            os.close(end)
        self._pending, self._number = b"", 0
        page = next(t for t in self.call("Target.getTargets")["targetInfos"] if t["type"] == "page")
        self._session = self.call("Target.attachToTarget", targetId=page["targetId"], flatten=True)["sessionId"]

    def call(self, method: str, session: str | None = None, **values: object) -> dict:
        """Calls a method of the protocol and waits for its answer."""
        self._number += 1
        request = {"id": self._number, "method": method, "params": values}
        text = json.dumps(request | ({"sessionId": session} if session else {}))
        os.write(self._out, text.encode() + b"\0")
        while True:
            while b"\0" not in self._pending:
                data = os.read(self._in, 1 << 20)
                if not data:
                    raise RuntimeError("the browser has ended")
                self._pending += data
            answer, _, self._pending = self._pending.partition(b"\0")
            message = json.loads(answer)
            if message.get("id") == self._number:
                if "error" in message:
                    raise RuntimeError(f"{method}: {message['error']['message']}")
                return message["result"]

    def resize(self, width: int, height: int) -> None:
        """Makes the window as large as a phone's or another screen [px]."""
        sizes = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600}
        self.call("Emulation.setDeviceMetricsOverride", self._session, **sizes)

    def open(self, url: str) -> None:
        """Goes to a page."""
        self.call("Page.navigate", self._session, url=url)

    def note_faults(self) -> None:
        """Has the scripts' uncaught errors of each page that is opened from now on in its `faults`."""
        note = "window.faults = []; addEventListener('error', (e) => faults.push(e.message));"
        self.call("Page.enable", self._session)
        self.call("Page.addScriptToEvaluateOnNewDocument", self._session, source=note)

    def value(self, expression: str) -> object:
        """The value of an expression in the page's script."""
        return self.call("Runtime.evaluate", self._session, expression=expression)["result"].get("value")

    def reaches(self, expression: str, value: object, patience: float = 20.0) -> bool:
        """Whether an expression has a value within `patience` seconds."""
        end = time.monotonic() + patience
        while self.value(expression) != value:
            if time.monotonic() > end:
                return False
            time.sleep(0.05)
        return True

    def capture(self, picture: Path) -> None:
        """Saves what the page shows."""
        picture.write_bytes(base64.b64decode(self.call("Page.captureScreenshot", self._session)["data"]))

    def close(self) -> None:
        """Ends the browser."""
        with contextlib.suppress(RuntimeError, OSError):
            self.call("Browser.close")
        self._process.wait()
        os.close(self._out)
        os.close(self._in)


@contextlib.contextmanager
def browser() -> Iterator[Browser]:
    """A browser with a profile of its own."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        opened = Browser(Path(folder))
        try:
            yield opened
        finally:
            opened.close()


def web_screenshot(url: str, picture: Path, shows: Callable[[Path], bool], patience: float = 120.0) -> None:
    """Opens a page of the web viewer and saves what it shows as soon as `shows` says that it is all there.

    After `patience` seconds it saves what is there.
    """
    with browser() as page:
        page.open(f"{url}&renderer=webgl&hide_welcome_screen=1")
        end = time.monotonic() + patience
        while time.monotonic() < end:
            time.sleep(2.0)
            page.capture(picture)
            if shows(picture):
                return
