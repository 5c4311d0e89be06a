"""The data that kernels read and write, as Warp structs, for each precision from one source.

`types(Real)` gives the structs whose quantities are `Real` (wp.float64 or wp.float32). Everything is in SI units.
Quantities that belong to a sprocket's motion, and sums over time, are float64 at both precisions.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

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
class CenterStages:
    """rk4's center and velocity of a moving sprocket at the step's start, and the sum of their weighted slopes."""

    base_center: vec2d
    base_velocity: vec2d
    sum_center: vec2d
    sum_velocity: vec2d


@wp.struct
class Totals:
    """What the contacts of one sprocket or guide-bar add up to at one instant."""

    moment: wp.float64  # on the sprocket [N m]
    push: vec2d  # force on the sprocket [N]
    force: wp.float64  # sum of magnitudes [N]
    force_max: wp.float64  # [N]
    dissipated: wp.float64  # power [W]
    energy: wp.float64  # elastic [J]
    impacts: wp.int32  # contacts that began


@wp.struct
class ContactSums:
    """Sums over the window of one sprocket's or guide-bar's contacts."""

    force_max: wp.float64  # [N]
    impacts: wp.int32
    impulse: wp.float64  # [N s]
    dissipated: wp.float64  # [J]


@wp.struct
class SprocketSums:
    """Sums over the window of a sprocket's motion (time integrals, trapezoidal)."""

    speed_min: wp.float64  # [rad/s]
    speed_max: wp.float64
    speed: wp.float64  # [rad]
    speed_square: wp.float64
    moment: wp.float64  # [N m s]
    contact_work: wp.float64  # done by the chain on the sprocket [J]
    load_work: wp.float64  # done by the load moment [J]


@wp.struct
class MountSums:
    """Sums over the window of a sprocket on an active mount."""

    travel: vec2d  # displacement from the stated center [m s]
    travel_max: wp.float64  # largest distance from it [m]
    force: wp.float64  # magnitude of what holds the center [N s]
    dissipated: wp.float64  # in its damper [J]
    work: wp.float64  # done on sprocket and wheel by what prescribes center and angle [J]


@wp.struct
class StrandSums:
    """Sums over the window of one strand: its links' tension and its mid-strand transverse displacement."""

    links: wp.int64  # tension samples
    tension_min: wp.float64  # [N]
    tension_max: wp.float64
    tension: wp.float64
    tension_square: wp.float64
    samples: wp.int64  # displacement samples
    displacement_min: wp.float64  # [m]
    displacement_max: wp.float64
    displacement: wp.float64
    displacement_square: wp.float64


@wp.struct
class ChainSums:
    """Sums over the window of the whole chain, and the energy balance's two ends."""

    tension_min: wp.float64  # [N]
    tension_max: wp.float64
    tension: wp.float64  # sum over links and steps
    tension_square: wp.float64
    samples: wp.int64  # steps in the window
    dissipated: wp.float64  # in the links [J]
    energy_start: wp.float64  # mechanical energy at the window's start [J]
    energy_end: wp.float64


@wp.struct
class Strand:
    """The nominal straight line of a strand, and which part of the chain lies on it (looked up every few steps)."""

    start: vec2d  # [m]
    direction: vec2d
    length: wp.float64  # [m]
    middle: wp.int32  # last roller not past mid-strand
    first_link: wp.int32  # first link between the tangent points
    links: wp.int32  # how many


@wp.struct
class Progress:
    """How far a variant has come."""

    step: wp.int32  # the next step to evaluate
    diverged: wp.int32  # 1: stopped, at `step`


@wp.struct
class Sums:
    """What is added up over the window; S sprockets (and strands) and G guide-bars a variant."""

    chain: wp.array(dtype=ChainSums)  # (variants,)
    strand: wp.array(dtype=StrandSums)  # (all sprockets,)
    sprocket: wp.array(dtype=SprocketSums)  # (all sprockets,)
    mount: wp.array(dtype=MountSums)  # (all sprockets,)
    contact: wp.array(dtype=ContactSums)  # (all sprockets and guide-bars,), a variant's sprockets first


@cache
def types(Real: type) -> SimpleNamespace:
    """The structs whose quantities are `Real`."""
    vec2 = wp.types.vector(2, Real)

    @wp.struct
    class ContactLaw:
        """A contact force law, eq. (15), (18), (19)."""

        stiffness: Real  # K [N/m^n]
        exponent: Real  # n
        hysteresis: Real  # 3 (1 - e^2) / 4
        speed_floor: Real  # v_min [m/s]

    @wp.struct
    class Chain:
        """The chain of one variant, eq. (1)-(3)."""

        pitch: Real  # p [m]
        stiffness: Real  # k [N/m]
        damping: Real  # c [N s/m]
        mass: Real  # m of a roller [kg]
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
        tip_reach: Real  # R_tip + Rr [m]
        law: ContactLaw

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
        sprockets: wp.array(dtype=Sprocket)  # (all sprockets,)
        motions: wp.array(dtype=Motion)  # (all sprockets,)
        mounts: wp.array(dtype=Mount)  # (all sprockets,)
        guides: wp.array(dtype=Guide)  # (all guide-bars,)
        harmonics: wp.array(dtype=vec3d)  # (order, amplitude, phase)
        tables: wp.array(dtype=wp.float64)  # five values a cell (`kernels.table`)
        seats: wp.array(dtype=vec2d)  # directions of the seats of each number of teeth in use

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
        progress: wp.array(dtype=Progress)  # (variants,)

    return SimpleNamespace(
        Real=Real,
        vec2=vec2,
        ContactLaw=ContactLaw,
        Chain=Chain,
        Sprocket=Sprocket,
        Guide=Guide,
        Ensemble=Ensemble,
        State=State,
    )
