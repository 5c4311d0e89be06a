"""States of one variant's bodies on a block: shared from the ensemble's state, and put back."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..number import leading_value, trimmed_value
from ..physics.body import aligned_pose, has_finite_rotation, is_in_box, pose_with_coordinates
from ..physics.hub import carried_body
from ..physics.tooth import grid_magic
from ..structs import GROUND, Drive
from ..sums import gathered_sprocket_sums
from .block_kinds import BlockKind, inlined
from .block_structs import ThreadParts
from .chains import chain_functions
from .geometry import geometry_functions
from .prescribed_motion import prescribed_motion_functions


@dataclass(frozen=True)
class BodyStateFunctions:
    """Body state functions of a block."""

    body_from_pose: wp.Function
    pose_from_state: wp.Function
    share_hub: wp.Function
    place_carried_sprocket: wp.Function
    share_body: wp.Function
    put_back_body: wp.Function
    has_body_left: wp.Function
    align_pose: wp.Function


@cache
def body_state_functions(kind: BlockKind) -> BodyStateFunctions:
    """Body state functions of block kernels."""
    Real, sprockets, rotors = kind.Real, kind.parts.sprockets, kind.parts.rotors
    kinds = kind.types
    Ensemble, State, Shared, Pose = kinds.Ensemble, kinds.State, kinds.Shared, kinds.Pose
    Sums = kinds.Sums
    chains = chain_functions(kind)
    geometry = geometry_functions(kind)
    prescribed_motion = prescribed_motion_functions(kind)

    @wp.func
    def body_from_pose(pose: Pose):
        """State of a block's body: the coordinates and rates of its pose."""
        body = kinds.BodyState()
        body.angle = pose.angle
        body.speed = pose.speed
        body.center = pose.center
        body.velocity = pose.velocity
        body.straight = pose.straight
        body.angular = pose.angular
        return body

    @wp.func
    def has_heading(pose: Pose):
        """Whether a block's pose in the state has its heading."""
        cosine, sine = leading_value(pose.cosine), leading_value(pose.sine)
        return cosine != Real(0.0) or sine != Real(0.0)

    @wp.func
    def pose_from_state(ensemble: Ensemble, state: State, drive: Drive, b: int):
        """Pose of body b of a chain from the state: of the launch before, if any."""
        pose = state.poses[drive.first_body + b]
        if has_heading(pose):
            return pose
        if wp.static(kind.is_paired):
            if b < drive.sprockets:
                pose.radius = ensemble.sprockets[drive.first_sprocket + b].exact_radius
                pose.inverse_radius = 1.0 / pose.radius.high
                pose.grid = grid_magic(pose.radius.high)
        return aligned_pose(pose_with_coordinates(pose, state.bodies[drive.first_body + b]))

    @wp.func
    def share_hub(ensemble: Ensemble, shared: Shared, variant: int, row: int, b: int):
        """Shares the hub of body b of a chain, if that is a sprocket."""
        if wp.static(kind.parts.hubs):
            if b < sprockets:
                hub = ensemble.hubs[ensemble.drives[variant].first_sprocket + b]
                hub.arm = chains.body_on_block(ensemble, shared, row, row - variant, hub.arm)
                shared.hubs[b] = hub

    @wp.func
    def place_carried_sprocket(shared: Shared, b: int):
        """Moves a block's body b with its carrier, if any; after a barrier."""
        if wp.static(kind.parts.hubs):
            if b >= 0 and b < sprockets:
                hub = shared.hubs[b]
                if hub.arm != GROUND:
                    geometry.put_pose(shared, b, carried_body(shared.poses[b], shared.poses[hub.arm], hub))

    @inlined
    def share_body(ensemble: Ensemble, state: State, sums: Sums, shared: Shared, mine: ThreadParts, step: int):
        """Shares the thread's body at `step` and its sums; with the first, the chain and guides."""
        drive = ensemble.drives[mine.variant]
        own = ensemble.drives[mine.drive_row]
        b = mine.body
        if b == 0:
            geometry.share_chains_and_guides(ensemble, shared, drive, mine.variant)
        pose = pose_from_state(ensemble, state, own, mine.body_number)
        shared.motions[b] = ensemble.motions[own.first_body + mine.body_number]
        if b < rotors:
            angle, speed = prescribed_motion.angle_and_speed(ensemble, shared, mine, b, step)
            pose.exact_speed = speed
        if wp.static(kind.moving):
            shared.mounts[b] = ensemble.mounts[own.first_body + mine.body_number]
        share_hub(ensemble, shared, mine.variant, mine.drive_row, b)
        if b < sprockets:
            at = drive.first_sprocket + b
            geometry.share_sprocket(ensemble, shared, drive, b, leading_value(pose.center))
            if wp.static(kind.measuring):
                shared.sprocket_sums[b] = sums.sprocket[at]
                if wp.static(kind.moving):
                    shared.mount_sums[b] = sums.mount[at]
        geometry.put_pose(shared, b, pose)

    @wp.func
    def put_back_body(ensemble: Ensemble, state: State, sums: Sums, shared: Shared, mine: ThreadParts):
        """Puts the thread's body and its sums back into the state."""
        drive = ensemble.drives[mine.variant]
        b = mine.body
        at_body = ensemble.drives[mine.drive_row].first_body + mine.body_number
        state.poses[at_body] = shared.poses[b]
        body = body_from_pose(shared.poses[b])
        body.angle = trimmed_value(body.angle)
        body.speed = trimmed_value(body.speed)
        body.center = trimmed_value(body.center)
        body.velocity = trimmed_value(body.velocity)
        state.bodies[at_body] = body
        if wp.static(kind.measuring):
            if b < sprockets:
                at = drive.first_sprocket + b
                sums.sprocket[at] = gathered_sprocket_sums(shared.sprocket_sums[b])
                if wp.static(kind.moving):
                    sums.mount[at] = shared.mount_sums[b]

    @wp.func
    def has_body_left(shared: Shared, mine: ThreadParts):
        """1 where the thread's body has no finite rotation or has left the drive's box, else 0."""
        pose, box = shared.poses[mine.body], 2 * (mine.drive_row - mine.variant)
        gone = int(not has_finite_rotation(pose.angle, pose.speed))
        if wp.static(kind.moving):
            gone = wp.max(
                gone, int(not is_in_box(shared.boxes[box], shared.boxes[box + 1], leading_value(pose.center)))
            )
        return gone

    @wp.func
    def align_pose(shared: Shared, b: int):
        """Sets the heading of body b's shared pose from its angle."""
        geometry.put_pose(shared, b, aligned_pose(shared.poses[b]))

    return BodyStateFunctions(
        body_from_pose=body_from_pose,
        pose_from_state=pose_from_state,
        share_hub=share_hub,
        place_carried_sprocket=place_carried_sprocket,
        share_body=share_body,
        put_back_body=put_back_body,
        has_body_left=has_body_left,
        align_pose=align_pose,
    )
