"""The window's sums at float32 without float64: of sprockets that spin.

While a kernel runs, sums are pairs of float32; what it reads and writes back is float64, and the host knows no other.
"""

import warp as wp

from ..pairs import added, pair_of, whole
from ..structs import SpinSums
from ..sum_structs import SprocketSums


@wp.func
def spin_sums_of(sums: SprocketSums):
    """Sums in float64 as pairs."""
    spin = SpinSums()
    spin.speed_min = wp.float32(sums.speed_min)
    spin.speed_max = wp.float32(sums.speed_max)
    spin.speed = pair_of(sums.speed)
    spin.speed_square = pair_of(sums.speed_square)
    spin.moment = pair_of(sums.moment)
    spin.contact_work = pair_of(sums.contact_work)
    spin.load_work = pair_of(sums.load_work)
    spin.force_x = pair_of(sums.force[0])
    spin.force_y = pair_of(sums.force[1])
    spin.force_max = wp.float32(sums.force_max)
    return spin


@wp.func
def with_recent(sums: SpinSums):
    """The sums with what a few steps have added, of which plain float32 is enough."""
    sums.moment = added(sums.moment, sums.recent[0])
    sums.contact_work = added(sums.contact_work, sums.recent[1])
    sums.load_work = added(sums.load_work, sums.recent[2])
    sums.recent = wp.vec3f()
    return sums


@wp.func
def sprocket_sums_of(found: SpinSums):
    """Sums in pairs as float64."""
    spin = with_recent(found)
    sums = SprocketSums()
    sums.speed_min = wp.float64(spin.speed_min)
    sums.speed_max = wp.float64(spin.speed_max)
    sums.speed = whole(spin.speed)
    sums.speed_square = whole(spin.speed_square)
    sums.moment = whole(spin.moment)
    sums.contact_work = whole(spin.contact_work)
    sums.load_work = whole(spin.load_work)
    sums.force = wp.vec2d(whole(spin.force_x), whole(spin.force_y))
    sums.force_max = wp.float64(spin.force_max)
    return sums


@wp.func
def add_spin_powers(sums: SpinSums, speed: wp.float32, moment: wp.float32, load: wp.float32, weight: wp.float32):
    """As `sums.add_powers`."""
    way = weight * speed
    sums.recent = sums.recent + wp.vec3f(weight * moment, way * moment, way * load)
    return sums


@wp.func
def add_spin_speed(sums: SpinSums, speed: wp.float32, weight: wp.float32):
    """As `sums.add_speed`."""
    sums.speed_min = wp.min(sums.speed_min, speed)
    sums.speed_max = wp.max(sums.speed_max, speed)
    way = weight * speed
    sums.speed = added(sums.speed, way)
    sums.speed_square = added(sums.speed_square, way * speed)
    return sums


@wp.func
def add_spin_hub(sums: SpinSums, force: wp.vec2f, weight: wp.float32):
    """As `sums.add_hub_force`."""
    sums.force_x = added(sums.force_x, weight * force[0])
    sums.force_y = added(sums.force_y, weight * force[1])
    sums.force_max = wp.max(sums.force_max, wp.length(force))
    return sums
