"""Structs at float32 made from those at float64, and rows of them converted there and back.

Fields become float32 or pairs.
"""

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from .number import Pair, PairVector, RecentSum

ROW = 16
"""Bytes of a struct that a thread reads at once."""
SINGLE = {wp.float64: wp.float32, wp.vec2d: wp.vec2f, wp.vec3d: wp.vec3f, wp.mat22d: wp.mat22f}
PAIRED = {wp.float64: Pair, wp.vec2d: PairVector}


def at_float32(
    full: Any,
    nested: Mapping[Any, Any],
    *,
    pairs: Collection[str] = (),
    recent: Collection[str] = (),
    kept: Collection[str] = (),
    rows: bool = False,
    **other: Any,
) -> Any:
    """Warp struct with float32 in place of float64, also in its arrays.

    Args:
        nested: replacements of structs in it.
        pairs: fields that become pairs.
        recent: sums that every step adds to (`number.RecentSum`).
        kept: unchanged fields.
        rows: fills up to whole rows of `ROW` bytes.
        other: types of further fields.
    """

    def kind_of(name: str, kind: Any) -> Any:
        """Float32 type of a struct's field, also in arrays."""
        if wp.types.is_array(kind):
            return wp.array[kind_of(name, kind.dtype)]
        if name in kept:
            return kind
        if name in recent:
            return RecentSum
        return PAIRED[kind] if name in pairs else SINGLE.get(kind) or nested.get(kind, kind)

    kinds = {name: other.get(name) or kind_of(name, var.type) for name, var in full.vars.items()} | other
    made = _struct(full, kinds)
    if rows:
        short = -wp.types.type_size_in_bytes(made) % ROW // 4
        made = _struct(full, kinds | {f"unused_{k}": wp.int32 for k in range(short)})
    return made


def _struct(full: Any, kinds: Mapping[str, Any]) -> Any:
    """A Warp struct like `full` with fields `kinds`."""
    body = {"__annotations__": kinds, "__doc__": full.__doc__, "__module__": full.cls.__module__}
    return wp.struct(type(full.key, (), body))


def sums_at_float32(full: Any, nested: Mapping[Any, Any], recent: Collection[str] = ()) -> Any:
    """Struct of sums at float32: pairs, extremes single."""
    added = [name for name, var in full.vars.items() if var.type in PAIRED and not name.endswith(("_min", "_max"))]
    return at_float32(full, nested, pairs=[name for name in added if name not in recent], recent=recent)


def as_float32(rows: NDArray[Any], kind: np.dtype[Any]) -> NDArray[Any]:
    """Rows of float64 as numpy rows of float32 or pairs."""
    names = kind.names or ()
    if not names:
        return rows.astype(kind)
    of_vectors = len(kind["high"].shape) if names == ("high", "low") else 0
    made = np.zeros(rows.shape[: rows.ndim - of_vectors], dtype=kind)
    if names == ("high", "low"):
        made["high"] = rows
        made["low"] = rows - made["high"]
    elif names == ("sum", "recent"):
        made["sum"] = as_float32(rows, kind["sum"])
    else:
        for name in rows.dtype.names or ():
            made[name] = as_float32(rows[name], kind[name].base)
    return made


def as_float64(rows: NDArray[Any], kind: np.dtype[Any]) -> NDArray[Any]:
    """Rows of float32 or pairs as numpy rows of float64, exactly."""
    names = rows.dtype.names or ()
    if kind.names:
        made = np.zeros(rows.shape, dtype=kind)
        for name in kind.names:
            made[name] = as_float64(rows[name], kind[name].base)
        return made
    if names == ("high", "low"):
        return rows["high"].astype(float) + rows["low"]
    if names == ("sum", "recent"):
        return as_float64(rows["sum"], kind) + rows["recent"]
    return rows.astype(kind)
