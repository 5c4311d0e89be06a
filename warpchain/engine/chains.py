"""Rows of packed ensembles: one for each chain of each variant, those of a variant one after the other.

A chain is packed, settled and looked at as a drive of its own (`warpchain.drive.chain_drives`). What couples the chains
of a variant while they are stepped is in `structs.Motion`: bodies of one shaft or train, which each have the inertia of
all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly.bounds import tension_scale
from warpchain.assembly.crossings import check_planes
from warpchain.drive import Drive
from warpchain.drive.chain_drives import chain_drives, loaded_chain_drives
from warpchain.drive.geared_chain_drives import shared_bodies
from warpchain.drive.parts_by_chain import ChainDrive, shaft_of_sprocket
from warpchain.drive.stacks import Stack, first_refusal, stacks_of_drives
from warpchain.drive.trains import inertia_of_body
from warpchain.drive.transmission import drive_with_bare_shafts, is_geared
from warpchain.engine.answers import share_answers
from warpchain.engine.pack import fill_steps
from warpchain.engine.packed import Packed
from warpchain.errors import DriveError
from warpchain.results.metrics import VariantEnds

Item = TypeVar("Item")


class Rows:
    """The rows of variants.

    Args:
        drives: the variants.
        stacks: the drives sorted into kinds.

    Attributes:
        first: (V + 1,) row of each variant's first chain, and where the last one's end.
        drives: of each row; of variants with one chain, theirs.
        stacks: these sorted into kinds.
    """

    def __init__(self, drives: Sequence[Drive], stacks: Sequence[Stack]) -> None:
        self.variants, self.alone = drives, not any(stack.drive.chains for stack in stacks)
        if self.alone:
            self.first, self.drives, self.stacks = np.arange(len(drives) + 1), drives, stacks
            return
        rings = [chain_drives(drive) for drive in drives]
        self.rings: list[ChainDrive] = [ring for of in rings for ring in of]
        self.first = np.append(0, np.cumsum([len(of) for of in rings]))
        self.drives = [ring.drive for ring in self.rings]
        self.stacks = stacks_of_drives(self.drives)

    @cached_property
    def owner(self) -> NDArray[np.int64]:
        """(rows,) the variant of each."""
        return np.repeat(np.arange(len(self.variants)), np.diff(self.first))

    def spread(self, values: Sequence[Item]) -> Sequence[Item]:
        """Values of variants, row by row."""
        return values if self.alone else [values[v] for v in self.owner.tolist()]

    def called(self, numbers: NDArray[np.int64]) -> NDArray[np.int64]:
        """(rows,) what each is called, after its variant; `numbers` is what these are called."""
        return numbers if self.alone else numbers[self.owner]

    def layouts(self, layouts: Sequence[tuple[str, ...]]) -> Sequence[tuple[str, ...]]:
        """Faults of the variants' layouts, from those of rows."""
        if self.alone:
            return layouts
        named = [tuple(f"{ring.name}: {line}" if ring.name else line for line in lines)
                 for ring, lines in zip(self.rings, layouts, strict=True)]  # fmt: skip
        return [sum(named[a:b], ()) for a, b in zip(self.first[:-1], self.first[1:], strict=True)]

    def ended(self, rows: VariantEnds, schedules: Sequence[Any], stacks: Sequence[Stack]) -> VariantEnds:
        """Ends of variants, from those of their rows."""
        if self.alone:
            return rows
        causes = np.array(rows.causes or [""] * len(self.drives), dtype=object)
        spans = list(zip(self.first[:-1], self.first[1:], strict=True))
        layouts = None if rows.layouts is None else self.layouts(rows.layouts)  # type: ignore[arg-type]
        return replace(
            rows.select_variants(self.first[:-1]),
            drives=self.variants,
            schedules=schedules,
            layouts=layouts,
            causes=[next(filter(None, causes[a:b]), "") for a, b in spans],
            stacks=stacks,
        )

    def couple(self, packed: Packed, numbers: NDArray[np.int64] | None = None) -> None:
        """Ties the bodies of each shaft of an ensemble packed row by row, in float64; variants are called `numbers`.

        Raises:
            DriveError: chains that cross in one plane.
        """
        if self.alone:
            return
        for v, (a, b) in enumerate(zip(self.first[:-1].tolist(), self.first[1:].tolist(), strict=True)):
            if b - a > 1:
                try:
                    check_planes(self.variants[v], [packed.assemblies[r].path for r in range(a, b)])
                except DriveError as error:
                    raise first_refusal([(v, error)], numbers) from None
                self._couple(packed, v, a, b)
        fill_steps(packed)

    def _couple(self, packed: Packed, v: int, a: int, b: int) -> None:
        """Ties the bodies of variant v, whose rows are `a` to `b` - 1."""
        geared = is_geared(self.variants[v])
        drive, rows = self.variants[v] if geared else drive_with_bare_shafts(self.variants[v]), packed.drives
        rows["rings"][a:b] = [b - a, *[0] * (b - a - 1)]
        begin = int(rows["first_body"][a])
        _number_trains(packed, range(a, b), begin)
        members_of: list[tuple[Member, Any]] = []
        for r in range(a, b):
            for k, s in enumerate(self.rings[r].places["sprockets"]):
                member = (r, int(rows["first_body"][r]) + k, int(rows["first_sprocket"][r]) + k)
                members_of.append((member, drive.sprockets[s]))
                packed.motions["own_inertia"][member[1]] = inertia_of_body(drive, s)
        if geared:
            for (one, shaft), (other, k) in shared_bodies(drive, self.rings[a:b]):
                _turn_as(packed, int(rows["first_body"][a + one]) + shaft, int(rows["first_body"][a + other]) + k)
        groups: dict[str, list[Member]] = {}
        for member, sprocket in members_of:
            key = str(packed.motions["train"][member[1]]) if geared else shaft_of_sprocket(sprocket)
            groups.setdefault(key, []).append(member)
        for members in groups.values():
            if len({row for row, *_ in members}) > 1:
                if not geared:
                    _tie(packed, members, begin)
                _share_contacts(packed, members)
        for r, ring in zip(range(a, b), loaded_chain_drives(drive), strict=True):
            rows["tension_scale"][r] = tension_scale(ring.drive, packed.assemblies[r])


Member = tuple[int, int, int]
"""A sprocket: its row, body and place among all sprockets."""


def _number_trains(packed: Packed, rows: range, begin: int) -> None:
    """Numbers the trains of a variant's rows among its bodies, which begin at `begin`; an arm has a negative number."""
    for row in packed.drives[rows.start : rows.stop]:
        bodies = int(row["first_body"]) + np.arange(int(row["bodies"]))
        own, motions = bodies - begin, packed.motions
        if row["tied"]:
            trains = motions["train"][bodies]
            motions["train"][bodies] = np.where(trains < 0, -1 - own, trains + own[0])
            motions["ratio"][bodies[trains < 0]] = 1.0
        else:
            motions["train"][bodies], motions["ratio"][bodies] = own, 1.0


OF_A_TRAIN = ("train", "ratio", "prescribed", "inverse_inertia", "speed", "ramp_time", "drive_harmonics", "drive_table")
"""What bodies of a train have in common of `structs.Motion`, the sign apart."""


def _turn_as(packed: Packed, home: int, body: int) -> None:
    """Makes a body turn as another chain's, a shaft that stands for it there (`drive.geared_chain_drives`)."""
    motions = packed.motions
    motions["apart"][body], motions["own_inertia"][home] = home - body, 0.0
    for name in OF_A_TRAIN:
        motions[name][body] = motions[name][home]
    if motions["prescribed"][home]:
        motions["sign"][body] = motions["sign"][home]
    packed.bodies["speed"][body] = packed.bodies["speed"][home]


def _tie(packed: Packed, members: Sequence[Member], begin: int) -> None:
    """Makes bodies one shaft: rows, bodies and sprockets of all; the variant's bodies begin at `begin`."""
    bodies = np.array([body for _, body, _ in members])
    packed.motions["train"][bodies] = bodies[0] - begin
    packed.motions["apart"][bodies] = bodies[0] - bodies
    packed.bodies["speed"][bodies] = packed.bodies["speed"][bodies[0]]


def _share_contacts(packed: Packed, members: Sequence[Member]) -> None:
    """Makes the answer of a train, and the mass that friction has to stop, go by the rollers of all its chains.

    As in `fill.tooth_effective_mass`, with 1/m_e = 1/m + sum of z times the mobility of a point.
    """
    rows, _, sprockets = (np.array(of) for of in zip(*members, strict=True))
    share_answers(packed, rows, sprockets)
    mass, stopped = packed.chains["mass"][rows], packed.tooth_friction["inertia"]
    rubs = stopped[sprockets] > 0.0
    yields = (1.0 / stopped[sprockets][rubs] - 1.0 / mass[rubs]).sum()
    stopped[sprockets[rubs]] = 1.0 / (1.0 / mass[rubs] + yields)
