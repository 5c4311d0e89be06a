"""An MCAP file being written: whole chunks appended in order, the summary at its end, its name only when it is whole.

The records' bytes come from the mcap package; chunks come compressed, so that compressing can go on in other threads.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mcap import records as kinds
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from numpy.typing import NDArray

from warpchain.archive.digest import DIGEST, of_channel, of_metadata, plain
from warpchain.errors import ArchiveError
from warpchain.files import WholeFile, refusals_as_errors

ZSTD_LEVEL = 1
"""On trajectories as small as the default level 3, and faster."""
MAGIC = b"\x89MCAP0\r\n"


class Chunk(NamedTuple):
    """A chunk ready to be written.

    Attributes:
        compression: "zstd", "lz4" or "".
        data: the records, compressed.
        size: bytes of the records uncompressed.
        crc: CRC-32 of the records uncompressed.
        start: least log time [ns].
        end: greatest log time [ns].
        indexes: for each channel, (messages, 2) log times [ns] and offsets in the uncompressed records.
    """

    compression: str
    data: Any
    size: int
    crc: int
    start: int
    end: int
    indexes: Mapping[int, NDArray[np.uint64]]


def compressor(compression: str) -> Callable[[Any], Any]:
    """The function that compresses a chunk's records."""
    if compression == "zstd":
        import zstandard

        return lambda data: zstandard.ZstdCompressor(level=ZSTD_LEVEL).compress(data)
    if compression == "lz4":
        import lz4.frame

        return lz4.frame.compress
    return lambda data: data


def make_chunk(records: Any, indexes: Mapping[int, NDArray[np.uint64]], compression: str) -> Chunk:
    """A chunk from its uncompressed records."""
    times = np.concatenate([index[:, 0] for index in indexes.values()])
    name = "" if compression == "none" else compression
    data = compressor(compression)(records)
    return Chunk(name, data, len(records), zlib.crc32(records), int(times.min()), int(times.max()), indexes)


def taken(path: Path) -> ArchiveError:
    """The refusal to replace a file."""
    return ArchiveError(f"{path}: exists already; give another name, or overwrite=True")


class McapFile:
    """Writes one MCAP file under a temporary name, which `finish` turns into its own.

    Args:
        path: the file's name when whole.
        library: name of the writing program, for the header.
        overwrite: replace a file of that name.
        claimed: the caller holds the lock of the archive's name.

    Raises:
        ArchiveError: here and in every method, another writer, a folder or disk that refuses; in `finish`, a file of
            that name.
    """

    def __init__(self, path: Path, library: str, overwrite: bool = True, claimed: bool = False) -> None:
        self.path = path
        self._at = 0
        self._schemas: dict[int, Any] = {}
        self._channels: dict[int, Any] = {}
        self._chunks: list[Any] = []
        self._attachments: list[Any] = []
        self._metadata: list[Any] = []
        self._counts: dict[int, int] = {}
        with refusals_as_errors(path, ArchiveError):
            self._file = WholeFile(path, overwrite, hidden=False, patience=None if claimed else 0.0)
        self._put(MAGIC)
        self._record(kinds.Header(profile="", library=library))

    @property
    def partial(self) -> Path:
        """The temporary name."""
        return self._file.partial

    @property
    def finished(self) -> bool:
        """Whether the file has its own name."""
        return self._file.finished

    @property
    def size(self) -> int:
        """Bytes written so far."""
        return self._at

    @property
    def chunks(self) -> int:
        """Chunks written so far."""
        return len(self._chunks)

    def _put(self, data: Any) -> int:
        """Appends bytes; returns where they begin."""
        at = self._at
        with refusals_as_errors(self.path, ArchiveError):
            self._file.stream.write(data)
        self._at += len(data)
        return at

    def _record(self, record: Any) -> tuple[int, int]:
        """Appends a record; returns its offset and length."""
        data = _bytes(record)
        return self._put(data), len(data)

    def schema(self, number: int, name: str, encoding: str, data: bytes) -> None:
        """Describes a message type."""
        self._schemas[number] = kinds.Schema(id=number, name=name, encoding=encoding, data=data)
        self._record(self._schemas[number])

    def has_schema(self, number: int) -> bool:
        """Whether a schema of that number was written."""
        return number in self._schemas

    def channel(self, number: int, schema: int, topic: str, encoding: str, metadata: Mapping[str, str]) -> None:
        """Opens a topic, whose schema was written; its metadata get a digest."""
        record = kinds.Channel(
            id=number, schema_id=schema, topic=topic, message_encoding=encoding, metadata=plain(metadata)
        )
        record.metadata[DIGEST] = of_channel(record, self._schemas[schema])
        self._channels[number] = record
        self._counts[number] = 0
        self._record(record)

    def has_channel(self, number: int) -> bool:
        """Whether a topic of that number was opened."""
        return number in self._channels

    def attachment(self, name: str, media_type: str, data: bytes) -> None:
        """Appends an attachment."""
        record = kinds.Attachment(create_time=0, log_time=0, name=name, media_type=media_type, data=data)
        offset, length = self._record(record)
        self._attachments.append(
            kinds.AttachmentIndex(
                offset=offset,
                length=length,
                log_time=0,
                create_time=0,
                data_size=len(data),
                name=name,
                media_type=media_type,
            )
        )

    def metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Appends a metadata record, with its digest."""
        sealed = plain(values) | {DIGEST: of_metadata(name, values)}
        offset, length = self._record(kinds.Metadata(name=name, metadata=sealed))
        self._metadata.append(kinds.MetadataIndex(offset=offset, length=length, name=name))

    def chunk(self, chunk: Chunk) -> None:
        """Appends a chunk and the index of its messages.

        Their bytes are put together here: `mcap.records` would copy the data and take the index as a list of pairs.
        """
        name = chunk.compression.encode()
        inner = struct.pack("<QQQII", chunk.start, chunk.end, chunk.size, chunk.crc, len(name)) + name
        inner += struct.pack("<Q", len(chunk.data))
        head = struct.pack("<BQ", Opcode.CHUNK, len(inner) + len(chunk.data)) + inner
        offset = self._put(head)
        self._put(chunk.data)
        offsets, begin = {}, self._at
        for number, index in chunk.indexes.items():
            offsets[number] = self._put(_index_bytes(number, index))
            self._counts[number] += len(index)
        with refusals_as_errors(self.path, ArchiveError):
            self._file.stream.flush()  # to the system, so that a killed process leaves whole chunks
        self._chunks.append(
            kinds.ChunkIndex(
                chunk_length=len(head) + len(chunk.data),
                chunk_start_offset=offset,
                compression=chunk.compression,
                compressed_size=len(chunk.data),
                message_end_time=chunk.end,
                message_index_length=self._at - begin,
                message_index_offsets=offsets,
                message_start_time=chunk.start,
                uncompressed_size=chunk.size,
            )
        )

    @contextmanager
    def draft(self, name: str, values: Mapping[str, str]) -> Iterator[Path]:
        """The temporary file while it is whole, with a last metadata record, to be read back; then all that goes."""
        at, held = self._at, len(self._metadata)
        self.metadata(name, values)
        self._end()
        try:
            with refusals_as_errors(self.path, ArchiveError):
                self._file.stream.flush()
            yield self.partial
        finally:
            del self._metadata[held:]
            with refusals_as_errors(self.path, ArchiveError):
                self._file.stream.seek(at)
                self._file.stream.truncate()
            self._at = at

    def _end(self) -> None:
        self._put(_bytes(kinds.DataEnd(data_section_crc=0)))
        self._put(self._summary())

    def finish(self) -> None:
        """Writes the summary, flushes to the disk and gives the file its name."""
        self._end()
        with refusals_as_errors(self.path, ArchiveError):
            try:
                self._file.finish()
            except FileExistsError:
                raise taken(self.path) from None

    def _summary(self) -> bytes:
        """The summary section, the footer and the closing magic."""
        start, data, offsets = self._at, bytearray(), bytearray()
        groups: list[list[Any]] = [list(self._schemas.values()), list(self._channels.values()), [self._statistics()]]
        for group in [*groups, self._chunks, self._attachments, self._metadata]:
            if group:
                begin = len(data)
                for record in group:
                    data += _bytes(record)
                length = len(data) - begin
                offset = kinds.SummaryOffset(group_opcode=data[begin], group_start=start + begin, group_length=length)
                offsets += _bytes(offset)
        footer = kinds.Footer(summary_start=start, summary_offset_start=start + len(data), summary_crc=0)
        data += offsets + _bytes(footer)[:-4]  # its CRC covers all before it
        return bytes(data) + struct.pack("<I", zlib.crc32(data)) + MAGIC

    def _statistics(self) -> Any:
        return kinds.Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._chunks),
            message_count=sum(self._counts.values()),
            metadata_count=len(self._metadata),
            message_start_time=min((chunk.message_start_time for chunk in self._chunks), default=0),
            message_end_time=max((chunk.message_end_time for chunk in self._chunks), default=0),
            schema_count=len(self._schemas),
        )

    def close(self, keep: bool = False) -> None:
        """Ends an unfinished file: drops it, or keeps it under its temporary name."""
        self._file.drop(keep)


def _bytes(record: Any) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())


def _index_bytes(channel: int, index: NDArray[np.uint64]) -> bytes:
    """A MessageIndex record."""
    data = np.ascontiguousarray(index, dtype="<u8").tobytes()
    return struct.pack("<BQHI", Opcode.MESSAGE_INDEX, 6 + len(data), channel, len(data)) + data
