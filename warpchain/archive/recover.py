"""Restores an archive that was cut or damaged: everything that can be trusted, in a new file that is whole.

Where the summary at the broken file's end is complete, and right by its checksum, it says where everything lies, and
what channels and schemas are; a record that is not there as it says is left out. Another file is read record by record
from its beginning, and channels and metadata go by their digests (`archive.digest`). Whole chunks are copied as they
are, once their checksum is found right; messages that another program mixed are sorted by variant. The result is read
back before it has its name. What is left out, or cannot be read, is counted and named.
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
from warpchain.archive.chunk_layout import LENGTH_STARTS, MESSAGE
from warpchain.archive.digest import checked
from warpchain.archive.file_set import PartName, Target, cut_files, editions, is_whole, of_cut, part_name
from warpchain.archive.mcap_read import (
    RECORD,
    STRETCH,
    Content,
    McapIndex,
    attachment_of,
    decompressed,
    is_data_crc,
    records,
    stretches,
)
from warpchain.archive.mcap_write import MAGIC, Chunk, McapFile, make_chunk
from warpchain.archive.read import RECOVERED, metrics_of, numbers_of, open_files
from warpchain.archive.trust import Topics, untrue
from warpchain.errors import ArchiveError
from warpchain.files import open_regular_file, refusal_reason

KNOWN = frozenset(Opcode)
"""Opcodes of MCAP; another one means that the bytes are not records any more."""
DESCRIBED = (Opcode.METADATA, Opcode.SCHEMA, Opcode.CHANNEL)
"""Records that are taken before all others: they describe them."""
MOST_MIXED = 2**26
"""Bytes of messages that are held while they are sorted by variant, at most."""
BAD = (ValueError, OverflowError, struct.error, IndexError, KeyError)
"""Errors that bytes raise which are not what they should be."""


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
        unreadable: the variants that the run recorded and that cannot be read, each with the reason.
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
    unreadable: dict[int, str] = field(default_factory=dict)
    lost: int = 0
    name: str = field(default="", repr=False)
    following: dict[int, tuple[int, int]] = field(default_factory=dict, repr=False)

    @property
    def complete(self) -> bool:
        """Whether nothing was left out but what a cut had not let come into being."""
        return not (self.damaged or self.missing or self.left_out or self.unreadable)

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
            words += f"; left out as damaged or missing: {_some(self.left_out)}"
        if self.unreadable:
            lost = [f"variant {variant} ({why})" for variant, why in sorted(self.unreadable.items())]
            words += f"; lost: {_some(lost)}"
        return words + (f"; {self.lost} bytes after the last whole record lost" if self.lost else "")


def _some(words: Sequence[str]) -> str:
    """The first of some words, in a line."""
    return ", ".join(words[:8]) + (", ..." if len(words) > 8 else "")


def recover_archive(broken: str | Path, output: str | Path, overwrite: bool = False) -> Recovered:
    """Restores a broken archive.

    Args:
        broken: the file; of a split archive, its name: all of its files are restored, as a set of the same kind.
        output: the archive to write; it appears under this name only when whole.
        overwrite: replace an archive of that name.

    Returns:
        What was restored and what was lost.

    Raises:
        ArchiveError: a file that is not an archive of warpchain or holds nothing that can be restored and then read, or
            a folder or disk that refuses.
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
        _read_back(copies, result)
        if not any(result.frames.values()):
            why = next(iter(result.unreadable.values()), "no frame is whole")
            raise ArchiveError(f"{source}: no variant of it can be read ({why}); nothing can be restored")
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


def _read_back(copies: Sequence[_Copy], result: Recovered) -> None:
    """Reads what was restored, as any reader will, and notes which variants cannot be read, and how many frames can."""
    with ExitStack() as drafts:
        paths = [drafts.enter_context(copy.draft(len(copies))) for copy in copies]
        try:
            back = open_files(result.path, tuple(map(McapIndex, paths)))
            recorded = set(back)
        except ArchiveError as error:
            raise ArchiveError(f"{copies[0].path}: cannot be restored ({_reason(error, paths)})") from None
        held = {name for file in back.trajectories.files for name in file.attachments}
        copies[-1].check_metrics(held)
        for variant in back.numbers:
            if held.isdisjoint((archive_format.drive_attachment(variant), archive_format.drive_copy(variant))):
                result.unreadable[variant] = f"lacks its attachment {archive_format.drive_attachment(variant)}"
        for variant in sorted((result.frames.keys() | copies[-1].due()) - result.unreadable.keys()):
            try:
                if variant not in recorded:
                    raise ArchiveError("lacks its frames")
                count = sum(len(block.time) for block in back.blocks(variant))
                result.missing += result.frames[variant] - count
                result.frames[variant] = count
            except ArchiveError as error:
                result.unreadable[variant] = _reason(error, paths)
        result.frames = {variant: count for variant, count in result.frames.items() if variant not in result.unreadable}


def _reason(error: ArchiveError, paths: Sequence[Path]) -> str:
    """An error's message without the temporary files' names, and without the advice to recover them."""
    text = str(error).removesuffix("; see warpchain recover")
    for path in paths:
        text = text.replace(f"{path}: ", "")
    return text


class _Copy:
    """Copies what can be trusted of one file into another."""

    def __init__(self, path: Path, file: McapFile, result: Recovered, number: int) -> None:
        self.path, self.file, self.result, self.number = path, file, result, number
        self._head: dict[str, str] | None = None
        self._old_end: dict[str, str] = {}
        self._held: dict[str, bytes] = {}
        self._topics = Topics()
        self._mixed: dict[int, bytearray] = {}

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
        self._write_mixed(self._mixed)
        return self.file.chunks > 0

    def _follow(self, data: Any, index: McapIndex) -> None:
        """Copies what a right summary lists, in the file's order."""
        self._topics = Topics(index)
        places = [(entry.offset, entry.length, Opcode.CHUNK, "") for entry in index.chunks]
        places += [(*at, Opcode.ATTACHMENT, name) for name, at in index.attachments.items()]
        places += [(*at, Opcode.METADATA, name) for name, at in index.metadata.items()]
        for offset, length, opcode, name in sorted(places, key=lambda place: (place[2] != Opcode.METADATA, place[0])):
            end = min(offset + length, len(data))
            found = RECORD.unpack_from(data, offset) if offset + RECORD.size <= end else None
            if found != (opcode, length - RECORD.size):
                self._leave_out(opcode, name)
            else:
                self._take(opcode, data[offset + RECORD.size : end], name)

    def _walk(self, data: Any) -> None:
        """Copies what is whole, record by record, once it is known what channels there are."""
        loose = self._survey(data)
        at = len(MAGIC)
        for opcode, begin, end in stretches(_whole(data)):
            if opcode == Opcode.DATA_END and end - begin == 4:
                at = len(data)
                break
            if opcode == Opcode.MESSAGE_INDEX:
                if not _is_index(data[begin:end]):
                    self._leave_out(Opcode.CHUNK)
            elif opcode in (Opcode.ATTACHMENT, Opcode.CHUNK) or (opcode == Opcode.MESSAGE and loose):
                self._take(opcode, data[begin:end])
            elif opcode not in DESCRIBED and not (opcode == Opcode.HEADER and at == len(MAGIC)):
                self._leave_out(opcode)
            at = end
        self.result.lost += max(0, len(data) - at)

    def _survey(self, data: Any) -> bool:
        """Takes metadata, channels and schemas; returns whether messages outside of chunks can be trusted."""
        used: set[int] = set()
        loose, right = False, True
        for opcode, begin, end in _whole(data):
            if opcode == Opcode.DATA_END and end - begin == 4:
                (crc,) = struct.unpack_from("<I", data, begin)
                right = not loose or is_data_crc(data[: begin - RECORD.size], crc)
                break
            if opcode in DESCRIBED:
                self._take(opcode, data[begin:end])
            elif opcode == Opcode.MESSAGE and end - begin >= 2:
                loose = True
                used.add(int.from_bytes(data[begin : begin + 2], "little"))
            elif opcode == Opcode.CHUNK:
                with suppress(*BAD):  # it is counted when it is copied
                    content = decompressed(kinds.Chunk.read(Content(data[begin:end])))
                    for inner, start, stop in records(content):
                        if inner in DESCRIBED:
                            self._take(inner, bytes(content[start:stop]))
                        elif inner == Opcode.MESSAGE:
                            used.add(int.from_bytes(content[start : start + 2], "little"))
        if self._topics.settle(self._head or {}, used):
            self._leave_out(Opcode.CHANNEL)
        return right

    def _leave_out(self, opcode: int, name: str = "") -> None:
        """Notes that a record was left out."""
        if opcode == Opcode.CHUNK:
            self.result.damaged += 1
        else:
            kind = {Opcode.ATTACHMENT: "attachment", Opcode.METADATA: "metadata", Opcode.MESSAGE: "messages"}
            what = kind.get(opcode, "a record")  # type: ignore[call-overload]
            self.result.leave_out(f"{what} {name}".strip())

    def require(self) -> None:
        """Refuses a file that says nothing of a run."""
        if self._head is None:
            raise ArchiveError(
                f"{self.path}: is not an archive of warpchain, or was cut before its first record, or that is damaged"
            )

    def due(self) -> set[int]:
        """Variants that the run recorded, all of which a run that reached its end has written."""
        recorded = (self._head or {}).get("recorded", "") if self._old_end.get("ended") == "complete" else ""
        return {int(word) for word in recorded.split() if word.isdigit()}

    def check_metrics(self, held: set[str]) -> None:
        """Notes that the metrics, which a run that ended has written, are not there."""
        if self._old_end.get("ended") in ("complete", "interrupted") and archive_format.METRICS_ATTACHMENT not in held:
            self._leave_out(Opcode.ATTACHMENT, archive_format.METRICS_ATTACHMENT)

    def draft(self, parts: int) -> AbstractContextManager[Path]:
        """The file while it is whole, to be read back."""
        return self.file.draft(archive_format.END_METADATA, self._end(parts))

    def finish(self, parts: int) -> None:
        """Ends the file."""
        self.file.metadata(archive_format.END_METADATA, self._end(parts))
        self.file.finish()

    def _end(self, parts: int) -> dict[str, str]:
        """Metadata of how the archive ended."""
        assert self._head is not None  # as required
        wall_time = self._old_end.get("wall_time", "0.0")
        ended = {"ended": RECOVERED, "wall_time": wall_time, "lost_bytes": str(self.result.lost)}
        ended["damaged_chunks"] = str(self.result.damaged)
        if self.number == parts - 1:
            ended["parts"] = str(parts)
        if self.result.missing:
            ended["missing_frames"] = str(self.result.missing)
        if self.result.left_out:
            ended["left_out"] = ", ".join(self.result.left_out)
        if self.result.unreadable:
            ended["unreadable"] = " ".join(map(str, sorted(self.result.unreadable)))
        return archive_format.with_head(ended, self._head)

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
                self._topics.add(kinds.Channel.read(Content(data)))
            elif opcode == Opcode.CHUNK:
                self._take_chunk(kinds.Chunk.read(Content(data)))
            elif opcode == Opcode.MESSAGE:
                self._take_mixed(data, message_index(data))
        except BAD:
            self._leave_out(opcode, name)

    def _take_attachment(self, name: str, attached: kinds.Attachment) -> None:
        if attached.name != name or self._held.setdefault(name, attached.data) != attached.data:
            raise ValueError("another one of this name")
        if name == archive_format.METRICS_ATTACHMENT:
            metrics_of(bytes(attached.data), numbers_of(self._head or {}))
        self.file.attachment(name, attached.media_type, attached.data)

    def _take_metadata(self, name: str, values: dict[str, str]) -> None:
        if name == archive_format.RUN_METADATA:
            self._take_head(values)
        elif name == archive_format.END_METADATA:
            self._old_end = {"ended": values.get("ended", ""), "wall_time": repr(float(values.get("wall_time", "0.0")))}
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

    def _owner(self, number: int) -> int:
        """The variant that a channel belongs to, -1 for another program's."""
        named = self._topics.variant_of(number)
        return named[0] if named else -1

    def _take_chunk(self, chunk: kinds.Chunk) -> None:
        content = decompressed(chunk)
        indexes = message_index(content)
        if len(set(map(self._owner, indexes))) > 1:
            self._take_mixed(content, indexes)
            return
        self._write_mixed(self._mixed)  # they came before it
        size, crc = chunk.uncompressed_size, chunk.uncompressed_crc
        start, end = chunk.message_start_time, chunk.message_end_time
        self._copy(Chunk(chunk.compression, chunk.data, size, crc, start, end, indexes), content)

    def _take_mixed(self, content: Any, indexes: Iterable[int]) -> None:
        """Sorts messages that another program mixed by variant, for chunks as warpchain has them."""
        if not all(map(self._topics.is_known, indexes)):
            raise ValueError("a topic is not described")
        for opcode, begin, end in records(content):
            if opcode == MESSAGE:
                (number,) = struct.unpack_from("<H", content, begin)
                self._mixed.setdefault(self._owner(number), bytearray()).extend(content[begin - RECORD.size : end])
        whole = sum(map(len, self._mixed.values())) > MOST_MIXED
        self._write_mixed([owner for owner, held in self._mixed.items() if whole or len(held) > STRETCH])

    def _write_mixed(self, owners: Iterable[int]) -> None:
        """Writes what was sorted of some variants."""
        for owner in list(owners):
            content = bytes(self._mixed.pop(owner))
            try:
                self._copy(make_chunk(content, message_index(content), "zstd"), content)
            except BAD:
                self._leave_out(Opcode.CHUNK)

    def _copy(self, chunk: Chunk, content: Any) -> None:
        """Appends a chunk of one variant.

        Raises:
            ValueError: its frames came before or are out of order, or a topic of it is not described.
        """
        result = self.result
        named = map(self._topics.variant_of, chunk.indexes)
        states = {v[0]: number for v, number in zip(named, chunk.indexes, strict=True) if v and v[1] == "state"}
        found = {variant: _sequence(content, chunk.indexes[number]) for variant, number in states.items()}
        for variant, sequence in found.items():
            due, stamp = result.following.get(variant, (0, -1))
            first = int(chunk.indexes[states[variant]][0, 0])
            if not sequence.any() and due + len(sequence) > 1 and first > stamp:  # MCAP leaves them optional
                sequence += due + np.arange(len(sequence))
            if sequence[0] < due or (np.diff(sequence) <= 0).any():
                raise ValueError("its frames came before, or are out of order")  # a chunk that is there twice
        self._topics.open(self.file, chunk.indexes)
        self.file.chunk(chunk)
        result.chunks += bool(found)
        for variant, sequence in found.items():
            result.missing += int(sequence[-1]) + 1 - result.following.get(variant, (0, -1))[0] - len(sequence)
            result.following[variant] = int(sequence[-1]) + 1, int(chunk.indexes[states[variant]][-1, 0])
            result.frames[variant] = result.frames.get(variant, 0) + len(sequence)


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


def _sequence(content: Any, index: NDArray[np.uint64]) -> NDArray[np.int64]:
    """Numbers of frames, from the messages of a chunk that an index lists."""
    found = [struct.unpack_from("<I", content, int(at) + LENGTH_STARTS + 2)[0] for at in index[:, 1]]
    return np.array(found, dtype=np.int64)


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
        with open(open_regular_file(path), "rb") as file:
            return memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
    except ValueError:  # an empty file
        return memoryview(b"")
    except OSError as error:
        raise ArchiveError(f"{path}: cannot be read ({refusal_reason(error)})") from None
