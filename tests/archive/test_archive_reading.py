"""Reading archives: lazily, in parts, without copies, and as tables."""

import os
import pickle
import re
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from archives import assert_same, unlike
from drives import example

from warpchain import ArchiveOptions, Record, Trajectory, read_archive, simulate, write_archive
from warpchain.archive.archive_parts import ArchiveParts
from warpchain.archive.mcap_read import McapIndex
from warpchain.archive.mcap_write import McapWriter, PackedChunk
from warpchain.errors import ArchiveError, SimulationError, WarpchainError
from warpchain.results.channels import CHANNEL_BY_NAME, CHANNEL_UNITS


@pytest.fixture(scope="module")
def run():
    return simulate(unlike(), record=Record(rate=1e5))


@pytest.fixture(scope="module", params=["zstd", "lz4", "none", "split"])
def archive(request, run, tmp_path_factory):
    split = request.param == "split"
    options = ArchiveOptions(split_size=100_000) if split else ArchiveOptions(compression=request.param)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("warpchain.archive.writer.CHUNK_BYTES", 2**16)
        return write_archive(run, tmp_path_factory.mktemp("read") / "a.mcap", options=options)


@pytest.fixture
def chunks_read(monkeypatch):
    """The chunks that a test reads."""
    read, plain = [], McapIndex.read_chunk
    monkeypatch.setattr(McapIndex, "read_chunk", lambda self, entry: (read.append(entry), plain(self, entry))[1])
    return read


def test_opening_reads_no_chunk_and_no_drive(archive, chunks_read, monkeypatch):
    attached, plain = [], McapIndex.read_attachment
    monkeypatch.setattr(McapIndex, "read_attachment", lambda self, name: (attached.append(name), plain(self, name))[1])
    back = read_archive(archive)
    assert len(back) == len(back.drives) == 2
    assert chunks_read == []
    assert attached == ["metrics.arrow"]


def test_a_pickled_archive_opens_its_files_anew(archive, run, monkeypatch, tmp_path):
    monkeypatch.chdir(archive.parent)
    data = pickle.dumps(read_archive(archive.name))
    monkeypatch.chdir(tmp_path)
    assert len(data) < 50_000
    assert_same(pickle.loads(data), run)


def test_a_variant_touches_only_its_chunks(archive, run, chunks_read):
    back = read_archive(archive)
    total = sum(len(file.chunks) for file in back.trajectories.files) - len(back)  # without the outlines
    np.testing.assert_array_equal(back[1].position, run[1].position)
    mine = len(chunks_read)
    held = back[0]
    assert len(chunks_read) == total
    assert 0 < mine < total
    assert back[0] is held  # as long as somebody holds it, it is not read again
    assert len(chunks_read) == total


def test_a_time_range_touches_only_its_chunks(archive, run, chunks_read):
    back = read_archive(archive)
    times = run[0].time
    for start, end in ((0.001, 0.0011), (None, 2e-4), (0.0025, None), (times[7], times[7]), (1.0, 2.0), (None, 0.0)):
        chunks_read.clear()
        part = back.read(0, start, end, channels=["tension", "sprocket_angle"])
        wanted = (times >= (start or 0.0)) & (times <= (np.inf if end is None else end))
        np.testing.assert_array_equal(part.time, times[wanted])
        np.testing.assert_array_equal(part.tension, run[0].tension[wanted])
        np.testing.assert_array_equal(part.sprocket_angle, run[0].sprocket_angle[wanted])
        assert part.position is None
        per_chunk = 2**16 // back.trajectories.chunk_layout(0).frame_bytes
        assert len(chunks_read) <= wanted.sum() / per_chunk + 2
    with pytest.raises(SimulationError, match="channels: 'colour' is unknown"):
        back.read(0, channels=["colour"])


def test_blocks_are_views_of_the_chunks(archive, run):
    back, at = read_archive(archive), 0
    for block in back.blocks(0):
        assert not block.position.flags.owndata and not block.position.flags.writeable
        np.testing.assert_array_equal(block.position, run[0].position[at : at + len(block.time)])
        base = block.position
        while isinstance(base.base, np.ndarray):
            base = base.base
        assert memoryview(base.base).nbytes >= block.position.nbytes  # the chunk's bytes, not a copy of the array
        at += len(block.time)
    assert at == len(run[0].time)


def test_chunks_that_another_program_wrote_anew_are_read_too(run, tmp_path):
    from mcap.reader import make_reader
    from mcap.writer import Writer

    path, other = write_archive(run, tmp_path / "a.mcap"), tmp_path / "b.mcap"
    with path.open("rb") as source, other.open("wb") as target:
        reader, writer = make_reader(source), Writer(target, chunk_size=100_000)
        writer.start()
        numbers = {}
        for schema, channel, message in reader.iter_messages():  # in order of time: variants and topics are mixed
            if channel.topic.endswith(("transforms", "scene")):
                continue  # topics that only viewers ask for may be left out
            if channel.id not in numbers:
                kind = writer.register_schema(schema.name, schema.encoding, schema.data)
                told = (channel.topic, channel.message_encoding, kind, channel.metadata)
                numbers[channel.id] = writer.register_channel(*told)
            held = (message.log_time, message.data, message.publish_time, message.sequence)
            writer.add_message(numbers[channel.id], *held)
        for attachment in reader.iter_attachments():
            writer.add_attachment(0, 0, attachment.name, attachment.media_type, attachment.data)
        for record in reader.iter_metadata():
            writer.add_metadata(record.name, record.metadata)
        writer.finish()
    back = read_archive(other)
    assert_same(run, back)
    np.testing.assert_array_equal(back.read(0, 0.001, 0.0012).time, read_archive(path).read(0, 0.001, 0.0012).time)


class Sparse(McapWriter):
    """Leaves holes in the file where chunks' data would be."""

    def _write_bytes(self, data):
        if len(data) < 2**20 or data[0] != 0:
            return super()._write_bytes(data)
        at, self._at = self._at, self._at + len(data)
        self._file.stream.seek(self._at)
        return at


@pytest.mark.long
def test_ten_gigabytes_open_in_well_under_a_second(run, tmp_path, monkeypatch):
    monkeypatch.setattr("warpchain.archive.archive_names.McapWriter", Sparse)
    variants, data = 2500, bytes(4 * 2**20)
    layout = read_archive(write_archive(run, tmp_path / "a.mcap")).trajectories.chunk_layout(0)
    drives = [run.drives[0]] * variants
    monkeypatch.setattr("warpchain.archive.archive_parts.dumps_drive", lambda drive: "# a drive\n" * 100)
    parts = ArchiveParts(tmp_path / "big.mcap", drives, range(variants), run.info, ArchiveOptions(), False, False)
    part = parts.part_for_chunk(0)
    for variant in range(variants):
        part.open_variant(variant, variant, layout.content, run.drives[0], {})
        for _ in range(4):
            index = {6 * variant + k + 1: np.zeros((50, 2), dtype=np.uint64) for k in range(3)}
            part.file.add_chunk(PackedChunk("", data[: 2**20], 2**20, 0, 0, 0, index))
    parts.finish_archive(run.metrics.take([0] * variants), run.info)
    assert os.stat(tmp_path / "big.mcap").st_size > 10e9
    pread, read = os.pread, []
    monkeypatch.setattr("os.pread", lambda *args: read.append(pread(*args)) or read[-1])
    took = []
    for _ in range(3):
        begin = time.process_time()
        assert len(read_archive(tmp_path / "big.mcap")) == variants
        took.append(time.process_time() - begin)
    assert sum(map(len, read)) < 3 * 5.8e6  # the summary, with a reason for each variant, and none of the data
    assert min(took) < 1.5  # 0.3 s; the limit is for a slow machine


def test_arrow_table_shares_memory_and_has_units(run):
    table = run[0].to_arrow()
    assert table.num_rows == len(run[0].time)
    for name, values in run[0].channels().items():
        flat = table[name].chunk(0)
        while flat.type != "double":
            flat = flat.values
        assert np.shares_memory(flat.to_numpy(), values)
        np.testing.assert_array_equal(flat.to_numpy(), values.reshape(-1))
        assert table.schema.field(name).metadata[b"unit"].decode() == CHANNEL_UNITS[name]
    assert table["position"][3].as_py()[5] == run[0].position[3, 5].tolist()


def test_xarray_dataset_has_dimensions_units_and_names(run):
    data = run[1].to_xarray()
    assert dict(data.sizes) == {"time": len(run[1].time), "roller": 64, "link": 64, "axis": 2, "sprocket": 2}
    for name, values in run[1].channels().items():
        assert data[name].dims == CHANNEL_BY_NAME[name].dimensions
        assert data[name].attrs["units"] == CHANNEL_UNITS[name]
        assert np.shares_memory(data[name].values, values)
    speed = data["sprocket_speed"].sel(sprocket="driven").sel(time=0.001, method="nearest")
    assert float(speed) == run[1].sprocket_speed[np.abs(run[1].time - 0.001).argmin(), 1]
    moved = Trajectory(example("car"), np.zeros(1), arm_angle=np.zeros((1, 1))).to_xarray()
    assert moved["arm"].values.tolist() == ["arm"]


def test_what_python_shows_of_runs_is_a_line(run, tmp_path):
    archive = read_archive(write_archive(run, tmp_path / "a.mcap"))
    assert repr(archive).startswith(f"Archive({len(run.drives)} variants, ")
    assert max(len(repr(shown)) for shown in (archive, run, run[0])) < 300


def test_without_xarray_one_line_tells_what_to_install(run, monkeypatch):
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(WarpchainError, match=r"needs xarray; install it with: pip .*\[xarray\]'"):
        run[0].to_xarray()


def test_the_page_on_archives_shows_what_works(run, tmp_path, monkeypatch, capsys):
    page = (Path(__file__).resolve().parents[2] / "docs" / "archive.md").read_text()
    monkeypatch.chdir(tmp_path)
    write_archive(run, "marine.mcap")
    reader, ours = re.findall(r"```python\n(.*?)```", page, re.S)
    exec(compile(reader, "docs/archive.md", "exec"), {})
    seconds, mean = map(float, capsys.readouterr().out.split())
    assert seconds == pytest.approx(run[0].time[-1], abs=1e-9)  # whole nanoseconds
    assert mean == pytest.approx(run[0].tension[-1].mean(), rel=1e-14)
    held = {}
    exec(compile(ours, "docs/archive.md", "exec"), held)
    assert held["part"].position.shape == (101, 60, 2)
    assert held["table"].num_rows == held["data"].sizes["time"] == len(run[0].time)


def test_attachments_and_metadata_are_there(run, tmp_path):
    options = ArchiveOptions(attachments={"study.toml": b"seed = 7\n", "design.csv": b"torque\n1.0\n"})
    back = read_archive(write_archive(run, tmp_path / "a.mcap", options=options))
    assert back.attachments == ("study.toml", "design.csv")
    assert back.attachment("study.toml") == b"seed = 7\n"
    assert back.metadata["device"] == "cpu"
    with pytest.raises(ArchiveError, match=r"lacks its attachment other\.csv"):
        back.attachment("other.csv")
