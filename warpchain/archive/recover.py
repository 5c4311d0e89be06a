"""Restoring a cut or damaged archive: what can be trusted goes into a new file that is whole.

A right and complete summary says where everything is. Any other file is read record by record, and channels and
metadata go by their digests (`archive.digest`).
"""

from __future__ import annotations

import mmap
import struct
from collections.abc import Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from mcap import records as kinds
from mcap.opcode import Opcode
from numpy.typing import NDArray

from warpchain.archive import archive_format
from warpchain.archive.archive_names import (
    ArchiveTarget,
    PartName,
    files_by_edition,
    finished_path,
    is_whole_set,
    parse_part_name,
    unfinished_files,
)
from warpchain.archive.channel_trust import TrustedTopics, untrusted_channel
from warpchain.archive.chunk_layout import MESSAGE_OPCODE, RECORD_HEAD_BYTES
from warpchain.archive.digest import checked_metadata
from warpchain.archive.mcap_read import (
    MOST_STRETCH_BYTES,
    RECORD_HEAD,
    McapIndex,
    RecordReader,
    attachment_from_bytes,
    decompress_chunk,
    group_loose_messages,
    is_data_checksum,
    iterate_records,
)
from warpchain.archive.mcap_write import MCAP_MAGIC, McapWriter, PackedChunk, pack_chunk
from warpchain.archive.read import ENDED_RECOVERED, metrics_from_attachment, numbers_from_metadata, open_archive_files
from warpchain.errors import ArchiveError
from warpchain.files import open_regular_file, refusal_reason

KNOWN_OPCODES = frozenset(Opcode)
DESCRIPTION_OPCODES = (Opcode.METADATA, Opcode.SCHEMA, Opcode.CHANNEL)
MOST_MIXED_BYTES = 2**26
BAD_BYTES_ERRORS = (ValueError, OverflowError, struct.error, IndexError, KeyError)


@dataclass
class Recovery:
    """Result of the recovery of an archive.

    Attributes:
        path, files: of the archive written.
        frames: of each variant.
        chunks, damaged: chunks of frames copied and left out.
        missing: frames missing between others.
        left_out: other things left out, in words.
        unreadable: recorded variants that cannot be read, with the reason.
        lost: bytes after the last whole record.
        set_name: common name of a split archive's files.
        next_frames: each variant's next frame number and last log time [ns].
    """

    path: Path
    files: list[Path] = field(default_factory=list)
    frames: dict[int, int] = field(default_factory=dict)
    chunks: int = 0
    damaged: int = 0
    missing: int = 0
    left_out: list[str] = field(default_factory=list)
    unreadable: dict[int, str] = field(default_factory=dict)
    lost: int = 0
    set_name: str = field(default="", repr=False)
    next_frames: dict[int, tuple[int, int]] = field(default_factory=dict, repr=False)

    @property
    def is_complete(self) -> bool:
        """Whether a recovery left out nothing that was whole."""
        return not (self.damaged or self.missing or self.left_out or self.unreadable)

    def note_left_out(self, what: str) -> None:
        """Notes that a recovery left something out."""
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
            words += f"; left out as damaged or missing: {_left_out_text(self.left_out)}"
        if self.unreadable:
            lost = [f"variant {variant} ({why})" for variant, why in sorted(self.unreadable.items())]
            words += f"; lost: {_left_out_text(lost)}"
        return words + (f"; {self.lost} bytes after the last whole record lost" if self.lost else "")


def _left_out_text(words: Sequence[str]) -> str:
    """Line on the first eight things that a recovery left out."""
    return ", ".join(words[:8]) + (", ..." if len(words) > 8 else "")


def recover_archive(broken: str | Path, output: str | Path, overwrite: bool = False) -> Recovery:
    """Restores a broken archive, by a file's or its name; returns what was restored and lost.

    Raises:
        ArchiveError: no archive of warpchain, nothing that can be restored, or a folder or disk that refuses.
    """
    source = Path(broken)
    sources = _source_files(source)
    result = Recovery(Path(output))
    copies: list[_FileCopy] = []
    target = ArchiveTarget(result.path, overwrite, split=len(sources) > 1)
    try:
        for path in sources:
            number = len(copies)
            copies.append(_FileCopy(path, target.begin_file(number, "warpchain recover"), result, number))
            if not copies[-1].copy_file() and number and path.suffix == ".partial":
                copies.pop().file.close_unfinished()  # a part that had only just begun
        for copy in copies:
            copy.require_run()
        if not result.chunks:
            raise ArchiveError(f"{source}: holds no whole chunk of frames; nothing can be restored")
        _check_restored(copies, result)
        if not any(result.frames.values()):
            why = next(iter(result.unreadable.values()), "no frame is whole")
            raise ArchiveError(f"{source}: no variant of it can be read ({why}); nothing can be restored")
        for copy in copies:
            copy.finish_file(len(copies))
        result.files = [copy.file.path for copy in copies]
        target.remove_replaced(result.files)
    except BaseException:
        if not (copies and copies[-1].file.is_finished):
            target.discard_files(copy.file.path for copy in copies if copy.file.is_finished)
        for copy in copies:
            copy.file.close_unfinished()
        raise
    finally:
        target.release_lock()
    return result


def _source_files(path: Path) -> list[Path]:
    """Files from which to restore an archive, unfinished ones last."""
    named = parse_part_name(path) if path.is_file() else None
    if path.is_file() and not named:
        return [path]
    name = named.archive if named else path
    sets = files_by_edition(name)
    for file in unfinished_files(name):
        part = parse_part_name(finished_path(file)) or PartName(name, 0, 0)
        sets.setdefault(part.edition, []).append(file)
    if named:
        return sets[named.edition]
    if not sets:
        why = "Is a directory" if path.is_dir() else "No such file or directory"
        raise ArchiveError(f"{path}: cannot be read ({why})")
    edition, files = max(sets.items())
    if len(sets) > 1 and not (edition and is_whole_set(files)):
        named_by = ", ".join(str(files[0]) for _, files in sorted(sets.items()))
        raise ArchiveError(f"{path}: several runs were cut; name one of {named_by}")
    if not edition and len(files) > 1:
        raise ArchiveError(f"{path}: several runs were cut; name one of {', '.join(map(str, files))}")
    return files


def _check_restored(copies: Sequence[_FileCopy], result: Recovery) -> None:
    """Reads the restored archive; notes frames and unreadable variants."""
    with ExitStack() as drafts:
        paths = [drafts.enter_context(copy.readable_draft(len(copies))) for copy in copies]
        try:
            back = open_archive_files(result.path, tuple(map(McapIndex, paths)))
            recorded = set(back)
        except ArchiveError as error:
            raise ArchiveError(f"{copies[0].path}: cannot be restored ({_short_reason(error, paths)})") from None
        held = {name for file in back.trajectories.files for name in file.attachments}
        copies[-1].check_metrics(held)
        for variant in back.numbers:
            if held.isdisjoint(
                (archive_format.drive_attachment_name(variant), archive_format.drive_copy_name(variant))
            ):
                result.unreadable[variant] = f"lacks its attachment {archive_format.drive_attachment_name(variant)}"
        for variant in sorted((result.frames.keys() | copies[-1].due_variants()) - result.unreadable.keys()):
            try:
                if variant not in recorded:
                    raise ArchiveError("lacks its frames")
                count = sum(len(block.time) for block in back.blocks(variant))
                result.missing += result.frames[variant] - count
                result.frames[variant] = count
            except ArchiveError as error:
                result.unreadable[variant] = _short_reason(error, paths)
        result.frames = {variant: count for variant, count in result.frames.items() if variant not in result.unreadable}


def _short_reason(error: ArchiveError, paths: Sequence[Path]) -> str:
    """Message of an archive's error, without temporary names and advice."""
    text = str(error).removesuffix("; see warpchain recover")
    for path in paths:
        text = text.replace(f"{path}: ", "")
    return text


class _FileCopy:
    """Copy of what can be trusted in a broken archive file."""

    def __init__(self, path: Path, file: McapWriter, result: Recovery, number: int) -> None:
        self.path, self.file, self.result, self.number = path, file, result, number
        self._start: dict[str, str] | None = None
        self._old_end: dict[str, str] = {}
        self._held: dict[str, bytes] = {}
        self._topics = TrustedTopics()
        self._mixed: dict[int, bytearray] = {}

    def copy_file(self) -> bool:
        """Copies a broken archive file's records; returns whether it had chunks."""
        data = _mapped_bytes(self.path)
        if len(data) >= len(MCAP_MAGIC) and bytes(data[: len(MCAP_MAGIC)]) != MCAP_MAGIC:
            raise ArchiveError(f"{self.path}: is not an MCAP file")
        index = _trusted_index(self.path)
        if index is None:
            self._copy_all_records(data)
        else:
            self._copy_listed_records(data, index)
        self._write_mixed_chunks(self._mixed)
        return self.file.chunks_written > 0

    def _copy_listed_records(self, data: Any, index: McapIndex) -> None:
        """Copies records of the broken archive file that a right summary lists."""
        self._topics = TrustedTopics(index)
        places = [(entry.offset, entry.length, Opcode.CHUNK, "") for entry in index.chunks]
        places += [(*at, Opcode.ATTACHMENT, name) for name, at in index.attachments.items()]
        places += [(*at, Opcode.METADATA, name) for name, at in index.metadata.items()]
        for offset, length, opcode, name in sorted(places, key=lambda place: (place[2] != Opcode.METADATA, place[0])):
            end = min(offset + length, len(data))
            found = RECORD_HEAD.unpack_from(data, offset) if offset + RECORD_HEAD.size <= end else None
            if found != (opcode, length - RECORD_HEAD.size):
                self._note_left_out(opcode, name)
            else:
                self._copy_record(opcode, data[offset + RECORD_HEAD.size : end], name)

    def _copy_all_records(self, data: Any) -> None:
        """Copies the broken archive file's whole records, one by one."""
        loose = self._gather_descriptions(data)
        at = len(MCAP_MAGIC)
        for opcode, begin, end in group_loose_messages(_whole_records(data)):
            if opcode == Opcode.DATA_END and end - begin == 4:
                at = len(data)
                break
            if opcode == Opcode.MESSAGE_INDEX:
                if not _is_message_index(data[begin:end]):
                    self._note_left_out(Opcode.CHUNK)
            elif opcode in (Opcode.ATTACHMENT, Opcode.CHUNK) or (opcode == Opcode.MESSAGE and loose):
                self._copy_record(opcode, data[begin:end])
            elif opcode not in DESCRIPTION_OPCODES and not (opcode == Opcode.HEADER and at == len(MCAP_MAGIC)):
                self._note_left_out(opcode)
            at = end
        self.result.lost += max(0, len(data) - at)

    def _gather_descriptions(self, data: Any) -> bool:
        """Gathers a broken archive's descriptions; returns whether loose messages count."""
        used: set[int] = set()
        loose, right = False, True
        for opcode, begin, end in _whole_records(data):
            if opcode == Opcode.DATA_END and end - begin == 4:
                (crc,) = struct.unpack_from("<I", data, begin)
                right = not loose or is_data_checksum(data[: begin - RECORD_HEAD.size], crc)
                break
            if opcode in DESCRIPTION_OPCODES:
                self._copy_record(opcode, data[begin:end])
            elif opcode == Opcode.MESSAGE and end - begin >= 2:
                loose = True
                used.add(int.from_bytes(data[begin : begin + 2], "little"))
            elif opcode == Opcode.CHUNK:
                with suppress(*BAD_BYTES_ERRORS):  # it is counted when it is copied
                    content = decompress_chunk(kinds.Chunk.read(RecordReader(data[begin:end])))
                    for inner, start, stop in iterate_records(content):
                        if inner in DESCRIPTION_OPCODES:
                            self._copy_record(inner, bytes(content[start:stop]))
                        elif inner == Opcode.MESSAGE:
                            used.add(int.from_bytes(content[start : start + 2], "little"))
        if self._topics.decide_trust(self._start or {}, used):
            self._note_left_out(Opcode.CHANNEL)
        return right

    def _note_left_out(self, opcode: int, name: str = "") -> None:
        """Notes in the recovery a record left out."""
        if opcode == Opcode.CHUNK:
            self.result.damaged += 1
        else:
            kind = {Opcode.ATTACHMENT: "attachment", Opcode.METADATA: "metadata", Opcode.MESSAGE: "messages"}
            what = kind.get(opcode, "a record")  # type: ignore[call-overload]
            self.result.note_left_out(f"{what} {name}".strip())

    def require_run(self) -> None:
        """Raises ArchiveError for a broken archive file without a run."""
        if self._start is None:
            raise ArchiveError(
                f"{self.path}: is not an archive of warpchain, or was cut before its first record, or that is damaged"
            )

    def due_variants(self) -> set[int]:
        """Numbers of variants whose frames a broken archive must hold."""
        recorded = (self._start or {}).get("recorded", "") if self._old_end.get("ended") == "complete" else ""
        return {int(word) for word in recorded.split() if word.isdigit()}

    def check_metrics(self, held: set[str]) -> None:
        """Notes in the recovery a missing metrics table of an ended run."""
        if self._old_end.get("ended") in ("complete", "interrupted") and archive_format.METRICS_ATTACHMENT not in held:
            self._note_left_out(Opcode.ATTACHMENT, archive_format.METRICS_ATTACHMENT)

    def readable_draft(self, parts: int) -> AbstractContextManager[Path]:
        """Context in which the restored archive file can be read back."""
        return self.file.readable_draft(archive_format.END_METADATA, self._end_metadata(parts))

    def finish_file(self, parts: int) -> None:
        """Ends the restored archive file and gives it its name."""
        self.file.add_metadata(archive_format.END_METADATA, self._end_metadata(parts))
        self.file.finish_file()

    def _end_metadata(self, parts: int) -> dict[str, str]:
        """Metadata at the restored archive file's end."""
        assert self._start is not None  # as required
        wall_time = self._old_end.get("wall_time", "0.0")
        ended = {"ended": ENDED_RECOVERED, "wall_time": wall_time, "lost_bytes": str(self.result.lost)}
        ended["damaged_chunks"] = str(self.result.damaged)
        if self.number == parts - 1:
            ended["parts"] = str(parts)
        if self.result.missing:
            ended["missing_frames"] = str(self.result.missing)
        if self.result.left_out:
            ended["left_out"] = ", ".join(self.result.left_out)
        if self.result.unreadable:
            ended["unreadable"] = " ".join(map(str, sorted(self.result.unreadable)))
        return archive_format.end_with_start_copy(ended, self._start)

    def _copy_record(self, opcode: int, data: Any, name: str = "") -> None:
        """Copies a broken archive's record if right, else notes it."""
        try:
            if opcode == Opcode.METADATA:
                metadata = kinds.Metadata.read(RecordReader(data))
                name = name or metadata.name
                self._copy_metadata(name, checked_metadata(metadata.name, metadata.metadata, self._topics.has_digests))
            elif opcode == Opcode.ATTACHMENT:
                attached = attachment_from_bytes(data)
                name = name or attached.name
                self._copy_attachment(name, attached)
            elif opcode == Opcode.SCHEMA:
                self._topics.add_schema(kinds.Schema.read(RecordReader(data)))
            elif opcode == Opcode.CHANNEL:
                self._topics.add_channel(kinds.Channel.read(RecordReader(data)))
            elif opcode == Opcode.CHUNK:
                self._copy_chunk(kinds.Chunk.read(RecordReader(data)))
            elif opcode == Opcode.MESSAGE:
                self._sort_mixed_messages(data, message_indexes(data))
        except BAD_BYTES_ERRORS:
            self._note_left_out(opcode, name)

    def _copy_attachment(self, name: str, attached: kinds.Attachment) -> None:
        """Copies a broken archive's attachment; raises ValueError if its name is taken."""
        if attached.name != name or self._held.setdefault(name, attached.data) != attached.data:
            raise ValueError("another one of this name")
        if name == archive_format.METRICS_ATTACHMENT:
            metrics_from_attachment(bytes(attached.data), numbers_from_metadata(self._start or {}))
        self.file.add_attachment(name, attached.media_type, attached.data)

    def _copy_metadata(self, name: str, values: dict[str, str]) -> None:
        """Copies a metadata record of a broken archive, but of the last keeps the times alone."""
        if name == archive_format.RUN_METADATA:
            self._copy_start_metadata(values)
        elif name == archive_format.END_METADATA:
            self._old_end = {"ended": values.get("ended", ""), "wall_time": repr(float(values.get("wall_time", "0.0")))}
            if self._start is None:  # its record was damaged; this is its copy
                self._copy_start_metadata(archive_format.start_copy_of_end(values))
        else:
            self.file.add_metadata(name, values)

    def _copy_start_metadata(self, values: dict[str, str]) -> None:
        """Copies a broken archive's first metadata; raises for another archive."""
        if self._start is not None:
            raise ValueError("another one of this name")
        if values.get("format_version") != archive_format.FORMAT_VERSION:
            raise ArchiveError(
                f"{self.path}: archive format {values.get('format_version')!r} is not known to this version "
                f"(it reads {archive_format.FORMAT_VERSION!r})"
            )
        if self.result.set_name not in ("", values.get("set", "")):
            raise ArchiveError(f"{self.path}: belongs to another archive than the files before it")
        self._start, self.result.set_name = values | {"part": str(self.number)}, values.get("set", "")
        self.file.add_metadata(archive_format.RUN_METADATA, self._start)

    def _owner_variant(self, number: int) -> int:
        """Variant of an MCAP channel, -1 for another program's."""
        named = self._topics.variant_and_topic(number)
        return named[0] if named else -1

    def _copy_chunk(self, chunk: kinds.Chunk) -> None:
        """Copies a broken archive's chunk, or sorts mixed messages."""
        content = decompress_chunk(chunk)
        indexes = message_indexes(content)
        if len(set(map(self._owner_variant, indexes))) > 1:
            self._sort_mixed_messages(content, indexes)
            return
        self._write_mixed_chunks(self._mixed)  # they came before it
        size, crc = chunk.uncompressed_size, chunk.uncompressed_crc
        start, end = chunk.message_start_time, chunk.message_end_time
        self._append_chunk(PackedChunk(chunk.compression, chunk.data, size, crc, start, end, indexes), content)

    def _sort_mixed_messages(self, content: Any, indexes: Iterable[int]) -> None:
        """Sorts mixed messages of a broken archive by variant."""
        if not all(map(self._topics.is_known, indexes)):
            raise ValueError("a topic is not described")
        for opcode, begin, end in iterate_records(content):
            if opcode == MESSAGE_OPCODE:
                (number,) = struct.unpack_from("<H", content, begin)
                self._mixed.setdefault(self._owner_variant(number), bytearray()).extend(
                    content[begin - RECORD_HEAD.size : end]
                )
        whole = sum(map(len, self._mixed.values())) > MOST_MIXED_BYTES
        self._write_mixed_chunks(
            [owner for owner, held in self._mixed.items() if whole or len(held) > MOST_STRETCH_BYTES]
        )

    def _write_mixed_chunks(self, owners: Iterable[int]) -> None:
        """Writes sorted messages of variants as the restored archive's chunks."""
        for owner in list(owners):
            content = bytes(self._mixed.pop(owner))
            try:
                self._append_chunk(pack_chunk(content, message_indexes(content), "zstd"), content)
            except BAD_BYTES_ERRORS:
                self._note_left_out(Opcode.CHUNK)

    def _append_chunk(self, chunk: PackedChunk, content: Any) -> None:
        """Appends a variant's chunk to the restored archive; raises if out of order."""
        result = self.result
        named = map(self._topics.variant_and_topic, chunk.indexes)
        states = {v[0]: number for v, number in zip(named, chunk.indexes, strict=True) if v and v[1] == "state"}
        found = {variant: _frame_numbers(content, chunk.indexes[number]) for variant, number in states.items()}
        for variant, sequence in found.items():
            due, stamp = result.next_frames.get(variant, (0, -1))
            first = int(chunk.indexes[states[variant]][0, 0])
            if not sequence.any() and due + len(sequence) > 1 and first > stamp:  # MCAP leaves them optional
                sequence += due + np.arange(len(sequence))
            if sequence[0] < due or (np.diff(sequence) <= 0).any():
                raise ValueError("its frames came before, or are out of order")  # a chunk that is there twice
        self._topics.copy_topics(self.file, chunk.indexes)
        self.file.add_chunk(chunk)
        result.chunks += bool(found)
        for variant, sequence in found.items():
            result.missing += int(sequence[-1]) + 1 - result.next_frames.get(variant, (0, -1))[0] - len(sequence)
            result.next_frames[variant] = int(sequence[-1]) + 1, int(chunk.indexes[states[variant]][-1, 0])
            result.frames[variant] = result.frames.get(variant, 0) + len(sequence)


def _trusted_index(path: Path) -> McapIndex | None:
    """Index of an MCAP file with right summary and digests, or None."""
    try:
        index = McapIndex(path)
    except ArchiveError:
        return None
    return index if index.has_checked_summary and untrusted_channel(index) is None else None


def _is_message_index(data: Any) -> bool:
    """Whether an MCAP record is a MessageIndex by its size."""
    return len(data) >= 6 and int.from_bytes(data[2:6], "little") == len(data) - 6 and len(data) % 16 == 6


def _frame_numbers(content: Any, index: NDArray[np.uint64]) -> NDArray[np.int64]:
    """Frame numbers (messages,) of an MCAP chunk's messages."""
    found = [struct.unpack_from("<I", content, int(at) + RECORD_HEAD_BYTES + 2)[0] for at in index[:, 1]]
    return np.array(found, dtype=np.int64)


def message_indexes(content: Any) -> dict[int, NDArray[np.uint64]]:
    """Log times [ns] and offsets (messages, 2) in an MCAP chunk, by channel."""
    found: dict[int, list[tuple[int, int]]] = {}
    for opcode, begin, _ in iterate_records(content):
        if opcode == MESSAGE_OPCODE:
            at = begin - RECORD_HEAD_BYTES
            channel, _, stamp = struct.unpack_from("<HIQ", content, begin)
            found.setdefault(channel, []).append((stamp, at))
    return {channel: np.array(index, dtype=np.uint64) for channel, index in found.items()}


def _whole_records(data: Any) -> Iterator[tuple[int, int, int]]:
    """Opcode, begin and end of MCAP records up to the first fault."""
    at = len(MCAP_MAGIC)
    while at + RECORD_HEAD.size <= len(data):
        opcode, length = RECORD_HEAD.unpack_from(data, at)
        end = at + RECORD_HEAD.size + length
        if opcode not in KNOWN_OPCODES or end > len(data):
            return
        yield opcode, at + RECORD_HEAD.size, end
        at = end


def _mapped_bytes(path: Path) -> memoryview:
    """Memory map of a broken archive file's bytes."""
    try:
        with open(open_regular_file(path), "rb") as file:
            return memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
    except ValueError:  # an empty file
        return memoryview(b"")
    except OSError as error:
        raise ArchiveError(f"{path}: cannot be read ({refusal_reason(error)})") from None
