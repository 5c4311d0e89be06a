"""Trajectories for other programs: the same numbers come back from every format, with their units."""

import csv

import numpy as np
import pyarrow.parquet as pq
import pytest
from command import run as command
from drives import two_sprockets
from pyarrow.csv import read_csv
from scipy.io import loadmat

from warpchain import Record, simulate, write_archive
from warpchain.archive.export import export
from warpchain.errors import ArchiveError, SimulationError
from warpchain.results.channels import UNITS


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
        assert set(held) == set(names(run[1]))
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
            assert held[name].attrs["units"] == UNITS[name]
        assert [dimension.label for dimension in held["position"].dims] == ["time", "roller", "axis"]
        assert held["tension"].dims[0][0].name == "/time"


def test_matlab(run, archive, tmp_path):
    held = loadmat(export(archive, tmp_path / "a.mat"))
    for name, values in names(run[1]).items():
        np.testing.assert_array_equal(held[name].squeeze(), values.squeeze())
        assert held["units"][name][0, 0][0] == UNITS[name]
    assert [name[0] for name in held["sprockets"].ravel()] == ["driver", "driven"]


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
        assert read(tmp_path / f"m{ending}")["tension_max"].to_pylist() == run.metrics["tension_max"].to_pylist()
    for words in (("-o", tmp_path / "x.xlsx"), ("--metrics", "-o", tmp_path / "x.npz")):
        status, _, err = command(capsys, "export", archive, *words)
        assert status == 2 and len(err) == 1 and ".csv" in err[0] and ".parquet" in err[0]
    assert not list(tmp_path.glob("x.*"))
