"""Reading an MCAP file by its summary, or all of it where the summary does not account for all records."""

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

from warpchain.archive.digest import DIGEST_KEY, channel_without_digest, checked_metadata
from warpchain.archive.mcap_write import MCAP_MAGIC
from warpchain.errors import ArchiveError
from warpchain.files import open_regular_file, refusal_reason

RECORD_HEAD = struct.Struct("<BQ")
MOST_CHUNK_BYTES = 2**28
"""Most uncompressed bytes of a chunk; warpchain writes about 1 MiB."""
FOOTER_BYTES = RECORD_HEAD.size + 20
STATISTICS_HEAD = struct.Struct("<QHIIII")
MOST_STRETCH_BYTES = 2**20


class ChunkEntry(NamedTuple):
    """Place of an MCAP chunk or loose messages, log times [ns], channels."""

    offset: int
    length: int
    start: int
    end: int
    channels: tuple[int, ...]
    is_loose: bool = False


class RecordReader(ReadDataStream):
    """Reader of an MCAP record's content; raises ValueError if cut."""

    def __init__(self, data: Any) -> None:
        self._data, self._count = data, 0

    def read(self, length: int) -> Any:
        """Next bytes of an MCAP record."""
        end = self._count + length
        part = self._data[self._count : end]
        if len(part) != length:
            raise ValueError("a text runs past its record's end")
        self._count = end
        return part

    def read_prefixed_string(self) -> str:
        """Next text of an MCAP record, after its length."""
        begin = self._count + 4
        end = begin + int.from_bytes(self._data[self._count : begin], "little")
        if end > len(self._data):
            raise ValueError("a text runs past its record's end")
        self._count = end
        return str(self._data[begin:end], "utf-8")


def iterate_records(data: Any, at: int = 0) -> Iterator[tuple[int, int, int]]:
    """Opcode, begin and end of each MCAP record; raises ValueError if cut."""
    while at < len(data):
        if at + RECORD_HEAD.size > len(data):
            raise ValueError("a record is cut")
        opcode, length = RECORD_HEAD.unpack_from(data, at)
        begin = at + RECORD_HEAD.size
        at = begin + length
        if at > len(data):
            raise ValueError("a record is cut")
        yield opcode, begin, at


def is_data_checksum(data: Any, crc: int) -> bool:
    """Whether an MCAP DataEnd record's checksum is 0 or right."""
    return crc in (0, zlib.crc32(data)) or crc == zlib.crc32(data[len(MCAP_MAGIC) :])


def attachment_from_bytes(data: Any) -> Attachment:
    """MCAP attachment of a record; raises for a wrong checksum."""
    content = RecordReader(data)
    record = Attachment.read(content)
    (crc,) = struct.unpack_from("<I", data, content.count - 4)
    if crc and crc != zlib.crc32(data[: content.count - 4]):
        raise ValueError(f"attachment {record.name}: its checksum (CRC) is wrong")
    return record


def decompress_chunk(chunk: Chunk) -> Any:
    """Uncompressed records of an MCAP chunk, checked; a view if stored so."""
    import lz4.frame
    import zstandard

    compression, data, size, crc = chunk.compression, chunk.data, chunk.uncompressed_size, chunk.uncompressed_crc
    if size > MOST_CHUNK_BYTES:
        raise ValueError(f"a chunk says that it holds {size} bytes; allowed are {MOST_CHUNK_BYTES}")
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
def convert_read_errors(path: Path) -> Iterator[None]:
    """Context that turns failures of an MCAP file into ArchiveError."""
    try:
        yield
    except OSError as error:
        raise ArchiveError(f"{path}: cannot be read ({refusal_reason(error)})") from None
    except (ValueError, IndexError, OverflowError, struct.error, MemoryError) as error:
        raise ArchiveError(f"{path}: is damaged ({error}); see warpchain recover") from None


@dataclass
class MessageSpan:
    """Channels and log times [ns] of some MCAP messages."""

    channels: set[int] = field(default_factory=set)
    start: int = 2**64 - 1
    end: int = 0

    def add_message(self, data: Any, begin: int) -> None:
        """Counts in the MCAP message at an offset."""
        channel, _, stamp = struct.unpack_from("<HIQ", data, begin)
        self.channels.add(channel)
        self.start, self.end = min(self.start, stamp), max(self.end, stamp)

    def chunk_entry(self, offset: int, length: int, loose: bool = False) -> ChunkEntry:
        """Entry of the MCAP messages for their place in the file."""
        return ChunkEntry(offset, length, self.start, self.end, tuple(sorted(self.channels)), loose)


def group_loose_messages(found: Iterable[tuple[int, int, int]]) -> Iterator[tuple[int, int, int]]:
    """MCAP records of `iterate_records`, runs of messages as one."""
    first = end = 0
    for opcode, begin, stop in found:
        if end > first and (opcode != Opcode.MESSAGE or stop - first > MOST_STRETCH_BYTES):
            yield Opcode.MESSAGE, first, end
            first = end
        if opcode == Opcode.MESSAGE:
            first, end = (first if end > first else begin - RECORD_HEAD.size), stop
        else:
            yield opcode, begin, stop
            first = end = stop
    if end > first:
        yield Opcode.MESSAGE, first, end


class McapIndex:
    """Open MCAP file and where everything in it is.

    Attributes:
        channels, schemas: by number.
        has_checked_summary: whether the summary is complete and right by its checksum.
        chunks: in the file's order.
        attachments, metadata: offset and length by name.

    Raises:
        ArchiveError: here and in every method, a missing, foreign, cut or damaged file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.channels: dict[int, Channel] = {}
        self.schemas: dict[int, Schema] = {}
        self.chunks: list[ChunkEntry] = []
        self.attachments: dict[str, tuple[int, int]] = {}
        self.metadata: dict[str, tuple[int, int]] = {}
        with convert_read_errors(path):
            self._file = open_regular_file(path)
            weakref.finalize(self, os.close, self._file)
            self._map: mmap.mmap | None = None
            size = self._size = os.fstat(self._file).st_size
            if self._read_bytes(0, len(MCAP_MAGIC)) != MCAP_MAGIC:
                raise ArchiveError(f"{path}: is not an MCAP file")
            tail = FOOTER_BYTES + len(MCAP_MAGIC)
            end = self._read_bytes(max(0, size - tail), tail)
            if size < tail + len(MCAP_MAGIC) or not end.endswith(MCAP_MAGIC):
                raise ArchiveError(f"{path}: is cut short; restore what is whole with: warpchain recover")
            footer = Footer.read(RecordReader(end[RECORD_HEAD.size :]))
            start, crc = footer.summary_start or size - tail, footer.summary_crc
            if end[0] != Opcode.FOOTER or not len(MCAP_MAGIC) <= start <= size - tail:
                raise ValueError("its footer is wrong")
            summary = self._read_bytes(start, size - tail - start)
            if crc and crc != zlib.crc32(summary + end[: FOOTER_BYTES - 4]):
                raise ValueError("its summary's checksum (CRC) is wrong")
            whole = self._parse_summary(summary)
            self.has_checked_summary = whole and crc != 0
            if not whole:
                self._scan_data(start)

    def __reduce__(self) -> tuple[Any, ...]:
        """Constructor and path that pickle the index of an MCAP file."""
        return McapIndex, (self.path.absolute(),)

    @property
    def has_digests(self) -> bool:
        """Whether the MCAP file's channels have digests."""
        return any(DIGEST_KEY in channel.metadata for channel in self.channels.values())

    def _read_bytes(self, offset: int, length: int) -> bytes:
        """Bytes of the MCAP file at an offset."""
        if offset + length > max(self._size, FOOTER_BYTES + len(MCAP_MAGIC)):
            raise ValueError(f"nothing at byte {offset}")
        data = os.pread(self._file, length, offset)
        while len(data) < length:
            more = os.pread(self._file, length - len(data), offset + len(data))
            if not more:
                break
            data += more
        return data

    @property
    def _mapped_file(self) -> mmap.mmap:
        """Memory map of the MCAP file."""
        if self._map is None:
            self._map = mmap.mmap(self._file, 0, access=mmap.ACCESS_READ)
        return self._map

    def _parse_summary(self, summary: bytes) -> bool:
        """Fills the index from an MCAP summary; returns whether complete."""
        # for indexes, which come by the ten thousand, `mcap.records` takes 3 to 6 times as long
        stated, messages = None, 0
        for opcode, begin, end in iterate_records(summary):
            if opcode == Opcode.CHUNK_INDEX:
                start, stop, offset, length, size = struct.unpack_from("<QQQQI", summary, begin)
                pairs = struct.unpack_from("<" + "HQ" * (size // 10), summary, begin + 36)
                self.chunks.append(ChunkEntry(offset, length, start, stop, pairs[::2]))
                (indexes,) = struct.unpack_from("<Q", summary, begin + 36 + size)
                messages += (indexes - (size // 10) * (RECORD_HEAD.size + 6)) // 16  # of a MessageIndex, 16 bytes each
            elif opcode == Opcode.ATTACHMENT_INDEX:
                offset, length, _, _, _, size = struct.unpack_from("<QQQQQI", summary, begin)
                self.attachments[str(summary[begin + 44 : begin + 44 + size], "utf-8")] = offset, length
            elif opcode == Opcode.CHANNEL:
                channel = Channel.read(RecordReader(summary[begin:end]))
                self.channels[channel.id] = channel
            elif opcode == Opcode.SCHEMA:
                schema = Schema.read(RecordReader(summary[begin:end]))
                self.schemas[schema.id] = schema
            elif opcode == Opcode.METADATA_INDEX:
                place = MetadataIndex.read(RecordReader(summary[begin:end]))
                self.metadata[place.name] = place.offset, place.length
            elif opcode == Opcode.STATISTICS:
                stated = STATISTICS_HEAD.unpack_from(summary, begin)
        self.chunks.sort()
        held = len(self.schemas), len(self.channels), len(self.attachments), len(self.metadata), len(self.chunks)
        return stated == (messages, *held)

    def _scan_data(self, end: int) -> None:
        """Fills the index from an MCAP file's data up to `end`."""
        self.chunks, self.attachments, self.metadata = [], {}, {}
        data, crc = memoryview(self._mapped_file)[:end], None
        for opcode, begin, stop in group_loose_messages(iterate_records(data, len(MCAP_MAGIC))):
            at = begin - RECORD_HEAD.size
            if opcode == Opcode.DATA_END:
                crc = DataEnd.read(RecordReader(data[begin:stop])).data_section_crc
                end = at
                break
            if opcode == Opcode.MESSAGE:
                loose = MessageSpan()
                for _, message, _ in iterate_records(data[begin:stop]):
                    loose.add_message(data, begin + message)
                self.chunks.append(loose.chunk_entry(begin, stop - begin, loose=True))
            elif opcode == Opcode.CHUNK:
                self.chunks.append(self._scan_chunk(data[begin:stop]).chunk_entry(at, stop - at))
            elif opcode == Opcode.ATTACHMENT:
                content = RecordReader(data[begin + 16 : stop])  # behind its two times
                self.attachments[content.read_prefixed_string()] = at, stop - at
            elif opcode == Opcode.METADATA:
                self.metadata[RecordReader(data[begin:stop]).read_prefixed_string()] = at, stop - at
            else:
                self._add_description(opcode, data[begin:stop])
        if crc is None:
            raise ValueError("its data have no end")
        if any(chunk.is_loose for chunk in self.chunks) and not is_data_checksum(data[:end], crc):
            raise ValueError("the checksum (CRC) of its data is wrong")
        unknown = {number for chunk in self.chunks for number in chunk.channels} - self.channels.keys()
        if unknown:
            raise ValueError(f"no record describes the channel {min(unknown)}, which messages have")

    def _scan_chunk(self, data: Any) -> MessageSpan:
        """Span of an MCAP chunk's messages, whose channels and schemas are added."""
        content, span = decompress_chunk(Chunk.read(RecordReader(data))), MessageSpan()
        for opcode, begin, stop in iterate_records(content):
            if opcode == Opcode.MESSAGE:
                span.add_message(content, begin)
            else:
                self._add_description(opcode, content[begin:stop])
        return span

    def _add_description(self, opcode: int, data: Any) -> None:
        """Adds an MCAP channel or schema; raises ValueError if its number is taken."""
        if opcode == Opcode.CHANNEL:
            channel = Channel.read(RecordReader(bytes(data)))
            if channel_without_digest(self.channels.setdefault(channel.id, channel)) != channel_without_digest(channel):
                raise ValueError(f"two channels of the number {channel.id}")
        elif opcode == Opcode.SCHEMA:
            schema = Schema.read(RecordReader(bytes(data)))
            if self.schemas.setdefault(schema.id, schema) != schema:
                raise ValueError(f"two schemas of the number {schema.id}")

    def _record_content(self, opcode: int, offset: int, length: int) -> memoryview:
        """Content of the MCAP record at an offset."""
        data = memoryview(self._read_bytes(offset, length))
        found = next(iterate_records(data), None)
        if found is None or found != (opcode, RECORD_HEAD.size, length):
            raise ValueError(f"no record of its kind at byte {offset}")
        return data[RECORD_HEAD.size :]

    def read_attachment(self, name: str) -> bytes:
        """Data of an MCAP file's attachment."""
        if name not in self.attachments:
            raise ArchiveError(f"{self.path}: lacks its attachment {name}")
        with convert_read_errors(self.path):
            record = attachment_from_bytes(self._record_content(Opcode.ATTACHMENT, *self.attachments[name]))
            if record.name != name:
                raise ValueError(f"attachment {name} is named {record.name!r}")
            return bytes(record.data)

    def read_metadata(self, name: str) -> dict[str, str] | None:
        """Values of an MCAP file's metadata record, or None."""
        if name not in self.metadata:
            return None
        with convert_read_errors(self.path):
            record = Metadata.read(RecordReader(self._record_content(Opcode.METADATA, *self.metadata[name])))
            if record.name != name:
                raise ValueError(f"metadata {name} are named {record.name!r}")
            return checked_metadata(name, record.metadata, self.has_digests)

    def read_chunk(self, entry: ChunkEntry) -> Any:
        """Uncompressed records of an MCAP chunk; a view if stored so."""
        with convert_read_errors(self.path):
            if entry.is_loose:
                return memoryview(self._mapped_file)[entry.offset : entry.offset + entry.length]
            head = self._read_bytes(entry.offset, min(64, entry.length))
            opcode, length = RECORD_HEAD.unpack_from(head, 0)
            if opcode != Opcode.CHUNK or RECORD_HEAD.size + length != entry.length:
                raise ValueError(f"no chunk at byte {entry.offset}")
            if struct.unpack_from("<I", head, RECORD_HEAD.size + 28) == (0,):  # no compression
                data = memoryview(self._mapped_file)[entry.offset : entry.offset + entry.length]
            else:
                data = memoryview(self._read_bytes(entry.offset, entry.length))
            return decompress_chunk(Chunk.read(RecordReader(data[RECORD_HEAD.size :])))
