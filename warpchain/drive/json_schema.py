"""JSON schemas of drive and study files for editors."""

from __future__ import annotations

import inspect
import json
from typing import Any

from warpchain.drive.csv_files import has_own_load
from warpchain.drive.defaults import FREE_KEYS
from warpchain.drive.file_columns import FILE_KEYS, LIFT_KEYS, OWN_KEY
from warpchain.drive.motion_table import TABLES
from warpchain.drive.quantities import attribute_descriptions, unit_of_key
from warpchain.drive.schema import Part, allowed_text
from warpchain.drive.valves import LiftTable

DIALECT = "https://json-schema.org/draft/2020-12/schema"
QUANTITY = {"type": "string", "pattern": r"^[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,3})?\s*[A-Za-z°µμ%]"}
"""JSON schema of a quantity such as "540 rpm"."""

TEXTS = {"type": "object", "additionalProperties": {"type": "string"}}
FILE_SHAPES: dict[str, dict[str, Any]] = {
    "file": {"type": "string"},
    "columns": TEXTS,
    "units": TEXTS,
    "decimal": {"enum": [".", ","]},
    "head": {"type": "integer", "minimum": 1},
    "event": {"type": "boolean"},
    "crank_turns": {"type": "integer", "minimum": 1},
}
"""JSON schemas of keys beside `file`."""

DRAWN = {"Guide": "profile", "Sprocket": "tooth"}
"""Keys of parts that may name a drawing."""
UNIT = {"type": "string", "description": "unit of the DXF file, such as mm, in place of what the file says"}


def file_schema(top: type[Part], title: str) -> dict[str, Any]:
    """JSON schema of a TOML file with the tables of `top`."""
    whole = top.model_json_schema()
    tables = {top.__name__: whole, **whole.get("$defs", {})}
    kinds = {kind.__name__: kind for kind in _derived_parts(Part)}
    for name, table in tables.items():
        _rewrite_for_file(kinds[name], table)
    return {"$schema": DIALECT, **whole, "title": title}


def drive_schema() -> dict[str, Any]:
    """JSON schema of drive files."""
    from warpchain.drive import Drive

    return file_schema(Drive, "warpchain drive file")


def schema_text(schema: dict[str, Any]) -> str:
    """Text of a JSON schema's file."""
    return json.dumps(schema, indent=1, ensure_ascii=False) + "\n"


def _derived_parts(kind: type[Part]) -> list[type[Part]]:
    """Parts derived from one, at all levels."""
    return [inner for own in kind.__subclasses__() for inner in (own, *_derived_parts(own))]


def _rewrite_for_file(kind: type[Part], table: dict[str, Any]) -> None:
    """Turns a part's JSON schema into a file table's."""
    table["description"] = " ".join(inspect.cleandoc(kind.__doc__ or "").split("\n\n")[0].split())
    said = attribute_descriptions(kind)
    for key, value in table.get("properties", {}).items():
        shape = _file_value_schema(value, bool(unit_of_key(kind, key)) or key in kind._quantities)
        words = [said.get(key, "").rstrip("."), allowed_text(kind, key)]
        table["properties"][key] = shape | {"description": "; ".join(filter(None, words))}
    free: Any = getattr(kind, "_filled", ())
    if issubclass(kind, (*TABLES, LiftTable)):  # a file that it names has the columns
        keys = FILE_KEYS | (LIFT_KEYS if kind is LiftTable else {})
        table["properties"] |= {key: FILE_SHAPES[key] | {"description": of} for key, of in keys.items()}
        if has_own_load(kind):
            table["properties"][OWN_KEY] = {"type": "string", "description": "name of a plug-in's load"}
        free = table["properties"]
    if kind.__name__ in DRAWN:
        table["properties"][f"{DRAWN[kind.__name__]}_unit"] = UNIT
    free = {*free, *FREE_KEYS.get(kind.__name__, ())}
    table["required"] = [key for key in table.get("required", ()) if key not in free]


def _file_value_schema(shape: Any, measured: bool) -> Any:
    """JSON schema of a file's value; also of quantities if `measured`."""
    if isinstance(shape, list):
        return [_file_value_schema(inner, measured) for inner in shape if inner != {"type": "null"}]
    if not isinstance(shape, dict):
        return shape
    bare = {key: _file_value_schema(inner, measured) for key, inner in shape.items() if key != "title"}
    if bare.get("default", 0) in (None, []):
        del bare["default"]
    if len(bare.get("anyOf", ())) == 1:
        bare |= bare.pop("anyOf")[0]
    if measured and bare.get("type") == "number":
        rest = {key: bare.pop(key) for key in ("default",) if key in bare}
        return rest | {"anyOf": [bare, QUANTITY]}
    return bare
