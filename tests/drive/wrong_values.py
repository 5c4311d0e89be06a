"""Rules of drive files as rows: a key, its wrong values, and the text that is said of each."""

import json

import pytest
from drives import errors_of, put


def key_of(values, path):
    """A path as errors name it: a part of a list by its name, unless the name itself is wrong."""
    kind, *rest = path.split("/")
    if len(rest) > 1 and rest[1] != "name" and isinstance(values[kind], list):
        rest[0] = values[kind][int(rest[0])]["name"]
    return ".".join((kind, *rest))


def wrong(values, *rows):
    """Path, value and the beginning of its error, for each value of rows (path, values, text); None is missing."""
    cases = []
    for path, several, text in rows:
        for value in several:
            shown = json.dumps(value) if isinstance(value, bool | str) else repr(value)
            said = "missing; " if value is None else ""
            line = key_of(values, path) + (f": {said}" if value is None else f" = {shown}: ") + text
            cases.append(pytest.param(path, value, line, id=f"{path}={value!r}"[:60]))
    return cases


def lines_of(values, path, value, line):
    """The errors of a drive with one wrong value, one of which begins so."""
    put(values, path, value)
    found = errors_of(values)
    assert any(error.startswith(line) for error in found), found
    return found
