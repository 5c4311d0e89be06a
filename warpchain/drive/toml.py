"""TOML text of nested tables, as drive files have them."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from warpchain.argument_checks import number_text
from warpchain.errors import drive_error

_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")
_PLACE = re.compile(r" \(at (.*)\)$")
_LONGEST = 60


def parse_toml(text: str, source: str) -> dict[str, Any]:
    """Tables of a TOML text.

    Raises:
        DriveError: no TOML; names line and column.
    """
    try:
        return tomllib.loads(text)
    except ValueError as error:  # also a number with too many digits, which has no place
        message = str(error)
        place = _PLACE.search(message)
        reason = _PLACE.sub("", message)
        where = f"{place.group(1)}: " if place else ""
        raise drive_error([f"{where}not TOML: {reason[:1].lower()}{reason[1:]}"], source) from None
    except RecursionError:
        raise drive_error(["not TOML that can be read: nested too deeply"], source) from None


def toml_text(tables: Mapping[str, Any]) -> str:
    """TOML text of tables, floats with every bit."""
    alone = {name: value for name, value in tables.items() if not isinstance(value, Mapping | list | tuple)}
    rest = {name: value for name, value in tables.items() if name not in alone}
    blocks = [list(_key_lines(alone))] if alone else []
    return "\n\n".join("\n".join(block) for block in [*blocks, *_table_blocks(rest, ())]) + "\n"


def _table_blocks(tables: Mapping[str, Any], above: tuple[str, ...]) -> Iterator[list[str]]:
    """Lines of a TOML table, then of those below it."""
    for name, value in tables.items():
        head = ".".join(_toml_key(word) for word in (*above, name))
        if isinstance(value, Mapping) and value and all(isinstance(inner, Mapping) for inner in value.values()):
            yield from _table_blocks(value, (*above, name))
        elif isinstance(value, Mapping):
            yield [f"[{head}]", *_key_lines(value)]
        else:
            for element in value:
                yield [f"[[{head}]]", *_key_lines(element)]


def _key_lines(table: Mapping[str, Any]) -> Iterator[str]:
    """Lines `key = value` of a TOML table."""
    for key, value in table.items():
        yield f"{_toml_key(key)} = {inline_value(value)}"


def _toml_key(key: str) -> str:
    """TOML key, quoted if needed."""
    return key if _BARE_KEY.fullmatch(key) else _quoted_text(key)


def _quoted_text(text: str) -> str:
    """A text in TOML's quotes."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def inline_value(value: Any, real: Callable[[float], str] = float.__repr__) -> str:
    """A value in TOML, its floats written by `real`.

    Raises:
        TypeError: no type of TOML.
    """
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return int.__repr__(value)
    if isinstance(value, float):
        return real(value)
    if isinstance(value, str):
        return _quoted_text(value)
    if isinstance(value, Mapping):
        pairs = ", ".join(f"{_toml_key(str(key))} = {inline_value(inner, real)}" for key, inner in value.items())
        return f"{{ {pairs} }}" if pairs else "{}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(inline_value(element, real) for element in value) + "]"
    raise TypeError(f"no TOML for {type(value).__name__}")


def key_text(word: str) -> str:
    """A key in an error line, quoted if needed."""
    return word if word.isprintable() else _quoted_text(word)


def value_text(value: Any) -> str:
    """A value in an error line, as TOML if possible, shortened."""
    try:
        text = inline_value(value.item() if getattr(value, "ndim", None) == 0 else value, number_text)
    except TypeError:
        text = str(value) if hasattr(value, "isoformat") else repr(value)
    except ValueError:  # python writes no integers of more than some thousand digits
        text = "a number of thousands of digits"
    text = " ".join(text.split())
    return text if len(text) <= _LONGEST else text[: _LONGEST - 4] + " ..."
