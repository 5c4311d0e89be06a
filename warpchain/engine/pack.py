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
from warpchain.drive.rubbing import guide_rubbing, tooth_rubbing
from warpchain.engine.alike import alike
from warpchain.engine.fill import (
    RowList,
    fill_bar,
    fill_body,
    fill_chain,
    fill_drive,
    fill_guide,
    fill_joint,
    fill_links,
    fill_motion,
    fill_mount,
    fill_sliding,
    fill_sprocket,
    fill_strand,
    tooth_heft,
)
from warpchain.engine.fill_bodies import fill_arm, fill_profile, guide_heft, profiled
from warpchain.engine.fill_tensioner import fill_tensioner
from warpchain.engine.packed import KINDS, Packed, numbered, state_rows
from warpchain.engine.resting import lay_to_rest
from warpchain.engine.tension_scale import tension_scale
from warpchain.errors import DriveError
from warpchain.kernels import structs
from warpchain.kernels.rows import STATE_ROWS
from warpchain.results.schedule import Schedule


def _layout(drive: Drive) -> tuple[Any, ...]:
    """All of a drive that its initial state hangs on: drives alike in this are assembled once."""
    chain = drive.chain
    sprockets = tuple((s.name, s.center, s.teeth, s.pitch, s.wrap, s.prescribed, s.mount) for s in drive.sprockets)
    wear = (chain.elongation, chain.worn_links, chain.outer, chain.play)
    lengths = (chain.pitch, chain.links, *wear, chain.roller_radius)
    bodies = drive.guides, drive.arms, drive.tensioners
    return (*lengths, sprockets, *bodies, drive.contact.sprocket, drive.run.gravity, drive.run.phase)


def _assembled(v: int, drive: Drive, known: dict[tuple[Any, ...], Assembly]) -> Assembly:
    layout = _layout(drive)
    if layout not in known:
        try:
            known[layout] = assemble(drive)
        except DriveError as error:
            raise DriveError(f"variant {v}: {error}") from None
    return known[layout]


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
        for drive, kind, begin in zip(drives, which, packed.drives["first_body"].tolist(), strict=True):
            twin = drives[firsts[kind]]
            for s, sprocket in enumerate(drive.sprockets):
                if sprocket is not twin.sprockets[s]:
                    packed.motions[begin + s] = blank
                    angle = float(packed.bodies["angle"][begin + s])
                    fill_motion(packed.motions[begin + s], drive, s, angle, harmonics, tables)
    for name in ("step", "steps", "window_start", "window_end", "sample_every"):
        packed.drives[name] = [getattr(schedule, name) for _, schedule in zip(drives, schedules, strict=True)]
    sprockets, guides = packed.tooth_sliding, packed.guide_sliding
    for laws, sliding, counts in ((packed.sprockets, sprockets, "sprockets"), (packed.guides, guides, "guides")):
        steps = np.repeat(packed.drives["step"], packed.drives[counts])
        sliding["stop"][: len(steps)] /= steps
        laws["law"]["most_damping"][: len(steps)] /= steps
    packed.joints["stop"] /= np.where(packed.joints["rubs"], packed.drives["step"], 1.0)
    packed.drives["tension_scale"] = [tension_scale(*of) for of in zip(drives, packed.assemblies, strict=True)]
    packed.harmonics, packed.tables, packed.seats = harmonics.array(), tables.array(), seats.array()
    return packed


def _pack_each(
    everyone: Sequence[Drive], chosen: Sequence[int], harmonics: RowList, seats: RowList, tables: TableList
) -> Packed:
    """Packs the chosen drives one by one, but for their schedules, and gathers what their rows refer to."""
    drives = [everyone[v] for v in chosen]
    known: dict[tuple[Any, ...], Assembly] = {}
    assemblies = tuple(_assembled(v, drive, known) for v, drive in zip(chosen, drives, strict=True))
    rows = np.zeros(len(drives), dtype=structs.Drive.numpy_dtype())
    for row, drive, assembly in zip(rows, drives, assemblies, strict=True):
        fill_drive(row, drive, assembly)
    packed = _empty(numbered(rows), assemblies)
    packed.lengths[:] = np.concatenate([drive.chain.link_lengths for drive in drives])
    for v, (drive, assembly) in enumerate(zip(drives, assemblies, strict=True)):
        row = packed.drives[v]
        fill_chain(packed.chains[v], drive)
        fill_joint(packed.joints[v], drive)
        fill_links(packed.links[v], drive)
        packed.rows(v)[:] = state_rows(assembly.position, assembly.velocity, "float64")
        for s, sprocket in enumerate(drive.sprockets):
            mine, body = row["first_sprocket"] + s, row["first_body"] + s
            fill_sprocket(packed.sprockets[mine], drive, s, seats)
            fill_sliding(packed.tooth_sliding[mine], tooth_rubbing(drive), tooth_heft(drive, s))
            fill_strand(packed.strands[mine], assembly, s, drive.chain.links)
            fill_motion(packed.motions[body], drive, s, float(assembly.sprocket_angle[s]), harmonics, tables)
            fill_mount(packed.mounts[body], sprocket, drive.run.gravity, drive.plunger_mass_on(s))
            fill_body(packed.bodies[body], sprocket, assembly, s)
            held = np.flatnonzero(assembly.seat_sprocket == s)
            packed.seat[row["first_contact"] + s * drive.chain.links + held] = assembly.seat_index[held]
        _pack_guides(packed, row, drive)
        arms = packed.bodies[row["first_body"] + row["bodies"] - row["arms"] :]
        for a in range(len(drive.arms)):
            fill_arm(packed.arms[row["first_arm"] + a], arms[a], drive, a, assembly)
        for t in range(len(drive.tensioners)):
            fill_tensioner(packed.tensioners[row["first_tensioner"] + t], drive, t)
    lay_to_rest(packed)
    return packed


def _pack_guides(packed: Packed, row: Any, drive: Drive) -> None:
    """Fills the guides of a drive, whose rows of `kernels.structs.Drive` is `row`."""
    pieces = packed.pieces[row["first_piece"] :]
    used = 0
    for g in range(len(drive.guides)):
        at = row["first_guide"] + g
        if profiled(drive, g):
            used += fill_profile(packed.guides[at], pieces, used, drive, g)
        else:
            fill_bar(packed.guides[at], drive, g)
        heft = guide_heft(drive, g)
        fill_guide(packed.guides[at], drive, g, heft)
        fill_sliding(packed.guide_sliding[at], guide_rubbing(drive, g), heft)


def _empty(drives: NDArray[Any], assemblies: tuple[Assembly, ...]) -> Packed:
    """An ensemble in float64 whose drives have their counts and places, and nothing else yet."""
    kinds = structs.types(wp.float64)
    count = {name: int(kind.count(drives).sum()) for name, kind in KINDS.items()}

    def zeros(struct: Any, kind: str) -> NDArray[Any]:
        return np.zeros(max(count[kind], 1), dtype=struct.numpy_dtype())

    return Packed(
        precision="float64",
        drives=drives,
        chains=np.zeros(len(drives), dtype=kinds.Chain.numpy_dtype()),
        joints=np.zeros(len(drives), dtype=kinds.Joint.numpy_dtype()),
        links=np.zeros(len(drives), dtype=kinds.Links.numpy_dtype()),
        lengths=np.zeros(count["roller"]),
        sprockets=zeros(kinds.Sprocket, "sprocket"),
        motions=zeros(structs.Motion, "body"),
        mounts=zeros(structs.Mount, "body"),
        guides=zeros(kinds.Guide, "guide"),
        pieces=zeros(structs.Piece, "piece"),
        arms=zeros(structs.Arm, "arm"),
        tensioners=zeros(structs.Tensioner, "tensioner"),
        oil=zeros(structs.TensionerState, "tensioner"),
        tooth_sliding=zeros(kinds.Sliding, "sprocket"),
        guide_sliding=zeros(kinds.Sliding, "guide"),
        harmonics=np.zeros(0),
        tables=np.zeros(0),
        seats=np.zeros(0),
        rollers=np.zeros(STATE_ROWS * count["roller"]),
        bodies=zeros(structs.BodyState, "body"),
        strands=zeros(structs.Strand, "sprocket"),
        seat=np.full(count["contact"], -1, dtype=np.int32),
        assemblies=assemblies,
    )
