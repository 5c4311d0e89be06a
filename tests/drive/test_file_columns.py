"""Tables of files that a drive file names: which column is which, in which unit, and what is refused."""

import math
import re
from typing import get_args

import pytest
from drives import two_sprockets

from warpchain import dumps_drive, load_drive, loads_drive
from warpchain.drive.csv_files import TABLES
from warpchain.drive.drive import Drive
from warpchain.drive.file_columns import COLUMN_UNITS, columns_of, read_columns
from warpchain.drive.motion_table import MotorTable, PlaceTable, SpeedTable, SupplyTable, Table, TorqueTable
from warpchain.drive.quantities import unit_of_key
from warpchain.drive.schema import Part
from warpchain.drive.valves import LiftTable
from warpchain.errors import DriveError

RPM = math.pi / 30.0


def columns(path, text, kind, **said):
    """The columns of a file of this text."""
    path.write_text(text, encoding="utf-8")
    return read_columns(path, said, columns_of(kind))


MOTOR = {"speed": [0.0, 1000.0 * RPM, 3000.0 * RPM], "torque": [90.0, 80.5, 20.0]}


@pytest.mark.parametrize(
    "text",
    [
        "speed [rpm],torque [Nm]\n0,90\n1000,80.5\n3000,20\n",
        "rpm;Nm\n0;90\n1000;80,5\n3000;20\n",
        "torque_Nm\tspeed_rpm\n90\t0\n80.5\t1000\n20\t3000\n",
        "n / min⁻¹;M / Nm\n0;90\n1000;80,5\n3000;20\n",
        "Motor XY;\nDrehzahl;Moment\nU/min;Nm\n0;90\n1000;80,5\n3000;20\n",
        "engine speed [rpm],torque\n0,90\n1000,80.5\n3000,20\n",
    ],
)
def test_a_column_is_what_its_name_or_its_unit_says(tmp_path, text):
    found = columns(tmp_path / "m.csv", text, MotorTable)
    assert set(found) == set(MOTOR)
    for key, values in MOTOR.items():
        assert found[key] == pytest.approx(values, rel=1e-15)


THREE = "n;M;T\n1/min;Nm;°C\n0;90;20\n1000;80,5;21\n3000;20;22\n"


def test_a_third_column_is_refused_by_name_until_those_that_count_are_named(tmp_path):
    path = tmp_path / "m.csv"
    with pytest.raises(DriveError) as caught:
        columns(path, THREE, MotorTable)
    (line,) = caught.value.errors
    text = 'line 1: column #3, "T [°C]", is not known, nor is its unit; must be torque over time or angle or'
    assert line.startswith(text) and line.endswith('columns = { speed = "n", torque = "M" }')
    for names in ({"speed": "n", "torque": "M"}, {"speed": "n [1/min]", "torque": "#2"}):
        found = columns(path, THREE, MotorTable, columns=names)
        assert found["torque"] == MOTOR["torque"] and found["speed"] == pytest.approx(MOTOR["speed"], rel=1e-15)


def test_units_that_a_file_does_not_say(tmp_path):
    text = "n,M,T\n0,0.09,20\n1000,0.0805,21\n3000,0.02,22\n"
    said = {"columns": {"speed": "n", "torque": "M"}, "units": {"speed": "rpm", "torque": "kNm"}}
    found = columns(tmp_path / "m.csv", text, MotorTable, **said)
    assert found["speed"] == pytest.approx(MOTOR["speed"], rel=1e-15)
    assert found["torque"] == pytest.approx(MOTOR["torque"], rel=1e-15)


@pytest.mark.parametrize(
    ("kind", "text", "found"),
    [
        (SpeedTable, "t [ms];U/min\n0;30\n500;60\n", {"time": [0.0, 0.5], "speed": [30 * RPM, 60 * RPM]}),
        (TorqueTable, "°KW;Nm\n0;1\n720;1\n", {"angle": [0.0, 4 * math.pi], "torque": [1.0, 1.0]}),
        (
            TorqueTable,
            "time [min],torque [lbf ft]\n0,0\n1,1\n",
            {"time": [0.0, 60.0], "torque": [0.0, 1.3558179483314004]},
        ),
        (SupplyTable, "rpm;bar\n0;1\n30;4,5\n", {"speed": [0.0, math.pi], "pressure": [1e5, 4.5e5]}),
        (
            SupplyTable,
            "time,pressure [psi]\n0,1\n1,2\n",
            {"time": [0.0, 1.0], "pressure": [6894.757293168361, 13789.514586336722]},
        ),
        (
            PlaceTable,
            "t [s];x [mm];y [in]\n0;0;0\n1;2;1\n",
            {"time": [0.0, 1.0], "x": [0.0, 0.002], "y": [0.0, 0.0254]},
        ),
        (PlaceTable, "time,y_mm\n0,0\n1,2\n", {"time": [0.0, 1.0], "y": [0.0, 0.002]}),
        (
            LiftTable,
            "deg;in\n-180;0\n0;0,25\n180;0\n",
            {"angle": [-math.pi, 0.0, math.pi], "lift": [0.0, 0.00635, 0.0]},
        ),
    ],
)
def test_each_kind_of_table_in_other_units(tmp_path, kind, text, found):
    assert columns(tmp_path / "t.csv", text, kind) == {key: pytest.approx(of, rel=1e-15) for key, of in found.items()}


@pytest.mark.parametrize(
    ("kind", "text", "said", "told"),
    [
        (
            TorqueTable,
            "time,moment\n0,1\n1,2\n",
            {},
            'line 1: column #2, "moment", is not known; must be torque over time or',
        ),
        (
            TorqueTable,
            "time,torque [kg]\n0,1\n1,2\n",
            {},
            'line 1: column "torque [kg]" is in "kg"; torque must be in one of N m,',
        ),
        (TorqueTable, "time,torque\n0,1\n1,\n", {}, 'line 3: column "torque" has no number; each line must have one'),
        (TorqueTable, "time,torque\n0,1\n0,2\n", {}, "line 3: time = 0 must be above that of the row before"),
        (
            TorqueTable,
            "time;torque\n0;1.249\n1;2.500\n",
            {},
            "line 2: 1.249 may be 1249, as all numbers here; give decimal , or .",
        ),
        (
            TorqueTable,
            "A;B\ntime;torque\n0;1\n1;2\n",
            {"head": 1},
            'line 1: column #1, "A [time]", is not known, nor is its unit',
        ),
        (
            TorqueTable,
            "time,torque,torque\n0,1,1\n1,2,2\n",
            {},
            "line 1: columns #2, torque, and #3, torque, are both torque; say",
        ),
        (
            MotorTable,
            "time,speed,torque\n0,1,1\n1,2,2\n",
            {},
            "line 1: has time, speed, torque; must be torque over time or angle",
        ),
        (
            MotorTable,
            ",speed,torque\n0,0,1\n1,1,2\n",
            {},
            "line 1: column #1, without a name, is not known; must be torque",
        ),
        (
            MotorTable,
            "n,M\n0,0\n1,1\n",
            {"columns": {"speed": "n", "torque": "M"}},
            'line 1: column "n" has no unit; give it, as in',
        ),
        (MotorTable, "n,M\n0,0\n1,1\n", {"columns": {"speed": "N", "torque": "M"}}, "no column 'N': allowed are n, M"),
        (
            MotorTable,
            "n,M\n0,0\n1,1\n",
            {"columns": {"torque": "M"}},
            "columns: has torque; must be torque over time or angle or",
        ),
        (
            MotorTable,
            "n,M\n0,0\n1,1\n",
            {"columns": {"lift": "M"}},
            'columns = { lift = "M" }: must be a table of texts, such as {',
        ),
        (
            MotorTable,
            "n,M\n0,0\n1,1\n",
            {"columns": "M"},
            'columns = "M": must be a table of texts, such as { time = "#2", ',
        ),
        (
            MotorTable,
            "rpm,Nm\n0,0\n1,1\n",
            {"columns": {"speed": "#1", "torque": "#1"}},
            'columns.speed = "#1": must be a column of its',
        ),
        (MotorTable, "rpm,Nm\n0,0\n1,1\n", {"units": {"time": "s"}}, 'units.time = "s": the file has no time'),
        (
            MotorTable,
            "rpm,Nm\n0,0\n1,1\n",
            {"units": {"speed": "mm"}},
            'line 1: column "rpm" is in "mm"; speed must be in one of rad/s,',
        ),
        (MotorTable, "rpm,Nm\n0,0\n1,1\n", {"decimal": 5}, 'decimal = 5: must be "." or ","'),
        (MotorTable, "rpm,Nm\n0,0\n1,1\n", {"head": 0}, "head = 0: must be the number of a line, 1 or more"),
        (MotorTable, "rpm,Nm\n0,0\n1,1\n", {"event": True}, "event = true: only of valves; leave it out"),
        (
            PlaceTable,
            "s;mm\n0;0\n1;1\n",
            {},
            'line 1: column #2, "mm", is not known; must be x or y over time; say which count',
        ),
        (
            SupplyTable,
            "time,pressure [barg]\n0,1\n1,2\n",
            {},
            'line 1: column "pressure [barg]" is in "barg"; pressure must be in',
        ),
    ],
)
def test_what_is_not_clear_is_one_line(tmp_path, kind, text, said, told):
    with pytest.raises(DriveError) as caught:
        columns(tmp_path / "t.csv", text, kind, **said)
    (line,) = caught.value.errors
    assert line.startswith(told)


def test_a_drive_takes_in_a_spreadsheets_table_and_forgets_how_it_was_written(tmp_path):
    text, led = dumps_drive(two_sprockets(duration=0.001)), "{ speed = 10.0, ramp_time = 0.0 }"
    assert text.count(led) == 1
    (tmp_path / "t.txt").write_bytes("Zeit [s];Drehzahl [U/min];Öl [°C]\n0;60;80\n1;1.200;81\n".encode("latin-1"))
    named = 'columns = { time = "Zeit", speed = "#2" }, decimal = ","'
    (tmp_path / "d.toml").write_text(text.replace(led, f'{{ table = {{ file = "t.txt", {named} }} }}'))
    drive = load_drive(tmp_path / "d.toml")
    table = drive.sprockets[0].prescribed.table
    assert table.time == (0.0, 1.0) and table.speed == pytest.approx((60.0 * RPM, 1200.0 * RPM), rel=1e-15)
    written = dumps_drive(drive)
    assert loads_drive(written) == drive and not re.search(r"\bfile\b|decimal|columns", written)
    (tmp_path / "d.toml").write_text(text.replace(led, '{ table = { file = "t.txt", decimal = "," } }'))
    with pytest.raises(DriveError) as caught:
        load_drive(tmp_path / "d.toml")
    (line,) = caught.value.errors
    assert 'prescribed.table.file = "t.txt": line 1: column #3, "Öl [°C]", is not known' in line


def kinds_of_tables(kind, seen=()):
    """The kinds of tables of numbers that lie in a part, by the keys that lead to them."""
    for key, field in kind.model_fields.items():
        rest = [field.annotation]
        while rest:
            of = rest.pop()
            if isinstance(of, type) and issubclass(of, (Table, PlaceTable, LiftTable)):
                yield key, of
            elif isinstance(of, type) and issubclass(of, Part) and of not in seen:
                yield from ((f"{key}.{inner}", found) for inner, found in kinds_of_tables(of, (*seen, of)))
            rest += get_args(of)


def test_every_table_of_a_drive_may_be_a_file():
    listed = {(parts, path): kind for lists, kinds in TABLES.items() for parts in lists for path, kind in kinds.items()}
    found = {tuple(path.split(".", 1)): kind for path, kind in kinds_of_tables(Drive)}
    assert found.items() <= listed.items()
    for kind in set(listed.values()):
        for key in (*columns_of(kind).over, *columns_of(kind).of):
            assert unit_of_key(kind, key) == COLUMN_UNITS[key]
