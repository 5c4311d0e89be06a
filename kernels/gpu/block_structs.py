"""Structs of block kernels: shared memory, the state of the time loop, and a thread's parts."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from ..number import Pair, pair_from_float64
from ..structs import Drive, Tallies, types

BITS = 31
"""Bits in use of a whole number: the largest number of partners."""
MOST_CHAINS = BITS // 2
"""Largest number of chains of a variant on a block; each has two partners."""


@cache
def block_structs(Real: type) -> SimpleNamespace:
    """Structs of block kernels whose quantities are `Real`: those of `structs`, and those defined here."""
    kinds = types(Real, blocks=True)

    @wp.struct
    class ChainPlace:
        """Where the parts of one of several chains begin among those of a block's variant."""

        first_roller: wp.int32
        end_roller: wp.int32
        first_sprocket: wp.int32
        first_guide: wp.int32
        first_arm: wp.int32
        first_shaft: wp.int32
        partners: wp.int32  # its sprockets and guides, as bits
        first_push: wp.int32  # of a silent one: its values in `State.push`, and
        backs: wp.int32  # guides' rows of its backs (`physics.back`)
        first_contact: wp.int32  # its contact memories
        sprockets: wp.int32

    @wp.struct
    class Stroke:
        """Stroke of a tensioner's plunger in a step, and the request to its oil (`oil_warp`)."""

        x: kinds.Number  # after the step [m]
        rate: Real  # over the step [m/s]
        asked: wp.int32

    @wp.struct
    class CarriedArm:
        """Values that a block's arm shares with arms that carry it or that it carries (`bodies.carried_arms`)."""

        force: kinds.vec2  # of contacts on it, then of its turning, passed on to the one that carries it [N]
        acceleration: Real  # of its angle [rad/s^2]
        moment: Real  # of springs, dampers and stops of arms on it [N m]
        angle: Real  # at the step's instant, as its own spring sees it [rad]
        speed: Real  # likewise [rad/s]
        energy: Real  # `hub.carried_arm_energy` [J]

    @wp.struct
    class Shared:
        """Shared memory of a block; S sprockets, B bodies (the arms after the sprockets), G guides."""

        rows: wp.array[Real]  # of rollers, one after the other (`shared_rows`)
        link_sums: wp.array[Real]  # extremes of tension, then rows of squared rates, of joint friction (`link_tallies`)
        strand_words: wp.array[wp.uint32]  # of threads' links: the strand that each is on (`strands`)
        poses: wp.array[kinds.Pose]  # (B,), and with profiles the ground
        motions: wp.array[kinds.Motion]  # (B,)
        train_moments: wp.array[Real]  # (B,) of tied drives: moment on each with what couplings pass on to it [N m]
        cams: wp.array[kinds.Cam]  # (B,) with valves
        lifts: wp.array[wp.types.vector(3, Real)]  # (cams,) of valves: lift, slope, bend (`valve.cam_lift`)
        mounts: wp.array[kinds.Mount]  # (B,), where centers move
        hubs: wp.array[kinds.Hub]  # (S,) where arms carry sprockets, or bearings rub, as the next two
        bearing_moments: wp.array[Real]  # (S,): moment of the bearing on its sprocket [N m]
        strokes: wp.array[Stroke]  # (tensioners,), where a warp of its own has their oil
        speeds_now: wp.array[Real]  # (B,): angular velocity at the step's instant [rad/s]
        carried_arms: wp.array[CarriedArm]  # (arms,), where arms carry arms
        arm_rates: wp.array[wp.types.vector(3, Real)]  # (B,) likewise: accelerations of each arm without coupling
        prescribed_angles: wp.array[
            kinds.Number
        ]  # (prescribed, steps): where prescribed motion leads (`PLANNED_STEPS`)
        prescribed_speeds: wp.array[Real]
        teeth: wp.array[kinds.Sprocket]  # (S,)
        bands: wp.array[kinds.Band]  # (S,)
        guides: wp.array[kinds.Guide]  # (G,)
        friction: wp.array[kinds.Friction]  # (S + G,), of kernels with friction there
        chains: wp.array[kinds.Chain]  # (chains,)
        plates: wp.array[kinds.Plate]  # (chains,) where some are silent; of radius 0 where one is not
        boxes: wp.array[kinds.vec2]  # (2 chains,): low and high corner beyond which a roller has left the drive [m]
        chain_places: wp.array[ChainPlace]  # (chains,), where there are several
        first_rollers: wp.types.vector(
            MOST_CHAINS - 1, int
        )  # not shared, each thread's: the first of each chain but the first
        contact_begins: wp.array[
            wp.int32
        ]  # (S + G,), of several chains: where contact memories with each begin (`chains`)
        body_indices: wp.array[wp.int32]  # (B,), of several chains: of each body among all of the ensemble
        wrench_parts: wp.array[Real]  # (3, B, `parts_per_body`): of moment [N m], force (x, y) [N] on each
        sprocket_sums: wp.array[kinds.SprocketSums]  # (S,)
        mount_sums: wp.array[kinds.MountSums]  # (S,) where centers move

    @wp.struct
    class Now:
        """State of a block's time loop, the same in all threads; fields without gaps."""

        step: wp.int32  # which is evaluated
        stage: wp.int32  # of the step, 0 with leapfrog
        next_event: wp.int32  # the next step at which more happens than forces and motion
        flags: wp.int32  # what happens now, as bits (`events.event_flags`)
        measures: wp.int32  # 1 in the window, at a step's start
        in_window: wp.int32  # 1 in the window
        weight: Real  # time that this step stands for in the window's sums [s]
        diverged: wp.int32
        goes_on: wp.int32  # 0 at the run's last step and where it diverged
        moved_sprockets: wp.int32  # sprockets that their moment moves, as bits
        wanted_moments: wp.int32  # sprockets whose moment is wanted now, as bits
        frames_begun: wp.int32  # the step at which the frames' buffer was begun

    @wp.struct
    class Out:
        """Arrays that a block's sums and frames go into."""

        sums: kinds.Sums
        tallies: Tallies
        frames: wp.array[Real]

    made = {
        "ChainPlace": ChainPlace,
        "Stroke": Stroke,
        "CarriedArm": CarriedArm,
        "Shared": Shared,
        "Now": Now,
        "Out": Out,
    }
    return SimpleNamespace(**vars(kinds) | made)


@wp.struct
class ThreadParts:
    """Variant of a block's thread, and the parts of it that are the thread's own."""

    variant: wp.int32  # of several chains, the row of the first
    rollers: wp.int32  # of the variant
    first_roller: wp.int32  # of the variant among all
    first_contact: wp.int32  # of its contact memories
    first_push: wp.int32  # of its values in `State.push`
    thread: wp.int32  # of the block
    body: wp.int32  # that the thread moves; negative for most
    sprocket: wp.int32  # that it moves; negative where its body is none
    arm: wp.int32  # number of its body among the arms; negative where that is none
    drive_row: wp.int32  # of the chain that the body is of
    body_number: wp.int32  # among the bodies of that chain
    prescribed_index: wp.int32  # of its prescribed motion among those of the drive (`prescribed_motion.plan_index`)
    step: wp.float64  # time step [s]
    step_pair: Pair  # time step for kernels at float32 [s]


@wp.func
def thread_parts(drive: Drive, variant: int, thread: int, body: int):
    """Parts of a thread of a variant's block; `body` is the one that it moves, negative for none."""
    mine = ThreadParts()
    mine.variant = variant
    mine.rollers = drive.rollers
    mine.first_roller = drive.first_roller
    mine.first_contact = drive.first_contact
    mine.first_push = drive.first_push
    mine.thread = thread
    mine.body = body
    mine.sprocket = wp.where(body < drive.sprockets, body, -1)
    mine.arm = wp.max(body - (drive.bodies - drive.arms), -1)
    mine.drive_row = variant
    mine.body_number = body
    mine.step = drive.step
    mine.step_pair = pair_from_float64(drive.step)
    return mine
