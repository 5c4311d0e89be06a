"""Data that kernels read and write, as Warp structs in float64 and SI units.

At float32 bodies' motion stays float64 on the CPU, on blocks in float32 or pairs.
"""

from functools import cache
from threading import Lock
from types import SimpleNamespace
from typing import Any

import warp as wp

from .number import Pair, PairVector
from .precision import at_float32, sums_at_float32

GROUND = wp.constant(-1)
"""Body number of the ground."""


@wp.struct
class Harmonics:
    """Rows of a body's harmonics (order, amplitude, phase) in the ensemble."""

    first: wp.int32
    count: wp.int32


@wp.struct
class Tabulated:
    """Table of a body's speed or torque in the ensemble (`physics.motion`)."""

    cells: wp.int32  # 0: no table
    first: wp.int32
    over_angle: wp.int32  # 1: over the body's own forward angle [rad], 0: over time [s], 2: a motor's over its speed
    repeats: wp.int32  # 1: begins anew beyond its ends, 0: keeps the value there
    start: wp.float64  # [rad] or [s]
    spacing: wp.float64  # of the cells [rad] or [s]


@wp.struct
class Drive:
    """One variant's drive: places of its parts in arrays, and settings."""

    chains: wp.int32  # chains of the variant that begins here, each a row; 0: a further one of that before
    rollers: wp.int32  # N
    sprockets: wp.int32  # S
    guides: wp.int32  # G: of a silent chain the backs' rows, then as many of its pins (`physics.back`)
    bodies: wp.int32  # B: the sprockets are the first S of them
    arms: wp.int32  # A: the last A of them
    tensioners: wp.int32
    pieces: wp.int32  # of all guides' profiles
    shafts: wp.int32  # H: the bodies after the sprockets
    gears: wp.int32
    couplings: wp.int32
    valves: wp.int32  # groups of valves
    tied: wp.int32  # 1: has shafts, gears, couplings or valves
    first_roller: wp.int32
    first_sprocket: wp.int32
    first_guide: wp.int32
    first_body: wp.int32
    first_piece: wp.int32
    first_arm: wp.int32
    first_tensioner: wp.int32
    first_shaft: wp.int32
    first_gear: wp.int32
    first_coupling: wp.int32
    first_valve: wp.int32
    points: wp.int32  # contacts of a pin with a sprocket: 1, of a silent chain its links' flank ends (`physics.toe`)
    first_contact: wp.int32  # first of the (S points + G) N contact memories: sprockets', point by point, then guides'
    first_push: wp.int32  # of a silent chain's values in `State.push`
    first_tally: wp.int32  # first of the (S + 1) N link tallies: each strand's, then those of links on no strand
    integrator: wp.int32  # as in `integrate.INTEGRATORS`: 0 leapfrog, above schemes with stages
    hubs: wp.int32  # 1: arms carry sprockets or arms, or bearings rub
    jointed: wp.int32  # 1: arms carry arms
    step: wp.float64  # h [s]
    steps: wp.int32  # whole run
    window_start: wp.int32  # metrics are taken from this step
    window_end: wp.int32  # to this one
    tension_scale: wp.float64  # of the bins of link tension [N]
    frame_interval: wp.int32  # steps between frames; 0: not recorded
    sample_interval: wp.int32  # steps between two samples of the chain, a power of two (`sums.is_sample_step`)
    first_value: wp.int64  # of this variant's frames in the block's buffer
    low: wp.vec2d  # bounding box beyond which a roller has left the drive [m]
    high: wp.vec2d


@wp.struct
class Motion:
    """Prescribed motion or load of a body's angle; its train (`physics.train`)."""

    prescribed: wp.int32  # 1: angle prescribed, 0: free to turn
    train: wp.int32  # number of the train's first body in the drive, or among those of all chains; its own where it
    # turns alone; negative: an arm of a drive that is tied
    ratio: wp.float64  # rho, its speed over that of the first
    own_inertia: wp.float64  # J of its own [kg m^2]
    sign: wp.float64  # +1 "ccw", -1 "cw"
    inverse_inertia: wp.float64  # 1 / J, of an arm about its pivot, with what moves along [1/(kg m^2)]
    speed: wp.float64  # Omega [rad/s]
    ramp_time: wp.float64  # [s]
    start_angle: wp.float64  # theta_0 [rad]
    load: wp.vec3d  # torque [N m], viscous [N m s], quadratic [N m s^2]
    load_ramp_time: wp.float64  # [s]
    drive_harmonics: Harmonics
    load_harmonics: Harmonics
    drive_table: Tabulated  # speed [rad/s] over time, instead of `speed` and `ramp_time`
    load_table: Tabulated  # torque [N m], on top of `load`
    shaft_offset: (
        wp.int32
    )  # by how many bodies the one stands after it that it turns as, with others that are tied or on its
    # shaft, of another chain; 0: it is that itself


@wp.struct
class Motor:
    """Motor of a shaft, forward (`physics.train`)."""

    present: wp.int32  # 1: there is one
    torque: wp.float64  # constant, or the largest; on top of the table [N m]
    power: wp.float64  # largest [W]; 0: unbounded
    ramp_time: wp.float64  # [s]
    wanted: wp.float64  # omega_0 of its governor [rad/s]
    band: wp.float64  # B [rad/s]; 0: it has none
    most: wp.float64  # f
    table: Tabulated  # forward [N m]


@wp.struct
class Coupling:
    """Coupling, gearbox or clutch between two bodies (`physics.train`)."""

    first: wp.int32  # of the drive's bodies, or `GROUND`
    second: wp.int32
    freewheel: wp.int32  # +1, -1: it bears only moments of that sign; 0: of both
    ratios: wp.int32  # how many rows (time [s], ratio) it has; 0: its ratio is 1
    first_ratio: wp.int32  # where they stand among the tables' values
    stiffness: wp.float64  # k [N m/rad]
    damping: wp.float64  # c [N m s/rad]
    lash: wp.float64  # b to either side [rad]
    capacity: wp.float64  # C, engaged [N m]; 0: it does not slip
    engagement: Tabulated  # part of that over time or speed


@wp.struct
class Engaged:
    """State of a coupling."""

    rest: wp.float64  # e_0: angle of the first, less the ratio times that of the second, without twist [rad]
    ratio: wp.float64  # i in use; 0: open
    capacity: wp.float64  # C [N m]; infinite: it does not slip
    lost: wp.float64  # by slipping, or by a change of ratio, at the last step's start [J]


@wp.struct
class Gear:
    """A pair of gears that ties two shafts (`physics.train`)."""

    body: wp.int32  # that its second gear is on, of the drive's
    side: wp.int64  # bodies that turn with that but for this pair, as bits; 0 where gears go round
    inertia: wp.float64  # of those, as that body sees it [kg m^2]
    lever: wp.float64  # R cos 20 degrees of the second gear [m]


@wp.struct
class ValveGroup:
    """Like valves that a body's cams lift (`physics.valve`)."""

    body: wp.int32  # of the drive's bodies
    phases: wp.int32  # how many places of its cams
    first_phase: wp.int32  # where their angles [rad] stand among the tables' values
    first_cam: wp.int32  # the first of its cams among those of the drive
    sign: wp.float64  # +1 where forward rotation of the body is counter-clockwise, else -1
    turned: wp.float64  # forward angle at which the cams would be as for 0 [rad]
    count: wp.float64  # valves at each place
    height: wp.float64  # by which the lift of the table is multiplied
    mass: wp.float64  # m that moves with a valve [kg]
    preload: wp.float64  # F_0 of its spring [N]
    stiffness: wp.float64  # k [N/m]
    lift: Tabulated  # l over the forward angle [m]


@wp.struct
class Cam:
    """Inertia, moment and energy of a body's valves."""

    inertia: wp.float64  # sum m l'^2 [kg m^2]
    growth: wp.float64  # half of its slope by the body's angle [kg m^2]
    moment: wp.float64  # of the springs [N m]
    energy: wp.float64  # of the springs [J]


@wp.struct
class Mount:
    """Mount of a body's center, and its balance wheel; zero for a fixed center.

    An arm's wheel on a prescribed pivot is its center of mass.
    """

    active: wp.int32  # 1: the center can move or there is a wheel
    moves: wp.int32  # 0 held, 1 prescribed, 2 on springs
    home: wp.vec2d  # stated center r_0 [m]
    direction: wp.vec2d  # of prescribed motion, a unit vector
    offset: wp.float64  # [m]
    amplitude: wp.float64  # [m]
    frequency: wp.float64  # 2 pi f [rad/s]
    phase: wp.float64  # [rad]
    x_table: Tabulated  # of prescribed motion over time, on top [m]
    y_table: Tabulated
    mass: wp.float64  # of body and wheel [kg]
    inverse_mass: wp.mat22d  # 1 / mass along the free directions, else 0 [1/kg]
    stiffness: wp.mat22d  # [N/m]
    damping: wp.mat22d  # [N s/m]
    preload: wp.vec2d  # [N]
    gravity: wp.vec2d  # [m/s^2]
    wheel: wp.vec2d  # m_b r_b (cos psi_b, sin psi_b) [kg m]
    inertia: wp.float64  # of body and wheel; of the wheel alone if the angle is prescribed [kg m^2]


@wp.struct
class Hub:
    """Hub of a sprocket: arm and bearing (`physics.hub`)."""

    arm: wp.int32  # the body of the drive that carries it, or `GROUND`
    lever: wp.vec2d  # d: its center from the arm's pivot, as drawn [m]
    bearing: wp.float64  # mu_b r_b [m]; 0: it does not rub
    inertia: wp.float64  # what friction has to stop, over a step [N m s]


@wp.struct
class Arm:
    """An arm that turns about a pivot, its body's center, from its drawn angle (`physics.body`)."""

    pivot: wp.vec2d  # [m]
    stiffness: wp.float64  # k_t of its torsion spring [N m/rad]
    free_angle: wp.float64  # of that spring [rad]
    damping: wp.float64  # c_t [N m s/rad]
    low: wp.float64  # angles of its stops [rad]
    high: wp.float64
    stop_stiffness: wp.float64  # of a stop [N m/rad]
    stop_damping: wp.float64  # [N m s/rad]
    reach: wp.float64  # how far from the pivot the chain may touch it [m]
    mass: wp.float64  # where its pivot is led: with what it carries; else 0 [kg]
    on: wp.int32  # the arm of the drive that carries it, counted from 1; 0: none
    lever: wp.vec2d  # d: its pivot from that of the arm that carries it, as drawn [m]
    mass_moment: wp.vec2d  # mass times its center of mass from the pivot, as drawn [kg m]
    gravity: wp.vec2d  # [m/s^2]
    coil_point: wp.vec2d  # where its coil spring holds it, from the pivot, as drawn [m]
    coil_anchor: wp.vec2d  # where that one is held, on what carries the arm, likewise [m]
    coil_stiffness: wp.float64  # [N/m]; 0: it has none
    coil_free_length: wp.float64  # [m]
    coil_damping: wp.float64  # [N s/m]


@wp.struct
class Piece:
    """Piece of a guide's face in its body's frame, chain on the left; one more ends the face."""

    start: wp.vec2d  # [m]
    direction: wp.vec2d  # of travel at its start
    curvature: wp.float64  # [1/m], positive where the face is hollow
    place: wp.float64  # of its start along the face [m]


@wp.struct
class Valve:
    """A tensioner's valve or orifice (`physics.tensioner`)."""

    hole_area: wp.float64  # A_b of its seat [m^2]; 0: there is none
    preload: wp.float64  # F_0 [N]
    compliance: wp.float64  # 1 / k_cv [m/N]
    lift_max: wp.float64  # y_max [m]
    seat_width: wp.float64  # 2 r_B tan(g) [m]
    seat_growth: wp.float64  # sin(g) / cos(g)^2
    discharge: wp.float64  # C_d


@wp.struct
class Tensioner:
    """A tensioner: place, spring, oil, valves and ratchet (`physics.tensioner`)."""

    body: wp.int32  # of the drive
    point: wp.vec2d  # where it touches, from the body's center in the body's frame [m]
    home: wp.vec2d  # r_0: where that is at the drawing [m]
    direction: wp.vec2d  # d: in which it pushes, a unit vector
    stiffness: wp.float64  # k of the spring [N/m]
    preload: wp.float64  # f_0 of the spring at x = 0 [N]
    damping: wp.float64  # c [N s/m]
    hydraulic: wp.int32  # 1: with a chamber of oil; else what follows up to `laminar_limit` is 0
    area: wp.float64  # A of the plunger [m^2]
    volume: wp.float64  # V_0 of the chamber at x = 0 [m^3]
    leak: wp.float64  # G of the gap [m^3/(s Pa)]
    drag: wp.float64  # pi d h / 2 of the gap [m^2]
    supply: wp.float64  # P_s [Pa]; pressures are absolute
    supply_table: Tabulated  # instead of `supply`, once the run has begun [Pa]
    pump: wp.int32  # body of the drive whose forward speed it is over, if over speed
    ambient: wp.float64  # P_0 [Pa]
    floor: wp.float64  # z = (P_v / P_0)^(1/7) of the vapor pressure
    rest: wp.float64  # P at which the valve brings in what leaks [Pa]
    drained: wp.float64  # share of the chamber that is air at the start
    oil_share: wp.float64  # P_0 / (E_0 (1 + a)), with the bulk modulus E_0 of the oil without air
    air_share: wp.float64  # a / (1 + a), with the share a of air at P_0
    still: wp.float64  # K + P exp(-phi) at P_0, eq. (10a) [Pa]
    supplied: wp.float64  # H at P_s, eq. (10), where that is not tabulated [Pa]
    check: Valve  # from the supply to the chamber
    relief: Valve  # out of the chamber
    vent: Valve  # likewise, always open
    density: wp.float64  # rho of the oil [kg/m^3]
    laminar_limit: wp.float64  # drop of pressure below which a valve's flow is linear in it [Pa]
    ratchet_pitch: wp.float64  # a [m]; 0: no ratchet
    backlash: wp.float64  # s [m]
    bottom: wp.float64  # x_b below which the plunger stands on the chamber's bottom [m]
    stop_stiffness: wp.float64  # k_s of ratchet and bottom [N/m]
    stop_damping: wp.float64  # c_s [N s/m]


@wp.struct
class TensionerState:
    """State of a tensioner's oil and ratchet."""

    content: wp.float64  # mu: logarithm of the mass of oil
    root: wp.float64  # z = (P / P_0)^(1/7) after the last step; 0 where that is not known
    growth: wp.float64  # of z over that step
    bend: wp.float64  # by which that was more than over the step before
    farthest: wp.float64  # x_max [m]
    supply: wp.float64  # P_s of the step, where it is tabulated [Pa]
    unfilled: wp.float64  # 1: drained, until oil has filled the chamber; no whole number, which would leave a gap


@wp.struct
class BodyState:
    """A body's coordinates and rates; leapfrog's are half a step behind."""

    angle: wp.float64  # theta [rad]
    speed: wp.float64  # omega [rad/s]
    center: wp.vec2d  # [m]
    velocity: wp.vec2d  # of the center [m/s]
    straight: wp.vec2d  # acceleration of the center in the step before [m/s^2]
    angular: wp.float64  # the same of the angle [rad/s^2]


@wp.struct
class Wrench:
    """Force and moment on a body at one instant."""

    force: wp.vec2d  # of contacts and tensioners [N]
    moment: wp.float64  # the same, about its center, counter-clockwise [N m]
    load: wp.float64  # moment of its load, or of an arm's own springs and weight [N m]
    bearing: wp.float64  # moment of the bearings of sprockets, of a sprocket its own [N m]


@wp.struct
class Push:
    """Force, pressure and extension of a tensioner."""

    force: wp.float64  # on its body, along its direction [N]
    pressure: wp.float64  # in its chamber [Pa]
    extension: wp.float64  # [m]
    moment: wp.float64  # on its body, about that's center [N m]
    thrust: wp.vec2d  # the force as a vector [N]


@wp.struct
class Pose:
    """Pose of a body as contacts see it."""

    cosine: wp.float64  # of its angle
    sine: wp.float64
    speed: wp.float64  # angular velocity, with leapfrog half a step behind [rad/s]
    center: wp.vec2d  # [m]
    velocity: wp.vec2d  # of the center [m/s]
    angle: wp.float64  # [rad]
    exact_speed: wp.float64  # prescribed: angular velocity at the step's instant [rad/s]
    load: wp.float64  # free: load moment [N m]
    straight: wp.vec2d  # acceleration of the center in the step before [m/s^2]
    angular: wp.float64  # the same of the angle [rad/s^2]


@wp.struct
class Strand:
    """Nominal line of a strand, and its links."""

    start: wp.vec2d  # [m]
    direction: wp.vec2d
    length: wp.float64  # [m]
    end: wp.int32  # of an open chain, bits: 1, it begins at the first pin; 2, it ends at the last; 4, it is the gap
    middle: wp.int32  # last roller not past mid-strand
    first_link: wp.int32  # first link between the tangent points
    links: wp.int32  # how many


@wp.struct
class Now:
    """Step of a variant on the CPU, and what it wants (1)."""

    step: wp.int32
    time: wp.float64  # [s]
    lag: wp.float64  # how far behind it the velocities are [s]
    weight: wp.float64  # time that the step stands for in the window's sums [s]
    measures: wp.int32  # powers that contacts take, and how many begin
    ends: wp.int32  # 1 at the window's ends: of them too, elastic energies
    sizes: wp.int32  # magnitudes of the contact forces on each roller


DIVERGENCE_CHECK = wp.constant(32)  # steps between two checks of whether a variant has left its box


@wp.struct
class Progress:
    """Progress of a variant's run."""

    step: wp.int32  # the next step to evaluate
    diverged: wp.int32  # 1: stopped, at `step`


@wp.struct
class ContactLaw:
    """A contact force law, eq. (15), (18), (19)."""

    form: wp.int32  # place of its function in `impact.FORCES`
    stiffness: wp.float64  # K [N/m^n]
    exponent: wp.float64  # n
    damping: wp.float64  # hysteresis factor d [-]; with Kelvin-Voigt c [N s/m]
    speed_floor: wp.float64  # v_min [m/s]
    lag: wp.float64  # h / 2, by which leapfrog's speeds are behind the forces [s]; 0 with stages
    yielding: wp.float64  # the same over a roller's mass [s/kg]
    ahead: wp.float64  # how far from its partner a roller may be that comes to touch it within a step [m]
    answer: wp.float64  # G: twice that of the partner's body to all its seated rollers (`impact`)
    most_damping: wp.float64  # with stages 2 m / h, which bounds the damper [N s/m]; 0 with leapfrog


@wp.struct
class Friction:
    """Dry friction of contacts or joints (`physics.friction`)."""

    inertia: wp.float64  # m_e [kg], of joints 0.6 (m p^2 / 6) [kg m^2]; 0: there is no friction
    stiffness: wp.float64  # k of its bristle [N/m], of joints [N m/rad]
    spring: wp.float64  # that which the step can follow, over a step, k h [N s/m], of joints [N m s/rad]
    damper: wp.float64  # c beside the bristle [N s/m], of joints [N m s/rad]
    mu_dynamic: wp.float64  # mu_d
    mu_static: wp.float64  # mu_s
    stribeck_speed: wp.float64  # v_s [m/s]


@wp.struct
class StrandLoad:
    """Goods on one strand of a chain (`physics.strand_load`)."""

    start: wp.vec2d  # where they come on [m]
    direction: wp.vec2d  # of the strand
    length: wp.float64  # over which they lie [m]
    reach: wp.float64  # pins nearer to the line carry them [m]
    per_pitch: wp.float64  # 1 / p [1/m]
    relative_mass: wp.float64  # of a pitch's goods over the chain's roller mass; 0: there are none
    feed_speed: wp.float64  # at which they come on, along the strand [m/s]


@wp.struct
class Chain:
    """The chain of one variant, eq. (1)-(3)."""

    stiffness: wp.float64  # k [N/m]
    damping: wp.float64  # c [N s/m]
    mass: wp.float64  # m of a roller, in the mean [kg]
    inverse_mass: wp.float64  # 1 / m [1/kg]
    gravity: wp.vec2d  # [m/s^2]
    length: wp.float64  # of each link, unloaded, where they are alike; else of the first [m]
    outer_stiffness: wp.float64  # k of links of an even index [N/m]; `stiffness` is that of the others
    outer_damping: wp.float64  # c of these [N s/m]
    play: wp.float64  # s of a link, its two joints' [m]
    absent: wp.int32  # the link, counted from 1, that an open chain lacks between its ends; 0: none
    pin_radius: wp.float64  # r_p [m]
    joint_arm: wp.float64  # kappa r_p [m]
    joint: Friction
    load: StrandLoad
    unlike_masses: wp.int32  # 1: its rollers' masses differ


@wp.struct
class Plate:
    """Plate of a silent chain (`physics.toe`)."""

    begin: wp.vec2d  # center of the arc at a flank's beginning, from the link's middle, outward as that and down [m]
    tip: wp.vec2d  # the same at the toe's tip [m]
    radius: wp.float64  # r of these arcs [m]
    cos_flank: wp.float64  # of the flanks' angle to the link's normal
    sin_flank: wp.float64
    side: wp.float64  # +1 where wheels are to the left of the chain's travel, else -1


@wp.struct
class Sprocket:
    """Teeth of one sprocket and their contact law."""

    teeth: wp.int32  # z
    first_seat: wp.int32  # of this number of teeth in the table of seat directions
    pitch_radius: wp.float64  # R [m]
    half_pitch_tangent: wp.float64  # tan(pi / z)
    clearance: wp.float64  # Rc = R_seat - Rr [m]
    cos_half_seat: wp.float64  # of half the seating angle
    sin_half_seat: wp.float64
    flank_curvature: wp.float64  # 1 / (re + Rr) [1/m]; 0: straight
    tip_reach: wp.float64  # R_tip + Rr [m]
    law: ContactLaw
    near_square: wp.float64  # (R - b)^2, not below 0, and
    far_square: wp.float64  # (R + b)^2: rollers between are engaged, b = max(p/2, R_tip + Rr + `law.ahead` - R)
    pin: wp.int32  # of an end, its only roller, counted from 1; 0: a sprocket with teeth
    exact_radius: wp.float64  # R, beside rows of float32 too [m]
    corner: wp.float64  # of a silent chain: tooth's tip along its flank, from the foot of the pin's perpendicular [m]


@wp.struct
class Band:
    """Ring about a sprocket in which rollers are engaged."""

    center: wp.vec2d  # [m]
    near_square: wp.float64  # [m^2]
    far_square: wp.float64


@wp.struct
class Guide:
    """One guide, bar or profile, and its contact law (`physics.guide`)."""

    start: wp.vec2d  # a [m]; of a profile, its chord's
    direction: wp.vec2d  # t
    length: wp.float64  # |b - a| [m]
    end_radius: wp.float64  # Rg [m]
    roller_radius: wp.float64  # Rr, or how far from the face a roller's center is that touches it [m]
    back_radius: wp.float64  # R_c of the backs of links that touch it; 0: rollers do (`physics.back`) [m]
    slack: wp.float64  # what float32 alone may be off by in telling which rollers are near [m]; 0 at float64
    deepest_entry: wp.float64  # a roller first seen deeper than this has not come through the face [m]
    law: ContactLaw
    body: wp.int32  # of the drive that carries it; `GROUND`: none
    pieces: wp.int32  # of its profile; 0: a straight bar
    first_piece: wp.int32  # of those of the drive
    low: wp.vec2d  # of a profile: the box along and across its chord in which rollers are looked after [m]
    high: wp.vec2d


@wp.struct
class Totals:
    """Totals over contacts of one sprocket or guide."""

    moment: wp.float64  # on the sprocket [N m]
    push: wp.vec2d  # force on the sprocket [N]
    energy: wp.float64  # elastic [J]; it keeps apart sums that the compiler would gather, four at a time
    force: wp.float64  # sum of magnitudes [N]
    force_max: wp.float64  # [N]
    dissipated: wp.float64  # power [W]
    friction: wp.float64  # power of friction [W]
    impacts: wp.int32  # contacts that began
    contacts: wp.int32  # of them, the first of a roller in its pass
    missed: wp.int32  # rollers that came in not through the face
    missing: wp.int32  # rollers that are in there


@wp.struct
class ContactSums:
    """Window's sums of one sprocket's or guide's contacts."""

    force_max: wp.float64  # [N]
    impacts: wp.int32  # contacts that began
    contacts: wp.int32  # of them, the first of a roller in its pass over a sprocket
    missed: wp.int32  # rollers that were in a guide-bar without having come through its face
    impulse: wp.float64  # [N s]
    dissipated: wp.float64  # [J]
    friction: wp.float64  # dissipated by friction, which `dissipated` has not [J]


@wp.struct
class SprocketSums:
    """Window's sums of a sprocket, by the trapezoidal rule."""

    speed_min: wp.float64  # [rad/s]
    speed_max: wp.float64
    speed: wp.float64  # [rad]
    speed_square: wp.float64
    moment: wp.float64  # [N m s]
    contact_work: wp.float64  # done by the chain on the sprocket [J]
    load_work: wp.float64  # done by the load moment [J]
    late_work: wp.float64  # done by contacts, beside what these have in `dissipated` (`body.late_contact_power`) [J]
    force: wp.vec2d  # of the chain on it [N s]
    force_max: wp.float64  # its largest magnitude [N]


@wp.struct
class MountSums:
    """Window's sums of a sprocket on an active mount."""

    travel: wp.vec2d  # displacement from the stated center [m s]
    travel_max: wp.float64  # largest distance from it [m]
    force: wp.float64  # magnitude of what holds the center [N s]
    dissipated: wp.float64  # in its damper [J]
    friction: wp.float64  # in its bearing, whatever mount it is on [J]
    work: wp.float64  # done on sprocket and wheel by what prescribes center and angle [J]


@wp.struct
class ArmSums:
    """Window's sums of an arm."""

    angle_min: wp.float64  # [rad]
    angle_max: wp.float64
    angle: wp.float64  # [rad s]
    angle_square: wp.float64
    moment: wp.float64  # of contacts about its pivot [N m s]
    dissipated: wp.float64  # in its damper and stops [J]
    work: wp.float64  # done on it by what leads its pivot [J]
    late_work: wp.float64  # done on it by contacts, beside these' `dissipated` (`body.late_contact_power`) [J]


@wp.struct
class ShaftSums:
    """Window's sums of a shaft."""

    speed_min: wp.float64  # [rad/s]
    speed_max: wp.float64
    speed: wp.float64  # [rad]
    speed_square: wp.float64
    motor: wp.float64  # moment of its motor [N m s]
    motor_max: wp.float64  # [N m]
    motor_work: wp.float64  # [J]
    load_work: wp.float64  # done by its load [J]


@wp.struct
class CouplingSums:
    """Window's sums of a coupling."""

    twist_min: wp.float64  # [rad]
    twist_max: wp.float64
    twist: wp.float64  # [rad s]
    moment_min: wp.float64  # [N m]
    moment_max: wp.float64
    moment: wp.float64  # taken from the first [N m s]
    dissipated: wp.float64  # in its damper [J]
    slip_loss: wp.float64  # by slipping and changes of ratio [J]
    led_work: wp.float64  # done on bodies whose angle is prescribed [J]


@wp.struct
class GearSums:
    """Window's sums of a gear pair."""

    force_max: wp.float64  # [N]
    force: wp.float64  # its magnitude [N s]
    moment: wp.float64  # passed on to the second shaft [N m s]


@wp.struct
class ValveSums:
    """Window's sums of a valve group."""

    torque_min: wp.float64  # against forward rotation [N m]
    torque_max: wp.float64
    torque: wp.float64  # [N m s]
    force_min: wp.float64  # of a cam on a follower [N]
    afloat: wp.float64  # time for which a follower would lift off [s]


@wp.struct
class TensionerFlows:
    """Oil flows through a tensioner and their energies."""

    leaked: wp.float64  # through the gap [m^3]
    supplied: wp.float64  # [m^3]
    relieved: wp.float64  # [m^3]
    vented: wp.float64  # [m^3]
    leak_loss: wp.float64  # in gap, relief valve and vent [J]
    valve_loss: wp.float64  # in the check valve [J]
    supply_work: wp.float64  # [J]
    filling: wp.float64  # time from the run's beginning until oil has filled the chamber [s]
    unfilled: wp.float64  # 1: it has not, at the step's end


@wp.struct
class TensionerSums:
    """Window's sums of a tensioner, and flows."""

    force_min: wp.float64  # [N]
    force_max: wp.float64
    force: wp.float64  # [N s]
    pressure_min: wp.float64  # [Pa]
    pressure_max: wp.float64
    pressure: wp.float64  # [Pa s]
    extension_min: wp.float64  # [m]
    extension_max: wp.float64
    extension: wp.float64  # [m s]
    dissipated: wp.float64  # in its damper and stop [J]
    suction_work: wp.float64  # done on a plunger that its oil would hold back [J]
    flows: TensionerFlows


@wp.struct
class StrandSums:
    """Window's sums of a strand: tension, mid-strand displacement."""

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
    """Window's sums of the chain, with energy balance."""

    tension_min: wp.float64  # [N]
    tension_max: wp.float64
    tension: wp.float64  # sum over links and samples
    tension_square: wp.float64
    samples: wp.int64  # samples in the window
    dissipated: wp.float64  # in the links [J]
    friction: wp.float64  # dissipated in the joints [J]
    goods_work: wp.float64  # that goods bring, less what they take along [J]
    energy_start: wp.float64  # mechanical energy at the window's start [J]
    energy_end: wp.float64


@wp.struct
class Note:
    """Sums of a chain or strand at a batch's end."""

    tension: wp.float64  # as in `ChainSums`, `StrandSums`
    samples: wp.int64
    links: wp.int64  # whose tensions were sampled
    displacement: wp.float64  # of a strand


@wp.struct
class SprocketNote:
    """Sums of a sprocket at a batch's end."""

    speed: wp.float64  # as in `SprocketSums`
    moment: wp.float64
    force: wp.vec2d


@wp.struct
class MountNote:
    """Sums of a mount at a batch's end."""

    travel: wp.vec2d  # as in `MountSums`
    force: wp.float64


@wp.struct
class SlipSums:
    """Teeth jumped over a sprocket (`statistics.follow_slip`)."""

    slips: wp.int32
    known: wp.int32  # 1: a roller has been seen in mid-wrap
    roller: wp.int32  # which was there at the last sample
    place: wp.int32  # of it along the chain, from where the window began, modulo the teeth
    offset: wp.int32  # of its seat from that place, modulo the teeth
    candidate: wp.int32  # the same at the last sample


@wp.struct
class LinkTally:
    """Sums of one link while on one strand."""

    samples: wp.int64
    tension: wp.float64  # [N]
    tension_square: wp.float64


@wp.struct
class RollerTally:
    """Dissipation and energies of one roller, its link and contacts."""

    dissipated: wp.float64  # [J]
    friction: wp.float64  # [J]
    goods_work: wp.float64  # as in `ChainSums` [J]
    energy_start: wp.float64  # [J]
    energy_end: wp.float64


@wp.struct
class Tallies:
    """Sums of block kernels by roller; contacts' in own rows."""

    link: wp.array[LinkTally]  # (sum of (S + 1) N,)
    impacts: wp.array[wp.int32]  # (contact memories,)
    contacts: wp.array[wp.int32]
    missed: wp.array[wp.int32]
    dissipated: wp.array[wp.float64]
    friction: wp.array[wp.float64]
    impulse: wp.array[wp.float64]
    force_max: wp.array[wp.float64]
    roller: wp.array[RollerTally]  # (all rollers,)
    body: wp.array[RollerTally]  # (all bodies,): energy only, of tensioners too


@wp.struct
class Sums:
    """Window's sums; S sprockets and G guides a variant."""

    chain: wp.array[ChainSums]  # (variants,)
    strand: wp.array[StrandSums]  # (all sprockets,)
    sprocket: wp.array[SprocketSums]  # (all sprockets,)
    mount: wp.array[MountSums]  # (all sprockets,)
    arm: wp.array[ArmSums]  # (all arms,)
    shaft: wp.array[ShaftSums]  # (all shafts,)
    coupling: wp.array[CouplingSums]  # (all couplings,)
    gear: wp.array[GearSums]  # (all gears,)
    valve: wp.array[ValveSums]  # (all groups of valves,)
    tensioner: wp.array[TensionerSums]  # (all tensioners,)
    contact: wp.array[ContactSums]  # (all sprockets and guide-bars,), a variant's sprockets first
    slip: wp.array[SlipSums]  # (all sprockets,)
    tension_counts: wp.array[wp.int32]  # `statistics.BINS` of each strand, then of links on none, variant by variant
    chain_notes: wp.array[Note]  # `statistics.NOTES` a variant
    strand_notes: wp.array[Note]  # the same for each sprocket
    sprocket_notes: wp.array[SprocketNote]
    mount_notes: wp.array[MountNote]


@wp.struct
class Ensemble:
    """Data of all variants that do not change."""

    drives: wp.array[Drive]  # (variants,)
    chains: wp.array[Chain]  # (variants,)
    plates: wp.array[Plate]  # (variants,)
    lengths: wp.array[wp.float64]  # (all rollers,) unloaded length of each link [m]
    sprockets: wp.array[Sprocket]  # (all sprockets,)
    motions: wp.array[Motion]  # (all bodies,)
    mounts: wp.array[Mount]  # (all bodies,)
    hubs: wp.array[Hub]  # (all sprockets,)
    guides: wp.array[Guide]  # (all guide-bars,)
    seats: wp.array[wp.vec2d]  # directions of the seats of each number of teeth in use (`physics.tooth`)
    pieces: wp.array[Piece]  # (all profiles' pieces,)
    arms: wp.array[Arm]  # (all arms,)
    tensioners: wp.array[Tensioner]  # (all tensioners,)
    motors: wp.array[Motor]  # (all shafts,)
    couplings: wp.array[Coupling]  # (all couplings,)
    gears: wp.array[Gear]  # (all gears,)
    valves: wp.array[ValveGroup]  # (all groups of valves,)
    harmonics: wp.array[wp.vec3d]  # (order, amplitude, phase) of the motions and loads of all bodies
    tables: wp.array[wp.float64]  # five values a cell of all tables (`physics.motion`)
    tooth_friction: wp.array[Friction]  # (all sprockets,)
    guide_friction: wp.array[Friction]  # (all guide-bars,)


@wp.struct
class Extra:
    """Forces and energy of one roller for frames."""

    tension: wp.float64  # of the link after it [N]
    rate: wp.float64  # of that link's elongation [m/s]
    sprocket_force: wp.float64  # sum of magnitudes [N]
    guide_force: wp.float64  # [N]
    energy: wp.float64  # elastic [J]
    friction_power: wp.float64  # of its joint, where frames hold it [W]


@wp.struct
class State:
    """State of a run, for all variants."""

    rollers: wp.array[wp.float64]  # (6 * all rollers,): a variant's x, y, vx, vy rows, and x, y's low parts
    relative_mass: wp.array[wp.float64]  # (all rollers,) mass over `Chain.mass`, with attachments
    bodies: wp.array[BodyState]  # (all bodies,)
    body_stages: wp.array[BodyState]  # (all bodies, 2): at the step's start, and sums of its stages' weighted slopes
    wrenches: wp.array[Wrench]  # (all bodies,), of contacts
    poses: wp.array[Pose]  # (all bodies,), on the CPU: as contacts see them
    rates: wp.array[wp.vec3d]  # (all bodies,), on the CPU: accelerations of center [m/s^2] and angle [rad/s^2]
    train_moments: wp.array[
        wp.float64
    ]  # (all bodies,), on the CPU: moment on each, with what couplings pass on to it [N m]
    cams: wp.array[Cam]  # (all bodies,), on the CPU
    couplings: wp.array[Engaged]  # (all couplings,)
    tensioners: wp.array[TensionerState]  # (all tensioners,)
    pushes: wp.array[Push]  # (all tensioners,)
    meters: wp.array[TensionerFlows]  # (all tensioners,): what has flowed since the run began
    strands: wp.array[Strand]  # (all sprockets,)
    seat: wp.array[wp.int32]  # (contact memories,): seat, or piece of a profile, that a roller is near, else -1
    impact_speed: wp.array[wp.float64]  # (contact memories,): v0 [m/s], not positive while open (`contact`)
    contact_hold: wp.array[wp.float64]  # (contact memories,): what friction's bristle holds [N] (`friction`)
    damper_speed: wp.array[wp.float64]  # the same: speed at which the damper acted in the step before [m/s] (`impact`)
    push: wp.array[wp.float64]  # of silent chains: forces on links in the step before, then all on pins, x, y [N]
    joint_hold: wp.array[wp.float64]  # (all rollers,): the same of joints [N m]
    hub_hold: wp.array[wp.float64]  # (all sprockets,): the same of bearings [N m]
    totals: wp.array[Totals]  # (all sprockets and guide-bars,)
    extra: wp.array[Extra]  # (all rollers,), for block kernels; else (1,)
    stages: wp.array[wp.float64]  # (10 * all rollers,) for stages on blocks, else (1,): see `gpu.rollers.STAGE_ROWS`
    rows: wp.array[wp.float64]  # for blocks too large to share theirs; else (1,)
    parts: wp.array[wp.float64]  # the same
    progress: wp.array[Progress]  # (variants,)


@wp.struct
class Memory:
    """Memory of contacts with one sprocket or guide."""

    seat: wp.array[wp.int32]  # as in `State`
    impact_speed: wp.array[wp.float64]
    bristle: wp.array[wp.float64]  # `State.contact_hold`
    damper_row: wp.int32  # row of the speeds at which dampers acted in the step before (`contact_rows.damper_row`)
    push_row: wp.int32  # of a silent chain: row of forces on links in the step before, and
    speed_row: wp.int32  # of its v0 (`contact_rows`)
    first: wp.int32  # of this partner's rollers
    stage: wp.int32  # v0 and holds are kept at stage 0 only, a step's start
    stretch_part: wp.float64  # part of a step over which bristles are stretched (`integrate.stretched_part`)
    wanted: Now  # what is added up too
    inverse_mass: wp.float64  # 1 / m of the chain's rollers [1/kg]
    unlike_masses: wp.int32  # of `Chain`
    gravity: wp.vec2d  # on them [m/s^2]
    straight: wp.vec2d  # acceleration of the center of the partner's body in the step before [m/s^2]
    angular: wp.float64  # the same of its angle [rad/s^2]
    lag: wp.float64  # how far the velocities are behind the forces [s]
    time: wp.float64  # the forces' instant [s]


@wp.struct
class _BlockPose:
    """`Pose` on blocks at float32 (`physics.tooth`)."""

    reach_cosine: Pair  # R cos theta, the high part on a grid of 12 bits [m]
    reach_sine: Pair
    center: PairVector  # [m]
    speed: Pair  # angular velocity, with leapfrog half a step behind [rad/s]
    inverse_radius: wp.float32  # 1 / R [1/m]
    load: wp.float32  # free: load moment [N m]
    cosine: Pair  # of its angle
    sine: Pair
    angle: Pair  # [rad]
    radius: Pair  # R [m]
    velocity: PairVector  # of the center [m/s]
    grid: wp.float32  # for `physics.tooth.gridded` [m]
    exact_speed: wp.float32  # prescribed: angular velocity at the step's instant [rad/s]
    straight: wp.vec2f  # acceleration of the center in the step before [m/s^2]
    angular: wp.float32  # the same of the angle [rad/s^2]
    unused_0: wp.int32
    unused_1: wp.int32
    unused_2: wp.int32


PAIRS = {
    Tabulated: ("start", "spacing"),
    Motion: ("speed", "ramp_time", "start_angle"),
    Motor: (),
    Coupling: (),
    Engaged: ("rest",),
    Gear: (),
    ValveGroup: ("turned",),
    Cam: (),
    Mount: ("home", "offset", "amplitude", "frequency", "phase"),
    Hub: ("lever",),
    Arm: ("lever",),
    Piece: ("start", "direction"),
    Valve: (),
    Tensioner: ("point", "home", "direction"),
    TensionerState: ("content",),
    BodyState: ("angle", "speed", "center", "velocity"),
    Wrench: (),
    Push: ("extension",),
}
"""Structs of bodies' motion on blocks at float32, and their pairs."""


@cache
def _roller_structs() -> dict[Any, Any]:
    """Structs at float32 of chain and contacts, by those at float64."""
    made: dict[Any, Any] = {}
    for full in (Friction, StrandLoad, ContactLaw, Chain, Plate, Band, Extra):
        made[full] = at_float32(full, made)
    made[Memory] = at_float32(Memory, made, kept=("time",))
    return made


def _add_block_structs(made: dict[Any, Any]) -> None:
    """Adds structs of bodies' motion for float32 blocks."""
    for full, pairs in PAIRS.items():
        made[full] = at_float32(full, made, pairs=pairs, rows=full is Piece)
    made[Pose] = _BlockPose
    flowed = [name for name in TensionerFlows.vars if name != "unfilled"]
    made[TensionerFlows] = at_float32(TensionerFlows, made, pairs=flowed)
    made[SprocketSums] = sums_at_float32(
        SprocketSums, made, recent=("moment", "contact_work", "load_work", "late_work")
    )
    made[SprocketNote] = sums_at_float32(SprocketNote, made, recent=("moment",))
    for full in (MountSums, MountNote, ArmSums, TensionerSums, ShaftSums, CouplingSums, GearSums, ValveSums, Sums):
        made[full] = sums_at_float32(full, made)


_ONE_AT_A_TIME = Lock()
"""Lock under which threads make structs."""


def types(Real: type, blocks: bool = False) -> SimpleNamespace:
    """Structs at precision `Real` (wp.float64 or wp.float32) by name.

    With them are `Real`, its vector `vec2`, `Number` (of `number`), and `Instant`, a body's state in plain numbers.
    Without `blocks` bodies' motion is float64.
    """
    with _ONE_AT_A_TIME:
        return _types(Real, blocks)


@cache
def _types(Real: type, blocks: bool) -> SimpleNamespace:
    """Structs for `types`, made once for each precision."""
    made: dict[Any, Any] = {}
    vec2 = wp.vec2d if Real == wp.float64 else wp.vec2f
    if Real == wp.float32:
        made |= _roller_structs()
        if blocks:
            _add_block_structs(made)
            made[Sprocket] = at_float32(Sprocket, made, pairs=("exact_radius",), rows=True)
            made[Guide] = at_float32(Guide, made, pairs=("start", "direction"), rows=True)
        else:
            made[Sprocket] = at_float32(Sprocket, made, kept=("exact_radius",))
            made[Guide] = at_float32(Guide, made, kept=("start", "direction", "low", "high"))
        of_blocks = {"pairs": ("tables",), "seats": wp.array[wp.vec4f], "harmonics": wp.array[wp.vec4f]}
        others = of_blocks if blocks else {"kept": ("seats", "harmonics", "tables")}
        made[Ensemble] = at_float32(Ensemble, made, **others)
        made[State] = at_float32(State, made, kept=("rates", "train_moments", "cams", "hub_hold"))
    named = {full.key: made.get(full, full) for full in STRUCTS}
    paired = Real == wp.float32 and blocks
    instant, number = (at_float32(BodyState, {}, rest=wp.float32), Pair) if paired else (BodyState, wp.float64)
    return SimpleNamespace(Real=Real, vec2=vec2, Number=number, Instant=instant, **named)


STRUCTS = [of for of in vars().values() if isinstance(of, type(Drive)) and of not in (Pair, PairVector, _BlockPose)]
