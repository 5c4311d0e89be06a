"""Restores an archive that was cut or damaged: everything that can be trusted, in a new file that is whole.

Where the summary at the broken file's end is right by its checksum, it says where everything lies, and what channels
and schemas are; a record that is not there as it says is left out. A file without it is read record by record from its
beginning, and channels and metadata go by their digests (`archive.digest`). Whole chunks are copied as they are, once
their checksum is found right. What is left out is counted and named.
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

from warpchain.archive import archive_format
from warpchain.archive.chunk_layout import LENGTH_STARTS, MESSAGE
from warpchain.archive.digest import checked
from warpchain.archive.file_set import PartName, Target, cut_files, editions, is_whole, of_cut, part_name
from warpchain.archive.mcap_read import RECORD, Content, McapIndex, attachment_of, decompressed, records
from warpchain.archive.mcap_write import MAGIC, Chunk, McapFile
from warpchain.archive.trust import Topics, untrue
from warpchain.errors import ArchiveError
from warpchain.files import open_regular, reason

KNOWN = frozenset(Opcode)
"""Opcodes of MCAP; another one means that the bytes are not records any more."""


@dataclass
class Recovered:
    """Result of a recovery.

    Attributes:
        path: the archive written.
        files: its files.
        frames: frames of each variant.
        chunks: whole chunks of frames.
        damaged: chunks left out because their checksum was wrong, or because nothing says whose they are.
        missing: frames that are missing between others.
        left_out: what else was left out, in words.
        lost: bytes after the last whole record.
        name: what all files of a split archive share.
    """

    path: Path
    files: list[Path] = field(default_factory=list)
    frames: dict[int, int] = field(default_factory=dict)
    chunks: int = 0
    damaged: int = 0
    missing: int = 0
    left_out: list[str] = field(default_factory=list)
    lost: int = 0
    name: str = field(default="", repr=False)
    next_frame: dict[int, int] = field(default_factory=dict, repr=False)

    @property
    def complete(self) -> bool:
        """Whether nothing was left out but what a cut had not let come into being."""
        return not (self.damaged or self.missing or self.left_out)

    def leave_out(self, what: str) -> None:
        """Notes that something was left out."""
        if what not in self.left_out:
            self.left_out.append(what)

    def __str__(self) -> str:
        variants = len(self.frames)
        words = (
            f"{sum(self.frames.values())} frames of {variants} variant{'s' * (variants != 1)} in {self.chunks} chunks"
        )
        if self.damaged:
            words += f"; {self.damaged} damaged chunk{'s' * (self.damaged != 1)} left out"
        if self.missing:
            words += f"; {self.missing} frames are missing between others"
        if self.left_out:
            named = ", ".join(self.left_out[:8]) + (", ..." if len(self.left_out) > 8 else "")
            words += f"; left out as damaged: {named}"
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
    source = Path(broken)
    sources = _sources(source)
    result = Recovered(Path(output))
    copies: list[_Copy] = []
    target = Target(result.path, overwrite, split=len(sources) > 1)
    try:
        for path in sources:
            number = len(copies)
            copies.append(_Copy(path, target.file(number, "warpchain recover"), result, number))
            if not copies[-1].run() and number and path.suffix == ".partial":
                copies.pop().file.close()  # a part that had only just begun
        for copy in copies:
            copy.require()
        if not result.chunks:
            raise ArchiveError(f"{source}: holds no whole chunk of frames; nothing can be restored")
        for copy in copies:
            copy.finish(len(copies))
        result.files = [copy.file.path for copy in copies]
        target.replace(result.files)
    except BaseException:
        if not (copies and copies[-1].file.finished):
            target.discard(copy.file.path for copy in copies if copy.file.finished)
        for copy in copies:
            copy.file.close()
        raise
    finally:
        target.release()
    return result


def _sources(path: Path) -> list[Path]:
    """The files to restore from; what a killed run left of a set comes after its finished files."""
    named = part_name(path) if path.is_file() else None
    if path.is_file() and not named:
        return [path]
    name = named.archive if named else path
    sets = editions(name)
    for file in cut_files(name):
        part = part_name(of_cut(file)) or PartName(name, 0, 0)
        sets.setdefault(part.edition, []).append(file)
    if named:
        return sets[named.edition]
    if not sets:
        why = "Is a directory" if path.is_dir() else "No such file or directory"
        raise ArchiveError(f"{path}: cannot be read ({why})")
    edition, files = max(sets.items())
    if len(sets) > 1 and not (edition and is_whole(files)):
        named_by = ", ".join(str(files[0]) for _, files in sorted(sets.items()))
        raise ArchiveError(f"{path}: several runs were cut; name one of {named_by}")
    if not edition and len(files) > 1:
        raise ArchiveError(f"{path}: several runs were cut; name one of {', '.join(map(str, files))}")
    return files


class _Copy:
    """Copies what can be trusted of one file into another."""

    def __init__(self, path: Path, file: McapFile, result: Recovered, number: int) -> None:
        self.path, self.file, self.result, self.number = path, file, result, number
        self._head: dict[str, str] | None = None
        self._held: dict[str, bytes] = {}
        self._wall_time = "0.0"
        self._topics = Topics()

    def run(self) -> bool:
        """Copies; returns whether there was a whole chunk."""
        data = _mapped(self.path)
        if len(data) >= len(MAGIC) and bytes(data[: len(MAGIC)]) != MAGIC:
            raise ArchiveError(f"{self.path}: is not an MCAP file")
        index = _protected(self.path)
        if index is None:
            self._walk(data)
        else:
            self._follow(data, index)
        return self.file.chunks > 0

    def _follow(self, data: Any, index: McapIndex) -> None:
        """Copies what a right summary lists, in the file's order."""
        self._topics = Topics(index)
        places = [(entry.offset, entry.length, Opcode.CHUNK, "") for entry in index.chunks]
        places += [(*at, Opcode.ATTACHMENT, name) for name, at in index.attachments.items()]
        places += [(*at, Opcode.METADATA, name) for name, at in index.metadata.items()]
        for offset, length, opcode, name in sorted(places):
            end = min(offset + length, len(data))
            found = RECORD.unpack_from(data, offset) if offset + RECORD.size <= end else None
            if found != (opcode, length - RECORD.size):
                self._leave_out(opcode, name)
            else:
                self._take(opcode, data[offset + RECORD.size : end], name)

    def _walk(self, data: Any) -> None:
        """Copies what is whole, record by record."""
        at = len(MAGIC)
        for opcode, begin, end in _whole(data):
            if opcode == Opcode.DATA_END and end - begin == 4:
                at = len(data)
                break
            if opcode == Opcode.MESSAGE_INDEX:
                if not _is_index(data[begin:end]):
                    self._leave_out(Opcode.CHUNK)
            elif opcode in (Opcode.METADATA, Opcode.ATTACHMENT, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.CHUNK):
                self._take(opcode, data[begin:end])
            elif not (opcode == Opcode.HEADER and at == len(MAGIC)):
                self._leave_out(opcode)
            at = end
        self.result.lost += max(0, len(data) - at)

    def _leave_out(self, opcode: int, name: str = "") -> None:
        """Notes that a record was left out."""
        if opcode == Opcode.CHUNK:
            self.result.damaged += 1
        else:
            what = {Opcode.ATTACHMENT: "attachment", Opcode.METADATA: "metadata"}.get(opcode, "a record")  # type: ignore
            self.result.leave_out(f"{what} {name}".strip())

    def require(self) -> None:
        """Refuses a file that says nothing of a run."""
        if self._head is None:
            raise ArchiveError(
                f"{self.path}: is not an archive of warpchain, or was cut before its first record, or that is damaged"
            )

    def finish(self, parts: int) -> None:
        """Ends the file, and notes how the archive ended."""
        assert self._head is not None  # as required
        ended = {"ended": "recovered", "wall_time": self._wall_time, "lost_bytes": str(self.result.lost)}
        ended["damaged_chunks"] = str(self.result.damaged)
        if self.result.missing:
            ended["missing_frames"] = str(self.result.missing)
        if self.result.left_out:
            ended["left_out"] = ", ".join(self.result.left_out)
        if self.number == parts - 1:
            ended["parts"] = str(parts)
        self.file.metadata(archive_format.END_METADATA, archive_format.with_head(ended, self._head))
        self.file.finish()

    def _take(self, opcode: int, data: Any, name: str = "") -> None:
        """Copies a record, if it is worth it and right.

        Args:
            name: what the summary calls it.
        """
        try:
            if opcode == Opcode.METADATA:
                metadata = kinds.Metadata.read(Content(data))
                name = name or metadata.name
                self._take_metadata(name, checked(metadata.name, metadata.metadata, self._topics.sealed))
            elif opcode == Opcode.ATTACHMENT:
                attached = attachment_of(data)
                name = name or attached.name
                self._take_attachment(name, attached)
            elif opcode == Opcode.SCHEMA:
                self._topics.add_schema(kinds.Schema.read(Content(data)))
            elif opcode == Opcode.CHANNEL:
                self._topics.add(kinds.Channel.read(Content(data)), self._head)
            elif opcode == Opcode.CHUNK:
                self._take_chunk(kinds.Chunk.read(Content(data)))
        except (ValueError, OverflowError, struct.error, IndexError):
            self._leave_out(opcode, name)

    def _take_attachment(self, name: str, attached: kinds.Attachment) -> None:
        if attached.name != name or self._held.setdefault(name, attached.data) != attached.data:
            raise ValueError("another one of this name")
        self.file.attachment(name, attached.media_type, attached.data)

    def _take_metadata(self, name: str, values: dict[str, str]) -> None:
        if name == archive_format.RUN_METADATA:
            self._take_head(values)
        elif name == archive_format.END_METADATA:
            self._wall_time = repr(float(values.get("wall_time", self._wall_time)))
            if self._head is None:  # its record was damaged; this is its copy
                self._take_head(archive_format.head_of(values))
        else:
            self.file.metadata(name, values)

    def _take_head(self, values: dict[str, str]) -> None:
        if self._head is not None:
            raise ValueError("another one of this name")
        if values.get("format_version") != archive_format.FORMAT_VERSION:
            raise ArchiveError(
                f"{self.path}: archive format {values.get('format_version')!r} is not known to this version "
                f"(it reads {archive_format.FORMAT_VERSION!r})"
            )
        if self.result.name not in ("", values.get("set", "")):
            raise ArchiveError(f"{self.path}: belongs to another archive than the files before it")
        self._head, self.result.name = values | {"part": str(self.number)}, values.get("set", "")
        self.file.metadata(archive_format.RUN_METADATA, self._head)

    def _take_chunk(self, chunk: kinds.Chunk) -> None:
        content = decompressed(chunk)
        indexes = message_index(content)
        variants = {number: self._topics.variant_of_state(number) for number in indexes}
        sequences = {v: _sequence(content, indexes[number]) for number, v in variants.items() if v is not None}
        for variant, sequence in sequences.items():
            if sequence[0] < self.result.next_frame.get(variant, 0):
                raise ValueError("its frames came before")  # a chunk that is there twice
        self._topics.open(self.file, indexes)
        size, crc = chunk.uncompressed_size, chunk.uncompressed_crc
        start, end = chunk.message_start_time, chunk.message_end_time
        self.file.chunk(Chunk(chunk.compression, chunk.data, size, crc, start, end, indexes))
        self.result.chunks += bool(sequences)
        for variant, sequence in sequences.items():
            due = self.result.next_frame.get(variant, 0)
            self.result.missing += int(sequence[-1]) + 1 - due - len(sequence)
            self.result.next_frame[variant] = int(sequence[-1]) + 1
            self.result.frames[variant] = self.result.frames.get(variant, 0) + len(sequence)


def _protected(path: Path) -> McapIndex | None:
    """The summary of a file, if a checksum says that it is right, and its channels' digests do not deny it."""
    try:
        index = McapIndex(path)
    except ArchiveError:
        return None
    return index if index.protected and untrue(index) is None else None


def _is_index(data: Any) -> bool:
    """Whether a record is an index of messages, and no other one with a wrong opcode."""
    return len(data) >= 6 and int.from_bytes(data[2:6], "little") == len(data) - 6 and len(data) % 16 == 6


def _sequence(content: Any, index: NDArray[np.uint64]) -> NDArray[np.uint32]:
    """Numbers of frames, from the messages of a chunk that an index lists."""
    found = [struct.unpack_from("<I", content, int(at) + LENGTH_STARTS + 2)[0] for at in index[:, 1]]
    sequence = np.array(found, dtype=np.int64)
    if (np.diff(sequence) <= 0).any():
        raise ValueError("its frames are out of order")
    return sequence.astype(np.uint32)


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
        with open(open_regular(path), "rb") as file:
            return memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
    except ValueError:  # an empty file
        return memoryview(b"")
    except OSError as error:
        raise ArchiveError(f"{path}: cannot be read ({reason(error)})") from None
