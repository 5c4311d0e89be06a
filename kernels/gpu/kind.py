"""Kinds of block kernels, and the place of a thread among rollers and bodies."""

from dataclasses import dataclass
from functools import cache, partial
from types import SimpleNamespace

import warp as wp

from ..number import Pair, pair_of
from ..structs import Drive, Tallies, types

DECLARED = 47_000
"""Most bytes of shared memory that a kernel declares; CUDA allows 48 KiB."""

WARP = 32
"""Threads of a warp on a GPU."""

inlined = partial(wp.func, inline=True)
"""As `wp.func`, for a function that takes a kernel's structs and is too long, or called too often, for the compiler to
draw it in by itself: a call hands structs on in memory, where the whole kernel then keeps them. The compiler takes such
a function before it has simplified it, so functions that it draws in anyway are to be without this."""

BITS = 31
"""Bits of a whole number that are used: as many as there may be partners."""
MOST_CHAINS = BITS // 2
"""Chains of a variant at most, as each has two partners."""

EVENT = wp.constant(1)
"""What can happen at a step, as bits."""
LAST = wp.constant(2)
FRAME = wp.constant(4)
START = wp.constant(8)  # of the window
END = wp.constant(16)
ENDS = wp.constant(24)
EXTRA = wp.constant(28)  # what wants more of each roller than its motion: frames and the window's ends
CHECK = wp.constant(32)  # whether the variant diverged


@cache
def block_types(Real: type) -> SimpleNamespace:
    """The structs of block kernels whose quantities are `Real`: those of `structs`, `Ring`, `Shared`, `Now`, `Out`."""
    kinds = types(Real, blocks=True)

    @wp.struct
    class Ring:
        """One of several chains: where its parts begin among those of the variant."""

        first: wp.int32  # roller
        end: wp.int32  # of its rollers
        sprocket: wp.int32
        guide: wp.int32
        arm: wp.int32
        shaft: wp.int32
        partners: wp.int32  # its sprockets and guides, as bits

    @wp.struct
    class Stroke:
        """Where a tensioner's plunger has gone in a step, and what is asked of its oil (`tensioners`)."""

        x: kinds.Number  # after the step [m]
        rate: Real  # over the step [m/s]
        asked: wp.int32

    @wp.struct
    class Shared:
        """Shared memory of a block; S sprockets, B bodies (the arms after the sprockets), G guides."""

        rows: wp.array[Real]  # of rollers, one after the other (`shared_rows`)
        seen: wp.array[Real]  # extremes of tension, then rows of squared rates, of joint friction (`observe`)
        strand_of: wp.array[wp.uint32]  # of threads' links: the strand that each is on (`strands`)
        poses: wp.array[kinds.Pose]  # (B,), and with profiles the ground
        motions: wp.array[kinds.Motion]  # (B,)
        passed: wp.array[Real]  # (B,) of tied drives: moment on each with what couplings pass on to it [N m]
        cams: wp.array[kinds.Cam]  # (B,) with valves
        lifts: wp.array[wp.types.vector(3, Real)]  # (cams,) of valves: lift, slope, bend (`valve.cam_lift`)
        mounts: wp.array[kinds.Mount]  # (B,), where centers move
        hubs: wp.array[kinds.Hub]  # (S,) where arms carry sprockets, or bearings rub, as the next two
        bearings: wp.array[Real]  # (S,): moment of the bearing on its sprocket [N m]
        strokes: wp.array[Stroke]  # (tensioners,), where a warp of its own has their oil
        turning: wp.array[Real]  # (B,): angular velocity at the step's instant [rad/s]
        joints: wp.array[Real]  # (arms, `shared_memory.OF_AN_ARM`), where arms carry arms: what acts between them
        led_angle: wp.array[kinds.Number]  # (prescribed, steps): where prescribed motion leads (`COURSE`)
        led_speed: wp.array[Real]
        teeth: wp.array[kinds.Sprocket]  # (S,)
        bands: wp.array[kinds.Band]  # (S,)
        bars: wp.array[kinds.Guide]  # (G,)
        friction: wp.array[kinds.Friction]  # (S + G,), of kernels with friction there
        chain: wp.array[kinds.Chain]  # (1,)
        box: wp.array[kinds.vec2]  # (2,): low and high corner beyond which a roller has left the drive [m]
        rings: wp.array[Ring]  # of several chains, each of which has one, or two, of the two before
        begins: wp.types.vector(MOST_CHAINS - 1, int)  # not shared, each thread's: the first roller of those
        memories: wp.array[wp.int32]  # (S + G,) of those: where contact memories with each begin (`rings`)
        places: wp.array[wp.int32]  # (B,) of those: of each body among all of the ensemble
        parts: wp.array[Real]  # (3, B, `parts_of_a_body`): of moment [N m], force (x, y) [N] on each
        sprocket_sums: wp.array[kinds.SprocketSums]  # (S,)
        mount_sums: wp.array[kinds.MountSums]  # (S,) where centers move

    @wp.struct
    class Now:
        """Where the time loop is; all threads of a block agree.

        Without gaps between the fields, around which the compiler would take whole numbers apart into bytes.
        """

        step: wp.int32
        stage: wp.int32  # of the step, 0 with leapfrog
        event: wp.int32  # the next step at which more happens than forces and motion
        flags: wp.int32  # what happens now, as bits (`events.flags_of`)
        measured: wp.int32  # 1 in the window, at a step's start
        window: wp.int32  # 1 in the window
        weight: Real  # time that this step stands for in the window's sums [s]
        diverged: wp.int32
        going: wp.int32  # 0 at the run's last step and where it diverged
        driven: wp.int32  # sprockets that their moment moves, as bits
        summed: wp.int32  # sprockets whose moment is wanted now, as bits
        begun: wp.int32  # the step at which the frames' buffer was begun

    @wp.struct
    class Out:
        """Where sums and frames go."""

        sums: kinds.Sums
        tallies: Tallies
        frames: wp.array[Real]

    return SimpleNamespace(**vars(kinds) | {"Ring": Ring, "Stroke": Stroke, "Shared": Shared, "Now": Now, "Out": Out})


@dataclass(frozen=True, order=True)
class BlockShape:
    """The shape of a block: threads of a variant, rollers of a thread.

    Attributes:
        threads: of a variant, whole warps.
        rollers_per_thread: of a thread, which has i, i + threads, ... of the chain.
        variants_per_block: a warp each, which wait for each other now and then (`block`), or for their oil.
        oil_warp: whether another warp has the oil of all of them (`tensioners`).
        shared_bytes: most of shared memory that a block may have; what does not fit lies in global memory.
    """

    threads: int
    rollers_per_thread: int
    variants_per_block: int = 1
    oil_warp: bool = False
    shared_bytes: int = DECLARED

    @property
    def body_warp(self) -> bool:
        """Whether the last warp has no rollers, but moves the bodies: where each thread of others has one."""
        return self.threads > WARP and self.rollers_per_thread == 1

    @property
    def block_threads(self) -> int:
        """Threads of a block."""
        return self.threads * self.variants_per_block + WARP * self.oil_warp

    def launched(self, variants: int) -> int:
        """Threads of a launch of so many variants."""
        if self.oil_warp:
            return -(-variants // self.variants_per_block) * self.block_threads
        return variants * self.threads

    @property
    def slots(self) -> int:
        """Rollers that all threads of a variant would have."""
        return self.threads * self.rollers_per_thread

    @property
    def room(self) -> int:
        """Most rollers of a drive."""
        return self.slots - WARP * self.body_warp


@dataclass(frozen=True)
class Parts:
    """The numbers of a drive's parts and of prescribed angles; 1, else 0, where motions or loads are tabulated,
    bodies tied by shafts, gears and couplings, arms carry sprockets or bearings rub (`structs.Drive.tied`, `hubs`),
    and where tensioners have oil, and its supply is tabulated; `hubs` is 2 where arms carry arms, `crowded` 1 where one
    carries a guide beside a sprocket or another guide. `valves` is room for so many cams of valves. Of several chains,
    `rings`, all others are of all of them, which are tied.
    """

    sprockets: int
    guides: int
    arms: int = 0
    tensioners: int = 0
    prescribed: int = 1
    others: int = 0
    tabulated: int = 1
    tied: int = 0
    hubs: int = 0
    crowded: int = 0
    oil: int = 0
    fed: int = 0
    valves: int = 0
    rings: int = 1

    @property
    def mounted(self) -> int:
        """Bodies whose angle may be prescribed: sprockets and others, which stand before the arms."""
        return self.sprockets + self.others

    @property
    def jointed(self) -> bool:
        """Whether arms carry arms."""
        return self.hubs == 2

    @property
    def bodies(self) -> int:
        """All bodies."""
        return self.mounted + self.arms


EVEN, BY_SPEED = 1, 2
"""Whether a coefficient of friction is the same at all speeds."""


@dataclass(frozen=True)
class Friction:
    """Friction of rollers on teeth and guides, and in the joints: 0 (not at all), `EVEN` or `BY_SPEED`."""

    contacts: int = 0
    joints: int = 0


@dataclass(frozen=True)
class BlockKind:
    """A kind of block kernels; one is compiled for each.

    Attributes:
        Real: wp.float64 or wp.float32.
        shape: of the blocks.
        parts: of each drive.
        measuring: metrics are taken.
        integrator: as in `integrate.INTEGRATORS`.
        moving: bodies' centers may move, or have balance wheels.
        profiles: guides have profiles, or are carried by bodies.
        friction: of contacts and joints.
        links: "alike"; "lengths", which differ; "varied", which differ in stiffness or have play, too.
        linear_hysteretic: all contacts' laws are hysteretic and linear (`impact.linear_force`).
    """

    Real: type
    shape: BlockShape
    parts: Parts
    measuring: bool = False
    integrator: int = 0
    moving: bool = False
    profiles: bool = False
    friction: Friction = Friction()
    links: str = "lengths"
    linear_hysteretic: bool = False

    @property
    def paired(self) -> bool:
        """Whether bodies, and guides as contacts see them, are in pairs of float32."""
        return bool(self.Real == wp.float32)

    @property
    def staged(self) -> bool:
        """Whether a step has stages: of any integrator but leapfrog."""
        return self.integrator != 0

    @property
    def types(self) -> SimpleNamespace:
        """The structs of the kernel, `Shared` among them."""
        return block_types(self.Real)

    @property
    def twice(self) -> bool:
        """Whether what steps without a frame do stands in the code a second time, so that nothing stands between its
        parts that only frames want: on several warps the contacts, on one all of it. Not where it is long.
        """
        more = self.moving or self.parts.hubs or self.parts.tied
        long = self.profiles or (self.measuring and self.Real == wp.float32 and more)
        return not (self.staged or long)

    @property
    def early(self) -> bool:
        """Whether rollers look for what they may touch while bodies move: on several warps, and fixed partners."""
        return self.shape.threads > WARP and not (self.moving or self.profiles)

    @property
    def handing(self) -> bool:
        """Whether the last warp alone moves the bodies, and goes on once the contacts' moments are there."""
        waiting = self.parts.tied or self.parts.hubs or self.parts.fed
        return self.shape.body_warp and self.parts.bodies <= 4 and self.shape.room <= 192 and not waiting

    @property
    def gripping(self) -> bool:
        """Whether rollers look up as early, too, what they keep of a sprocket."""
        return self.early and self.handing


@wp.struct
class Mine:
    """Which variant a thread is at, and what of it is its own."""

    variant: wp.int32  # of several chains, the row of the first
    rollers: wp.int32  # of the variant
    first: wp.int32  # of its rollers among all
    memory: wp.int32  # first of its contact memories
    thread: wp.int32  # of the block
    body: wp.int32  # that the thread moves, negative for most
    sprocket: wp.int32  # the same, if it is one, else negative
    arm: wp.int32  # its number among the arms, if it is one
    row: wp.int32  # of the chain that the body is of, among the drives
    number: wp.int32  # of the body among those of that chain
    course: wp.int32  # place of its prescribed motion among those of the drive (`bodies.plan_at`)
    h: wp.float64  # time step [s]
    step: Pair  # the same, for kernels at float32


@wp.func
def mine_of(drive: Drive, variant: int, thread: int, body: int):
    """The place of a thread of a variant's block; `body` is the one that it moves, negative for most."""
    mine = Mine()
    mine.variant = variant
    mine.rollers = drive.rollers
    mine.first = drive.first_roller
    mine.memory = drive.first_contact
    mine.thread = thread
    mine.body = body
    mine.sprocket = wp.where(body < drive.sprockets, body, -1)
    mine.arm = wp.max(body - (drive.bodies - drive.arms), -1)
    mine.row = variant
    mine.number = body
    mine.h = drive.step
    mine.step = pair_of(drive.step)
    return mine
