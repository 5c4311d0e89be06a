"""States of a study's runs at the end of their windows: kept shard by shard; longer runs go on from them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from warpchain.errors import StudyError
from warpchain.study.run.folder import GONE_ON, Folder
from warpchain.study.store import read_table

if TYPE_CHECKING:
    from warpchain.engine.checkpoint import Kept
    from warpchain.study.run.row_drives import Variant

ROW, COPY, STATE = "variant", "replicate", "state"
"""Columns of a shard's table of states, beside `GONE_ON`."""


def write_states(folder: Folder, shard: int, variants: Sequence[Variant]) -> None:
    """Writes the states of a shard's runs, and which of them went on from one.

    Raises:
        StudyError: a folder or disk that refuses.
    """
    import pyarrow as pa

    table = pa.table(
        {
            ROW: pa.array([variant.row["variant"] for variant in variants], pa.int64()),
            COPY: pa.array([variant.copy for variant in variants], pa.int64()),
            GONE_ON: pa.array([variant.gone_on for variant in variants], pa.bool_()),
            STATE: pa.array([variant.kept and variant.kept.to_bytes() for variant in variants], pa.large_binary()),
        }
    )
    folder.write(folder.states_path(shard), table, shard)


def states_of(folder: Folder, tasks: Sequence[tuple[int, int]]) -> dict[tuple[int, int], bytes]:
    """The states that a folder keeps of some of its runs, by row and copy."""
    numbers = folder.design()[ROW].to_pylist()
    wanted = {(numbers[row], copy): (row, copy) for row, copy in tasks}
    rows = {row for row, _ in tasks}
    found = {}
    for shard in folder.shards:
        path = folder.states_path(shard)
        if folder.done(shard) and path.exists() and not rows.isdisjoint(folder.tasks(shard)[0].tolist()):
            for held in read_table(path, None, folder.part(shard).identity or None).to_pylist():
                task = wanted.get((held[ROW], held[COPY]))
                if task is not None and held[STATE] is not None:
                    found[task] = held[STATE]
    return found


def write_joined(folder: Folder, shard: int, states: Sequence[tuple[int, int, bytes | None]]) -> None:
    """Writes a shard's states (number, copy, state) of runs that were joined; nothing where there are none."""
    import pyarrow as pa

    numbers, copies, held = zip(*states, strict=True)
    if any(state is not None for state in held):
        columns = {ROW: numbers, COPY: copies, GONE_ON: [False] * len(held), STATE: pa.array(held, pa.large_binary())}
        folder.write(folder.states_path(shard), pa.table(columns), shard)


def begin_with(folder: Folder, variants: Sequence[Variant]) -> None:
    """Gives runs the states of those before that a study with another duration or window had.

    A table of states that cannot be read is no help; the runs then begin anew.
    """
    wanted = {(variant.row["variant"], variant.copy): variant for variant in variants if not variant.recorded}
    if not folder.before or not wanted:
        return
    numbers = folder.design()[ROW].to_pylist()
    for part in folder.before:
        for shard in part.shards:
            path = folder.states_path(shard)
            if not path.exists():
                continue
            tasks = zip(*(values.tolist() for values in part.tasks(shard)), strict=True)
            if wanted.keys().isdisjoint((numbers[row], copy) for row, copy in tasks):
                continue
            try:
                rows = read_table(path, None, part.identity or None).to_pylist()
            except StudyError:
                continue
            for row in rows:
                variant = wanted.get((row[ROW], row[COPY]))
                if variant is not None and row[STATE] is not None:
                    variant.begin = _read(row[STATE])


def _read(data: bytes) -> Kept | None:
    from warpchain.engine.checkpoint import Kept

    try:
        return Kept.from_bytes(data)
    except ValueError:
        return None
