"""Files of measured signals: dates, gaps, equal times, and what stands in MAT of version 7.3, MDF and TDMS."""

import warnings

import numpy as np
import pytest
from bit_flips import flip_each_bit
from command import refused
from command import run as command
from drives import two_sprockets
from scipy.io import savemat

from warpchain import simulate, write_archive
from warpchain.errors import SimulationError
from warpchain.results.measured_binary import read_binary_columns_here
from warpchain.results.measured_columns import MeasuredColumns
from warpchain.results.measured_file import read_signal
from warpchain.results.measured_times import spread_equal_times


def read(path, data=None, unit="N", **said):
    """Times and values of a file, of this text as Latin-1 if it is given."""
    if data is not None:
        path.write_bytes(data.encode("latin-1"))
    found = read_signal(path, "a.tension", unit, MeasuredColumns(**said))
    return found.time, found.values


INSTANTS = {
    "year first": "2026-12-24T10:00:00.5,2026-12-24T10:00:02",
    "zones": "2026-12-24T10:00:00.5Z,2026-12-24T12:00:02+02:00",
    "over midnight": "24.12.2026 23:59:59.5,25.12.2026 00:00:01",
    "decimal commas": "24.12.2026 10:00:00 | 24.12.2026 10:00:01,5",
    "twelve hours": "12/24/2026 11:59:59.5 AM,12/24/2026 12:00:01 PM",
    "one day that may be two": "03/04/2026 10:00:00.5,03/04/2026 10:00:02",
    "a day that tells the month": "12/13/2026 23:59:59.5,12/14/2026 00:00:01",
    "years of two digits": "31.12.26 23:59:59.5,01.01.27 00:00:01",
    "a time of day alone": "10:00:00.5,10:00:02",
    "hours and minutes": "10:00,10:01",
}


@pytest.mark.parametrize("case", INSTANTS)
def test_dates_and_times_of_day_count_from_the_first_line(tmp_path, case):
    mark = "|" if "|" in INSTANTS[case] else ","
    first, second = (instant.strip() for instant in INSTANTS[case].split(mark))
    time, values = read(tmp_path / "rig.csv", f"Start;F [kN]\n{first};1\n{second};2\n")
    assert time == pytest.approx([0.0, 60.0 if case == "hours and minutes" else 1.5], abs=1e-9)
    assert values.tolist() == [1000.0, 2000.0]


def test_a_date_and_the_time_of_day_beside_it_are_one_time(tmp_path):
    text = "Datum;Uhrzeit;F [N];G [N]\n24.12.2026;23:59:59,5;1;3\n25.12.2026;00:00:00,0;2;4\n"
    time, values = read(tmp_path / "rig.csv", text)
    assert time.tolist() == [0.0, 0.5] and values.tolist() == [1.0, 2.0]
    assert read(tmp_path / "rig.csv", text, column="G")[1].tolist() == [3.0, 4.0]


def test_microseconds_of_a_date_are_kept(tmp_path):
    """An hour of the day in double precision: to 1e-11 s."""
    text = "t,F\n2026-12-24T23:00:00.000001,1\n2026-12-24T23:00:00.000003,2\n"
    assert read(tmp_path / "rig.csv", text)[0] == pytest.approx([0.0, 2e-6], abs=3e-11)


def test_times_since_1970_count_from_the_first(tmp_path):
    with pytest.warns(UserWarning, match=r"rig.csv: t: begins at 1766570400 s; it counts from the first instant"):
        assert read(tmp_path / "rig.csv", "t,F\n1766570400.25,1\n1766570401.5,2\n")[0].tolist() == [0.0, 1.25]


def test_the_signal_is_the_first_column_after_the_time(tmp_path):
    text = "No;t;F;G\n7;0;1;3\n8;1;2;4\n"
    assert read(tmp_path / "rig.csv", text, time="t")[1].tolist() == [1.0, 2.0]
    assert read(tmp_path / "rig.csv", "F;G;t\n1;3;0\n2;4;1\n", time="t")[1].tolist() == [1.0, 2.0]
    savemat(tmp_path / "rig.mat", {"No": TIME + 7.0, "t": TIME, "F": 2.0 * TIME})
    assert read(tmp_path / "rig.mat", time="t")[1] == pytest.approx(2.0 * TIME)


def test_gaps_are_left_out_and_told(tmp_path):
    text = "t [ms];F [N];G [N]\n0;1,5;\n1;;3\n2;NaN;4\n;;\n3;2,5;5\n;;6\n"
    with pytest.warns(UserWarning, match=r"rig.csv: 3 of 5 instants have no value; they are left out"):
        time, values = read(tmp_path / "rig.csv", text)
    assert time == pytest.approx([0.0, 0.003]) and values.tolist() == [1.5, 2.5]
    with pytest.raises(SimulationError, match=r"rig.csv: t: value 5 of 5 has no time: must have one"):
        read(tmp_path / "rig.csv", text, column="G")
    with pytest.raises(SimulationError, match="must ascend over at least two lines with values"):
        read(tmp_path / "rig.csv", "t,F\n0,1\n1,\n")


def test_equal_times_are_spread_up_to_the_next_and_told(tmp_path):
    """Of 400 samples a second, rounded to a hundredth: each is back within the rounding."""
    exact = np.arange(40) / 400.0
    rows = "".join(f"{time:.2f},1\n" for time in np.floor(100.0 * exact + 1e-9) / 100.0)
    with pytest.warns(UserWarning, match=r"t: 30 of 40 times are those of the line before; they are spread evenly"):
        assert read(tmp_path / "rig.csv", "t,F\n" + rows)[0] == pytest.approx(exact, abs=1e-12)
    assert spread_equal_times(np.array([0.0, 0.0, 1.0, 2.0, 2.0])).tolist() == [0.0, 0.5, 1.0, 2.0, 3.0]
    for wrong in ("0,1\n0,2\n0,3\n", "0,1\n1,1\n0.5,1\n"):
        with pytest.raises(SimulationError, match="t: must ascend over at least two lines with values"):
            read(tmp_path / "rig.csv", "t,F\n" + wrong)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (
            "t,F\n03/04/2026 10:00,1\n04/04/2026 10:00,2\n",
            "line 2: 03/04/2026 may have the day or the month first: write",
        ),
        (
            "t,F\n31.02.2026 10:00,1\n31.02.2026 10:01,2\n",
            "line 2: 31.02.2026, or a date below it, is no day of a calen",
        ),
        ("t,F\n10:00:00,1\n10:00:61,2\n", "line 3: 10:00:61 is no time of day"),
        ("t,F\n10:00:00,1\n13:00:00 PM,2\n", "line 3: 13:00:00 PM is no time of day"),
        ("t,F\n10:00:00,1\n11.5,2\n", "line 3: '11.5' is no date or time of day like those above"),
        ("t,F\n23:59:59,1\n00:00:00,2\n", "t: must ascend"),
        (
            "No;t;F\n1;0;1\n2;1;2\n",
            "column #1, No, may be no time, since column #2, t, is one: say --time '#2', or another",
        ),
        (",time,F\n0,0.0,1\n1,0.5,2\n", "column #1 has no name: say --time '#1', or another"),
        (
            "time;force\ns;klbf\n0;1\n1;2\n",
            "force has the unit 'klbf': allowed are N, mN, kN, MN, daN, kgf, lbf, and products of",
        ),
    ],
)
def test_what_is_not_clear_is_one_line(tmp_path, text, told):
    with pytest.raises(SimulationError) as caught:
        read(tmp_path / "rig.csv", text)
    assert str(caught.value).startswith(f"{tmp_path / 'rig.csv'}: {told}") and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "unit", "values"),
    [
        ("t [min];n [U/min]\n0;30\n1;60\n", "rad/s", [np.pi, 2.0 * np.pi]),
        ("t [min],F [kgf]\n0,1\n1,2\n", "N", [9.80665, 19.6133]),
        ("Zeit;Weg\nmin;µm\n0;1\n1;2\n", "m", [1e-6, 2e-6]),
    ],
)
def test_units_of_rigs(tmp_path, text, unit, values):
    found = read(tmp_path / "rig.csv", text, unit)
    assert found[0].tolist() == [0.0, 60.0] and found[1] == pytest.approx(values, rel=1e-14)


TIME = np.linspace(0.0, 1.0, 50)


def mat_of_version_7_3(path, **variables):
    """Writes a MAT file of version 7.3 as MATLAB lays it out: HDF5 behind 512 bytes, a class at each variable."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in variables.items():
            file[name] = values
            file[name].attrs["MATLAB_class"] = np.bytes_("char" if values.dtype == np.uint16 else "double")
    with open(path, "r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")


def test_a_mat_file_of_version_7_3(tmp_path):
    """A row and a column; texts and matrices are passed over."""
    path, words = tmp_path / "rig.mat", np.frombuffer("rig 3".encode("utf-16-le"), np.uint16)
    mat_of_version_7_3(path, t=TIME[None], force=np.sin(TIME)[:, None], name=words, map=np.ones((3, 3)))
    time, values = read(path, unit="N")
    assert time.tolist() == TIME.tolist() and values == pytest.approx(np.sin(TIME), rel=1e-15)
    with pytest.raises(SimulationError, match=r"rig.mat: no column 'map': allowed are force, t"):
        read(path, column="map")
    mat_of_version_7_3(path, t=TIME, force=TIME, speed=TIME)
    with pytest.raises(
        SimulationError, match=r"rig.mat: its variables have no order: say --column, one of force, speed, t"
    ):
        read(path)
    assert read(path, column="speed")[1].tolist() == TIME.tolist()
    mat_of_version_7_3(path, Zeit=TIME, force=TIME)
    with pytest.raises(SimulationError, match=r"its variables have no order: say --time, one of Zeit, force"):
        read(path)
    path.write_bytes(path.read_bytes()[:700])
    with pytest.raises(SimulationError, match=r"rig.mat: cannot be read") as caught:
        read(path)
    assert "\n" not in str(caught.value)


def test_an_mdf_file_of_version_3(tmp_path):
    asammdf = pytest.importorskip("asammdf")
    with asammdf.MDF(version="3.30") as mdf:
        signals = (("force", "kN", np.sin(TIME)), ("speed", "1/min", np.cos(TIME)))
        mdf.append([asammdf.Signal(values, TIME, unit=unit, name=name) for name, unit, values in signals])
        mdf.save(tmp_path / "rig.mdf", overwrite=True)
    time, values = read(tmp_path / "rig.mdf")
    assert time == pytest.approx(TIME) and values == pytest.approx(1e3 * np.sin(TIME))
    assert read(tmp_path / "rig.mdf", unit="rad/s", column="speed")[1] == pytest.approx(np.pi / 30.0 * np.cos(TIME))
    (tmp_path / "rig.dat").write_bytes((tmp_path / "rig.mdf").read_bytes())
    with pytest.raises(SimulationError, match=r"rig.dat: is MDF: its name must end in .mdf or .mf4"):
        read(tmp_path / "rig.dat")


def test_samples_of_mdf_that_are_not_valid_are_gaps(tmp_path):
    asammdf, valid = pytest.importorskip("asammdf"), np.arange(50) % 10 > 0
    with asammdf.MDF(version="4.10") as mdf:
        mdf.append([asammdf.Signal(TIME + 1.0, TIME, unit="N", name="force", invalidation_bits=~valid)])
        mdf.save(tmp_path / "rig.mf4", overwrite=True)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        time, values = read(tmp_path / "rig.mf4")
    assert time.tolist() == TIME[valid].tolist() and values.tolist() == (TIME + 1.0)[valid].tolist()


def test_a_tdms_file(tmp_path):
    """A waveform has its time, another channel takes one beside it: seconds, or instants from the first on."""
    nptdms, path = pytest.importorskip("nptdms"), tmp_path / "rig.tdms"
    wave = {"wf_increment": 0.1, "wf_start_offset": 1.0, "unit_string": "kN"}
    stamps = np.datetime64("2026-12-24T10:00:00") + np.arange(5) * np.timedelta64(1000, "us")
    with nptdms.TdmsWriter(str(path)) as file:
        channels = {
            "F": (np.arange(5.0), wave),
            "G": (np.arange(5), {}),
            "s": (np.arange(5.0) / 4.0, {"unit_string": "ms"}),
        }
        channels |= {"stamp": (stamps, {}), "name": (list("abcde"), {})}
        file.write_segment([nptdms.ChannelObject("rig", name, *of) for name, of in channels.items()])
    time, values = read(path)
    assert time == pytest.approx([1.0, 1.1, 1.2, 1.3, 1.4]) and values.tolist() == [0.0, 1e3, 2e3, 3e3, 4e3]
    assert read(path, column="G", time="s")[0] == pytest.approx(np.arange(5) / 4e3)
    assert read(path, column="#2", time="stamp")[0] == pytest.approx(np.arange(5) * 1e-3)
    with pytest.raises(
        SimulationError, match=r"channel 'G' has no time of its own \(wf_increment\): say --time, one of F, G"
    ):
        read(path, column="G")
    with pytest.raises(SimulationError, match=r"rig.tdms: channel 'name': must hold numbers"):
        read(path, column="name", time="s")
    with pytest.raises(SimulationError, match=r"rig.tdms: --head 2: only of text"):
        read(path, head=2)


def test_flipped_bits_of_a_tdms_file_are_read_or_refused_in_one_line(tmp_path):
    nptdms, path = pytest.importorskip("nptdms"), tmp_path / "rig.tdms"
    with nptdms.TdmsWriter(str(path)) as file:
        file.write_segment(
            [nptdms.ChannelObject("rig", "F", np.arange(5.0), {"wf_increment": 0.1, "unit_string": "N"})]
        )
    told = 0
    for _ in flip_each_bit(path, range(0, 8 * path.stat().st_size, 11)):
        try:
            read_binary_columns_here(path, MeasuredColumns())
        except SimulationError as error:
            told += 1
            assert "\n" not in str(error) and str(path) in str(error)
    assert told
    path.write_bytes(b"t,F\n0,1\n")
    with pytest.raises(SimulationError, match=r"rig.tdms: is not TDMS \("):
        read_binary_columns_here(path, MeasuredColumns())


@pytest.mark.parametrize(
    ("ending", "extra", "module"), [("mdf", "mdf", "asammdf"), ("tdms", "tdms", "nptdms"), ("mat", "hdf5", "h5py")]
)
def test_a_missing_extra_is_one_line_with_its_command(tmp_path, monkeypatch, ending, extra, module):
    path = tmp_path / f"rig.{ending}"
    if ending == "mat":
        mat_of_version_7_3(path, t=TIME, force=TIME)
    else:
        path.touch()
    monkeypatch.setattr("warpchain.extras.find_spec", lambda name: None if name == module else True)
    with pytest.raises(
        SimulationError, match=rf"rig.{ending}: .*: needs {module}; install it with: pip install .*\[{extra}\]"
    ):
        read_binary_columns_here(path, MeasuredColumns())


def test_the_command_says_what_it_left_out_and_takes_the_line_of_names(tmp_path, capsys):
    archive = write_archive(simulate(two_sprockets(duration=0.02)), tmp_path / "a.mcap")
    rows = "".join(f"{k};{2.0 + 0.1 * (k % 3):.1f}\n".replace(".", ",") for k in range(20))
    (tmp_path / "rig.txt").write_bytes(("Tester;Meier\nZeit;Kraft\nms;kN\n" + rows + "20;\n").encode("utf-16"))
    words = ["import", tmp_path / "rig.txt", archive, "--as", "driver->driven.tension"]
    status, out, err = command(capsys, *words, "--head", "2")
    assert status == 0 and any(line.split()[0] == "mean" and line.split()[2] == "2.095" for line in out)
    assert any(line.endswith("rig.txt: 1 of 21 instants have no value; they are left out") for line in err)
    (tmp_path / "rig.txt").write_text("Tester;Meier\nZeit;Kraft\n0;1\n1;2\n")
    assert "rig.txt: lines 1 and 2 may both be the names: say --head 2, or another" in refused(capsys, *words)
