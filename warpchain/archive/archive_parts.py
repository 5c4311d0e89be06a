"""Writing an archive's files: one, or a set split by size or number of variants."""

from __future__ import annotations

import platform
import uuid
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

from warpchain.archive import archive_format
from warpchain.archive.archive_names import ArchiveTarget
from warpchain.archive.chunk_layout import FrameContent
from warpchain.archive.mcap_write import McapWriter
from warpchain.archive.options import ArchiveOptions
from warpchain.drive import Drive, dumps_drive
from warpchain.errors import ArchiveError, warn_caller
from warpchain.results.arrow_tables import table_with_column
from warpchain.results.channels import CHANNEL_UNITS
from warpchain.results.run import RunInfo

if TYPE_CHECKING:
    import pyarrow as pa


class ArchivePart:
    """File of an archive, being written."""

    def __init__(self, file: McapWriter, start: Mapping[str, str], drives: bool) -> None:
        self.file, self.start, self._drives = file, start, drives
        self._variants: set[int] = set()

    def open_variant(
        self, variant: int, place: int, content: FrameContent, drive: Drive, facts: Mapping[str, str]
    ) -> None:
        """Begins a variant's topics in this archive file, once.

        `place`, of the variant in this file, numbers its channels; `facts` are metadata.
        """
        if variant in self._variants:
            return
        self._variants.add(variant)
        if not self._drives:
            attach_drives(self.file, {variant: drive})
        held = {
            "links": str(content.links),
            "channels": " ".join(content.channels),
            "units": ", ".join(CHANNEL_UNITS[name] for name in content.channels),
            "precision": content.precision,
            "values": content.values,
            **facts,
        }
        numbers = archive_format.channel_numbers(place)
        for topic in (*content.topics, "scene"):
            self.open_topic(numbers[topic], variant, topic, held if topic == "rollers" else {})

    def open_topic(self, number: int, variant: int, topic: str, metadata: Mapping[str, str]) -> None:
        """Begins a topic in this archive file, with its schema if new."""
        name = archive_format.TOPICS[topic]
        kind = 1 + list(archive_format.TOPICS).index(topic)
        encoding, data = archive_format.topic_schema(name)
        if not self.file.has_schema(kind):
            self.file.add_schema(kind, name, encoding, data)
        message = "cdr" if encoding == "ros2msg" else "protobuf"
        self.file.add_channel(number, kind, archive_format.topic_path(variant, topic), message, metadata)


def attach_drives(file: McapWriter, drives: Mapping[int, Drive]) -> None:
    """Appends variants' drive files, and copies, to an archive file."""
    texts = {variant: dumps_drive(drive).encode() for variant, drive in drives.items()}
    for name in (archive_format.drive_attachment_name, archive_format.drive_copy_name):
        for variant, text in texts.items():
            file.add_attachment(name(variant), "application/toml", text)


class ArchiveParts:
    """Files of an archive, being written; raises ArchiveError if refused."""

    def __init__(
        self,
        path: Path,
        drives: Sequence[Drive],
        recorded: Sequence[int],
        info: RunInfo,
        options: ArchiveOptions,
        overwrite: bool,
        salvage: bool,
    ) -> None:
        self._salvage, self._numbers = salvage, variant_numbers(options, drives)
        self._options, self._info = options, replace(info, seed=info.seed if options.seed is None else options.seed)
        self._per_part = options.split_variants or archive_format.MOST_VARIANTS
        split = options.split_size is not None or options.split_variants is not None
        if len(recorded) > archive_format.MOST_VARIANTS and options.split_variants is None:
            raise ArchiveError(
                f"{path}: {len(recorded)} recorded variants do not fit one file, which holds "
                f"{archive_format.MOST_VARIANTS}; split the archive by number of variants (split_variants)"
            )
        if self._per_part > archive_format.MOST_VARIANTS:
            raise ArchiveError(f"split_variants = {self._per_part}: allowed is up to {archive_format.MOST_VARIANTS}")
        self._start = {
            "format_version": archive_format.FORMAT_VERSION,
            "variants": str(len(drives)),
            "recorded": " ".join(str(self._numbers[variant]) for variant in recorded),
            **({} if options.numbers is None else {"numbers": " ".join(map(str, self._numbers))}),
            "set": uuid.uuid4().hex,
        }
        self._parts: list[ArchivePart] = []
        self._by_group: dict[int, ArchivePart] = {}
        self._target = ArchiveTarget(path, overwrite, split)
        try:
            first = self._begin_part()
            attach_drives(first.file, dict(zip(self._numbers, drives, strict=True)))
            for name, data in options.attachments.items():
                first.file.add_attachment(name, media_type(name), data)
        except BaseException:
            self.close_unfinished()
            raise

    def _begin_part(self) -> ArchivePart:
        """Begins the archive's next file."""
        number = len(self._parts)
        start = self._start | {"part": str(number)} | _run_metadata(self._info)
        part = ArchivePart(
            self._target.begin_file(number, f"warpchain {self._info.version}"), start, drives=number == 0
        )
        self._parts.append(part)
        part.file.add_metadata(archive_format.RUN_METADATA, part.start)
        return part

    def place_in_part(self, position: int) -> int:
        """Place of a recorded variant in its archive file."""
        return position % self._per_part

    def part_for_chunk(self, position: int) -> ArchivePart:
        """Archive file for the next chunk of the variant at a position."""
        limit = self._options.split_size
        if limit is not None:
            current = self._parts[-1]
            if current.file.bytes_written >= limit and current.file.chunks_written:
                self._finish_part(current, {"ended": "continued"})
                current = self._begin_part()
            return current
        group = position // self._per_part
        if group not in self._by_group:
            self._by_group[group] = self._begin_part() if self._by_group else self._parts[0]
        return self._by_group[group]

    def _finish_part(self, part: ArchivePart, end: Mapping[str, str]) -> None:
        """Ends an archive's file with its metadata."""
        part.file.add_metadata(archive_format.END_METADATA, archive_format.end_with_start_copy(end, part.start))
        part.file.finish_file()

    def finish_archive(self, metrics: pa.Table, info: RunInfo) -> None:
        """Ends the archive's files, with metrics and the run's end."""
        self._target.check_free()
        last = self._parts[-1]
        for part in self._parts[:-1]:
            if not part.file.is_finished:
                self._finish_part(part, {"ended": "continued"})
        if self._options.numbers is not None:
            metrics = table_with_column(metrics, "variant", self._numbers)
        last.file.add_attachment(
            archive_format.METRICS_ATTACHMENT, media_type(archive_format.METRICS_ATTACHMENT), _arrow_bytes(metrics)
        )
        end = {"ended": info.ended, "wall_time": repr(float(info.wall_time)), "parts": str(len(self._parts))}
        self._finish_part(last, end)
        self._target.remove_replaced([part.file.path for part in self._parts])
        self._target.release_lock()

    def _unfinished_files(self) -> list[McapWriter]:
        """Unfinished files of the archive worth keeping."""
        return [
            part.file
            for part in self._parts
            if self._salvage and part.file.chunks_written and not part.file.is_finished
        ]

    def _kept_files_text(self) -> str:
        """Text on an unfinished archive's kept files, or ""."""
        whole = [part.file.path for part in self._parts if self._salvage and part.file.is_finished]
        words = [str(file.partial_path) for file in self._unfinished_files()]
        if whole:
            files = f"{len(whole)} whole files, {whole[0]} to {whole[-1].name}"
            words.insert(0, files if len(whole) > 1 else f"the whole file {whole[0]}")
        return f"what was written until then is in {', '.join(words)}: see warpchain recover" if words else ""

    def refusal_error(self, error: ArchiveError) -> ArchiveError:
        """Error of a disk that refuses, naming the archive's kept files."""
        kept = self._kept_files_text()
        return ArchiveError(f"{error}; {kept}") if kept else error

    def close_unfinished(self, named: bool = False) -> None:
        """Drops the archive's unfinished files, or with `salvage` keeps those with frames.

        A warning names these, unless an error has `named` them.
        """
        left, kept = self._unfinished_files(), self._kept_files_text()
        for part in self._parts:
            if not part.file.is_finished:
                part.file.close_unfinished(keep=part.file in left)
        if not self._parts or not self._parts[-1].file.is_finished:
            if not self._salvage:
                self._target.discard_files(part.file.path for part in self._parts if part.file.is_finished)
            if kept and not named:
                warn_caller(f"{self._target.path}: was not finished; {kept}")
        self._target.release_lock()


def media_type(name: str) -> str:
    """Media type of an archive's attachment, by name."""
    kinds = {
        ".arrow": "application/vnd.apache.arrow.file",
        ".parquet": "application/vnd.apache.parquet",
        ".toml": "application/toml",
        ".csv": "text/csv",
        ".json": "application/json",
    }
    return kinds.get(Path(name).suffix, "application/octet-stream")


def _run_metadata(info: RunInfo) -> dict[str, str]:
    """Provenance of a run as an archive's metadata."""
    made = {k: v for k, v in asdict(info).items() if k not in ("ended", "wall_time") and v is not None}
    texts = {name: repr(value) if isinstance(value, float) else str(value) for name, value in made.items()}
    versions = [f"{name} {version(name)}" for name in ("warp-lang", "numpy", "mcap", "protobuf")]
    return texts | {"versions": ", ".join([f"python {platform.python_version()}", *versions])}


def variant_numbers(options: ArchiveOptions, drives: Sequence[Drive]) -> Sequence[int]:
    """Numbers of an archive's variants; raises ArchiveError for a wrong count."""
    if options.numbers is None:
        return range(len(drives))
    if len(options.numbers) != len(drives):
        raise ArchiveError(f"numbers: there are {len(options.numbers)} for {len(drives)} variants; give one each")
    return options.numbers


def _arrow_bytes(table: pa.Table) -> bytes:
    """Arrow IPC bytes of a metrics table."""
    import pyarrow as pa

    sink = pa.BufferOutputStream()
    with pa.ipc.new_file(sink, table.schema) as file:
        file.write_table(table)
    return bytes(sink.getvalue())
