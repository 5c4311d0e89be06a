"""What a block kernel is made for, and where its threads are."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..number import Pair, pair_of
from ..structs import Drive

DECLARED = 47_000
"""Most bytes of shared memory that a kernel declares; CUDA allows 48 KiB."""

WARP = 32
"""Threads of a warp on a GPU."""


@dataclass(frozen=True)
class BlockKind:
    """A kind of block kernels; one is compiled for each.

    Attributes:
        Real: wp.float64 or wp.float32.
        threads: of a variant, whole warps; a block's unless variants are abreast.
        per: rollers of a thread, which has i, i + threads, ... of the chain.
        sprockets, guides: of each drive.
        moving: sprockets' centers may move, or have balance wheels.
        measuring: metrics are taken.
        rk4: the classical Runge-Kutta scheme instead of leapfrog.
        contact_friction: rollers rub on teeth or guide-bars.
        joint_friction: the joints rub.
        linear_hysteretic: all contacts' laws are hysteretic and linear (`impact.is_linear_hysteretic`).
        uniform_links: a chain's links are of one length.
        led: of each drive's sprockets, those whose angle is prescribed.
        abreast: variants of a block, a warp each, which wait for each other now and then (`block`).
        stribeck: a coefficient of friction may depend on the speed.
        varied_links: links differ, or have play.
        arms, tensioners: of each drive.
        profiles: guides have profiles, or are carried by arms.
        tabulated: motions or loads may be tabulated.
        crewed: the last warp has no rollers, but moves the bodies.
        roomy: few blocks are on a multiprocessor, so that a thread has registers for two contacts at once.
        shared_bytes: most of shared memory that a block may have; what does not fit lies in global memory.
    """

    Real: type
    threads: int
    rollers_per_thread: int
    sprockets: int
    guides: int
    moving: bool = False
    measuring: bool = False
    rk4: bool = False
    contact_friction: bool = False
    joint_friction: bool = False
    varied_links: bool = False
    arms: int = 0
    tensioners: int = 0
    profiles: bool = False
    body_warp: bool = False
    low_occupancy: bool = False
    shared_bytes: int = DECLARED
    tabulated: bool = True
    stribeck: bool = True
    linear_hysteretic: bool = False
    uniform_links: bool = False
    led: int = -1
    variants_per_block: int = 1

    @property
    def paired(self) -> bool:
        """Whether bodies, and guides as contacts see them, are in pairs of float32."""
        return bool(self.Real == wp.float32)

    @property
    def wheels(self) -> int:
        """Bodies that contacts see in pairs of float32: all, and with profiles the ground."""
        return self.bodies + self.profiles

    @property
    def bodies(self) -> int:
        """Sprockets and arms of each drive."""
        return self.sprockets + self.arms

    @property
    def prescribed(self) -> int:
        """Sprockets of each drive that there is room for to have their angle prescribed: all, unless it is known."""
        return max(self.led, 1) if self.led >= 0 else self.sprockets

    @property
    def pushes(self) -> bool:
        """Whether the force on sprockets is wanted beside the moment: by what moves, or by the metrics."""
        return self.moving or self.measuring

    @property
    def early(self) -> bool:
        """Whether rollers look for what they may touch while bodies move: on several warps, and fixed partners."""
        return self.threads > WARP and not (self.moving or self.profiles)

    @property
    def quick(self) -> bool:
        """Whether usual contacts are worked out without branches, in kernels of one length of chain all or none.

        So metrics leave a variant its bits. Of more than 192 links not all kernels gave the same bits with it
        (docs/performance.md).
        """
        return self.room <= 192

    @property
    def gripping(self) -> bool:
        """Whether rollers look up as early, too, what they keep of a sprocket."""
        return self.early and self.handing

    @property
    def handing(self) -> bool:
        """Whether the last warp alone moves the bodies, and goes on as soon as the contacts' moments stand there."""
        return self.body_warp and self.bodies <= 4 and self.room <= 192

    @property
    def carrying(self) -> bool:
        """Whether links' sums of squared rates stay in registers from one event to the next, where there are enough.

        Shared memory is asked for so much in each step that kernels with few rollers a thread wait for it.
        """
        return self.measuring and self.threads == WARP and self.rollers_per_thread <= 4

    @property
    def block_threads(self) -> int:
        """Threads of a block."""
        return self.threads * self.variants_per_block

    @property
    def slots(self) -> int:
        """Rollers that all threads of a variant would have."""
        return self.threads * self.rollers_per_thread

    @property
    def room(self) -> int:
        """Most rollers of a drive."""
        return self.slots - WARP * self.body_warp


@wp.struct
class Mine:
    """Which variant a thread is at, and what of it is its own."""

    variant: wp.int32
    rollers: wp.int32  # of the variant
    first: wp.int32  # of its rollers among all
    memory: wp.int32  # first of its contact memories
    thread: wp.int32  # of the block
    sprocket: wp.int32  # that the thread moves, negative for most
    course: wp.int32  # place of its prescribed motion among those of the drive (`bodies.plan_at`)
    arm: wp.int32  # the same
    h: wp.float64  # time step [s]
    step: Pair  # the same, for kernels at float32


@wp.func
def mine_of(drive: Drive, variant: int, thread: int, body: int):
    """What a thread of a variant's block is at; `body` is what it moves, negative for most."""
    mine = Mine()
    mine.variant = variant
    mine.rollers = drive.rollers
    mine.first = drive.first_roller
    mine.memory = drive.first_contact
    mine.thread = thread
    mine.sprocket = wp.where(body < drive.sprockets, body, -1)
    mine.arm = wp.where(body < drive.sprockets, -1, body - drive.sprockets)
    mine.h = drive.step
    mine.step = pair_of(drive.step)
    return mine


@cache
def now_struct(Real: type) -> type:
    """The struct that says where the time loop is; its weight is `Real`."""

    @wp.struct
    class Now:
        """Where the time loop is; all threads of a block agree.

        Without gaps between the fields, around which the compiler would take whole numbers apart into bytes.
        """

        step: wp.int32
        stage: wp.int32  # of the step, 0 to 3 with rk4
        event: wp.int32  # the next step at which more happens than forces and motion
        flags: wp.int32  # what happens now, as bits (`block_events`)
        measured: wp.int32  # 1 in the window, at a step's start
        window: wp.int32  # 1 in the window
        weight: Real  # time that this step stands for in the window's sums [s]
        watch_weight: Real  # time that a watched step stands for [s]
        watched: wp.int32  # 1 where forces are watched (`sums.WATCH_EVERY`)
        diverged: wp.int32
        going: wp.int32  # 0 at the run's last step and where it diverged
        common: wp.int32  # 1 in a step of one warp that wants no more than most (`block.is_common`)
        linear_hysteretic: wp.int32  # sprockets whose contacts' law is linear and hysteretic, as bits
        driven: wp.int32  # sprockets that their moment moves, as bits
        summed: wp.int32  # sprockets whose moment is wanted now, as bits
        since: wp.int32  # the frames' buffer was begun so many steps before this launch

    return Now
