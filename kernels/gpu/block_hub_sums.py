"""The window's sums of moving sprockets at float32 without float64, as `block_spin_sums` has those of what turns."""

from typing import Any

import warp as wp

from ..pairs import added, pair_of, whole
from ..physics.hub import off_home
from ..structs import Hub, HubSums, Wheel
from ..sum_structs import MountSums


@wp.func
def hub_sums_of(sums: MountSums):
    """Sums in float64 as pairs."""
    hub = HubSums()
    hub.travel_x = pair_of(sums.travel[0])
    hub.travel_y = pair_of(sums.travel[1])
    hub.travel_max = wp.float32(sums.travel_max)
    hub.force = pair_of(sums.force)
    hub.dissipated = pair_of(sums.dissipated)
    hub.work = pair_of(sums.work)
    return hub


@wp.func
def mount_sums_of(hub: HubSums):
    """Sums in pairs as float64."""
    sums = MountSums()
    sums.travel = wp.vec2d(whole(hub.travel_x), whole(hub.travel_y))
    sums.travel_max = wp.float64(hub.travel_max)
    sums.force = whole(hub.force)
    sums.dissipated = whole(hub.dissipated)
    sums.work = whole(hub.work)
    return sums


@wp.func
def add_hub_sums(
    sums: HubSums, wheel: Wheel, body: Any, hub: Hub, held: wp.vec2f, power: wp.float32, weight: wp.float32
):
    """As `sums.add_mount`."""
    apart = off_home(wheel, hub)
    sums.travel_x = added(sums.travel_x, weight * apart[0])
    sums.travel_y = added(sums.travel_y, weight * apart[1])
    sums.travel_max = wp.max(sums.travel_max, wp.length(apart))
    sums.force = added(sums.force, weight * wp.length(held))
    sums.dissipated = added(sums.dissipated, weight * wp.dot(body.velocity, hub.damping * body.velocity))
    sums.work = added(sums.work, weight * power)
    return sums
