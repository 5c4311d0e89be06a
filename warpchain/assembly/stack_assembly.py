"""Initial states and layout faults of many drives, by stacks; equal layouts once."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly.assembly import Assembly, assemble_stack
from warpchain.assembly.layout_checks import has_possible_faults, layout_faults
from warpchain.assembly.path import results_in_parts
from warpchain.drive.body_ties import body_ties
from warpchain.errors import DriveError
from warpchain.model import ChainModel
from warpchain.model.stacks import (
    Stack,
    first_refusal,
    first_refused_variant,
    pick_variants,
    stack_arrays,
    stacks_of_drives,
    variant_count,
)
from warpchain.model.trains import has_trains

Places = NDArray[np.int64]

PULLING_CHAIN_KEYS = "stiffness", "roller_mass", "mass_per_length"
"""Keys of a chain that pull an arm or end, or stiffen stops."""
LAYOUT_FREE_KEYS = frozenset(("inertia", "load", "bearing"))
"""Keys of a sprocket that its layout is free of."""
WEIGHT_KEYS = frozenset(("mass", "balance_wheel"))
"""Keys of a sprocket that only weigh on arms or ends."""


@dataclass(frozen=True)
class Assemblies(Sequence[Assembly]):
    """Initial states of V variants, a sequence of `Assembly`.

    Attributes:
        blocks: states of stacks; variants may share a state.
        block, row: (V,) block of each variant, and its row there.
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

    def pick_variants(self, which: Places) -> Assemblies:
        """Initial states of chosen variants, each as often as named."""
        return Assemblies(self.blocks, self.block[which], self.row[which])

    def states_by_block(self, members: Places) -> Iterator[tuple[Places, Assembly]]:
        """Yields initial states by block: places (K,) in `members`, and states (K, ...)."""
        mine = self.block[members]
        for block in np.unique(mine).tolist():
            places, state = np.flatnonzero(mine == block), self.blocks[block]
            rows = self.row[members[places]]
            whole = len(rows) == len(state.position) and bool((rows == np.arange(len(rows))).all())
            yield places, state if whole else state.pick_variants(rows)

    def parts_of_stacks(self, stacks: Sequence[Stack[ChainModel]]) -> Iterator[tuple[Stack[ChainModel], Assembly]]:
        """Yields stacks in parts of one block each, and their initial states."""
        for stack in stacks:
            for places, state in self.states_by_block(stack.members):
                whole = len(places) == len(stack.members)
                yield stack if whole else Stack(stack.members[places], pick_variants(stack.one, places)), state


def assemble_stacks(stacks: Sequence[Stack], numbers: Places | None = None) -> Assemblies:
    """Initial states of all variants of stacks of drives.

    Args:
        numbers: of the variants in errors; None counts from 0.

    Raises:
        DriveError: a chain that does not fit, of the first such variant.
    """
    count = sum(len(stack.members) for stack in stacks)
    block, row = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.int64)
    blocks: list[Assembly] = []
    known: dict[Hashable, int] = {}
    refused: list[tuple[int, DriveError]] = []
    for stack in stacks:
        model, which = _stack_of_layouts(stack.one, len(stack.members))
        size = variant_count(model)
        key = _layout_key(model) if size == 1 else None
        if key is not None and key in known:
            block[stack.members] = known[key]
            continue
        try:
            found = results_in_parts(model, size, assemble_stack)
        except DriveError:
            refused.append(
                first_refused_variant(
                    stack, lambda model: results_in_parts(model, variant_count(model), assemble_stack)
                )
            )
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
        raise first_refusal(refused, numbers)
    return Assemblies(tuple(blocks), block, row)


def _stack_of_layouts(model: ChainModel, count: int) -> tuple[ChainModel, Places]:
    """Stack of the distinct layouts of another, and each variant's layout (V,)."""
    if count == 1:
        return model, np.zeros(1, dtype=np.int64)
    one, own = pick_variants(model, 0), _layout_values(model)
    layout = replace(
        one,
        chain=one.chain.model_copy(update=own["chain"]),
        sprockets=tuple(
            sprocket.model_copy(update=of) for sprocket, of in zip(one.sprockets, own["sprockets"], strict=True)
        ),
        shafts=tuple(shaft.model_copy(update=of) for shaft, of in zip(one.shafts, own["shafts"], strict=True)),
        guides=model.guides,
        arms=model.arms,
        tensioners=model.tensioners,
        run=one.run.model_copy(update=own["run"]),
    )
    columns = list(stack_arrays(layout))
    if not columns:
        return layout, np.zeros(count, dtype=np.int64)
    table = np.stack(columns, axis=1).view(np.int64)
    _, first, which = np.unique(table, axis=0, return_index=True, return_inverse=True)
    if len(first) == count:
        return layout, np.arange(count)
    return pick_variants(layout, first), which.ravel().astype(np.int64)


def _layout_key(model: ChainModel) -> Hashable:
    """Hashable key of a drive's layout, with what turns its arms."""
    own = _layout_values(model)
    values = [value for of in (own["chain"], *own["sprockets"], *own["shafts"], own["run"]) for value in of.values()]
    tied = tuple(body_ties(model)) if has_trains(model) else ()
    return (*values, tied, model.driver, model.guides, model.arms, model.tensioners, model.contact.sprocket)


def _layout_values(model: ChainModel) -> dict[str, Any]:
    """Values of chain, sprockets, shafts and run that a layout depends on, by name."""

    def fields_of(part: Any, *names: str) -> dict[str, Any]:
        """Values of a part by name."""
        return {name: getattr(part, name) for name in names}

    lengths: tuple[str, ...] = "pitch", "links", "elongation", "worn_links", "play", "roller_radius", "load"
    pulls = model.arms or model.chain.is_open  # on arms, or on weights at its ends
    if pulls:
        lengths = (*lengths, *PULLING_CHAIN_KEYS)
    outer = model.chain.outer
    if outer is not None:
        outer = outer.model_copy(update={"damping": None} if pulls else {"damping": None, "stiffness": None})
    beside = LAYOUT_FREE_KEYS if pulls else LAYOUT_FREE_KEYS | WEIGHT_KEYS
    return {
        "chain": fields_of(model.chain, *lengths) | {"outer": outer},
        "sprockets": [
            fields_of(of, *(name for name in type(of).model_fields if name not in beside)) for of in model.sprockets
        ],
        "shafts": [fields_of(shaft, "name", "prescribed", "initial_speed") for shaft in model.shafts],
        "run": fields_of(model.run, "gravity", "phase"),
    }


def layout_faults_of_drives(
    models: Sequence[ChainModel], assemblies: Assemblies, stacks: Sequence[Stack] | None = None
) -> list[tuple[str, ...]]:
    """Layout faults of each drive, a line each; equal layouts are checked once."""
    found: list[tuple[str, ...]] = [()] * len(models)
    known: dict[tuple[int, ...], tuple[str, ...]] = {}
    for part, assembly in assemblies.parts_of_stacks(stacks_of_drives(models) if stacks is None else stacks):
        for v in part.members[has_possible_faults(part.one, assembly.path)].tolist():
            key = (int(assemblies.block[v]), int(assemblies.row[v]), *map(id, models[v].guides))
            if key not in known:
                known[key] = layout_faults(models[v], assemblies[v].path)
            found[v] = known[key]
    return found


def layout_faults_line(layouts: Sequence[Sequence[str]]) -> str | None:
    """Layout faults of variants in one line; None without any."""
    wrong = [v for v, found in enumerate(layouts) if found]
    if not wrong:
        return None
    first = "; ".join(layouts[wrong[0]])
    if len(layouts) == 1:
        return first
    more = f", and of {len(wrong) - 1} further variants alike" if len(wrong) > 1 else ""
    return f"variant {wrong[0]}{more}: {first}"
