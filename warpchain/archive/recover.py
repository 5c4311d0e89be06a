"""Restores an archive that was cut or damaged: everything up to its last whole chunk, in a new file that is whole.

The broken file is read record by record from its beginning. Whole chunks are copied as they are, once their checksum is
found right; a damaged chunk is left out, and counted.
"""

from __future__ import annotations

import mmap
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from mcap import records as kinds
from mcap.opcode import Opcode
from numpy.typing import NDArray

from warpchain.archive import schema
from warpchain.archive.layout import LENGTH_STARTS, MESSAGE
from warpchain.archive.mcap_read import RECORD, Content, attachment_of, decompressed, records
from warpchain.archive.mcap_write import MAGIC, Chunk, McapFile, taken
from warpchain.archive.parts import PART, archive_files, cut_files, part_files, part_path
from warpchain.errors import ArchiveError
from warpchain.files import reason

KNOWN = frozenset(Opcode)
"""Opcodes of MCAP; another one means that the bytes are not records any more."""


@dataclass
class Recovered:
    """What a recovery brought.

    Attributes:
        path: the archive written.
        files: its files.
        frames: frames of each variant.
        chunks: whole chunks of frames.
        damaged: chunks left out because their checksum was wrong.
        lost: bytes after the last whole record.
        name: what all files of a split archive share.
    """

    path: Path
    files: list[Path] = field(default_factory=list)
    frames: dict[int, int] = field(default_factory=dict)
    chunks: int = 0
    damaged: int = 0
    lost: int = 0
    name: str = field(default="", repr=False)

    def __str__(self) -> str:
        variants = len(self.frames)
        words = (
            f"{sum(self.frames.values())} frames of {variants} variant{'s' * (variants != 1)} in {self.chunks} chunks"
        )
        if self.damaged:
            words += f"; {self.damaged} damaged chunk{'s' * (self.damaged != 1)} left out"
        return words + (f"; {self.lost} bytes after the last whole record lost" if self.lost else "")


def recover_archive(broken: str | Path, output: str | Path, overwrite: bool = False) -> Recovered:
    """Restores a broken archive.

    Args:
        broken: the file; of a split archive, its name: all of its files are restored, as a set of the same kind.
        output: the archive to write; it appears under this name only when whole.
        overwrite: replace an archive of that name.

    Returns:
        What was restored and what was lost.

    Raises:
        ArchiveError: a file that is not an archive of warpchain or holds nothing that can be restored, or a folder or
            disk that refuses.
    """
    source, target = Path(broken), Path(output)
    sources = _sources(source)
    split = len(sources) > 1
    there = [target] if target.exists() else part_files(target)
    if there and not overwrite:
        raise taken(there[0])
    if target.is_dir():
        raise ArchiveError(f"{target}: is a folder; give a file name such as {target / 'fixed.mcap'}")
    result = Recovered(target)
    copies: list[_Copy] = []
    try:
        for path in sources:
            number = len(copies)
            file = McapFile(part_path(target, number) if split else target, "warpchain recover", overwrite)
            copies.append(_Copy(path, file, result, number))
            if not copies[-1].run() and number and path.suffix == ".partial":
                copies.pop().file.close()  # a part that had only just begun
        for copy in copies:
            copy.require()
        if not result.chunks:
            raise ArchiveError(f"{source}: holds no whole chunk of frames; nothing can be restored")
        for copy in copies:
            copy.finish(len(copies))
    except BaseException:
        for copy in copies:
            if not copy.file.finished:
                copy.file.close()
        raise
    result.files = [copy.file.path for copy in copies]
    return result


def _sources(path: Path) -> list[Path]:
    """The files to restore from; what a killed run left of a set comes after its finished files."""
    named = PART.fullmatch(path.stem)
    if path.is_file() and not named:
        return [path]
    files = [file for file in archive_files(path) if file.is_file()]
    left = cut_files(path.with_name(named[1] + path.suffix) if named else path)
    if len(left) > 1 and not files and not PART.fullmatch(left[0].name.split(path.suffix)[0]):
        raise ArchiveError(f"{path}: several runs were cut; name one of {', '.join(map(str, left))}")
    if not files + left:
        raise ArchiveError(f"{path}: cannot be read (No such file or directory)")
    return files + left


class _Copy:
    """Copies what is whole of one file into another."""

    def __init__(self, path: Path, file: McapFile, result: Recovered, number: int) -> None:
        self.path, self.file, self.result, self.number = path, file, result, number
        self._variants: dict[int, int] = {}
        self._head: dict[str, str] | None = None
        self._wall_time = "0.0"

    def run(self) -> bool:
        """Copies; returns whether there was a whole chunk."""
        data = _mapped(self.path)
        if len(data) >= len(MAGIC) and bytes(data[: len(MAGIC)]) != MAGIC:
            raise ArchiveError(f"{self.path}: is not an MCAP file")
        at = len(MAGIC)
        for opcode, begin, end in _whole(data):
            if opcode == Opcode.DATA_END:
                at = len(data)
                break
            self._take(opcode, data[begin:end])
            at = end
        self.result.lost += max(0, len(data) - at)
        return self.file.chunks > 0

    def require(self) -> None:
        """Refuses a file that tells nothing of a run."""
        if self._head is None:
            raise ArchiveError(f"{self.path}: is not an archive of warpchain, or was cut before its first record")

    def finish(self, parts: int) -> None:
        """Ends the file, and notes how the archive ended."""
        ended = {"ended": "recovered", "wall_time": self._wall_time, "lost_bytes": str(self.result.lost)}
        ended["damaged_chunks"] = str(self.result.damaged)
        if self.number == parts - 1:
            ended["parts"] = str(parts)
        self.file.metadata(schema.END_METADATA, ended)
        self.file.finish()

    def _take(self, opcode: int, data: Any) -> None:
        """Copies a record, if it is worth it and right."""
        try:
            if opcode == Opcode.METADATA:
                metadata = kinds.Metadata.read(Content(data))
                self._take_metadata(metadata.name, metadata.metadata)
            elif opcode == Opcode.ATTACHMENT:
                attached = attachment_of(data)
                self.file.attachment(attached.name, attached.media_type, attached.data)
            elif opcode == Opcode.SCHEMA:
                kind = kinds.Schema.read(Content(data))
                self.file.schema(kind.id, kind.name, kind.encoding, bytes(kind.data))
            elif opcode == Opcode.CHANNEL:
                self._take_channel(kinds.Channel.read(Content(data)))
            elif opcode == Opcode.CHUNK:
                self._take_chunk(kinds.Chunk.read(Content(data)))
        except (ValueError, struct.error, IndexError):
            self.result.damaged += 1

    def _take_channel(self, channel: kinds.Channel) -> None:
        encoding = channel.message_encoding
        self.file.channel(channel.id, channel.schema_id, channel.topic, encoding, channel.metadata)
        named = schema.variant_of(channel.topic)
        if named and named[1] == "state":
            self._variants[channel.id] = named[0]

    def _take_metadata(self, name: str, values: dict[str, str]) -> None:
        if name == schema.RUN_METADATA:
            if values.get("format_version") != schema.FORMAT_VERSION:
                raise ArchiveError(
                    f"{self.path}: archive format {values.get('format_version')!r} is not known to this version "
                    f"(it reads {schema.FORMAT_VERSION!r})"
                )
            if self.result.name not in ("", values.get("set", "")):
                raise ArchiveError(f"{self.path}: belongs to another archive than the files before it")
            self._head, self.result.name = values, values.get("set", "")
            self.file.metadata(name, values | {"part": str(self.number)})
        elif name == schema.END_METADATA:
            self._wall_time = values.get("wall_time", self._wall_time)
        else:
            self.file.metadata(name, values)

    def _take_chunk(self, chunk: kinds.Chunk) -> None:
        indexes = message_index(decompressed(chunk))
        if not all(self.file.has_channel(number) for number in indexes):
            raise ValueError("its topic is not described")  # the description was damaged
        size, crc = chunk.uncompressed_size, chunk.uncompressed_crc
        start, end = chunk.message_start_time, chunk.message_end_time
        self.file.chunk(Chunk(chunk.compression, chunk.data, size, crc, start, end, indexes))
        self.result.chunks += any(channel in self._variants for channel in indexes)
        for channel, index in indexes.items():
            if channel in self._variants:
                variant = self._variants[channel]
                self.result.frames[variant] = self.result.frames.get(variant, 0) + len(index)


def message_index(content: Any) -> dict[int, NDArray[np.uint64]]:
    """Log times and offsets of each channel's messages in a chunk's records.

    Only the messages' heads are read: `mcap.records` would copy what they hold.
    """
    found: dict[int, list[tuple[int, int]]] = {}
    for opcode, begin, _ in records(content):
        if opcode == MESSAGE:
            at = begin - LENGTH_STARTS
            channel, _, stamp = struct.unpack_from("<HIQ", content, begin)
            found.setdefault(channel, []).append((stamp, at))
    return {channel: np.array(index, dtype=np.uint64) for channel, index in found.items()}


def _whole(data: Any) -> Iterator[tuple[int, int, int]]:
    """Opcode, begin and end of each whole record of a file, until one that is cut or makes no sense."""
    at = len(MAGIC)
    while at + RECORD.size <= len(data):
        opcode, length = RECORD.unpack_from(data, at)
        end = at + RECORD.size + length
        if opcode not in KNOWN or end > len(data):
            return
        yield opcode, at + RECORD.size, end
        at = end


def _mapped(path: Path) -> memoryview:
    """A file's bytes, mapped."""
    try:
        with path.open("rb") as file:
            return memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
    except ValueError:  # an empty file
        return memoryview(b"")
    except OSError as error:
        raise ArchiveError(f"{path}: cannot be read ({reason(error)})") from None
