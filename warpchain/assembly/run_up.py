"""Run-up of a drive from its start to work: speeds, accelerations, moments."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly.statics import load_moments
from warpchain.drive.body_ties import body_names, driving_body, nearest_sprocket, part_of_body
from warpchain.model.train_speeds import SPEED_STEPS, lumped_drive, speed_steps
from warpchain.model.trains import body_speed_ratio, free_body_loads, inertia_behind_body, is_free_body, is_held_body

if TYPE_CHECKING:
    from warpchain.model import ChainModel

Array = NDArray[np.float64]

_BALANCED = 1e-9
"""Largest moment left of motors and loads in balance, relative."""


class RunUp(NamedTuple):
    """Run-up of a driver: speeds (K,) [rad/s] and accelerations (K,) [rad/s^2] to work."""

    speed: Array
    acceleration: Array

    def times(self, ratio: float) -> RunUp:
        """Run-up of a body that turns `ratio` times as fast."""
        return RunUp(ratio * self.speed, ratio * self.acceleration)

    def at(self, k: int) -> tuple[float, float]:
        """Speed [rad/s] and acceleration [rad/s^2] at place k of a run-up."""
        return float(self.speed[k]), float(self.acceleration[k])


def driver_run_up(model: ChainModel) -> RunUp:
    """Run-up of a chain's driver by ramp or table, else by motors and loads."""
    b = driving_body(model)
    motion, top = part_of_body(model, b).prescribed, model.driver_speed
    if motion is None:
        return _free_run_up(model)
    table = motion.table
    speed, acceleration = [], []
    if motion.ramp_time > 0.0:
        u = np.linspace(0.0, 1.0, SPEED_STEPS + 1)
        speed, acceleration = [top * u**2 * (3.0 - 2.0 * u)], [6.0 * top * u * (1.0 - u) / motion.ramp_time]
    elif table is not None and table.time is not None:
        ratio, time = body_speed_ratio(model, model.driver, b), np.array(table.over)
        slope = ratio * np.diff(table.values) / np.diff(time)
        slope = slope[time[:-1] < model.run.duration]
        rows = ratio * np.array(table.values)
        speed, acceleration = [rows[: len(slope)], rows[1 : len(slope) + 1]], [slope, slope]
    return RunUp(np.concatenate([*speed, [top]]), np.concatenate([*acceleration, [0.0]]))


def _free_run_up(model: ChainModel) -> RunUp:
    """Run-up of a drive in which no motion is prescribed."""
    one, top = lumped_drive(model), model.driver_speed
    grid = speed_steps(one.start, top)
    least, most = one.net_moment_bounds(grid)
    at_work = float(one.net_moment(top))
    if abs(at_work) <= _BALANCED * sum(r * motor.largest_moment for r, motor in one.motors):
        at_work = 0.0
    moments = np.concatenate([least, most, [at_work]])
    return RunUp(np.concatenate([grid, grid, [top]]), moments / float(one.inertia))


def run_up_moments(model: ChainModel, of: RunUp) -> Array:
    """Moments of loads and inertias against forward rotation in a run-up (S + H, K) [N m]."""
    found = load_moments(model, of.speed)
    for b in range(len(found)):
        if is_free_body(model, b) and nearest_sprocket(model, b) is not None:
            found[b] += inertia_behind_body(model, b) * body_speed_ratio(model, b, model.driver) * of.acceleration
    return found


def tension_rises(model: ChainModel, moments: Array) -> Array:
    """Tension of the strand behind each sprocket above the driver's (S, K) [N].

    Args:
        moments: (S + H, K) against forward rotation [N m].
    """
    count = len(model.sprockets)
    found = np.zeros((count, moments.shape[1]))
    asked = np.zeros_like(found)
    for b in range(len(moments)):
        s = nearest_sprocket(model, b)
        if s is not None and not is_held_body(model, s):
            asked[s] += (1.0 if b == s else body_speed_ratio(model, b, s)) * moments[b] / model.pitch_radius(s)
    for turn in range(1, count):
        s = (model.driver + turn) % count
        found[s] = found[s - 1] + asked[s]
    return found


def hardest_place(model: ChainModel, of: RunUp, moments: Array) -> int:
    """Index of the run-up's place with the hardest pull on the chain; -1, at work, where none is harder."""
    rise = tension_rises(model, moments)
    chain_speed = of.speed * model.pitch_radius(model.driver)
    pull = np.ptp(rise, axis=0) + model.chain.mass / model.chain.pitch * chain_speed**2
    k = int(pull.argmax())
    return k if pull[k] > (1.0 + _BALANCED) * pull[-1] else -1


def missing_effects(model: ChainModel) -> Iterator[str]:
    """Names of effects that the largest pull of a run-up leaves out."""
    yield "vibration"
    b = driving_body(model)
    names = body_names(model)
    motion = part_of_body(model, b).prescribed
    if motion is not None and (motion.harmonics or (motion.table is not None and motion.table.angle is not None)):
        yield f'the ups and downs of "{names[b]}", which is led'
    for other, load in free_body_loads(model):
        s = nearest_sprocket(model, other)
        if (s is None or is_held_body(model, s)) and (load.harmonics or load.table is not None):
            yield f'the ups and downs of the load on "{names[other]}", which drives'
    for coupling in model.couplings:
        if coupling.ratios is not None and len({ratio for ratio in coupling.ratios.ratio if ratio}) > 1:
            yield f'the other ratios of "{coupling.name}" than its first'
        if coupling.clutch is not None:
            yield f'what "{coupling.name}" passes on while it slips, up to {coupling.clutch.largest_moment:.4g} N m'
        if coupling.freewheel and not coupling.is_grounded:
            yield f'that "{coupling.name}" may be overrun'
    if motion is not None:
        return
    one, shafts = lumped_drive(model), list(enumerate(model.shafts, len(model.sprockets)))
    for h, shaft in ((h, shaft) for h, shaft in shafts if nearest_sprocket(model, h) is not None):
        if shaft.motor is not None and shaft.motor.ramp_time <= 0.0:
            yield f'the jerk of the motor on "{shaft.name}", which comes on at once: up to twice as much'
        if shaft.initial_speed is None:
            continue
        with_driver = float(one.start) * body_speed_ratio(model, h, model.driver)
        if abs(shaft.initial_speed - with_driver) > 1e-3 * max(shaft.initial_speed, with_driver):
            yield (
                f'how "{shaft.name}", which begins with {shaft.initial_speed:.4g} rad/s, comes to the '
                f"{with_driver:.4g} rad/s that the driver has"
            )
