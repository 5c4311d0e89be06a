"""An MCAP file being read: its summary at once, everything else where the summary says it lies.

Only what is asked for is read, so that opening does not depend on the file's size. MCAP leaves every index optional:
where the summary does not account for all records, the data are read through once. Every failure of the bytes becomes
one `ArchiveError`.
"""

from __future__ import annotations

import mmap
import os
import struct
import weakref
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, DataEnd, Footer, Metadata, MetadataIndex, Schema

from warpchain.archive.digest import DIGEST, checked, plain_channel
from warpchain.archive.mcap_write import MAGIC
from warpchain.errors import ArchiveError
from warpchain.files import open_regular_file, refusal_reason

RECORD = struct.Struct("<BQ")
"""A record's opcode and length, before its content."""
MOST_CHUNK = 2**28
"""Bytes of a chunk's records at most, uncompressed: warpchain writes about 1 MiB, others a few."""
FOOTER = RECORD.size + 20
"""Bytes of the footer's record."""
STATISTICS = struct.Struct("<QHIIII")
"""Numbers of messages, schemas, channels, attachments, metadata and chunks, where a Statistics record begins."""
STRETCH = 2**20
"""Bytes at most of messages outside of chunks that are taken together, as if they were a chunk."""


class ChunkEntry(NamedTuple):
    """Where a chunk lies, and what is in it: log times [ns], bytes, channels.

    `loose` ones are no record of MCAP's, but messages that follow one another outside of chunks.
    """

    offset: int
    length: int
    start: int
    end: int
    channels: tuple[int, ...]
    loose: bool = False


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


def is_data_crc(data: Any, crc: int) -> bool:
    """Whether a DataEnd record's checksum is 0 for none, or that of all before it, with the file's magic or without."""
    return crc in (0, zlib.crc32(data)) or crc == zlib.crc32(data[len(MAGIC) :])


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
        raise ArchiveError(f"{path}: cannot be read ({refusal_reason(error)})") from None
    except (ValueError, IndexError, OverflowError, struct.error, MemoryError) as error:
        raise ArchiveError(f"{path}: is damaged ({error}); see warpchain recover") from None


@dataclass
class Span:
    """Channels and log times [ns] of some messages."""

    channels: set[int] = field(default_factory=set)
    start: int = 2**64 - 1
    end: int = 0

    def add(self, data: Any, begin: int) -> None:
        """Takes the message whose content begins there."""
        channel, _, stamp = struct.unpack_from("<HIQ", data, begin)
        self.channels.add(channel)
        self.start, self.end = min(self.start, stamp), max(self.end, stamp)

    def entry(self, offset: int, length: int, loose: bool = False) -> ChunkEntry:
        """The messages as an entry of the place where they lie."""
        return ChunkEntry(offset, length, self.start, self.end, tuple(sorted(self.channels)), loose)


def stretches(found: Iterable[tuple[int, int, int]]) -> Iterator[tuple[int, int, int]]:
    """Records as `records` gives them, but of messages that follow one another up to `STRETCH` bytes as one item.

    Such an item has the opcode of a message, and begins where its first record does, not its content.
    """
    first = end = 0
    for opcode, begin, stop in found:
        if end > first and (opcode != Opcode.MESSAGE or stop - first > STRETCH):
            yield Opcode.MESSAGE, first, end
            first = end
        if opcode == Opcode.MESSAGE:
            first, end = (first if end > first else begin - RECORD.size), stop
        else:
            yield opcode, begin, stop
            first = end = stop
    if end > first:
        yield Opcode.MESSAGE, first, end


class McapIndex:
    """An MCAP file and where everything in it lies: by its summary, or by its data where the summary leaves some out.

    Attributes:
        channels: topics by number.
        schemas: what describes their messages, by number.
        protected: whether the summary accounts for all records, and has a checksum, which was right.
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
            self._file = open_regular_file(path)
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
            start, crc = footer.summary_start or size - tail, footer.summary_crc
            if end[0] != Opcode.FOOTER or not len(MAGIC) <= start <= size - tail:
                raise ValueError("its footer is wrong")
            summary = self._read(start, size - tail - start)
            if crc and crc != zlib.crc32(summary + end[: FOOTER - 4]):
                raise ValueError("its summary's checksum (CRC) is wrong")
            whole = self._parse(summary)
            self.protected = whole and crc != 0
            if not whole:
                self._scan(start)

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

    @property
    def _mapped(self) -> mmap.mmap:
        """The file's bytes."""
        if self._map is None:
            self._map = mmap.mmap(self._file, 0, access=mmap.ACCESS_READ)
        return self._map

    def _parse(self, summary: bytes) -> bool:
        """Takes what is needed of the summary; returns whether by its statistics it accounts for every record.

        The two kinds of record that come by the ten thousand, chunks' and drives' indexes, are unpacked here: with
        `mcap.records` they take 6 and 3 times as long, and opening would be slow.
        """
        stated, messages = None, 0
        for opcode, begin, end in records(summary):
            if opcode == Opcode.CHUNK_INDEX:
                start, stop, offset, length, size = struct.unpack_from("<QQQQI", summary, begin)
                pairs = struct.unpack_from("<" + "HQ" * (size // 10), summary, begin + 36)
                self.chunks.append(ChunkEntry(offset, length, start, stop, pairs[::2]))
                (indexes,) = struct.unpack_from("<Q", summary, begin + 36 + size)
                messages += (indexes - (size // 10) * (RECORD.size + 6)) // 16  # of a MessageIndex, 16 bytes each
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
            elif opcode == Opcode.STATISTICS:
                stated = STATISTICS.unpack_from(summary, begin)
        self.chunks.sort()
        held = len(self.schemas), len(self.channels), len(self.attachments), len(self.metadata), len(self.chunks)
        return stated == (messages, *held)

    def _scan(self, end: int) -> None:
        """Takes from the data, which end there, where everything lies; of the summary only channels and schemas stay.

        One chunk at a time is in memory, and of attachments no more than is needed for their names.
        """
        self.chunks, self.attachments, self.metadata = [], {}, {}
        data, crc = memoryview(self._mapped)[:end], None
        for opcode, begin, stop in stretches(records(data, len(MAGIC))):
            at = begin - RECORD.size
            if opcode == Opcode.DATA_END:
                crc = DataEnd.read(Content(data[begin:stop])).data_section_crc
                end = at
                break
            if opcode == Opcode.MESSAGE:
                loose = Span()
                for _, message, _ in records(data[begin:stop]):
                    loose.add(data, begin + message)
                self.chunks.append(loose.entry(begin, stop - begin, loose=True))
            elif opcode == Opcode.CHUNK:
                self.chunks.append(self._scanned(data[begin:stop]).entry(at, stop - at))
            elif opcode == Opcode.ATTACHMENT:
                content = Content(data[begin + 16 : stop])  # behind its two times
                self.attachments[content.read_prefixed_string()] = at, stop - at
            elif opcode == Opcode.METADATA:
                self.metadata[Content(data[begin:stop]).read_prefixed_string()] = at, stop - at
            else:
                self._describe(opcode, data[begin:stop])
        if crc is None:
            raise ValueError("its data have no end")
        if any(chunk.loose for chunk in self.chunks) and not is_data_crc(data[:end], crc):
            raise ValueError("the checksum (CRC) of its data is wrong")
        unknown = {number for chunk in self.chunks for number in chunk.channels} - self.channels.keys()
        if unknown:
            raise ValueError(f"no record describes the channel {min(unknown)}, which messages have")

    def _scanned(self, data: Any) -> Span:
        """The messages of a chunk's record; takes channels and schemas in it."""
        content, span = decompressed(Chunk.read(Content(data))), Span()
        for opcode, begin, stop in records(content):
            if opcode == Opcode.MESSAGE:
                span.add(content, begin)
            else:
                self._describe(opcode, content[begin:stop])
        return span

    def _describe(self, opcode: int, data: Any) -> None:
        """Takes a channel or a schema; raises ValueError where another one has its number."""
        if opcode == Opcode.CHANNEL:
            channel = Channel.read(Content(bytes(data)))
            if plain_channel(self.channels.setdefault(channel.id, channel)) != plain_channel(channel):
                raise ValueError(f"two channels of the number {channel.id}")
        elif opcode == Opcode.SCHEMA:
            schema = Schema.read(Content(bytes(data)))
            if self.schemas.setdefault(schema.id, schema) != schema:
                raise ValueError(f"two schemas of the number {schema.id}")

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
        """A chunk's records; those of an uncompressed chunk, and loose ones, are a view of the file."""
        with reading(self.path):
            if entry.loose:
                return memoryview(self._mapped)[entry.offset : entry.offset + entry.length]
            head = self._read(entry.offset, min(64, entry.length))
            opcode, length = RECORD.unpack_from(head, 0)
            if opcode != Opcode.CHUNK or RECORD.size + length != entry.length:
                raise ValueError(f"no chunk at byte {entry.offset}")
            if struct.unpack_from("<I", head, RECORD.size + 28) == (0,):  # no compression
                data = memoryview(self._mapped)[entry.offset : entry.offset + entry.length]
            else:
                data = memoryview(self._read(entry.offset, entry.length))
            return decompressed(Chunk.read(Content(data[RECORD.size :])))
