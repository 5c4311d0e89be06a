"""Text tables of drives and measured signals: names, then numbers (docs/drive-file.md)."""

from __future__ import annotations

import csv
import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import NamedTuple

from warpchain.drive.quantities import SECOND, unit_from_text
from warpchain.drive.schema import HUGE
from warpchain.drive.toml import value_text
from warpchain.errors import WarpchainError
from warpchain.files import read_regular_file, refusal_reason

SEPARATORS = {";": "semicolons", "\t": "tabs", ",": "commas", " ": "blanks"}
"""Separators of cells, in order."""
MISSING = "must have a line of names and lines of numbers below it, of two columns at least"
MOST_PREAMBLE = 1000
"""Most lines in which a table's names are sought."""
LONGEST_HEAD = 200
"""Most characters of a head with a unit."""
GAPS = frozenset({"", "nan", "-nan", "na", "n/a", "#n/a", "#na", "#nv", "null", "1.#qnan", "-1.#ind", "1.#ind"})
"""Cells without a value, in small letters."""
SUFFIXED_NAMES = ("time", "angle", "speed", "torque", "pressure", "lift", "x", "y")
"""Names that a unit may follow after an underscore."""
TIME_NAMES = ("t", "time", "Time", "zeit", "Zeit", "temps", "Temps", "tempo", "Tempo")
"""Names that may stand before a time's unit."""
NO_TEXT = {
    b"PK\x03\x04": "a spreadsheet or an archive: save the table as CSV",
    b"\xd0\xcf\x11\xe0": "a spreadsheet: save the table as CSV",
    b"MDF     ": "MDF: its name must end in .mdf or .mf4",
    b"TDSm": "TDMS: its name must end in .tdms",
    b"MATLAB": "a MAT file: its name must end in .mat",
    b"\x89HDF": "HDF5: save the table as CSV",
}
"""First bytes of other files, with the remedy."""
_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_LOOSE_NUMBER = re.compile(
    r"[+-]?(?:[0-9][0-9.,'’\u00a0\u202f ]*|[.,][0-9]+)(?:[eE][+-]?[0-9]+)?|[+-]?inf", re.IGNORECASE
)
_SIGNED_NUMBER = re.compile(r"[+-]?(?=.*[0-9])[0-9]*([.,])[0-9]*(?:([.,])[0-9]*)?(?:[eE][+-]?[0-9]+)?")
"""A number with one or two decimal or thousands signs."""
_MAYBE_THOUSANDS = re.compile(r"[+-]?[1-9][0-9]{0,2}[.,][0-9]{3}")
_GROUPED = re.compile(r"[+-]?[0-9]{1,3}(?:(['’\u00a0\u202f ])[0-9]{3})(?:\1[0-9]{3})*(?:[.,][0-9]*)?")
DATE = r"(?:[0-9]{4}[-/.][0-9]{1,2}[-/.][0-9]{1,2}|[0-9]{1,2}[-/.][0-9]{1,2}[-/.](?:[0-9]{4}|[0-9]{2}))"
CLOCK = r"(?:[0-9]{1,2}:[0-9]{2}(?::[0-9]{2}(?:[.,][0-9]+)?)?(?: ?[AaPp][Mm])?(?: ?Z|[+-][0-9]{2}:?[0-9]{2})?)"
_INSTANT = re.compile(rf"{DATE}(?:[ T]+{CLOCK})?|{CLOCK}")
_WITH_UNIT = (
    re.compile(rf"({'|'.join(SUFFIXED_NAMES)})_(.+)", re.IGNORECASE),
    re.compile(r"(.+?)\s*(?:[/,]|\sin\s)\s*(.+)"),
)


class TableError(WarpchainError):
    """Error of a text table, in one line without the file's name."""


class Head(NamedTuple):
    """Name of a column, and its unit in the file, or ""."""

    name: str
    unit: str = ""

    def __str__(self) -> str:
        return f"{self.name} [{self.unit}]" if self.unit and self.unit != self.name else self.name


class Row(NamedTuple):
    """Cells of a text table's line, and its line number."""

    line: int
    cells: list[str]

    @property
    def width(self) -> int:
        """Number of a row's cells up to the last filled one."""
        return max((k + 1 for k, cell in enumerate(self.cells) if cell), default=0)


@dataclass(frozen=True)
class TextTable:
    """A text table as read, with text cells.

    Attributes:
        line: line number of the names.
        rows: below the names, none empty or longer than the heads.
        decimal: "." or ",".
        is_grouped: whether the other sign may stand between thousands.
    """

    heads: tuple[Head, ...]
    line: int
    rows: list[Row]
    decimal: str
    is_grouped: bool

    @property
    def names(self) -> list[tuple[str, str]]:
        """Each column's name, and name with unit."""
        return [(head.name, str(head)) for head in self.heads]

    def cells(self, column: int) -> list[str]:
        """Cells of a column, "" where missing."""
        return [row.cells[column] if column < len(row.cells) else "" for row in self.rows]

    def numbers(self, column: int) -> list[float]:
        """Numbers of a text table's column, NaN for gaps.

        Raises:
            TableError: another text.
        """
        found = []
        for row, cell in zip(self.rows, self.cells(column), strict=True):
            value = self._number(cell)
            if value is None or abs(value) > HUGE:
                other, word = (",", "points") if self.decimal == "." else (".", "commas")
                hint = f"; numbers of this file have decimal {word}, or say --decimal" if other in cell else ""
                if _is_text_row(row.cells):
                    hint = f"; say --head {row.line} if it has the names"
                raise TableError(
                    f"line {row.line}: {value_text(cell)} is not a finite number within {HUGE:g} of 0{hint}"
                )
            found.append(value)
        return found

    def _number(self, cell: str) -> float | None:
        """Number of a cell, NaN for a gap, or None."""
        if _NUMBER.fullmatch(cell) and self.decimal == "." and not self.is_grouped:
            return float(cell)
        if cell.lower() in GAPS:
            return float("nan")
        cell = cell.replace("\N{MINUS SIGN}", "-")
        if grouped := _GROUPED.fullmatch(cell):
            cell = cell.replace(grouped[1], "")
        other = "." if self.decimal == "," else ","
        if other in cell and self.is_grouped:
            sign, mark = re.escape(self.decimal), re.escape(other)
            if not re.fullmatch(rf"[+-]?[0-9]{{1,3}}(?:{mark}[0-9]{{3}})+(?:{sign}[0-9]*)?", cell):
                return None
            cell = cell.replace(other, "")
        if self.decimal == ",":
            cell = cell.replace(".", "x").replace(",", ".")
        return float(cell) if _NUMBER.fullmatch(cell) else None


def read_text_table(
    path: str | Path, decimal: str | None = None, head: int | None = None, names: Collection[str] = ()
) -> TextTable:
    """Table of a text file.

    Args:
        decimal: "." or ","; None is found.
        head: line of the names; None is found.
        names: known columns, in small letters.

    Raises:
        TableError: unreadable or ambiguous.
    """
    lines = list(enumerate(_text_lines(path), 1))
    plain = [(number, text) for number, text in lines if not _is_remark(text)]
    remarks = {number: text.lstrip("# \t") for number, text in lines[:MOST_PREAMBLE] if _is_remark(text)}
    wrong: list[TableError] = []
    for separator in SEPARATORS:
        beginning = list(_parsed_rows(plain[:MOST_PREAMBLE], separator))
        try:
            found = _find_names(beginning, remarks, separator, head, frozenset(names))
        except TableError as error:
            wrong.append(error)
            continue
        if found is not None:
            heads, line, first = found
            rows = _rows_below(plain, first, separator, len(heads))
            sign = decimal or _decimal_sign(rows, separator)
            return TextTable(tuple(heads), line, rows, sign, decimal is not None)
    if head is not None:
        raise TableError(f"line {head}: must be a line of names that stands above lines of numbers")
    raise wrong[0] if wrong else TableError(MISSING)


def column_place(names: Sequence[tuple[str, str]], wanted: str | None, default: int, option: str) -> int:
    """Index of a text table's column by name or number "#2".

    Args:
        wanted: None takes `default`.
        option: of the command line, for messages.

    Raises:
        TableError: no single column of that name.
    """
    if wanted is None:
        if default >= len(names):
            raise TableError("has one column: must have a time and values")
        wanted = names[default][0]
        if not wanted:
            raise TableError(f"column #{default + 1} has no name: say --{option} '#{default + 1}', or another")
    numbered = [(name, whole, f"#{k + 1}") for k, (name, whole) in enumerate(names)]
    for form in range(3):
        at = [k for k, forms in enumerate(numbered) if forms[form] == wanted]
        if len(at) > 1:
            all_of = " and ".join(f"{numbered[k][2]}, {numbered[k][1]}" for k in at)
            raise TableError(f"{wanted!r} names the columns {all_of}: say --{option} '#{at[0] + 1}', or another")
        if at:
            return at[0]
    raise TableError(f"no column {wanted!r}: allowed are {', '.join(name for name, _ in names)}")


def options_as_keys(text: str) -> str:
    """A table's refusal, with keys for command line options."""
    return re.sub(r"say --([a-z]+)-?([a-z]*)", lambda found: f"give {'_'.join(filter(None, found.groups()))}", text)


def head_of_cell(cell: str) -> Head:
    """Name and unit in a cell of a table's names."""
    text = " ".join(cell.split())
    if len(text) > LONGEST_HEAD:
        return Head(text)
    if unit_from_text(text):
        return Head(text, text)
    if found := re.fullmatch(r"(.*?)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))", text):
        its = (found[2] or found[3] or "").strip()
        return Head(found[1] or its, its)
    for form in _WITH_UNIT:
        if (found := form.fullmatch(text)) and (its := unit_from_text(found[2])):
            if its.powers == SECOND and "/" in text and found[1] not in TIME_NAMES:
                return Head(text, text)  # not n in minutes, but a number a minute
            return Head(found[1], found[2])
    return Head(text)


# ----------------------------------------------------------------------------------------------------------- text


def _text_lines(path: str | Path) -> list[str]:
    """Lines of a text table's file."""
    try:
        data = read_regular_file(path)
    except (OSError, ValueError) as refused:  # a name with a zero byte is a ValueError
        raise TableError(f"cannot be read: {refusal_reason(refused).lower()}") from None
    for begin, kind in NO_TEXT.items():
        if data.startswith(begin):
            raise TableError(f"is {kind}")
    lines = re.split(r"\r\n|\n|\r", _text_of_bytes(data))
    for number, line in enumerate(lines, 1):
        if "\0" in line:
            raise TableError(f"line {number}: has a zero byte: must be text")
    return lines


def _text_of_bytes(data: bytes) -> str:
    """Text of bytes: UTF-8, UTF-16, else Windows-1252."""
    marks = {b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16"}
    wide = marks.get(data[:2])
    if wide is None and len(data) > 1 and (data[0] == 0) != (data[1] == 0):
        wide = "utf-16-le" if data[1] == 0 else "utf-16-be"
    if wide is not None:
        try:
            return data.decode(wide)
        except UnicodeDecodeError as error:
            raise TableError(f"byte {error.start} is not UTF-16") from None
    for encoding in ("utf-8-sig", "cp1252"):
        try:
            return data.decode(encoding)
        except UnicodeDecodeError:
            pass
    return data.decode("latin-1")


def _is_remark(line: str) -> bool:
    """Whether a text table's line is a remark, behind # but no gap."""
    return line.lstrip().startswith("#") and re.split(r"[;\t, ]", line.strip())[0].lower() not in GAPS


def _parsed_rows(lines: Sequence[tuple[int, str]], separator: str) -> Iterator[Row]:
    """Rows of a text table's numbered lines."""
    texts = (text for _, text in lines)
    if separator == " ":
        texts = (_with_few_blanks(text) for text in texts)
    reader = csv.reader((f"{text}\n" for text in texts), delimiter=separator)
    begin = 0
    try:
        for cells in reader:
            yield Row(lines[begin][0], [cell.strip() for cell in cells])
            begin = reader.line_num
    except csv.Error as error:  # a cell of more than 131,072 characters, say
        raise TableError(f"line {lines[begin][0]}: is not CSV ({error})") from None


def _with_few_blanks(text: str) -> str:
    """Line of a text table with single blanks, none before units."""
    text = re.sub(r"\[[^\[\]]*\]|\([^()]*\)", lambda unit_of: unit_of[0].replace(" ", "·"), " ".join(text.split()))
    text = text.replace(" / ", "/")
    return re.sub(r"(?<=[^\s\])]) (?=[\[(])", "", text)


# ---------------------------------------------------------------------------------------------------------- names


def _find_names(
    rows: list[Row], remarks: dict[int, str], separator: str, head: int | None, names: frozenset[str]
) -> tuple[list[Head], int, int] | None:
    """Heads of a text table, their line, and the first numbers'; or None.

    Raises:
        TableError: several lines of names, or none.
    """
    if head is not None:
        return _names_at(rows, remarks, separator, head)
    wrong: TableError | None = None
    for k, row in enumerate(rows):
        if not _is_number_row(row.cells):
            continue
        block = _rows_above(rows, k)
        if not block and row.line - 1 in remarks:  # "# time, force"
            block = list(_parsed_rows([(row.line - 1, remarks[row.line - 1])], separator))
        wide = [i for i, above in enumerate(block) if above.width >= row.width and len(above.cells) > 1]
        if wide:
            i = _names_place(block, wide, names)
            return _heads_of_rows(block[i:]), block[i].line, row.line
        if wrong is None:
            wrong = _misplaced_numbers(rows[:k], row, block, separator)
    if wrong is not None:
        raise wrong
    return None


def _misplaced_numbers(above: list[Row], row: Row, block: list[Row], separator: str) -> TableError:
    """Refusal of numbers without names directly above."""
    if block:
        text = "; decimal commas need semicolons or tabs between the columns" if separator == "," else ""
        return TableError(f"line {row.line}: has {row.width} cells below {block[-1].width} names{text}")
    last = next((before for before in reversed(above) if before.width), None)
    text = "nothing is above it" if last is None else f"above it is {value_text(separator.join(last.cells))}"
    return TableError(
        f"line {row.line}: numbers begin, and no line of names is above them; {text}; say --head LINE, of the names"
    )


def _names_at(
    rows: list[Row], remarks: dict[int, str], separator: str, head: int
) -> tuple[list[Head], int, int] | None:
    """Heads in a given line, and the first numbers' line; or None."""
    own = _parsed_rows([(head, remarks[head])], separator) if head in remarks else rows
    names = next((row for row in own if row.line == head), None)
    below = [row for row in rows if row.line > head and row.width]
    first = next((row for row in below if _is_number_row(row.cells)), None)
    if names is None or first is None or first.width > names.width:
        return None
    units = [*takewhile(lambda row: row is not first and _is_text_row(row.cells), below)]
    return _heads_of_rows([names, *units]), head, first.line


def _kind_of_cell(cell: str) -> str:
    """Kind of a table's cell: "gap", "number" (also date or time) or "text"."""
    if cell.lower() in GAPS:
        return "gap"
    cell = cell.replace("\N{MINUS SIGN}", "-")
    return "number" if _LOOSE_NUMBER.fullmatch(cell) or _INSTANT.fullmatch(cell) else "text"


def _is_number_row(cells: list[str]) -> bool:
    """Whether a table's line is of numbers."""
    kinds = [kind for kind in map(_kind_of_cell, cells) if kind != "gap"]
    return len(cells) > 1 and kinds[:1] == ["number"] and ("text" not in kinds or kinds.count("number") > 1)


def _rows_above(rows: list[Row], k: int) -> list[Row]:
    """Rows of text directly above row k of a table."""
    above = rows[:k]
    while above and not above[-1].width:
        above.pop()
    return [*takewhile(lambda row: row.width and _is_text_row(row.cells), reversed(above))][::-1]


def _is_text_row(cells: list[str]) -> bool:
    """Whether no cell of a table's line is a number."""
    filled = [cell for cell in cells if cell]
    return all(_kind_of_cell(cell) == "text" or (k and cell in ("1", "-")) for k, cell in enumerate(filled))


def _names_place(block: list[Row], wide: list[int], names: frozenset[str]) -> int:
    """Index of the line of names above a table's numbers."""
    said = [i for i in wide if _says_names(block[i].cells, names) and not _is_unit_row(block[i].cells)]
    if said:
        return said[-1]
    bare = [[_cell_without_brackets(cell) for cell in row.cells] for row in block]
    units = [i for i, cells in enumerate(bare) if any(map(unit_from_text, cells))]
    if units:
        return next((i for i in reversed(wide) if i < units[-1]), wide[-1])
    if len(wide) == 1:
        return wide[0]
    lines = " and ".join(str(block[i].line) for i in wide[-2:])
    raise TableError(f"lines {lines} may both be the names: say --head {block[wide[-1]].line}, or another")


def _says_names(cells: list[str], names: frozenset[str]) -> bool:
    """Whether a text table's line has known names or units."""
    heads = [head_of_cell(cell) for cell in cells]
    return any(head.name.lower() in names or (unit_from_text(head.unit) and head.unit != head.name) for head in heads)


def _is_unit_row(cells: list[str]) -> bool:
    """Whether all cells of a table's line are units."""
    bare = [_cell_without_brackets(cell) for cell in cells if cell]
    return all(unit_from_text(cell) or cell in ("1", "") for cell in bare)


def _cell_without_brackets(cell: str) -> str:
    """Text of a table's cell without brackets around it."""
    return cell.strip(" []()")


def _heads_of_rows(rows: list[Row]) -> list[Head]:
    """Heads of a text table from rows of names and units."""
    heads = [head_of_cell(cell) for cell in rows[0].cells[: rows[0].width]]
    below = rows[1].cells if len(rows) > 1 else []
    if below and (_is_unit_row(below) or not any(head.unit not in ("", head.name) for head in heads)):
        units = ["-" if cell == "1" else _cell_without_brackets(cell) for cell in below] + len(heads) * [""]
        heads = [
            Head(head.name, own if own and head.unit in ("", head.name) else head.unit)
            for head, own in zip(heads, units, strict=False)
        ]
    return heads


# ------------------------------------------------------------------------------------------------------- numbers


def _rows_below(lines: list[tuple[int, str]], first: int, separator: str, count: int) -> list[Row]:
    """Rows of a text table from a line on; raises a TableError for too many cells."""
    below = [line for line in lines if line[0] >= first and line[1].strip()]
    rows = [row for row in _parsed_rows(below, separator) if any(row.cells)]
    for row in rows:
        if len(row.cells) > count and row.width > count:
            text = "; decimal commas need semicolons or tabs between the columns" if separator == "," else ""
            raise TableError(f"line {row.line}: has {row.width} cells below {count} names{text}")
    return rows


def _decimal_sign(rows: list[Row], separator: str) -> str:
    """Decimal sign of a text table's numbers, by default a point."""
    if separator == ",":
        return "."
    first: dict[str, tuple[int, str]] = {}
    is_sure = False
    for row in rows:
        for cell in row.cells:
            found = _SIGNED_NUMBER.fullmatch(cell) if "." in cell or "," in cell else None
            if found is None or found[1] == found[2]:  # 24.12.2026 is a date
                continue
            is_sure = is_sure or not _MAYBE_THOUSANDS.fullmatch(cell)
            for sign in filter(None, found.groups()):
                first.setdefault(sign, (row.line, cell))
        if len(first) == 2:
            (one, this), (other, that) = first.values()
            both = f"{that}, but line {one} has {this}" if this != that else that
            raise TableError(
                f"line {other}: {both}: numbers of one file have points and commas; say --decimal , or . and the other "
                "sign is for thousands"
            )
    if first and not is_sure:
        ((sign, (line, cell)),) = first.items()
        raise TableError(
            f"line {line}: {cell} may be {cell.replace(sign, '')}, as all numbers here; say --decimal , or ."
        )
    return next(iter(first), ".")
