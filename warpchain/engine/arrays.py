"""The arrays of an ensemble: one table of them, of which packing, casts, uploads, sums and checkpoints are made.

The structs of the kernels (`kernels.structs`, `kernels.sum_structs`) hold each array by its name, with the type of its
values; the table has what it counts by and where its first values come from. A new field of a struct needs nothing
here, a new array its row.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpchain.kernels import structs, sum_structs
from warpchain.kernels.batches import NOTES
from warpchain.kernels.rows import STATE_ROWS
from warpchain.kernels.tension_bins import BINS

INTEGRATORS = {"leapfrog": 0, "rk4": 1}

SPARE_LENGTHS = 4096
"""Lengths after the last: the block kernels' threads that have no roller read them."""


@dataclass(frozen=True)
class Kind:
    """A kind of thing that arrays hold, variant after variant.

    Attributes:
        count: how many each variant has, (variants,), from the rows of `drives`.
        first: the field of `kernels.structs.Drive` that says where a variant's begin, "" where there is none.
    """

    count: Callable[[NDArray[Any]], NDArray[Any]]
    first: str = ""


KINDS = {
    "variant": Kind(lambda drives: np.ones(len(drives), dtype=np.int64)),
    "roller": Kind(lambda drives: drives["rollers"], "first_roller"),
    "sprocket": Kind(lambda drives: drives["sprockets"], "first_sprocket"),
    "body": Kind(lambda drives: drives["bodies"], "first_body"),
    "guide": Kind(lambda drives: drives["guides"], "first_guide"),
    "piece": Kind(lambda drives: drives["pieces"], "first_piece"),
    "arm": Kind(lambda drives: drives["arms"], "first_arm"),
    "tensioner": Kind(lambda drives: drives["tensioners"], "first_tensioner"),
    "partner": Kind(lambda drives: drives["sprockets"] + drives["guides"]),
    "contact": Kind(lambda drives: drives["rollers"] * (drives["sprockets"] + drives["guides"]), "first_contact"),
    "tally": Kind(lambda drives: drives["rollers"] * (drives["sprockets"] + 1), "first_tally"),
    "histogram": Kind(lambda drives: drives["sprockets"] + 1),
}
"""Partners of contacts are a variant's sprockets, then its guide-bars; histograms those of its strands and of none."""


def starts(drives: NDArray[Any]) -> dict[str, NDArray[np.int64]]:
    """Where each variant's things of each kind begin, and where the last one's end, (variants + 1,)."""
    return {
        name: np.append(0, np.cumsum(kind.count(drives).astype(np.int64), dtype=np.int64))
        for name, kind in KINDS.items()
    }


def numbered(drives: NDArray[Any]) -> NDArray[Any]:
    """Rows of `kernels.structs.Drive` with the places where their parts begin, one variant after the other."""
    for name, places in starts(drives).items():
        if KINDS[name].first:
            drives[KINDS[name].first] = places[:-1]
    return drives


@dataclass(frozen=True)
class Array:
    """A row of the table.

    Attributes:
        kind: what the array counts by, a key of `KINDS`; "" for what variants share, and for scratch.
        width: how many values each has.
        packed: the array of `Packed` with its first values, "" for none: it begins at zero, or as `made` says.
        made: its values for a device, of a packed ensemble.
        kept: whether checkpoints keep it, in the order of the rows.
        where: "cpu" or "gpu" where only one of them has use for it; it has one row on the other.
    """

    kind: str
    width: int = 1
    packed: str = ""
    made: Callable[[Any], NDArray[Any]] | None = None
    kept: bool = False
    where: str = ""


def split_seats(seats: NDArray[np.floating]) -> NDArray[np.floating]:
    """Directions (seats, 2) as (seats, 4): their multiples of 2^-12, and what these round off (`physics.tooth`)."""
    coarse = np.rint(4096.0 * seats) / 4096.0
    return np.hstack([coarse, seats - coarse]).astype(np.float32)


def split(values: NDArray[np.floating]) -> NDArray[np.float32]:
    """Numbers (n,) as pairs of float32 (n, 2)."""
    high = values.astype(np.float32)
    return np.stack([high, (values - high).astype(np.float32)], axis=-1)


def _set_pairs(rows: NDArray[Any], values: dict[str, NDArray[np.floating]]) -> None:
    """Sets fields of rows that are pairs of float32."""
    for name, of in values.items():
        rows[name]["high"], rows[name]["low"] = split(of).T


def split_tables(motions: NDArray[Any]) -> NDArray[Any]:
    """(2 * bodies,) `structs.SplitTable`: the table of each body's motion and that of its load."""
    tables = np.stack([motions["drive_table"], motions["load_table"]], axis=1).ravel()
    made = np.zeros(len(tables), dtype=structs.SplitTable.numpy_dtype())
    for name in ("cells", "first", "over_angle", "repeats"):
        made[name] = tables[name]
    spacing = np.where(tables["cells"] > 0, tables["spacing"], 1.0)
    _set_pairs(made, {"start": tables["start"], "spacing": spacing, "rate": 1.0 / spacing})
    return made


def split_pieces(pieces: NDArray[Any]) -> NDArray[np.float32]:
    """Pieces of profiles as rows of four (`physics.profile`), (3 * pieces, 4)."""
    made = np.zeros((len(pieces), 3, 4), dtype=np.float32)
    for k, name in enumerate(("start", "direction")):
        made[:, k] = np.moveaxis(split(pieces[name]), 2, 1).reshape(-1, 4)
    made[:, 2, 0] = pieces["curvature"]
    return made.reshape(-1, 4)


def strokes(tensioners: NDArray[Any]) -> NDArray[Any]:
    """(tensioners,) `structs.Stroke`."""
    made = np.zeros(len(tensioners), dtype=structs.Stroke.numpy_dtype())
    (px, py), (dx, dy) = tensioners["point"].T, tensioners["direction"].T
    home = (tensioners["home"] * tensioners["direction"]).sum(axis=1)
    along, across = px * dx + py * dy, px * dy - py * dx
    _set_pairs(made, dict(zip(made.dtype.names or (), (home, dx, dy, along, across), strict=True)))
    return made


def _paired(
    packed: str, form: Callable[[NDArray[Any]], NDArray[Any]] = lambda values: values
) -> Callable[[Any], NDArray[Any]]:
    """Makes an array for blocks at float32 of a packed one; it is empty at float64."""
    return lambda of: form(getattr(of, packed)[: None if of.precision == "float32" else 0])


TABLE = {
    "ensemble": {
        "drives": Array("variant", packed="drives"),
        "chains": Array("variant", packed="chains"),
        "joints": Array("variant", packed="joints"),
        "links": Array("variant", packed="links"),
        "lengths": Array("roller", packed="lengths", made=lambda of: np.append(of.lengths, np.ones(SPARE_LENGTHS))),
        "sprockets": Array("sprocket", packed="sprockets"),
        "tooth_sliding": Array("sprocket", packed="tooth_sliding"),
        "motions": Array("body", packed="motions"),
        "mounts": Array("body", packed="mounts"),
        "guides": Array("guide", packed="guides"),
        "guide_sliding": Array("guide", packed="guide_sliding"),
        "pieces": Array("piece", packed="pieces"),
        "arms": Array("arm", packed="arms"),
        "tensioners": Array("tensioner", packed="tensioners"),
        "seats": Array("", packed="seats"),
        "block_arms": Array("arm", made=_paired("arms")),
        "block_tensioners": Array("tensioner", made=_paired("tensioners")),
        "strokes": Array("tensioner", made=_paired("tensioners", strokes)),
        "split_seats": Array("", made=_paired("seats", split_seats)),
        "split_harmonics": Array("", made=lambda of: np.column_stack([of.harmonics, np.sin(of.harmonics[:, 2])])),
        "split_tables": Array("body", 2, made=_paired("motions", split_tables)),
        "split_pieces": Array("piece", 3, made=_paired("pieces", split_pieces)),
        "split_values": Array("", made=_paired("tables", split)),
    },
    "curves": {"harmonics": Array("", packed="harmonics"), "tables": Array("", packed="tables")},
    "state": {
        "rollers": Array("roller", STATE_ROWS, packed="rollers", kept=True),
        "bodies": Array("body", packed="bodies", kept=True),
        "body_stages": Array("body", kept=True),
        "wrenches": Array("body", kept=True),
        "tensioners": Array("tensioner", packed="oil", kept=True),
        "pushes": Array("tensioner", kept=True),
        "meters": Array("tensioner", kept=True),
        "strands": Array("sprocket", packed="strands", kept=True),
        "seat": Array("contact", packed="seat", kept=True),
        "impact_speed": Array("contact", kept=True),
        "totals": Array("partner", kept=True),
        "progress": Array("variant", kept=True),
        "poses": Array("body", where="cpu"),
        "rates": Array("body", where="cpu"),
        "extra": Array("roller", where="gpu"),
        "stages": Array(""),
        "rows": Array(""),
        "parts": Array(""),
    },
    "sums": {
        "chain": Array("variant", kept=True),
        "strand": Array("sprocket", kept=True),
        "sprocket": Array("sprocket", kept=True),
        "mount": Array("sprocket", kept=True),
        "arm": Array("arm", kept=True),
        "tensioner": Array("tensioner", kept=True),
        "contact": Array("partner", kept=True),
        "slip": Array("sprocket", kept=True),
        "tension_counts": Array("histogram", int(BINS), kept=True),
        "chain_notes": Array("variant", int(NOTES), kept=True),
        "strand_notes": Array("sprocket", int(NOTES), kept=True),
        "sprocket_notes": Array("sprocket", int(NOTES), kept=True),
        "mount_notes": Array("sprocket", int(NOTES), kept=True),
    },
    "tallies": {
        "link": Array("tally", kept=True),
        "impacts": Array("contact", kept=True),
        "contacts": Array("contact", kept=True),
        "missed": Array("contact", kept=True),
        "dissipated": Array("contact", kept=True),
        "friction": Array("contact", kept=True),
        "impulse": Array("contact", kept=True),
        "force_max": Array("contact", kept=True),
        "roller": Array("roller", kept=True),
        "body": Array("body", kept=True),
    },
}
"""The arrays of `kernels.structs` (Ensemble, its Curves, State) and `kernels.sum_structs` (Sums, Tallies), by name."""

PACKED = {row.packed: (group, name) for group, rows in TABLE.items() for name, row in rows.items() if row.packed}
"""The arrays of `Packed`: group and name of each in the table."""


def array_type(group: str, name: str, real: type) -> Any:
    """Warp's type of an array's values, as the kernels' struct of its group has it."""
    kinds = structs.types(real)
    of_group = {
        "ensemble": kinds.Ensemble,
        "curves": structs.Curves,
        "state": kinds.State,
        "sums": sum_structs.Sums,
        "tallies": sum_structs.Tallies,
    }
    return of_group[group].vars[name].type.dtype


@cache
def dtype_of(kind: Any) -> np.dtype[Any]:
    """The numpy type of a Warp struct's rows, or of a scalar or of a vector's parts; Warp takes long to lay one out."""
    if hasattr(kind, "numpy_dtype"):
        return np.dtype(kind.numpy_dtype())
    return np.dtype(wp.dtype_to_numpy(getattr(kind, "_wp_scalar_type_", kind)))


def lengths(drives: NDArray[Any], group: str) -> dict[str, int]:
    """Length of each array of a group that counts by something, at least 1, as Warp reads no empty array."""
    counts = {name: max(int(kind.count(drives).sum()), 1) for name, kind in KINDS.items()}
    counts["partner"] = counts["sprocket"] + counts["guide"]
    return {name: row.width * counts[row.kind] for name, row in TABLE[group].items() if row.kind}


def _uploaded(packed: Any, group: str, name: str, device: str) -> wp.array:
    """A copy of an array's first values on a device."""
    row, kind = TABLE[group][name], array_type(group, name, packed.real)
    values = getattr(packed, row.packed) if row.made is None else row.made(packed)
    return wp.array(values.astype(dtype_of(kind), copy=False), dtype=kind, device=device, copy=True)


def upload_ensemble(packed: Any, device: str) -> Any:
    """The data that does not change during a run (`kernels.structs.types(...).Ensemble`), copied to `device`."""
    ensemble = structs.types(packed.real).Ensemble()
    for group, of in (("ensemble", ensemble), ("curves", ensemble.curves)):
        for name in TABLE[group]:
            setattr(of, name, _uploaded(packed, group, name, device))
    return ensemble


def _stage_rows() -> int:
    """Rows of a roller between rk4's stages; where no GPU takes it, the GPU's kernels are not loaded."""
    from warpchain.kernels.gpu.rk4 import STAGE_ROWS

    return STAGE_ROWS


def upload_state(packed: Any, device: str, large: tuple[int, int] | None = None) -> Any:
    """The initial state (`kernels.structs.types(...).State`), copied to `device`.

    `large` is for block kernels: how many values, and values of parts, that blocks share lie in global memory.
    """
    state = structs.types(packed.real).State()
    counts, engine = lengths(packed.drives, "state"), "cpu" if large is None else "gpu"
    for name, row in TABLE["state"].items():
        if row.packed:
            setattr(state, name, _uploaded(packed, "state", name, device))
        elif row.kind:
            count = counts[name] if row.where in ("", engine) else 1
            setattr(state, name, wp.zeros(count, dtype=array_type("state", name, packed.real), device=device))
    rk4 = large is not None and bool((packed.drives["integrator"] == INTEGRATORS["rk4"]).any())
    in_rows, in_parts = large or (0, 0)
    stages = _stage_rows() * len(packed.lengths) if rk4 else 0
    for name, count in (("stages", stages), ("rows", in_rows), ("parts", in_parts)):
        setattr(state, name, wp.empty(max(count, 1), dtype=packed.real, device=device))
    return state


def empty_sums(packed: Any, device: str) -> sum_structs.Sums:
    """Sums to which nothing has been added: minima at +infinity, maxima at -infinity."""
    sums = sum_structs.Sums()
    for name, count in lengths(packed.drives, "sums").items():
        struct = array_type("sums", name, packed.real)
        array: wp.array = wp.zeros(count, dtype=struct, device=device)
        fields = dtype_of(struct).names or ()
        extremes = {
            field: np.inf if field.endswith("_min") else -np.inf
            for field in fields
            if field.endswith(("_min", "_max")) and (name, field) != ("contact", "force_max")
        }
        if extremes:
            least = struct()
            for field, value in extremes.items():
                setattr(least, field, value)
            array.fill_(least)  # where they are: half a gigabyte of 67,584 variants does not go through the host
        setattr(sums, name, array)
    return sums


def sums_bytes(packed: Any) -> int:
    """Bytes that an ensemble's sums and statistics take: about a kilobyte a strand, 136 a sprocket and batch."""
    counts = lengths(packed.drives, "sums")
    return sum(count * dtype_of(array_type("sums", name, packed.real)).itemsize for name, count in counts.items())


def empty_tallies(packed: Any, device: str) -> sum_structs.Tallies:
    """Tallies to which nothing has been added, for the block kernels."""
    tallies = sum_structs.Tallies()
    for name, count in lengths(packed.drives, "tallies").items():
        setattr(tallies, name, wp.zeros(count, dtype=array_type("tallies", name, packed.real), device=device))
    return tallies
