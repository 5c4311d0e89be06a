"""Chain rows of packed ensembles: one a chain, those of a variant one after the other.

Each chain is packed and settled alone; then bodies of one shaft or train are tied.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly.bounds import tension_scale
from warpchain.assembly.crossings import check_planes
from warpchain.drive import Drive
from warpchain.engine.contact_mobility import sum_mobility_over_chains
from warpchain.engine.pack import fill_step_dependence
from warpchain.engine.packed_ensemble import PackedEnsemble
from warpchain.errors import DriveError
from warpchain.model import ChainModel, Model
from warpchain.model.stacks import Stack, first_refusal
from warpchain.model.trains import inertia_of_body
from warpchain.results.metrics import VariantEnds


class ChainRows:
    """Chain rows of variants.

    Attributes:
        variants: (V,) models of drives.
        first_rows: (V + 1,) row of each variant's first chain, and the end.
        models: (rows,) of chains.
        stacks: of these.
    """

    def __init__(self, drives: Sequence[Drive], stacks: Sequence[Stack[Drive]]) -> None:
        self.drives, self.variants = drives, [Model(drive) for drive in drives]
        counts = [len(drive.each_chain) for drive in drives]
        self.first_rows = np.append(0, np.cumsum(counts, dtype=np.int64))
        self.models = [chain for variant in self.variants for chain in variant.chains]
        rows = [
            Stack(self.first_rows[stack.members] + r, chain)
            for stack in stacks
            for r, chain in enumerate(Model(stack.one).chains)
        ]
        self.stacks = sorted(rows, key=lambda stack: int(stack.members[0]))

    @cached_property
    def variant_of_row(self) -> NDArray[np.int64]:
        """Variant (rows,) of each chain row."""
        return np.repeat(np.arange(len(self.drives)), np.diff(self.first_rows))

    def rows_of_variants(self) -> Iterator[tuple[int, int]]:
        """Yields the first chain row of each variant, and the end."""
        yield from pairwise(self.first_rows.tolist())

    def layout_faults(self, layouts: Sequence[Sequence[str]]) -> Sequence[tuple[str, ...]]:
        """Layout faults of variants, from those of chain rows."""
        named = [
            tuple(f"{model.name}: {line}" if model.name else line for line in lines)
            for model, lines in zip(self.models, layouts, strict=True)
        ]
        return [sum(named[a:b], ()) for a, b in self.rows_of_variants()]

    def variant_ends(
        self, rows: VariantEnds[ChainModel], schedules: Sequence[Any], stacks: Sequence[Stack[Drive]]
    ) -> VariantEnds[Drive]:
        """Final states of variants, from those of chain rows."""
        first, causes = self.first_rows[:-1], rows.causes or [""] * len(self.models)
        return VariantEnds(
            self.drives,
            schedules,
            rows.steps[first],
            rows.diverged[first],
            rows.settled[first],
            layouts=None if rows.layouts is None else self.layout_faults(rows.layouts),
            causes=[next(filter(None, causes[a:b]), "") for a, b in self.rows_of_variants()],
            stacks=stacks,
        )

    def couple_chains(self, packed: PackedEnsemble, numbers: NDArray[np.int64] | None = None) -> None:
        """Ties the chains of each variant in `packed`, in float64; `numbers` are for errors.

        Raises:
            DriveError: chains that cross in one plane.
        """
        spans = [(v, a, b) for v, (a, b) in enumerate(self.rows_of_variants()) if b - a > 1]
        for v, a, b in spans:
            try:
                check_planes(self.variants[v], [packed.assemblies[r].path for r in range(a, b)])
            except DriveError as error:
                raise first_refusal([(v, error)], numbers) from None
            self._couple_chains_of(packed, v, a, b)
        if spans:
            fill_step_dependence(packed)

    def _couple_chains_of(self, packed: PackedEnsemble, v: int, a: int, b: int) -> None:
        """Ties the chains of variant v, rows `a` to before `b`."""
        variant, rows = self.variants[v], packed.drives
        rows["chains"][a:b] = [b - a, *[0] * (b - a - 1)]
        begin = int(rows["first_body"][a])
        _number_trains(packed, range(a, b), begin)
        sprockets: list[ChainSprocket] = []
        for r in range(a, b):
            for k, s in enumerate(self.models[r].places["sprockets"]):
                member = (r, int(rows["first_body"][r]) + k, int(rows["first_sprocket"][r]) + k)
                sprockets.append(member)
                packed.motions["own_inertia"][member[1]] = inertia_of_body(variant.drive, s)
        for (one, shaft), (other, k) in variant.shared_bodies:
            _tie_body_to(packed, int(rows["first_body"][a + one]) + shaft, int(rows["first_body"][a + other]) + k)
        trains: dict[int, list[ChainSprocket]] = {}
        for member in sprockets:
            trains.setdefault(int(packed.motions["train"][member[1]]), []).append(member)
        for members in trains.values():
            if len({row for row, *_ in members}) > 1:
                _sum_contacts_over_chains(packed, members)
        for r, chain in zip(range(a, b), variant.loaded_chains, strict=True):
            rows["tension_scale"][r] = tension_scale(chain, packed.assemblies[r])


ChainSprocket = tuple[int, int, int]
"""A chain's sprocket: row, body and place among all."""


def _number_trains(packed: PackedEnsemble, rows: range, begin: int) -> None:
    """Numbers the trains of a variant's chain rows."""
    for row in packed.drives[rows.start : rows.stop]:
        bodies = int(row["first_body"]) + np.arange(int(row["bodies"]))
        own, motions = bodies - begin, packed.motions
        if row["tied"]:
            trains = motions["train"][bodies]
            motions["train"][bodies] = np.where(trains < 0, -1 - own, trains + own[0])
            motions["ratio"][bodies[trains < 0]] = 1.0
        else:
            motions["train"][bodies], motions["ratio"][bodies] = own, 1.0


TRAIN_FIELDS = (
    "train",
    "ratio",
    "prescribed",
    "inverse_inertia",
    "speed",
    "ramp_time",
    "drive_harmonics",
    "drive_table",
)
"""Fields of `structs.Motion` that chains' bodies of a train share."""


def _tie_body_to(packed: PackedEnsemble, home: int, body: int) -> None:
    """Ties `body` to `home`, on its shaft in another chain."""
    motions = packed.motions
    motions["shaft_offset"][body], motions["own_inertia"][home] = home - body, 0.0
    for name in TRAIN_FIELDS:
        motions[name][body] = motions[name][home]
    if motions["prescribed"][home]:
        motions["sign"][body] = motions["sign"][home]
    packed.bodies["speed"][body] = packed.bodies["speed"][home]


def _sum_contacts_over_chains(packed: PackedEnsemble, members: Sequence[ChainSprocket]) -> None:
    """Fills a train's contact mobility and effective mass over chains."""
    rows, _, sprockets = (np.array(of) for of in zip(*members, strict=True))
    sum_mobility_over_chains(packed, rows, sprockets)
    mass, stopped = packed.chains["mass"][rows], packed.tooth_friction["inertia"]
    rubs = stopped[sprockets] > 0.0
    yields = (1.0 / stopped[sprockets][rubs] - 1.0 / mass[rubs]).sum()
    stopped[sprockets[rubs]] = 1.0 / (1.0 / mass[rubs] + yields)
