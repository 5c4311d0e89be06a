"""Archives, written and read."""

import argparse
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from common.cases import Line, case, case_option, table_head
from common.drives import example_drive
from common.timing import least_seconds

from warpchain import ArchiveOptions, Record, read_archive, simulate, write_archive
from warpchain.archive import mcap_write
from warpchain.archive.archive_format import message_class
from warpchain.results.run import Run

COMPRESSIONS = ("none", "lz4", "zstd")
CHUNK = 2**20
TOPICS = ("scene", "rollers", "state", "sprockets", "transforms")
Messages = list[tuple[str, int, bytes]]
"""Topic, log time and payload of the messages of one variant."""


def archive_messages(path: Path) -> Messages:
    """The messages of an archive."""
    from mcap.reader import make_reader

    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True).iter_messages(log_time_order=False)
        return [(channel.topic.split("/")[-1], message.log_time, message.data) for _, channel, message in reader]


def write_mcap(path: Path, messages: Messages, variants: int, compression: str) -> None:
    """Bytes through mcap.Writer."""
    from mcap.writer import CompressionType, Writer

    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=CHUNK, compression=getattr(CompressionType, compression.upper()))
        writer.start()
        for variant in range(variants):
            numbers = {topic: writer.register_channel(f"/{variant}/{topic}", "protobuf", 0) for topic in TOPICS}
            for topic, stamp, data in messages:
                writer.add_message(numbers[topic], stamp, data, stamp)
        writer.finish()


def write_foxglove(path: Path, messages: Messages, variants: int, compression: str) -> None:
    """PointClouds that the foxglove SDK serializes, and other messages' bytes."""
    import foxglove
    from foxglove import Channel, Context, Schema
    from foxglove.channels import PointCloudChannel
    from foxglove.mcap import MCAPCompression, MCAPWriteOptions
    from foxglove.messages import PackedElementField, PackedElementFieldNumericType, PointCloud

    path.unlink(missing_ok=True)
    kind = {"zstd": MCAPCompression.Zstd, "lz4": MCAPCompression.Lz4, "none": None}[compression]
    options = MCAPWriteOptions(compression=kind, chunk_size=CHUNK, compression_threads=0)
    parse = message_class("foxglove.PointCloud").FromString
    clouds = {stamp: parse(data) for topic, stamp, data in messages if topic == "rollers"}
    first = next(iter(clouds.values()))
    kinds = {1: PackedElementFieldNumericType.Uint8, 8: PackedElementFieldNumericType.Float64}
    fields = [PackedElementField(name=f.name, offset=f.offset, type=kinds[f.type]) for f in first.fields]
    bare: Any = {"message_encoding": "protobuf", "schema": Schema(name="bytes", encoding="", data=b"")}
    cloud_of: Any = {"frame_id": "drive", "point_stride": first.point_stride, "fields": fields}
    context = Context()
    writer = foxglove.open_mcap(path, context=context, writer_options=options)
    for variant in range(variants):
        rollers = PointCloudChannel(f"/{variant}/rollers", context=context)
        others = {
            topic: Channel(f"/{variant}/{topic}", context=context, **bare) for topic in TOPICS if topic != "rollers"
        }
        for topic, stamp, data in messages:
            if topic == "rollers":
                rollers.log(PointCloud(data=clouds[stamp].data, **cloud_of), log_time=stamp)
            else:
                others[topic].log(data, log_time=stamp)
    writer.close()


def read_arrays(path: Path) -> None:
    """All trajectories, in arrays."""
    run = read_archive(path)
    assert all(run[variant].position is not None for variant in run)


def read_views(path: Path) -> None:
    """All trajectories as views of their chunks; one number of each array is read."""
    run = read_archive(path)
    for variant in run:
        for block in run.blocks(variant):
            assert all(np.isfinite(values[-1].flat[-1]) for values in block.channels().values())


def write_with_warpchain(run: Run, path: Path, **options: Any) -> None:
    """Trajectories in arrays through warpchain."""
    write_archive(run, path, overwrite=True, options=ArchiveOptions(**options))


def write_at_level_3(run: Run, path: Path) -> None:
    """Writes trajectories through warpchain at zstd's level 3, which other writers take."""
    with patch.object(mcap_write, "ZSTD_LEVEL", 3):
        write_with_warpchain(run, path, encoders=1)


@contextmanager
def limited_cores(count: int | None) -> Iterator[None]:
    """Limits the process to so many of its cores in a `with` block."""
    held = os.sched_getaffinity(0)
    os.sched_setaffinity(0, sorted(held)[:count])
    try:
        yield
    finally:
        os.sched_setaffinity(0, held)


def compression_rows(
    run: Run, messages: Messages, folder: Path, compression: str, size: float, rounds: int
) -> Iterator[Line]:
    """Rows of one compression's writers and readers, all on one core."""
    bytes_, variants = "mcap.Writer, bytes", len(run)
    path = {
        who: folder / f"{who}.mcap" for who in ("warpchain", bytes_, "warpchain, level 3", "foxglove-sdk, PointCloud")
    }
    jobs: dict[str, Callable[[], object]] = {
        "warpchain": partial(write_with_warpchain, run, path["warpchain"], compression=compression, encoders=1),
        bytes_: partial(write_mcap, path[bytes_], messages, variants, compression),
    }
    if compression == "zstd":
        jobs["warpchain, level 3"] = partial(write_at_level_3, run, path["warpchain, level 3"])
    others = ("foxglove-sdk, PointCloud", messages, variants, compression)
    jobs[others[0]] = partial(write_foxglove, path[others[0]], *others[1:])
    reading: dict[str, Callable[[], object]] = {
        "warpchain": partial(read_arrays, path["warpchain"]),
        "views": partial(read_views, path["warpchain"]),
        bytes_: partial(archive_messages, path[bytes_]),
    }
    with limited_cores(1):
        wrote, read = least_seconds(jobs, rounds), least_seconds(reading, rounds)
    for who, took in wrote.items():
        rate = f"{size / read[who]:.0f}" if who in read else "-"
        rate += f" (views {size / read['views']:.0f})" if who == "warpchain" else ""
        written, part = (f"{size / took:.0f}", f"{variants / took:.1f}"), path[who].stat().st_size / size / 1e6
        yield (who, compression, *written, f"{wrote[bytes_] / took:.2f}", rate, f"{part:.2f}")
        path[who].unlink()


def bare_zstd_rates(threads: int) -> None:
    """Rates of zstd alone, in one thread and in two."""
    import zstandard

    data = np.random.default_rng(0).normal(size=CHUNK // 8).tobytes()
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(lambda _: zstandard.compress(data), range(24)))


def core_scaling(run: Run, folder: Path, size: float, rounds: int) -> Iterator[Line]:
    """Rates [MB/s] on two cores and on one, and their ratio."""
    cases: dict[str, dict[str, Any]] = {
        "1 core": {"encoders": 1},
        "2 cores, one file": {"encoders": 2},
        "2 cores, two files": {"encoders": 2, "split_variants": -(-len(run) // 2)},
    }
    bare = "bare zstd, 2 threads"
    lines: dict[str, list[str]] = {name: [] for name in (*cases, bare)}

    def run_on_cores(cores: int, job: Callable[..., None], *words: Any, **options: Any) -> None:
        """Runs a job on so many cores."""
        with limited_cores(cores):
            job(*words, **options)

    for compression in COMPRESSIONS:
        jobs = {
            name: partial(
                run_on_cores,
                options["encoders"],
                write_with_warpchain,
                run,
                folder / "a.mcap",
                compression=compression,
                **options,
            )
            for name, options in cases.items()
        }
        jobs |= {
            "1 thread": partial(run_on_cores, 1, bare_zstd_rates, 1),
            bare: partial(run_on_cores, 2, bare_zstd_rates, 2),
        }
        times = least_seconds(jobs, rounds)
        for name in cases:
            lines[name].append(f"{size / times[name]:.0f} ({times['1 core'] / times[name]:.2f})")
        lines[bare].append(f"({times['1 thread'] / times[bare]:.2f})")
    yield from ((name, *cells) for name, cells in lines.items())


@case(case_option("--variants", type=int, default=4), case_option("--rounds", type=int, default=10))
def archive(asked: argparse.Namespace) -> Iterator[Line]:
    """Writing and reading, beside writers of the same messages that only pass bytes on.

    python scripts/bench.py archive

    The marine drive is run for half a second; its 1,000 frames of 162 rollers stand for every variant. In one run, in
    turns, best of several rounds, at each compression:

    - warpchain: trajectories in arrays -> laid out, colored, compressed, written; and read back to arrays.
    - mcap.Writer: the very messages of warpchain's file, made beforehand, handed over as bytes; and those bytes read
      back. It compresses with zstd at level 3, warpchain at level 1; a line shows warpchain at level 3 too.
    - foxglove-sdk: the PointClouds made by it from the same bytes, other messages as bytes.

    MB are 10^6 bytes of the messages' payloads, the same for all. All on one core, then warpchain on two, with one file
    and with one file a core, beside bare zstd in as many threads: the gain of a second core just then. Files lie in
    memory where the system offers that, so that no disk is measured.
    """
    variants, rounds, memory = asked.variants, asked.rounds, Path("/dev/shm")
    free = memory.is_dir() and shutil.disk_usage(memory).free > 30e6 * variants
    one = simulate(example_drive("marine"), duration=0.5, record=Record(rate=2000.0))
    run = Run(
        [one[0].drive] * variants, one.metrics.take([0] * variants), dict.fromkeys(range(variants), one[0]), one.info
    )
    with tempfile.TemporaryDirectory(dir=memory if free else None) as name:
        folder = Path(name)
        messages = archive_messages(write_archive(one, folder / "one.mcap"))
        size = sum(len(data) for _, _, data in messages) * variants / 1e6
        yield f"{variants} variants of {size / variants:.1f} MB, best of {rounds} rounds; files in {folder.parent}\n"
        yield table_head(
            "on one core | compression | write MB/s | variants/s | of mcap.Writer | read MB/s | file / payload"
        )
        for compression in COMPRESSIONS:
            yield from compression_rows(run, messages, folder, compression, size, rounds)
        yield ""
        yield ("write MB/s (against one core)", *COMPRESSIONS)
        yield from core_scaling(run, folder, size, rounds)
