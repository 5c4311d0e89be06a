"""The rollers of one variant on the CPU: rows in a scratch, link forces, kick and drift.

Rows have a constant length (`rows`). Branchless loops through `native.row_access` (`while`, not `range`) vectorize
(docs/performance.md).
"""

from dataclasses import dataclass, fields
from functools import cache

import warp as wp

from ..native import STATE_ROWS, row_access
from ..physics.link import acceleration_component, compensated_sum, link_force
from ..structs import types


@dataclass(frozen=True)
class Rows:
    """First index of each row of a CPU scratch, in order.

    A silent chain has as many more for contacts of links, after contacts' memory. A row written at i is not within two
    rows after one read at i + 1: vectors would be narrower.
    """

    x: int  # position [m]
    y: int
    vx: int  # velocity [m/s]
    vy: int
    x_low: int  # what float32 rounds off the position [m]
    y_low: int
    link_x: int  # force of link i at i + 1 [N]
    link_y: int
    tension: int  # of the link after the roller [N]
    rate: int  # of its elongation [m/s]
    fx: int  # contact forces [N]
    fy: int
    sprocket_force: int  # their magnitudes [N]
    guide_force: int
    length: int  # of the link after the roller [m]
    relative_mass: int  # of the roller over the chain's [-], and
    mobility: int  # 1 over that
    turn_rate: int  # of that link [rad/s]
    moment: int  # of the joint on it [N m]
    joint_bristle: int  # moment that this joint's bristle holds [N m]
    couple_x: int  # n / L of link i at i + 1 [1/m], then the force of its joints' couple on roller i [N]
    couple_y: int
    x0: int  # stages: the state at the step's start
    y0: int
    vx0: int
    vy0: int
    x0_low: int
    y0_low: int
    sum_x: int  # stages: sums of weighted slopes
    sum_y: int
    sum_vx: int
    sum_vy: int
    v0_before: int  # of contacts with the partner at hand (`contact_rows`): v0 until now [m/s]
    near: int  # 1: near the partner at hand, else 0
    piece: int  # of the profile at hand that the roller is over, else -1
    direction_owner: int  # the sprocket of the drive to a seat of which the direction below belongs, else -1
    direction_x: int  # to where a seat points at angle zero, and what float32 rounds off
    direction_y: int
    direction_x_low: int
    direction_y_low: int
    v0_of_seat: int  # v0 that its contact with that sprocket has kept [m/s]
    radial: int  # in a tooth gap: from the seat, along the seat's outward direction and across it [m]
    lateral: int
    outward_x: int  # that direction
    outward_y: int
    arm_x: int  # the roller from the center of the partner's body [m]
    arm_y: int
    penetration: int  # [m], at the instant and then in the mean of the step (`contact.normal_force`)
    normal_x: int  # towards the roller
    normal_y: int
    relative_x: int  # velocity of the partner's material point less the roller's [m/s]
    relative_y: int
    v0_open: int  # memory if there is no contact [m/s]
    v0_kept: int  # memory from now on [m/s]
    damper_speed: int  # at which the damper acted in the step before, then acts [m/s]
    force_x: int  # force on the roller [N]
    force_y: int
    force_size: int  # of the normal force [N]
    mu: int  # coefficient of friction [-]
    bristle: int  # force that friction's bristle holds [N]
    friction_x: int  # friction [N]
    friction_y: int
    reaction: int  # on the partner's body [N m]
    damper_power: int  # that contacts take without friction [W]
    friction_power: int  # power of friction [W]
    tension_min: int  # of links since their tallies were merged: least and greatest tension [N]
    tension_max: int
    rate_squares: int  # weighted sum of squares of rates of elongation
    strand: int  # that the link is on
    run_first: int  # of runs of rollers that can come near a partner soon (`neighbor_list`): the first roller
    run_rollers: int  # and how many they are
    runs: int  # of partner i of the drive
    lifetime: int  # 0: steps for which they hold; 1: as long as none is faster [m/s]
    joint_friction: int  # tally of the powers that the roller's joints take [W]
    toe_x: int  # of a silent chain (`toes`): force of contacts on the pin in the step before [N]
    toe_y: int
    pin_ax: int  # acceleration of the pin by its links, and by contacts as in the step before [m/s^2]
    pin_ay: int
    near_x: int  # force of a wheel's teeth, or of guides on backs, at the pin on it, and in the end all of theirs [N]
    near_y: int
    link_ux: int  # unit vector of link i at i + 1, like the seven that follow
    link_uy: int
    link_length: int  # [m]
    link_turn: int  # angular velocity [rad/s]
    link_angular: int  # angular acceleration [rad/s^2]
    middle_vx: int  # velocity of the link's middle [m/s]
    middle_vy: int
    middle_ax: int  # acceleration of that [m/s^2]
    middle_ay: int
    place_x: int  # of the contact at hand from its link's middle [m]
    place_y: int
    more_x: int  # acceleration of its relative velocity [m/s^2]
    more_y: int
    pushed: int  # force that it exerted in the step before [N]
    exception: int  # 1: it is worked out apart, as few are; in a pin's row bits of such flank ends
    after_near: int  # 1: the link after the pin may touch a tooth of its gap within half a step, else 0
    before_near: int  # and the link before it
    held: int  # speed at which its damper acted then [m/s]
    point_mobility: int  # inverse mass along its normal over a roller's [-]
    next_x: int  # of pin i at i + 1: and on the next pin, by the link between
    next_y: int
    last_x: int  # of pin i at i + 1: and on the pin before
    last_y: int


ROWS = tuple(field.name for field in fields(Rows))


@cache
def rows(capacity: int) -> Rows:
    """First indices of a CPU scratch's rows of `capacity` values."""
    firsts = {name: k * capacity for k, name in enumerate(ROWS)}
    for name in ("link_x", "link_y"):
        firsts[name] += 15  # so that what stands at i + 1 begins with a cache line, at both precisions
    return type("Rows", (), firsts)  # as Warp reads constants from attributes of a class, not of an object


@dataclass(frozen=True)
class RollerFunctions:
    """CPU roller functions."""

    fetch: wp.Function
    put_back: wp.Function
    clear_rows: wp.Function
    exact_position: wp.Function
    link_vector: wp.Function
    link_velocity: wp.Function
    store_link_force: wp.Function
    move: wp.Function
    repeat_first_roller: wp.Function
    find_link_forces: wp.Function
    acceleration_components: wp.Function
    acceleration: wp.Function
    kick_and_drift: wp.Function
    is_inside: wp.Function


@cache
def roller_functions(Real: type, capacity: int) -> RollerFunctions:
    """CPU roller functions."""
    kinds = types(Real)
    Chain = kinds.Chain
    vec2 = kinds.vec2
    compensated = Real == wp.float32
    access = row_access(Real)
    row = rows(capacity)

    @wp.func
    def fetch(state: kinds.State, lengths: wp.array[Real], w: wp.array[Real], first: int, n: int):
        """Copies a chain's `n` rollers from `first` on, and link lengths, into the CPU's scratch."""
        for k in range(STATE_ROWS):
            for i in range(n):
                w[k * wp.static(capacity) + i] = state.rollers[STATE_ROWS * first + k * n + i]
        for i in range(n):
            w[row.length + i] = lengths[first + i]
            w[row.joint_bristle + i] = state.joint_hold[first + i]
            relative = state.relative_mass[first + i]
            w[row.relative_mass + i] = relative
            w[row.mobility + i] = Real(1.0) / relative
        w[row.joint_bristle + n] = state.joint_hold[first]
        for i in range(access.round_up(n)):
            w[row.direction_owner + i] = Real(-1.0)

    @wp.func
    def put_back(state: kinds.State, w: wp.array[Real], first: int, n: int):
        """Copies a chain's rollers and bristles from the CPU's scratch into the state."""
        for k in range(STATE_ROWS):
            for i in range(n):
                state.rollers[STATE_ROWS * first + k * n + i] = w[k * wp.static(capacity) + i]
        for i in range(1, n):
            state.joint_hold[first + i] = w[row.joint_bristle + i]
        state.joint_hold[first] = w[row.joint_bristle + n]

    @wp.func
    def clear_rows(w: wp.array[Real], first: int, second: int, n: int):
        """Zeroes two rows of rollers, from `first` and `second` on."""
        i = int(0)
        while i < n:
            access.store(w, first + i, Real(0.0))
            access.store(w, second + i, Real(0.0))
            i = i + 1

    @wp.func
    def exact_position(w: wp.array[Real], i: int):
        """Position [m] of roller `i` in float64, from the CPU's rows."""
        if wp.static(compensated):
            return wp.vec2d(
                wp.float64(access.load(w, row.x + i)) + wp.float64(access.load(w, row.x_low + i)),
                wp.float64(access.load(w, row.y + i)) + wp.float64(access.load(w, row.y_low + i)),
            )
        else:
            return wp.vec2d(wp.float64(access.load(w, row.x + i)), wp.float64(access.load(w, row.y + i)))

    @wp.func
    def link_vector(w: wp.array[Real], i: int):
        """Vector [m] from roller `i` to i + 1 in rows, exact at float32 too."""
        d = vec2(
            access.load(w, row.x + i + 1) - access.load(w, row.x + i),
            access.load(w, row.y + i + 1) - access.load(w, row.y + i),
        )
        if wp.static(compensated):
            d += vec2(
                access.load(w, row.x_low + i + 1) - access.load(w, row.x_low + i),
                access.load(w, row.y_low + i + 1) - access.load(w, row.y_low + i),
            )
        return d

    @wp.func
    def link_velocity(w: wp.array[Real], i: int):
        """Velocity [m/s] of roller i + 1 relative to roller `i`, from rows."""
        return vec2(
            access.load(w, row.vx + i + 1) - access.load(w, row.vx + i),
            access.load(w, row.vy + i + 1) - access.load(w, row.vy + i),
        )

    @wp.func
    def store_link_force(w: wp.array[Real], i: int, tension: Real, rate: Real, u: vec2):
        """Stores tension and force of link `i`; clears contact forces."""
        access.store(w, row.tension + i, tension)
        access.store(w, row.rate + i, rate)
        access.store(w, row.link_x + i + 1, tension * u[0])
        access.store(w, row.link_y + i + 1, tension * u[1])
        access.store(w, row.fx + i, Real(0.0))
        access.store(w, row.fy + i, Real(0.0))

    @wp.func
    def move(w: wp.array[Real], i: int, dx: Real, dy: Real):
        """Moves roller `i` in CPU rows by (dx, dy) [m], float32's rounding in the low parts."""
        if wp.static(compensated):
            x, x_low = compensated_sum(access.load(w, row.x + i), access.load(w, row.x_low + i), dx)
            y, y_low = compensated_sum(access.load(w, row.y + i), access.load(w, row.y_low + i), dy)
            access.store(w, row.x + i, x)
            access.store(w, row.y + i, y)
            access.store(w, row.x_low + i, x_low)
            access.store(w, row.y_low + i, y_low)
        else:
            access.store(w, row.x + i, access.load(w, row.x + i) + dx)
            access.store(w, row.y + i, access.load(w, row.y + i) + dy)

    @wp.func
    def repeat_first_roller(w: wp.array[Real], n: int):
        """Copies roller 0 to roller n in rows, closing the chain."""
        access.store(w, row.x + n, access.load(w, row.x))
        access.store(w, row.y + n, access.load(w, row.y))
        access.store(w, row.vx + n, access.load(w, row.vx))
        access.store(w, row.vy + n, access.load(w, row.vy))
        if wp.static(compensated):
            access.store(w, row.x_low + n, access.load(w, row.x_low))
            access.store(w, row.y_low + n, access.load(w, row.y_low))

    @wp.func
    def find_link_forces(w: wp.array[Real], n: int, chain: Chain):
        """Stores tension and force of every link in CPU rows, eq. (2), (3); clears contact forces."""
        repeat_first_roller(w, n)
        i = int(0)
        while i < access.round_up(n):
            d, v = link_vector(w, i), link_velocity(w, i)
            tension, rate, u = link_force(d, v, access.load(w, row.length + i), chain)
            store_link_force(w, i, tension, rate, u)
            i = i + 1
        access.store(w, row.link_x, access.load(w, row.link_x + n))
        access.store(w, row.link_y, access.load(w, row.link_y + n))

    @wp.func
    def acceleration_components(w: wp.array[Real], i: int, inverse_mass: Real, gravity: vec2):
        """Acceleration [m/s^2] of roller `i` by links, contacts and gravity, in x and y, from CPU rows."""
        x = access.load(w, row.link_x + i + 1) - access.load(w, row.link_x + i) + access.load(w, row.fx + i)
        y = access.load(w, row.link_y + i + 1) - access.load(w, row.link_y + i) + access.load(w, row.fy + i)
        own = inverse_mass * access.load(w, row.mobility + i)
        return acceleration_component(x, own, gravity[0]), acceleration_component(y, own, gravity[1])

    @wp.func
    def acceleration(w: wp.array[Real], i: int, inverse_mass: Real, gravity: vec2):
        """Acceleration [m/s^2] of roller `i` by forces in CPU rows and gravity, as a vector."""
        ax, ay = acceleration_components(w, i, inverse_mass, gravity)
        return vec2(ax, ay)

    @wp.func
    def kick_and_drift(w: wp.array[Real], n: int, chain: Chain, kick: Real, h: Real):
        """Moves all rollers in CPU rows: v += kick a, then x += h v; ages or ends the neighbor list."""
        inverse_mass = chain.inverse_mass
        limit = access.load(w, row.lifetime + 1) * access.load(w, row.lifetime + 1)
        fast = int(0)
        i = int(0)
        while i < access.round_up(n):
            a = acceleration(w, i, inverse_mass, chain.gravity)
            vx = access.load(w, row.vx + i) + kick * a[0]
            vy = access.load(w, row.vy + i) + kick * a[1]
            access.store(w, row.vx + i, vx)
            access.store(w, row.vy + i, vy)
            move(w, i, h * vx, h * vy)
            square = vx * vx + vy * vy
            fast = fast | wp.where(square <= limit, 0, wp.where(i < n, 1, 0))
            i = i + 1
        access.store(w, row.lifetime, wp.where(fast != 0, Real(0.0), access.load(w, row.lifetime) - Real(1.0)))

    @wp.func
    def is_inside(w: wp.array[Real], n: int, low: wp.vec2d, high: wp.vec2d):
        """1 while every roller is finite and in the drive's box, else 0."""
        good = int(1)
        i = int(0)
        while i < n:
            x = wp.float64(access.load(w, row.x + i))
            y = wp.float64(access.load(w, row.y + i))
            if not (x > low[0] and x < high[0] and y > low[1] and y < high[1]):
                good = int(0)
            i = i + 1
        return good

    return RollerFunctions(
        fetch=fetch,
        put_back=put_back,
        clear_rows=clear_rows,
        exact_position=exact_position,
        link_vector=link_vector,
        link_velocity=link_velocity,
        store_link_force=store_link_force,
        move=move,
        repeat_first_roller=repeat_first_roller,
        find_link_forces=find_link_forces,
        acceleration_components=acceleration_components,
        acceleration=acceleration,
        kick_and_drift=kick_and_drift,
        is_inside=is_inside,
    )
