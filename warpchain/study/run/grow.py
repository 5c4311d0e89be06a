"""Grows a study in its folder: more points of its design, more replicates, other windows; nothing that was run is lost.

What is added is a plan of its own, with shards that follow those that are there. More rows and more copies only add
runs. Another duration or window runs all rows once more: from where the runs before stood, if that was kept
(`run.keep_states`, `engine.states`), else from the beginning; the tables before stay, as `results.before-K.parquet`. A
Latin hypercube of n points grows to k n: each old point lies in a stratum of its own among the k n, and new points fill
the others, so that it is one again.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from warpchain.drive.toml import value_text
from warpchain.errors import StudyError
from warpchain.files import refusals, whole_file
from warpchain.study.design import make_design
from warpchain.study.run.folder import REPLICATES, Folder, differences, open_folder, plan_file, write_plan
from warpchain.study.run.tasks import Block
from warpchain.study.spec import Study, dumps_study, load_study
from warpchain.study.spec.parts import SAMPLED
from warpchain.study.store import write_table, write_text


def growable(known: Study, other: Study) -> bool:
    """Whether a study is another one grown."""
    if not set(differences(known, other)) <= {"design", "run"}:
        return False
    design, run = known.design, known.run
    alike = design.model_copy(update={"count": other.design.count, "replicates": other.design.replicates,
                                      "replicate_by": other.design.replicate_by})  # fmt: skip
    ways = design.copies == 1 or (design.replicate_by or "phase") == (other.design.replicate_by or "phase")
    free = ("duration", "window", "shard", "keep_states")
    same = {name: getattr(other.run, name) for name in free}
    counts = design.count == other.design.count or (
        design.kind in SAMPLED and (design.count or 0) < (other.design.count or 0)
    )
    return (
        alike == other.design
        and ways
        and counts
        and design.copies <= other.design.copies
        and run.model_copy(update=same) == other.run
    )


def grown(folder: Folder, study: Study, source: Path, shard: int) -> Folder:
    """The folder with a further plan.

    Args:
        folder: what is there.
        study: the study that `growable` lets pass.
        source: its file.
        shard: number of runs of a new shard.

    Raises:
        StudyError: a design whose first rows would be others, or a folder that cannot be written.
    """
    path, number = folder.path, folder.plans
    before = _counts(folder)
    design = make_design(study, source, before if study.design.kind == "latin-hypercube" else ())
    names = [factor.name for factor in study.factors]
    if not design.select(names).slice(0, folder.rows).equals(folder.design().select(names)):
        raise StudyError(
            f"{source}: design.count = {value_text(study.design.count)}: the first {folder.rows} rows would be others; "
            "give another folder"
        )
    rows, copies = design.num_rows, study.design.copies
    same = {name: getattr(folder.study.run, name) for name in ("shard", "keep_states")}
    restart = study.run.model_copy(update=same) != folder.study.run
    blocks = [Block((0, rows), (0, copies))] if restart else [
        Block((0, folder.rows), (folder.copies, copies)), Block((folder.rows, rows), (0, copies))]  # fmt: skip
    facts: dict[str, Any] = {
        "rows": rows,
        "shard": shard,
        "blocks": [[*block.rows, *block.copies] for block in blocks if len(block)],
        "after": folder.identity,
    }
    fixed = study.model_copy(update={"study": study.study.model_copy(update={"drive": "drive.toml"})})
    if restart:
        for table in (folder.results, folder.path / REPLICATES):
            _keep_as_it_is(table, table.with_name(f"{table.stem}.before-{number}.parquet"))
    write_text(path / plan_file("study.toml", number), dumps_study(fixed))
    write_table(path / plan_file("design.parquet", number), design)
    write_plan(path, number, {**facts, "restart": True} if restart else facts)
    return open_folder(path)


def _keep_as_it_is(table: Path, other: Path) -> None:
    """A copy of a table, if it is there, under a name that nothing writes to."""
    if table.exists() and not other.exists():
        with refusals(other, StudyError), whole_file(other) as file:
            file.write(table.read_bytes())


def _counts(folder: Folder) -> tuple[int, ...]:
    """Points of the design before each growth."""
    files = [folder.path / plan_file("study.toml", number) for number in range(folder.plans)]
    return tuple(dict.fromkeys(load_study(file).design.count or 0 for file in files))
