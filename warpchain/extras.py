"""Packages that are extras of an install, asked for before work begins."""

from __future__ import annotations

import json
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, distribution
from importlib.util import find_spec
from urllib.parse import unquote, urlparse

SURROGATE_MODULES = ("sklearn", "threadpoolctl")
EXTRA_MODULES = {
    "xarray": ("xarray",),
    "dask": ("distributed",),
    "salib": ("SALib",),
    "rainflow": ("rainflow",),
    "hdf5": ("h5py",),
    "uff": ("pyuff",),
    "mdf": ("asammdf",),
    "tdms": ("nptdms",),
    "dxf": ("ezdxf",),
    "completions": ("shtab",),
    "mcp": ("mcp", "anyio"),
    "surrogate": SURROGATE_MODULES,
    "optimize": (*SURROGATE_MODULES, "pymoo"),
    "calibrate": (*SURROGATE_MODULES, "emcee"),
}
"""Modules that code imports, by their extra in pyproject.toml."""


def install_command(extra: str) -> str:
    """Command that adds an extra to this install."""
    try:
        origin = json.loads(distribution("warpchain").read_text("direct_url.json") or "{}")
    except (PackageNotFoundError, ValueError):
        origin = {}
    url = urlparse(str(origin.get("url", "")))
    if url.scheme != "file":
        return f"pip install 'warpchain[{extra}]'"
    editable = "-e " if origin.get("dir_info", {}).get("editable") else ""
    return f"pip install {editable}'{unquote(url.path)}[{extra}]'"


def require_extra(extra: str, what: str, error: Callable[[str], Exception]) -> None:
    """Raises an error if an extra's modules, which `what` needs, are not installed."""
    missing = [module for module in EXTRA_MODULES[extra] if find_spec(module) is None]
    if missing:
        raise error(f"{what}: needs {', '.join(missing)}; install it with: {install_command(extra)}")
