"""Kinds of block kernels: the shape of blocks, parts and properties of drives, what is measured."""

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
"""Decorator of a block kernel's Warp function that is always inlined; a call would keep its structs in memory."""


@dataclass(frozen=True, order=True)
class BlockShape:
    """Shape of a block: threads of a variant, rollers of a thread.

    Attributes:
        threads: of a variant, whole warps.
        rollers_per_thread: i, i + threads, ... of the chain.
        variants_per_block: a warp each (`warp_steps`).
        shared_bytes: shared memory of a block at most; the rest lies in global memory.
    """

    threads: int
    rollers_per_thread: int
    variants_per_block: int = 1
    shared_bytes: int = DECLARED

    @property
    def is_one_warp(self) -> bool:
        """Whether one warp has all threads of a block's variant."""
        return self.threads == WARP

    @property
    def body_warp(self) -> bool:
        """Whether the last warp of a block has no rollers, but moves the bodies."""
        return self.threads > WARP and self.rollers_per_thread == 1

    @property
    def slots(self) -> int:
        """Rollers that all threads of a block's variant could have."""
        return self.threads * self.rollers_per_thread

    @property
    def room(self) -> int:
        """Largest number of rollers of a drive on a block of this shape."""
        return self.slots - WARP * self.body_warp


@dataclass(frozen=True)
class Parts:
    """Parts of each drive of a kind of block kernels, over all its chains, and properties: 1 where drives have them."""

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
        """Number of bodies in block kernels whose angle may be prescribed: all but arms, which come last."""
        return self.sprockets + self.other_bodies

    @property
    def is_tied(self) -> bool:
        """Whether bodies in block kernels are tied to each other or to those of other chains."""
        return bool(self.tied) or self.chains > 1

    @property
    def jointed(self) -> bool:
        """Whether arms carry arms in block kernels."""
        return self.hubs == 2

    @property
    def bodies(self) -> int:
        """Number of all bodies of a drive in block kernels."""
        return self.rotors + self.arms


EVEN, BY_SPEED = 1, 2
"""Coefficient of friction in block kernels: the same at all speeds, or not."""


@dataclass(frozen=True)
class Friction:
    """Friction in block kernels at contacts and joints: 0 (none), `EVEN` or `BY_SPEED`."""

    contacts: int = 0
    joints: int = 0


@dataclass(frozen=True)
class BlockKind:
    """A kind of block kernels; one is compiled for each.

    Attributes:
        Real: wp.float64 or wp.float32.
        measuring: metrics are computed.
        integrator: as in `integrate.INTEGRATORS`.
        moving: bodies' centers may move, or have balance wheels.
        profiles: guides have profiles, or are carried by bodies.
        links: "alike"; of different "lengths"; "varied" in stiffness or mass, or with play.
        linear_hysteretic: of all contacts' laws (`impact.linear_force`).
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
        """Whether a block has another warp for its variants' oil (`oil_warp`): of several variants with tensioners."""
        return self.shape.variants_per_block > 1 and self.parts.tensioners > 0

    @property
    def block_threads(self) -> int:
        """Number of threads of a block, those of the oil's warp counted in."""
        return self.shape.threads * self.shape.variants_per_block + WARP * self.has_oil_warp

    def launch_threads(self, variants: int) -> int:
        """Number of threads of a launch of block kernels for a number of variants."""
        if self.has_oil_warp:
            return -(-variants // self.shape.variants_per_block) * self.block_threads
        return variants * self.shape.threads

    @property
    def is_paired(self) -> bool:
        """Whether a block kernel has bodies, and guides in contacts, as pairs of float32."""
        return bool(self.Real == wp.float32)

    @property
    def has_stages(self) -> bool:
        """Whether a block kernel's steps have stages: of any integrator but leapfrog."""
        return self.integrator != 0

    @property
    def types(self) -> SimpleNamespace:
        """Structs of the block kernel, `Shared` among them."""
        return block_structs(self.Real)

    @property
    def has_common_path(self) -> bool:
        """Whether one-warp steps without a frame have code of their own in the block kernel."""
        more = self.moving or self.parts.hubs or self.parts.is_tied
        long = self.profiles or (self.measuring and self.Real == wp.float32 and more)
        return not (self.has_stages or long or self.silent)

    @property
    def finds_partners_early(self) -> bool:
        """Whether a block's rollers look for fixed partners while bodies move: on several warps."""
        return self.shape.threads > WARP and not (self.moving or self.profiles or self.silent)

    @property
    def hands_over(self) -> bool:
        """Whether the last warp of a block alone moves the bodies, once contacts' moments are handed over."""
        waiting = self.parts.is_tied or self.parts.hubs or self.parts.hydraulic or self.silent
        return self.shape.body_warp and self.parts.bodies <= 4 and self.shape.room <= 192 and not waiting
