"""Times of measured signals: dates and times of day as seconds, equal times spread."""

from __future__ import annotations

import re
from datetime import date

import numpy as np

from warpchain.drive.text_table import CLOCK, DATE, GAPS, TableError, TextTable
from warpchain.results.measured_columns import Array

_INSTANT = re.compile(rf"(?P<date>{DATE})?(?:(?:^|[ T]+)(?P<clock>{CLOCK}))?")
_CLOCK_PARTS = re.compile(
    r"(\d+):(\d+)(?::(\d+)(?:[.,](\d+))?)?(?: ?([AaPp])[Mm])?(?: ?(Z)|([+-])(\d{2}):?(\d{2}))?", re.ASCII
)
_ORDERS = {"year first": (0, 1, 2), "day first": (2, 1, 0), "month first": (2, 0, 1)}


def has_clock(table: TextTable, column: int) -> bool:
    """Whether a measured column holds dates or times."""
    first = next((cell for cell in table.cells(column) if cell.lower() not in GAPS), "")
    return bool(first and re.search("[-/.:].*[-/.:]|:", first) and _INSTANT.fullmatch(first))


def clock_seconds(table: TextTable, column: int) -> Array:
    """Seconds (rows,) of a measured column's dates or times.

    A date beside a column of times of day is read with it.

    Raises:
        TableError: a cell that is none, or a date that may mean two days.
    """
    cells = table.cells(column)
    if not any(":" in cell for cell in cells) and column + 1 < len(table.heads) and has_clock(table, column + 1):
        cells = [f"{day} {time}".strip() for day, time in zip(cells, table.cells(column + 1), strict=True)]
    lines = [row.line for row in table.rows]
    parts: list[re.Match[str] | None] = []
    for line, cell in zip(lines, cells, strict=True):
        found = _INSTANT.fullmatch(cell)
        if found is None and cell.lower() not in GAPS:
            raise TableError(f"line {line}: {cell!r} is no date or time of day like those above")
        parts.append(found if cell.lower() not in GAPS else None)
    days = _day_numbers([part["date"] if part else None for part in parts], lines)
    # days and seconds are subtracted apart: an instant of this century would leave few digits for microseconds
    day = np.array(days, dtype=float)
    clock = np.array(
        [
            _seconds_of_day(part["clock"] or "0:00", line) if part else np.nan
            for part, line in zip(parts, lines, strict=True)
        ]
    )
    timed = np.flatnonzero(~np.isnan(clock))
    first = timed[0] if len(timed) else 0
    return 86400.0 * (day - day[first]) + (clock - clock[first])


def _day_numbers(dates: list[str | None], lines: list[int]) -> list[int]:
    """Day numbers of measured dates, 0 for none.

    Raises:
        TableError: a date that is none, or day and month that cannot be told apart.
    """
    given = {text for text in dates if text is not None}
    words = {text: [int(word) for word in re.split(r"[-/.]", text)] for text in given}
    orders = ["day first", "month first"]
    if any(len(re.split(r"[-/.]", text)[0]) == 4 for text in given):
        orders = ["year first"]
    elif any("." in text for text in given):  # 24.12.2026
        orders = ["day first"]
    read: dict[str, dict[str, int]] = {}
    for order in orders:
        try:
            read[order] = {text: _day_number(words[text], _ORDERS[order]) for text in given}
        except ValueError:
            continue
    if not read and given:
        k = next(k for k, text in enumerate(dates) if text is not None)
        raise TableError(f"line {lines[k]}: {dates[k]}, or a date below it, is no day of a calendar")
    if len(read) == 2 and len(given) > 1:
        k = next(k for k, text in enumerate(dates) if text is not None)
        raise TableError(f"line {lines[k]}: {dates[k]} may have the day or the month first: write dates as 2026-12-24")
    days = next(iter(read.values()), {})
    return [days[text] if text is not None else 0 for text in dates]


def _day_number(words: list[int], order: tuple[int, int, int]) -> int:
    """Day number of a date's three numbers; raises ValueError."""
    year, month, day = (words[place] for place in order)
    return date(year + 2000 if year < 100 else year, month, day).toordinal()


def _seconds_of_day(text: str, line: int) -> float:
    """Seconds from midnight of a time of day.

    Raises:
        TableError: there is no such time of day.
    """
    found = _CLOCK_PARTS.fullmatch(text)
    assert found is not None  # by the pattern of an instant
    hour, minute, second = (int(found[k] or 0) for k in (1, 2, 3))
    if found[5]:
        hour = hour % 12 + (12 if found[5] in "Pp" else 0) if 1 <= hour <= 12 else 24
    if hour > 23 or minute > 59 or second > 59:
        raise TableError(f"line {line}: {text} is no time of day")
    away = int(found[8] or 0) * 3600 + int(found[9] or 0) * 60
    fraction = float(f"0.{found[4]}") if found[4] else 0.0
    return hour * 3600 + minute * 60 + second - (away if found[7] != "-" else -away) + fraction


def spread_equal_times(time: Array) -> Array:
    """Times (K,) of a measured signal, equal ones spread evenly."""
    starts = np.flatnonzero(np.append(True, np.diff(time) > 0.0))
    ends = np.append(time[starts[1:]], 0.0)
    counts = np.diff(np.append(starts, len(time)))
    ends[-1] = time[-1] + counts[-1] * (ends[-2] - time[starts[-2]]) / counts[-2]
    steps = (ends - time[starts]) / counts
    return time + (np.arange(len(time)) - np.repeat(starts, counts)) * np.repeat(steps, counts)
