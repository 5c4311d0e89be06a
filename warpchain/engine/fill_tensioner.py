"""Rows of `kernels.structs.Tensioner` from the tensioners of drives."""

from __future__ import annotations

import math
from typing import Any

from warpchain.drive import Drive
from warpchain.drive.batch_math import each, joined, largest, power, sqrt, where
from warpchain.drive.oil import LAMINAR_DROP, bottom_place, static_pressure
from warpchain.drive.tensioners import VAPOR_PRESSURE, Tensioner

STOP_DAMPING = 0.3
"""Damping ratio of ratchet and bottom, with the mass of the plunger or of a roller, whichever is more."""


def fill_tensioner(row: Any, drive: Drive, t: int) -> None:
    """Fills the row of a drive's tensioner number `t`.

    It touches an arm, whose center is its pivot, at a point of the arm's; a sprocket on a slider at its center, since
    the plunger does not turn with it.
    """
    tensioner, body = drive.tensioners[t], drive.tensioner_body(t)
    row["body"] = body
    arm = body - len(drive.sprockets)
    if arm < 0:
        row["home"] = joined(drive.sprockets[body].center)
    else:
        row["home"] = joined(tensioner.at)
        row["point"] = joined(tensioner.at) - joined(drive.arms[arm].pivot)
    row["direction"] = joined(tensioner.unit_direction)
    fill_element(row, drive, tensioner)


def fill_element(row: Any, drive: Drive, tensioner: Tensioner) -> None:
    """Fills what a tensioner is by itself: spring, oil, valve, ratchet, and stops as stiff as a link of the chain."""
    stiffness, mass = drive.chain.stiffness, largest(tensioner.plunger_mass, drive.chain.mass)
    row["stop_stiffness"], row["stop_damping"] = stiffness, 2.0 * STOP_DAMPING * sqrt(stiffness * mass)
    row["stiffness"], row["preload"] = tensioner.spring_stiffness, tensioner.spring_preload
    row["damping"] = tensioner.spring_damping
    row["bottom"] = bottom_place(tensioner)
    if tensioner.ratchet is not None:
        row["ratchet_pitch"], row["backlash"] = tensioner.ratchet.pitch, tensioner.ratchet.backlash
    if tensioner.hydraulic:
        row["hydraulic"] = 1
        _fill_oil(row, tensioner)


def _fill_oil(row: Any, tensioner: Tensioner) -> None:
    oil, valve, chamber = tensioner.oil, tensioner.valve, tensioner.chamber
    assert oil is not None and valve is not None and chamber is not None
    row["area"], row["volume"] = tensioner.area, chamber.volume
    row["leak"], row["drag"] = tensioner.leak_conductance, tensioner.drag_flow
    row["supply"], row["ambient"], row["vapor"] = oil.supply, oil.ambient, VAPOR_PRESSURE
    row["rest"] = static_pressure(tensioner)
    row["bulk_modulus"], row["air"], row["density"] = oil.bulk_modulus, oil.air, oil.density
    row["hole_area"] = valve.hole_area
    row["valve_preload"], row["lift_max"] = valve.preload, valve.lift
    # without a spring it opens all the way
    row["valve_stiffness"] = where(valve.stiffness > 0.0, valve.stiffness, 1e-300)
    angle = valve.seat_angle_rad
    row["seat_width"] = 2.0 * valve.ball_radius * each(math.tan)(angle)
    row["seat_growth"] = each(math.sin)(angle) / power(each(math.cos)(angle), 2)
    row["discharge"], row["laminar_limit"] = valve.discharge, LAMINAR_DROP
