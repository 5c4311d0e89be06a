"""MCAP archives of runs: written, read back, recovered."""

from warpchain.archive.options import ArchiveOptions
from warpchain.archive.read import read_archive
from warpchain.archive.writer import ArchiveWriter, write_archive

__all__ = ["ArchiveOptions", "ArchiveWriter", "read_archive", "write_archive"]
