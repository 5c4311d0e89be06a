"""Archives, written and read."""

import argparse
import functools
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from common.cases import Line, case, option
from common.timing import least

from warpchain import ArchiveOptions, Record, load_drive, read_archive, simulate, write_archive
from warpchain.archive import mcap_write as archive_file
from warpchain.archive.archive_format import message_type
from warpchain.drive.examples import drive_path
from warpchain.results.run import Run

COMPRESSIONS = ("none", "lz4", "zstd")
CHUNK = 2**20


def ensemble(variants: int) -> Run:
    """A run of `variants` variants that share one trajectory."""
    drive = load_drive(drive_path("marine"))
    one = simulate(drive, duration=0.5, record=Record(rate=2000.0))
    return Run([drive] * variants, one.metrics, dict.fromkeys(range(variants), one[0]), one.info)


def messages_of(path: Path) -> list[tuple[str, int, bytes]]:
    """Topic, log time and payload of the messages of one variant."""
    from mcap.reader import make_reader

    with path.open("rb") as stream:
        reader = make_reader(stream).iter_messages(log_time_order=False)
        return [(channel.topic.split("/")[-1], message.log_time, message.data) for _, channel, message in reader]


def write_mcap(path: Path, messages: list[tuple[str, int, bytes]], variants: int, compression: str) -> None:
    """Bytes through mcap.Writer."""
    from mcap.writer import CompressionType, Writer

    kind = getattr(CompressionType, compression.upper())
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=CHUNK, compression=kind)
        writer.start()
        for variant in range(variants):
            numbers = {
                topic: writer.register_channel(f"/{variant}/{topic}", "protobuf", 0)
                for topic in ("scene", "rollers", "state", "sprockets", "transforms")
            }
            for topic, stamp, data in messages:
                writer.add_message(numbers[topic], stamp, data, stamp)
        writer.finish()


def read_mcap(path: Path) -> None:
    """All messages' bytes through mcap's reader."""
    from mcap.reader import make_reader

    with path.open("rb") as stream:
        for _, _, message in make_reader(stream, validate_crcs=True).iter_messages(log_time_order=False):
            assert message.data


def write_foxglove(path: Path, messages: list[tuple[str, int, bytes]], variants: int, compression: str) -> None:
    """PointClouds that the foxglove SDK serializes, and other messages' bytes."""
    import foxglove
    from foxglove import Channel, Context, Schema
    from foxglove.channels import PointCloudChannel
    from foxglove.mcap import MCAPCompression, MCAPWriteOptions
    from foxglove.messages import PackedElementField, PackedElementFieldNumericType, PointCloud

    kind = {"zstd": MCAPCompression.Zstd, "lz4": MCAPCompression.Lz4, "none": None}[compression]
    options = MCAPWriteOptions(compression=kind, chunk_size=CHUNK, compression_threads=0)
    schema = Schema(name="bytes", encoding="", data=b"")
    parse = message_type("foxglove.PointCloud").FromString
    first = parse(next(data for topic, _, data in messages if topic == "rollers"))
    kinds = {1: PackedElementFieldNumericType.Uint8, 8: PackedElementFieldNumericType.Float64}
    fields = [PackedElementField(name=f.name, offset=f.offset, type=kinds[f.type]) for f in first.fields]
    clouds = {stamp: parse(data).data for topic, stamp, data in messages if topic == "rollers"}
    context = Context()
    writer = foxglove.open_mcap(path, context=context, writer_options=options)
    for variant in range(variants):
        rollers = PointCloudChannel(f"/{variant}/rollers", context=context)
        others = {
            topic: Channel(f"/{variant}/{topic}", message_encoding="protobuf", schema=schema, context=context)
            for topic in ("scene", "state", "sprockets", "transforms")
        }
        for topic, stamp, data in messages:
            if topic == "rollers":
                cloud = PointCloud(frame_id="drive", point_stride=first.point_stride, fields=fields, data=clouds[stamp])
                rollers.log(cloud, log_time=stamp)
            else:
                others[topic].log(data, log_time=stamp)
    writer.close()


def read_warpchain(path: Path) -> None:
    """All trajectories, in arrays."""
    run = read_archive(path)
    for variant in run:
        assert run[variant].position is not None


def view_warpchain(path: Path) -> None:
    """All trajectories as views of their chunks; one number of each array is looked at."""
    run = read_archive(path)
    for variant in run:
        for block in run.blocks(variant):
            for values in block.channels().values():
                assert np.isfinite(values[-1].flat[-1])


def writer_of(run: Run, path: Path, **options: Any) -> Callable[[], None]:
    """Writes with warpchain."""
    return lambda: void(write_archive(run, path, overwrite=True, options=ArchiveOptions(**options)))


def void(_: object) -> None:
    """Nothing."""


def table(
    run: Run,
    messages: list[tuple[str, int, bytes]],
    folder: Path,
    compression: str,
    size: float,
    rounds: int,
    cores: list[int],
) -> Iterator[Line]:
    """One compression's lines, all on one core."""
    variants = len(run)
    mine, raw, fox = (folder / f"{who}.mcap" for who in ("warpchain", "mcap", "foxglove"))

    def foxglove() -> None:
        fox.unlink(missing_ok=True)
        write_foxglove(fox, messages, variants, compression)

    os.sched_setaffinity(0, cores[:1])
    level_3 = folder / "level-3.mcap"

    def same_level() -> None:
        kept, archive_file.ZSTD_LEVEL = archive_file.ZSTD_LEVEL, 3
        write_archive(run, level_3, overwrite=True, options=ArchiveOptions(encoders=1))
        archive_file.ZSTD_LEVEL = kept

    writers = {
        "warpchain": writer_of(run, mine, compression=compression, encoders=1),
        "mcap.Writer, bytes": lambda: write_mcap(raw, messages, variants, compression),
    }
    if compression == "zstd":
        writers["warpchain, level 3"] = same_level
    try:
        import foxglove as _  # noqa: F401

        writers["foxglove-sdk, PointCloud"] = foxglove
    except ImportError:
        pass
    wrote = least(writers, rounds)
    read = least(
        {
            "warpchain": lambda: read_warpchain(mine),
            "warpchain, views": lambda: view_warpchain(mine),
            "mcap.Writer, bytes": lambda: read_mcap(raw),
        },
        rounds,
    )
    os.sched_setaffinity(0, cores)
    paths = {"warpchain": mine, "mcap.Writer, bytes": raw, "warpchain, level 3": level_3}
    for who in writers:
        path = paths.get(who, fox)
        reading = f"{size / read[who]:.0f}" if who in read else "-"
        if who == "warpchain":
            reading += f" (views {size / read['warpchain, views']:.0f})"
        took, of_bytes = wrote[who], wrote["mcap.Writer, bytes"] / wrote[who]
        part = f"{path.stat().st_size / size / 1e6:.2f}"
        yield (who, compression, f"{size / took:.0f}", f"{variants / took:.1f}", f"{of_bytes:.2f}", reading, part)
        path.unlink()


def bare(threads: int, cores: list[int]) -> None:
    """The same compressing in one thread or in two, and nothing else."""
    import zstandard

    os.sched_setaffinity(0, cores[:threads])
    data = np.random.default_rng(0).normal(size=CHUNK // 8).tobytes()
    compress = zstandard.compress
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(lambda _: void(compress(data)), range(24)))


def scaling(run: Run, folder: Path, size: float, rounds: int, cores: list[int]) -> Iterator[Line]:
    """Two cores against one: MB/s and the ratio."""
    half = -(-len(run) // 2)
    cases = {
        "1 core": (1, {"encoders": 1}),
        "2 cores, one file": (2, {"encoders": 2}),
        "2 cores, two files": (2, {"encoders": 2, "split_variants": half}),
    }
    lines: dict[str, list[str]] = {name: [] for name in (*cases, "bare zstd, 2 threads")}
    for compression in COMPRESSIONS:
        jobs: dict[str, Callable[[], None]] = {}
        for name, (count, options) in cases.items():
            write = writer_of(run, folder / f"{name}.mcap".replace(" ", "-"), compression=compression, **options)

            def job(write: Callable[[], None] = write, count: int = count) -> None:
                os.sched_setaffinity(0, cores[:count])
                write()

            jobs[name] = job
        for threads in (1, 2):
            jobs[f"bare zstd, {threads} threads"] = functools.partial(bare, threads, cores)
        times = least(jobs, rounds)
        ratio = times["bare zstd, 1 threads"] / times["bare zstd, 2 threads"]
        lines["bare zstd, 2 threads"].append(f"({ratio:.2f})")
        for name in cases:
            lines[name].append(f"{size / times[name]:.0f} ({times['1 core'] / times[name]:.2f})")
    yield from ((name, *cells) for name, cells in lines.items())
    os.sched_setaffinity(0, cores)


@case(option("--variants", type=int, default=4), option("--rounds", type=int, default=10))
def archive(asked: argparse.Namespace) -> Iterator[Line]:
    """Writing and reading, beside writers of the same messages that only pass bytes on.

    python scripts/bench.py archive

    The marine drive is run for half a second; its 1,000 frames of 162 rollers stand for every variant. In one run, in
    turns, best of several rounds, at each compression:

    - warpchain: trajectories in arrays -> laid out, colored, compressed, written; and read back to arrays.
    - mcap.Writer: the very messages of warpchain's file, made beforehand, handed over as bytes; and those bytes read
      back. It compresses with zstd at level 3, warpchain at level 1; a line shows warpchain at level 3 too.
    - foxglove-sdk (where it is installed): the PointClouds made by it from the same bytes, other messages as bytes.

    MB are 10^6 bytes of the messages' payloads, the same for all. All on one core, then warpchain on two, with one file
    and with one file a core, beside bare zstd in as many threads, which tells what a second core gave just then. Files
    lie in memory where the system offers that, so that no disk is measured.
    """
    variants, rounds = asked.variants, asked.rounds
    cores = sorted(os.sched_getaffinity(0))
    memory = Path("/dev/shm")
    free = memory.is_dir() and shutil.disk_usage(memory).free > 30e6 * variants
    with tempfile.TemporaryDirectory(dir=memory if free else None) as name:
        folder = Path(name)
        messages = messages_of(write_archive(ensemble(1), folder / "one.mcap"))
        size = sum(len(data) for _, _, data in messages) * variants / 1e6
        run = ensemble(variants)
        yield f"{variants} variants of {size / variants:.1f} MB, best of {rounds} rounds; files in {folder.parent}\n"
        yield (
            "on one core",
            "compression",
            "write MB/s",
            "variants/s",
            "of mcap.Writer",
            "read MB/s",
            "file / payload",
        )
        for compression in COMPRESSIONS:
            yield from table(run, messages, folder, compression, size, rounds, cores)
        if len(cores) > 1:
            yield ""
            yield ("write MB/s (against one core)", *COMPRESSIONS)
            yield from scaling(run, folder, size, rounds, cores)
