"""Structs of float64 as blocks at float32 keep them, and the way there and back, made from their fields.

While a kernel at float32 runs, what it adds up and remembers is in pairs of float32; the state that it reads and writes
back is float64, and the host knows no other. A new field of a struct needs nothing here.
"""

import linecache
from functools import cache
from typing import Any

import warp as wp

from .number import Pair, RecentSum, SumVector, gathered, pair_of, pairs_of, recent_sum, whole

SINGLE = ("_min", "_max")
"""Ends of the names of fields that float32 holds as they are found: extremes."""

OF_KIND = {Pair: "pair_of", SumVector: "pairs_of", RecentSum: "recent_sum", wp.float32: "wp.float32"}
"""The function that makes a field of each kind of its float64."""

NARROWED = """
@wp.func
def narrowed(full: Full):
    made = Made()
{fields}
    return made
"""

WHOLE = """
@wp.func
def whole(made: Made):
    full = Full()
{fields}
    return full
"""

GATHERED = """
@wp.func
def gathered(made: Made):
{fields}
    return made
"""


@wp.func
def unchanged(full: Any):
    """At float64 nothing is made of it."""
    return full


functions = {"whole": whole, "gathered": gathered}
"""What is made here, by name: each an overload for every struct."""


def _define(name: str, source: str, lines: list[str], full: Any, made: Any) -> None:
    """Defines a function of such a source, which Warp reads where Python finds that of tracebacks."""
    text = source.format(fields="\n".join(f"    {line}" for line in lines))
    place = f"<{name} of {made.native_name}>"
    linecache.cache[place] = len(text), None, text.splitlines(keepends=True), place
    scope = {"wp": wp, "pair_of": pair_of, "pairs_of": pairs_of, "recent_sum": recent_sum, "__name__": __name__}
    scope |= functions | {"Full": full, "Made": made}
    exec(compile(text, place, "exec"), scope)
    functions[name] = scope[name]


def _kind_of(name: str, kind: Any, single: tuple[str, ...], recent: tuple[str, ...]) -> Any:
    """What a field is kept as."""
    if kind == wp.vec2d:
        return SumVector
    if kind != wp.float64:
        return kind
    if name in single or name.endswith(SINGLE):
        return wp.float32
    return RecentSum if name in recent else Pair


def at_float32(full: Any, single: tuple[str, ...] = (), recent: tuple[str, ...] = ()) -> Any:
    """A struct as blocks at float32 keep it: numbers and vectors in pairs, extremes in float32, the rest as it is.

    `narrowed` makes it of `full`, and `whole` makes `full` of it.

    Args:
        full: with float64.
        single: fields that float32 is enough for.
        recent: sums that every step adds to (`number.RecentSum`); `gathered` gathers them.
    """
    kinds = {name: _kind_of(name, var.type, single, recent) for name, var in full.vars.items()}
    body = {"__annotations__": kinds, "__doc__": full.__doc__, "__module__": full.cls.__module__}
    made = wp.struct(type(full.key, (), body))
    there = [f"made.{name} = {OF_KIND.get(kind, '')}(full.{name})" for name, kind in kinds.items()]
    _define("narrowed", NARROWED, there, full, made)
    _define("whole", WHOLE, [f"full.{name} = whole(made.{name})" for name in kinds], full, made)
    if recent:
        _define("gathered", GATHERED, [f"made.{name} = gathered(made.{name})" for name in recent], full, made)
    return made


@cache
def narrowing(Real: type) -> wp.Function:
    """The function that makes of a struct of float64 what a block at a precision keeps."""
    return unchanged if Real == wp.float64 else functions["narrowed"]
