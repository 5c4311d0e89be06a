"""Packs drives: assembles each, fills its rows of the ensemble's arrays, and lays its tensioners to rest.

At rest a tensioner's check valve brings in what goes out, at the pressure P_r (`warpchain.drive.oil`). The content of
oil is then mu = phi(P_r) + ln(V / V_0) at the extension that the body gives (eq. (5), (6) of
`kernels.physics.tensioner`), and the ratchet is latched where it is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly import Assembly
from warpchain.assembly.bounds import tension_scale
from warpchain.assembly.stack_assembly import Assemblies, assemble_stacks
from warpchain.assembly.table_cells import TableList
from warpchain.drive import Drive
from warpchain.drive.friction_coefficients import guide_rubbing, tooth_rubbing
from warpchain.drive.oil import EXPONENT
from warpchain.drive.stacks import Stack, pick_variants, stacks_of_drives
from warpchain.engine.answers import fill_answers
from warpchain.engine.arrays import KINDS, dtype_of, numbered
from warpchain.engine.fill import (
    RowList,
    fill_bar,
    fill_body,
    fill_chain,
    fill_drive,
    fill_friction,
    fill_guide,
    fill_hub,
    fill_motion,
    fill_mount,
    fill_sprocket,
    fill_strand,
    tooth_effective_mass,
)
from warpchain.engine.fill_bodies import (
    fill_arm,
    fill_coupling,
    fill_engaged,
    fill_gear,
    fill_motor,
    fill_pivot,
    fill_profile,
    fill_shaft,
    fill_tensioner,
    fill_train,
    fill_valve,
    guide_effective_mass,
    is_tied,
    piece_count,
    profiled,
)
from warpchain.engine.packed import Packed, spread, state_rows, store
from warpchain.kernels import structs
from warpchain.kernels.native import STATE_ROWS
from warpchain.kernels.physics.friction import DAMPER, SPRING
from warpchain.kernels.physics.mount import CARRIED
from warpchain.kernels.physics.tensioner import LEAST_OIL_SHARE
from warpchain.results.schedule import Schedule, schedule_columns


def pack(
    drives: Sequence[Drive],
    schedules: Sequence[Schedule],
    stacks: Sequence[Stack] | None = None,
    numbers: NDArray[np.int64] | None = None,
) -> Packed:
    """Packs drives in float64, each in its assembled initial state: those of a kind all at once.

    Args:
        drives: the drives.
        schedules: their steps.
        stacks: the drives sorted into kinds, where they are.
        numbers: what they are called; None counts them from 0.

    Raises:
        DriveError: for a drive whose chain does not fit; the message names the variant.
    """
    stacks = stacks_of_drives(drives) if stacks is None else stacks
    assemblies = assemble_stacks(stacks, numbers)
    rows = np.zeros(len(drives), dtype=dtype_of(structs.Drive))
    for part, assembly in _parts(stacks, assemblies):
        row = np.zeros(len(part.members), dtype=rows.dtype)
        fill_drive(row, part.drive, assembly)
        rows[part.members] = row
    packed = Packed.blank(numbered(rows), assemblies)
    gathered = Gathered(RowList(3), RowList(2), TableList())
    for name, column in schedule_columns(schedules).items():
        packed.drives[name] = column
    for part, assembly in _parts(stacks, assemblies):
        _pack_part(packed, part, assembly, gathered)
        fill_answers(packed, part.members, part.drive, assembly)
    fill_steps(packed)
    owner = np.repeat(np.arange(packed.variants), packed.drives["sprockets"])
    packed.hubs["inertia"][: len(owner)] /= packed.drives["step"][owner]
    packed.harmonics, packed.tables = gathered.harmonics.array(), gathered.tables.array()
    packed.seats = gathered.seats.array()
    lay_to_rest(packed)
    return packed


def fill_steps(packed: Packed) -> None:
    """Fills what of contact laws and friction hangs on the steps of their drives."""
    for friction, counts in ((packed.tooth_friction, "sprockets"), (packed.guide_friction, "guides")):
        steps = np.repeat(packed.drives["step"], packed.drives[counts])
        fill_bristles(friction[: len(steps)], steps)
    fill_bristles(packed.chains["joint"], packed.drives["step"])
    for laws, counts in ((packed.sprockets["law"], "sprockets"), (packed.guides["law"], "guides")):
        owner = np.repeat(np.arange(packed.variants), packed.drives[counts])
        row, step, mass = laws[: len(owner)], packed.drives["step"][owner], packed.chains["mass"][owner]
        staged = packed.drives["integrator"][owner] > 0
        row["lag"] = np.where(staged, 0.0, 0.5 * step)
        row["yielding"] = row["lag"] / mass
        row["most_damping"] = np.where(staged, 2.0 * mass / (step * (1.0 + row["answer"])), 0.0)


def fill_bristles(friction: NDArray[Any], step: NDArray[np.float64]) -> None:
    """Fills what of friction hangs on the step: bristles as stiff as it can follow, and their dampers."""
    inertia = friction["inertia"]
    stiffness = np.minimum(friction["stiffness"], SPRING * inertia / (step * step))
    friction["spring"] = stiffness * step
    friction["damper"] = DAMPER * np.sqrt(stiffness * inertia / SPRING)


@dataclass
class Gathered:
    """Values that rows of an ensemble refer to, gathered as drives are packed."""

    harmonics: RowList
    seats: RowList
    tables: TableList


def _parts(stacks: Sequence[Stack], assemblies: Assemblies) -> Iterator[tuple[Stack, Assembly]]:
    """The stacks, in parts where their states were not found at once, and the states."""
    for stack in stacks:
        for places, assembly in assemblies.states_by_block(stack.members):
            whole = len(places) == len(stack.members)
            yield stack if whole else Stack(stack.members[places], pick_variants(stack.drive, places)), assembly


@contextmanager
def _rows(array: NDArray[Any], places: NDArray[Any]) -> Iterator[NDArray[Any]]:
    """Blank rows to fill, which then go to their places in an array."""
    rows = np.zeros(places.shape, dtype=array.dtype)
    yield rows
    array[places] = rows


def _fill(array: NDArray[Any], places: NDArray[Any], fill: Callable[..., None], *given: Any) -> None:
    """Fills blank rows, which then go to their places in an array."""
    with _rows(array, places) as row:
        fill(row, *given)


def _pack_part(packed: Packed, part: Stack, assembly: Assembly, gathered: Gathered) -> None:
    """Fills the rows of a stack's variants, in their initial states."""
    drive, v = part.drive, part.members
    at = {kind.first: packed.drives[kind.first][v].astype(np.int64) for kind in KINDS.values() if kind.first}
    packed.drives["tension_scale"][v] = tension_scale(drive, assembly)
    _fill(packed.chains, v, fill_chain, drive)
    links = drive.chain.links
    store(packed.lengths, at["first_roller"], drive.chain.link_lengths)
    packed.chains["length"][v] = packed.lengths[at["first_roller"]]
    states = state_rows(assembly.position, assembly.velocity).reshape(len(v), -1)
    store(packed.rollers, STATE_ROWS * at["first_roller"], states)
    for s in range(len(drive.sprockets)):
        _pack_sprocket(packed, drive, s, at, assembly, gathered)
        held = np.where(assembly.seat_sprocket == s, assembly.seat_index, -1)
        store(packed.seat, at["first_contact"] + s * links, held)
    _pack_guides(packed, drive, at)
    for a in range(len(drive.arms)):
        body = at["first_body"] + drive.first_arm_body + a
        arm, motion = _rows(packed.arms, at["first_arm"] + a), _rows(packed.motions, body)
        with arm as row, motion as turned, _rows(packed.bodies, body) as placed:
            fill_arm(row, turned, placed, drive, a, assembly)
        if drive.parent(a) is not None:
            packed.mounts["moves"][body] = CARRIED
        if drive.arms[a].pivot_table is not None:
            _fill(packed.mounts, body, fill_pivot, drive, a, gathered.tables)
    for t in range(len(drive.tensioners)):
        _fill(packed.tensioners, at["first_tensioner"] + t, fill_tensioner, drive, t, gathered.tables)
    _pack_trains(packed, drive, at, assembly, gathered)


def _pack_trains(
    packed: Packed, drive: Drive, at: Mapping[str, NDArray[np.int64]], assembly: Assembly, gathered: Gathered
) -> None:
    """Fills the rows of shafts, gears, couplings and valves, where a stack has any."""
    if not is_tied(drive):
        return
    for h in range(len(drive.shafts)):
        b = len(drive.sprockets) + h
        _fill(packed.motions, at["first_body"] + b, fill_motion, drive, b, 0.0, gathered.harmonics, gathered.tables)
        _fill(packed.bodies, at["first_body"] + b, fill_shaft, h, assembly)
        _fill(packed.motors, at["first_shaft"] + h, fill_motor, drive, h, gathered.tables)
    for b in range(drive.first_arm_body + len(drive.arms)):
        row = packed.motions[at["first_body"] + b]
        fill_train(row, drive, b)
        packed.motions[at["first_body"] + b] = row
    for c in range(len(drive.couplings)):
        _fill(packed.couplings, at["first_coupling"] + c, fill_coupling, drive, c, gathered.tables)
        _fill(packed.engaged, at["first_coupling"] + c, fill_engaged, drive, c, assembly)
    for g in range(len(drive.gears)):
        _fill(packed.gears, at["first_gear"] + g, fill_gear, drive, g)
    for v in range(len(drive.valves)):
        _fill(packed.valves, at["first_valve"] + v, fill_valve, drive, v, gathered.tables)


def _pack_sprocket(
    packed: Packed, drive: Drive, s: int, at: Mapping[str, NDArray[np.int64]], assembly: Assembly, gathered: Gathered
) -> None:
    """Fills the rows of sprocket s; `at` says where the parts of each variant begin."""
    mine, body = at["first_sprocket"] + s, at["first_body"] + s
    _fill(packed.sprockets, mine, fill_sprocket, drive, s, gathered.seats)
    _fill(
        packed.tooth_friction,
        mine,
        fill_friction,
        tooth_rubbing(drive),
        tooth_effective_mass(drive, s),
        drive.sprocket_stiffness(s),
    )
    _fill(packed.strands, mine, fill_strand, assembly, s, drive.chain.links)
    _fill(
        packed.motions, body, fill_motion, drive, s, assembly.sprocket_angle[:, s], gathered.harmonics, gathered.tables
    )
    _fill(packed.mounts, body, fill_mount, drive, s, gathered.tables)
    _fill(packed.hubs, mine, fill_hub, drive, s)
    _fill(packed.bodies, body, fill_body, drive, assembly, s)


def _pack_guides(packed: Packed, drive: Drive, at: Mapping[str, NDArray[np.int64]]) -> None:
    """Fills the rows of the guides of a stack."""
    used = 0
    with _rows(packed.pieces, spread(at["first_piece"], piece_count(drive))) as pieces:
        for g in range(len(drive.guides)):
            mine, effective_mass = at["first_guide"] + g, guide_effective_mass(drive, g)
            with _rows(packed.guides, mine) as row:
                if profiled(drive, g):
                    used += fill_profile(row, pieces, used, drive, g)
                else:
                    fill_bar(row, drive, g)
                fill_guide(row, drive, g)
            _fill(
                packed.guide_friction,
                mine,
                fill_friction,
                guide_rubbing(drive, g),
                effective_mass,
                drive.guide_stiffness(g),
            )


def extensions(packed: Packed) -> NDArray[np.float64]:
    """(all tensioners,) extension of each where its body stands [m]."""
    first = np.repeat(packed.drives["first_body"].astype(np.int64), packed.drives["tensioners"])
    of = packed.tensioners[: len(first)]
    body = packed.bodies[first + of["body"]]
    cosine, sine = np.cos(body["angle"])[:, None], np.sin(body["angle"])[:, None]
    point = of["point"]
    arm = point * cosine + np.stack([-point[:, 1], point[:, 0]], axis=1) * sine
    return np.einsum("ti,ti->t", body["center"] + arm - of["home"], of["direction"])


def compression(pressure: NDArray[np.float64], of: NDArray[Any]) -> NDArray[np.float64]:
    """phi(P) of oil with air, eq. (5)."""
    ratio = pressure / of["ambient"]
    return of["oil_share"] * ratio - of["air_share"] * ratio ** (-1.0 / EXPONENT)


def lay_to_rest(packed: Packed) -> None:
    """Gives every tensioner of an ensemble the state that it has at rest where its body stands now."""
    x = extensions(packed)
    of, oil = packed.tensioners[: len(x)], packed.oil[: len(x)]
    oil["farthest"] = x
    oil["supply"] = of["supply"]
    wet = of["hydraulic"] == 1
    oil["root"][wet] = (of["rest"][wet] / of["ambient"][wet]) ** (1.0 / 7.0)
    volume = 1.0 + of["area"][wet] * np.maximum(x, of["bottom"])[wet] / of["volume"][wet]
    oil["content"][wet] = compression(of["rest"][wet], of[wet]) + np.log(volume)
    oil["unfilled"] = of["drained"] > 0.0
    oil["root"][of["drained"] > 0.0] = 0.0  # found from the content
    oil["content"] += np.log(np.maximum(1.0 - of["drained"], LEAST_OIL_SHARE))


def springs(tensioners: NDArray[Any]) -> NDArray[Any]:
    """Tensioners that push with what they push with at rest: as springs, without dampers and ratchets."""
    slow = tensioners.copy()
    wet = slow["hydraulic"] == 1
    slow["preload"][wet] += ((slow["rest"] - slow["ambient"]) * slow["area"])[wet]
    for name in ("hydraulic", "damping", "stop_damping", "ratchet_pitch"):
        slow[name] = 0
    slow["bottom"] = np.where(wet, slow["bottom"], -np.inf)
    return slow
