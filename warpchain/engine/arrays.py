"""The arrays of an ensemble: one table of them, of which packing, casts, uploads, sums and checkpoints are made.

The structs of the kernels (`kernels.structs`) hold each array by its name, with the type of its
values; the table has what it counts by and where its first values come from. A new field of a struct needs nothing
here, a new array its row.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from functools import cache
from typing import Any, Protocol

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpchain.kernels import structs
from warpchain.kernels.native import STATE_ROWS
from warpchain.kernels.precision import as_float32, as_float64
from warpchain.kernels.statistics import BINS, NOTES

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
    "shaft": Kind(lambda drives: drives["shafts"], "first_shaft"),
    "gear": Kind(lambda drives: drives["gears"], "first_gear"),
    "coupling": Kind(lambda drives: drives["couplings"], "first_coupling"),
    "valve": Kind(lambda drives: drives["valves"], "first_valve"),
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
        packed: the array of `Packed` with its first values, "" for none: it begins at zero.
        made: its values for a device, of a packed ensemble, where they are others; blocks at float32 may want more.
        kept: whether checkpoints keep it, in the order of the rows.
        where: "cpu" or "gpu" where only one of them has use for it; it has one row on the other.
    """

    kind: str
    width: int = 1
    packed: str = ""
    made: Callable[[Any, bool], NDArray[Any]] | None = None
    kept: bool = False
    where: str = ""


def with_lengths_beyond(packed: Any, blocks: bool) -> NDArray[Any]:
    """Lengths of links, and of some that there are not."""
    return np.append(packed.lengths, np.ones(SPARE_LENGTHS))


def seat_directions(packed: Any, blocks: bool) -> NDArray[np.floating]:
    """Directions (seats, 2), for blocks (seats, 4): multiples of 2^-12 and what these round off (`physics.tooth`)."""
    if not blocks:
        return np.asarray(packed.seats)
    coarse = np.rint(4096.0 * packed.seats) / 4096.0
    return np.hstack([coarse, packed.seats - coarse])


def harmonic_rows(packed: Any, blocks: bool) -> NDArray[np.floating]:
    """Rows (order, amplitude, phase) of harmonics, for blocks with the sine of the phase."""
    rows = packed.harmonics
    return np.column_stack([rows, np.sin(rows[:, 2])]) if blocks else np.asarray(rows)


TABLE = {
    "ensemble": {
        "drives": Array("variant", packed="drives"),
        "chains": Array("variant", packed="chains"),
        "lengths": Array("roller", packed="lengths", made=with_lengths_beyond),
        "sprockets": Array("sprocket", packed="sprockets"),
        "tooth_friction": Array("sprocket", packed="tooth_friction"),
        "motions": Array("body", packed="motions"),
        "mounts": Array("body", packed="mounts"),
        "hubs": Array("sprocket", packed="hubs"),
        "guides": Array("guide", packed="guides"),
        "guide_friction": Array("guide", packed="guide_friction"),
        "pieces": Array("piece", packed="pieces"),
        "arms": Array("arm", packed="arms"),
        "tensioners": Array("tensioner", packed="tensioners"),
        "motors": Array("shaft", packed="motors"),
        "couplings": Array("coupling", packed="couplings"),
        "gears": Array("gear", packed="gears"),
        "valves": Array("valve", packed="valves"),
        "seats": Array("", packed="seats", made=seat_directions),
        "harmonics": Array("", packed="harmonics", made=harmonic_rows),
        "tables": Array("", packed="tables"),
    },
    "state": {
        "rollers": Array("roller", STATE_ROWS, packed="rollers", kept=True),
        "bodies": Array("body", packed="bodies", kept=True),
        "body_stages": Array("body", 2, kept=True),
        "wrenches": Array("body", kept=True),
        "tensioners": Array("tensioner", packed="oil", kept=True),
        "pushes": Array("tensioner", kept=True),
        "meters": Array("tensioner", kept=True),
        "strands": Array("sprocket", packed="strands", kept=True),
        "seat": Array("contact", packed="seat", kept=True),
        "impact_speed": Array("contact", kept=True),
        "contact_hold": Array("contact", kept=True),
        "damper_speed": Array("contact", kept=True),
        "joint_hold": Array("roller", kept=True),
        "hub_hold": Array("sprocket", kept=True),
        "totals": Array("partner", kept=True),
        "progress": Array("variant", kept=True),
        "couplings": Array("coupling", packed="engaged", kept=True),
        "poses": Array("body", where="cpu"),
        "rates": Array("body", where="cpu"),
        "passed": Array("body", where="cpu"),
        "cams": Array("body", where="cpu"),
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
        "shaft": Array("shaft", kept=True),
        "coupling": Array("coupling", kept=True),
        "gear": Array("gear", kept=True),
        "valve": Array("valve", kept=True),
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
"""The arrays of `kernels.structs` (Ensemble, State, Sums, Tallies), by name."""

PACKED = {row.packed: (group, name) for group, rows in TABLE.items() for name, row in rows.items() if row.packed}
"""The arrays of `Packed`: group and name of each in the table."""


def array_type(group: str, name: str, real: type, blocks: bool = False) -> Any:
    """Warp's type of an array's values, as the struct of its group has it in the CPU's kernels or in `blocks`."""
    kinds = structs.types(real, blocks)
    of_group = {
        "ensemble": kinds.Ensemble,
        "state": kinds.State,
        "sums": kinds.Sums,
        "tallies": structs.Tallies,
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


def _uploaded(packed: Any, group: str, name: str, device: str, blocks: bool) -> wp.array:
    """A copy of an array's first values on a device."""
    row, kind = TABLE[group][name], array_type(group, name, packed.real, blocks)
    paired = blocks and packed.precision == "float32"
    values = getattr(packed, row.packed) if row.made is None else row.made(packed, paired)
    values = as_float32(values, dtype_of(kind)) if paired else values.astype(dtype_of(kind), copy=False)
    return wp.array(values, dtype=kind, device=device, copy=True)


def rows_of(array: wp.array, group: str, name: str, real: type) -> NDArray[Any]:
    """The values of an array of a device, as the CPU has them."""
    values: NDArray[Any] = array.numpy()
    kind = dtype_of(array_type(group, name, real))
    return values if values.dtype == kind else as_float64(values, kind)


def assign_rows(array: wp.array, values: NDArray[Any]) -> None:
    """Sets an array of a device, from values as the CPU has them."""
    array.assign(as_float32(values, dtype_of(array.dtype)))


def upload_ensemble(packed: Any, device: str, blocks: bool = False) -> Any:
    """The data that does not change during a run (`kernels.structs.types(...).Ensemble`), copied to `device`."""
    kinds = structs.types(packed.real, blocks)
    ensemble = kinds.Ensemble()
    for name in TABLE["ensemble"]:
        setattr(ensemble, name, _uploaded(packed, "ensemble", name, device, blocks))
    return ensemble


def upload_state(packed: Any, device: str, large: tuple[int, int] | None = None) -> Any:
    """The initial state (`kernels.structs.types(...).State`), copied to `device`.

    `large` is for block kernels: how many values, and values of parts, that blocks share lie in global memory.
    """
    blocks = large is not None
    state = structs.types(packed.real, blocks).State()
    counts, engine = lengths(packed.drives, "state"), "gpu" if blocks else "cpu"
    for name, row in TABLE["state"].items():
        if row.packed:
            setattr(state, name, _uploaded(packed, "state", name, device, blocks))
        elif row.kind:
            count = counts[name] if row.where in ("", engine) else 1
            kind = array_type("state", name, packed.real, blocks)
            setattr(state, name, wp.zeros(count, dtype=kind, device=device))
    stages = 0
    if blocks and packed.drives["integrator"].any():  # else the GPU's kernels are not loaded
        from warpchain.kernels.gpu.rollers import STAGE_ROWS

        stages = STAGE_ROWS * len(packed.lengths)
    in_rows, in_parts = large or (0, 0)
    for name, count in (("stages", stages), ("rows", in_rows), ("parts", in_parts)):
        setattr(state, name, wp.empty(max(count, 1), dtype=packed.real, device=device))
    return state


def empty_sums(packed: Any, device: str, blocks: bool = False) -> Any:
    """Sums to which nothing has been added (`types(...).Sums`): minima at +infinity, maxima at -infinity."""
    sums = structs.types(packed.real, blocks).Sums()
    for name, count in lengths(packed.drives, "sums").items():
        struct = array_type("sums", name, packed.real, blocks)
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
    """Bytes that an ensemble's sums and statistics take: about a kilobyte a strand, 88 a sprocket and batch."""
    counts = lengths(packed.drives, "sums")
    return sum(count * dtype_of(array_type("sums", name, packed.real)).itemsize for name, count in counts.items())


def empty_tallies(packed: Any, device: str) -> structs.Tallies:
    """Tallies to which nothing has been added, for the block kernels."""
    tallies = structs.Tallies()
    for name, count in lengths(packed.drives, "tallies").items():
        setattr(tallies, name, wp.zeros(count, dtype=array_type("tallies", name, packed.real), device=device))
    return tallies


class Buffer(Protocol):
    """Frames of one launch."""

    def numpy(self) -> NDArray[np.floating]:
        """The frames, in the host's memory."""
        ...


class Engine(ABC):
    """An engine that steps an ensemble: `cpu.CpuEngine` or `gpu.GpuEngine`.

    Its arrays that change as variants run have the groups and names of `TABLE`.
    """

    packed: Any
    balances = False
    """Whether each variant may have steps of its own in a launch."""

    @abstractmethod
    def advance(self, steps: Any, frames: Any) -> list[Future[None]]:
        """Starts `steps` steps of every variant that has not ended, (variants,) where it `balances`; frames go to
        `frames`.
        """

    @abstractmethod
    def start_settling(self, settling: NDArray[Any]) -> None:
        """Takes the state of each variant's relaxation, (variants,) `kernels.relaxation.Settling`."""

    @abstractmethod
    def settle(self, steps: int) -> list[Future[None]]:
        """Starts up to `steps` steps of relaxation of every variant that has not settled."""

    @abstractmethod
    def settling(self) -> NDArray[Any]:
        """The state of each variant's relaxation."""

    @abstractmethod
    def frame_buffer(self, values: int) -> Buffer:
        """A buffer for a launch's frames."""

    @abstractmethod
    def held(self) -> dict[str, Any]:
        """The structs that change, by group."""

    @abstractmethod
    def fetch(self, group: str, name: str) -> NDArray[Any]:
        """A copy of an array, as the CPU has it."""

    @abstractmethod
    def put(self, group: str, name: str, values: NDArray[Any]) -> None:
        """Sets an array, as `fetch` gives it."""

    @abstractmethod
    def close(self) -> None:
        """Ends it, after what it is doing."""

    def rollers(self) -> NDArray[np.floating]:
        """Copy of the rollers' rows, as in `Packed.rollers`."""
        return self.fetch("state", "rollers")

    def bodies(self) -> NDArray[Any]:
        """Copy of the bodies' states, as in `Packed.bodies`."""
        return self.fetch("state", "bodies")

    def progress(self) -> NDArray[Any]:
        """(variants,) copy of `structs.Progress`: the next step of each variant, and whether it diverged."""
        return self.fetch("state", "progress")

    def sums(self) -> dict[str, NDArray[Any]]:
        """The window's sums, by name as in `kernels.structs.Sums`."""
        return {name: self.fetch("sums", name) for name in TABLE["sums"]}
