"""Measured signals: files as rigs write them, laid over a run whose signals are known."""

import json
import os
from math import pi

import numpy as np
import pytest
import scipy.sparse
from bit_flips import flip_each_bit
from command import refused
from command import run as command
from drives import example, two_sprockets
from scipy.io import savemat

from warpchain import Trajectory, simulate, write_archive
from warpchain.errors import SimulationError
from warpchain.results.measured import compare_signals, signal_source, signal_sources, signal_units
from warpchain.results.measured_binary import read_binary_columns_here
from warpchain.results.measured_columns import MeasuredColumns
from warpchain.results.measured_file import MeasuredSignal, read_signal

TEETH, TURNS = 20, 10.0


def signal(time, gain=1.0):
    """A mean, and a sine of 100 N of the twentieth order at ten revolutions a second."""
    return gain * (2000.0 + 100.0 * np.sin(2.0 * pi * TEETH * TURNS * time))


@pytest.fixture(scope="module")
def known():
    """Two seconds of a drive that turns evenly, the tension of all links the sine."""
    drive = two_sprockets()
    position = simulate(two_sprockets(duration=0.0001, settle="false"))[0].position[:1]
    time = np.linspace(0.0, 2.0, 8001)
    ones = np.ones((len(time), 60))
    held = {
        "position": np.broadcast_to(position, (len(time), 60, 2)),
        "sprocket_force": 0.0 * ones,
        "guide_force": 0.0 * ones,
        "tension": signal(time)[:, None] * ones,
        "sprocket_angle": (2.0 * pi * TURNS * time)[:, None] * np.ones(2),
        "sprocket_speed": np.full((len(time), 2), 2.0 * pi * TURNS),
        "sprocket_center": np.broadcast_to(np.array([s.center for s in drive.sprockets]), (len(time), 2, 2)),
    }
    return Trajectory(drive, time, **held)


def test_statistics_and_orders_of_a_known_signal(known):
    """A sensor that reads 5 % too much: all of it is 1.05 times. Ten revolutions, so that order 20 is a line."""
    time = np.linspace(0.0, 1.0, 2000, endpoint=False)
    found = compare_signals(known, MeasuredSignal("link 7.tension", "N", time, signal(time, 1.05)))
    for name, exact in {"mean": 2000.0, "std": 100.0 / np.sqrt(2.0), "smallest": 1900.0, "largest": 2100.0}.items():
        ours, theirs = found.statistics[name]
        # 20 samples a period, and 10: the largest one is within cos(pi / 10) of the sine's 100 N
        assert ours == pytest.approx(exact, rel=3e-3)
        assert theirs == pytest.approx(1.05 * exact, rel=4e-3)
    cause, ours, theirs = found.orders[20.0]
    assert "tooth passing" in cause
    # straight lines between 20 samples a period, at even angles, lose up to (pi / 20)^2 / 2 of the amplitude
    assert ours == pytest.approx(100.0, rel=0.0124)
    assert theirs == pytest.approx(105.0, rel=1e-3)
    _, none, nothing = found.orders[40.0]
    assert none < 0.5 and nothing < 0.5


def test_the_offset_at_which_both_agree_best(known):
    """A sweep through the latter half, measured on a clock that began 0.3 s later."""
    time = known.time
    bump = 2000.0 + 500.0 * np.exp(-(((time - 1.4) / 0.05) ** 2))
    run = Trajectory(known.drive, time, **known.channels() | {"tension": bump[:, None] * np.ones((1, 60))})
    rig = np.linspace(0.0, 0.6, 1201)
    values = 2000.0 + 480.0 * np.exp(-(((rig + 1.1 - 1.4) / 0.05) ** 2))
    found = compare_signals(run, MeasuredSignal("link 0.tension", "N", rig, values), offset=None)
    # to the coarser of both intervals, half a millisecond
    assert found.measured.time[0] == pytest.approx(1.1, abs=6e-4)
    assert compare_signals(run, MeasuredSignal("link 0.tension", "N", rig, values), 1.0).measured.time[0] == 1.0


@pytest.mark.parametrize(
    ("text", "columns"),
    [
        ("time [s],tension [kN]\n0.0,1.5\n0.5,2.5\n", None),
        ("time (ms),other,tension (N)\n0,7,1500\n500,7,2500\n", MeasuredColumns(column="tension")),
        ("# rig 7\nZeit;Kraft\ns;kN\n0,0;1,5\n0,5;2,5\n", None),
        ("t\tF\n0.0\t1500\n0.5\t2500\n\n", None),
        ("time,tension\n0.0,1500\n0.5,2.5e3\n", None),
    ],
)
def test_files_as_rigs_write_them(tmp_path, text, columns):
    path = tmp_path / "rig.csv"
    path.write_text(text)
    found = read_signal(path, "a.tension", "N", columns)
    assert found.time.tolist() == [0.0, 0.5]
    assert found.values.tolist() == pytest.approx([1500.0, 2500.0])


def test_a_unit_that_is_said_goes_before_the_heads(tmp_path):
    (tmp_path / "rig.csv").write_text("t [s],n [V]\n0,60\n1,30\n")
    found = read_signal(tmp_path / "rig.csv", "a.speed", "rad/s", MeasuredColumns(unit="rpm"))
    assert found.values == pytest.approx([2.0 * pi, pi])


@pytest.mark.parametrize(
    "text, said",
    [
        ("time,tension\n", "must have a line of names and lines of numbers below it"),
        ("time,tension\n0,1\n", "must ascend over at least two lines"),
        ("time,tension\n0,1\n0,2\n", "must ascend"),
        ("time,tension\n0,1\n1,x\n", 'line 3: "x" is not a finite number within 1e+30 of 0'),
        ("time,tension\n0,1\n1,inf\n", 'line 3: "inf" is not a finite number'),
        ("time,tension\n0,1\n1,1e304\n", 'line 3: "1e304" is not a finite number within 1e+30 of 0'),
        ("time,tension\n0,1\n1e10,1\n", "must be within 1e+09 s of 0"),
        ("time,tension\n0,1\n1," + 131_073 * "1" + "\n", "is not CSV"),
        (
            "time,tension [rpm]\n0,1\n1,2\n",
            "tension is in rpm: a.tension is in N; say --unit",
        ),
        ("time,tension [cubit]\n0,1\n1,2\n", "tension has the unit 'cubit': allowed are N, "),
        ("time [N],tension\n0,1\n1,2\n", "the time, time, is in N: must be a time; say --time-unit"),
        ("time\n0\n1\n", "of two columns at least"),
    ],
)
def test_what_is_not_understood(tmp_path, text, said):
    path = tmp_path / "rig.csv"
    path.write_text(text)
    with pytest.raises(SimulationError) as caught:
        read_signal(path, "a.tension", "N")
    assert said in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize("ending", ["csv", "mat", "mf4"])
def test_a_pipe_is_refused_at_once(tmp_path, ending):
    if ending == "mf4":
        pytest.importorskip("asammdf")
    os.mkfifo(tmp_path / f"rig.{ending}")
    with pytest.raises(SimulationError, match=r"cannot be read.*it is a device or a pipe, not a file"):
        read_signal(tmp_path / f"rig.{ending}", "a.tension", "N")


def test_every_source_has_a_view_and_its_unit():
    from warpchain.view.rerun.signal_charts import CURVE_GROUPS

    for drive in (two_sprockets(duration=0.001), *map(example, ("v6", "balance_shafts"))):
        run = simulate(drive.with_values({"run.duration": 1e-3, "run.sample_rate": 1e4}))[0]
        assert {name: of.unit for name, of in signal_sources(run).items()} == signal_units(drive)
        for name, of in signal_sources(run).items():
            assert of.group in CURVE_GROUPS
            assert of.values().shape == run.time.shape, name
    assert {"rotor.speed", "tongue.torque", "tongue.twist"} <= set(signal_units(drive))
    assert {"left arm.angle", "left tensioner.pressure"} <= set(signal_units(example("v6")))
    run = simulate(two_sprockets(duration=0.001))[0]
    with pytest.raises(SimulationError, match=r"'x': allowed are driver->driven.tension, .* with I from 0 to 59"):
        signal_source(run, "x")


def test_the_command_compares_and_draws(tmp_path, capsys):
    archive = write_archive(simulate(two_sprockets(duration=0.02)), tmp_path / "a.mcap")
    rig = tmp_path / "rig.csv"
    rig.write_text("time [ms],force [kN]\n" + "".join(f"{k},{2.0 + 0.1 * (k % 3)}\n" for k in range(20)))
    words = ["import", rig, archive, "--as", "driver->driven.tension", "-o"]
    files = [tmp_path / f"out.{kind}" for kind in ("png", "svg", "rrd", "json")]
    status, out, err = command(capsys, *words, *files)
    assert (status, err) == (0, [])
    assert out[-4:] == [str(path) for path in files]
    assert all(path.stat().st_size > 100 for path in files)
    held = json.loads(files[3].read_text())
    assert held["statistics"]["largest"]["measured"] == pytest.approx(2200.0)
    assert any(line.split()[0] == "mean" and line.split()[2] == "2.095" for line in out)  # 7 times 2, 7 times 2.1, 6
    assert "amplitude of tension [kN]" in files[1].read_text()
    for bad, said in (
        ([*words, tmp_path / "a.pdf"], "ending '.pdf': allowed are .png, .svg, .rrd, .json"),
        *(
            ([*words[:-1], f"--offset={word}"], f"--offset {word}: must be a number of seconds within 1e+09, or auto")
            for word in ("soon", "nan", "-1e300")
        ),
        ([*words[:3], "--as", "camshaft"], "--as 'camshaft': allowed are "),
    ):
        assert said in refused(capsys, *bad)


def test_mat_and_mdf4_hold_the_signal_that_was_written(tmp_path):
    """Variables of MAT files are SI unless said; channels of MDF4 have their unit and time."""
    asammdf, time = pytest.importorskip("asammdf"), np.linspace(0.0, 1.0, 50)
    savemat(tmp_path / "rig.mat", {"t": time, "force": np.sin(time), "speed": np.cos(time), "name": "rig 3"})
    with asammdf.MDF(version="4.10") as mdf:
        signals = (("force", "kN", np.sin(time)), ("speed", "rpm", np.cos(time)))
        mdf.append([asammdf.Signal(values, time, unit=unit, name=name) for name, unit, values in signals])
        mdf.save(tmp_path / "rig.mf4", overwrite=True)
    kilonewtons = read_signal(tmp_path / "rig.mat", "a.tension", "N", MeasuredColumns(unit="kN"))
    assert kilonewtons.time == pytest.approx(time)
    assert kilonewtons.values == pytest.approx(1e3 * np.sin(time))
    assert read_signal(tmp_path / "rig.mf4", "a.tension", "N").values == pytest.approx(1e3 * np.sin(time))
    speed = read_signal(tmp_path / "rig.mf4", "a.speed", "rad/s", MeasuredColumns(column="speed"))
    assert speed.values == pytest.approx(np.pi / 30.0 * np.cos(time))
    with pytest.raises(SimulationError, match="no column 'f': allowed are t, force, speed"):
        read_signal(tmp_path / "rig.mat", "a.tension", "N", MeasuredColumns(column="f"))
    for name, words in (("rig.mat", "is not a MAT file"), ("rig.mf4", "is not MDF")):
        (tmp_path / name).write_bytes(b"t,force\n0,1\n" * 20)
        with pytest.raises(SimulationError, match=words) as refused:
            read_signal(tmp_path / name, "a.tension", "N")
        assert len(str(refused.value).splitlines()) == 1
    with pytest.raises(SimulationError, match="cannot be read"):
        read_signal(tmp_path / "none.mat", "a.tension", "N")


TWICE = "time [s],force [N],force [kN],time [s]\n0,1500,1.4,0\n0.5,2500,2.4,1\n"


@pytest.mark.parametrize(
    ("columns", "values"),
    [
        (MeasuredColumns("#2", "#1"), [1500.0, 2500.0]),
        (MeasuredColumns("#3", "#4"), [1400.0, 2400.0]),
        (MeasuredColumns("force [kN]", "#1"), [1400.0, 2400.0]),
    ],
)
def test_a_column_can_be_chosen_by_its_number_or_its_whole_head(tmp_path, columns, values):
    (tmp_path / "rig.csv").write_text(TWICE)
    assert read_signal(tmp_path / "rig.csv", "a.tension", "N", columns).values.tolist() == values


@pytest.mark.parametrize(
    ("text", "columns", "said"),
    [
        (
            TWICE,
            MeasuredColumns(time="#1"),
            "'force' names the columns #2, force [N] and #3, force [kN]: say --column '#2', or",
        ),
        (
            TWICE,
            MeasuredColumns("force", "#1"),
            "'force' names the columns #2, force [N] and #3, force [kN]: say --column",
        ),
        (
            TWICE,
            MeasuredColumns("#2"),
            "'time' names the columns #1, time [s] and #4, time [s]: say --time '#1', or another",
        ),
        (TWICE, MeasuredColumns("#5", "#1"), "no column '#5'"),
        (TWICE, MeasuredColumns("#0", "#1"), "no column '#0'"),
        (
            TWICE.replace("kN", "N"),
            MeasuredColumns("force [N]", "#1"),
            "'force [N]' names the columns #2, force [N] and #3",
        ),
    ],
)
def test_a_name_that_stands_twice_is_refused(tmp_path, text, columns, said):
    (tmp_path / "rig.csv").write_text(text)
    with pytest.raises(SimulationError) as caught:
        read_signal(tmp_path / "rig.csv", "a.tension", "N", columns)
    assert said in str(caught.value)


def test_a_name_that_stands_twice_in_mat_and_mdf4(tmp_path):
    """Of two variables of a name scipy takes the last, of two channels asammdf the first."""
    asammdf, time = pytest.importorskip("asammdf"), np.linspace(0.0, 1.0, 50)
    for k in range(2):
        savemat(tmp_path / f"{k}.mat", {"t": time, "force": time + k})
    whole, more = ((tmp_path / f"{k}.mat").read_bytes() for k in range(2))
    (tmp_path / "rig.mat").write_bytes(whole + more[128:])  # behind the head of 128 bytes
    with pytest.raises(SimulationError, match=r"rig.mat: variable 't' stands twice: must stand once"):
        read_signal(tmp_path / "rig.mat", "a.tension", "N")
    with asammdf.MDF(version="4.10") as mdf:
        for k in range(2):
            mdf.append([asammdf.Signal(time + k, time, unit="N", name="force")])
        mdf.save(tmp_path / "rig.mf4", overwrite=True)
    text = r"'force' names the columns #1, force of group 0 and #2, force of group 1: say --column '#1'"
    with pytest.raises(SimulationError, match=text):
        read_signal(tmp_path / "rig.mf4", "a.tension", "N")
    assert read_signal(tmp_path / "rig.mf4", "a.tension", "N", MeasuredColumns("#2")).values[0] == 1.0


GERMAN = "Zeit [s];Kraft [N];am\n0,000022;1.249;24.12.2026\n0,5;2.500,5;24.12.2026\n"


@pytest.mark.parametrize(
    ("text", "decimal", "values"),
    [
        (GERMAN, ",", [1249.0, 2500.5]),
        ("t;F;n\n0;1.249;24.12.2026\n1;2.5;3\n", None, [1.249, 2.5]),  # a date is no number
        ("t;F;n\n0;1,249;24.12.2026\n1;2,5;3\n", None, [1.249, 2.5]),
        ("t;F\n0;1,249\n1;2,500.5\n", ".", [1249.0, 2500.5]),
        ('t,F\n0,"1,249"\n1,"2,500.5"\n', ".", [1249.0, 2500.5]),
        ('t,F\n"0,0","1.249"\n"0,5","2.500,5"\n', ",", [1249.0, 2500.5]),
    ],
)
def test_a_file_has_one_decimal_sign(tmp_path, text, decimal, values):
    """The other one is between thousands, where the sign is said; a guess would be wrong by a factor of 1000."""
    (tmp_path / "rig.csv").write_text(text)
    assert (
        read_signal(tmp_path / "rig.csv", "a.tension", "N", MeasuredColumns(decimal=decimal)).values.tolist() == values
    )


@pytest.mark.parametrize(
    ("text", "decimal", "said"),
    [
        (GERMAN, None, "line 2: 1.249, but line 2 has 0,000022: numbers of one file have points and commas; say --dec"),
        ("t;F\n0;1,5\n1;2\n2;2.5\n", None, "line 4: 2.5, but line 2 has 1,5: numbers of one file have"),
        ("t;F;G\n0;1.249;0,5\n1;2.5;3\n", None, "line 2: 0,5, but line 2 has 1.249"),  # a column beside it tells
        ("t;F\n0;1.249,5\n1;2\n", None, "line 2: 1.249,5: numbers of one file have points and commas"),
        ("t\tF\n0\t1.249\n1\t2,5\n", None, "line 3: 2,5, but line 2 has 1.249"),
        ("t;F\n0;1.24\n1;2\n", ",", 'line 2: "1.24" is not a finite number within 1e+30 of 0'),  # no thousands
        (
            't,F\n0,"1,5"\n1,2\n',
            None,
            'line 2: "1,5" is not a finite number within 1e+30 of 0; numbers of this file have decimal points',
        ),
        ("t,F\n0,0,1,5\n0,5,2,5\n", None, "line 2: has 4 cells below 2 names; decimal commas need semicolons or tabs"),
        ("t;F\n0;1\n1;2\n", "x", "--decimal x: must be . or ,"),
    ],
)
def test_numbers_of_which_it_is_not_said_what_they_are(tmp_path, text, decimal, said):
    (tmp_path / "rig.csv").write_text(text)
    with pytest.raises(SimulationError) as caught:
        read_signal(tmp_path / "rig.csv", "a.tension", "N", MeasuredColumns(decimal=decimal))
    assert said in str(caught.value) and "\n" not in str(caught.value)


def test_a_small_mat_file_of_millions_of_zeros_is_refused_before_it_is_read(tmp_path, monkeypatch):
    """The head of a variable says its length; the zeros themselves, compressed a thousand times, are not read."""
    monkeypatch.setattr("warpchain.results.measured_binary.MOST_SIGNAL_VALUES", 10**5)
    monkeypatch.setattr("scipy.io.loadmat", lambda *_, **__: pytest.fail("it was read"))
    time = np.linspace(0.0, 1.0, 10**5 + 1)
    savemat(tmp_path / "rig.mat", {"t": time, "force": np.zeros_like(time)}, do_compression=True)
    with pytest.raises(SimulationError, match=r"rig.mat: t has 100001 values; allowed are at most 100000"):
        read_binary_columns_here(tmp_path / "rig.mat", MeasuredColumns())


def test_a_small_mdf4_file_of_millions_of_zeros_is_refused_before_it_is_read(tmp_path, monkeypatch):
    asammdf, time = pytest.importorskip("asammdf"), np.linspace(0.0, 1.0, 1001)
    with asammdf.MDF(version="4.10") as mdf:
        mdf.append([asammdf.Signal(np.zeros_like(time), time, unit="N", name="force")])
        mdf.save(tmp_path / "rig.mf4", overwrite=True)
    monkeypatch.setattr("warpchain.results.measured_binary.MOST_SIGNAL_VALUES", 1000)
    monkeypatch.setattr("asammdf.MDF.get", lambda *_, **__: pytest.fail("it was read"))
    with pytest.raises(SimulationError, match=r"rig.mf4: force has 1001 values; allowed are at most 1000"):
        read_binary_columns_here(tmp_path / "rig.mf4", MeasuredColumns())


def test_variables_that_are_no_vectors_of_real_numbers_are_none_of_a_signal(tmp_path):
    """A sparse matrix is passed over; complex numbers are known only when they are read."""
    time = np.arange(5.0)
    row = scipy.sparse.csc_matrix(np.ones((1, 5)))
    savemat(tmp_path / "rig.mat", {"sparse": row, "t": time, "force": 2.0 * time, "wave": 1j * time})
    assert read_signal(tmp_path / "rig.mat", "a.tension", "N").values.tolist() == [0.0, 2.0, 4.0, 6.0, 8.0]
    with pytest.raises(SimulationError, match=r"rig.mat: no column 'sparse': allowed are t, force, wave"):
        read_signal(tmp_path / "rig.mat", "a.tension", "N", MeasuredColumns("sparse"))
    with pytest.raises(SimulationError, match=r"rig.mat: variable 'wave': must hold real numbers"):
        read_signal(tmp_path / "rig.mat", "a.tension", "N", MeasuredColumns("wave"))


def test_flipped_bits_of_a_mat_file_are_read_or_refused_in_one_line(tmp_path):
    """Of 300 flips of a bit, each gives a signal or one line that says something.

    Compressed variables have checksums; flips of others are below.
    """
    time = np.linspace(0.0, 1.0, 20)
    path = tmp_path / "rig.mat"
    savemat(path, {"t": time, "force": time}, do_compression=True)
    told = 0
    for _ in flip_each_bit(path, np.random.default_rng(1).choice(8 * path.stat().st_size, 300, replace=False)):
        try:
            read_binary_columns_here(path, MeasuredColumns())
        except SimulationError as error:
            told += 1
            assert "\n" not in str(error) and "()" not in str(error)
    assert told


@pytest.mark.parametrize(("ending", "bits"), [("mat", (1416, 3200, 3213)), ("mf4", (8430, 8447, 10293))])
def test_flipped_bits_that_end_a_process_are_read_or_refused_in_one_line(tmp_path, ending, bits):
    """Flips in sizes and addresses, of which scipy 1.17 and asammdf 8.8 end the process that reads."""
    time, path = np.linspace(0.0, 1.0, 20), tmp_path / f"rig.{ending}"
    if ending == "mat":
        savemat(path, {"t": time, "force": time})
    else:
        asammdf = pytest.importorskip("asammdf")
        with asammdf.MDF(version="4.10") as mdf:
            mdf.append([asammdf.Signal(time, time, unit="N", name="force")])
            mdf.save(path, overwrite=True)
    for _ in flip_each_bit(path, bits):
        try:
            read_signal(path, "a.tension", "N")
        except SimulationError as error:
            assert "\n" not in str(error) and str(path) in str(error)


@pytest.mark.parametrize(
    ("act", "said"),
    [
        (
            "os.abort()",
            r"rig.mf4: cannot be read: the process that read it ended \(signal 6, Aborted\); it is damaged$",
        ),
        ("os._exit(0)", r"the process that read it ended \(exit status 0\); it is damaged$"),
        ("bytearray(2**40)", r"rig.mf4: is not MDF \(MemoryError\)$"),
        ("time.sleep(1e6)", r"rig.mf4: cannot be read: reading it takes more than 3 s$"),
    ],
)
def test_a_file_that_ends_the_process_which_reads_it_is_one_line(tmp_path, monkeypatch, act, said):
    """In place of asammdf: what its C code may do at a damaged file."""
    (tmp_path / "asammdf.py").write_text(f"import os, time\ndef MDF(path):\n    {act}\n")
    (tmp_path / "rig.mf4").touch()
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr("warpchain.results.measured_binary.MOST_READING_TIME", 3.0 if "sleep" in act else 60.0)
    with pytest.raises(SimulationError, match=said) as caught:
        read_signal(tmp_path / "rig.mf4", "a.tension", "N")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("reader", ["scipy.io.whosmat", "asammdf.MDF"])
def test_an_exception_without_words_is_named(tmp_path, monkeypatch, reader):
    """As scipy and asammdf raise them where a file is damaged."""
    pytest.importorskip(reader.split(".")[0])

    def wordless(*_, **__):
        raise AssertionError

    monkeypatch.setattr(reader, wordless)
    path = tmp_path / ("rig.mat" if "mat" in reader else "rig.mf4")
    path.touch()
    with pytest.raises(SimulationError, match=r"\(AssertionError\)$"):
        read_binary_columns_here(path, MeasuredColumns())
