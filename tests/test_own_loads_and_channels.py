"""Loads and channels of plug-ins: against their formulas, in drive files, metrics and exports; mistakes in a line."""

import numpy as np
import pytest
from command import refused, run
from own_files import CHANNELS, LOADS, write_plugin
from study_helpers import tiny_drive

from warpchain import load_drive, load_plugin, loads_drive, simulate, write_archive
from warpchain.drive import dumps_drive
from warpchain.errors import DriveError, PluginError

pytestmark = [
    pytest.mark.usefixtures("own_plugins"),
    pytest.mark.filterwarnings("ignore::warpchain.errors.SuspectWarning"),
]
SHORT = {"device": "cpu", "step": 1e-5, "duration": 5e-4}
HEAD = "import numpy as np\nimport warpchain\n"


def drive_with_load(folder, words):
    """A drive's file whose sprocket s1 has a load's table, read."""
    drive = tiny_drive().with_values({"sprockets.s1.load": {"torque": 1.0}, "run.sample_rate": 1e5})
    text = dumps_drive(drive)
    old = next(line for line in text.splitlines() if line.startswith("load = ") or line.startswith("torque = "))
    new = "load = { table = { %s } }" if old.startswith("load") else "table = { %s }"
    file = folder / "drive.toml"
    file.write_text(text.replace(old, new % words))
    return load_drive(file)


def test_a_load_is_the_table_of_its_function(tmp_path):
    load_plugin(write_plugin(tmp_path, LOADS))
    table = drive_with_load(tmp_path, 'own = "piston", factor = 2.0').sprockets[1].load.table
    angle = np.linspace(0.0, 2.0 * np.pi, 181)
    np.testing.assert_array_equal(table.over, angle)
    np.testing.assert_allclose(table.values, 2.0 * (40.0 + 25.0 * np.cos(2.0 * angle)), rtol=1e-12)
    assert table.values[0] == table.values[-1]
    whole = drive_with_load(tmp_path, 'own = "rise"')
    assert whole.sprockets[1].load.table.time == tuple(np.linspace(0.0, 0.1, 11))
    again = loads_drive(dumps_drive(whole))  # which needs the plug-in no more
    assert again == whole


def test_a_run_with_an_own_load_is_that_with_its_numbers(tmp_path):
    load_plugin(write_plugin(tmp_path, LOADS))
    own = drive_with_load(tmp_path, 'own = "piston"')
    angle = np.linspace(0.0, 2.0 * np.pi, 181)
    torque = 40.0 + 25.0 * np.cos(2.0 * angle)
    torque[-1] = torque[0]
    table = {"angle": angle.tolist(), "torque": torque.tolist()}
    plain = tiny_drive().with_values({"sprockets.s1.load": {"table": table}, "run.sample_rate": 1e5})
    found, expected = (simulate(drive, **SHORT) for drive in (own, plain))
    np.testing.assert_array_equal(found[0].tension, expected[0].tension)
    assert "own.py sha256:" in found.info.plugins


def test_a_channel_is_its_formula_in_metrics_and_exports(tmp_path, capsys):
    path = write_plugin(tmp_path, CHANNELS)
    load_plugin(path)
    drive = tiny_drive().with_values({"run.sample_rate": 1e5})
    done = simulate(drive, **SHORT)
    row, frames = done.metrics.to_pylist()[0], done[0]
    power = frames.tension * np.hypot(frames.velocity[..., 0], frames.velocity[..., 1])
    inside = frames.time >= row["window_start"] - 1e-12
    assert row["link_power_max"] == pytest.approx(power[inside].max(), rel=1e-12)
    write_archive(done, tmp_path / "a.mcap")
    assert run(capsys, "export", tmp_path / "a.mcap", "-o", tmp_path / "a.npz", "--plugin", path)[0] == 0
    with np.load(tmp_path / "a.npz") as held:
        assert dict(held["units"])["link_power"] == "W"
        np.testing.assert_allclose(held["link_power"], power, rtol=2e-6)  # recorded in float32
    assert run(capsys, "export", tmp_path / "a.mcap", "-o", tmp_path / "a.csv", "--plugin", path)[0] == 0
    assert "link_power.0 [W]" in (tmp_path / "a.csv").read_text().splitlines()[0]


@pytest.mark.parametrize(
    ("body", "line"),
    [
        ('over="angle", end=1.0)\ndef own(x):\n    return x', "angle.720 = 1.0: must be a whole number of revolutions"),
        (
            'over="time", end=1.0)\ndef own(x):\n    return 1.0',
            "gives an array of shape (); must be 721 finite",
        ),
        ('over="time", end=1.0)\ndef own(x):\n    return x / 0.0 + np.nan', "gives torques that are not finite; must"),
        ('over="time", end=1.0)\ndef own(x):\n    return y', "line 5: load 'own': NameError: name 'y' is not defined"),
        ('over="speed", end=1.0)\ndef own(x):\n    return x', "is a load over speed; must be one over time or angle"),
    ],
)
def test_what_is_wrong_with_a_load_is_one_line(tmp_path, body, line):
    load_plugin(write_plugin(tmp_path, f'{HEAD}@warpchain.load_law("own", {body}\n'))
    with pytest.raises((DriveError, PluginError)) as caught, np.errstate(all="ignore"):
        drive_with_load(tmp_path, 'own = "own"')
    assert line in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "words", ['over="place", end=1.0', 'over="time", end=0.0', 'over="time", end=1.0, rows=1']
)  # fmt: skip
def test_a_load_that_cannot_be_is_refused_as_its_file_is_loaded(tmp_path, words):
    path = write_plugin(tmp_path, f'{HEAD}@warpchain.load_law("own", {words})\ndef own(x):\n    return x\n')
    with pytest.raises(PluginError, match=r"own\.py, line 3: load 'own'"):
        load_plugin(path)


def test_a_load_that_is_not_there_is_one_line(tmp_path, capsys):
    with pytest.raises(DriveError, match=r"must be the name of a plug-in's load; none is loaded \(--plugin\)"):
        drive_with_load(tmp_path, 'own = "piston"')
    assert "must be the name of a plug-in's load" in refused(capsys, "check", tmp_path / "drive.toml")
    load_plugin(write_plugin(tmp_path, LOADS))
    with pytest.raises(DriveError, match=r'own = "pistn": must be the name of a plug-in.s load; did you mean piston'):
        drive_with_load(tmp_path, 'own = "pistn"')
    with pytest.raises(DriveError, match=r"load\.table\.own = \"piston\": unknown key"):
        tiny_drive().with_values({"sprockets.s1.load": {"table": {"own": "piston"}}})


def test_a_channel_of_another_shape_is_one_line(tmp_path):
    text = CHANNELS.replace("return run.tension * ", "return run.tension[0] + 0 * ").replace("[..., 0]", "[0, :, 0]")
    load_plugin(write_plugin(tmp_path, text.replace("[..., 1]", "[0, :, 1]")))
    with pytest.raises(PluginError, match=r"channel 'link_power': gives an array of shape \(\d+,\); must be"):
        simulate(tiny_drive().with_values({"run.sample_rate": 1e5}), **SHORT)
