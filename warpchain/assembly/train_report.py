"""Values of `check` on shafts, gears, couplings, valves and motors."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from warpchain.drive.body_ties import body_names, driving_body, first_coupling_ratio, nearest_sprocket, part_of_body
from warpchain.model.train_speeds import lumped_drive
from warpchain.model.trains import (
    body_speed_ratio,
    coupled_bodies,
    is_free_body,
    prescribed_leader,
    train_inertia,
    train_of_body,
)

if TYPE_CHECKING:
    from warpchain.assembly.statics import Steady
    from warpchain.model import ChainModel, Model


_FAST = 1e6
"""Speed beyond all [rad/s], at which loads that grow with it have grown."""


def shaft_report(model: ChainModel) -> list[dict[str, Any]]:
    """Values of `check` on shafts: bodies, speed [rad/s], train's inertia [kg m^2], motor [N m]."""
    names, found = body_names(model), []
    for b, shaft in enumerate(model.own_shafts, len(model.sprockets)):
        speed, motor = _working_speed(model, b), shaft.motor
        found.append(
            {
                "name": shaft.name,
                "with": [names[other] for other in train_of_body(model, b).bodies if other != b],
                "speed": speed,
                "inertia": train_inertia(model, b) if is_free_body(model, b) else None,
                "motor_at_rest": None if motor is None else float(motor.at(0.0)),
                "motor_at_work": None if motor is None or speed is None else float(motor.at(speed)),
            }
        )
    return found


def _working_speed(model: ChainModel, b: int) -> float | None:
    """Forward speed of a shaft at work [rad/s]; None without chain or motion."""
    if nearest_sprocket(model, b) is not None:
        return float(model.driver_speed * body_speed_ratio(model, b, model.driver))
    leader = prescribed_leader(model, b)
    if leader is None:
        return None
    return float(part_of_body(model, leader[0]).prescribed.top_speed * leader[1])


def gear_report(model: ChainModel) -> list[dict[str, Any]]:
    """Values of `check` on gear pairs: shafts, teeth, speed ratio of the second."""
    return [
        {
            "name": gear.name,
            "between": list(gear.between),
            "teeth": list(gear.teeth),
            "ratio": (1.0 if gear.internal else -1.0) * gear.teeth[0] / gear.teeth[1],
        }
        for gear in model.gears
    ]


def valve_report(model: Model) -> list[dict[str, Any]]:
    """Values of `check` on valves: body, count, lift [m], steepest slope [m/rad], spring force [N], speeds [rad/s]."""
    drive, found = model.drive, []
    names = body_names(drive)
    for group in drive.valves:
        lift, slope, _ = group.lifts()
        on = names.index(group.on)
        tied = nearest_sprocket(drive, on) is not None
        found.append(
            {
                "name": group.name,
                "on": group.on,
                "count": group.number * len(group.phases),
                "lift": float(lift.max()),
                "slope": float(slope.max()),
                "spring_force": group.spring.preload + group.spring.stiffness * float(lift.max()),
                "float_speed": group.float_speed,
                "driver_float_speed": group.float_speed * model.speed_ratio(drive.driver, on) if tied else None,
            }
        )
    return found


def coupling_report(model: ChainModel, running: Steady) -> list[dict[str, Any]]:
    """Values of `check` on couplings: frequency [Hz] and damping between the inertias they see, the chain aside.

    In a gearbox's first ratio; twist [rad] and torque from the first body [N m] at work, None without a steady state.
    """
    found = []
    for coupling, twist, torque in zip(model.couplings, running.twist, running.torque, strict=True):
        turns = zip(coupled_bodies(model, coupling), (1.0, float(first_coupling_ratio(coupling) or 1)), strict=True)
        give = sum(i * i / train_inertia(model, b) for b, i in turns if b >= 0 and is_free_body(model, b))
        omega = math.sqrt(coupling.stiffness * give)
        found.append(
            {
                "name": coupling.name,
                "between": list(coupling.between),
                "frequency": omega / math.tau,
                "damping_ratio": 0.5 * coupling.damping * omega / coupling.stiffness,
                "lash": coupling.lash,
                "ratios": None if coupling.ratios is None else list(coupling.ratios.ratio),
                "clutch": None if coupling.clutch is None else coupling.clutch.largest_moment,
                "freewheel": coupling.freewheel,
                "working_twist": None if running.failure else float(twist),
                "working_torque": None if running.failure else float(torque),
            }
        )
    return found


def motor_advice(model: ChainModel) -> Iterator[str]:
    """Advice of `check` on motors that do not start their loads, or that no load balances."""
    b = driving_body(model)
    if getattr(part_of_body(model, b), "motor", None) is None:
        return
    one, name = lumped_drive(model), f"shafts.{body_names(model)[b]}.motor"
    own = body_speed_ratio(model, b, model.driver)
    pulled = sum(r * motor.at(0.0) for r, motor in one.motors) / own
    asked = sum(r * load.steady_moment(0.0) for r, load in one.loads) / own
    if 0.0 < pulled <= asked and one.start <= 0.0:
        yield (
            f"{name}: pulls {pulled:.4g} N m at rest, as this shaft sees it, where loads "
            f"ask for {asked:.4g} N m: it does not start; give it more, or the loads a viscous part instead"
        )
    elif one.net_moment(model.driver_speed) > 0.0 and one.net_moment(_FAST) > 0.0:
        yield (
            f"{name}: no load balances it at any speed: this shaft comes to {own * model.driver_speed:.4g} rad/s at "
            "the end of the run, and would go on; give a load, or the motor a table over speed that falls to 0"
        )


def tie_advice(model: ChainModel) -> Iterator[str]:
    """Advice of `check` on valves on a shaft that no chain turns."""
    names = body_names(model)
    for group in model.valves:
        if nearest_sprocket(model, names.index(group.on)) is None:
            yield (
                f'valves.{group.name}.on = "{group.on}": nothing ties this shaft to the chain, so that it has no speed '
                "of the driver's: put a sprocket on it, or tie it by gears or a coupling"
            )
