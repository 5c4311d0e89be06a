"""Drives of which contacts want the accelerations of bodies before forces (`kernels.physics.body.solved`).

Elsewhere contacts expect of a body what it had the step before, and f = 1 / (1 + g) of a change, g = z m R^2 / J. Let
its teeth be dampers c_i with levers r_i. Speeds of body and rollers that turn around at each step, all others balanced,
neither grow nor decay where

    h sum(c_i r_i^2) / (2 J) = 1 - f / 2,                                                       (a)

whatever a roller's mass is. Beyond it they grow, and the body gains energy. Dampers are strongest at a start: a roller
that has been in its seat from the first has c = d N / v_min under a load N, T p / R under a tension T. A torque moves
n rollers off the middle of their seats, to normals anywhere up to half the seat angle, beta, from the radius:

    sum(c_i r_i^2) = (d / v_min) n T p R (1/2 - sin(2 beta) / (4 beta)).                        (b)

A sprocket that passes no torque on has in place of the last factor the mean square of min(u, sin beta), u from 0 to
n T / (2 k C) of the arc's ends: rollers are off the middle, of clearance C, only by what links are stretched.
A drive that stays slow, whose dampers stay strong, counts twice.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly import Assembly
from warpchain.assembly.bounds import starting_tension
from warpchain.drive import Drive
from warpchain.drive.batch_math import power
from warpchain.drive.sprocket import Led
from warpchain.engine.fill_bodies import is_tied
from warpchain.engine.packed import Packed

LIGHT = 0.2
"""Where `Motion.following` is less, z m R^2 / J above 4, contacts want accelerations whatever dampers are."""

SLOW = 10.0
"""A drive stays slow if rollers come into seats, at p times the sprocket's speed, with less than so many v_min."""

EVEN = 1e-12
"""Rollers no farther off the middle of their seats, over the clearance, are there."""


def braking(packed: Packed, rows: NDArray[np.integer], drive: Drive, assembly: Assembly) -> NDArray[np.float64]:
    """The left side of (a) by (b) for the bodies of a stack's variants (V, B), whose `rows` are filled.

    It is 0 of bodies without teeth, of what is led, and of sprockets on mounts, whose contacts know no accelerations.
    """
    drives, tension = packed.drives[rows], starting_tension(drive, assembly)
    found = np.zeros((len(rows), int(drives["bodies"][0])))
    for s, sprocket in enumerate(drive.sprockets):
        tooth, body = packed.sprockets[drives["first_sprocket"] + s], drives["first_body"] + s
        law, radius, seat_angle = tooth["law"], tooth["pitch_radius"], drive.tooth(s).seat_angle
        seated = (assembly.seat_sprocket == s).sum(axis=-1)
        lever = 0.5 - 0.5 * np.sin(seat_angle) / seat_angle
        if sprocket.load is None and not isinstance(sprocket, Led) and not is_tied(drive):
            off = 0.5 * seated * tension / (drive.chain.stiffness * tooth["clearance"])
            most = np.minimum(off, np.sin(0.5 * seat_angle))
            lever = power(most, 2) * (1.0 - most / np.maximum(1.5 * off, EVEN))
        load = tension * drive.chain.pitch / radius
        damper = law["damping"] * np.where(law["form"] == 0, load / law["speed_floor"], 1.0)
        slow = drive.chain_speed * drive.chain.pitch / radius < SLOW * law["speed_floor"]
        free = (1 + slow) * packed.motions["inverse_inertia"][body] * (packed.mounts["active"][body] == 0)
        found[:, s] = 0.5 * drives["step"] * seated * damper * power(radius, 2) * lever * free
    return found


def wanted(following: NDArray[np.float64], strength: NDArray[np.float64]) -> Any:
    """Whether contacts want accelerations before forces: `Motion.following` and the left side of (a) of each of their
    bodies, (..., B).
    """
    return np.any((following < LIGHT) | (strength > 1.0 - 0.5 * following), axis=-1)


def fill_light(packed: Packed, rows: NDArray[np.integer], drive: Drive, assembly: Assembly) -> None:
    """Fills `Drive.light` of a stack's variants; arguments as of `braking`."""
    strength = braking(packed, rows, drive, assembly)
    bodies = packed.drives["first_body"][rows][:, None] + np.arange(strength.shape[1])
    packed.drives["light"][rows] = wanted(packed.motions["following"][bodies], strength)
