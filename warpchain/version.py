"""The installed version."""

from importlib.metadata import version


def installed() -> str:
    """warpchain's version."""
    return version("warpchain")
