"""Teeth, bands, guide-bars and laws of a variant, where all threads of its block read them."""

from functools import cache

import warp as wp

from ..physics.spin import wheel_of
from ..structs import GROUND, Drive, Pose, types
from .block_kind import BlockKind
from .block_wheels import gears, store_wheel


@cache
def geometry_sharing(kind: BlockKind) -> wp.Function:
    """The function by which the thread of a sprocket shares what belongs to it; that of the first also the rest."""
    Real, sprockets, guides, bodies, profiles = kind.Real, kind.sprockets, kind.guides, kind.bodies, kind.profiles
    sliding, kinds = kind.sliding, types(Real)
    vec2 = kinds.vec2
    store_gear, store_bar = gears(kind).store_gear, gears(kind).store_bar

    @wp.func
    def share_geometry(
        ensemble: kinds.Ensemble, shared: kinds.Shared, drive: Drive, variant: int, s: int, center: wp.vec2d
    ):
        """Teeth and band of sprocket s at `center`; with the first one, the chain and the guide-bars."""
        sprocket = ensemble.sprockets[drive.first_sprocket + s]
        shared.teeth[s] = sprocket
        if wp.static(kind.paired):
            store_gear(shared.gears, s, sprocket)
        band = kinds.Band()
        band.center = vec2(Real(center[0]), Real(center[1]))
        band.near_square = sprocket.near_square
        band.far_square = sprocket.far_square
        shared.bands[s] = band
        if wp.static(sliding):
            shared.sliding[s] = ensemble.tooth_sliding[drive.first_sprocket + s]
        if s == 0:
            if wp.static(kind.paired):
                low, high = drive.low, drive.high
                shared.box[0] = wp.vec4f(
                    wp.float32(low[0]), wp.float32(low[1]), wp.float32(high[0]), wp.float32(high[1])
                )
            shared.chain[0] = ensemble.chains[variant]
            if wp.static(kind.bending):
                shared.joint[0] = ensemble.joints[variant]
            if wp.static(kind.uneven):
                shared.links[0] = ensemble.links[variant]
            if wp.static(profiles):
                ground = Pose()
                ground.cosine = wp.float64(1.0)
                if wp.static(kind.paired):
                    store_wheel(shared.wheels, wp.static(bodies), wheel_of(ground, wp.float64(0.0)))
                else:
                    shared.poses[wp.static(bodies)] = ground
            for g in range(wp.static(guides)):
                bar = ensemble.guides[drive.first_guide + g]
                if wp.static(profiles):
                    bar.body = wp.where(bar.body == GROUND, wp.static(bodies), bar.body)
                    bar.first_piece = drive.first_piece + bar.first_piece
                shared.bars[g] = bar
                if wp.static(kind.paired):
                    store_bar(shared.lines, g, bar)
                if wp.static(sliding):
                    shared.sliding[wp.static(sprockets) + g] = ensemble.guide_sliding[drive.first_guide + g]

    return share_geometry
