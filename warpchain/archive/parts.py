"""The files of an archive: one, or a set that is split by size or by number of variants."""

from __future__ import annotations

import platform
import re
import uuid
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

from warpchain.archive import schema
from warpchain.archive.layout import Form
from warpchain.archive.mcap_write import McapFile, taken
from warpchain.archive.options import ArchiveOptions
from warpchain.drive import Drive, dumps_drive
from warpchain.errors import ArchiveError
from warpchain.files import refusals
from warpchain.results.run import RunInfo

if TYPE_CHECKING:
    import pyarrow as pa

PART = re.compile(r"(.*)\.part(\d{4,})")
"""Stem of a part's name: the archive's stem and the part's number."""


def part_path(path: Path, number: int) -> Path:
    """Name of a part: `run.mcap`, 3 -> `run.part0003.mcap`."""
    return path.with_name(f"{path.stem}.part{number:04d}{path.suffix}")


def part_files(path: Path) -> list[Path]:
    """Files of the set that `path` names, in order; empty if there are none."""
    if not path.parent.is_dir():
        return []
    found = {}
    for file in path.parent.iterdir():
        named = PART.fullmatch(file.stem)
        if named and named[1] == path.stem and file.suffix == path.suffix:
            found[int(named[2])] = file
    return [found[number] for number in sorted(found)]


def cut_files(path: Path) -> list[Path]:
    """Unfinished files that a killed run left of the archive that `path` names."""
    if not path.parent.is_dir():
        return []
    left = re.compile(rf"{re.escape(path.stem)}(\.part\d+)?{re.escape(path.suffix)}\.\d+\.partial")
    return sorted(file for file in path.parent.iterdir() if left.fullmatch(file.name))


def archive_files(path: Path) -> list[Path]:
    """Files of the archive that `path` names: the file itself, or the set that it names or is a part of."""
    named = PART.fullmatch(path.stem)
    if named and path.is_file():
        return part_files(path.with_name(named[1] + path.suffix))
    return [path] if path.is_file() else part_files(path) or [path]


class Part:
    """One file of an archive, being written."""

    def __init__(self, file: McapFile, drives: bool) -> None:
        self.file, self._drives = file, drives
        self._variants: set[int] = set()

    def open_variant(self, variant: int, place: int, form: Form, drive: Drive, facts: Mapping[str, str]) -> None:
        """Begins a variant's topics in this file, if that has not been done.

        Args:
            place: the variant's place in this file, which numbers its channels.
            form: the layout of its frames.
            drive: the variant's drive.
            facts: what else a reader should know, for the channel's metadata.
        """
        if variant in self._variants:
            return
        self._variants.add(variant)
        if not self._drives:
            attach_drive(self.file, variant, drive)
        held = {
            "links": str(form.links),
            "channels": " ".join(form.channels),
            "precision": form.precision,
            "values": form.values,
            **facts,
        }
        numbers = schema.channel_numbers(place)
        for topic in (*form.topics, "scene"):
            self.open_topic(numbers[topic], variant, topic, held if topic == "rollers" else {})

    def open_topic(self, number: int, variant: int, topic: str, metadata: Mapping[str, str]) -> None:
        """Begins a topic, and describes its messages if they are new to this file."""
        name = schema.TOPICS[topic]
        kind = 1 + list(schema.TOPICS).index(topic)
        encoding, data = schema.schema_of(name)
        if not self.file.has_schema(kind):
            self.file.schema(kind, name, encoding, data)
        message = "cdr" if encoding == "ros2msg" else "protobuf"
        self.file.channel(number, kind, schema.topic_path(variant, topic), message, metadata)


def attach_drive(file: McapFile, variant: int, drive: Drive) -> None:
    """Appends a variant's drive file."""
    file.attachment(schema.drive_attachment(variant), "application/toml", dumps_drive(drive).encode())


class Parts:
    """The files of an archive, being written; the first is there from the beginning.

    Raises:
        ArchiveError: here and in every method, an existing archive, a folder or disk that refuses.
    """

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
        self.path, self.overwrite, self._salvage = path, overwrite, salvage
        self._options, self._info = options, replace(info, seed=info.seed if options.seed is None else options.seed)
        self._per_part = options.split_variants or schema.MOST_VARIANTS
        self._split = options.split_size is not None or options.split_variants is not None
        if len(recorded) > schema.MOST_VARIANTS and options.split_variants is None:
            raise ArchiveError(
                f"{path}: {len(recorded)} recorded variants do not fit one file, which holds {schema.MOST_VARIANTS}; "
                "split the archive by number of variants (split_variants)"
            )
        if self._per_part > schema.MOST_VARIANTS:
            raise ArchiveError(f"split_variants = {self._per_part}: allowed is up to {schema.MOST_VARIANTS}")
        self._head = {
            "format_version": schema.FORMAT_VERSION,
            "variants": str(len(drives)),
            "recorded": " ".join(map(str, recorded)),
            "set": uuid.uuid4().hex,
        }
        self._parts: list[Part] = []
        self._by_group: dict[int, Part] = {}
        self._keep = False
        self._check_free()
        try:
            first = self._open()
            for variant, drive in enumerate(drives):
                attach_drive(first.file, variant, drive)
            for name, data in options.attachments.items():
                first.file.attachment(name, media_type(name), data)
        except BaseException:
            self.close()
            raise

    def _check_free(self) -> None:
        if self.path.is_dir():
            raise ArchiveError(f"{self.path}: is a folder; give a file name such as {self.path / 'run.mcap'}")
        mine = [part.file.path for part in self._parts if part.file.finished]
        there = [self.path] if self.path.exists() else part_files(self.path)
        others = [file for file in there if file not in mine]
        if others and not self.overwrite:
            raise taken(others[0])

    def _open(self) -> Part:
        """Begins the next file."""
        number = len(self._parts)
        path = part_path(self.path, number) if self._split else self.path
        part = Part(McapFile(path, f"warpchain {self._info.version}", self.overwrite), drives=number == 0)
        self._parts.append(part)
        part.file.metadata(schema.RUN_METADATA, self._head | {"part": str(number)} | _made(self._info))
        return part

    def place(self, position: int) -> int:
        """Place in its file of the variant recorded in the given position."""
        return position % self._per_part

    def part(self, position: int) -> Part:
        """The file that takes the next chunk of the variant recorded in the given position."""
        limit = self._options.split_size
        if limit is not None:
            current = self._parts[-1]
            if current.file.size >= limit and current.file.chunks:
                self._finish_part(current, {"ended": "continued"})
                current = self._open()
            return current
        group = position // self._per_part
        if group not in self._by_group:
            self._by_group[group] = self._open() if self._by_group else self._parts[0]
        return self._by_group[group]

    def _finish_part(self, part: Part, end: Mapping[str, str]) -> None:
        part.file.metadata(schema.END_METADATA, end)
        part.file.finish()

    def finish(self, metrics: pa.Table, info: RunInfo) -> None:
        """Ends all files; the last one holds the metrics and tells how the run ended."""
        self._check_free()
        stale = [file for file in [self.path, *part_files(self.path)] if file.is_file()]
        last = self._parts[-1]
        for part in self._parts[:-1]:
            if not part.file.finished:
                self._finish_part(part, {"ended": "continued"})
        last.file.attachment(schema.METRICS_ATTACHMENT, media_type(schema.METRICS_ATTACHMENT), _arrow_bytes(metrics))
        end = {"ended": info.ended, "wall_time": repr(float(info.wall_time)), "parts": str(len(self._parts))}
        self._finish_part(last, end)
        with refusals(self.path, ArchiveError):
            for file in stale:
                if file not in [part.file.path for part in self._parts]:
                    file.unlink()

    def refusal(self, error: ArchiveError) -> ArchiveError:
        """The error to raise when the disk refuses: with `salvage` it names the files that hold what was written."""
        left = [part.file for part in self._parts if part.file.chunks and not part.file.finished]
        if not self._salvage or not left:
            return error
        self._keep = True
        names = ", ".join(str(file.partial) for file in left)
        return ArchiveError(f"{error}; what was written until then is in {names}: see warpchain recover")

    def close(self) -> None:
        """Ends unfinished files: drops them, but for those that `refusal` named."""
        for part in self._parts:
            if not part.file.finished:
                part.file.close(keep=self._keep and part.file.chunks > 0)


def media_type(name: str) -> str:
    """Media type of an attachment, by its name."""
    kinds = {
        ".arrow": "application/vnd.apache.arrow.file",
        ".parquet": "application/vnd.apache.parquet",
        ".toml": "application/toml",
        ".csv": "text/csv",
        ".json": "application/json",
    }
    return kinds.get(Path(name).suffix, "application/octet-stream")


def _made(info: RunInfo) -> dict[str, str]:
    """How a run was made, as metadata."""
    made = {k: v for k, v in asdict(info).items() if k not in ("ended", "wall_time") and v is not None}
    texts = {name: repr(value) if isinstance(value, float) else str(value) for name, value in made.items()}
    versions = [f"{name} {version(name)}" for name in ("warp-lang", "numpy", "mcap", "protobuf")]
    return texts | {"versions": ", ".join([f"python {platform.python_version()}", *versions])}


def _arrow_bytes(table: pa.Table) -> bytes:
    import pyarrow as pa

    sink = pa.BufferOutputStream()
    with pa.ipc.new_file(sink, table.schema) as file:
        file.write_table(table)
    return bytes(sink.getvalue())
