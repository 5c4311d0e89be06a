"""Plans of a study's folder: runs, copies of rows, cut into shards."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from warpchain.errors import StudyError
from warpchain.files import parse_json
from warpchain.study.store import file_digest, write_study_text

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

Indices: TypeAlias = "NDArray[np.int64]"
PLAN_FORMAT = 1
PLAN_FILES = ("study.toml", "drive.toml", "design.parquet")


@dataclass(frozen=True)
class RunBlock:
    """Block of runs: consecutive copies of rows."""

    rows: tuple[int, int]  # the first row, and the one behind the last
    copies: tuple[int, int] = (0, 1)  # the first copy of each row, and the one behind the last

    def __len__(self) -> int:
        return (self.rows[1] - self.rows[0]) * (self.copies[1] - self.copies[0])

    def runs_between(self, begin: int, end: int) -> tuple[Indices, Indices]:
        """Rows and copies of a block's runs in a span."""
        import numpy as np

        number, width = np.arange(begin, end), self.copies[1] - self.copies[0]
        return self.rows[0] + number // width, self.copies[0] + number % width


@dataclass(frozen=True)
class ShardPlan:
    """Plan of runs that a study's folder adds, in shards."""

    blocks: tuple[RunBlock, ...]
    shard_size: int  # runs of a shard; the last may have fewer
    first_shard: int = 0
    identity: str = ""  # the plan's digest, which its tables bear
    digests: Mapping[str, str] = field(default_factory=dict)  # SHA-256 of the plan's files
    plugins: str | None = None  # names and digests of the plug-ins with which it was made

    @property
    def run_count(self) -> int:
        """Number of runs of a plan."""
        return sum(map(len, self.blocks))

    @property
    def shard_numbers(self) -> range:
        """Numbers of a plan's shards."""
        return range(self.first_shard, self.first_shard - (-self.run_count // self.shard_size))

    def shard_run_count(self, shard: int) -> int:
        """Number of runs of a plan's shard."""
        return min(self.shard_size, self.run_count - (shard - self.first_shard) * self.shard_size)

    def shard_runs(self, shard: int) -> tuple[Indices, Indices]:
        """Rows and copies of a planned shard's runs, two arrays."""
        import numpy as np

        begin = (shard - self.first_shard) * self.shard_size
        end, before = begin + self.shard_run_count(shard), 0
        found = []
        for block in self.blocks:
            low, high = max(begin - before, 0), min(end - before, len(block))
            if low < high:
                found.append(block.runs_between(low, high))
            before += len(block)
        rows, copies = zip(*found, strict=True)
        return np.concatenate(rows), np.concatenate(copies)


def blocks_of_runs(tasks: Iterable[tuple[int, int]], copies: int) -> tuple[RunBlock, ...]:
    """Blocks that ascending runs (row, copy) form."""
    rows: dict[int, list[int]] = {}
    for row, copy in tasks:
        rows.setdefault(row, []).append(copy)
    found: list[RunBlock] = []
    for row, mine in rows.items():
        for begin, end in _consecutive_spans(mine):
            last = found[-1] if found else None
            if last and last.rows[1] == row and last.copies == (begin, end) and end - begin == copies:
                found[-1] = RunBlock((last.rows[0], row + 1), last.copies)
            else:
                found.append(RunBlock((row, row + 1), (begin, end)))
    return tuple(found)


def _consecutive_spans(numbers: Sequence[int]) -> list[tuple[int, int]]:
    """Begins and ends of consecutive numbers among ascending ones."""
    found: list[tuple[int, int]] = []
    for number in numbers:
        if found and found[-1][1] == number:
            found[-1] = found[-1][0], number + 1
        else:
            found.append((number, number + 1))
    return found


def plan_file_name(name: str, number: int) -> str:
    """Name of a plan's file: study.toml, study.1.toml, ..."""
    stem, _, ending = name.rpartition(".")
    return f"{stem}.{number}.{ending}" if number else name


def write_plan(path: Path, number: int, facts: Mapping[str, Any]) -> None:
    """Writes a plan's file, unless it exists."""
    from warpchain.drive.plugins import plugin_words

    names = (
        PLAN_FILES
        if not number
        else [name if name == "drive.toml" else plan_file_name(name, number) for name in PLAN_FILES]
    )
    plan: dict[str, Any] = {
        "format": PLAN_FORMAT,
        **facts,
        **({} if (words := plugin_words()) is None else {"plugins": words}),
        "digests": {name: file_digest(path / name) for name in names},
    }
    plan["digest"] = _plan_digest(plan)
    write_study_text(path / plan_file_name("plan.json", number), json.dumps(plan) + "\n", keep=True)


def read_plan(path: Path, number: int, before: Sequence[ShardPlan]) -> tuple[int, ShardPlan, bool]:
    """Number of rows, plan, and whether it begins anew, from file."""
    file = path / plan_file_name("plan.json", number)
    try:
        plan = parse_json(file.read_text())
        known = plan["format"] == PLAN_FORMAT
        rows, shard, digests = int(plan["rows"]), int(plan["shard"]), dict(plan.get("digests", {}))
        identity = plan.get("digest", "")
        if identity != (_plan_digest(plan) if digests else "") or rows < 0 or shard < 1:
            raise ValueError("its digest is wrong")
        if number and plan["after"] != before[-1].identity:
            raise ValueError("it follows another plan")
        blocks = [RunBlock((a, b), (c, d)) for a, b, c, d in plan.get("blocks", [(0, rows, 0, 1)])]
        restart, words = bool(plan.get("restart", False)), str(plan.get("plugins", "")) or None
    except OSError:
        raise StudyError(f"{path}: not a study's folder; make one with: warpchain study run") from None
    except (ValueError, KeyError, TypeError):
        raise StudyError(f"{file}: damaged") from None
    if not known:
        raise StudyError(f"{file}: format {plan['format']!r} is not known to this version ({PLAN_FORMAT})")
    first = before[-1].shard_numbers.stop if before else 0
    return rows, ShardPlan(tuple(blocks), shard, first, identity, digests, words), restart


def _plan_digest(plan: Mapping[str, Any]) -> str:
    """SHA-256 of a plan's entries, which marks its tables."""
    text = json.dumps({name: value for name, value in plan.items() if name != "digest"}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def check_plan_file(path: Path, digests: Mapping[str, str], name: str) -> None:
    """Raises StudyError for a plan's file that has changed."""
    if name in digests and file_digest(path / name) != digests[name]:
        raise StudyError(f"{path / name}: was changed or is damaged; give another folder")
