"""Packs drives: assembles each, and fills its rows of the ensemble's arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpchain.assembly import Assembly, assemble
from warpchain.assembly.tables import TableList
from warpchain.drive import Drive
from warpchain.drive.mounts import initial_center, initial_velocity
from warpchain.engine.alike import alike
from warpchain.engine.fill import (
    RowList,
    fill_chain,
    fill_drive,
    fill_guide,
    fill_motion,
    fill_mount,
    fill_sprocket,
    fill_strand,
)
from warpchain.engine.packed import Packed, state_rows
from warpchain.errors import DriveError
from warpchain.kernels import structs
from warpchain.kernels.rows import STATE_ROWS
from warpchain.results.schedule import Schedule


def _layout(drive: Drive) -> tuple[Any, ...]:
    """All of a drive that its initial state hangs on: drives alike in this are assembled once."""
    chain = drive.chain
    wheels = tuple((s.name, s.center, s.teeth, s.pitch, s.wrap, s.prescribed, s.mount) for s in drive.sprockets)
    lengths = (chain.pitch, chain.links, chain.elongation, chain.worn_links, chain.roller_radius)
    return (*lengths, wheels, drive.contact.sprocket, drive.run.gravity)


def _assembled(v: int, drive: Drive, known: dict[tuple[Any, ...], Assembly]) -> Assembly:
    layout = _layout(drive)
    if layout not in known:
        try:
            known[layout] = assemble(drive)
        except DriveError as error:
            raise DriveError(f"variant {v}: {error}") from None
    return known[layout]


def _zeros(struct: Any, count: int) -> NDArray[Any]:
    return np.zeros(max(count, 1), dtype=struct.numpy_dtype())


def pack(drives: Sequence[Drive], schedules: Sequence[Schedule]) -> Packed:
    """Packs drives in float64, each in its assembled initial state.

    Drives alike in all but their loads are packed once and repeated; then each is given its own loads.

    Raises:
        DriveError: for a drive whose chain does not fit; the message names the variant.
    """
    firsts, which = alike(drives)
    harmonics, seats, tables = RowList(3), RowList(2), TableList()
    packed = _pack_each(drives, firsts, harmonics, seats, tables)
    if len(firsts) < len(drives):
        packed = packed.taken(which)
        blank = np.zeros((), dtype=packed.motions.dtype)
        for drive, kind, begin in zip(drives, which, packed.drives["first_sprocket"].tolist(), strict=True):
            twin = drives[firsts[kind]]
            for s, sprocket in enumerate(drive.sprockets):
                if sprocket is not twin.sprockets[s]:
                    packed.motions[begin + s] = blank
                    angle = float(packed.bodies["angle"][begin + s])
                    fill_motion(packed.motions[begin + s], drive, s, angle, harmonics, tables)
    for name in ("step", "steps", "window_start", "window_end", "sample_every"):
        packed.drives[name] = [getattr(schedule, name) for _, schedule in zip(drives, schedules, strict=True)]
    packed.harmonics, packed.tables, packed.seats = harmonics.array(), tables.array(), seats.array()
    return packed


def _pack_each(
    everyone: Sequence[Drive], chosen: Sequence[int], harmonics: RowList, seats: RowList, tables: TableList
) -> Packed:
    """Packs the chosen drives one by one, but for their schedules, and gathers what their rows refer to."""
    drives = [everyone[v] for v in chosen]
    kinds = structs.types(wp.float64)
    count = len(drives)
    links = np.array([d.chain.links for d in drives])
    wheels = np.array([len(d.sprockets) for d in drives])
    bars = np.array([len(d.guides) for d in drives])
    known: dict[tuple[Any, ...], Assembly] = {}
    packed = Packed(
        precision="float64",
        drives=_zeros(structs.Drive, count),
        chains=_zeros(kinds.Chain, count),
        lengths=np.concatenate([drive.chain.link_lengths for drive in drives]),
        sprockets=_zeros(kinds.Sprocket, int(wheels.sum())),
        motions=_zeros(structs.Motion, int(wheels.sum())),
        mounts=_zeros(structs.Mount, int(wheels.sum())),
        guides=_zeros(kinds.Guide, int(bars.sum())),
        harmonics=np.zeros(0),
        tables=np.zeros(0),
        seats=np.zeros(0),
        rollers=np.zeros(STATE_ROWS * int(links.sum())),
        bodies=_zeros(structs.SprocketState, int(wheels.sum())),
        strands=_zeros(structs.Strand, int(wheels.sum())),
        seat=np.full(int((links * (wheels + bars)).sum()), -1, dtype=np.int32),
        assemblies=tuple(_assembled(v, drive, known) for v, drive in zip(chosen, drives, strict=True)),
    )
    roller = sprocket = guide = memory = tally = 0
    for v, (drive, assembly) in enumerate(zip(drives, packed.assemblies, strict=True)):
        row = packed.drives[v]
        row["first_roller"], row["first_sprocket"] = roller, sprocket
        row["first_guide"], row["first_contact"], row["first_tally"] = guide, memory, tally
        fill_drive(row, drive, assembly)
        fill_chain(packed.chains[v], drive)
        for s, wheel in enumerate(drive.sprockets):
            fill_sprocket(packed.sprockets[sprocket + s], drive, s, seats)
            fill_motion(packed.motions[sprocket + s], drive, s, float(assembly.sprocket_angle[s]), harmonics, tables)
            fill_strand(packed.strands[sprocket + s], assembly, s, drive.chain.links)
            body = packed.bodies[sprocket + s]
            body["angle"], body["speed"] = assembly.sprocket_angle[s], assembly.sprocket_speed[s]
            body["center"], body["velocity"] = initial_center(wheel), initial_velocity(wheel)
            fill_mount(packed.mounts[sprocket + s], wheel, drive.run.gravity)
            held = np.flatnonzero(assembly.seat_sprocket == s)
            packed.seat[memory + s * drive.chain.links + held] = assembly.seat_index[held]
        for g in range(len(drive.guides)):
            fill_guide(packed.guides[guide + g], drive, g)
        n = drive.chain.links
        packed.rollers[STATE_ROWS * roller : STATE_ROWS * (roller + n)] = state_rows(
            assembly.position, assembly.velocity, "float64"
        ).ravel()
        roller, sprocket, guide = roller + n, sprocket + len(drive.sprockets), guide + len(drive.guides)
        memory += n * (len(drive.sprockets) + len(drive.guides))
        tally += n * (len(drive.sprockets) + 1)
    return packed
