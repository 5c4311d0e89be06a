"""Trajectories for other programs: the same numbers come back from every format, with their units."""

import csv

import numpy as np
import pyarrow.parquet as pq
import pytest
from command import run as command
from drives import timing, two_sprockets
from mcap.reader import make_reader
from pyarrow.csv import read_csv
from scipy.io import loadmat

from warpchain import Record, read_archive, simulate, write_archive
from warpchain.archive.archive_parts import ArchivePart
from warpchain.archive.export import export, export_metrics
from warpchain.errors import ArchiveError, SimulationError
from warpchain.results.channels import CHANNEL_UNITS


@pytest.fixture(scope="module")
def run():
    return simulate([two_sprockets(duration=0.001, settle="false")] * 2, record=Record([1], rate=1e4))


@pytest.fixture(scope="module")
def archive(run, tmp_path_factory):
    return write_archive(run, tmp_path_factory.mktemp("export") / "a.mcap")


def names(trajectory):
    return {"time": trajectory.time, **trajectory.channels()}


def test_numpy(run, archive, tmp_path):
    with np.load(export(archive, tmp_path / "a.npz")) as held:
        assert set(held) == {*names(run[1]), "units"}
        assert dict(held["units"]) == {name: CHANNEL_UNITS[name] for name in names(run[1])}
        for name, values in names(run[1]).items():
            np.testing.assert_array_equal(held[name], values)


def test_csv_has_units_in_its_head_and_every_digit(run, archive, tmp_path):
    with open(export(archive, tmp_path / "a.csv"), newline="") as file:
        head, *rows = list(csv.reader(file))
    column = {name: np.array([float(row[k]) for row in rows]) for k, name in enumerate(head)}
    trajectory = run[1]
    np.testing.assert_array_equal(column["time [s]"], trajectory.time)
    np.testing.assert_array_equal(column["tension.7 [N]"], trajectory.tension[:, 7])
    np.testing.assert_array_equal(column["position.59.y [m]"], trajectory.position[:, 59, 1])
    np.testing.assert_array_equal(column["sprocket_speed.driven [rad/s]"], trajectory.sprocket_speed[:, 1])
    assert len(head) == 1 + sum(values[0].size for values in trajectory.channels().values())


def test_parquet_has_units_in_its_fields(run, archive, tmp_path):
    table = pq.read_table(export(archive, tmp_path / "a.parquet"))
    assert table.schema.field("tension.7").metadata[b"unit"] == b"N"
    np.testing.assert_array_equal(table["tension.7"].to_numpy(), run[1].tension[:, 7])
    np.testing.assert_array_equal(table["sprocket_center.driven.x"].to_numpy(), run[1].sprocket_center[:, 1, 0])


@pytest.mark.parametrize("ending", ["h5", "hdf5", "H5"])
def test_hdf5_has_units_labels_and_a_scale_of_time(run, archive, tmp_path, ending):
    h5py = pytest.importorskip("h5py")
    with h5py.File(export(archive, tmp_path / f"a.{ending}")) as held:
        assert list(held.attrs["sprockets"]) == ["driver", "driven"]
        for name, values in names(run[1]).items():
            np.testing.assert_array_equal(held[name][:], values)
            assert held[name].attrs["units"] == CHANNEL_UNITS[name]
        assert [dimension.label for dimension in held["position"].dims] == ["time", "roller", "axis"]
        assert held["tension"].dims[0][0].name == "/time"


def test_matlab(run, archive, tmp_path):
    held = loadmat(export(archive, tmp_path / "a.mat"))
    for name, values in names(run[1]).items():
        np.testing.assert_array_equal(held[name].squeeze(), values.squeeze())
        assert held["units"][name][0, 0][0] == CHANNEL_UNITS[name]
    assert [name[0] for name in held["sprockets"].ravel()] == ["driver", "driven"]


@pytest.fixture(scope="module")
def armed(tmp_path_factory):
    run = simulate(timing().with_values({"run.duration": 2e-4, "run.settle": False}))
    return write_archive(run, tmp_path_factory.mktemp("armed") / "a.mcap")


def test_angles_of_arms_are_radians_and_say_so(armed, tmp_path):
    """Drive files have them in degrees: every way out of an archive names the unit beside the numbers."""
    h5py = pytest.importorskip("h5py")
    archive = read_archive(armed)
    angle, data = archive[0].arm_angle, archive[0].to_xarray()
    assert CHANNEL_UNITS["arm_angle"] == "rad" and len(data.arm) == 1
    assert (data.arm_angle.attrs["units"], list(data.arm.values)) == ("rad", ["arm"])
    assert data.arm_angle.attrs["long_name"] == "angle from the drawing, counter-clockwise"
    assert archive[0].to_arrow().field("arm_angle").metadata[b"unit"] == b"rad"
    assert "arm_angle.arm [rad]" in read_csv(export(armed, tmp_path / "a.csv")).column_names
    assert dict(np.load(export(armed, tmp_path / "a.npz"))["units"])["arm_angle"] == "rad"
    with h5py.File(export(armed, tmp_path / "a.h5")) as held:
        assert held["arm_angle"].attrs["units"] == "rad" and list(held.attrs["arms"]) == ["arm"]
    held = loadmat(export(armed, tmp_path / "a.mat"))
    assert held["units"]["arm_angle"][0, 0][0] == "rad" and held["arms"].ravel()[0][0] == "arm"
    with open(armed, "rb") as file:
        channels = make_reader(file).get_summary().channels.values()
    (facts,) = (channel.metadata for channel in channels if channel.topic.endswith("/rollers"))
    units = dict(zip(facts["channels"].split(), facts["units"].split(", "), strict=True))
    assert units == {name: CHANNEL_UNITS[name] for name in archive[0].channels()} and angle.shape[1] == 1
    metrics = read_csv(export_metrics(armed, tmp_path / "m.csv")).column_names
    assert "arm.angle_mean [rad]" in metrics and "efficiency" in metrics
    assert not [name for name in metrics if name.endswith(("[1]", "[]"))]


def test_an_archive_that_does_not_name_its_units_reads_the_same(armed, tmp_path, monkeypatch):
    """As those of earlier versions, which have all else."""
    run, before = read_archive(armed), ArchivePart.open_topic

    def open_topic(self, number, variant, topic, metadata):
        before(self, number, variant, topic, {name: word for name, word in metadata.items() if name != "units"})

    monkeypatch.setattr(ArchivePart, "open_topic", open_topic)
    bare = write_archive(run, tmp_path / "bare.mcap")
    assert bare.stat().st_size < armed.stat().st_size
    for name, values in read_archive(bare)[0].channels().items():
        np.testing.assert_array_equal(values, run[0].channels()[name])


def test_refusals(archive, tmp_path, capsys):
    with pytest.raises(ArchiveError, match=r"ending '.xls': allowed are .npz, .csv, .parquet, .h5, .hdf5, .mat"):
        export(archive, tmp_path / "a.xls")
    with pytest.raises(SimulationError, match="variant 0 was not recorded"):
        export(archive, tmp_path / "a.csv", variant=0)
    assert command(capsys, "export", archive, "-o", tmp_path / "a")[0] == 2
    assert list(tmp_path.iterdir()) == []


def test_metrics_come_as_a_table_and_endings_are_held_to(run, archive, tmp_path, capsys):
    for ending, read in ((".csv", read_csv), (".parquet", pq.read_table)):
        status, out, _ = command(capsys, "export", archive, "--metrics", "-o", tmp_path / f"m{ending}")
        assert (status, out) == (0, [str(tmp_path / f"m{ending}")])
        name = "tension_max [N]" if ending == ".csv" else "tension_max"
        assert read(tmp_path / f"m{ending}")[name].to_pylist() == run.metrics["tension_max"].to_pylist()
    for words in (("-o", tmp_path / "x.xlsx"), ("--metrics", "-o", tmp_path / "x.npz")):
        status, _, err = command(capsys, "export", archive, *words)
        assert status == 2 and len(err) == 1 and ".csv" in err[0] and ".parquet" in err[0]
    assert not list(tmp_path.glob("x.*"))
