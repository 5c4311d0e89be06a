"""Checkpoints: states of variants within a run, from which a longer run continues bit by bit.

Each is of the last multiple of `DIVERGENCE_CHECK` in the window. A longer run continues with the sums where its window
begins at the same step, and samples and notes agree; without them, on a CPU, where it begins later.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.lib.recfunctions import repack_fields
from numpy.typing import NDArray

from warpchain.drive import Drive
from warpchain.engine.arrays import ARRAYS, Engine, first_places
from warpchain.engine.packed_ensemble import PackedEnsemble
from warpchain.engine.window_sums import has_batches, note_steps
from warpchain.errors import SimulationError
from warpchain.files import parse_json
from warpchain.kernels.statistics import NOTES
from warpchain.kernels.structs import DIVERGENCE_CHECK
from warpchain.results.schedule import LOOK_EVERY, MOST_STEPS, Schedule
from warpchain.version import installed_version

MOST_STOPS = 16
"""Most stops of a run for checkpoints."""
FORMAT = 8
Arrays = Mapping[tuple[str, str], NDArray[Any]]


@dataclass(frozen=True)
class VariantState:
    """Checkpoint: a variant's state within its run."""

    facts: Mapping[str, Any]  # drive, run and step, as JSON
    data: bytes = field(repr=False)  # bytes of its arrays, one after the other

    @property
    def step(self) -> int:
        """Number of the next step after a checkpoint."""
        return int(self.facts["next"])

    def to_bytes(self) -> bytes:
        """Bytes of a checkpoint, for a file."""
        head = json.dumps(self.facts, sort_keys=True).encode()
        return len(head).to_bytes(8, "little") + head + self.data

    @classmethod
    def from_bytes(cls, data: bytes) -> VariantState:
        """Checkpoint from bytes of `to_bytes`.

        Raises:
            ValueError: other bytes.
        """
        size = int.from_bytes(data[:8], "little")
        facts = parse_json(data[8 : 8 + size])
        if not isinstance(facts, dict) or facts.get("format") != FORMAT:
            raise ValueError("a state of another version")
        return cls(facts, data[8 + size :])


@dataclass
class States:
    """Checkpoints from which a run's variants begin, and those kept.

    Attributes:
        keep: whether to keep states.
        begin: each variant's state, None to begin anew; () for none.
        kept: after the run, each variant's state that came so far.
        used: after the run, which variants continued from a state.
    """

    keep: bool = True
    begin: Sequence[VariantState | None] = ()
    kept: list[VariantState | None] = field(default_factory=list)
    used: list[bool] = field(default_factory=list)

    def prepare(self, count: int) -> None:
        """Prepares for checkpoints of so many variants.

        Raises:
            SimulationError: not one state a variant to begin with.
        """
        if self.begin and len(self.begin) != count:
            raise SimulationError(f"states.begin: there are {len(self.begin)} for {count} variants; give one each")
        self.kept, self.used = [None] * count, [False] * count


def _drive_digest(drive: Drive) -> str:
    """SHA-256 of a drive's content, for checkpoints."""
    plain = drive.model_copy(update={"run": drive.run.model_copy(update={"duration": 1.0, "sample_rate": 1.0})})
    return hashlib.sha256(plain.model_dump_json().encode()).hexdigest()


def _required_facts(drive: Drive, schedule: Schedule, run: str) -> dict[str, Any]:
    """Facts that a checkpoint must have to continue a run."""
    return {
        "format": FORMAT,
        "warpchain": installed_version(),
        "run": run,
        "step": float(schedule.step).hex(),
        "drive": _drive_digest(drive),
    }


def latest_stop_step(schedule: Schedule) -> int:
    """Last step that allows a checkpoint, or 0."""
    unit = int(DIVERGENCE_CHECK)
    return schedule.window_end // unit * unit


def has_usable_sums(kept: VariantState, schedule: Schedule) -> bool:
    """Whether a checkpoint's sums can be continued."""
    first, last = kept.facts["window"]
    if (
        kept.facts.get("look_every", LOOK_EVERY) != schedule.sample_interval
    ):  # before it was a fact it was always the same
        return False
    if schedule.window_start != first or schedule.window_end < kept.step or kept.step < first:
        return False
    return schedule.window_end == last or usable_notes(kept, schedule) is not None


def usable_notes(kept: VariantState, schedule: Schedule) -> list[tuple[int, int]] | None:
    """Pairs of notes of longer run and checkpoint, or None."""
    first, last = kept.facts["window"]
    every = schedule.sample_interval
    wanted = note_steps(schedule.window_start, schedule.window_end, every)
    if not has_batches(schedule.window_end - schedule.window_start, every):
        return []
    taken = {step: k for k, step in reversed(list(enumerate(note_steps(first, last, every).tolist())))}
    behind = [(k, step) for k, step in enumerate(wanted.tolist()) if step < kept.step]
    return [(k, taken[step]) for k, step in behind] if all(step in taken for _, step in behind) else None


def _is_usable(kept: VariantState, drive: Drive, schedule: Schedule, run: str) -> bool:
    """Whether a run can continue from a checkpoint."""
    if any(kept.facts.get(name) != value for name, value in _required_facts(drive, schedule, run).items()):
        return False
    later = schedule.window_start >= kept.step and _is_on_cpu(run)
    return kept.step <= schedule.steps and (has_usable_sums(kept, schedule) or later)


def _is_on_cpu(run: str) -> bool:
    """Whether a checkpoint's `run` (precision, device) is on a CPU."""
    return run.endswith("cpu")


def stop_steps(schedules: Sequence[Schedule]) -> NDArray[np.int64]:
    """Steps (V,) at which variants' checkpoints are kept."""
    wanted = np.array([latest_stop_step(schedule) for schedule in schedules], dtype=np.int64)
    held = np.unique(wanted)
    if len(held) > MOST_STOPS:
        held = held[np.linspace(0, len(held) - 1, MOST_STOPS).astype(int)]
    return np.asarray(held[np.searchsorted(held, wanted, side="right") - 1])


class StateKeeper:
    """Keeper of a run's checkpoints, which also restores them.

    Args:
        states: filled as the run goes.
        numbers: (V,) of variants in the run.
        run: precision and kind of device.
    """

    def __init__(
        self,
        states: States,
        drives: Sequence[Drive],
        schedules: Sequence[Schedule],
        numbers: NDArray[np.int64],
        run: str,
    ) -> None:
        self._drives, self._schedules, self._run = drives, schedules, run
        self._states, self._numbers = states, numbers.tolist()
        begin = [states.begin[number] for number in self._numbers] if states.begin else [None] * len(drives)
        self.begin = [
            kept
            if kept is not None and schedule.frame_interval == 0 and _is_usable(kept, drive, schedule, run)
            else None
            for kept, drive, schedule in zip(begin, drives, schedules, strict=True)
        ]
        for number, kept in zip(self._numbers, self.begin, strict=True):
            states.used[number] = kept is not None
        self._stops = stop_steps(schedules) if states.keep else np.zeros(len(drives), dtype=np.int64)
        self._ends: dict[int, dict[str, Any]] = {}

    def drives_to_settle(self) -> list[Drive]:
        """Drives of a run, unsettled if continued from a checkpoint."""
        settled = {"settle": False}
        return [
            drive if kept is None else drive.model_copy(update={"run": drive.run.model_copy(update=settled)})
            for drive, kept in zip(self._drives, self.begin, strict=True)
        ]

    def take_over_settling(self, packed: PackedEnsemble, settled: NDArray[Any], left: NDArray[np.float64]) -> None:
        """Takes boxes and settling from checkpoints; notes new ones."""
        for v, kept in enumerate(self.begin):
            if kept is not None:
                facts = kept.facts
                packed.drives["low"][v], packed.drives["high"][v] = facts["low"], facts["high"]
                left[v] = facts["left"]
                for name, value in facts["settled"].items():
                    settled[name][v] = value
        row = packed.drives
        for v in range(packed.variants):
            held = {name: settled[name][v].item() for name in settled.dtype.names or ()}
            ends = {"low": row["low"][v].tolist(), "high": row["high"][v].tolist()}
            self._ends[v] = {**ends, "left": float(left[v]), "settled": held}

    def restore_states(self, engine: Engine) -> None:
        """Sets an engine's variants to their checkpoints."""
        if not any(self.begin):
            return
        arrays, places = _checkpoint_arrays(engine), _variant_places(engine.packed)
        for v, kept in enumerate(self.begin):
            if kept is not None:
                _set_variant(arrays, places, v, kept, self._schedules[v])
        for name, values in arrays.items():
            engine.set_array(*name, values)

    def steps_ahead(self, progress: NDArray[Any]) -> NDArray[np.int64]:
        """Steps (V,) until each variant's checkpoint."""
        ahead = self._stops - progress["step"]
        return np.where((progress["diverged"] == 0) & (ahead > 0), ahead, MOST_STEPS + 1)

    def keep_due_states(self, engine: Engine, progress: NDArray[Any]) -> None:
        """Keeps the checkpoints that are due."""
        due = (self._stops > 0) & (progress["step"] == self._stops) & (progress["diverged"] == 0)
        if due.any():
            arrays, places = _checkpoint_arrays(engine), _variant_places(engine.packed)
            for v in np.flatnonzero(due).tolist():
                self._states.kept[self._numbers[v]] = self._variant_state(v, _variant_bytes(arrays, places, v))

    def _variant_state(self, v: int, data: bytes) -> VariantState:
        """Checkpoint of variant v, from its arrays' bytes."""
        schedule = self._schedules[v]
        window = [schedule.window_start, schedule.window_end]
        more = {"next": int(self._stops[v]), "window": window, "look_every": schedule.sample_interval, **self._ends[v]}
        return VariantState({**_required_facts(self._drives[v], schedule, self._run), **more}, data)


def _checkpoint_arrays(engine: Engine) -> dict[tuple[str, str], NDArray[Any]]:
    """Copies of an engine's arrays in checkpoints, by name."""
    return {
        (group, name): engine.fetch_array(group, name)
        for group in engine.changing_structs()
        for name, row in ARRAYS[group].items()
        if row.in_checkpoints
    }


def _variant_places(packed: PackedEnsemble) -> dict[tuple[str, str], NDArray[np.int64]]:
    """Places (variants + 1,) of variants' values in checkpoints."""
    first = first_places(packed.drives)
    rows = {(group, name): row for group in ARRAYS for name, row in ARRAYS[group].items() if row.in_checkpoints}
    return {name: row.width * first[row.dimension] for name, row in rows.items()}


def _variant_bytes(arrays: Arrays, places: Mapping[tuple[str, str], NDArray[np.int64]], v: int) -> bytes:
    """Bytes of variant v in a checkpoint's arrays."""
    parts = (values[places[name][v] : places[name][v + 1]] for name, values in arrays.items())
    return b"".join(repack_fields(part, recurse=True).tobytes() for part in parts)


def _set_variant(
    arrays: Arrays,
    places: Mapping[tuple[str, str], NDArray[np.int64]],
    v: int,
    kept: VariantState,
    schedule: Schedule,
) -> None:
    """Sets variant v in all arrays from its checkpoint.

    Raises:
        SimulationError: another layout.
    """
    sums, at = has_usable_sums(kept, schedule), 0
    for name, values in arrays.items():
        place = slice(places[name][v], places[name][v + 1])
        kind = repack_fields(values.dtype, recurse=True)
        size = (place.stop - place.start) * kind.itemsize
        held = np.frombuffer(kept.data[at : at + size], dtype=kind)
        at += size
        if name[0] == "state" or (sums and not name[1].endswith("_notes")):
            values[place] = held
        elif sums:
            mine, noted = values[place].reshape(-1, int(NOTES)), held.reshape(-1, int(NOTES))
            for k, old in usable_notes(kept, schedule) or []:
                mine[:, k] = noted[:, old]
            values[place] = mine.reshape(-1)
    if at != len(kept.data):
        raise SimulationError("states.begin: a state of another drive or version")
