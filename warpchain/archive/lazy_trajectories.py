"""Drives and recorded trajectories in an archive's files, read when asked for."""

from __future__ import annotations

import weakref
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, overload

import numpy as np
from mcap.records import Channel

from warpchain.archive import archive_format
from warpchain.archive.channel_trust import untrusted_channel
from warpchain.archive.chunk_layout import (
    MESSAGE_HEADER,
    MESSAGE_OPCODE,
    RECORD_HEAD_BYTES,
    ChunkLayout,
    FrameContent,
    layout_of_content,
)
from warpchain.archive.mcap_read import ChunkEntry, McapIndex, convert_read_errors, iterate_records
from warpchain.drive import Drive, loads_drive
from warpchain.errors import ArchiveError, DriveError
from warpchain.results.channels import CHANNEL_NAMES
from warpchain.results.run import Trajectory

READ_TOPICS = ("rollers", "state", "positions")
"""Topics that are read; others repeat them for viewers."""
RECOVER_ADVICE = "see warpchain recover"
PRECISIONS = ("float64", "float32")


class LazyDrives(Sequence[Drive]):
    """Drives of an archived run, each read when asked for.

    `numbers` are the archive's of the variants; with `gaps` a drive may be missing.
    """

    def __init__(self, files: Sequence[McapIndex], numbers: Sequence[int], gaps: bool = False) -> None:
        self._files, self.numbers, self._count = files, numbers, len(numbers)
        self._held: dict[int, Drive] = {}
        for variant in () if gaps else numbers:
            name = archive_format.drive_attachment_name(variant)
            if files[0].attachments.keys().isdisjoint((name, archive_format.drive_copy_name(variant))):
                raise ArchiveError(f"{files[0].path}: lacks its attachment {name}")

    def __len__(self) -> int:
        return self._count

    @overload
    def __getitem__(self, index: int) -> Drive: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Drive, ...]: ...
    def __getitem__(self, index: int | slice) -> Drive | tuple[Drive, ...]:
        if isinstance(index, slice):
            return tuple(self[k] for k in range(*index.indices(self._count)))
        place = index + self._count if index < 0 else index
        if not 0 <= place < self._count:
            raise IndexError(f"drive {index} of {self._count}")
        return self.drive_of(self.numbers[place])

    def drive_of(self, variant: int) -> Drive:
        """Drive of an archived variant, from the copy if damaged."""
        if variant not in self._held:
            try:
                self._held[variant] = self._read_drive(archive_format.drive_attachment_name(variant))
            except ArchiveError:
                copy = archive_format.drive_copy_name(variant)
                if not any(copy in file.attachments for file in self._files):
                    raise
                self._held[variant] = self._read_drive(copy)
        return self._held[variant]

    def _read_drive(self, name: str) -> Drive:
        """Drive in an archive's attachment."""
        file = next((file for file in self._files if name in file.attachments), self._files[0])
        try:
            return loads_drive(file.read_attachment(name).decode(), f"{file.path}: {name}")
        except (DriveError, UnicodeDecodeError) as error:
            raise ArchiveError(f"{file.path}: a drive of it cannot be read ({error})") from None

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sequence) and tuple(self) == tuple(other)

    __hash__ = None  # type: ignore[assignment]


@dataclass(frozen=True)
class VariantChunks:
    """Topics and chunks of a variant in an archive file."""

    file: McapIndex
    rollers: Channel
    numbers: Mapping[str, int]
    chunks: list[ChunkEntry] = field(default_factory=list)


class ArchiveTrajectories(Mapping[int, Trajectory]):
    """Trajectories of an archive, each read when asked for; with `gaps` frames may be missing."""

    def __init__(self, files: tuple[McapIndex, ...], drives: LazyDrives, gaps: bool) -> None:
        self.files, self._drives, self._gaps = files, drives, gaps
        self._held: weakref.WeakValueDictionary[int, Trajectory] = weakref.WeakValueDictionary()
        self._last: Trajectory | None = None

    def __reduce__(self) -> tuple[Any, ...]:
        return ArchiveTrajectories, (self.files, self._drives, self._gaps)

    @cached_property
    def _chunks_by_variant(self) -> dict[int, list[VariantChunks]]:
        """Chunks of each variant in archive files; raises for untrusted channels."""
        found: dict[int, list[VariantChunks]] = {}
        for file in self.files:
            wrong = untrusted_channel(file)
            if wrong is not None:
                raise ArchiveError(f"{file.path}: is damaged ({wrong.topic}: its digest is wrong); {RECOVER_ADVICE}")
            numbers: dict[int, dict[str, int]] = {}
            for channel in file.channels.values():
                named = archive_format.variant_and_topic(channel.topic)
                if named:
                    topics = numbers.setdefault(named[0], {})
                    if topics.setdefault(named[1], channel.id) != channel.id:
                        raise ArchiveError(f"{file.path}: has two channels {channel.topic}; {RECOVER_ADVICE}")
            here: dict[int, VariantChunks] = {}
            known = set(self._drives.numbers)
            for variant, topics in numbers.items():
                if variant not in known:
                    raise ArchiveError(f"{file.path}: has frames of variant {variant} of {len(self._drives)}")
                if "rollers" in topics and "state" in topics:
                    place = VariantChunks(file, file.channels[topics["rollers"]], topics)
                    here |= {topics[topic]: place for topic in READ_TOPICS if topic in topics}
                    found.setdefault(variant, []).append(place)
            for chunk in file.chunks:
                for place in {id(here[n]): here[n] for n in chunk.channels if n in here}.values():
                    place.chunks.append(chunk)
        held = {variant: [place for place in places if place.chunks] for variant, places in found.items()}
        return {variant: held[variant] for variant in sorted(held) if held[variant]}

    @property
    def numbers(self) -> Sequence[int]:
        """Numbers of the archive's variants, recorded or not."""
        return self._drives.numbers

    def __contains__(self, variant: object) -> bool:
        return variant in self._chunks_by_variant

    def __iter__(self) -> Iterator[int]:
        return iter(self._chunks_by_variant)

    def __len__(self) -> int:
        return len(self._chunks_by_variant)

    def __getitem__(self, variant: int) -> Trajectory:
        held = self._held.get(variant)
        if held is None:
            held = self._held[variant] = self.read_trajectory(variant)
        self._last = held
        return held

    def chunk_layout(self, variant: int) -> ChunkLayout:
        """Byte layout of an archived variant's frames."""
        place = self._chunks_by_variant[variant][0]
        facts, drive = place.rollers.metadata, self._drives.drive_of(variant)
        try:
            channels, precision, values = facts["channels"].split(), facts["precision"], facts["values"]
        except KeyError as missing:
            raise ArchiveError(f"{place.file.path}: {place.rollers.topic} lacks its metadata {missing}") from None
        known = set(channels) <= set(CHANNEL_NAMES) and len(set(channels)) == len(channels)
        if not known or precision not in PRECISIONS or values not in PRECISIONS:
            raise ArchiveError(f"{place.file.path}: {place.rollers.topic} has wrong metadata; see warpchain recover")
        exact = "positions" in place.numbers
        return layout_of_content(FrameContent.from_drive(drive, tuple(channels), precision, values, exact, variant))

    def read_trajectory(
        self,
        variant: int,
        start: float | None = None,
        end: float | None = None,
        channels: Sequence[str] = CHANNEL_NAMES,
    ) -> Trajectory:
        """Part of an archived variant's trajectory, in its own arrays."""
        held: dict[str, list[Any]] = {}
        for block in self.iterate_blocks(variant, start, end, channels):
            for name, values in (("time", block.time), *block.channels().items()):
                held.setdefault(name, []).append(values)
        content = self.chunk_layout(variant).content
        joined = {"time": _concatenate_blocks(held.get("time", []), "float64", ())}
        for name in content.channels:
            if name in channels:
                joined[name] = _concatenate_blocks(
                    held.get(name, []), content.channel_type(name), content.channel_shape(name)
                )
        return Trajectory(self._drives.drive_of(variant), **joined)

    def iterate_blocks(
        self,
        variant: int,
        start: float | None = None,
        end: float | None = None,
        channels: Sequence[str] = CHANNEL_NAMES,
    ) -> Iterator[Trajectory]:
        """Parts of an archived variant's trajectory, views of one chunk each."""
        layout, drive = self.chunk_layout(variant), self._drives.drive_of(variant)
        low = 0 if start is None else max(0, int(start * 1e9) - 1)
        high = 2**63 if end is None else max(0, int(end * 1e9) + 2)
        following = 0 if start is None else None
        for frames in self._iterate_frames(variant, layout, low, high):
            sequence = frames["state"]["head"]["sequence"].astype(np.int64)
            first = sequence[0] if following is None else following
            if not self._gaps and not np.array_equal(sequence, first + np.arange(len(sequence))):
                path = self._chunks_by_variant[variant][0].file.path
                raise ArchiveError(f"{path}: variant {variant} lacks frames after {first}; see warpchain recover")
            following = int(sequence[-1]) + 1
            held = layout.channel_views(frames)
            time = held.pop("time")
            inside = np.flatnonzero(
                (time >= (-np.inf if start is None else start)) & (time <= (np.inf if end is None else end))
            )
            if len(inside):
                part = slice(inside[0], inside[-1] + 1)
                yield Trajectory(drive, time[part], **{n: v[part] for n, v in held.items() if n in channels})

    def _iterate_frames(self, variant: int, layout: ChunkLayout, low: int, high: int) -> Iterator[Any]:
        """Frames of an archive's chunks between log times [ns]."""
        last = np.zeros(0, dtype=MESSAGE_HEADER)
        for place in self._chunks_by_variant[variant]:
            chosen = [chunk for chunk in place.chunks if chunk.end >= low and chunk.start <= high]
            for k, chunk in enumerate(chosen):
                frames = _frames_from_chunk(place.file.read_chunk(chunk), layout, place.numbers)
                if frames is None:  # another program has written the chunks anew
                    rest = map(place.file.read_chunk, chosen[k:])
                    with convert_read_errors(place.file.path):
                        frames = _frames_from_mixed_chunks(rest, layout, place.numbers, low, high, self._gaps)
                    chosen = []
                if len(frames):
                    frames = _numbered_frames(frames, last)
                    last = frames["state"]["head"][-1:].copy()
                    yield frames
                if not chosen:
                    break


def _concatenate_blocks(parts: Sequence[Any], kind: str, shape: tuple[int, ...]) -> Any:
    """Blocks of an archive's frames as one array."""
    out = np.empty((sum(len(part) for part in parts), *shape), dtype=kind)
    at = 0
    for part in parts:
        out[at : at + len(part)] = part
        at += len(part)
    return out


def _numbered_frames(frames: Any, last: Any) -> Any:
    """Archived frames whose `sequence` is counted on from `last` where zero."""
    head = frames["state"]["head"]
    if head["sequence"].any() or len(last) + len(head) == 1 or (last["log_time"] >= head["log_time"][:1]).any():
        return frames
    frames = frames.copy()
    frames["state"]["head"]["sequence"] = np.arange(len(head)) + (last["sequence"] + 1 if len(last) else 0)
    return frames


def _frames_from_chunk(data: Any, layout: ChunkLayout, numbers: Mapping[str, int]) -> Any:
    """Frames of an archive's chunk as a view, or None if mixed."""
    if len(data) % layout.frame_bytes or not set(layout.content.topics) <= set(numbers):
        return None
    frames = np.frombuffer(data, dtype=layout.dtype)
    for topic in layout.content.topics:
        head, message = frames[topic]["head"], layout.dtype[topic]
        length = message.itemsize - RECORD_HEAD_BYTES
        right = (head["opcode"] == MESSAGE_OPCODE) & (head["length"] == length) & (head["channel"] == numbers[topic])
        if not right.all():
            return None
    return frames


def _frames_from_mixed_chunks(
    chunks: Iterable[Any], layout: ChunkLayout, numbers: Mapping[str, int], low: int, high: int, gaps: bool
) -> Any:
    """Frames of archive chunks in which another program mixed topics and variants.

    With `gaps` a frame that lacks a message is left out, else it raises ValueError, as other faults do.
    """
    topics = [topic for topic in layout.content.topics if topic in READ_TOPICS]
    found: dict[int, dict[int, bytes]] = {numbers[topic]: {} for topic in topics}
    for data in chunks:
        for opcode, begin, end in iterate_records(data):
            if opcode == MESSAGE_OPCODE:
                head = np.frombuffer(data, MESSAGE_HEADER, 1, begin - RECORD_HEAD_BYTES)[0]
                if head["channel"] in found and low <= head["log_time"] <= high:
                    message = bytes(data[begin - RECORD_HEAD_BYTES : end])
                    if found[head["channel"]].setdefault(int(head["log_time"]), message) != message:
                        raise ValueError(f"there are two messages of a topic at {head['log_time']} ns")
    stamps = set.intersection(*map(set, found.values()))
    if not gaps and any(len(messages) > len(stamps) for messages in found.values()):
        raise ValueError("its topics have unlike frames")
    frames = np.zeros(len(stamps), dtype=layout.dtype)
    for topic in topics:
        size, messages = layout.dtype[topic].itemsize, [found[numbers[topic]][stamp] for stamp in sorted(stamps)]
        if any(len(data) != size for data in messages):
            raise ValueError(f"messages of {topic} are not as warpchain writes them")
        frames[topic] = np.frombuffer(b"".join(messages), dtype=layout.dtype[topic])
    return frames
