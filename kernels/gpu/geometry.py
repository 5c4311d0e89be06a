"""Shared geometry of a block for contacts: bodies, teeth, guides and laws; rollers relative to bodies."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import warp as wp

from ..number import difference, leading_value, number_of
from ..physics.guide import carried_guide, frame_vector
from ..structs import GROUND, Drive
from .block_kinds import BlockKind
from .chains import chain_functions
from .rollers import roller_functions


@dataclass(frozen=True)
class GeometryFunctions:
    """Shared geometry functions of a block."""

    put_pose: wp.Function
    share_chains_and_guides: wp.Function
    share_sprocket: wp.Function
    guide_now: wp.Function
    arm_from_body: wp.Function
    arm_and_carrier_coordinates: wp.Function


@cache
def geometry_functions(kind: BlockKind) -> GeometryFunctions:
    """Shared geometry functions of block kernels."""
    Real, sprockets, body_count = kind.Real, kind.parts.sprockets, kind.parts.bodies
    kinds = kind.types
    Ensemble, Shared, Pose = kinds.Ensemble, kinds.Shared, kinds.Pose
    chains = chain_functions(kind)
    rollers = roller_functions(kind)
    vec2 = kinds.vec2

    @wp.func
    def put_pose(shared: Shared, b: int, pose: Pose):
        """Sets the shared pose of body b, and the center of its band."""
        shared.poses[b] = pose
        if wp.static(kind.moving):
            if b < sprockets:
                center = leading_value(pose.center)
                shared.bands[b].center = vec2(Real(center[0]), Real(center[1]))

    @wp.func
    def share_chain(ensemble: Ensemble, shared: Shared, drive: Drive, variant: int, r: int):
        """Shares chain r, `drive`, and its box."""
        shared.boxes[2 * r] = vec2(Real(drive.low[0]), Real(drive.low[1]))
        shared.boxes[2 * r + 1] = vec2(Real(drive.high[0]), Real(drive.high[1]))
        shared.chains[r] = ensemble.chains[variant + r]
        if wp.static(kind.silent):
            shared.plates[r] = ensemble.plates[variant + r]

    @wp.func
    def share_chains_and_guides(ensemble: Ensemble, shared: Shared, drive: Drive, variant: int):
        """Copies a variant's chains and guides to shared memory; `drive` is the first chain's row."""
        for r in range(wp.static(kind.parts.chains)):
            share_chain(ensemble, shared, ensemble.drives[variant + r], variant, r)
        if wp.static(kind.profiles):
            ground = Pose()
            ground.cosine = number_of(Real(1.0))
            put_pose(shared, body_count, ground)
        for g in range(wp.static(kind.parts.guides)):
            bar = ensemble.guides[drive.first_guide + g]
            if wp.static(kind.profiles):
                chain = chains.chain_number_of_guide(shared, g)
                body = chains.body_on_block(ensemble, shared, variant + chain, chain, bar.body)
                bar.body = wp.where(body == GROUND, body_count, body)
                bar.first_piece = ensemble.drives[variant + chain].first_piece + bar.first_piece
            shared.guides[g] = bar
            if wp.static(kind.friction.contacts):
                shared.friction[sprockets + g] = ensemble.guide_friction[drive.first_guide + g]

    @wp.func
    def share_sprocket(ensemble: Ensemble, shared: Shared, drive: Drive, s: int, center: Any):
        """Shares teeth and band of sprocket s, at `center`."""
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
    def guide_now(shared: Shared, g: int):
        """A block's guide g at its present place; one with a profile in its carrier's frame."""
        bar = shared.guides[g]
        if wp.static(kind.profiles):
            if bar.pieces == 0 and bar.body < body_count:
                bar = carried_guide(bar, shared.poses[bar.body])
        return bar

    @wp.func
    def arm_from_body(shared: Shared, j: int, b: int):
        """Vector [m] to a block's roller j from the center of body b, which carries a guide."""
        return leading_value(difference(rollers.exact_position(shared.rows, j), shared.poses[b].center))

    @wp.func
    def arm_and_carrier_coordinates(shared: Shared, p: Any, b: int):
        """Vector [m] to a place p from the center of a guide's carrier b, and that in the carrier's frame."""
        carrier = shared.poses[b]
        arm = difference(p, carrier.center)
        q = arm
        if b < body_count:  # the ground has not turned
            q = frame_vector(arm, carrier)
        return arm, q

    return GeometryFunctions(
        put_pose=put_pose,
        share_chains_and_guides=share_chains_and_guides,
        share_sprocket=share_sprocket,
        guide_now=guide_now,
        arm_from_body=arm_from_body,
        arm_and_carrier_coordinates=arm_and_carrier_coordinates,
    )
