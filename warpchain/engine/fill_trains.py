"""Rows of the kernels' structs for shafts: how bodies turn in trains, motors, couplings, gears and valves."""

from __future__ import annotations

import math
from typing import Any

from warpchain.assembly import Assembly
from warpchain.assembly.table_cells import TableList
from warpchain.drive import Drive
from warpchain.drive.batch_math import radians
from warpchain.drive.trains import (
    PRESSURE_ANGLE,
    gear_side,
    has_trains,
    names_of,
    own_inertia,
    speed_ratio,
    train_of,
    turning_sign,
    untwisted,
)
from warpchain.drive.turned import turned_by, turned_on
from warpchain.kernels.physics.train import OVER_SPEED


def fill_counts(row: Any, drive: Drive) -> None:
    """Fills how many of these a `kernels.structs.Drive` has."""
    row["shafts"], row["gears"], row["couplings"] = len(drive.shafts), len(drive.gears), len(drive.couplings)
    row["valves"] = len(drive.valves)
    row["tied"] = is_tied(drive)


def is_tied(drive: Drive) -> bool:
    """Whether kernels gather the moments on bodies before they turn any."""
    return has_trains(drive) or bool(drive.valves)


def fill_tie(row: Any, drive: Drive, b: int) -> None:
    """Fills how body b turns in its train; an arm is in none."""
    if b >= drive.first_arm_body:
        row["train"] = -1
        return
    bodies, ratios = train_of(drive, b)
    row["train"], row["ratio"], row["inertia"] = bodies[0], 1.0 / ratios[0], own_inertia(drive, b)


def fill_shaft(row: Any, drive: Drive, h: int, assembly: Assembly) -> None:
    """Fills the `kernels.structs.BodyState` of shaft h; it stands where the first sprocket does, and does not move."""
    row["speed"] = assembly.shaft_speed[..., h]
    row["center"] = assembly.path.center[..., 0, :]


def fill_motor(row: Any, drive: Drive, h: int, tables: TableList) -> None:
    """Fills the motor of shaft h; it stays zero without one."""
    motor, b = drive.shafts[h].motor, len(drive.sprockets) + h
    if motor is None:
        return
    row["present"] = 1
    row["torque"] = 0.0 if motor.torque is None else motor.torque
    row["power"] = 0.0 if motor.power is None else motor.power
    row["ramp_time"] = motor.ramp_time
    table = turned_on(drive, drive.shafts[h], motor).table
    if table is not None:
        shaft = b if table.shaft is None else names_of(drive).index(table.shaft)
        tables.add(row["table"], table, speed_ratio(drive, b, shaft))
        if table.speed is not None:
            row["table"]["over_angle"] = OVER_SPEED


def fill_coupling(row: Any, drive: Drive, c: int, tables: TableList) -> None:
    """Fills coupling c."""
    coupling, names = drive.couplings[c], names_of(drive)
    row["first"], row["second"] = (names.index(name) for name in coupling.between)
    row["stiffness"], row["damping"], row["lash"] = coupling.stiffness, coupling.damping, coupling.lash
    ratios, clutch = coupling.ratios, coupling.clutch
    if ratios is not None:
        row["ratios"] = len(ratios.time)
        row["first_ratio"] = tables.add_rows(tuple(zip(ratios.time, ratios.ratio, strict=True)))
    if clutch is not None and clutch.table is not None:
        row["capacity"] = 1.0
        tables.add(row["engagement"], clutch.table, 1.0)
    elif clutch is not None:
        row["capacity"] = clutch.torque


def fill_engaged(row: Any, drive: Drive, c: int, assembly: Assembly) -> None:
    """Fills the state of coupling c, which is not twisted where the chain has been laid."""
    ratios = drive.couplings[c].ratios
    row["ratio"], row["capacity"] = 1.0 if ratios is None else ratios.ratio[0], math.inf
    row["rest"] = untwisted(drive, c, row["ratio"], assembly.sprocket_angle)[2]


def fill_valve(row: Any, drive: Drive, v: int, tables: TableList) -> None:
    """Fills group v of valves."""
    valves = drive.valves[v]
    body = names_of(drive).index(valves.on)
    phases = [math.radians(phase) for phase in valves.phases]
    row["body"], row["phases"], row["first_phase"] = body, len(phases), tables.add_rows((tuple(phases),))
    row["sign"], row["count"] = turning_sign(drive, body), valves.number
    row["turned"] = radians(valves.phase) - turned_by(drive, valves.on)
    row["height"], row["mass"] = valves.height, valves.mass
    row["preload"], row["stiffness"] = valves.spring.preload, valves.spring.stiffness
    tables.add(row["lift"], valves.curve, 1.0)


def fill_gear(row: Any, drive: Drive, g: int) -> None:
    """Fills gear pair g."""
    gear, side = drive.gears[g], gear_side(drive, g)
    body = names_of(drive).index(gear.between[1])
    bodies, ratios = train_of(drive, body)
    beside = dict(zip(bodies, ratios, strict=True))
    row["body"], row["side"] = body, sum(1 << b for b in side)
    row["inertia"] = sum(beside[b] ** 2 * own_inertia(drive, b) for b in side)
    row["lever"] = 0.5 * gear.teeth[1] * gear.module * math.cos(math.radians(PRESSURE_ANGLE))
