"""Mounts and balance wheels of sprockets: places, velocities, masses, springs."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from warpchain.drive.sprocket import ArmMount, ElasticMount, FixedMount, PrescribedMount, SliderMount
from warpchain.drive.stack_math import (
    Number,
    array_of_columns,
    cos,
    cos_sin,
    hypot,
    is_true_somewhere,
    maximum,
    power,
    radians,
    sin,
)

if TYPE_CHECKING:
    from warpchain.drive.motion_table import PlaceTable
    from warpchain.drive.sprocket import Sprocket


def unit_direction(direction: tuple[float, float]) -> NDArray[np.float64]:
    """Unit vector (2,) along a mount's direction."""
    return array_of_columns(_unit_components(direction))


def _unit_components(direction: tuple[float, float]) -> tuple[Number, Number]:
    """Components of the unit vector along a mount's direction."""
    x, y = direction
    size = hypot(x, y)
    return x / size, y / size


def rim_angle(sprocket: Sprocket) -> Number:
    """Start angle of an end's pin on its rim [rad]."""
    return radians(0.0 if sprocket.key is None else sprocket.key)


def initial_place(sprocket: Sprocket) -> tuple[Number, Number]:
    """Start place of a sprocket's center, or of an end's pin on a rim [m]."""
    (x, y), mount = sprocket.center, sprocket.mount
    if sprocket.rim is not None:
        cosine, sine = cos_sin(rim_angle(sprocket))
        return x + sprocket.rim * cosine, y + sprocket.rim * sine
    if not isinstance(mount, PrescribedMount) or mount.direction is None:
        return x, y
    (ux, uy), way = _unit_components(mount.direction), mount.offset + mount.amplitude * sin(mount.phase)
    return x + ux * way, y + uy * way


def initial_velocity(sprocket: Sprocket, pivot: PlaceTable | None) -> NDArray[np.float64]:
    """Start velocity of a sprocket's center (2,) [m/s]."""
    mount = sprocket.mount
    if isinstance(mount, ArmMount):
        return start_velocity(pivot)
    if not isinstance(mount, PrescribedMount):
        return np.zeros(2)
    if mount.direction is None:
        return start_velocity(mount.table)
    (ux, uy), rate = _unit_components(mount.direction), 2.0 * math.pi * mount.frequency
    speed = mount.amplitude * rate * cos(mount.phase)
    return array_of_columns((ux * speed, uy * speed))


def start_velocity(table: PlaceTable | None) -> NDArray[np.float64]:
    """Start velocity of a place table (2,) [m/s]."""
    return np.zeros(2) if table is None else np.array(table.start_velocity)


def largest_displacement(sprocket: Sprocket) -> float:
    """Largest prescribed displacement of a sprocket's center [m]."""
    mount = sprocket.mount
    if not isinstance(mount, PrescribedMount):
        return 0.0
    return (
        abs(mount.offset)
        + abs(mount.amplitude)
        + (mount.table.largest_displacement if mount.table is not None else 0.0)
    )


def has_moving_center(sprocket: Sprocket) -> bool:
    """Whether a mount lets a sprocket's center move."""
    return not isinstance(sprocket.mount, FixedMount | ArmMount)


def is_on_springs(sprocket: Sprocket) -> bool:
    """Whether a sprocket's mount is elastic or a slider."""
    return isinstance(sprocket.mount, ElasticMount | SliderMount)


def has_active_mount(sprocket: Sprocket) -> bool:
    """Whether a sprocket's center moves or has a balance wheel."""
    return has_moving_center(sprocket) or is_true_somewhere(wheel_mass(sprocket) > 0.0)


def wheel_mass(sprocket: Sprocket) -> float:
    """Mass of a sprocket's balance wheel [kg]."""
    return sprocket.balance_wheel.mass if sprocket.balance_wheel is not None else 0.0


def wheel_inertia(sprocket: Sprocket) -> float:
    """Inertia of a sprocket's balance wheel [kg m^2]."""
    wheel = sprocket.balance_wheel
    return wheel_mass(sprocket) * power(wheel.radius, 2) if wheel is not None else 0.0


def moving_mass(sprocket: Sprocket) -> float:
    """Mass of a sprocket with balance wheel [kg]."""
    return (0.0 if sprocket.mass is None else sprocket.mass) + wheel_mass(sprocket)


def mount_spring(sprocket: Sprocket) -> tuple[float, float]:
    """Largest stiffness [N/m] and damping [N s/m] of a mount."""
    mount = sprocket.mount
    if isinstance(mount, ElasticMount):
        return maximum(*mount.stiffness), maximum(*mount.damping)
    return (mount.stiffness, mount.damping) if isinstance(mount, SliderMount) else (0.0, 0.0)


def mount_frequencies(sprocket: Sprocket) -> tuple[float, ...]:
    """Natural frequencies of a mount without chain [Hz]."""
    mount = sprocket.mount
    stiffness: tuple[float, ...] = mount.stiffness if isinstance(mount, ElasticMount) else ()
    if isinstance(mount, SliderMount):
        stiffness = (mount.stiffness,)
    return tuple(math.sqrt(k / moving_mass(sprocket)) / (2.0 * math.pi) for k in stiffness)


def wheel_force(sprocket: Sprocket, speed: float) -> float:
    """Centrifugal force of a balance wheel [N]."""
    return (
        wheel_mass(sprocket) * sprocket.balance_wheel.radius * speed**2 if sprocket.balance_wheel is not None else 0.0
    )
