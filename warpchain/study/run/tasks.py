"""What a study runs: copies of rows, cut into shards. One that is grown adds a part, and leaves those before alone."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

Numbers: TypeAlias = "NDArray[np.int64]"


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
    """What one plan of a folder adds.

    Attributes:
        blocks: what is run, in order.
        shard: number of runs of a shard; the last one may have fewer.
        first: number of its first shard.
        identity: the plan's digest, which its tables bear; "" in folders of earlier versions.
        digests: SHA-256 of the files that the plan stands on.
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
