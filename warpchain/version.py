"""The installed version of warpchain."""

from importlib.metadata import version


def installed_version() -> str:
    """Version of warpchain that is installed."""
    return version("warpchain")
