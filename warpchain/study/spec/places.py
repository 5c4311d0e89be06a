"""Names of places in a study file, for messages: entries of lists go by their own names or metrics, not by an index."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

from warpchain.drive.schema import elements, get, is_name
from warpchain.drive.toml import value_text, word_text
from warpchain.study.spec.study_tables import of_file

_NOUNS = {
    "factors": ("factor", ""),
    "constraints": ("constraint", ""),
    "adjust": ("adjustment", ""),
    "objectives": ("objective", "objective"),
    "bounds": ("limit", "limit on"),
    "measured": ("measurement", "measurement of"),
}
"""An entry of each list by its number, and by its metric or signal."""
_NAMES = {"factors": "name", "adjust": "chain"}
"""Keys of the names that entries have in key paths."""


def places(study: Any) -> Callable[[Sequence[str | int]], str]:
    """A function that words a key path into a study, or into the mapping that should become one.

    An entry is one of its own name, `factors.torque.range`, `limit on "slack": max`; where that name is at issue, not
    unique or missing, one of its number, from 1: `limit 2: metric`. So is a value of a list, `value 1 of metrics.keep`.
    """
    values = of_file(study)
    known: dict[str, Counter[str]] = {}

    def place(path: Sequence[str | int]) -> str:
        head, number, *rest = str(path[0]), *(path[1:] or ("",))
        entries = elements(values, head)
        if head not in _NOUNS or not isinstance(number, int):
            return _path(*path)
        if head == "adjust" and len(entries) == 1:
            return _path(head, *rest)
        if head not in known:
            known[head] = Counter(_own(head, entry)[1] for entry in entries)
        key, own = _own(head, entries[number])
        noun, on = _NOUNS[head]
        if not own or known[head][own] > 1 or (on and rest == [key]):
            words = f"{noun} {number + 1}"
        elif on:
            words = f"{on} {value_text(own)}"
        else:
            return _path(head, own, *rest)
        return f"{words}: {_path(*rest)}" if rest else words

    return place


def _path(*keys: str | int) -> str:
    text = word_text(str(keys[0]))
    for key in keys[1:]:
        text = f"value {key + 1} of {text}" if isinstance(key, int) else f"{text}.{word_text(key)}"
    return text


def _own(head: str, entry: Any) -> tuple[str, str]:
    """The key that an entry of a list goes by, and its value; "" where there is none that can stand in a line."""
    if head in _NAMES:
        name = get(entry, _NAMES[head])
        return _NAMES[head], name if is_name(name) else ""
    keys = [key for key in ("metric", "signal") if isinstance(get(entry, key), str) and get(entry, key)]
    return (keys[0], get(entry, keys[0])) if keys and _NOUNS[head][1] else ("", "")
