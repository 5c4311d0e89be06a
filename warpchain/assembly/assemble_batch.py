"""The initial states and layouts of many drives: a stack of a kind at once, and what differs in no place once."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly.assembly import Assembly, assemble_stack
from warpchain.assembly.layout_checks import findings, suspects
from warpchain.assembly.path import in_parts
from warpchain.drive import Drive
from warpchain.drive.batch import Stack, arrays_of, first_of, first_refused, picked, size_of, stacks_of
from warpchain.drive.trains import body_ties, has_trains
from warpchain.errors import DriveError

Places = NDArray[np.int64]

PULLS = "stiffness", "roller_mass", "mass_per_length"
"""Values of a chain that pull an arm, or make its stops as stiff as they are; outer links' stiffness does, too."""
BESIDE = frozenset(("inertia", "load", "bearing"))
"""Values of a sprocket that its layout does not hang on."""
WEIGHTS = frozenset(("mass", "balance_wheel"))
"""Those that only weigh on an arm."""


@dataclass(frozen=True)
class Assemblies(Sequence[Assembly]):
    """The initial states of V variants.

    Attributes:
        blocks: of stacks; variants may share a state.
        block, row: (V,) the block of each variant, and its row in it.
    """

    blocks: tuple[Assembly, ...]
    block: Places
    row: Places

    def __len__(self) -> int:
        return len(self.block)

    @overload
    def __getitem__(self, v: int) -> Assembly: ...
    @overload
    def __getitem__(self, v: slice) -> Assemblies: ...
    def __getitem__(self, v: int | slice) -> Assembly | Assemblies:
        if isinstance(v, slice):
            return Assemblies(self.blocks, self.block[v], self.row[v])
        return self.blocks[self.block[v]][int(self.row[v])]

    def taken(self, which: Places) -> Assemblies:
        """Those of some variants, each as often as it is named."""
        return Assemblies(self.blocks, self.block[which], self.row[which])

    def among(self, members: Places) -> Iterator[tuple[Places, Assembly]]:
        """Some variants block by block: places (K,) in `members`, and their states (K, ...)."""
        mine = self.block[members]
        for block in np.unique(mine).tolist():
            places, state = np.flatnonzero(mine == block), self.blocks[block]
            rows = self.row[members[places]]
            whole = len(rows) == len(state.position) and bool((rows == np.arange(len(rows))).all())
            yield places, state if whole else state.of(rows)


def assemble_all(stacks: Sequence[Stack], numbers: Places | None = None) -> Assemblies:
    """Assembles the drives of stacks; `numbers` is what they are called, None counts them from 0.

    Raises:
        DriveError: for a drive whose chain does not fit; the message names the first variant.
    """
    count = sum(len(stack.members) for stack in stacks)
    block, row = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.int64)
    blocks: list[Assembly] = []
    known: dict[Hashable, int] = {}
    refused: list[tuple[int, DriveError]] = []
    for stack in stacks:
        drive, which = _layouts(stack.drive, len(stack.members))
        size = size_of(drive)
        key = _layout(drive) if size == 1 else None
        if key is not None and key in known:
            block[stack.members] = known[key]
            continue
        try:
            found = in_parts(drive, size, assemble_stack)
        except DriveError:
            refused.append(first_refused(stack, lambda drive: in_parts(drive, size_of(drive), assemble_stack)))
            continue
        if key is not None:
            known[key] = len(blocks)
        for places, assembly in found:
            own = np.full(size, -1)
            own[places] = np.arange(len(places))
            mine = own[which] >= 0
            block[stack.members[mine]], row[stack.members[mine]] = len(blocks), own[which][mine]
            blocks.append(assembly)
    if refused:
        raise first_of(refused, numbers)
    return Assemblies(tuple(blocks), block, row)


def _layouts(drive: Drive, count: int) -> tuple[Drive, Places]:
    """A stack of the layouts of a stack, each once, and which of them each of its variants has (V,).

    A layout is all of a drive that its initial state hangs on.
    """
    if count == 1:
        return drive, np.zeros(1, dtype=np.int64)
    one, own = picked(drive, 0), _layout_key(drive)
    layout = one.model_copy(
        update={
            "chain": one.chain.model_copy(update=own["chain"]),
            "sprockets": tuple(
                sprocket.model_copy(update=of) for sprocket, of in zip(one.sprockets, own["sprockets"], strict=True)
            ),
            "shafts": tuple(shaft.model_copy(update=of) for shaft, of in zip(one.shafts, own["shafts"], strict=True)),
            "guides": drive.guides,
            "arms": drive.arms,
            "tensioners": drive.tensioners,
            "run": one.run.model_copy(update=own["run"]),
        }
    )
    columns = list(arrays_of(layout))
    if not columns:
        return layout, np.zeros(count, dtype=np.int64)
    table = np.stack(columns, axis=1).view(np.int64)
    _, first, which = np.unique(table, axis=0, return_index=True, return_inverse=True)
    if len(first) == count:
        return layout, np.arange(count)
    return picked(layout, first), which.ravel().astype(np.int64)


def _layout(drive: Drive) -> Hashable:
    """The layout of one drive, by value: with arms, what pulls and pushes them counts."""
    own = _layout_key(drive)
    values = [value for of in (own["chain"], *own["sprockets"], *own["shafts"], own["run"]) for value in of.values()]
    tied = tuple(body_ties(drive)) if has_trains(drive) else ()
    return (*values, tied, drive.driver, drive.guides, drive.arms, drive.tensioners, drive.contact.sprocket)


def _layout_key(drive: Drive) -> dict[str, Any]:
    """The values of a drive's chain, sprockets, shafts and run that its layout depends on, by name."""

    def some(part: Any, *names: str) -> dict[str, Any]:
        return {name: getattr(part, name) for name in names}

    lengths: tuple[str, ...] = "pitch", "links", "elongation", "worn_links", "play", "roller_radius"
    if drive.arms:
        lengths = (*lengths, *PULLS)
    outer = drive.chain.outer
    if outer is not None:
        outer = outer.model_copy(update={"damping": None} if drive.arms else {"damping": None, "stiffness": None})
    beside = BESIDE if drive.arms else BESIDE | WEIGHTS
    return {
        "chain": some(drive.chain, *lengths) | {"outer": outer},
        "sprockets": [
            some(of, *(name for name in type(of).model_fields if name not in beside)) for of in drive.sprockets
        ],
        "shafts": [some(shaft, "name", "prescribed", "initial_speed") for shaft in drive.shafts],
        "run": some(drive.run, "gravity", "phase"),
    }


def layouts_of(
    drives: Sequence[Drive], assemblies: Assemblies, stacks: Sequence[Stack] | None = None
) -> list[tuple[str, ...]]:
    """Find the faults of each drive's layout; drives that share their state and guide-bars are checked once.

    Args:
        drives: the drives.
        assemblies: their initial states.
        stacks: the drives sorted into kinds, where they are.
    """
    found: list[tuple[str, ...]] = [()] * len(drives)
    known: dict[tuple[int, ...], tuple[str, ...]] = {}
    for stack in stacks_of(drives) if stacks is None else stacks:
        for places, assembly in assemblies.among(stack.members):
            members = stack.members[places]
            for v in members[suspects(picked(stack.drive, places), assembly.path)].tolist():
                key = (int(assemblies.block[v]), int(assemblies.row[v]), *map(id, drives[v].guides))
                if key not in known:
                    known[key] = findings(drives[v], assemblies[v].path)
                found[v] = known[key]
    return found


def layout_line(layouts: Sequence[Sequence[str]]) -> str | None:
    """The layouts' faults in one line, None where there are none."""
    wrong = [v for v, found in enumerate(layouts) if found]
    if not wrong:
        return None
    first = "; ".join(layouts[wrong[0]])
    if len(layouts) == 1:
        return first
    more = f", and of {len(wrong) - 1} further variants alike" if len(wrong) > 1 else ""
    return f"variant {wrong[0]}{more}: {first}"
