"""Where variants stand within a run, so that a longer run goes on from there and ends as if it had been one.

A variant is kept at the last step of its window that is a multiple of `DIVERGENCE_CHECK`, before that step is taken:
what moves, what contacts and tensioners remember, and what the window has summed up. Kernels can end a launch at such a
step without a trace, so a run that is gone on with gives the same bits as a run of that length.

A longer run can take a state over, with its sums, where its window begins at the same step, the chain is looked at as
often (`looks`), and each note of its batches (`kernels.statistics`) that lies behind was taken, as it was where the
window becomes a whole number of times as long.
It can take a state over without its sums where its window begins later, on a CPU. Else the variant begins anew.
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
from warpchain.engine.arrays import TABLE, Engine, starts
from warpchain.engine.outcomes import has_batches, note_steps
from warpchain.engine.packed import Packed
from warpchain.errors import SimulationError
from warpchain.files import parse_json
from warpchain.kernels.statistics import NOTES
from warpchain.kernels.structs import DIVERGENCE_CHECK
from warpchain.results.schedule import LOOK_EVERY, MOST_STEPS, Schedule
from warpchain.version import installed_version

STOPS = 16
"""Most steps at which a run is stopped to keep states; variants of unlike steps share them."""
FORMAT = 8
Arrays = Mapping[tuple[str, str], NDArray[Any]]


@dataclass(frozen=True)
class Kept:
    """A variant within its run.

    Attributes:
        facts: what it is of and when (`_facts`), values that JSON holds.
        data: its arrays' bytes, one after the other.
    """

    facts: Mapping[str, Any]
    data: bytes = field(repr=False)

    @property
    def step(self) -> int:
        """The next step."""
        return int(self.facts["next"])

    def to_bytes(self) -> bytes:
        """All of it, for a file."""
        head = json.dumps(self.facts, sort_keys=True).encode()
        return len(head).to_bytes(8, "little") + head + self.data

    @classmethod
    def from_bytes(cls, data: bytes) -> Kept:
        """The other way round.

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
    """States to begin with, and to keep; handed to `simulate`.

    Attributes:
        keep: whether to keep the variants' states.
        begin: a state for each variant, None for one that begins anew; none at all for ().
        kept: after the run, the state of each variant that came so far; None of others.
        used: after the run, which variants went on from a state.
    """

    keep: bool = True
    begin: Sequence[Kept | None] = ()
    kept: list[Kept | None] = field(default_factory=list)
    used: list[bool] = field(default_factory=list)

    def prepare(self, count: int) -> None:
        """Makes room for a run of so many variants.

        Raises:
            SimulationError: not one state a variant to begin with.
        """
        if self.begin and len(self.begin) != count:
            raise SimulationError(f"states.begin: there are {len(self.begin)} for {count} variants; give one each")
        self.kept, self.used = [None] * count, [False] * count


def _identity(drive: Drive) -> str:
    """Digest of a drive's content but for how long it runs."""
    plain = drive.model_copy(update={"run": drive.run.model_copy(update={"duration": 1.0, "sample_rate": 1.0})})
    return hashlib.sha256(plain.model_dump_json().encode()).hexdigest()


def _facts(drive: Drive, schedule: Schedule, run: str) -> dict[str, Any]:
    """The facts that must hold of a state for it to be taken over."""
    return {
        "format": FORMAT,
        "warpchain": installed_version(),
        "run": run,
        "step": float(schedule.step).hex(),
        "drive": _identity(drive),
    }


def stop_of(schedule: Schedule) -> int:
    """The step at which a variant is kept at the latest; 0 for none."""
    unit = int(DIVERGENCE_CHECK)
    return schedule.window_end // unit * unit


def takes_sums(kept: Kept, schedule: Schedule) -> bool:
    """Whether a run can take over what a state has summed up: the same window so far, and its notes."""
    first, last = kept.facts["window"]
    if kept.facts.get("look_every", LOOK_EVERY) != schedule.look_every:  # before it was a fact it was always the same
        return False
    if schedule.window_start != first or schedule.window_end < kept.step or kept.step < first:
        return False
    return schedule.window_end == last or notes_from(kept, schedule) is not None


def notes_from(kept: Kept, schedule: Schedule) -> list[tuple[int, int]] | None:
    """(note of the longer run, note of the state) of each that lies behind; None where one was not taken."""
    first, last = kept.facts["window"]
    every = schedule.look_every
    wanted = note_steps(schedule.window_start, schedule.window_end, every)
    if not has_batches(schedule.window_end - schedule.window_start, every):
        return []
    taken = {step: k for k, step in reversed(list(enumerate(note_steps(first, last, every).tolist())))}
    behind = [(k, step) for k, step in enumerate(wanted.tolist()) if step < kept.step]
    return [(k, taken[step]) for k, step in behind] if all(step in taken for _, step in behind) else None


def _fits(kept: Kept, drive: Drive, schedule: Schedule, run: str) -> bool:
    """Whether a run can go on from a state."""
    if any(kept.facts.get(name) != value for name, value in _facts(drive, schedule, run).items()):
        return False
    later = schedule.window_start >= kept.step and _on_cpu(run)
    return kept.step <= schedule.steps and (takes_sums(kept, schedule) or later)


def _on_cpu(run: str) -> bool:
    return run.endswith("cpu")


def stops_of(schedules: Sequence[Schedule]) -> NDArray[np.int64]:
    """(V,) at which step each variant is kept, of at most `STOPS` different ones."""
    wanted = np.array([stop_of(schedule) for schedule in schedules], dtype=np.int64)
    held = np.unique(wanted)
    if len(held) > STOPS:
        held = held[np.linspace(0, len(held) - 1, STOPS).astype(int)]
    return np.asarray(held[np.searchsorted(held, wanted, side="right") - 1])


class Keeper:
    """Keeps the states of some variants of a run, and gives them those that they begin with.

    Args:
        states: what is asked for, prepared for the run; it is filled.
        drives, schedules: the variants.
        numbers: (V,) what they are called in the run.
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
            kept if kept is not None and schedule.sample_every == 0 and _fits(kept, drive, schedule, run) else None
            for kept, drive, schedule in zip(begin, drives, schedules, strict=True)
        ]
        for number, kept in zip(self._numbers, self.begin, strict=True):
            states.used[number] = kept is not None
        self._stops = stops_of(schedules) if states.keep else np.zeros(len(drives), dtype=np.int64)
        self._ends: dict[int, dict[str, Any]] = {}

    def unsettled(self) -> list[Drive]:
        """The drives, without settling of those that do not begin anew."""
        settled = {"settle": False}
        return [
            drive if kept is None else drive.model_copy(update={"run": drive.run.model_copy(update=settled)})
            for drive, kept in zip(self._drives, self.begin, strict=True)
        ]

    def prepare(self, packed: Packed, settled: NDArray[Any], left: NDArray[np.float64]) -> None:
        """Gives the variants that go on their box and how their settling had ended."""
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

    def restore(self, engine: Engine) -> None:
        """Sets an engine's variants where their states were."""
        if not any(self.begin):
            return
        arrays, places = _fetched(engine), _places(engine.packed)
        for v, kept in enumerate(self.begin):
            if kept is not None:
                _set(arrays, places, v, kept, self._schedules[v])
        for name, values in arrays.items():
            engine.put(*name, values)

    def ahead(self, progress: NDArray[Any]) -> NDArray[np.int64]:
        """(V,) steps until each variant is to be kept, more than any run has where it is not."""
        ahead = self._stops - progress["step"]
        return np.where((progress["diverged"] == 0) & (ahead > 0), ahead, MOST_STEPS + 1)

    def take(self, engine: Engine, progress: NDArray[Any]) -> None:
        """Keeps the variants that have come to their steps."""
        due = (self._stops > 0) & (progress["step"] == self._stops) & (progress["diverged"] == 0)
        if due.any():
            arrays, places = _fetched(engine), _places(engine.packed)
            for v in np.flatnonzero(due).tolist():
                self._states.kept[self._numbers[v]] = self._of(v, _bytes(arrays, places, v))

    def _of(self, v: int, data: bytes) -> Kept:
        schedule = self._schedules[v]
        window = [schedule.window_start, schedule.window_end]
        more = {"next": int(self._stops[v]), "window": window, "look_every": schedule.look_every, **self._ends[v]}
        return Kept({**_facts(self._drives[v], schedule, self._run), **more}, data)


def _fetched(engine: Engine) -> dict[tuple[str, str], NDArray[Any]]:
    """Copies of an engine's arrays that are kept, by group and name, in the order of a state's bytes."""
    return {
        (group, name): engine.fetch(group, name)
        for group in engine.held()
        for name, row in TABLE[group].items()
        if row.kept
    }


def _places(packed: Packed) -> dict[tuple[str, str], NDArray[np.int64]]:
    """Where each variant's values begin in each array that is kept, (variants + 1,)."""
    first = starts(packed.drives)
    rows = {(group, name): row for group in TABLE for name, row in TABLE[group].items() if row.kept}
    return {name: row.width * first[row.kind] for name, row in rows.items()}


def _bytes(arrays: Arrays, places: Mapping[tuple[str, str], NDArray[np.int64]], v: int) -> bytes:
    """A variant's part of all arrays, without the gaps between the fields of structs."""
    parts = (values[places[name][v] : places[name][v + 1]] for name, values in arrays.items())
    return b"".join(repack_fields(part, recurse=True).tobytes() for part in parts)


def _set(
    arrays: Arrays,
    places: Mapping[tuple[str, str], NDArray[np.int64]],
    v: int,
    kept: Kept,
    schedule: Schedule,
) -> None:
    """Puts a variant's part into all arrays; sums that its window has not begun stay as they are.

    Raises:
        SimulationError: the state is of another layout.
    """
    sums, at = takes_sums(kept, schedule), 0
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
            for k, old in notes_from(kept, schedule) or []:
                mine[:, k] = noted[:, old]
            values[place] = mine.reshape(-1)
    if at != len(kept.data):
        raise SimulationError("states.begin: a state of another drive or version")
