"""The data that kernels read and write, as Warp structs, for each precision from one source.

`types(Real)` gives the structs whose quantities are `Real` (wp.float64 or wp.float32). Everything is in SI units.
Quantities that belong to a sprocket's motion, and sums over time, are float64 at both precisions.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from .sum_structs import MountSums, SprocketSums, StrandSums, Totals

vec2d = wp.types.vector(2, wp.float64)
vec3d = wp.types.vector(3, wp.float64)
mat22d = wp.types.matrix((2, 2), wp.float64)


@wp.struct
class Harmonics:
    """Where a sprocket's (order, amplitude, phase) rows stand in the ensemble's list."""

    first: wp.int32
    count: wp.int32


@wp.struct
class Table:
    """Where a sprocket's speed or torque table stands in the ensemble's list (see `kernels.table`)."""

    cells: wp.int32  # 0: no table
    first: wp.int32
    over_angle: wp.int32  # 1: over the sprocket's own forward angle [rad], 0: over time [s]
    repeats: wp.int32  # 1: begins anew beyond its ends, 0: keeps the value there
    start: wp.float64  # [rad] or [s]
    spacing: wp.float64  # of the cells [rad] or [s]


@wp.struct
class Drive:
    """One variant: where its parts begin in the ensemble's arrays, and its settings."""

    rollers: wp.int32  # N
    sprockets: wp.int32  # S
    guides: wp.int32  # G
    first_roller: wp.int32
    first_sprocket: wp.int32
    first_guide: wp.int32
    first_contact: wp.int32  # first of the (S + G) N contact memories: sprockets, then guide-bars
    first_tally: wp.int32  # first of the (S + 1) N link tallies: each strand's, then those of links on no strand
    integrator: wp.int32  # 0 leapfrog, 1 rk4
    step: wp.float64  # h [s]
    steps: wp.int32  # whole run
    window_start: wp.int32  # metrics are taken from this step
    window_end: wp.int32  # to this one
    sample_every: wp.int32  # steps between frames; 0: not recorded
    first_value: wp.int64  # of this variant's frames in the block's buffer
    low: vec2d  # bounding box beyond which a roller has left the drive [m]
    high: vec2d


@wp.struct
class Motion:
    """A sprocket as a body: how it is driven or loaded, eq. (4)."""

    prescribed: wp.int32  # 1: angle prescribed, 0: free to turn
    sign: wp.float64  # +1 "ccw", -1 "cw"
    inverse_inertia: wp.float64  # 1 / J [1/(kg m^2)]
    speed: wp.float64  # Omega [rad/s]
    ramp_time: wp.float64  # [s]
    start_angle: wp.float64  # theta_0 [rad]
    load: vec3d  # torque [N m], viscous [N m s], quadratic [N m s^2]
    load_ramp_time: wp.float64  # [s]
    drive_harmonics: Harmonics
    load_harmonics: Harmonics
    drive_table: Table  # speed [rad/s] over time, instead of `speed` and `ramp_time`
    load_table: Table  # torque [N m], on top of `load`


@wp.struct
class Mount:
    """How a sprocket's center is held, and its balance wheel; all zero for a fixed center without a wheel."""

    active: wp.int32  # 1: the center can move or there is a wheel
    moves: wp.int32  # 0 held, 1 prescribed, 2 on springs
    home: vec2d  # stated center r_0 [m]
    direction: vec2d  # of prescribed motion, a unit vector
    offset: wp.float64  # [m]
    amplitude: wp.float64  # [m]
    frequency: wp.float64  # 2 pi f [rad/s]
    phase: wp.float64  # [rad]
    mass: wp.float64  # of sprocket and wheel [kg]
    inverse_mass: mat22d  # 1 / mass along the free directions, else 0 [1/kg]
    stiffness: mat22d  # [N/m]
    damping: mat22d  # [N s/m]
    preload: vec2d  # [N]
    gravity: vec2d  # [m/s^2]
    wheel: vec2d  # m_b r_b (cos psi_b, sin psi_b) [kg m]
    inertia: wp.float64  # of sprocket and wheel; of the wheel alone if the angle is prescribed [kg m^2]


@wp.struct
class SprocketState:
    """A sprocket in motion; leapfrog keeps speed and velocity at half steps."""

    angle: wp.float64  # theta [rad]
    speed: wp.float64  # omega [rad/s]
    center: vec2d  # [m]
    velocity: vec2d  # of the center [m/s]
    base_angle: wp.float64  # rk4: at the step's start, and the sum of weighted slopes
    base_speed: wp.float64
    sum_angle: wp.float64
    sum_speed: wp.float64


@wp.struct
class Wheel:
    """A sprocket as a block's threads see it: thread s writes it, all read it."""

    cosine: wp.float64  # of its angle
    sine: wp.float64
    speed: wp.float64  # angular velocity, half a step behind [rad/s]
    center: vec2d  # [m]
    velocity: vec2d  # of the center [m/s]
    angle: wp.float64  # [rad]
    exact_speed: wp.float64  # prescribed: angular velocity at the step's instant [rad/s]
    load: wp.float64  # free: load moment [N m]


@wp.struct
class CenterStages:
    """rk4's center and velocity of a moving sprocket at the step's start, and the sum of their weighted slopes."""

    base_center: vec2d
    base_velocity: vec2d
    sum_center: vec2d
    sum_velocity: vec2d


@wp.struct
class Strand:
    """The nominal straight line of a strand, and which part of the chain lies on it (looked up every few steps)."""

    start: vec2d  # [m]
    direction: vec2d
    length: wp.float64  # [m]
    middle: wp.int32  # last roller not past mid-strand
    first_link: wp.int32  # first link between the tangent points
    links: wp.int32  # how many


DIVERGENCE_CHECK = wp.constant(32)  # steps between two looks at whether a variant has left its box


@wp.struct
class Progress:
    """How far a variant has come."""

    step: wp.int32  # the next step to evaluate
    diverged: wp.int32  # 1: stopped, at `step`


@cache
def types(Real: type) -> SimpleNamespace:
    """The structs whose quantities are `Real`."""
    vec2 = wp.types.vector(2, Real)

    @wp.struct
    class ContactLaw:
        """A contact force law, eq. (15), (18), (19)."""

        form: wp.int32  # place of its function in `impact.FORCES`
        stiffness: Real  # K [N/m^n]
        exponent: Real  # n
        hysteresis: Real  # d [-]; with Kelvin-Voigt c [N s/m]
        speed_floor: Real  # v_min [m/s]

    @wp.struct
    class Chain:
        """The chain of one variant, eq. (1)-(3)."""

        stiffness: Real  # k [N/m]
        damping: Real  # c [N s/m]
        mass: Real  # m of a roller [kg]
        inverse_mass: Real  # 1 / m [1/kg]
        gravity: vec2  # [m/s^2]

    @wp.struct
    class Sprocket:
        """The teeth of one sprocket and their contact law, eq. (5)-(8)."""

        teeth: wp.int32  # z
        first_seat: wp.int32  # of this number of teeth in the table of seat directions
        exact_radius: wp.float64  # R [m]
        pitch_radius: Real  # R [m]
        near_square: Real  # (R - p/2)^2, and
        far_square: Real  # (R + p/2)^2: rollers between are engaged
        half_pitch_tangent: Real  # tan(pi / z)
        clearance: Real  # Rc = R_seat - Rr [m]
        cos_half_seat: Real  # of half the seating angle
        sin_half_seat: Real
        flank_curvature: Real  # 1 / (re + Rr) [1/m]; 0: straight
        tip_reach: Real  # R_tip + Rr [m]
        law: ContactLaw

    @wp.struct
    class Band:
        """Where rollers are engaged with a sprocket: a ring about its center, at the kernel's precision."""

        center: vec2  # [m]
        near_square: Real  # [m^2]
        far_square: Real

    @wp.struct
    class Guide:
        """One guide-bar and its contact law, eq. (21)-(23)."""

        start: vec2d  # a [m]
        direction: vec2d  # t
        length: Real  # |b - a| [m]
        end_radius: Real  # Rg [m]
        roller_radius: Real  # Rr [m]
        law: ContactLaw

    @wp.struct
    class Ensemble:
        """What does not change during a run, for all variants."""

        drives: wp.array(dtype=Drive)  # (variants,)
        chains: wp.array(dtype=Chain)  # (variants,)
        lengths: wp.array(dtype=Real)  # (all rollers,) unloaded length of each link [m]
        sprockets: wp.array(dtype=Sprocket)  # (all sprockets,)
        motions: wp.array(dtype=Motion)  # (all sprockets,)
        mounts: wp.array(dtype=Mount)  # (all sprockets,)
        guides: wp.array(dtype=Guide)  # (all guide-bars,)
        harmonics: wp.array(dtype=vec3d)  # (order, amplitude, phase)
        tables: wp.array(dtype=wp.float64)  # five values a cell (`kernels.table`)
        seats: wp.array(dtype=vec2d)  # directions of the seats of each number of teeth in use

    @wp.struct
    class Extra:
        """What frames and the energy balance want of one roller, at the steps that want it."""

        tension: Real  # of the link after it [N]
        rate: Real  # of that link's elongation [m/s]
        sprocket_force: Real  # sum of magnitudes [N]
        guide_force: Real  # [N]
        energy: Real  # elastic [J]

    @wp.struct
    class State:
        """What changes during a run, for all variants."""

        rollers: wp.array(dtype=Real)  # (6 * all rollers,): a variant's x, y, vx, vy rows, and x, y's low parts
        sprockets: wp.array(dtype=SprocketState)  # (all sprockets,)
        centers: wp.array(dtype=CenterStages)  # (all sprockets,), for rk4
        strands: wp.array(dtype=Strand)  # (all sprockets,)
        seat: wp.array(dtype=wp.int32)  # (contact memories,): seat of an engaged roller, else -1
        impact_speed: wp.array(dtype=Real)  # (contact memories,): v0 of a contact, 0 while open [m/s]
        totals: wp.array(dtype=Totals)  # (all sprockets and guide-bars,)
        extra: wp.array(dtype=Extra)  # (all rollers,), for block kernels; else (1,)
        stages: wp.array(dtype=Real)  # (10 * all rollers,) for rk4 on blocks, else (1,): see `block_rk4`
        rows: wp.array(dtype=Real)  # for blocks too large to share theirs; else (1,)
        held: wp.array(dtype=wp.int32)  # the same
        parts: wp.array(dtype=wp.float64)  # the same
        progress: wp.array(dtype=Progress)  # (variants,)

    @wp.struct
    class Shared:
        """What the threads of a block share of the variant they are at, in the block's own memory."""

        rows: wp.array(dtype=Real)  # of rollers, one after the other (`exchange.ROWS`)
        held: wp.array(dtype=wp.int32)  # partners that each roller is near, as bits: sprockets, then guide-bars
        seen: wp.array(dtype=Real)  # of links, one row after the other (`exchange.SEEN`)
        wheels: wp.array(dtype=Wheel)  # (S,)
        teeth: wp.array(dtype=Sprocket)  # (S,)
        bands: wp.array(dtype=Band)  # (S,)
        bars: wp.array(dtype=Guide)  # (G,), at least one
        chain: wp.array(dtype=Chain)  # (1,)
        parts: wp.array(dtype=wp.float64)  # (3, S, threads): of sprockets' moment [N m] and pushing force (x, y) [N]
        motions: wp.array(dtype=Motion)  # (S,)
        course: wp.array(dtype=wp.float64)  # (S, steps, 2): angle, speed of prescribed sprockets (`exchange.COURSE`)
        mounts: wp.array(dtype=Mount)  # (S,)
        sprocket_sums: wp.array(dtype=SprocketSums)  # (S,)
        strands: wp.array(dtype=Strand)  # (S,)
        strand_sums: wp.array(dtype=StrandSums)  # (S,)
        mount_sums: wp.array(dtype=MountSums)  # (S,)

    return SimpleNamespace(
        Real=Real,
        vec2=vec2,
        Shared=Shared,
        ContactLaw=ContactLaw,
        Chain=Chain,
        Sprocket=Sprocket,
        Band=Band,
        Extra=Extra,
        Guide=Guide,
        Ensemble=Ensemble,
        State=State,
    )
