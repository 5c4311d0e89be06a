"""Packs drives: assembles each, fills its rows of the ensemble's arrays, and brings its tensioners to rest.

At rest an oil's pressure is P_r (`warpchain.model.oil`), its content mu = phi(P_r) + ln(V / V_0) ((5), (6) of
`kernels.physics.tensioner`).
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
from warpchain.assembly.stack_assembly import assemble_stacks
from warpchain.assembly.table_cells import TableList
from warpchain.drive import Drive
from warpchain.engine.arrays import FIRST_ITEMS, dtype_of, fill_first_places
from warpchain.engine.body_struct_rows import (
    fill_arm_row,
    fill_coupling_row,
    fill_coupling_state,
    fill_gear_row,
    fill_motor_row,
    fill_pivot_row,
    fill_profile_face,
    fill_shaft_row,
    fill_tensioner_row,
    fill_train_row,
    fill_valve_row,
    guide_effective_mass,
    has_profile_face,
    is_tied,
    piece_count,
)
from warpchain.engine.contact_mobility import fill_contact_mobility
from warpchain.engine.packed_ensemble import PackedEnsemble, consecutive_places, roller_state_rows, scatter_values
from warpchain.engine.struct_rows import (
    RowList,
    fill_back_row,
    fill_body_row,
    fill_chain_row,
    fill_drive_row,
    fill_friction_row,
    fill_guide_row,
    fill_hub_row,
    fill_motion_row,
    fill_mount_row,
    fill_plate_row,
    fill_sprocket_row,
    fill_straight_face,
    fill_strand_row,
    tooth_effective_mass,
)
from warpchain.kernels import structs
from warpchain.kernels.native import STATE_ROWS
from warpchain.kernels.physics.friction import DAMPER, SPRING
from warpchain.kernels.physics.mount import CARRIED
from warpchain.kernels.physics.tensioner import LEAST_OIL_SHARE
from warpchain.kernels.physics.toe import ENDS
from warpchain.model import ChainModel, single_chain
from warpchain.model.friction_coefficients import guide_friction_coefficients, tooth_friction_coefficients
from warpchain.model.oil import EXPONENT
from warpchain.model.stacks import Stack, stacks_of_drives
from warpchain.results.schedule import Schedule, schedules_as_columns


def pack(
    chains: Sequence[Drive | ChainModel],
    schedules: Sequence[Schedule],
    stacks: Sequence[Stack[ChainModel]] | None = None,
    numbers: NDArray[np.int64] | None = None,
) -> PackedEnsemble:
    """Packed ensemble of chains in their assembled initial states, in float64.

    Args:
        chains: drives of one chain, or models of chains.
        numbers: of drives in messages.

    Raises:
        DriveError: a drive whose chain does not fit.
    """
    stacks = stacks_of_drives([single_chain(of) for of in chains]) if stacks is None else stacks
    assemblies = assemble_stacks(stacks, numbers)
    parts = list(assemblies.parts_of_stacks(stacks))
    rows = np.zeros(len(chains), dtype=dtype_of(structs.Drive))
    for part, assembly in parts:
        row = np.zeros(len(part.members), dtype=rows.dtype)
        fill_drive_row(row, part.one, assembly)
        rows[part.members] = row
    packed = PackedEnsemble.blank(fill_first_places(rows), assemblies)
    gathered = SharedRows(RowList(3), RowList(2), TableList())
    for name, column in schedules_as_columns(schedules).columns.items():
        packed.drives[name] = column
    for part, assembly in parts:
        _pack_stack(packed, part, assembly, gathered)
        fill_contact_mobility(packed, part.members, part.one, assembly)
    fill_step_dependence(packed)
    owner = np.repeat(np.arange(packed.variants), packed.drives["sprockets"])
    packed.hubs["inertia"][: len(owner)] /= packed.drives["step"][owner]
    packed.harmonics, packed.tables = gathered.harmonics.array(), gathered.tables.array()
    packed.seats = gathered.seats.array()
    rest_tensioners(packed)
    return packed


def fill_step_dependence(packed: PackedEnsemble) -> None:
    """Fills packed contacts and friction that depend on the step."""
    lightest = np.minimum.reduceat(packed.relative_mass, packed.drives["first_roller"].astype(np.int64))
    for friction, counts in ((packed.tooth_friction, "sprockets"), (packed.guide_friction, "guides")):
        steps, part = (np.repeat(of, packed.drives[counts]) for of in (packed.drives["step"], lightest))
        fill_bristles(friction[: len(steps)], steps, part)
    fill_bristles(packed.chains["joint"], packed.drives["step"], lightest)
    for laws, counts in ((packed.sprockets["law"], "sprockets"), (packed.guides["law"], "guides")):
        owner = np.repeat(np.arange(packed.variants), packed.drives[counts])
        row, step, mass = laws[: len(owner)], packed.drives["step"][owner], packed.chains["mass"][owner]
        staged = packed.drives["integrator"][owner] > 0
        row["lag"] = np.where(staged, 0.0, 0.5 * step)
        row["yielding"] = row["lag"] / mass
        row["most_damping"] = np.where(staged, 2.0 * mass / (step * (1.0 + row["answer"])), 0.0)


def fill_bristles(friction: NDArray[Any], step: NDArray[np.float64], part: Any = 1.0) -> None:
    """Fills packed friction bristles as stiff as steps allow, for `part` of the inertia."""
    inertia = part * friction["inertia"]
    stiffness = np.minimum(friction["stiffness"], SPRING * inertia / (step * step))
    friction["spring"] = stiffness * step
    friction["damper"] = DAMPER * np.sqrt(stiffness * inertia / SPRING)


@dataclass
class SharedRows:
    """Rows that a packed ensemble's variants share."""

    harmonics: RowList
    seats: RowList
    tables: TableList


@contextmanager
def _blank_rows(array: NDArray[Any], places: NDArray[Any]) -> Iterator[NDArray[Any]]:
    """Context of zero rows, put into a packed array."""
    rows = np.zeros(places.shape, dtype=array.dtype)
    yield rows
    array[places] = rows


def _fill_rows(array: NDArray[Any], places: NDArray[Any], fill: Callable[..., None], *given: Any) -> None:
    """Fills zero rows by `fill` into a packed array."""
    with _blank_rows(array, places) as row:
        fill(row, *given)


def _pack_stack(packed: PackedEnsemble, part: Stack[ChainModel], assembly: Assembly, gathered: SharedRows) -> None:
    """Packs a stack's variants, in their initial states."""
    model, v = part.one, part.members
    at = {name: packed.drives[name][v].astype(np.int64) for name in FIRST_ITEMS}
    packed.drives["tension_scale"][v] = tension_scale(model, assembly)
    _fill_rows(packed.chains, v, fill_chain_row, model, assembly)
    if model.chain.is_silent:
        _fill_rows(packed.plates, v, fill_plate_row, model)
    links, points = model.chain.rollers, int(ENDS) if model.chain.is_silent else 1
    scatter_values(packed.relative_mass, at["first_roller"], model.chain.relative_masses)
    scatter_values(packed.lengths, at["first_roller"], model.chain.link_lengths)
    packed.chains["length"][v] = packed.lengths[at["first_roller"]]
    states = roller_state_rows(assembly.position, assembly.velocity).reshape(len(v), -1)
    scatter_values(packed.rollers, STATE_ROWS * at["first_roller"], states)
    for s in range(len(model.sprockets)):
        _pack_sprocket(packed, model, s, at, assembly, gathered)
        held = np.where(assembly.seat_sprocket == s, assembly.seat_index, -1)
        scatter_values(packed.seat, at["first_contact"] + s * points * links, held)
    _pack_guides(packed, model, at)
    for a in range(len(model.arms)):
        body = at["first_body"] + model.first_arm_body + a
        arm, motion = _blank_rows(packed.arms, at["first_arm"] + a), _blank_rows(packed.motions, body)
        with arm as row, motion as turned, _blank_rows(packed.bodies, body) as placed:
            fill_arm_row(row, turned, placed, model, a, assembly)
        if model.parent(a) is not None:
            packed.mounts["moves"][body] = CARRIED
        if model.arms[a].pivot_table is not None:
            _fill_rows(packed.mounts, body, fill_pivot_row, model, a, gathered.tables)
    for t in range(len(model.tensioners)):
        _fill_rows(packed.tensioners, at["first_tensioner"] + t, fill_tensioner_row, model, t, gathered.tables)
    _pack_trains(packed, model, at, assembly, gathered)


def _pack_trains(
    packed: PackedEnsemble,
    model: ChainModel,
    at: Mapping[str, NDArray[np.int64]],
    assembly: Assembly,
    gathered: SharedRows,
) -> None:
    """Packs shafts, gears, couplings and valves of a stack."""
    if not is_tied(model):
        return
    for h in range(len(model.shafts)):
        b = len(model.sprockets) + h
        _fill_rows(
            packed.motions, at["first_body"] + b, fill_motion_row, model, b, 0.0, gathered.harmonics, gathered.tables
        )
        _fill_rows(packed.bodies, at["first_body"] + b, fill_shaft_row, h, assembly)
        _fill_rows(packed.motors, at["first_shaft"] + h, fill_motor_row, model, h, gathered.tables)
    for b in range(model.first_arm_body + len(model.arms)):
        row = packed.motions[at["first_body"] + b]
        fill_train_row(row, model, b)
        packed.motions[at["first_body"] + b] = row
    for c in range(len(model.couplings)):
        _fill_rows(packed.couplings, at["first_coupling"] + c, fill_coupling_row, model, c, gathered.tables)
        _fill_rows(packed.engaged, at["first_coupling"] + c, fill_coupling_state, model, c, assembly)
    for g in range(len(model.gears)):
        _fill_rows(packed.gears, at["first_gear"] + g, fill_gear_row, model, g)
    for v in range(len(model.valves)):
        _fill_rows(packed.valves, at["first_valve"] + v, fill_valve_row, model, v, gathered.tables)


def _pack_sprocket(
    packed: PackedEnsemble,
    model: ChainModel,
    s: int,
    at: Mapping[str, NDArray[np.int64]],
    assembly: Assembly,
    gathered: SharedRows,
) -> None:
    """Packs sprocket s of a stack's variants."""
    mine, body = at["first_sprocket"] + s, at["first_body"] + s
    _fill_rows(packed.sprockets, mine, fill_sprocket_row, model, s, gathered.seats)
    _fill_rows(
        packed.tooth_friction,
        mine,
        fill_friction_row,
        tooth_friction_coefficients(model, s),
        tooth_effective_mass(model, s),
        model.sprocket_stiffness(s),
    )
    _fill_rows(packed.strands, mine, fill_strand_row, assembly, model, s)
    _fill_rows(
        packed.motions,
        body,
        fill_motion_row,
        model,
        s,
        assembly.sprocket_angle[:, s],
        gathered.harmonics,
        gathered.tables,
    )
    _fill_rows(packed.mounts, body, fill_mount_row, model, s, gathered.tables)
    _fill_rows(packed.hubs, mine, fill_hub_row, model, s)
    _fill_rows(packed.bodies, body, fill_body_row, model, assembly, s)


def _pack_guides(packed: PackedEnsemble, model: ChainModel, at: Mapping[str, NDArray[np.int64]]) -> None:
    """Packs the guides of a stack."""
    used, backs = 0, len(model.guides) * model.chain.is_silent
    with _blank_rows(packed.pieces, consecutive_places(at["first_piece"], piece_count(model))) as pieces:
        for g in range(len(model.guides)):
            mine, effective_mass = at["first_guide"] + backs + g, guide_effective_mass(model, g)
            with _blank_rows(packed.guides, mine) as row:
                if has_profile_face(model, g):
                    used += fill_profile_face(row, pieces, used, model, g)
                else:
                    fill_straight_face(row, model, g)
                fill_guide_row(row, model, g)
            _fill_rows(
                packed.guide_friction,
                mine,
                fill_friction_row,
                guide_friction_coefficients(model, g),
                effective_mass,
                model.guide_stiffness(g),
            )
            if backs:
                with _blank_rows(packed.guides, mine - backs) as row:
                    row[:] = packed.guides[mine]
                    fill_back_row(row, model)
                packed.guide_friction[mine - backs] = packed.guide_friction[mine]


def tensioner_extensions(packed: PackedEnsemble) -> NDArray[np.float64]:
    """Extensions (all tensioners,) [m] at bodies' packed places."""
    first = np.repeat(packed.drives["first_body"].astype(np.int64), packed.drives["tensioners"])
    of = packed.tensioners[: len(first)]
    body = packed.bodies[first + of["body"]]
    cosine, sine = np.cos(body["angle"])[:, None], np.sin(body["angle"])[:, None]
    point = of["point"]
    arm = point * cosine + np.stack([-point[:, 1], point[:, 0]], axis=1) * sine
    return np.einsum("ti,ti->t", body["center"] + arm - of["home"], of["direction"])


def oil_compression(pressure: NDArray[np.float64], of: NDArray[Any]) -> NDArray[np.float64]:
    """Compression phi(P) of tensioners' oil, eq. (5)."""
    ratio = pressure / of["ambient"]
    return of["oil_share"] * ratio - of["air_share"] * ratio ** (-1.0 / EXPONENT)


def rest_tensioners(packed: PackedEnsemble) -> None:
    """Sets packed tensioners to rest at bodies' places."""
    x = tensioner_extensions(packed)
    of, oil = packed.tensioners[: len(x)], packed.oil[: len(x)]
    oil["farthest"] = x
    oil["supply"] = of["supply"]
    wet = of["hydraulic"] == 1
    oil["root"][wet] = (of["rest"][wet] / of["ambient"][wet]) ** (1.0 / 7.0)
    volume = 1.0 + of["area"][wet] * np.maximum(x, of["bottom"])[wet] / of["volume"][wet]
    oil["content"][wet] = oil_compression(of["rest"][wet], of[wet]) + np.log(volume)
    oil["unfilled"] = of["drained"] > 0.0
    oil["root"][of["drained"] > 0.0] = 0.0  # found from the content
    oil["content"] += np.log(np.maximum(1.0 - of["drained"], LEAST_OIL_SHARE))


def tensioners_as_springs(tensioners: NDArray[Any]) -> NDArray[Any]:
    """Rows of tensioners as springs pushing as at rest."""
    slow = tensioners.copy()
    wet = slow["hydraulic"] == 1
    slow["preload"][wet] += ((slow["rest"] - slow["ambient"]) * slow["area"])[wet]
    for name in ("hydraulic", "damping", "stop_damping", "ratchet_pitch"):
        slow[name] = 0
    slow["bottom"] = np.where(wet, slow["bottom"], -np.inf)
    return slow
