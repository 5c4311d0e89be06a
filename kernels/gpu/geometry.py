"""Bodies, teeth, guides and laws of a variant, where all threads of its block read them; rollers seen from bodies."""

from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from ..number import difference, leading, number_of
from ..physics.guide import carried_guide, frame_vector
from ..structs import GROUND, Drive
from .kind import BlockKind
from .rings import block_rings
from .rollers import roller_rows


@cache
def contact_geometry(kind: BlockKind) -> SimpleNamespace:
    """The functions that share and read what contacts of one variant on a block see of bodies and guides."""
    Real, sprockets, guides, bodies = kind.Real, kind.parts.sprockets, kind.parts.guides, kind.parts.bodies
    profiles = kind.profiles
    kinds, moving = kind.types, kind.moving
    Ensemble, Shared, Pose = kinds.Ensemble, kinds.Shared, kinds.Pose
    vec2, point, rings = kinds.vec2, roller_rows(kind).point, block_rings(kind)
    ring_of_guide, body_of = rings.ring_of_guide, rings.body_of

    @wp.func
    def put_pose(shared: Shared, b: int, pose: Pose):
        """Makes it the pose of body b, and its band go with it."""
        shared.poses[b] = pose
        if wp.static(moving):
            if b < wp.static(sprockets):
                center = leading(pose.center)
                shared.bands[b].center = vec2(Real(center[0]), Real(center[1]))

    @wp.func
    def share_ring(ensemble: Ensemble, shared: Shared, drive: Drive, variant: int, r: int):
        """Shares chain r, `drive`, and its box."""
        shared.box[2 * r] = vec2(Real(drive.low[0]), Real(drive.low[1]))
        shared.box[2 * r + 1] = vec2(Real(drive.high[0]), Real(drive.high[1]))
        shared.chain[r] = ensemble.chains[variant + r]

    @wp.func
    def share_chain(ensemble: Ensemble, shared: Shared, drive: Drive, variant: int):
        """The chain and the guides, of all chains; `drive` is the first of them."""
        for r in range(wp.static(kind.parts.rings)):
            share_ring(ensemble, shared, ensemble.drives[variant + r], variant, r)
        if wp.static(profiles):
            ground = Pose()
            ground.cosine = number_of(Real(1.0))
            put_pose(shared, wp.static(bodies), ground)
        for g in range(wp.static(guides)):
            bar = ensemble.guides[drive.first_guide + g]
            if wp.static(profiles):
                ring = ring_of_guide(shared, g)
                body = body_of(ensemble, shared, variant + ring, ring, bar.body)
                bar.body = wp.where(body == GROUND, wp.static(bodies), body)
                bar.first_piece = ensemble.drives[variant + ring].first_piece + bar.first_piece
            shared.bars[g] = bar
            if wp.static(kind.friction.contacts):
                shared.friction[wp.static(sprockets) + g] = ensemble.guide_friction[drive.first_guide + g]

    @wp.func
    def share_sprocket(ensemble: Ensemble, shared: Shared, drive: Drive, s: int, center: Any):
        """Teeth and band of sprocket s at `center`."""
        sprocket = ensemble.sprockets[drive.first_sprocket + s]
        shared.teeth[s] = sprocket
        band = kinds.Band()
        band.center = vec2(Real(center[0]), Real(center[1]))
        band.near_square = sprocket.near_square
        band.far_square = sprocket.far_square
        shared.bands[s] = band
        if wp.static(kind.friction.contacts):
            shared.friction[s] = ensemble.tooth_friction[drive.first_sprocket + s]

    @wp.func
    def guide_at(shared: Shared, g: int):
        """Guide g where it is now; one with a profile stays in the frame of the body that carries it."""
        bar = shared.bars[g]
        if wp.static(profiles):
            if bar.pieces == 0 and bar.body < wp.static(bodies):
                bar = carried_guide(bar, shared.poses[bar.body])
        return bar

    @wp.func
    def arm_on(shared: Shared, j: int, b: int):
        """Roller j from the center of body b, which carries a guide [m]."""
        return leading(difference(point(shared.rows, j), shared.poses[b].center))

    @wp.func
    def in_carrier(shared: Shared, j: int, b: int):
        """Roller j from the center of body b, which carries a guide, and in that body's frame [m]."""
        carrier = shared.poses[b]
        arm = difference(point(shared.rows, j), carrier.center)
        q = arm
        if b < wp.static(bodies):  # the ground has not turned
            q = frame_vector(arm, carrier)
        return arm, q

    return SimpleNamespace(**locals())
