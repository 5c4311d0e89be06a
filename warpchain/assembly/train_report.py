"""Figures of `check` on shafts, gears, couplings, valves and motors."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from warpchain.drive.geared import own_shafts
from warpchain.drive.train_speeds import as_one
from warpchain.drive.trains import (
    driving_body,
    first_ratio,
    is_free,
    leader_of,
    names_of,
    nearest_sprocket,
    seen_inertia,
    speed_ratio,
    train_of,
    turned_part,
)

if TYPE_CHECKING:
    from warpchain.assembly.statics import Steady
    from warpchain.drive import Drive


_FAST = 1e6
"""A speed beyond all [rad/s], at which loads that grow with it have grown."""


def shafts(drive: Drive) -> list[dict[str, Any]]:
    """Shafts: what turns as one with each, speed at work [rad/s] if that is known, inertia that it sees [kg m^2] and
    its motor [N m]."""
    names, found = names_of(drive), []
    for b, shaft in enumerate(own_shafts(drive), len(drive.sprockets)):
        speed, motor = _speed(drive, b), shaft.motor
        found.append(
            {
                "name": shaft.name,
                "with": [names[other] for other in train_of(drive, b).bodies if other != b],
                "speed": speed,
                "inertia": seen_inertia(drive, b) if is_free(drive, b) else None,
                "motor_at_rest": None if motor is None else float(motor.at(0.0)),
                "motor_at_work": None if motor is None or speed is None else float(motor.at(speed)),
            }
        )
    return found


def _speed(drive: Drive, b: int) -> float | None:
    """Forward speed of a shaft at work [rad/s]; of one that nothing ties to a chain as it is led, else None."""
    if nearest_sprocket(drive, b) is not None:
        return float(drive.driver_speed * speed_ratio(drive, b, drive.driver))
    leader = leader_of(drive, b)
    if leader is None:
        return None
    return float(turned_part(drive, leader[0]).prescribed.top_speed * leader[1])


def gears(drive: Drive) -> list[dict[str, Any]]:
    """Pairs of gears: shafts, teeth, and the speed of the second over that of the first."""
    return [
        {
            "name": gear.name,
            "between": list(gear.between),
            "teeth": list(gear.teeth),
            "ratio": (1.0 if gear.internal else -1.0) * gear.teeth[0] / gear.teeth[1],
        }
        for gear in drive.gears
    ]


def valves(drive: Drive) -> list[dict[str, Any]]:
    """Groups of valves: what they are on, how many, lift [m], steepest lift by the angle [m], the largest force of a
    spring [N], and the speed of their shaft, and of the driver, above which followers lift off [rad/s]; None of the
    driver where nothing ties the shaft to it.
    """
    names, found = names_of(drive), []
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
                "driver_float_speed": group.float_speed * speed_ratio(drive, drive.driver, on) if tied else None,
            }
        )
    return found


def couplings(drive: Drive, running: Steady) -> list[dict[str, Any]]:
    """Couplings: what they couple, own frequency [Hz] and damping ratio between the inertias that they see, the chain
    aside, in the first ratio of a gearbox; lash [rad], ratios, what a clutch bears at most [N m], and at work twist
    [rad] and torque taken from the first [N m], counter-clockwise, None where no steady state was found."""
    names, found = names_of(drive), []
    for coupling, twist, torque in zip(drive.couplings, running.twist, running.torque, strict=True):
        ends = [names.index(name) for name in coupling.between]
        turns = zip(ends, (1.0, float(first_ratio(coupling) or 1)), strict=True)
        give = sum(i * i / seen_inertia(drive, b) for b, i in turns if is_free(drive, b))
        omega = math.sqrt(coupling.stiffness * give)
        found.append(
            {
                "name": coupling.name,
                "between": list(coupling.between),
                "frequency": omega / math.tau,
                "damping_ratio": 0.5 * coupling.damping * omega / coupling.stiffness,
                "lash": coupling.lash,
                "ratios": None if coupling.ratios is None else list(coupling.ratios.ratio),
                "clutch": None if coupling.clutch is None else coupling.clutch.most,
                "working_twist": None if running.failure else float(twist),
                "working_torque": None if running.failure else float(torque),
            }
        )
    return found


def advice(drive: Drive) -> Iterator[str]:
    """Lines on motors that do not start their loads, or that no load ever balances."""
    b = driving_body(drive)
    if getattr(turned_part(drive, b), "motor", None) is None:
        return
    one, name = as_one(drive), f"shafts.{names_of(drive)[b]}.motor"
    own = speed_ratio(drive, b, drive.driver)
    pulled = sum(r * motor.at(0.0) for r, motor in one.motors) / own
    asked = sum(r * load.steady(0.0) for r, load in one.loads) / own
    if 0.0 < pulled <= asked and one.start <= 0.0:
        yield (
            f"{name}: pulls {pulled:.4g} N m at rest, as this shaft sees it, where loads "
            f"ask for {asked:.4g} N m: it does not start; give it more, or the loads a viscous part instead"
        )
    elif one.moment(drive.driver_speed) > 0.0 and one.moment(_FAST) > 0.0:
        yield (
            f"{name}: no load balances it at any speed: this shaft comes to {own * drive.driver_speed:.4g} rad/s at "
            "the end of the run, and would go on; give a load, or the motor a table over speed that falls to 0"
        )


def tie_advice(drive: Drive) -> Iterator[str]:
    """Lines on valves on a shaft that nothing ties to a chain."""
    names = names_of(drive)
    for group in drive.valves:
        if nearest_sprocket(drive, names.index(group.on)) is None:
            yield (
                f'valves.{group.name}.on = "{group.on}": nothing ties this shaft to the chain, so that it has no speed '
                "of the driver's: put a sprocket on it, or tie it by gears or a coupling"
            )
