"""Kinds of block kernels: the shape of blocks, what drives have, and what is taken."""

from dataclasses import dataclass
from functools import partial
from types import SimpleNamespace

import warp as wp

from .block_structs import block_structs

DECLARED = 47_000
"""Most bytes of shared memory that a kernel declares; CUDA allows 48 KiB."""


WARP = 32
"""Threads of a warp on a GPU."""


inlined = partial(wp.func, inline=True)
"""Makes a Warp function that is always drawn in, where it takes structs of a kernel and is too long or called too often
for the compiler to do so by itself: a call hands structs on in memory, where the whole kernel then keeps them. The
compiler takes such a function before it has simplified it, so functions that it draws in anyway are without this."""


@dataclass(frozen=True, order=True)
class BlockShape:
    """The shape of a block: threads of a variant, rollers of a thread.

    Attributes:
        threads: of a variant, whole warps.
        rollers_per_thread: of a thread, which has i, i + threads, ... of the chain.
        variants_per_block: a warp each, which wait for each other now and then (`warp_steps`), or for their oil.
        shared_bytes: most of shared memory that a block may have; what does not fit lies in global memory.
    """

    threads: int
    rollers_per_thread: int
    variants_per_block: int = 1
    shared_bytes: int = DECLARED

    @property
    def is_one_warp(self) -> bool:
        """Whether a variant has one warp, whose threads wait for no other."""
        return self.threads == WARP

    @property
    def body_warp(self) -> bool:
        """Whether the last warp has no rollers, but moves the bodies: where each thread of others has one."""
        return self.threads > WARP and self.rollers_per_thread == 1

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
    """Parts of each drive of a kind, those of all its chains, and properties, which are 1 where drives have them."""

    sprockets: int
    guides: int
    arms: int = 0
    tensioners: int = 0
    prescribed: int = 1  # angles, at least 1
    other_bodies: int = 0  # that are neither sprockets nor arms
    tabulated: int = 1  # 1: motions or loads have tables
    tied: int = 0  # 1: some bodies are tied (`structs.Drive.tied`)
    geared: int = 0  # 1: bodies are tied by gears or couplings
    hubs: int = 0  # 1: arms carry sprockets, or bearings rub; 2: arms carry arms
    crowded_arms: int = 0  # 1: an arm carries a guide beside a sprocket or another guide
    hydraulic: int = 0  # 1: tensioners have oil
    valves: int = 0  # cams of valves that there is room for
    chains: int = 1

    @property
    def rotors(self) -> int:
        """Bodies whose angle may be prescribed: all but arms, which stand after them."""
        return self.sprockets + self.other_bodies

    @property
    def is_tied(self) -> bool:
        """Whether bodies are tied, or turn with those of other chains."""
        return bool(self.tied) or self.chains > 1

    @property
    def jointed(self) -> bool:
        """Whether arms carry arms."""
        return self.hubs == 2

    @property
    def bodies(self) -> int:
        """Number of all bodies."""
        return self.rotors + self.arms


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
        links: "alike"; "lengths", which differ; "varied", which differ in stiffness or mass or have play, too.
        linear_hysteretic: all contacts' laws are hysteretic and linear (`impact.linear_force`).
        silent: some chain is a silent one.
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
    silent: bool = False

    @property
    def has_oil_warp(self) -> bool:
        """Whether another warp has the oil of a block's variants (`oil_warp`): of several with tensioners."""
        return self.shape.variants_per_block > 1 and self.parts.tensioners > 0

    @property
    def block_threads(self) -> int:
        """Threads of a block."""
        return self.shape.threads * self.shape.variants_per_block + WARP * self.has_oil_warp

    def launch_threads(self, variants: int) -> int:
        """Threads of a launch of a number of variants."""
        if self.has_oil_warp:
            return -(-variants // self.shape.variants_per_block) * self.block_threads
        return variants * self.shape.threads

    @property
    def is_paired(self) -> bool:
        """Whether bodies, and guides as contacts see them, are in pairs of float32."""
        return bool(self.Real == wp.float32)

    @property
    def has_stages(self) -> bool:
        """Whether a step has stages: of any integrator but leapfrog."""
        return self.integrator != 0

    @property
    def types(self) -> SimpleNamespace:
        """The structs of the kernel, `Shared` among them."""
        return block_structs(self.Real)

    @property
    def has_common_path(self) -> bool:
        """Whether steps of one warp without a frame have code of their own, without what only frames want."""
        more = self.moving or self.parts.hubs or self.parts.is_tied
        long = self.profiles or (self.measuring and self.Real == wp.float32 and more)
        return not (self.has_stages or long or self.silent)

    @property
    def finds_partners_early(self) -> bool:
        """Whether rollers look for partners, which are fixed, while bodies move: on several warps."""
        return self.shape.threads > WARP and not (self.moving or self.profiles or self.silent)

    @property
    def hands_over(self) -> bool:
        """Whether the last warp alone moves the bodies, and goes on once the contacts' moments are there."""
        waiting = self.parts.is_tied or self.parts.hubs or self.parts.hydraulic or self.silent
        return self.shape.body_warp and self.parts.bodies <= 4 and self.shape.room <= 192 and not waiting
