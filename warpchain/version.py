"""The installed version."""

from importlib.metadata import version


def installed_version() -> str:
    """warpchain's version."""
    return version("warpchain")
