"""Fills rows of kernels' structs from a drive: chain, sprockets, mounts, contacts, friction, straight guides."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly import Assembly
from warpchain.assembly.bounds import escape_distance
from warpchain.assembly.strand_load import load_line
from warpchain.assembly.table_cells import TableList, shaft_ratio
from warpchain.drive import ArmMount, ElasticMount, Harmonic, ImpactLaw, PrescribedMount, SliderMount
from warpchain.drive.body_ties import part_of_body
from warpchain.drive.laws import LAWS
from warpchain.drive.motion_table import Table
from warpchain.drive.plate import CROWN, tooth_corner
from warpchain.drive.stack_math import array_of_columns, maximum, power, with_last_axis
from warpchain.drive.stiffness import contact_damping
from warpchain.engine.body_struct_rows import fill_place_tables, fill_train_counts, piece_count
from warpchain.engine.own_laws import form_of_law
from warpchain.kernels.integrate import INTEGRATORS
from warpchain.kernels.physics.back import BACK_ANSWER, ROW_MARGIN
from warpchain.kernels.physics.impact import FORCES
from warpchain.kernels.physics.mount import CARRIED, FREE, PRESCRIBED
from warpchain.kernels.physics.toe import ENDS
from warpchain.kernels.structs import GROUND
from warpchain.model import ChainModel
from warpchain.model.friction_coefficients import FrictionCoefficients, friction_coefficients
from warpchain.model.mounts import (
    has_active_mount,
    initial_velocity,
    is_on_springs,
    largest_displacement,
    moving_mass,
    unit_direction,
    wheel_inertia,
    wheel_mass,
)
from warpchain.model.start_phase import motion_from_start_phase
from warpchain.model.trains import body_turning_sign, is_free_body, prescribed_leader, train_inertia

FORCE_NUMBERS = {force.key: form for form, force in enumerate(FORCES)}
JOINT_INERTIA = 0.6
"""Part of m p^2 / 6 that joint friction has to stop."""

CONTACT_MARGIN = 1.0 / 16.0
"""Distance, in roller radii, from which contacts count."""

PIN_STIFFNESS = 12.0
"""Pin's stiffness in its bush over a link's."""

TANGENTIAL_STIFFNESS = 0.8
"""Tangential over normal stiffness of contacts (Mindlin 1949)."""

DEEPEST_ENTRY = 0.5
"""Depth in a guide, in roller radii, beyond which its face was missed."""


class RowList:
    """List of rows of harmonics or seats, for packing."""

    def __init__(self, width: int) -> None:
        self.blocks: list[NDArray[np.float64]] = []
        self.length = 0
        self.width = width
        self.known: dict[int, int] = {}

    def add(self, rows: NDArray[np.float64]) -> tuple[int, int]:
        """Appends rows; returns their place and number."""
        first = self.length
        self.blocks.append(rows.reshape(-1, self.width))
        self.length += len(self.blocks[-1])
        return first, len(self.blocks[-1])

    def array(self) -> NDArray[np.float64]:
        """Array of all rows; one row of zeros for none."""
        return np.concatenate(self.blocks) if self.length else np.zeros((1, self.width))


def fill_law_row(row: Any, contact: ImpactLaw, stiffness: float, mass: float) -> None:
    """Fills a `structs.ContactLaw`, apart from step and bodies."""
    row["form"] = form_of_law(LAWS[contact.law])
    row["stiffness"] = stiffness
    row["exponent"] = contact.exponent
    row["damping"] = contact_damping(contact, stiffness, mass)
    row["speed_floor"] = contact.impact_speed_floor


def fill_sprocket_row(row: Any, model: ChainModel, s: int, seats: RowList) -> None:
    """Fills the `structs.Sprocket` of sprocket s or an end, and its `seats`."""
    teeth = model.sprockets[s].teeth
    if teeth not in seats.known:
        angle = 2.0 * np.pi * np.arange(teeth) / teeth
        seats.known[teeth], _ = seats.add(np.stack([np.cos(angle), np.sin(angle)], axis=1))
    radius = model.pitch_radius(s)
    tooth = model.tooth(s)
    half_seat, roller_radius = 0.5 * tooth.seat_angle, model.chain.roller_radius
    row["law"]["ahead"] = CONTACT_MARGIN * roller_radius
    band = maximum(model.engagement(s), tooth.tip_radius + roller_radius + row["law"]["ahead"] - radius)
    row["teeth"] = teeth
    row["first_seat"] = seats.known[teeth]
    row["exact_radius"] = row["pitch_radius"] = radius
    row["near_square"] = power(maximum(radius - band, 0.0), 2)
    row["far_square"] = power(radius + band, 2)
    row["half_pitch_tangent"] = np.tan(np.pi / teeth)
    row["clearance"] = tooth.seat_radius - roller_radius
    row["cos_half_seat"] = np.cos(half_seat)
    row["sin_half_seat"] = np.sin(half_seat)
    row["flank_curvature"] = 1.0 / (tooth.flank_radius + roller_radius)
    row["tip_reach"] = tooth.tip_radius + roller_radius
    if model.sprockets[s].is_end:
        _fill_end(row, model, s)
    else:
        fill_law_row(row["law"], model.contact.sprocket, model.sprocket_stiffness(s), model.chain.mass)
    if model.chain.is_silent:
        _fill_wheel(row, model, s)


def _fill_wheel(row: Any, model: ChainModel, s: int) -> None:
    """Fills a silent chain's `structs.Sprocket`: flanks for toes, contacts half as stiff."""
    plate, tooth, pitch, radius = model.chain.plate, model.tooth(s), model.sprocket_pitch(s), model.pitch_radius(s)
    row["law"]["ahead"] = CONTACT_MARGIN * plate.tip_radius
    row["law"]["stiffness"] *= 0.5
    row["law"]["damping"] *= 0.5 if LAWS[model.contact.sprocket.law].viscous else 1.0
    row["clearance"] = plate.flank_distance - plate.tip_radius
    row["tip_reach"] = tooth.tip_radius + plate.tip_radius
    row["corner"] = tooth_corner(plate, model.sprockets[s].teeth, pitch)
    row["far_square"] = power(maximum(tooth.tip_radius + plate.reach, radius + 0.5 * pitch), 2)


def fill_plate_row(row: Any, model: ChainModel) -> None:
    """Fills the `structs.Plate` of a silent chain."""
    plate, (first, *_) = model.chain.plate, model.sprockets
    for name, number in (("begin", 0), ("tip", 1)):
        x, y = plate.flank_end(number)
        row[name] = array_of_columns((x - 0.5 * plate.pitch, y))
    row["radius"] = plate.tip_radius
    row["cos_flank"], row["sin_flank"] = np.cos(plate.flank_angle), np.sin(plate.flank_angle)
    row["side"] = first.sign


def _fill_end(row: Any, model: ChainModel, s: int) -> None:
    """Fills the `structs.Sprocket` of an end: one pin's hole, stiff as a link."""
    row["pin"] = 1 if s == 0 else model.chain.rollers
    row["near_square"], row["far_square"] = -1.0, np.inf
    row["cos_half_seat"], row["sin_half_seat"] = -1.0, 0.0
    row["law"]["form"] = FORCE_NUMBERS["kelvin_voigt_damper"]
    row["law"]["stiffness"], row["law"]["exponent"] = model.sprocket_stiffness(s), 1.0
    row["law"]["damping"] = model.chain.link_damping
    row["law"]["speed_floor"] = model.contact.sprocket.impact_speed_floor


def _harmonic_rows(model: ChainModel, s: int, harmonics: Sequence[Harmonic]) -> NDArray[np.float64]:
    """Harmonics (order, amplitude, phase) of a body."""
    rows = [array_of_columns((h.order / shaft_ratio(model, s, h.shaft), h.amplitude, h.phase)) for h in harmonics]
    return np.stack(np.broadcast_arrays(*rows), axis=-2) if rows else np.zeros((0, 3))


def fill_motion_row(row: Any, model: ChainModel, s: int, angle: Any, harmonics: RowList, tables: TableList) -> None:
    """Fills the `structs.Motion` of a sprocket or shaft."""
    turned, led_by = part_of_body(model, s), prescribed_leader(model, s)
    row["sign"] = body_turning_sign(model, s)
    row["start_angle"] = angle
    if led_by is not None:
        leader, ratio = led_by
        motion = motion_from_start_phase(model, part_of_body(model, leader), part_of_body(model, leader).prescribed)
        row["sign"] = body_turning_sign(model, leader) * ratio
        row["prescribed"] = 1
        row["speed"] = motion.top_speed
        row["ramp_time"] = motion.ramp_time
        fill_table_row(row["drive_table"], model, leader, motion.table, tables)
        rows = _harmonic_rows(model, leader, motion.harmonics)
        _fill_harmonics_row(row["drive_harmonics"], rows, harmonics)
        return
    row["inverse_inertia"] = 1.0 / train_inertia(model, s)
    if turned.load is not None:
        load = motion_from_start_phase(model, turned, turned.load)
        row["load"] = array_of_columns((load.torque, load.viscous, load.quadratic))
        row["load_ramp_time"] = load.ramp_time
        fill_table_row(row["load_table"], model, s, load.table, tables)
        rows = _harmonic_rows(model, s, load.harmonics)
        _fill_harmonics_row(row["load_harmonics"], rows, harmonics)


def _fill_harmonics_row(row: Any, rows: NDArray[np.float64], harmonics: RowList) -> None:
    """Appends a body's harmonics, and fills their place."""
    first, _ = harmonics.add(rows)
    row["count"] = rows.shape[-2]
    row["first"] = first + (rows.shape[-2] * np.arange(len(rows)) if rows.ndim > 2 else 0)


def fill_table_row(row: Any, model: ChainModel, s: int, table: Table | None, tables: TableList) -> None:
    """Fills the place of a body's table, and adds it."""
    if table is not None:
        tables.add(row, table, shaft_ratio(model, s, table.shaft))


def fill_straight_face(row: Any, model: ChainModel, g: int) -> None:
    """Fills the face of a straight, fixed guide into `structs.Guide`."""
    bar = model.guides[g].bar
    start, end = array_of_columns(bar.start), array_of_columns(bar.end)
    chord = end - start
    length = np.hypot(chord[..., 0], chord[..., 1])
    row["body"] = GROUND
    row["start"] = start
    row["direction"] = chord / length[..., None]
    row["length"] = length
    row["end_radius"] = bar.end_radius
    row["roller_radius"] = model.guide_offset(g)


def fill_guide_row(row: Any, model: ChainModel, g: int) -> None:
    """Fills a `structs.Guide` apart from its face."""
    row["law"]["ahead"] = CONTACT_MARGIN * model.chain.roller_radius
    row["deepest_entry"] = DEEPEST_ENTRY * model.chain.roller_radius
    fill_law_row(row["law"], model.guide_contact(g), model.guide_stiffness(g), model.chain.mass)


def fill_back_row(row: Any, model: ChainModel) -> None:
    """Makes a guide's `structs.Guide` that of the backs of links, which is wider (`physics.back.back_guide`)."""
    radius = CROWN * model.chain.pitch
    margin = ROW_MARGIN * radius
    row["back_radius"] = radius
    row["end_radius"] += margin
    row["roller_radius"] += margin
    row["low"] -= with_last_axis(margin)
    row["high"] += with_last_axis(margin)
    row["law"]["answer"] = BACK_ANSWER


def fill_friction_row(row: Any, rubbing: FrictionCoefficients, effective_mass: float, stiffness: float) -> None:
    """Fills a contact's `structs.Friction`, apart from the step; `effective_mass` in kg."""
    if rubbing.has_friction:
        fill_friction_coefficients(row, rubbing, effective_mass, stiffness)


def fill_friction_coefficients(row: Any, rubbing: FrictionCoefficients, inertia: float, stiffness: float) -> None:
    """Fills a `structs.Friction`, apart from the step.

    Friction has to stop `inertia` [kg]; `stiffness` is along the surface [N/m]; of joints [kg m^2], [N m/rad].
    """
    row["inertia"], row["stiffness"] = inertia, TANGENTIAL_STIFFNESS * stiffness
    row["mu_dynamic"], row["mu_static"] = rubbing.dynamic, rubbing.static
    row["stribeck_speed"] = rubbing.stribeck_speed


def tooth_effective_mass(model: ChainModel, s: int) -> float:
    """Effective mass m_e [kg] of a roller on sprocket s: 1/m_e = 1/m + z (1/M + (r + b/M)^2 / J).

    z contacts act on a sprocket that turns and whose center moves (1/M, b of its balance wheel), J about the center of
    mass, r the contacts' reach. An arm adds d^2 / I, d the center from its pivot.
    """
    sprocket, mobility, offset = model.sprockets[s], 0.0, 0.0
    wheel = sprocket.balance_wheel
    moment = wheel_mass(sprocket) * wheel.radius if wheel is not None else 0.0
    inertia = train_inertia(model, s)
    if is_on_springs(sprocket):
        mobility, offset = 1.0 / moving_mass(sprocket), moment / moving_mass(sprocket)
        inertia = inertia - moment * offset
    if is_free_body(model, s):
        mobility = mobility + power(model.pitch_radius(s) + model.engagement(s) + offset, 2) / inertia
    arm = model.carrier(s)
    if arm is not None:
        mobility = mobility + power(model.center_lever(s), 2) / model.arm_inertia(arm)
    return 1.0 / (1.0 / model.chain.mass + sprocket.teeth * mobility)


def fill_strand_row(row: Any, assembly: Assembly, model: ChainModel, s: int) -> None:
    """Fills the `structs.Strand` after sprocket s: line and middle roller."""
    path = assembly.path
    chord = path.strand_end[..., s, :] - path.strand_start[..., s, :]
    length = np.hypot(chord[..., 0], chord[..., 1])
    row["start"] = path.strand_start[..., s, :]
    row["direction"] = chord / length[..., None]
    row["length"] = length
    row["middle"] = (assembly.strand_first[..., s] + assembly.strand_links[..., s] // 2) % model.links
    if model.chain.is_open:
        last = len(model.sprockets) - 1
        row["end"] = 1 * (s == 0) + 2 * (s == last - 1) + 4 * (s == last)


def fill_drive_row(row: Any, model: ChainModel, assembly: Assembly) -> None:
    """Fills a `structs.Drive`: counts, integrator, box of motion."""
    row["chains"] = 1
    row["points"] = int(ENDS) if model.chain.is_silent else 1
    row["rollers"], row["sprockets"] = model.chain.rollers, len(model.sprockets)
    row["guides"] = len(model.guides) * (1 + model.chain.is_silent)
    row["bodies"], row["arms"] = len(model.sprockets) + len(model.shafts) + len(model.arms), len(model.arms)
    fill_train_counts(row, model)
    row["tensioners"], row["pieces"] = len(model.tensioners), piece_count(model)
    row["integrator"] = INTEGRATORS[model.run.integrator]
    margin = escape_distance(model, assembly)[..., None]
    row["jointed"] = any(arm.arm is not None for arm in model.arms)
    carried = any(s.bearing is not None or isinstance(s.mount, ArmMount) for s in model.sprockets)
    row["hubs"] = carried or row["jointed"]
    reach = [model.pitch_radius(s) + largest_displacement(sprocket) for s, sprocket in enumerate(model.sprockets)]
    for s in range(len(reach)):
        if model.carrier(s) is not None:
            reach[s] = reach[s] + 2.0 * model.center_lever(s)  # wherever the arm turns
    arms = [2.0 * math.dist(arm.pivot, model.arms[p].pivot) if (p := model.parent(a)) is not None else 0.0
            for a, arm in enumerate(model.arms)]  # fmt: skip
    for s in range(len(reach)):
        reach[s] = reach[s] + (0.0 if (a := model.carrier(s)) is None else arms[a])
    margin = margin + max(
        (arm.pivot_table.largest_displacement for arm in model.arms if arm.pivot_table is not None), default=0.0
    )
    places = [sprocket.center for sprocket in model.sprockets] + [arm.pivot for arm in model.arms]
    reach += arms
    circles = list(zip(map(array_of_columns, places), map(with_last_axis, reach), strict=True))
    row["low"] = reduce(np.minimum, [center - radius for center, radius in circles]) - margin
    row["high"] = reduce(np.maximum, [center + radius for center, radius in circles]) + margin
    widen_box(row, np.ascontiguousarray(np.swapaxes(assembly.position, -1, -2)), margin)


def widen_box(row: Any, position: NDArray[np.floating], margin: NDArray[np.float64]) -> None:
    """Widens drives' boxes around rollers (..., 2, N) by `margin`."""
    sound = np.isfinite(position).all(axis=(-2, -1))[..., None]
    row["low"] = np.where(sound, np.minimum(row["low"], position.min(axis=-1) - margin), row["low"])
    row["high"] = np.where(sound, np.maximum(row["high"], position.max(axis=-1) + margin), row["high"])


def fill_hub_row(row: Any, model: ChainModel, s: int) -> None:
    """Fills a sprocket's `structs.Hub`, for a 1 s step."""
    sprocket, arm = model.sprockets[s], model.carrier(s)
    row["arm"] = GROUND if arm is None else model.first_arm_body + arm
    if arm is not None:
        row["lever"] = array_of_columns(sprocket.center) - array_of_columns(model.arms[arm].pivot)
    if sprocket.bearing is not None:
        row["bearing"] = sprocket.bearing.friction * sprocket.bearing.radius
        mobility = 1.0 / train_inertia(model, s)
        if arm is not None:
            mobility = mobility + len(model.sprockets_on(arm)) / model.arm_inertia(arm)
        row["inertia"] = 1.0 / mobility


def fill_body_row(row: Any, model: ChainModel, assembly: Assembly, s: int) -> None:
    """Fills the initial `structs.BodyState` of sprocket s."""
    row["angle"], row["speed"] = assembly.sprocket_angle[..., s], assembly.sprocket_speed[..., s]
    own = model.sprockets[s]
    row["center"] = assembly.path.center[..., s, :] if own.rim is None else array_of_columns(own.center)
    row["velocity"] = initial_velocity(model.sprockets[s], model.pivot_table(s))


def fill_mount_row(row: Any, model: ChainModel, s: int, tables: TableList) -> None:
    """Fills the `structs.Mount` of a sprocket, zero if fixed."""
    sprocket, gravity = model.sprockets[s], model.run.gravity
    plungers = model.plunger_mass_on(s)
    if isinstance(sprocket.mount, ArmMount):
        row["moves"], row["home"] = CARRIED, array_of_columns(sprocket.center)
    if not has_active_mount(sprocket):
        return
    mount, mass = sprocket.mount, moving_mass(sprocket) + plungers
    row["active"] = 1
    row["home"] = array_of_columns(sprocket.center)
    row["mass"] = mass
    row["gravity"] = array_of_columns(gravity)
    row["inertia"] = train_inertia(model, s) if is_free_body(model, s) else wheel_inertia(sprocket)
    if sprocket.balance_wheel is not None:
        phase = sprocket.balance_wheel.phase
        arm = wheel_mass(sprocket) * sprocket.balance_wheel.radius
        row["wheel"] = with_last_axis(arm) * array_of_columns((np.cos(phase), np.sin(phase)))
    if isinstance(mount, PrescribedMount):
        row["moves"] = PRESCRIBED
        fill_place_tables(row, mount.table, tables)
        row["direction"] = 0.0 if mount.direction is None else unit_direction(mount.direction)
        row["offset"], row["amplitude"], row["phase"] = mount.offset, mount.amplitude, mount.phase
        row["frequency"] = 2.0 * math.pi * mount.frequency
    elif isinstance(mount, ElasticMount):
        row["moves"] = FREE
        row["inverse_mass"] = np.eye(2) / with_last_axis(with_last_axis(mass))
        row["stiffness"], row["damping"] = _diagonal_matrices(mount.stiffness), _diagonal_matrices(mount.damping)
        row["preload"] = array_of_columns(mount.preload)
    elif isinstance(mount, SliderMount):
        way = unit_direction(mount.direction)
        line = way[..., :, None] * way[..., None, :]
        row["moves"] = FREE
        row["inverse_mass"] = line / with_last_axis(with_last_axis(mass))
        row["stiffness"], row["damping"] = (
            with_last_axis(with_last_axis(mount.stiffness)) * line,
            with_last_axis(with_last_axis(mount.damping)) * line,
        )
        row["preload"] = with_last_axis(mount.preload) * way


def _diagonal_matrices(values: tuple[float, float]) -> NDArray[np.float64]:
    """Diagonal matrices (..., 2, 2) of x and y values."""
    return array_of_columns(values)[..., None] * np.eye(2)


def fill_chain_row(row: Any, model: ChainModel, assembly: Assembly) -> None:
    """Fills a `structs.Chain`, joint friction for a 1 s step."""
    chain = model.chain
    row["stiffness"], row["damping"] = chain.stiffness, chain.link_damping
    row["outer_stiffness"], row["outer_damping"] = chain.outer_stiffness, chain.outer_damping
    row["play"], row["absent"] = chain.link_play, chain.rollers if chain.is_open else 0
    row["mass"], row["inverse_mass"] = chain.mass, 1.0 / chain.mass
    row["gravity"] = array_of_columns(model.run.gravity)
    row["unlike_masses"] = (chain.relative_masses != 1.0).any(axis=-1) | (chain.load is not None)
    if chain.load is not None:
        row["load"]["relative_mass"] = chain.load.load_per_length * chain.pitch / chain.mass
        row["load"]["per_pitch"], row["load"]["feed_speed"] = 1.0 / chain.pitch, chain.load.feed_speed
        for name, value in load_line(model, assembly.path)._asdict().items():
            row["load"][name] = value
    if chain.joint is not None and chain.has_friction:
        pin_radius = chain.pin_radius
        assert pin_radius is not None  # the chain's own rule
        row["pin_radius"], row["joint_arm"] = pin_radius, chain.joint.factor * pin_radius
        inertia = JOINT_INERTIA * chain.mass * power(chain.pitch, 2) / 6.0
        stiffness = PIN_STIFFNESS * chain.stiffness * power(pin_radius, 2)
        fill_friction_coefficients(row["joint"], friction_coefficients(chain.joint), inertia, stiffness)
