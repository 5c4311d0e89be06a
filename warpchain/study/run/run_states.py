"""Tables of the states in which a study's runs end, from which longer runs go on; a file a shard."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from warpchain.errors import StudyError
from warpchain.study.run.study_folder import RESUMED_COLUMN, StudyFolder
from warpchain.study.store import read_table

if TYPE_CHECKING:
    from warpchain.engine.checkpoint import VariantState
    from warpchain.study.run.row_drives import Variant

VARIANT_COLUMN, COPY_COLUMN, STATE_COLUMN = "variant", "replicate", "state"


def write_run_states(folder: StudyFolder, shard: int, variants: Sequence[Variant]) -> None:
    """Writes a shard's table of its runs' end states."""
    import pyarrow as pa

    table = pa.table(
        {
            VARIANT_COLUMN: pa.array([variant.row["variant"] for variant in variants], pa.int64()),
            COPY_COLUMN: pa.array([variant.copy for variant in variants], pa.int64()),
            RESUMED_COLUMN: pa.array([variant.resumed for variant in variants], pa.bool_()),
            STATE_COLUMN: pa.array(
                [variant.final_state and variant.final_state.to_bytes() for variant in variants], pa.large_binary()
            ),
        }
    )
    folder.write_table(folder.states_path(shard), table, shard)


def read_run_states(folder: StudyFolder, tasks: Sequence[tuple[int, int]]) -> dict[tuple[int, int], bytes]:
    """End states by run (row, copy), read from disk."""
    numbers = folder.read_design()[VARIANT_COLUMN].to_pylist()
    wanted = {(numbers[row], copy): (row, copy) for row, copy in tasks}
    rows = {row for row, _ in tasks}
    found = {}
    for shard in folder.shard_numbers:
        path = folder.states_path(shard)
        if folder.is_done(shard) and path.exists() and not rows.isdisjoint(folder.shard_runs(shard)[0].tolist()):
            for held in read_table(path, None, folder.plan_of_shard(shard).identity or None).to_pylist():
                task = wanted.get((held[VARIANT_COLUMN], held[COPY_COLUMN]))
                if task is not None and held[STATE_COLUMN] is not None:
                    found[task] = held[STATE_COLUMN]
    return found


def write_joined_states(folder: StudyFolder, shard: int, states: Sequence[tuple[int, int, bytes | None]]) -> None:
    """Writes a joined shard's end states, if any."""
    import pyarrow as pa

    numbers, copies, held = zip(*states, strict=True)
    if any(state is not None for state in held):
        columns = {
            VARIANT_COLUMN: numbers,
            COPY_COLUMN: copies,
            RESUMED_COLUMN: [False] * len(held),
            STATE_COLUMN: pa.array(held, pa.large_binary()),
        }
        folder.write_table(folder.states_path(shard), pa.table(columns), shard)


def assign_initial_states(folder: StudyFolder, variants: Sequence[Variant]) -> None:
    """Sets variants' initial states to earlier runs' end states."""
    wanted = {(variant.row["variant"], variant.copy): variant for variant in variants if not variant.recorded}
    if not folder.earlier_plans or not wanted:
        return
    numbers = folder.read_design()[VARIANT_COLUMN].to_pylist()
    for part in folder.earlier_plans:
        for shard in part.shard_numbers:
            path = folder.states_path(shard)
            if not path.exists():
                continue
            tasks = zip(*(values.tolist() for values in part.shard_runs(shard)), strict=True)
            if wanted.keys().isdisjoint((numbers[row], copy) for row, copy in tasks):
                continue
            try:
                rows = read_table(path, None, part.identity or None).to_pylist()
            except StudyError:
                continue
            for row in rows:
                variant = wanted.get((row[VARIANT_COLUMN], row[COPY_COLUMN]))
                if variant is not None and row[STATE_COLUMN] is not None:
                    variant.initial_state = _state_from_bytes(row[STATE_COLUMN])


def _state_from_bytes(data: bytes) -> VariantState | None:
    """End state of a run from bytes, or None."""
    from warpchain.engine.checkpoint import VariantState

    try:
        return VariantState.from_bytes(data)
    except ValueError:
        return None
