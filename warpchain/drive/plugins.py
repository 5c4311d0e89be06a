"""Plug-ins: users' files and packages that add contact laws, loads, metrics and channels (docs/plugins.md).

Their decorators, such as `warpchain.contact_law`, add to registries. What their code raises becomes an error of one
line, with file and line number.
"""

from __future__ import annotations

import hashlib
import math
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import FrameType, ModuleType, TracebackType
from typing import Any

from warpchain.argument_checks import check_arguments
from warpchain.errors import PluginError

GROUPS = ("warpchain.laws", "warpchain.metrics")
"""Groups of entry points whose modules are plug-ins."""
LOADING_SECONDS, METRIC_SECONDS = 60.0, 10.0
"""Longest time to load a plug-in, and for its metric [s]."""


@dataclass(frozen=True)
class Plugin:
    """A plug-in that is loaded.

    Attributes:
        name: of its file, or MODULE of an installed package.
        digest: SHA-256 of its file, in hexadecimal digits.
        path: its file.
    """

    name: str
    digest: str
    path: Path

    @property
    def words(self) -> str:
        """Name and digest of a plug-in, for archives and tables."""
        return f"{self.name} sha256:{self.digest}"


_LOADED: dict[Path, Plugin] = {}
_DIRECT: dict[Path, Plugin] = {}
"""Files that add to registries without being loaded, such as scripts."""
_LOADING: list[Path] = []
_ADDED: list[Callable[[], object]] = []
"""Functions that take back additions of the plug-in being loaded."""


@check_arguments(PluginError)
def load_plugin(path: str | os.PathLike[str]) -> Plugin:
    """Loads a plug-in's file, once, for drives, runs and studies.

    Raises:
        PluginError: a file that cannot be read, that has changed since it was loaded, or whose code fails.
    """
    load_installed_plugins()
    file = Path(path).resolve()
    digest = _file_digest(file, str(path))
    known = _LOADED.get(file)
    if known is not None:
        if known.digest != digest:
            raise PluginError(f"{path}: has changed since it was loaded; start Python anew")
        return known
    if file.suffix != ".py":
        raise PluginError(f"{path}: a plug-in is a Python file, which ends in .py")
    module = ModuleType(f"warpchain_plugin_{file.stem}_{digest[:8]}")
    module.__file__ = str(file)

    def run() -> None:
        """Runs the plug-in's code as a module of its own."""
        sys.modules[module.__name__] = module
        exec(compile(file.read_bytes(), str(file), "exec"), module.__dict__)

    return _add_plugin(Plugin(file.name, digest, file), str(path), run)


def _file_digest(file: Path, name: str) -> str:
    """SHA-256 of a plug-in's file."""
    try:
        return hashlib.sha256(file.read_bytes()).hexdigest()
    except OSError as error:
        raise PluginError(f"{name}: cannot be read ({error.strerror or error})") from None


def _add_plugin(plugin: Plugin, name: str, run: Callable[[], object]) -> Plugin:
    """A plug-in, its code run; takes back additions if that fails."""
    before = len(_ADDED)  # of a plug-in that loads this one
    _LOADING.append(plugin.path)
    try:
        with plugin_code(str(plugin.path), name, LOADING_SECONDS):
            run()
    except BaseException:
        while len(_ADDED) > before:
            _ADDED.pop()()
        raise
    finally:
        _LOADING.pop()
    if not before:
        _ADDED.clear()
    _LOADED[plugin.path] = plugin
    return plugin


@cache
def load_installed_plugins() -> None:
    """Loads the plug-ins of installed packages, by entry points, once.

    Raises:
        PluginError: the code of one fails.
    """
    from importlib.metadata import entry_points

    for point in {of.value: of for group in GROUPS for of in entry_points(group=group)}.values():
        name = f"{point.value} of the installed package {point.dist.name if point.dist else point.module}"
        with plugin_code("", name, LOADING_SECONDS):
            file = _module_file(point.module)
        if file not in _LOADED:
            _add_plugin(Plugin(point.module, _file_digest(file, name), file), name, point.load)


def _module_file(module: str) -> Path:
    """File of a module that need not be imported yet."""
    from importlib.util import find_spec

    found = find_spec(module)
    if found is None or not found.has_location or found.origin is None:
        raise ModuleNotFoundError(f"No module named {module!r} that is a file")
    return Path(found.origin).resolve()


def loaded_plugins() -> tuple[Plugin, ...]:
    """Plug-ins that are loaded, in order, installed ones included."""
    load_installed_plugins()
    return tuple(_LOADED.values())


def _known_plugins() -> list[Plugin]:
    """Plug-ins that are loaded, and files that only add to registries."""
    return [*loaded_plugins(), *(plugin for path, plugin in _DIRECT.items() if path not in _LOADED)]


def plugin_words() -> str | None:
    """Names and digests of all plug-ins; None without any."""
    return ", ".join(plugin.words for plugin in _known_plugins()) or None


def short_plugin_words(words: str) -> str:
    """Names and digests of `plugin_words`, digests shortened."""
    return ", ".join(f"{name} (sha256 {digest[:8]})" for name, _, digest in
                     (word.rpartition(" sha256:") for word in words.split(", ")))  # fmt: skip


def missing_plugins(words: str | None) -> str | None:
    """Words on plug-ins of `plugin_words` that are not loaded; None if all are."""
    if not words:
        return None
    here = {plugin.name: plugin.digest for plugin in _known_plugins()}
    lines = []
    for word in words.split(", "):
        name, _, digest = word.rpartition(" sha256:")
        if name not in here:
            lines.append(f"{name} (sha256 {digest[:8]}) is not loaded")
        elif here[name] != digest:
            lines.append(f"{name} has changed (sha256 {digest[:8]}, now {here[name][:8]})")
    return ", ".join(lines) or None


def digest_of_file(file: str) -> str:
    """SHA-256 of a plug-in function's file, or ""."""
    path = Path(file).resolve()
    plugin = _LOADED.get(path) or _DIRECT.get(path)
    return "" if plugin is None else plugin.digest


def add_to_registry(registry: dict[str, Any], kind: str, name: str, value: Any, file: str) -> None:
    """Adds a plug-in's definition to a registry; taken back should the plug-in fail.

    Args:
        file: that the definition stands in.

    Raises:
        PluginError: a name that is no word of small letters, digits, "_" and "-", or that is taken.
    """
    if not (isinstance(name, str) and name.replace("_", "a").replace("-", "a").isalnum() and name == name.lower()):
        raise PluginError(f"{kind} {name!r}: must be a word of small letters, digits, _ and -")
    if name in registry:
        raise PluginError(f"{kind} {name!r}: there is one of this name already")
    registry[name] = value
    _ADDED.append(lambda: registry.pop(name, None))
    path = Path(file).resolve()
    if not _LOADING and path.is_file():
        _DIRECT[path] = Plugin(path.name, _file_digest(path, file), path)


class _OutOfTimeError(BaseException):
    """Raised where a plug-in's code takes too long, past its `except Exception`."""


@contextmanager
def plugin_code(file: str, name: str, seconds: float, what: str = "", line: int = 0) -> Iterator[None]:
    """Context in which a plug-in's code runs, for a limited time.

    The limit holds in the main thread, between instructions of Python.

    Args:
        file: the plug-in's, whose lines errors name.
        name: by which errors call it.
        what: which code of it runs, in words; "" for all.
        line: where that begins, or 0.

    Raises:
        PluginError: what the code raises, with file and line, in one line.
    """
    try:
        with _time_limit(seconds):
            yield
    except (KeyboardInterrupt, MemoryError):
        raise
    except BaseException as error:
        found = _line_in_file(error.__traceback__, file) or line
        if isinstance(error, SyntaxError) and error.filename == file:
            found = error.lineno or 0
        where = f"{name}, line {found}" if found else name
        said = f"takes longer than {seconds:g} s" if isinstance(error, _OutOfTimeError) else _error_words(error)
        raise PluginError(": ".join(filter(None, (where, what, said)))) from None


def function_code(function: Any, what: str) -> AbstractContextManager[None]:
    """Context in which a plug-in's function computes `what`.

    Raises:
        PluginError: as `plugin_code`.
    """
    code = function.__code__
    return plugin_code(code.co_filename, code.co_filename, METRIC_SECONDS, what, code.co_firstlineno)


def _error_words(error: BaseException) -> str:
    """A plug-in error's kind and message in one line."""
    text = error.args[0] if isinstance(error, KeyError) and error.args else error  # else its message in quotes
    said = " ".join(str(text).split())
    kind = "" if isinstance(error, PluginError) else type(error).__name__
    return ": ".join(filter(None, (kind, said)))


def _line_in_file(trace: TracebackType | None, file: str) -> int:
    """Last line of a file in a traceback, or 0."""
    found = 0
    while trace is not None:
        if trace.tb_frame.f_code.co_filename == file:
            found = trace.tb_lineno
        trace = trace.tb_next
    return found


@contextmanager
def _time_limit(seconds: float) -> Iterator[None]:
    """Context that raises `_OutOfTimeError` after some seconds in the main thread."""
    if threading.current_thread() is not threading.main_thread() or not hasattr(signal, "setitimer"):
        yield
        return

    def stop(_: int, __: FrameType | None) -> None:
        """Ends the code that takes too long."""
        raise _OutOfTimeError

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def checked_number(value: Any) -> float | None:
    """A plug-in's value as a number; None stays.

    Raises:
        PluginError: no number, or none that is finite.
    """
    if value is None:
        return None
    shape = getattr(value, "shape", ())
    if shape != ():
        raise PluginError(f"gives an array of shape {shape}; must be one number, or None")
    try:
        number = float(value) if not isinstance(value, str | bytes | bool | Mapping) else None
    except (TypeError, ValueError):
        number = None
    if number is None:
        raise PluginError(f"gives {type(value).__name__}; must be one number, or None")
    if not math.isfinite(number):
        raise PluginError(f"gives {number}; must be finite, or None where there is no value")
    return number


PLUGINS_VARIABLE = "_WARPCHAIN_PLUGINS"
"""Environment variable with a process's plug-ins."""


def plugins_environment() -> dict[str, str]:
    """Environment of a process to load the plug-ins loaded here."""
    return {PLUGINS_VARIABLE: os.pathsep.join(map(str, _LOADED))}


def load_plugins_of_parent() -> None:
    """Loads the parent process's plug-ins, in order."""
    load_installed_plugins()
    for file in filter(None, os.environ.get(PLUGINS_VARIABLE, "").split(os.pathsep)):
        load_plugin(file)
