"""Teeth, bands, guides and laws of a variant, where all threads of its block read them; rollers seen from bodies."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from ..namespace import namespace
from ..number import difference, leading
from ..physics.contact import center_of
from ..physics.profile import in_frame
from ..physics.spin import wheel_of
from ..structs import GROUND, Drive, Pose, types
from .kind import BlockKind
from .roller_rows import roller_rows
from .wheels import gears, load_wheel, seen_wheel, store_wheel, velocity_of


@cache
def contact_geometry(kind: BlockKind) -> SimpleNamespace:
    """The functions that share and read what contacts of one variant on a block see of bodies and guides."""
    Real, sprockets, guides, bodies, profiles = kind.Real, kind.sprockets, kind.guides, kind.bodies, kind.profiles
    paired, kinds = kind.paired, types(Real)
    vec2, point = kinds.vec2, roller_rows(kind).point
    rows = gears(kind)

    @wp.func
    def share_geometry(
        ensemble: kinds.Ensemble, shared: kinds.Shared, drive: Drive, variant: int, s: int, center: wp.vec2d
    ):
        """Teeth and band of sprocket s at `center`; with the first one, the chain and the guide-bars."""
        sprocket = ensemble.sprockets[drive.first_sprocket + s]
        shared.teeth[s] = sprocket
        if wp.static(paired):
            rows.store_gear(shared.gears, s, sprocket)
        band = kinds.Band()
        band.center = vec2(Real(center[0]), Real(center[1]))
        band.near_square = sprocket.near_square
        band.far_square = sprocket.far_square
        shared.bands[s] = band
        if wp.static(kind.contact_friction):
            shared.sliding[s] = ensemble.tooth_sliding[drive.first_sprocket + s]
        if s == 0:
            if wp.static(paired):
                low, high = drive.low, drive.high
                shared.box[0] = wp.vec4f(
                    wp.float32(low[0]), wp.float32(low[1]), wp.float32(high[0]), wp.float32(high[1])
                )
            shared.chain[0] = ensemble.chains[variant]
            if wp.static(kind.joint_friction):
                shared.joint[0] = ensemble.joints[variant]
            if wp.static(kind.varied_links):
                shared.links[0] = ensemble.links[variant]
            if wp.static(profiles):
                ground = Pose()
                ground.cosine = wp.float64(1.0)
                if wp.static(paired):
                    store_wheel(shared.wheels, wp.static(bodies), wheel_of(ground, wp.float64(0.0)))
                else:
                    shared.poses[wp.static(bodies)] = ground
            for g in range(wp.static(guides)):
                bar = ensemble.guides[drive.first_guide + g]
                if wp.static(profiles):
                    bar.body = wp.where(bar.body == GROUND, wp.static(bodies), bar.body)
                    bar.first_piece = drive.first_piece + bar.first_piece
                shared.bars[g] = bar
                if wp.static(paired):
                    rows.store_bar(shared.lines, g, bar)
                if wp.static(kind.contact_friction):
                    shared.sliding[wp.static(sprockets) + g] = ensemble.guide_sliding[drive.first_guide + g]

    @wp.func
    def teeth_of(shared: kinds.Shared, s: int):
        """Teeth of sprocket s."""
        if wp.static(paired):
            return rows.load_gear(shared.gears, s)
        else:
            return shared.teeth[s]

    @wp.func
    def bar_of(shared: kinds.Shared, g: int):
        """Guide g."""
        if wp.static(paired and not profiles):
            return rows.load_bar(shared.lines, g)
        else:
            return shared.bars[g]

    @wp.func
    def sprocket_at(shared: kinds.Shared, s: int):
        """Where sprocket s is, as contacts see it."""
        if wp.static(paired):
            return seen_wheel(shared.wheels, s)
        else:
            return shared.poses[s]

    @wp.func
    def carrier_at(shared: kinds.Shared, b: int):
        """Where body b is that carries a guide."""
        if wp.static(paired):
            return load_wheel(shared.wheels, b)
        else:
            return shared.poses[b]

    @wp.func
    def center_velocity(shared: kinds.Shared, b: int):
        """Velocity of the center of body b [m/s]."""
        if wp.static(paired):
            return velocity_of(shared.wheels, b)
        else:
            return shared.poses[b].velocity

    @wp.func
    def arm_on(shared: kinds.Shared, j: int, b: int):
        """Roller j from the center of body b, which carries a guide [m]."""
        return leading(difference(point(shared.rows, j), center_of(carrier_at(shared, b))))

    @wp.func
    def in_carrier(shared: kinds.Shared, j: int, b: int):
        """Roller j from the center of body b, which carries a guide, and in that body's frame [m]."""
        carrier = carrier_at(shared, b)
        arm = difference(point(shared.rows, j), center_of(carrier))
        if wp.static(paired):
            q = arm
            if b < wp.static(bodies):  # the ground has not turned
                q = in_frame(arm, carrier)
            return arm, q
        else:
            return arm, in_frame(arm, carrier)

    return namespace(share_geometry, teeth_of, bar_of, sprocket_at, carrier_at, center_velocity, arm_on, in_carrier)
