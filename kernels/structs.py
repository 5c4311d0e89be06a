"""The data that kernels read and write, as Warp structs, for each precision from one source.

`types(Real)` gives the structs whose quantities are `Real` (wp.float64 or wp.float32). Everything is in SI units.
Quantities that belong to a body's motion, and sums over time, are float64 at both precisions; on blocks at float32 what
moves bodies and what contacts see of them is in float32 and pairs of float32 (`float32`, `Spin`, `Wheel`).
"""

import sys
from functools import cache
from types import SimpleNamespace

import warp as wp

from .number import Pair
from .precision import at_float32, narrowing
from .sum_structs import ArmSums, MountSums, SprocketSums, TensionerFlows, TensionerSums, Totals, flows_struct

GROUND = wp.constant(-1)
"""The body of what does not move."""


@wp.struct
class Harmonics:
    """Where a body's (order, amplitude, phase) rows stand in the ensemble's list."""

    first: wp.int32
    count: wp.int32


@wp.struct
class Tabulated:
    """Where a body's speed or torque table stands in the ensemble's list (see `kernels.physics.table`)."""

    cells: wp.int32  # 0: no table
    first: wp.int32
    over_angle: wp.int32  # 1: over the body's own forward angle [rad], 0: over time [s]
    repeats: wp.int32  # 1: begins anew beyond its ends, 0: keeps the value there
    start: wp.float64  # [rad] or [s]
    spacing: wp.float64  # of the cells [rad] or [s]


@wp.struct
class Curves:
    """What the motions and loads of all bodies are tabulated in."""

    harmonics: wp.array[wp.vec3d]  # (order, amplitude, phase)
    tables: wp.array[wp.float64]  # five values a cell (`physics.table`)


@wp.struct
class Drive:
    """One variant: where its parts begin in the ensemble's arrays, and its settings."""

    rollers: wp.int32  # N
    sprockets: wp.int32  # S
    guides: wp.int32  # G
    bodies: wp.int32  # B: the sprockets are the first S of them
    arms: wp.int32  # A: the last A of them
    tensioners: wp.int32
    pieces: wp.int32  # of all guides' profiles
    first_roller: wp.int32
    first_sprocket: wp.int32
    first_guide: wp.int32
    first_body: wp.int32
    first_piece: wp.int32
    first_arm: wp.int32
    first_tensioner: wp.int32
    first_contact: wp.int32  # first of the (S + G) N contact memories: sprockets, then guide-bars
    first_tally: wp.int32  # first of the (S + 1) N link tallies: each strand's, then those of links on no strand
    integrator: wp.int32  # 0 leapfrog, 1 rk4
    step: wp.float64  # h [s]
    steps: wp.int32  # whole run
    window_start: wp.int32  # metrics are taken from this step
    window_end: wp.int32  # to this one
    tension_scale: wp.float64  # of the bins of link tension [N]
    sample_every: wp.int32  # steps between frames; 0: not recorded
    look_every: wp.int32  # steps between two looks at the chain, a power of two (`sums.is_look`)
    first_value: wp.int64  # of this variant's frames in the block's buffer
    low: wp.vec2d  # bounding box beyond which a roller has left the drive [m]
    high: wp.vec2d


@wp.struct
class Motion:
    """How a body is turned: driven or loaded, eq. (4)."""

    prescribed: wp.int32  # 1: angle prescribed, 0: free to turn
    sign: wp.float64  # +1 "ccw", -1 "cw"
    inverse_inertia: wp.float64  # 1 / J [1/(kg m^2)]
    speed: wp.float64  # Omega [rad/s]
    ramp_time: wp.float64  # [s]
    start_angle: wp.float64  # theta_0 [rad]
    load: wp.vec3d  # torque [N m], viscous [N m s], quadratic [N m s^2]
    load_ramp_time: wp.float64  # [s]
    drive_harmonics: Harmonics
    load_harmonics: Harmonics
    drive_table: Tabulated  # speed [rad/s] over time, instead of `speed` and `ramp_time`
    load_table: Tabulated  # torque [N m], on top of `load`


@wp.struct
class Mount:
    """How a body's center is held, and its balance wheel; all zero for a fixed center without a wheel."""

    active: wp.int32  # 1: the center can move or there is a wheel
    moves: wp.int32  # 0 held, 1 prescribed, 2 on springs
    home: wp.vec2d  # stated center r_0 [m]
    direction: wp.vec2d  # of prescribed motion, a unit vector
    offset: wp.float64  # [m]
    amplitude: wp.float64  # [m]
    frequency: wp.float64  # 2 pi f [rad/s]
    phase: wp.float64  # [rad]
    mass: wp.float64  # of body and wheel [kg]
    inverse_mass: wp.mat22d  # 1 / mass along the free directions, else 0 [1/kg]
    stiffness: wp.mat22d  # [N/m]
    damping: wp.mat22d  # [N s/m]
    preload: wp.vec2d  # [N]
    gravity: wp.vec2d  # [m/s^2]
    wheel: wp.vec2d  # m_b r_b (cos psi_b, sin psi_b) [kg m]
    inertia: wp.float64  # of body and wheel; of the wheel alone if the angle is prescribed [kg m^2]


def _arm_struct(Real: type, vec2: type) -> type:
    """`Arm` at a precision."""

    @wp.struct
    class Arm:
        """An arm that turns about a fixed pivot, its body's center; its angle is 0 as drawn (`physics.arm`)."""

        pivot: vec2  # [m]
        inverse_inertia: Real  # about the pivot, with what moves along [1/(kg m^2)]
        stiffness: Real  # k_t of its torsion spring [N m/rad]
        free_angle: Real  # of that spring [rad]
        damping: Real  # c_t [N m s/rad]
        low: Real  # angles of its stops [rad]
        high: Real
        stop_stiffness: Real  # of a stop [N m/rad]
        stop_damping: Real  # [N m s/rad]
        reach: Real  # how far from the pivot the chain may touch it [m]
        mass_moment: vec2  # mass times its center of mass from the pivot, as drawn [kg m]
        gravity: vec2  # [m/s^2]

    return Arm


Arm = _arm_struct(wp.float64, wp.vec2d)


@wp.struct
class Piece:
    """An arc or a straight piece of a guide's face, in the coordinates of the body that carries it.

    The chain is on the left of its direction. After the last piece of a guide one more says where that ends.
    """

    start: wp.vec2d  # [m]
    direction: wp.vec2d  # of travel at its start
    curvature: wp.float64  # [1/m], positive where the face is hollow
    place: wp.float64  # of its start along the face [m]


def _tensioner_struct(Real: type, vec2: type) -> type:
    """`Tensioner` at a precision."""

    @wp.struct
    class Tensioner:
        """A tensioner: where it touches its body, its spring, oil, valve and ratchet (`physics.tensioner`)."""

        body: wp.int32  # of the drive
        point: vec2  # where it touches, from the body's center in the body's frame [m]
        home: vec2  # r_0: where that is at the drawing [m]
        direction: vec2  # d: in which it pushes, a unit vector
        stiffness: Real  # k of the spring [N/m]
        preload: Real  # f_0 of the spring at x = 0 [N]
        damping: Real  # c [N s/m]
        hydraulic: wp.int32  # 1: with a chamber of oil; else what follows up to `laminar_limit` is 0
        area: Real  # A of the plunger [m^2]
        volume: Real  # V_0 of the chamber at x = 0 [m^3]
        leak: Real  # G of the gap [m^3/(s Pa)]
        drag: Real  # pi d h / 2 of the gap [m^2]
        supply: Real  # P_s [Pa]; pressures are absolute
        ambient: Real  # P_0 [Pa]
        vapor: Real  # P_v [Pa]
        rest: Real  # P at which the valve brings in what leaks [Pa]
        bulk_modulus: Real  # E_0 of the oil without air [Pa]
        air: Real  # share a of air at P_0
        hole_area: Real  # A_b of the valve's seat [m^2]
        valve_preload: Real  # F_0 [N]
        valve_stiffness: Real  # k_cv [N/m]
        lift_max: Real  # y_max [m]
        seat_width: Real  # 2 r_B tan(g) [m]
        seat_growth: Real  # sin(g) / cos(g)^2
        discharge: Real  # C_d
        density: Real  # rho of the oil [kg/m^3]
        laminar_limit: Real  # drop of pressure below which the valve's flow is linear in it [Pa]
        ratchet_pitch: Real  # a [m]; 0: no ratchet
        backlash: Real  # s [m]
        bottom: Real  # x_b below which the plunger stands on the chamber's bottom [m]
        stop_stiffness: Real  # k_s of ratchet and bottom [N/m]
        stop_damping: Real  # c_s [N s/m]

    return Tensioner


Tensioner = _tensioner_struct(wp.float64, wp.vec2d)


@wp.struct
class TensionerState:
    """What a tensioner remembers."""

    content: wp.float64  # mu: logarithm of the mass of oil
    pressure: wp.float64  # P after the last step [Pa]
    farthest: wp.float64  # x_max [m]


@wp.struct
class BodyState:
    """A body in motion: its coordinates and their rates; leapfrog keeps the rates at half steps."""

    angle: wp.float64  # theta [rad]
    speed: wp.float64  # omega [rad/s]
    center: wp.vec2d  # [m]
    velocity: wp.vec2d  # of the center [m/s]


@wp.struct
class BodyStages:
    """rk4's body at the step's start, and the sum of its weighted slopes."""

    base: BodyState
    slopes: BodyState


@wp.struct
class Wrench:
    """What contacts do to a body at one instant."""

    force: wp.vec2d  # [N]
    moment: wp.float64  # about its center, counter-clockwise [N m]


@wp.struct
class Push:
    """What a tensioner does at one instant."""

    force: wp.float64  # on its body, along its direction [N]
    pressure: wp.float64  # in its chamber [Pa]
    extension: wp.float64  # [m]
    rate: wp.float64  # of that [m/s]
    wrench: Wrench  # on its body


@wp.struct
class Pose:
    """Where a body is and how it moves, as contacts see it; on blocks, thread s writes it, all read it."""

    cosine: wp.float64  # of its angle
    sine: wp.float64
    speed: wp.float64  # angular velocity, with leapfrog half a step behind [rad/s]
    center: wp.vec2d  # [m]
    velocity: wp.vec2d  # of the center [m/s]
    angle: wp.float64  # [rad]
    exact_speed: wp.float64  # prescribed: angular velocity at the step's instant [rad/s]
    load: wp.float64  # free: load moment [N m]


@wp.struct
class Spin:
    """`Motion` on blocks at float32, as far as it is not tabulated."""

    prescribed: wp.int32  # 1: angle prescribed, 0: free to turn
    tabulated: wp.int32  # 1: tabulated
    drive_harmonics: Harmonics
    load_harmonics: Harmonics
    sign: wp.float32  # +1 "ccw", -1 "cw"
    inverse_inertia: wp.float32  # 1 / J [1/(kg m^2)]
    speed: Pair  # Omega [rad/s]
    ramp_time: Pair  # [s]
    ramp_rate: Pair  # 1 / ramp_time [1/s]
    start_angle: Pair  # theta_0 [rad]
    load: wp.vec3f  # torque [N m], viscous [N m s], quadratic [N m s^2]
    load_ramp_time: wp.float32  # [s]


@wp.struct
class SplitTable:
    """`Tabulated` on blocks at float32."""

    cells: wp.int32  # 0: no table
    first: wp.int32
    over_angle: wp.int32
    repeats: wp.int32
    start: Pair  # [rad] or [s]
    spacing: Pair  # [rad] or [s]
    rate: Pair  # 1 / spacing


@wp.struct
class Wheel:
    """A body on blocks at float32, as `Pose` and for `physics.tooth`; the thread that has it writes it, all read it."""

    reach_cosine: Pair  # R cos theta, the high part on a grid of 12 bits [m]
    reach_sine: Pair
    center: wp.vec2f  # high parts [m]
    center_low: wp.vec2f
    cosine: Pair  # of the angle
    sine: Pair
    speed: Pair  # angular velocity, with leapfrog half a step behind [rad/s]
    velocity: wp.vec2f  # of the center [m/s]
    radius: Pair  # R [m]
    grid: wp.float32  # for `physics.tooth.gridded` [m]
    angle: Pair  # [rad]
    exact_speed: wp.float32  # prescribed: angular velocity at the step's instant [rad/s]
    load: wp.float32  # free: load moment [N m]


@wp.struct
class Hub:
    """`Mount` on blocks at float32, and how its sprocket's center moves."""

    active: wp.int32
    moves: wp.int32
    home: wp.vec2f  # high parts [m]
    home_low: wp.vec2f
    direction: wp.vec2f
    offset: Pair  # [m]
    amplitude: Pair  # [m]
    frequency: Pair  # [rad/s]
    phase: Pair  # [rad]
    mass: wp.float32  # [kg]
    inverse_mass: wp.mat22f  # [1/kg]
    stiffness: wp.mat22f  # [N/m]
    damping: wp.mat22f  # [N s/m]
    preload: wp.vec2f  # [N]
    gravity: wp.vec2f  # [m/s^2]
    wheel: wp.vec2f  # [kg m]
    inertia: wp.float32  # [kg m^2]
    velocity_low: wp.vec2f  # of the center, what its high parts (`Wheel`) round off [m/s]


@wp.struct
class SpinRates:
    """Angular velocity of a sprocket and velocity of its center, in float32."""

    speed: wp.float32  # [rad/s]
    velocity: wp.vec2f  # [m/s]


@wp.struct
class SpinWrench:
    """`Wrench` in float32."""

    moment: wp.float32  # [N m]
    force: wp.vec2f  # [N]


@wp.struct
class Slope:
    """A coordinate at the step's start, and the sum of its weighted slopes."""

    base: Pair
    total: Pair


@wp.struct
class WheelStages:
    """`BodyStages` of a body on blocks at float32."""

    angle: Slope
    speed: Slope
    x: Slope  # of the center
    y: Slope
    across: Slope  # velocity of the center, x
    up: Slope  # and y


@wp.struct
class Stroke:
    """What a tensioner's extension hangs on, on blocks at float32 (`physics.tensioner`)."""

    home: Pair  # r_0 . d [m]
    direction_x: Pair  # d
    direction_y: Pair
    along: Pair  # p . d, p the touched point in the body's frame [m]
    across: Pair  # d . p turned by +90 degrees [m]


@wp.struct
class Led:
    """Where prescribed motion leads a sprocket, on blocks at float32."""

    angle: Pair  # [rad]
    speed: wp.float32  # [rad/s]


@wp.struct
class Line:
    """Where a straight guide-bar lies, on blocks at float32: high and low parts."""

    start: wp.vec2f  # a [m]
    start_low: wp.vec2f
    direction: wp.vec2f  # t
    direction_low: wp.vec2f
    slack: wp.float32  # what float32 alone may be off by along the bar and a little beyond [m]


@wp.struct
class Strand:
    """The nominal straight line of a strand, and which part of the chain lies on it (updated every few steps)."""

    start: wp.vec2d  # [m]
    direction: wp.vec2d
    length: wp.float64  # [m]
    middle: wp.int32  # last roller not past mid-strand
    first_link: wp.int32  # first link between the tangent points
    links: wp.int32  # how many


@wp.struct
class Wanted:
    """What is wanted of an evaluated step on the CPU beside forces and moments; 1: wanted."""

    measures: wp.int32  # powers that contacts take, and how many begin
    forces: wp.int32  # of them too, the sum and the largest of the contacts' magnitudes
    energy: wp.int32  # of them too, elastic
    sizes: wp.int32  # magnitudes of the contact forces on each roller


DIVERGENCE_CHECK = wp.constant(32)  # steps between two checks of whether a variant has left its box


@wp.struct
class Progress:
    """How far a variant has come."""

    step: wp.int32  # the next step to evaluate
    diverged: wp.int32  # 1: stopped, at `step`


TensionerMeter = TensionerFlows
"""What has flowed through a tensioner since the run began."""


@wp.struct
class _Push:
    """`Push` on blocks at float32: what it does to its body lies with that of the contacts."""

    force: wp.float32  # on its body, along its direction [N]
    pressure: wp.float32  # in its chamber [Pa]
    extension: Pair  # [m]


float32 = SimpleNamespace(
    Arm=_arm_struct(wp.float32, wp.vec2f),
    Tensioner=_tensioner_struct(wp.float32, wp.vec2f),
    Push=_Push,
    SprocketSums=at_float32(SprocketSums, recent=("moment", "contact_work", "load_work")),
    MountSums=at_float32(MountSums),
    ArmSums=at_float32(ArmSums),
    TensionerSums=at_float32(TensionerSums),
    TensionerState=at_float32(TensionerState, single=("pressure", "farthest")),
    TensionerFlows=flows_struct(wp.float32),
    TensionerMeter=at_float32(TensionerMeter, single=("lift",)),
)
"""Structs of this module as blocks at float32 keep them, by the same names."""


@cache
def types(Real: type) -> SimpleNamespace:
    """The structs whose quantities are `Real`, and the function that makes a body's of float64 that of a block."""
    at = float32 if Real == wp.float32 else sys.modules[__name__]
    vec2 = wp.vec2d if Real == wp.float64 else wp.vec2f

    @wp.struct
    class ContactLaw:
        """A contact force law, eq. (15), (18), (19)."""

        form: wp.int32  # place of its function in `impact.FORCES`
        stiffness: Real  # K [N/m^n]
        exponent: Real  # n
        damping: Real  # hysteresis factor d [-]; with Kelvin-Voigt c [N s/m]
        speed_floor: Real  # v_min [m/s]
        most_damping: Real  # m_e / h [N s/m]: more would turn the approach around in a step

    @wp.struct
    class Friction:
        """Coefficients of dry friction (`physics.friction`)."""

        mu_dynamic: Real  # mu_d
        mu_static: Real  # mu_s
        stribeck_speed: Real  # v_s [m/s]

    @wp.struct
    class Sliding:
        """What rubs where rollers touch teeth or a guide-bar (`physics.friction`)."""

        rubs: wp.int32  # 1: there is friction
        stop: Real  # beta m_e / h [N s/m]
        law: Friction

    @wp.struct
    class Joint:
        """What rubs in the joints of one chain (`physics.joint`)."""

        rubs: wp.int32  # 1: there is friction
        pin_radius: Real  # r_p [m]
        arm: Real  # kappa r_p [m]
        stop: Real  # moment a sliding speed that a step can stop, 0.375 (m p^2 / 6) / (h r_p) [N s]
        law: Friction

    @wp.struct
    class Chain:
        """The chain of one variant, eq. (1)-(3)."""

        stiffness: Real  # k [N/m]
        damping: Real  # c [N s/m]
        mass: Real  # m of a roller [kg]
        inverse_mass: Real  # 1 / m [1/kg]
        gravity: vec2  # [m/s^2]
        length: Real  # of each link, unloaded, where they are alike; else of the first [m]

    @wp.struct
    class Links:
        """Where the links of one chain are not all the same linear spring: outer ones have an even index."""

        varied_links: wp.int32  # 1: outer links differ in stiffness or damping, or there is play
        outer_stiffness: Real  # k of outer links [N/m]; the chain's is that of inner ones
        outer_damping: Real  # c of outer links [N s/m]
        play: Real  # s of a link, its two joints' [m]

    @wp.struct
    class Sprocket:
        """The teeth of one sprocket and their contact law, eq. (5)-(8)."""

        teeth: wp.int32  # z
        first_seat: wp.int32  # of this number of teeth in the table of seat directions
        exact_radius: wp.float64  # R [m]
        pitch_radius: Real  # R [m]
        near_square: Real  # (R - b)^2, not below 0, and
        far_square: Real  # (R + b)^2: rollers between are engaged, b = max(p/2, R_tip + Rr - R)
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
        """One guide and its contact law: a straight bar, eq. (21)-(23), or a profile (`physics.profile`)."""

        body: wp.int32  # of the drive that carries it; `GROUND`: none
        pieces: wp.int32  # of its profile; 0: a straight bar
        first_piece: wp.int32  # of those of the drive
        start: wp.vec2d  # a [m]; of a profile, its chord's
        direction: wp.vec2d  # t
        length: Real  # |b - a| [m]
        low: wp.vec2d  # of a profile: the box along and across its chord in which rollers are looked after [m]
        high: wp.vec2d
        end_radius: Real  # Rg [m]
        roller_radius: Real  # Rr, or how far from the face a roller's center is that touches it [m]
        deepest_entry: Real  # a roller first seen deeper than this has not come through the face [m]
        law: ContactLaw

    @wp.struct
    class Ensemble:
        """What does not change during a run, for all variants."""

        drives: wp.array[Drive]  # (variants,)
        chains: wp.array[Chain]  # (variants,)
        lengths: wp.array[Real]  # (all rollers,) unloaded length of each link [m]
        sprockets: wp.array[Sprocket]  # (all sprockets,)
        motions: wp.array[Motion]  # (all bodies,)
        mounts: wp.array[Mount]  # (all bodies,)
        guides: wp.array[Guide]  # (all guide-bars,)
        seats: wp.array[wp.vec2d]  # directions of the seats of each number of teeth in use
        pieces: wp.array[Piece]  # (all profiles' pieces,)
        arms: wp.array[Arm]  # (all arms,)
        tensioners: wp.array[Tensioner]  # (all tensioners,)
        block_arms: wp.array[float32.Arm]  # the arms for blocks at float32, else (1,)
        block_tensioners: wp.array[float32.Tensioner]  # the tensioners, the same
        strokes: wp.array[Stroke]  # of the tensioners, the same
        curves: Curves
        split_seats: wp.array[wp.vec4f]  # the same for blocks at float32, else (1,): high parts of 12 bits, low parts
        split_harmonics: wp.array[wp.vec4f]  # `curves.harmonics` for blocks at float32, and the sine of the phase
        split_tables: wp.array[SplitTable]  # (2 * all bodies,) for blocks at float32, else (1,): of motion, of load
        split_pieces: wp.array[wp.vec4f]  # three rows a piece for blocks at float32, else (1,) (`physics.profile`)
        split_values: wp.array[wp.vec2f]  # `curves.tables` for blocks at float32, else (1,)
        tooth_sliding: wp.array[Sliding]  # (all sprockets,)
        guide_sliding: wp.array[Sliding]  # (all guide-bars,)
        joints: wp.array[Joint]  # (variants,)
        links: wp.array[Links]  # (variants,)

    @wp.struct
    class Extra:
        """What frames and the energy balance want of one roller, at the steps that want it."""

        tension: Real  # of the link after it [N]
        rate: Real  # of that link's elongation [m/s]
        sprocket_force: Real  # sum of magnitudes [N]
        guide_force: Real  # [N]
        energy: Real  # elastic [J]
        friction_power: Real  # of its joint, where frames hold it [W]

    @wp.struct
    class State:
        """What changes during a run, for all variants."""

        rollers: wp.array[Real]  # (6 * all rollers,): a variant's x, y, vx, vy rows, and x, y's low parts
        bodies: wp.array[BodyState]  # (all bodies,)
        body_stages: wp.array[BodyStages]  # (all bodies,), for rk4
        wrenches: wp.array[Wrench]  # (all bodies,), of contacts
        poses: wp.array[Pose]  # (all bodies,), on the CPU: as contacts see them
        rates: wp.array[wp.vec3d]  # (all bodies,), on the CPU: accelerations of center [m/s^2] and angle [rad/s^2]
        tensioners: wp.array[TensionerState]  # (all tensioners,)
        pushes: wp.array[Push]  # (all tensioners,)
        meters: wp.array[TensionerFlows]  # (all tensioners,): what has flowed since the run began
        strands: wp.array[Strand]  # (all sprockets,)
        seat: wp.array[wp.int32]  # (contact memories,): seat, or piece of a profile, that a roller is near, else -1
        impact_speed: wp.array[Real]  # (contact memories,): v0 of a contact, not positive while open (`contact`) [m/s]
        totals: wp.array[Totals]  # (all sprockets and guide-bars,)
        extra: wp.array[Extra]  # (all rollers,), for block kernels; else (1,)
        stages: wp.array[Real]  # (10 * all rollers,) for rk4 on blocks, else (1,): see `block_rk4`
        rows: wp.array[Real]  # for blocks too large to share theirs; else (1,)
        parts: wp.array[Real]  # the same
        progress: wp.array[Progress]  # (variants,)

    @wp.struct
    class Memory:
        """What contacts with one sprocket or guide-bar keep from step to step, and what of it a pass may change."""

        seat: wp.array[wp.int32]  # as in `State`
        impact_speed: wp.array[Real]
        first: wp.int32  # of this partner's rollers
        stage: wp.int32  # v0 is kept at stage 0 only, a step's start (rk4 has three more)
        wanted: Wanted  # what is added up too
        lag: Real  # how far the velocities are behind the forces [s]

    @wp.struct
    class Shared:
        """What the threads of a block share of the variant they are at, in the block's own memory."""

        rows: wp.array[Real]  # of rollers, one after the other (`block_room.shared_rows`)
        seen: wp.array[Real]  # extremes of tension, then rows of squared rates, of joint friction (`block_observe`)
        strand_of: wp.array[wp.uint32]  # of threads' links: the strand that each is on (`block_strands`)
        poses: wp.array[Pose]  # (bodies,), and with profiles the ground
        wheels: wp.array[wp.vec4f]  # rows of these instead, at float32 (`block_wheels`)
        gears: wp.array[wp.vec4f]  # rows of sprockets' teeth, the same
        spins: wp.array[Spin]  # (S,), the same
        led: wp.array[Led]  # (S, steps), the same
        hubs: wp.array[Hub]  # (S,), the same where sprockets' centers move
        wheel_stages: wp.array[WheelStages]  # (bodies,), the same with rk4
        tensioners: wp.array[at.TensionerState]  # (tensioners,), the same
        pushes: wp.array[at.Push]  # (tensioners,), the same
        meters: wp.array[at.TensionerMeter]  # (tensioners,), the same
        tensioner_sums: wp.array[at.TensionerSums]  # (tensioners,), the same
        arm_sums: wp.array[at.ArmSums]  # (arms,), the same
        lines: wp.array[wp.vec4f]  # rows of guides, the same
        box: wp.array[wp.vec4f]  # (1,), the same: low and high corner beyond which a roller has left the drive [m]
        teeth: wp.array[Sprocket]  # (S,)
        bands: wp.array[Band]  # (S,)
        bars: wp.array[Guide]  # (G,), at least one
        sliding: wp.array[Sliding]  # (S + G,), of kernels with friction there
        chain: wp.array[Chain]  # (1,)
        joint: wp.array[Joint]  # (1,)
        links: wp.array[Links]  # (1,)
        parts: wp.array[Real]  # (3, bodies, `block_room.parts_of_a_body`): of moment [N m], force (x, y) [N] on each
        motions: wp.array[Motion]  # (S,)
        course: wp.array[wp.float64]  # (courses, steps, 2): prescribed angle, speed (`gpu.shared_memory.COURSE`)
        mounts: wp.array[Mount]  # (S,)
        sprocket_sums: wp.array[at.SprocketSums]  # (S,)
        mount_sums: wp.array[at.MountSums]  # (S,)

    return SimpleNamespace(
        Real=Real,
        vec2=vec2,
        narrowed=narrowing(Real),
        Shared=Shared,
        ContactLaw=ContactLaw,
        Friction=Friction,
        Sliding=Sliding,
        Joint=Joint,
        Links=Links,
        Chain=Chain,
        Sprocket=Sprocket,
        Band=Band,
        Extra=Extra,
        Memory=Memory,
        Guide=Guide,
        Ensemble=Ensemble,
        State=State,
    )
