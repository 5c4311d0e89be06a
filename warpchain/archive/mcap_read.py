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

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Footer, Metadata, MetadataIndex, Schema

from warpchain.archive.digest import DIGEST, checked
from warpchain.archive.mcap_write import MAGIC
from warpchain.errors import ArchiveError
from warpchain.files import open_regular, reason

RECORD = struct.Struct("<BQ")
"""A record's opcode and length, before its content."""
MOST_CHUNK = 2**28
"""Bytes of a chunk's records at most, uncompressed: warpchain writes about 1 MiB, others a few."""
FOOTER = RECORD.size + 20
"""Bytes of the footer's record."""


class ChunkEntry(NamedTuple):
    """Where a chunk lies, and what is in it: log times [ns], bytes, channels."""

    offset: int
    length: int
    start: int
    end: int
    channels: tuple[int, ...]


class Content(ReadDataStream):
    """A record's content for the parsers of `mcap.records`: in place, without copies, and never past its end.

    Their own stream hands on what is left of a text that is cut; here that is a ValueError, as every other damage is.
    """

    def __init__(self, data: Any) -> None:
        self._data, self._count = data, 0

    def read(self, length: int) -> Any:
        """The next bytes, as a view where the content is one."""
        end = self._count + length
        part = self._data[self._count : end]
        if len(part) != length:
            raise ValueError("a text runs past its record's end")
        self._count = end
        return part

    def read_prefixed_string(self) -> str:
        """A text behind its length; in one step, since opening an archive reads tens of thousands of them."""
        begin = self._count + 4
        end = begin + int.from_bytes(self._data[self._count : begin], "little")
        if end > len(self._data):
            raise ValueError("a text runs past its record's end")
        self._count = end
        return str(self._data[begin:end], "utf-8")


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


def attachment_of(data: Any) -> Attachment:
    """An Attachment record, its CRC checked, which `mcap.records` passes over."""
    content = Content(data)
    record = Attachment.read(content)
    (crc,) = struct.unpack_from("<I", data, content.count - 4)
    if crc and crc != zlib.crc32(data[: content.count - 4]):
        raise ValueError(f"attachment {record.name}: its checksum (CRC) is wrong")
    return record


def decompressed(chunk: Chunk) -> Any:
    """A chunk's records, checked against their size and CRC; uncompressed ones are not copied.

    Nothing larger than the chunk says, and nothing larger than `MOST_CHUNK`, is ever made.
    """
    import lz4.frame
    import zstandard

    compression, data, size, crc = chunk.compression, chunk.data, chunk.uncompressed_size, chunk.uncompressed_crc
    if size > MOST_CHUNK:
        raise ValueError(f"a chunk says that it holds {size} bytes; allowed are {MOST_CHUNK}")
    try:
        if compression == "zstd":
            if zstandard.frame_content_size(data) not in (-1, size):
                raise ValueError("a chunk's size is wrong")
            out: Any = zstandard.ZstdDecompressor().decompress(data, max_output_size=size)
        elif compression == "lz4":
            out = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1)
        elif compression == "":
            out = data
        else:
            raise ValueError(f"compression {compression!r} is unknown")
    except (zstandard.ZstdError, RuntimeError, EOFError, MemoryError) as error:
        raise ValueError(f"a chunk cannot be decompressed: {error}") from None
    if len(out) != size or (crc and zlib.crc32(out) != crc):
        raise ValueError("a chunk's checksum (CRC) is wrong")
    return out


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Turns every failure of a file's bytes into one line."""
    try:
        yield
    except OSError as error:
        raise ArchiveError(f"{path}: cannot be read ({reason(error)})") from None
    except (ValueError, IndexError, OverflowError, struct.error, MemoryError) as error:
        raise ArchiveError(f"{path}: is damaged ({error}); see warpchain recover") from None


class McapIndex:
    """An MCAP file and what its summary says.

    Attributes:
        channels: topics by number.
        schemas: what describes their messages, by number.
        protected: whether the summary has a checksum, which was right.
        chunks: where chunks lie, in the file's order.
        attachments: offset and length of each attachment's record, by name.
        metadata: the same of metadata records.

    Raises:
        ArchiveError: here and in every method, a file that is missing, not an MCAP, cut short or damaged.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.channels: dict[int, Channel] = {}
        self.schemas: dict[int, Schema] = {}
        self.chunks: list[ChunkEntry] = []
        self.attachments: dict[str, tuple[int, int]] = {}
        self.metadata: dict[str, tuple[int, int]] = {}
        with reading(path):
            self._file = open_regular(path)
            weakref.finalize(self, os.close, self._file)
            self._map: mmap.mmap | None = None
            size = self._size = os.fstat(self._file).st_size
            if self._read(0, len(MAGIC)) != MAGIC:
                raise ArchiveError(f"{path}: is not an MCAP file")
            tail = FOOTER + len(MAGIC)
            end = self._read(max(0, size - tail), tail)
            if size < tail + len(MAGIC) or not end.endswith(MAGIC):
                raise ArchiveError(f"{path}: is cut short; restore what is whole with: warpchain recover")
            footer = Footer.read(Content(end[RECORD.size :]))
            start, crc = footer.summary_start, footer.summary_crc
            if end[0] != Opcode.FOOTER or start == 0:
                raise ArchiveError(f"{path}: lacks the summary at its end; write it anew with: warpchain recover")
            if not len(MAGIC) <= start <= size - tail:
                raise ValueError("its footer is wrong")
            summary = self._read(start, size - tail - start)
            if crc and crc != zlib.crc32(summary + end[: FOOTER - 4]):
                raise ValueError("its summary's checksum (CRC) is wrong")
            self.protected = crc != 0
            self._parse(summary)

    def __reduce__(self) -> tuple[Any, ...]:
        """A pickled one opens the file anew."""
        return McapIndex, (self.path.absolute(),)

    @property
    def sealed(self) -> bool:
        """Whether the archive has digests."""
        return any(DIGEST in channel.metadata for channel in self.channels.values())

    def _read(self, offset: int, length: int) -> bytes:
        if offset + length > max(self._size, FOOTER + len(MAGIC)):
            raise ValueError(f"nothing at byte {offset}")
        data = os.pread(self._file, length, offset)
        while len(data) < length:
            more = os.pread(self._file, length - len(data), offset + len(data))
            if not more:
                break
            data += more
        return data

    def _parse(self, summary: bytes) -> None:
        """Takes what is needed of the summary.

        The two kinds of record that come by the ten thousand, chunks' and drives' indexes, are unpacked here: with
        `mcap.records` they take 6 and 3 times as long, and opening would be slow.
        """
        for opcode, begin, end in records(summary):
            if opcode == Opcode.CHUNK_INDEX:
                start, stop, offset, length, size = struct.unpack_from("<QQQQI", summary, begin)
                pairs = struct.unpack_from("<" + "HQ" * (size // 10), summary, begin + 36)
                self.chunks.append(ChunkEntry(offset, length, start, stop, pairs[::2]))
            elif opcode == Opcode.ATTACHMENT_INDEX:
                offset, length, _, _, _, size = struct.unpack_from("<QQQQQI", summary, begin)
                self.attachments[str(summary[begin + 44 : begin + 44 + size], "utf-8")] = offset, length
            elif opcode == Opcode.CHANNEL:
                channel = Channel.read(Content(summary[begin:end]))
                self.channels[channel.id] = channel
            elif opcode == Opcode.SCHEMA:
                schema = Schema.read(Content(summary[begin:end]))
                self.schemas[schema.id] = schema
            elif opcode == Opcode.METADATA_INDEX:
                place = MetadataIndex.read(Content(summary[begin:end]))
                self.metadata[place.name] = place.offset, place.length
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
        with reading(self.path):
            record = attachment_of(self._record(Opcode.ATTACHMENT, *self.attachments[name]))
            if record.name != name:
                raise ValueError(f"attachment {name} is named {record.name!r}")
            return bytes(record.data)

    def values(self, name: str) -> dict[str, str] | None:
        """A metadata record's values, or None."""
        if name not in self.metadata:
            return None
        with reading(self.path):
            record = Metadata.read(Content(self._record(Opcode.METADATA, *self.metadata[name])))
            if record.name != name:
                raise ValueError(f"metadata {name} are named {record.name!r}")
            return checked(name, record.metadata, self.sealed)

    def chunk(self, entry: ChunkEntry) -> Any:
        """A chunk's records; those of an uncompressed chunk are a view of the file."""
        with reading(self.path):
            head = self._read(entry.offset, min(64, entry.length))
            opcode, length = RECORD.unpack_from(head, 0)
            if opcode != Opcode.CHUNK or RECORD.size + length != entry.length:
                raise ValueError(f"no chunk at byte {entry.offset}")
            if struct.unpack_from("<I", head, RECORD.size + 28) == (0,):  # no compression
                if self._map is None:
                    self._map = mmap.mmap(self._file, 0, access=mmap.ACCESS_READ)
                data = memoryview(self._map)[entry.offset : entry.offset + entry.length]
            else:
                data = memoryview(self._read(entry.offset, entry.length))
            return decompressed(Chunk.read(Content(data[RECORD.size :])))
