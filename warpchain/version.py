"""The installed version of warpchain."""

from importlib.metadata import version


def installed_version() -> str:
    """The installed version of warpchain."""
    return version("warpchain")
