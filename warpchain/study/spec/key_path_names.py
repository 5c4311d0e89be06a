"""Names of key paths of a study file in messages: entries of lists go by their own names."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

from warpchain.drive.schema import is_name, node_list, node_value
from warpchain.drive.toml import key_text, value_text
from warpchain.study.spec.study_tables import fields_from_file

_ENTRY_NOUNS = {
    "factors": ("factor", ""),
    "constraints": ("constraint", ""),
    "adjust": ("adjustment", ""),
    "objectives": ("objective", "objective"),
    "bounds": ("limit", "limit on"),
    "measured": ("measurement", "measurement of"),
}
_NAME_KEYS = {"factors": "name", "adjust": "chain"}


def key_path_namer(study: Any) -> Callable[[Sequence[str | int]], str]:
    """Function that names key paths: `factors.torque.range`, `limit 2: metric`."""
    values = fields_from_file(study)
    known: dict[str, Counter[str]] = {}

    def key_path_name(path: Sequence[str | int]) -> str:
        """Name of a study's key path in messages."""
        head, number, *rest = str(path[0]), *(path[1:] or ("",))
        entries = node_list(values, head)
        if head not in _ENTRY_NOUNS or not isinstance(number, int):
            return _key_path_text(*path)
        if head == "adjust" and len(entries) == 1:
            return _key_path_text(head, *rest)
        if head not in known:
            known[head] = Counter(_entry_name(head, entry)[1] for entry in entries)
        key, own = _entry_name(head, entries[number])
        noun, on = _ENTRY_NOUNS[head]
        if not own or known[head][own] > 1 or (on and rest == [key]):
            words = f"{noun} {number + 1}"
        elif on:
            words = f"{on} {value_text(own)}"
        else:
            return _key_path_text(head, own, *rest)
        return f"{words}: {_key_path_text(*rest)}" if rest else words

    return key_path_name


def _key_path_text(*keys: str | int) -> str:
    """Text of a key path: "a.b", "value 1 of a"."""
    text = key_text(str(keys[0]))
    for key in keys[1:]:
        text = f"value {key + 1} of {text}" if isinstance(key, int) else f"{text}.{key_text(key)}"
    return text


def _entry_name(head: str, entry: Any) -> tuple[str, str]:
    """Key that names a list's entry, and its value."""
    if head in _NAME_KEYS:
        name = node_value(entry, _NAME_KEYS[head])
        return _NAME_KEYS[head], name if is_name(name) else ""
    keys = [key for key in ("metric", "signal") if isinstance(node_value(entry, key), str) and node_value(entry, key)]
    return (keys[0], node_value(entry, keys[0])) if keys and _ENTRY_NOUNS[head][1] else ("", "")
