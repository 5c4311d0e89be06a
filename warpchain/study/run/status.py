"""How a study stands. A status is asked for often, so nothing here loads drives or tables that it does not want."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from warpchain.results.reasons import alike_reasons, by_frequency
from warpchain.study.reasons import STATUSES
from warpchain.study.run.folder import Folder, open_folder

LATEST = 20
"""Shards that the rate of a study is taken from."""
REASONS = 3
"""Most reasons that an outcome tells."""


@dataclass(frozen=True)
class Outcome:
    """How a study stands.

    Attributes:
        folder: its folder.
        counts: number of variants by status, of the shards that are done.
        reasons: the most frequent (reason, how many) of variants that are not ok; alike in all but numbers is one.
        shards: (done, all).
        left: number of variants of the shards that are not done.
        rate: variants a second, as the latest shards came in; None where too few are there to tell.
        table: the whole table's file, once there is one.
        went_on: of a study with another duration or window than before, (runs that went on from where the ones before
            stood, runs that began anew); None of others.
    """

    folder: Path
    counts: Mapping[str, int]
    reasons: tuple[tuple[str, int], ...]
    shards: tuple[int, int]
    left: int
    rate: float | None
    table: Path | None
    went_on: tuple[int, int] | None = None


def study_status(out: str | os.PathLike[str]) -> Outcome:
    """How a study's folder stands.

    Raises:
        StudyError: no such folder, or a damaged one.
    """
    folder = open_folder(Path(out))
    done = [shard for shard in folder.shards if folder.done(shard)]
    counts = Counter(dict.fromkeys(STATUSES, 0))
    reasons: list[tuple[str, str, int]] = []
    for shard in done:
        ended = folder.ended(shard)
        counts.update(ended.counts)
        reasons += ended.reasons
    table = folder.results if folder.results.exists() else None
    often = tuple((reason, number) for _, reason, number in by_frequency(alike_reasons(reasons))[:REASONS])
    left = folder.runs - sum(folder.size(shard) for shard in done)
    shards = len(done), len(folder.shards)
    return Outcome(folder.path, dict(counts), often, shards, left, _rate(folder, done), table, _went_on(folder))


def _rate(folder: Folder, done: Sequence[int]) -> float | None:
    """Variants a second of the shards that came in last, by the times of their files."""
    landed = sorted((folder.table_path(shard).stat().st_mtime, folder.size(shard)) for shard in done)[-LATEST:]
    if len(landed) < 3 or landed[-1][0] <= landed[0][0]:
        return None
    return sum(size for _, size in landed[1:]) / (landed[-1][0] - landed[0][0])


def _went_on(folder: Folder) -> tuple[int, int] | None:
    """See `Outcome.went_on`."""
    if not folder.before:
        return None
    from warpchain.study.run.stood import went_on

    return went_on(folder)
