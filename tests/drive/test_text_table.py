"""Text tables as spreadsheets and measurement systems write them: what each convention means, and what is refused."""

import math
import time

import pytest

from warpchain.drive.quantities import unit_factor
from warpchain.drive.text_table import TableError, head_of_cell, read_text_table

ROWS = [[0.0, -1.5], [0.5, 1249.0], [1.0, 0.25]]


def read(path, data, **said):
    """A table's heads and numbers, of a file of these bytes, or of this text as UTF-8."""
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    table = read_text_table(path, **said)
    return [str(head) for head in table.heads], [list(row) for row in zip(*map(table.numbers, range(2)), strict=True)]


CONVENTIONS = {
    "commas": "t [s],F [N]\n0,-1.5\n0.5,1249\n1,0.25\n",
    "semicolons": "t [s];F [N]\n0;-1.5\n0.5;1249\n1;0.25\n",
    "decimal commas": "t [s];F [N]\n0;-1,5\n0,5;1249\n1;0,25\n",
    "tabs": "t [s]\tF [N]\n0\t-1,5\n0,5\t1249\n1\t0,25\n",
    "blanks": "  t [s]   F [N]\n 0.0  -1.5\n 0.5   1249\n 1.0 .25\n",
    "blanks with decimal commas": "t [s] F [N]\n0 -1,5\n0,5 1249\n1 0,25\n",
    "line ends of two signs": "t [s],F [N]\r\n0,-1.5\r\n0.5,1249\r\n1,0.25\r\n",
    "line ends of old": "t [s],F [N]\r0,-1.5\r0.5,1249\r1,0.25",
    "a line of units": "t;F\ns;N\n0;-1,5\n0,5;1249\n1;0,25\n",
    "a line of units in brackets and an empty one": "t,F\n[s],(N)\n\n0,-1.5\n0.5,1249\n1,0.25\n",
    "units behind slashes": "t / s;F/N\n0;-1,5\n0,5;1249\n1;0,25\n",
    "units behind commas": '"t, s","F, N"\n0,-1.5\n0.5,1249\n1,0.25\n',
    "units behind in": "t in s;F in N\n0;-1,5\n0,5;1249\n1;0,25\n",
    "quotes and a line end in a name": '"t\n[s]";"F\n[N]"\n"0";"-1,5"\n"0,5";"1249"\n"1";"0,25"\n',
    "thousands by blanks": "t [s];F [N]\n0;-1,5\n0,5;1\u00a0249,0\n1;0,25\n",
    "thousands by apostrophes": "t [s];F [N]\n0;-1.5\n0.5;1'249\n1;0.25\n",
    "exponents and signs": "t [s],F [N]\n0e0,-1.5E+00\n+5e-1,1.249e3\n1.,25e-2\n",
    "a long minus": "t [s];F [N]\n0;−1,5\n0,5;1249\n1;0,25\n",
    "cells beyond": "t [s],F [N],,\n0,-1.5,,\n0.5,1249,,\n1,0.25,,\n,,,\n",
    "remarks": "# rig\nt [s],F [N]\n# begin\n0,-1.5\n\n0.5,1249\n1,0.25\n",
    "names in a remark": "# t [s], F [N]\n0, -1.5\n0.5, 1249\n1, 0.25\n",
    "a preamble": 'Rig 7 "left";;\nRate;1000\nDate;24.12.2026;10:00\n\nt [s];F [N]\n0;-1,5\n0,5;1249\n1;0,25\n',
    "numbers of channels": "1;2\nt [s];F [N]\n0;-1,5\n0,5;1249\n1;0,25\n",
    "a line of notes below the units": "t;F\ns;N\nraw;filter 2\n0;-1,5\n0,5;1249\n1;0,25\n",
}


@pytest.mark.parametrize("text", CONVENTIONS.values(), ids=CONVENTIONS)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be"])
def test_the_same_table_in_each_convention(tmp_path, text, encoding):
    assert read(tmp_path / "t.csv", text.encode(encoding)) == (["t [s]", "F [N]"], ROWS)


@pytest.mark.parametrize("encoding", ["latin-1", "cp1252"])
def test_signs_of_windows_and_of_latin_1(tmp_path, encoding):
    text = "Prüfstand;\nWinkel [°];Weg [µm]\n0;-1,5\n0,5;1249\n1;0,25\n"
    assert read(tmp_path / "t.csv", text.encode(encoding)) == (["Winkel [°]", "Weg [µm]"], ROWS)


@pytest.mark.parametrize(
    ("cell", "name", "unit"),
    [
        ("Speed [rpm]", "Speed", "rpm"),
        ("Force (left) [kN]", "Force (left)", "kN"),
        ("n / min⁻¹", "n", "min⁻¹"),
        ("M/Nm", "M", "Nm"),
        ("U/min", "U/min", "U/min"),
        ("t/min", "t", "min"),
        ("T/min", "T/min", "T/min"),  # not T in minutes: a unit that is not known, so it is refused where it counts
        ("Hübe / s", "Hübe / s", "Hübe / s"),
        ("rpm", "rpm", "rpm"),
        ("[mm]", "mm", "mm"),
        ("p [bar(g)]", "p", "bar(g)"),
        ("F (N m)", "F", "N m"),
        ("F []", "F", ""),
        ("speed_rpm", "speed", "rpm"),
        ("Angle_deg", "Angle", "deg"),
        ("p_m", "p_m", ""),
        ("x/y", "x/y", ""),
        ("Weg in mm", "Weg", "mm"),
        ("torque (motor B)", "torque", "motor B"),  # no unit that is known, so it is refused where it counts
    ],
)
def test_names_and_their_units(cell, name, unit):
    assert head_of_cell(cell) == (name, unit)


@pytest.mark.parametrize(
    ("words", "wanted", "value"),
    [
        ("rpm, RPM, U/min, 1/min, min^-1, min⁻¹, min-1, r/min, rev/min, r.p.m.", "rad/s", math.pi / 30.0),
        ("deg/s, °/s", "rad/s", math.pi / 180.0),
        ("deg, °, °CA, °KW, °NW, deg crank, deg cam, ° KW", "rad", math.pi / 180.0),
        ("kgf, kp", "N", 9.80665),
        ("daN", "N", 10.0),
        ("min", "s", 60.0),
        ("in, inch, inches", "m", 0.0254),
        ("lbf", "N", 0.45359237 * 9.80665),
        ("lbf-ft, ft-lbf, lbf ft, lb-ft", "N m", 0.45359237 * 9.80665 * 0.3048),
        ("lbf-in, in lbf, lbf in", "N m", 0.45359237 * 9.80665 * 0.0254),
        ("Nm, N·m, N*m, N.m, N-m, N⋅m, N m", "N m", 1.0),
        ("psi", "Pa", 0.45359237 * 9.80665 / 0.0254**2),
        ("mbar, hPa", "Pa", 100.0),
        ("mm²/s, mm^2/s", "m^2/s", 1e-6),
    ],
)
def test_units_by_their_definitions_however_they_are_spelled(words, wanted, value):
    for word in words.split(", "):
        assert unit_factor(word, wanted) == pytest.approx(value, rel=1e-14), word


@pytest.mark.parametrize("word", ["1/s", "Grad", "NM", "barg", "lb", "mil", "", "2", "N/(m"])
def test_words_that_may_mean_two_units_are_none(word):
    assert all(unit_factor(word, wanted) is None for wanted in ("rad/s", "rad", "N m", "Pa", "N", "m", "s"))


REFUSED = {
    "nothing": ("", "must have a line of names and lines of numbers below it, of two columns at least"),
    "names alone": ("t,F\n", "must have a line of names and lines of numbers below it, of two columns at least"),
    "no names": ("0,1\n1,2\n", "line 1: numbers begin, and no line of names is above them; nothing is above it; say"),
    "rates below the names": (
        "t\tF\nHz\t1000\n0,5\t1,5\n",
        "line 3: numbers begin, and no line of names is above them; ",
    ),
    "two tables": (
        "No;k\n1;2\n\nt [s];F [N]\n0;1,5\n",
        'line 4: "t [s]" is not a finite number within 1e+30 of 0; say --he',
    ),
    "a wrong first number": (
        "t,F\n0,x\n1,2\n",
        "line 3: numbers begin, and no line of names is above them; above it is",
    ),
    "a wrong number": ("t,F\n0,1\n1,x\n", 'line 3: "x" is not a finite number within 1e+30 of 0'),
    "a text in the middle": ("t,F\n0,1\nx,y\n1,2\n", 'line 3: "x" is not a finite number'),
    "a foot": ("t,F\n0,1\n1,2\nend of data\n", 'line 4: "end of data" is not a finite number'),
    "underscores": ("t,F\n0,1_000\n1,2\n", "line 3: numbers begin, and no line of names is above them"),
    "infinite": ("t,F\n0,1\n1,inf\n", 'line 3: "inf" is not a finite number'),
    "points and commas": (
        "t;F\n0;1,5\n1;2.5\n",
        "line 3: 2.5, but line 2 has 1,5: numbers of one file have points and c",
    ),
    "points or thousands": (
        "t;F\n0;1.249\n1;2.500\n",
        "line 2: 1.249 may be 1249, as all numbers here; say --decimal , or .",
    ),
    "commas or thousands": ("t\tF\n0\t1,249\n1\t2\n", "line 2: 1,249 may be 1249, as all numbers here; say --decimal"),
    "more numbers than names": (
        "t,F\n0,0,1,5\n",
        "line 2: has 4 cells below 2 names; decimal commas need semicolons or tabs",
    ),
    "a longer line": ("t;F\n0;1\n1;2;3\n", "line 3: has 3 cells below 2 names"),
    "two lines of names": (
        "Tester;Meier\nZeit;Kraft\n0;1\n",
        "lines 1 and 2 may both be the names: say --head 2, or another",
    ),
    "zero bytes": ("t,F\n0,1\n1,\0\n", "line 3: has a zero byte: must be text"),
    "half a sign": (b"\xff\xfet\0;\0F", "byte 6 is not UTF-16"),
    "a workbook": (b"PK\x03\x04rest", "is a spreadsheet or an archive: save the table as CSV"),
    "MDF by another name": (b"MDF     4.10", "is MDF: its name must end in .mdf or .mf4"),
    "one column": ("t\n0\n1\n", "must have a line of names and lines of numbers below it, of two columns at least"),
    "a number of a line that is none": (
        "t,F\n0,1\n",
        "line 2: must be a line of names that stands above lines of numbers",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_not_clear_is_one_line(tmp_path, case):
    text, told = REFUSED[case]
    with pytest.raises(TableError) as caught:
        read(tmp_path / "t.csv", text, head=2 if "number of a line" in case else None)
    assert str(caught.value).startswith(told) and "\n" not in str(caught.value)


def test_what_is_said_goes_before_what_is_found(tmp_path):
    """The sign before decimals, the line of the names and a known name."""
    path = tmp_path / "t.csv"
    assert read(path, "t;F\n0;1.249\n1;2.500\n", decimal=",")[1] == [[0.0, 1249.0], [1.0, 2500.0]]
    assert read(path, "t;F\n0;1.249\n1;2.500\n", decimal=".")[1] == [[0.0, 1.249], [1.0, 2.5]]
    assert read(path, 't,F\n0,"1.249,5"\n1,2\n', decimal=",")[1] == [[0.0, 1249.5], [1.0, 2.0]]
    two = "Tester;Meier\nZeit;Kraft\n0;1\n1;2\n"
    assert read(path, two, head=2)[0] == read(path, two, names={"kraft"})[0] == ["Zeit", "Kraft"]
    assert read(path, "No;k\n1;2\n\nt;F\ns;N\n0;1,5\n", head=4) == (["t [s]", "F [N]"], [[0.0, 1.5]])
    assert read(path, "t [s]\tF [N]\nHz\t1000\n0,5\t1,5\n", head=1) == (["t [s]", "F [N]"], [[0.5, 1.5]])
    assert read(path, "# t [s], F [N]\n# rig 7\n0,1.5\n", head=1) == (["t [s]", "F [N]"], [[0.0, 1.5]])


@pytest.mark.parametrize("sign", "[(/ ,;")
def test_long_lines_of_one_sign_are_refused_at_once(tmp_path, sign):
    """100,000 signs: an expression that goes back over them took minutes; they take well below 5 s of the processor."""
    begin = time.process_time()
    with pytest.raises(TableError):
        read(tmp_path / "t.csv", f"t{100_000 * sign}\n0 1\n1 2\n")
    assert time.process_time() - begin < 5.0


def test_gaps_are_no_numbers_and_no_mistakes(tmp_path):
    cells = ["", "NaN", "n/a", "#N/A", "#NV", "-1.#IND", "NULL"]
    text = "t;F\n" + "".join(f"{k};{cell}\n" for k, cell in enumerate(cells)) + "7;1,5\n"
    numbers = read(tmp_path / "t.csv", text)[1]
    assert [row[0] for row in numbers] == [*range(8)]
    assert all(math.isnan(row[1]) for row in numbers[:7]) and numbers[7][1] == 1.5
