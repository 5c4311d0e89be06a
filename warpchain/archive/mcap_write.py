"""Writing an MCAP file: chunks in order, the summary at the end, its name only when whole."""

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

from warpchain.archive.digest import DIGEST_KEY, channel_digest, metadata_digest, metadata_without_digest
from warpchain.errors import ArchiveError
from warpchain.files import WholeFile, refusals_as_errors

ZSTD_LEVEL = 1
MCAP_MAGIC = b"\x89MCAP0\r\n"


class PackedChunk(NamedTuple):
    """Compressed MCAP chunk, ready to be written.

    Attributes:
        size, crc: of the records uncompressed.
        start, end: least and greatest log time [ns].
        indexes: (messages, 2) log times [ns] and offsets by channel.
    """

    compression: str
    data: Any
    size: int
    crc: int
    start: int
    end: int
    indexes: Mapping[int, NDArray[np.uint64]]


def chunk_compressor(compression: str) -> Callable[[Any], Any]:
    """Function that compresses an MCAP chunk's records."""
    if compression == "zstd":
        import zstandard

        return lambda data: zstandard.ZstdCompressor(level=ZSTD_LEVEL).compress(data)
    if compression == "lz4":
        import lz4.frame

        return lz4.frame.compress
    return lambda data: data


def pack_chunk(records: Any, indexes: Mapping[int, NDArray[np.uint64]], compression: str) -> PackedChunk:
    """Compressed MCAP chunk of records, with messages' indexes."""
    times = np.concatenate([index[:, 0] for index in indexes.values()])
    name = "" if compression == "none" else compression
    data = chunk_compressor(compression)(records)
    return PackedChunk(name, data, len(records), zlib.crc32(records), int(times.min()), int(times.max()), indexes)


def name_taken_error(path: Path) -> ArchiveError:
    """Error of an archive's file that exists already."""
    return ArchiveError(f"{path}: exists already; give another name, or overwrite=True")


class McapWriter:
    """Writer of an MCAP file, under a temporary name until `finish_file`.

    `claimed`: the caller holds the lock of the archive's name.

    Raises:
        ArchiveError: here and in every method, another writer, or a folder or disk that refuses.
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
        self._write_bytes(MCAP_MAGIC)
        self._write_record(kinds.Header(profile="", library=library))

    @property
    def partial_path(self) -> Path:
        """Temporary name of the MCAP file."""
        return self._file.partial

    @property
    def is_finished(self) -> bool:
        """Whether the MCAP file has its own name."""
        return self._file.finished

    @property
    def bytes_written(self) -> int:
        """Number of bytes of the MCAP file so far."""
        return self._at

    @property
    def chunks_written(self) -> int:
        """Number of chunks of the MCAP file so far."""
        return len(self._chunks)

    def _write_bytes(self, data: Any) -> int:
        """Appends bytes to the MCAP file; returns their offset."""
        at = self._at
        with refusals_as_errors(self.path, ArchiveError):
            self._file.stream.write(data)
        self._at += len(data)
        return at

    def _write_record(self, record: Any) -> tuple[int, int]:
        """Appends an MCAP record; returns its offset and length."""
        data = _record_bytes(record)
        return self._write_bytes(data), len(data)

    def add_schema(self, number: int, name: str, encoding: str, data: bytes) -> None:
        """Appends an MCAP schema."""
        self._schemas[number] = kinds.Schema(id=number, name=name, encoding=encoding, data=data)
        self._write_record(self._schemas[number])

    def has_schema(self, number: int) -> bool:
        """Whether an MCAP schema of that number is written."""
        return number in self._schemas

    def add_channel(self, number: int, schema: int, topic: str, encoding: str, metadata: Mapping[str, str]) -> None:
        """Appends an MCAP channel with its digest."""
        record = kinds.Channel(
            id=number,
            schema_id=schema,
            topic=topic,
            message_encoding=encoding,
            metadata=metadata_without_digest(metadata),
        )
        record.metadata[DIGEST_KEY] = channel_digest(record, self._schemas[schema])
        self._channels[number] = record
        self._counts[number] = 0
        self._write_record(record)

    def has_channel(self, number: int) -> bool:
        """Whether an MCAP channel of that number is written."""
        return number in self._channels

    def add_attachment(self, name: str, media_type: str, data: bytes) -> None:
        """Appends an MCAP attachment."""
        record = kinds.Attachment(create_time=0, log_time=0, name=name, media_type=media_type, data=data)
        offset, length = self._write_record(record)
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

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Appends an MCAP metadata record with its digest."""
        sealed = metadata_without_digest(values) | {DIGEST_KEY: metadata_digest(name, values)}
        offset, length = self._write_record(kinds.Metadata(name=name, metadata=sealed))
        self._metadata.append(kinds.MetadataIndex(offset=offset, length=length, name=name))

    def add_chunk(self, chunk: PackedChunk) -> None:
        """Appends an MCAP chunk and its messages' index."""
        name = chunk.compression.encode()
        inner = struct.pack("<QQQII", chunk.start, chunk.end, chunk.size, chunk.crc, len(name)) + name
        inner += struct.pack("<Q", len(chunk.data))
        head = struct.pack("<BQ", Opcode.CHUNK, len(inner) + len(chunk.data)) + inner
        offset = self._write_bytes(head)
        self._write_bytes(chunk.data)
        offsets, begin = {}, self._at
        for number, index in chunk.indexes.items():
            offsets[number] = self._write_bytes(_message_index_bytes(number, index))
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
    def readable_draft(self, name: str, values: Mapping[str, str]) -> Iterator[Path]:
        """Context in which the temporary MCAP file has an end, to be read back."""
        at, held = self._at, len(self._metadata)
        self.add_metadata(name, values)
        self._write_end()
        try:
            with refusals_as_errors(self.path, ArchiveError):
                self._file.stream.flush()
            yield self.partial_path
        finally:
            del self._metadata[held:]
            with refusals_as_errors(self.path, ArchiveError):
                self._file.stream.seek(at)
                self._file.stream.truncate()
            self._at = at

    def _write_end(self) -> None:
        """Appends the MCAP data's end and the summary."""
        self._write_bytes(_record_bytes(kinds.DataEnd(data_section_crc=0)))
        self._write_bytes(self._summary_bytes())

    def finish_file(self) -> None:
        """Ends the MCAP file, flushes it, and gives it its name."""
        self._write_end()
        with refusals_as_errors(self.path, ArchiveError):
            try:
                self._file.finish()
            except FileExistsError:
                raise name_taken_error(self.path) from None

    def _summary_bytes(self) -> bytes:
        """Bytes of the MCAP file's summary, footer and closing magic."""
        start, data, offsets = self._at, bytearray(), bytearray()
        groups: list[list[Any]] = [
            list(self._schemas.values()),
            list(self._channels.values()),
            [self._statistics_record()],
        ]
        for group in [*groups, self._chunks, self._attachments, self._metadata]:
            if group:
                begin = len(data)
                for record in group:
                    data += _record_bytes(record)
                length = len(data) - begin
                offset = kinds.SummaryOffset(group_opcode=data[begin], group_start=start + begin, group_length=length)
                offsets += _record_bytes(offset)
        footer = kinds.Footer(summary_start=start, summary_offset_start=start + len(data), summary_crc=0)
        data += offsets + _record_bytes(footer)[:-4]  # its CRC covers all before it
        return bytes(data) + struct.pack("<I", zlib.crc32(data)) + MCAP_MAGIC

    def _statistics_record(self) -> Any:
        """Statistics record of the MCAP file."""
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

    def close_unfinished(self, keep: bool = False) -> None:
        """Drops an unfinished MCAP file, or keeps it under its temporary name."""
        self._file.drop(keep)


def _record_bytes(record: Any) -> bytes:
    """Bytes of an MCAP record."""
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())


def _message_index_bytes(channel: int, index: NDArray[np.uint64]) -> bytes:
    """Bytes of an MCAP MessageIndex record."""
    data = np.ascontiguousarray(index, dtype="<u8").tobytes()
    return struct.pack("<BQHI", Opcode.MESSAGE_INDEX, 6 + len(data), channel, len(data)) + data
