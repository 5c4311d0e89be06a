"""Plans of a study: copies of rows, cut into shards. A study that is grown adds a plan; those before stay."""

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

Numbers: TypeAlias = "NDArray[np.int64]"
FORMAT = 1
FIXED = ("study.toml", "drive.toml", "design.parquet")
"""The files that a plan is made of."""


@dataclass(frozen=True)
class Block:
    """Some copies of some rows, row by row.

    Attributes:
        rows: the first row, and the one behind the last.
        copies: of each, likewise.
    """

    rows: tuple[int, int]
    copies: tuple[int, int] = (0, 1)

    def __len__(self) -> int:
        return (self.rows[1] - self.rows[0]) * (self.copies[1] - self.copies[0])

    def tasks(self, begin: int, end: int) -> tuple[Numbers, Numbers]:
        """Row and copy of the runs from `begin` to `end`."""
        import numpy as np

        number, width = np.arange(begin, end), self.copies[1] - self.copies[0]
        return self.rows[0] + number // width, self.copies[0] + number % width


@dataclass(frozen=True)
class Part:
    """The runs that one plan of a folder adds.

    Attributes:
        blocks: what is run, in order.
        shard: number of runs of a shard; the last one may have fewer.
        first: number of its first shard.
        identity: the plan's digest, which its tables bear; "" in folders of earlier versions.
        digests: SHA-256 of the files that the plan is made of.
    """

    blocks: tuple[Block, ...]
    shard: int
    first: int = 0
    identity: str = ""
    digests: Mapping[str, str] = field(default_factory=dict)

    @property
    def count(self) -> int:
        """Number of runs."""
        return sum(map(len, self.blocks))

    @property
    def shards(self) -> range:
        """Numbers of its shards."""
        return range(self.first, self.first - (-self.count // self.shard))

    def size(self, shard: int) -> int:
        """Number of runs of a shard."""
        return min(self.shard, self.count - (shard - self.first) * self.shard)

    def tasks(self, shard: int) -> tuple[Numbers, Numbers]:
        """Row and copy of each run of a shard."""
        import numpy as np

        begin = (shard - self.first) * self.shard
        end, before = begin + self.size(shard), 0
        found = []
        for block in self.blocks:
            low, high = max(begin - before, 0), min(end - before, len(block))
            if low < high:
                found.append(block.tasks(low, high))
            before += len(block)
        rows, copies = zip(*found, strict=True)
        return np.concatenate(rows), np.concatenate(copies)


def blocks_of(tasks: Iterable[tuple[int, int]], copies: int) -> tuple[Block, ...]:
    """Blocks of runs (row, copy) in ascending order; of a study that runs each row `copies` times."""
    rows: dict[int, list[int]] = {}
    for row, copy in tasks:
        rows.setdefault(row, []).append(copy)
    found: list[Block] = []
    for row, mine in rows.items():
        for begin, end in _runs(mine):
            last = found[-1] if found else None
            if last and last.rows[1] == row and last.copies == (begin, end) and end - begin == copies:
                found[-1] = Block((last.rows[0], row + 1), last.copies)
            else:
                found.append(Block((row, row + 1), (begin, end)))
    return tuple(found)


def _runs(numbers: Sequence[int]) -> list[tuple[int, int]]:
    """Ascending numbers as (first, behind the last) of what is consecutive."""
    found: list[tuple[int, int]] = []
    for number in numbers:
        if found and found[-1][1] == number:
            found[-1] = found[-1][0], number + 1
        else:
            found.append((number, number + 1))
    return found


def plan_file(name: str, number: int) -> str:
    """A file's name in the plan of this number: study.toml, study.1.toml, study.2.toml, ..."""
    stem, _, ending = name.rpartition(".")
    return f"{stem}.{number}.{ending}" if number else name


def write_plan(path: Path, number: int, facts: Mapping[str, Any]) -> None:
    """Writes a plan, whose other files are there, if there is none of this number."""
    names = FIXED if not number else [name if name == "drive.toml" else plan_file(name, number) for name in FIXED]
    plan: dict[str, Any] = {"format": FORMAT, **facts, "digests": {name: file_digest(path / name) for name in names}}
    plan["digest"] = _identity(plan)
    write_study_text(path / plan_file("plan.json", number), json.dumps(plan) + "\n", keep=True)


def read_plan(path: Path, number: int, before: Sequence[Part]) -> tuple[int, Part, bool]:
    """Rows of the design, what a plan adds, and whether it begins anew."""
    file = path / plan_file("plan.json", number)
    try:
        plan = parse_json(file.read_text())
        known = plan["format"] == FORMAT
        rows, shard, digests = int(plan["rows"]), int(plan["shard"]), dict(plan.get("digests", {}))
        identity = plan.get("digest", "")
        if identity != (_identity(plan) if digests else "") or rows < 0 or shard < 1:
            raise ValueError("its digest is wrong")
        if number and plan["after"] != before[-1].identity:
            raise ValueError("it follows another plan")
        blocks = [Block((a, b), (c, d)) for a, b, c, d in plan.get("blocks", [(0, rows, 0, 1)])]
        restart = bool(plan.get("restart", False))
    except OSError:
        raise StudyError(f"{path}: not a study's folder; make one with: warpchain study run") from None
    except (ValueError, KeyError, TypeError):
        raise StudyError(f"{file}: damaged") from None
    if not known:
        raise StudyError(f"{file}: format {plan['format']!r} is not known to this version ({FORMAT})")
    first = before[-1].shards.stop if before else 0
    return rows, Part(tuple(blocks), shard, first, identity, digests), restart


def _identity(plan: Mapping[str, Any]) -> str:
    """Digest of a plan, which marks a study's tables as its own."""
    text = json.dumps({name: value for name, value in plan.items() if name != "digest"}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def check_file(path: Path, digests: Mapping[str, str], name: str) -> None:
    """Refuses a file of a folder that is not what the plan was made with."""
    if name in digests and file_digest(path / name) != digests[name]:
        raise StudyError(f"{path / name}: was changed or is damaged; give another folder")
