"""An MCAP file being read: its summary at once, everything else where the summary says it lies.

Only what is asked for is read, so that opening does not depend on the file's size. Every failure of the bytes becomes
one `ArchiveError`.
"""

from __future__ import annotations

import mmap
import os
import struct
import weakref
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from warpchain.archive.mcap_write import MAGIC
from warpchain.errors import ArchiveError
from warpchain.files import reason

SCHEMA, CHANNEL, CHUNK, CHUNK_INDEX = 0x03, 0x04, 0x06, 0x08
ATTACHMENT, ATTACHMENT_INDEX, METADATA, METADATA_INDEX = 0x09, 0x0A, 0x0C, 0x0D
FOOTER = struct.Struct("<BQQQI")
RECORD = struct.Struct("<BQ")


class ChannelInfo(NamedTuple):
    """A topic."""

    number: int
    schema: int
    topic: str
    encoding: str
    metadata: dict[str, str]


class ChunkEntry(NamedTuple):
    """Where a chunk lies, and what is in it: log times [ns], bytes, channels."""

    offset: int
    length: int
    start: int
    end: int
    channels: tuple[int, ...]


class Texts:
    """Reads length-prefixed texts and numbers one after the other."""

    def __init__(self, data: Any, at: int = 0) -> None:
        self.data, self.at = data, at

    def number(self, code: str) -> int:
        """A little-endian integer of `struct`'s code."""
        (value,) = struct.unpack_from(f"<{code}", self.data, self.at)
        self.at += struct.calcsize(f"<{code}")
        return int(value)

    def bytes(self, code: str = "I") -> Any:
        """Bytes behind their length."""
        length = self.number(code)
        part = self.data[self.at : self.at + length]
        if len(part) != length:
            raise ValueError("a text runs past its record's end")
        self.at += length
        return part

    def text(self) -> str:
        """A text."""
        return str(self.bytes(), "utf-8")

    def map(self) -> dict[str, str]:
        """A map of texts."""
        end = self.number("I") + self.at
        held = {}
        while self.at < end:
            key = self.text()
            held[key] = self.text()
        return held


def records(data: Any, at: int = 0) -> Iterator[tuple[int, int, int]]:
    """Opcode, begin and end of the content of each record of `data`; raises ValueError at one that is cut."""
    while at < len(data):
        if at + RECORD.size > len(data):
            raise ValueError("a record is cut")
        opcode, length = RECORD.unpack_from(data, at)
        begin = at + RECORD.size
        at = begin + length
        if at > len(data):
            raise ValueError("a record is cut")
        yield opcode, begin, at


def channel_of(data: Any) -> ChannelInfo:
    """A Channel record's content."""
    number, schema = struct.unpack_from("<HH", data, 0)
    texts = Texts(data, 4)
    return ChannelInfo(number, schema, texts.text(), texts.text(), texts.map())


def schema_of(data: Any) -> tuple[int, str, str, bytes]:
    """A Schema record's number, name, encoding and data."""
    texts = Texts(data)
    return texts.number("H"), texts.text(), texts.text(), bytes(texts.bytes())


def attachment_of(data: Any) -> tuple[str, str, bytes]:
    """An Attachment record's name, media type and data, its CRC checked."""
    texts = Texts(data, 16)
    name, kind, body = texts.text(), texts.text(), bytes(texts.bytes("Q"))
    crc = texts.number("I")
    if crc and crc != zlib.crc32(data[: texts.at - 4]):
        raise ValueError(f"attachment {name}: its checksum (CRC) is wrong")
    return name, kind, body


def metadata_of(data: Any) -> tuple[str, dict[str, str]]:
    """A Metadata record's name and values."""
    texts = Texts(data)
    return texts.text(), texts.map()


def chunk_of(data: Any) -> tuple[str, Any, int, int, int, int]:
    """A Chunk record's compression, data, uncompressed size, CRC, start and end."""
    start, end, size, crc = struct.unpack_from("<QQQI", data, 0)
    texts = Texts(data, 28)
    return texts.text(), texts.bytes("Q"), size, crc, start, end


def decompressed(compression: str, data: Any, size: int, crc: int) -> Any:
    """A chunk's records, checked against their size and CRC; uncompressed ones are not copied."""
    import lz4.frame
    import zstandard

    try:
        if compression == "zstd":
            if zstandard.frame_content_size(data) not in (-1, size):
                raise ValueError("a chunk's size is wrong")
            out: Any = zstandard.ZstdDecompressor().decompress(data, max_output_size=size)
        elif compression == "lz4":
            out = lz4.frame.decompress(data)
        elif compression == "":
            out = data
        else:
            raise ValueError(f"compression {compression!r} is unknown")
    except (zstandard.ZstdError, RuntimeError, MemoryError) as error:
        raise ValueError(f"a chunk cannot be decompressed: {error}") from None
    if len(out) != size or (crc and zlib.crc32(out) != crc):
        raise ValueError("a chunk's checksum (CRC) is wrong")
    return out


@contextmanager
def told(path: Path) -> Iterator[None]:
    """Turns every failure of a file's bytes into one line."""
    try:
        yield
    except OSError as error:
        raise ArchiveError(f"{path}: cannot be read ({reason(error)})") from None
    except (ValueError, IndexError, struct.error, MemoryError) as error:
        raise ArchiveError(f"{path}: is damaged ({error}); see warpchain recover") from None


class McapIndex:
    """An MCAP file and what its summary says.

    Attributes:
        channels: topics by number.
        chunks: where chunks lie, in the file's order.
        attachments: offset and length of each attachment's record, by name.
        metadata: the same of metadata records.

    Raises:
        ArchiveError: here and in every method, a file that is missing, not an MCAP, cut short or damaged.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.channels: dict[int, ChannelInfo] = {}
        self.chunks: list[ChunkEntry] = []
        self.attachments: dict[str, tuple[int, int]] = {}
        self.metadata: dict[str, tuple[int, int]] = {}
        with told(path):
            self._file = os.open(path, os.O_RDONLY)
            weakref.finalize(self, os.close, self._file)
            self._map: mmap.mmap | None = None
            size = os.fstat(self._file).st_size
            if self._read(0, len(MAGIC)) != MAGIC:
                raise ArchiveError(f"{path}: is not an MCAP file")
            tail = FOOTER.size + len(MAGIC)
            end = self._read(max(0, size - tail), tail)
            if size < tail + len(MAGIC) or not end.endswith(MAGIC):
                raise ArchiveError(f"{path}: is cut short; restore what is whole with: warpchain recover")
            opcode, _, start, _, crc = FOOTER.unpack_from(end, 0)
            if opcode != 0x02 or start == 0:
                raise ArchiveError(f"{path}: lacks the summary at its end; write it anew with: warpchain recover")
            if not len(MAGIC) <= start <= size - tail:
                raise ValueError("its footer is wrong")
            summary = self._read(start, size - tail - start)
            if crc and crc != zlib.crc32(summary + end[: FOOTER.size - 4]):
                raise ValueError("its summary's checksum (CRC) is wrong")
            self._parse(summary)

    def _read(self, offset: int, length: int) -> bytes:
        data = os.pread(self._file, length, offset)
        while len(data) < length:
            more = os.pread(self._file, length - len(data), offset + len(data))
            if not more:
                break
            data += more
        return data

    def _parse(self, summary: bytes) -> None:
        for opcode, begin, end in records(summary):
            if opcode == CHUNK_INDEX:
                start, stop, offset, length, size = struct.unpack_from("<QQQQI", summary, begin)
                pairs = struct.unpack_from("<" + "HQ" * (size // 10), summary, begin + 36)
                self.chunks.append(ChunkEntry(offset, length, start, stop, pairs[::2]))
            elif opcode == CHANNEL:
                channel = channel_of(summary[begin:end])
                self.channels[channel.number] = channel
            elif opcode == ATTACHMENT_INDEX:
                place = struct.unpack_from("<QQ", summary, begin)
                self.attachments[Texts(summary, begin + 40).text()] = place
            elif opcode == METADATA_INDEX:
                place = struct.unpack_from("<QQ", summary, begin)
                self.metadata[Texts(summary, begin + 16).text()] = place
        self.chunks.sort()

    def _record(self, opcode: int, offset: int, length: int) -> memoryview:
        """The content of the record at an offset of the file."""
        data = memoryview(self._read(offset, length))
        found = next(records(data), None)
        if found is None or found != (opcode, RECORD.size, length):
            raise ValueError(f"no record of its kind at byte {offset}")
        return data[RECORD.size :]

    def attachment(self, name: str) -> bytes:
        """An attachment's data."""
        if name not in self.attachments:
            raise ArchiveError(f"{self.path}: lacks its attachment {name}")
        with told(self.path):
            return attachment_of(self._record(ATTACHMENT, *self.attachments[name]))[2]

    def values(self, name: str) -> dict[str, str] | None:
        """A metadata record's values, or None."""
        if name not in self.metadata:
            return None
        with told(self.path):
            return metadata_of(self._record(METADATA, *self.metadata[name]))[1]

    def chunk(self, entry: ChunkEntry) -> Any:
        """A chunk's records; those of an uncompressed chunk are a view of the file."""
        with told(self.path):
            head = self._read(entry.offset, min(64, entry.length))
            opcode, length = RECORD.unpack_from(head, 0)
            if opcode != CHUNK or RECORD.size + length != entry.length:
                raise ValueError(f"no chunk at byte {entry.offset}")
            if Texts(head, RECORD.size + 28).number("I") == 0:
                if self._map is None:
                    self._map = mmap.mmap(self._file, 0, access=mmap.ACCESS_READ)
                data = memoryview(self._map)[entry.offset : entry.offset + entry.length]
            else:
                data = memoryview(self._read(entry.offset, entry.length))
            compression, packed, size, crc, _, _ = chunk_of(data[RECORD.size :])
            return decompressed(compression, packed, size, crc)
