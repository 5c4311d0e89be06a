"""Table of an ensemble's arrays, `ARRAYS`: how they are packed, uploaded, summed up and kept."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
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
"""Link lengths after the last, for idle block threads."""


FIRST_ITEMS = tuple(name for name in structs.Drive.vars if name.startswith("first_") and name != "first_value")
"""Fields of `structs.Drive` with places of rows' first items."""


def item_counts(drives: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """Items (rows,) of `drives` in each dimension of an ensemble's arrays."""
    rollers, sprockets, guides, points = (drives[name] for name in ("rollers", "sprockets", "guides", "points"))
    return {
        "variant": np.ones(len(drives), dtype=np.int64),
        "roller": rollers,
        "sprocket": sprockets,
        "body": drives["bodies"],
        "guide": guides,
        "piece": drives["pieces"],
        "arm": drives["arms"],
        "tensioner": drives["tensioners"],
        "shaft": drives["shafts"],
        "gear": drives["gears"],
        "coupling": drives["couplings"],
        "valve": drives["valves"],
        "partner": sprockets + guides,
        "contact": rollers * (sprockets * points + guides),
        "push": (points > 1) * rollers * (sprockets * points + guides // 2 + 2),
        "tally": rollers * (sprockets + 1),
        "histogram": sprockets + 1,
    }


def first_places(drives: NDArray[Any]) -> dict[str, NDArray[np.int64]]:
    """Places (rows + 1,) of rows' first items in arrays, by dimension."""
    return {
        name: np.append(0, np.cumsum(counts.astype(np.int64), dtype=np.int64))
        for name, counts in item_counts(drives).items()
    }


def fill_first_places(drives: NDArray[Any]) -> NDArray[Any]:
    """Fills places of first items into `structs.Drive`, returned."""
    places = first_places(drives)
    for name in FIRST_ITEMS:
        drives[name] = places[name.removeprefix("first_")][:-1]
    return drives


@dataclass(frozen=True)
class ArrayRow:
    """Row of the table of an ensemble's arrays."""

    dimension: str  # key of `item_counts`; "" for what variants share, and for scratch
    width: int = 1  # values of an item
    packed_name: str = ""  # array of `PackedEnsemble` with the first values, "" for zeros
    values_for_device: Callable[[Any, bool], NDArray[Any]] | None = None  # for blocks at float32
    in_checkpoints: bool = False
    where: str = ""  # "cpu" or "gpu", or both


def padded_lengths(packed: Any, blocks: bool) -> NDArray[Any]:
    """Link lengths of an ensemble, and `SPARE_LENGTHS` more."""
    return np.append(packed.lengths, np.ones(SPARE_LENGTHS))


def seat_directions(packed: Any, blocks: bool) -> NDArray[np.floating]:
    """Directions (seats, 2) of tooth seats, for blocks (seats, 4)."""
    if not blocks:
        return np.asarray(packed.seats)
    coarse = np.rint(4096.0 * packed.seats) / 4096.0
    return np.hstack([coarse, packed.seats - coarse])


def harmonic_rows(packed: Any, blocks: bool) -> NDArray[np.floating]:
    """Rows (order, amplitude, phase) of harmonics, for blocks with sines."""
    rows = packed.harmonics
    return np.column_stack([rows, np.sin(rows[:, 2])]) if blocks else np.asarray(rows)


ARRAYS = {
    "ensemble": {
        "drives": ArrayRow("variant", packed_name="drives"),
        "chains": ArrayRow("variant", packed_name="chains"),
        "plates": ArrayRow("variant", packed_name="plates"),
        "lengths": ArrayRow("roller", packed_name="lengths", values_for_device=padded_lengths),
        "sprockets": ArrayRow("sprocket", packed_name="sprockets"),
        "tooth_friction": ArrayRow("sprocket", packed_name="tooth_friction"),
        "motions": ArrayRow("body", packed_name="motions"),
        "mounts": ArrayRow("body", packed_name="mounts"),
        "hubs": ArrayRow("sprocket", packed_name="hubs"),
        "guides": ArrayRow("guide", packed_name="guides"),
        "guide_friction": ArrayRow("guide", packed_name="guide_friction"),
        "pieces": ArrayRow("piece", packed_name="pieces"),
        "arms": ArrayRow("arm", packed_name="arms"),
        "tensioners": ArrayRow("tensioner", packed_name="tensioners"),
        "motors": ArrayRow("shaft", packed_name="motors"),
        "couplings": ArrayRow("coupling", packed_name="couplings"),
        "gears": ArrayRow("gear", packed_name="gears"),
        "valves": ArrayRow("valve", packed_name="valves"),
        "seats": ArrayRow("", packed_name="seats", values_for_device=seat_directions),
        "harmonics": ArrayRow("", packed_name="harmonics", values_for_device=harmonic_rows),
        "tables": ArrayRow("", packed_name="tables"),
    },
    "state": {
        "rollers": ArrayRow("roller", STATE_ROWS, packed_name="rollers", in_checkpoints=True),
        "relative_mass": ArrayRow("roller", packed_name="relative_mass"),
        "bodies": ArrayRow("body", packed_name="bodies", in_checkpoints=True),
        "body_stages": ArrayRow("body", 2, in_checkpoints=True),
        "wrenches": ArrayRow("body", in_checkpoints=True),
        "tensioners": ArrayRow("tensioner", packed_name="oil", in_checkpoints=True),
        "pushes": ArrayRow("tensioner", in_checkpoints=True),
        "meters": ArrayRow("tensioner", in_checkpoints=True),
        "strands": ArrayRow("sprocket", packed_name="strands", in_checkpoints=True),
        "seat": ArrayRow("contact", packed_name="seat", in_checkpoints=True),
        "impact_speed": ArrayRow("contact", in_checkpoints=True),
        "contact_hold": ArrayRow("contact", in_checkpoints=True),
        "damper_speed": ArrayRow("contact", in_checkpoints=True),
        "joint_hold": ArrayRow("roller", in_checkpoints=True),
        "hub_hold": ArrayRow("sprocket", in_checkpoints=True),
        "totals": ArrayRow("partner", in_checkpoints=True),
        "progress": ArrayRow("variant", in_checkpoints=True),
        "couplings": ArrayRow("coupling", packed_name="engaged", in_checkpoints=True),
        "push": ArrayRow("push", in_checkpoints=True),
        "poses": ArrayRow("body"),
        "rates": ArrayRow("body", where="cpu"),
        "train_moments": ArrayRow("body", where="cpu"),
        "cams": ArrayRow("body", where="cpu"),
        "extra": ArrayRow("roller", where="gpu"),
        "stages": ArrayRow(""),
        "rows": ArrayRow(""),
        "parts": ArrayRow(""),
    },
    "sums": {
        "chain": ArrayRow("variant", in_checkpoints=True),
        "strand": ArrayRow("sprocket", in_checkpoints=True),
        "sprocket": ArrayRow("sprocket", in_checkpoints=True),
        "mount": ArrayRow("sprocket", in_checkpoints=True),
        "arm": ArrayRow("arm", in_checkpoints=True),
        "tensioner": ArrayRow("tensioner", in_checkpoints=True),
        "contact": ArrayRow("partner", in_checkpoints=True),
        "slip": ArrayRow("sprocket", in_checkpoints=True),
        "tension_counts": ArrayRow("histogram", int(BINS), in_checkpoints=True),
        "chain_notes": ArrayRow("variant", int(NOTES), in_checkpoints=True),
        "strand_notes": ArrayRow("sprocket", int(NOTES), in_checkpoints=True),
        "sprocket_notes": ArrayRow("sprocket", int(NOTES), in_checkpoints=True),
        "mount_notes": ArrayRow("sprocket", int(NOTES), in_checkpoints=True),
        "shaft": ArrayRow("shaft", in_checkpoints=True),
        "coupling": ArrayRow("coupling", in_checkpoints=True),
        "gear": ArrayRow("gear", in_checkpoints=True),
        "valve": ArrayRow("valve", in_checkpoints=True),
    },
    "tallies": {
        "link": ArrayRow("tally", in_checkpoints=True),
        "impacts": ArrayRow("contact", in_checkpoints=True),
        "contacts": ArrayRow("contact", in_checkpoints=True),
        "missed": ArrayRow("contact", in_checkpoints=True),
        "dissipated": ArrayRow("contact", in_checkpoints=True),
        "friction": ArrayRow("contact", in_checkpoints=True),
        "impulse": ArrayRow("contact", in_checkpoints=True),
        "force_max": ArrayRow("contact", in_checkpoints=True),
        "roller": ArrayRow("roller", in_checkpoints=True),
        "body": ArrayRow("body", in_checkpoints=True),
    },
}
"""Arrays of an ensemble, by struct and name."""

PACKED_ARRAYS = {
    row.packed_name: (group, name) for group, rows in ARRAYS.items() for name, row in rows.items() if row.packed_name
}
"""Struct and name of each packed array."""


@cache
def array_type(group: str, name: str, real: type, blocks: bool = False) -> Any:
    """Warp type of an array's values, on the CPU or in `blocks`."""
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
    """Numpy dtype of a Warp struct, scalar or vector."""
    if hasattr(kind, "numpy_dtype"):
        return np.dtype(kind.numpy_dtype())
    return np.dtype(wp.dtype_to_numpy(getattr(kind, "_wp_scalar_type_", kind)))


def array_lengths(drives: NDArray[Any], group: str) -> dict[str, int]:
    """Length of each array of a group, at least 1."""
    counts = {name: max(int(each.sum()), 1) for name, each in item_counts(drives).items()}
    counts["partner"] = counts["sprocket"] + counts["guide"]
    return {name: row.width * counts[row.dimension] for name, row in ARRAYS[group].items() if row.dimension}


def _upload_array(packed: Any, group: str, name: str, device: str, blocks: bool) -> wp.array:
    """Device copy of a packed array."""
    row, kind = ARRAYS[group][name], array_type(group, name, packed.real, blocks)
    paired = blocks and packed.precision == "float32"
    values = (
        getattr(packed, row.packed_name) if row.values_for_device is None else row.values_for_device(packed, paired)
    )
    values = as_float32(values, dtype_of(kind)) if paired else values.astype(dtype_of(kind), copy=False)
    return wp.array(values, dtype=kind, device=device, copy=True)


def device_values(array: wp.array, group: str, name: str, real: type) -> NDArray[Any]:
    """Values of a device's array, in the CPU's types."""
    values: NDArray[Any] = array.numpy()
    kind = dtype_of(array_type(group, name, real))
    return values if values.dtype == kind else as_float64(values, kind)


def assign_values(array: wp.array, values: NDArray[Any]) -> None:
    """Sets a device's array from values in the CPU's types."""
    array.assign(as_float32(values, dtype_of(array.dtype)))


def upload_ensemble(packed: Any, device: str, blocks: bool = False) -> Any:
    """Constant data of an ensemble (`structs.Ensemble`) on a device."""
    kinds = structs.types(packed.real, blocks)
    ensemble = kinds.Ensemble()
    for name in ARRAYS["ensemble"]:
        setattr(ensemble, name, _upload_array(packed, "ensemble", name, device, blocks))
    return ensemble


def upload_state(packed: Any, device: str, large: tuple[int, int] | None = None) -> Any:
    """Initial state of an ensemble (`structs.State`) on a device.

    `large`: values, and values of parts, in global memory.
    """
    blocks = large is not None
    state = structs.types(packed.real, blocks).State()
    counts, engine = array_lengths(packed.drives, "state"), "gpu" if blocks else "cpu"
    for name, row in ARRAYS["state"].items():
        if row.packed_name:
            setattr(state, name, _upload_array(packed, "state", name, device, blocks))
        elif row.dimension:
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
    """Empty sums of an ensemble (`structs.Sums`): minima +infinity, maxima -infinity."""
    sums = structs.types(packed.real, blocks).Sums()
    for name, count in array_lengths(packed.drives, "sums").items():
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
    """Bytes of an ensemble's sums."""
    counts = array_lengths(packed.drives, "sums")
    return sum(count * dtype_of(array_type("sums", name, packed.real)).itemsize for name, count in counts.items())


def empty_tallies(packed: Any, device: str) -> structs.Tallies:
    """Empty tallies of the block kernels."""
    tallies = structs.Tallies()
    for name, count in array_lengths(packed.drives, "tallies").items():
        setattr(tallies, name, wp.zeros(count, dtype=array_type("tallies", name, packed.real), device=device))
    return tallies


class FrameSource(Protocol):
    """Frames of one launch, on any device."""

    def numpy(self) -> NDArray[np.floating]:
        """Frames of a launch in the host's memory."""
        ...


class Engine(ABC):
    """Engine that steps an ensemble: `cpu.CpuEngine` or `gpu.GpuEngine`."""

    packed: Any
    has_own_steps = False
    """Whether an engine's variants may differ in a launch's steps."""

    @abstractmethod
    def advance(self, steps: Any, frames: Any) -> list[Future[None]]:
        """Starts a launch of `steps` steps of every variant, frames going to `frames`.

        `steps` may be (variants,) if `has_own_steps`.
        """

    @abstractmethod
    def start_settling(self, settling: NDArray[Any]) -> None:
        """Sets variants' settling states, `kernels.relaxation.Settling`, in the engine."""

    @abstractmethod
    def settle(self, steps: int) -> list[Future[None]]:
        """Starts up to `steps` settling steps of every variant."""

    @abstractmethod
    def settling_states(self) -> NDArray[Any]:
        """Copy (variants,) of the engine's settling states."""

    @abstractmethod
    def frame_buffer(self, values: int, wanted: NDArray[np.integer] | None = None) -> FrameSource:
        """Buffer for a launch's frames; only values at places `wanted` are read after `take_steps`."""

    @abstractmethod
    def changing_structs(self) -> dict[str, Any]:
        """Engine's changing structs by group."""

    @abstractmethod
    def fetch_array(self, group: str, name: str) -> NDArray[Any]:
        """Copy of an engine's array, in the CPU's types."""

    @abstractmethod
    def set_array(self, group: str, name: str, values: NDArray[Any]) -> None:
        """Sets an engine's array from values as of `fetch_array`."""

    @abstractmethod
    def sums(self) -> dict[str, NDArray[Any]]:
        """Engine's sums of the window, by name."""

    @abstractmethod
    def set_constants(self, name: str, values: NDArray[Any]) -> None:
        """Sets an array of an engine's constants between launches."""

    @abstractmethod
    def stage_inputs(self, first: int) -> tuple[NDArray[Any], NDArray[Any]]:
        """Views of tables and of rows' frame intervals, which `take_steps` reads as they stand.

        Of the tables only values from `first` on may change.
        """

    @abstractmethod
    def diverged_view(self) -> NDArray[Any]:
        """View (rows,) of an engine's divergences."""

    @abstractmethod
    def close(self) -> None:
        """Waits for an engine's launches; frees threads and memory."""

    def take_steps(self, steps: int | NDArray[np.integer], frames: Any) -> None:
        """Takes `steps` steps of all rows, or of each (rows,), and waits; fills `frames`."""
        for future in self.advance(steps, frames):
            future.result()

    def copy_state(self) -> dict[tuple[str, str], NDArray[Any]]:
        """Copies of changing arrays, in the device's types."""
        return {
            (group, name): np.array(getattr(struct, name).numpy(), copy=True)
            for group, struct in self.changing_structs().items()
            for name in ARRAYS[group]
        }

    def restore_state(self, arrays: Mapping[tuple[str, str], NDArray[Any]]) -> None:
        """Sets an engine's changing arrays from `copy_state`."""
        for (group, name), values in arrays.items():
            getattr(self.changing_structs()[group], name).assign(values)

    def rollers(self) -> NDArray[np.floating]:
        """Copy of an engine's roller rows."""
        return self.fetch_array("state", "rollers")

    def bodies(self) -> NDArray[Any]:
        """Copy of an engine's body states."""
        return self.fetch_array("state", "bodies")

    def progress(self) -> NDArray[Any]:
        """Copy (variants,) of progress: next step, whether diverged."""
        return self.fetch_array("state", "progress")
