"""Packages that are extras of an install, asked for before work begins."""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec

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


def require_extra(extra: str, what: str, error: Callable[[str], Exception]) -> None:
    """Raises an error if an extra's modules, which `what` needs, are not installed."""
    missing = [module for module in EXTRA_MODULES[extra] if find_spec(module) is None]
    if missing:
        raise error(f"{what}: needs {', '.join(missing)}; install it with: pip install 'warpchain[{extra}]'")
