"""How the launches of a GPU are cut, so that none waits for the last blocks of another.

A block takes one variant through all steps of a launch, and a GPU holds so many blocks at once: a turn. A launch ends
with a turn that few blocks may be left for, while the next launch waits. Where there is more than a turn of variants
they go in two groups, each on a stream of its own, whose launches are cut into shorter ones: while the last blocks of
one group run, blocks of the other fill the GPU, and the rest of a turn is lost only once in `PARTS` launches. Results
do not depend on where launches end.
"""

from __future__ import annotations

from collections.abc import Sequence

PARTS = 8
"""Launches that the steps of one are cut into."""

Phase = tuple[str, int, int]
"""Kernel, steps, and steps before in the same call."""


def groups(count: int, turn: int) -> list[tuple[int, int]]:
    """First variant and number of variants of each group of `count` variants."""
    if count <= turn:
        return [(0, count)]
    half = count // 2
    return [(0, half), (half, count - half)]


def cut(phases: Sequence[Phase], unit: int) -> list[Phase]:
    """Phases cut into about `PARTS` of equal length in all, of whole units of steps."""
    total = sum(steps for _, steps, _ in phases)
    most = max(unit, -(-total // (PARTS * unit)) * unit)
    return [
        (name, min(most, steps - done), before + done)
        for name, steps, before in phases
        for done in range(0, steps, most)
    ]
