"""The example drives that come with the package, by name."""

from warpchain.drive.examples import drive_path, example_names

__all__ = ["drive_path", "example_names"]
