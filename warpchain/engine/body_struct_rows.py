"""Fills rows of kernels' structs of bodies from a drive: profiled guides, arms, tensioners, trains, valves."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly import Assembly
from warpchain.assembly.guide_obstacles import rotated_place
from warpchain.assembly.table_cells import TableList
from warpchain.drive.body_ties import body_names
from warpchain.drive.face_profile import Profile
from warpchain.drive.motion_table import PlaceTable
from warpchain.drive.stack_math import (
    Number,
    array_of_columns,
    elementwise,
    maximum,
    power,
    radians,
    sqrt,
    where,
    with_last_axis,
)
from warpchain.drive.tensioners import VAPOR_PRESSURE, Tensioner
from warpchain.kernels.physics.mount import PRESCRIBED
from warpchain.kernels.physics.tensioner import SERIES
from warpchain.kernels.physics.train import OVER_SPEED
from warpchain.kernels.structs import GROUND
from warpchain.model import ChainModel
from warpchain.model.mounts import start_velocity
from warpchain.model.oil import LAMINAR_DROP, bottom_place, static_pressure
from warpchain.model.start_phase import motion_from_start_phase, start_phase_angle
from warpchain.model.trains import (
    GEAR_PRESSURE_ANGLE,
    bodies_beyond_gear,
    body_speed_ratio,
    body_turning_sign,
    coupled_bodies,
    coupling_rest_angle,
    has_trains,
    inertia_of_body,
    train_of_body,
)

FACE_MARGIN = 0.25
"""Distance from guides at which rollers count, in pitches."""


def has_profile_face(model: ChainModel, g: int) -> bool:
    """Whether kernels take guide g as a profile."""
    return not model.guides[g].straight or model.guides[g].arm is not None


def piece_count(model: ChainModel) -> int:
    """Number of rows `structs.Piece` of a drive's profiled guides."""
    return sum(len(model.profile(g).pieces) + 1 for g in range(len(model.guides)) if has_profile_face(model, g))


def fill_profile_face(row: Any, pieces: Any, first: int, model: ChainModel, g: int) -> int:
    """Fills the face of profiled guide g into `structs.Guide`; returns pieces used."""
    profile, arm = model.profile(g), model.arm_of(g)
    origin = np.zeros(2) if arm is None else np.asarray(model.arms[arm].pivot)  # the same for all of a stack
    row["body"] = GROUND if arm is None else model.first_arm_body + arm
    row["pieces"], row["first_piece"] = len(profile.pieces), first
    for i, (piece, place) in enumerate(zip(profile.pieces, profile.places, strict=True), first):
        at = pieces[:, i]
        at["start"] = np.subtract(piece.start, origin)
        at["direction"] = math.cos(piece.heading), math.sin(piece.heading)
        at["curvature"], at["place"] = piece.curvature, place
    last, end = profile.pieces[-1], pieces[:, first + len(profile.pieces)]
    end["start"] = np.subtract(last.end, origin)
    end["direction"] = math.cos(last.end_heading), math.sin(last.end_heading)
    end["place"] = profile.places[-1] + last.length
    row["roller_radius"], row["end_radius"] = model.guide_offset(g), profile.end_radius
    _fill_face_box(row, profile, origin, model.guide_offset(g), FACE_MARGIN * model.chain.pitch)
    return len(profile.pieces) + 1


def _fill_face_box(row: Any, profile: Profile, origin: NDArray[np.float64], offset: float, margin: float) -> None:
    """Fills the box of a guide's face where rollers count."""
    points = profile.points(0.25 * profile.end_radius) - origin
    start = np.asarray(profile.face[0].start) - origin
    chord = np.asarray(profile.face[-1].end) - origin - start
    row["start"], row["length"] = start, np.hypot(*chord)
    t = row["direction"] = chord / np.hypot(*chord)
    reach = points - start
    along, across = reach @ t, reach @ np.array([-t[1], t[0]])
    around = offset + margin
    row["low"] = along.min() - around, across.min() - profile.end_radius
    row["high"] = along.max() + around, across.max() + around


def guide_effective_mass(model: ChainModel, g: int) -> float:
    """Effective mass [kg] of a roller sliding on guide g."""
    arm = model.arm_of(g)
    return model.chain.mass if arm is None else arm_effective_mass(model, arm)


def arm_effective_mass(model: ChainModel, a: int) -> float:
    """Effective mass m_e [kg] of a roller on arm a: 1/m_e = 1/m + (n r^2 + sum z d^2) / I.

    n rollers on its faces at reach r, z on sprockets d from its pivot.
    """
    square = squared_levers(model, a, [sprocket.teeth for sprocket in model.sprockets])
    return 1.0 / (1.0 / model.chain.mass + square / model.arm_inertia(a))


def squared_levers(model: ChainModel, a: int, rollers: Sequence[Any]) -> Number:
    """Squared levers n r^2 + sum z d^2 [m^2] of an arm's rollers."""
    on_faces = sum(model.profile(g).face_length / model.chain.pitch + 2.0 for g in model.guides_of(a))
    square = on_faces * power(model.arm_lever(a), 2)
    return square + sum(rollers[s] * power(model.center_lever(s), 2) for s in model.sprockets_on(a))


def fill_arm_row(row: Any, motion: Any, body: Any, model: ChainModel, a: int, assembly: Assembly) -> None:
    """Fills arm a into `structs.Arm`, `Motion` and `BodyState`, at rest."""
    arm = model.arms[a]
    row["pivot"] = body["center"] = array_of_columns(arm.pivot)
    motion["inverse_inertia"] = 1.0 / model.arm_inertia(a)
    row["stiffness"], row["free_angle"], row["damping"] = arm.stiffness, arm.free_angle_rad, arm.damping
    row["low"], row["high"] = arm.stops_rad
    if arm.stops is not None:
        row["stop_stiffness"], row["stop_damping"] = model.stop_stiffness(a), model.stop_damping(a)
    row["reach"] = model.arm_lever(a)
    row["mass_moment"] = _mass_moment(model, a)
    row["gravity"] = array_of_columns(model.run.gravity)
    if arm.spring is not None:
        pivot = array_of_columns(arm.pivot)
        row["coil_point"], row["coil_anchor"] = (
            array_of_columns(end) - pivot for end in (arm.spring.at, arm.spring.anchor)
        )
        row["coil_stiffness"], row["coil_damping"] = arm.spring.stiffness, arm.spring.damping
        row["coil_free_length"] = arm.spring.free_length
    row["mass"] = 0.0 if arm.pivot_table is None else sum(mass for mass, _ in model.masses_on(a))
    body["angle"], body["velocity"] = assembly.arm_angle[:, a], start_velocity(arm.pivot_table)
    parent = model.parent(a)
    if parent is not None:
        on = model.arms[parent]
        row["on"], row["lever"] = parent + 1, array_of_columns(arm.pivot) - array_of_columns(on.pivot)
        body["center"] = array_of_columns(rotated_place(on.pivot, arm.pivot, assembly.arm_angle[:, parent]))
        body["angle"] += assembly.arm_angle[:, parent]


def _mass_moment(model: ChainModel, a: int) -> NDArray[np.float64]:
    """Mass moment (..., 2) [kg m] of an arm about its pivot."""
    pivot, found = array_of_columns(model.arms[a].pivot), np.zeros(2)
    for mass, place in model.masses_on(a):
        found = found + with_last_axis(mass) * (array_of_columns(place) - pivot)
    return found


def fill_place_tables(row: Any, table: PlaceTable | None, tables: TableList) -> None:
    """Fills tables of a `structs.Mount` whose center follows one."""
    for axis in "xy":
        column = None if table is None else table.displacement_along(axis)
        if column is not None:
            tables.add(row[f"{axis}_table"], column, 1.0)


def fill_pivot_row(row: Any, model: ChainModel, a: int, tables: TableList) -> None:
    """Fills the `structs.Mount` of an arm whose pivot is prescribed."""
    arm = model.arms[a]
    row["active"], row["moves"], row["home"] = 1, PRESCRIBED, array_of_columns(arm.pivot)
    fill_place_tables(row, arm.pivot_table, tables)
    row["mass"] = sum(mass for mass, _ in model.masses_on(a))
    row["inertia"], row["wheel"] = model.arm_inertia(a), _mass_moment(model, a)


STOP_DAMPING = 0.3
"""Damping ratio of a tensioner's ratchet and bottom."""


def fill_tensioner_row(row: Any, model: ChainModel, t: int, tables: TableList) -> None:
    """Fills the `structs.Tensioner` of tensioner t."""
    tensioner, body = model.tensioners[t], model.tensioner_body(t)
    row["body"] = body
    arm = body - model.first_arm_body
    if arm < 0:
        row["home"] = array_of_columns(model.sprockets[body].center)
    else:
        row["home"] = array_of_columns(tensioner.at)
        row["point"] = array_of_columns(tensioner.at) - array_of_columns(model.arms[arm].pivot)
    row["direction"] = array_of_columns(tensioner.unit_direction)
    fill_tensioner_element(row, model, tensioner)
    table = None if tensioner.oil is None else tensioner.oil.supply_table
    if table is not None:
        row["pump"] = model.driver if table.shaft is None else body_names(model).index(table.shaft)
        tables.add(row["supply_table"], table, 1.0)
        if table.speed is not None:
            row["supply_table"]["over_angle"] = OVER_SPEED


def fill_tensioner_element(row: Any, model: ChainModel, tensioner: Tensioner) -> None:
    """Fills spring, oil, valves, ratchet and stops of a `structs.Tensioner`."""
    stiffness, mass = model.chain.stiffness, maximum(tensioner.plunger_mass, model.chain.mass)
    row["stop_stiffness"], row["stop_damping"] = stiffness, 2.0 * STOP_DAMPING * sqrt(stiffness * mass)
    row["stiffness"], row["preload"] = tensioner.spring_stiffness, tensioner.spring_preload
    row["damping"] = tensioner.spring_damping
    row["bottom"] = bottom_place(tensioner)
    if tensioner.ratchet is not None:
        row["ratchet_pitch"], row["backlash"] = tensioner.ratchet.pitch, tensioner.ratchet.backlash
    if tensioner.hydraulic:
        row["hydraulic"] = 1
        _fill_oil_fields(row, tensioner)


def _expansion_pressure(pressure: Number, oil: Any) -> Number:
    """Expansion pressure [Pa] of oil, (10a) of `physics.tensioner`."""
    share, ratio = 1.0 / (1.0 + oil.air), pressure / oil.ambient
    q, b = share * pressure / oil.bulk_modulus, share * oil.air * power(ratio, -5.0 / 7.0)
    total = 0.0 * q
    for row in reversed(SERIES):
        of_row = 0.0 * b
        for coefficient in reversed(row):
            of_row = of_row * b + coefficient
        total = total * q + of_row
    return pressure * (total + elementwise(math.exp)(b - q))


def oil_energies(oil: Any) -> tuple[Number, Number]:
    """Oil's energies [Pa] at rest and supplied, for `structs.Tensioner`."""
    still = _expansion_pressure(oil.ambient, oil)
    return still, _expansion_pressure(oil.supply, oil) - still


def _fill_oil_fields(row: Any, tensioner: Tensioner) -> None:
    """Fills oil and valves of a `structs.Tensioner`."""
    oil, valve, chamber = tensioner.oil, tensioner.valve, tensioner.chamber
    assert oil is not None and valve is not None and chamber is not None
    row["area"], row["volume"] = tensioner.area, chamber.volume
    row["leak"], row["drag"] = tensioner.leak_conductance, tensioner.drag_flow
    row["supply"], row["ambient"], row["floor"] = (
        oil.supply,
        oil.ambient,
        power(VAPOR_PRESSURE / oil.ambient, 1.0 / 7.0),
    )
    row["rest"], row["drained"] = static_pressure(tensioner), chamber.drained
    row["oil_share"] = oil.ambient / (oil.bulk_modulus * (1.0 + oil.air))
    row["air_share"], row["density"] = oil.air / (1.0 + oil.air), oil.density
    row["still"], row["supplied"] = oil_energies(oil)
    row["laminar_limit"] = LAMINAR_DROP
    check = row["check"]
    check["hole_area"], check["preload"], check["lift_max"] = valve.hole_area, valve.preload, valve.lift
    # without a spring it opens all the way
    check["compliance"] = 1.0 / where(valve.stiffness > 0.0, valve.stiffness, 1e-30)
    angle = valve.seat_angle_rad
    check["seat_width"] = 2.0 * valve.ball_radius * elementwise(math.tan)(angle)
    check["seat_growth"] = elementwise(math.sin)(angle) / power(elementwise(math.cos)(angle), 2)
    check["discharge"] = valve.discharge
    if tensioner.relief is not None:
        relief, at = row["relief"], tensioner.relief
        relief["hole_area"], relief["preload"], relief["lift_max"] = at.hole_area, at.preload(oil.ambient), at.lift
        relief["compliance"], relief["seat_width"], relief["discharge"] = 1.0 / at.stiffness, at.diameter, at.discharge
    if tensioner.vent is not None:  # lifted all the way at any drop, with a curtain far beyond its hole
        vent = row["vent"]
        vent["hole_area"], vent["preload"] = tensioner.vent.flow_area, -1.0
        vent["compliance"] = vent["lift_max"] = vent["seat_width"] = vent["discharge"] = 1.0


def fill_train_counts(row: Any, model: ChainModel) -> None:
    """Fills counts of trains' parts into a `structs.Drive`."""
    row["shafts"], row["gears"], row["couplings"] = len(model.shafts), len(model.gears), len(model.couplings)
    row["valves"] = len(model.valves)
    row["tied"] = is_tied(model)


def is_tied(model: ChainModel) -> bool:
    """Whether a drive's bodies are tied in trains or by valves."""
    return has_trains(model) or bool(model.valves)


def fill_train_row(row: Any, model: ChainModel, b: int) -> None:
    """Fills the train of a body b into `structs.Motion`."""
    if b >= model.first_arm_body:
        row["train"] = -1
        return
    bodies, ratios = train_of_body(model, b)
    row["train"], row["ratio"], row["own_inertia"] = bodies[0], 1.0 / ratios[0], inertia_of_body(model, b)


def fill_shaft_row(row: Any, h: int, assembly: Assembly) -> None:
    """Fills the `structs.BodyState` of shaft h."""
    row["speed"] = assembly.shaft_speed[..., h]
    row["center"] = assembly.path.center[..., 0, :]


def fill_motor_row(row: Any, model: ChainModel, h: int, tables: TableList) -> None:
    """Fills the `structs.Motor` of shaft h; zero without one."""
    motor, b = model.shafts[h].motor, len(model.sprockets) + h
    if motor is None:
        return
    row["present"] = 1
    row["torque"] = 0.0 if motor.torque is None else motor.torque
    row["power"] = 0.0 if motor.power is None else motor.power
    row["ramp_time"] = motor.ramp_time
    if motor.governor is not None:
        row["wanted"], row["band"], row["most"] = motor.governor.speed, motor.governor.band, motor.governor.most
    table = motion_from_start_phase(model, model.shafts[h], motor).table
    if table is not None:
        shaft = b if table.shaft is None else body_names(model).index(table.shaft)
        tables.add(row["table"], table, body_speed_ratio(model, b, shaft))
        if table.speed is not None:
            row["table"]["over_angle"] = OVER_SPEED


def fill_coupling_row(row: Any, model: ChainModel, c: int, tables: TableList) -> None:
    """Fills the `structs.Coupling` of coupling c."""
    coupling = model.couplings[c]
    first, second = coupled_bodies(model, coupling)
    row["first"], row["second"] = GROUND if coupling.is_grounded else first, second
    if coupling.freewheel:
        row["freewheel"] = body_turning_sign(model, second if coupling.is_grounded else first)
    row["stiffness"], row["damping"], row["lash"] = coupling.stiffness, coupling.damping, coupling.lash
    ratios, clutch = coupling.ratios, coupling.clutch
    if ratios is not None:
        row["ratios"] = len(ratios.time)
        row["first_ratio"] = tables.add_rows(tuple(zip(ratios.time, ratios.ratio, strict=True)))
    if clutch is not None and clutch.table is not None:
        row["capacity"] = 1.0
        tables.add(row["engagement"], clutch.table, 1.0)
        if clutch.table.speed is not None:
            row["engagement"]["over_angle"] = OVER_SPEED
    elif clutch is not None:
        row["capacity"] = clutch.torque


def fill_coupling_state(row: Any, model: ChainModel, c: int, assembly: Assembly) -> None:
    """Fills the initial state of coupling c, untwisted."""
    ratios = model.couplings[c].ratios
    row["ratio"], row["capacity"] = 1.0 if ratios is None else ratios.ratio[0], math.inf
    row["rest"] = coupling_rest_angle(model, c, row["ratio"], assembly.sprocket_angle)[2]


def fill_valve_row(row: Any, model: ChainModel, v: int, tables: TableList) -> None:
    """Fills the `structs.ValveGroup` of valve group v."""
    valves = model.valves[v]
    body = body_names(model).index(valves.on)
    phases = [math.radians(phase) for phase in valves.phases]
    row["body"], row["phases"], row["first_phase"] = body, len(phases), tables.add_rows((tuple(phases),))
    row["first_cam"] = sum(len(group.phases) for group in model.valves[:v])
    row["sign"], row["count"] = body_turning_sign(model, body), valves.number
    row["turned"] = radians(valves.phase) - start_phase_angle(model, valves.on)
    row["height"], row["mass"] = valves.height, valves.mass
    row["preload"], row["stiffness"] = valves.spring.preload, valves.spring.stiffness
    tables.add(row["lift"], valves.curve, 1.0)


def fill_gear_row(row: Any, model: ChainModel, g: int) -> None:
    """Fills the `structs.Gear` of gear pair g."""
    gear, side = model.gears[g], bodies_beyond_gear(model, g)
    body = body_names(model).index(gear.between[1])
    bodies, ratios = train_of_body(model, body)
    beside = dict(zip(bodies, ratios, strict=True))
    row["body"], row["side"] = body, sum(1 << b for b in side)
    row["inertia"] = sum(beside[b] ** 2 * inertia_of_body(model, b) for b in side)
    row["lever"] = 0.5 * gear.teeth[1] * gear.module * math.cos(math.radians(GEAR_PRESSURE_ANGLE))
