"""The CPU kernel's passes over the rollers of one variant: link forces, teeth, kick and drift.

The rollers lie in a scratch of rows of constant length (`rows`), read and written through `load_row` and `store_row`,
which tell the compiler that neighbors in a row are neighbors in memory; with plain loops (`while`, not `range`) it then
vectorizes the passes without branches: 1,080 million link forces a second on one core with AVX-512, against 115 with
Warp's strided array indexing (docs/performance.md).
"""

from dataclasses import dataclass, fields
from functools import cache
from types import SimpleNamespace

import warp as wp

from ..native import STATE_ROWS, accessors, whole_lanes
from ..physics.link import acceleration_component, compensated_sum, link_force
from ..structs import types


@dataclass(frozen=True)
class Rows:
    """First index of each row of a scratch, in their order."""

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
    turn: int  # of that link [rad/s]
    moment: int  # of the joint on it [N m]
    joint_hold: int  # what that joint's bristle holds [N m]
    bend_x: int  # n / L of link i at i + 1 [1/m], then the force of its joints' couple on roller i [N]
    bend_y: int
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
    before: int  # of contacts with the partner at hand (`contacts`): v0 until now [m/s]
    near: int  # 1: near the partner at hand, else 0
    piece: int  # of the profile at hand that the roller is over, else -1
    direction_of: int  # the sprocket of the drive to a seat of which the direction below belongs, else -1
    direction_x: int  # to where a seat points at angle zero, and what float32 rounds off
    direction_y: int
    direction_x_low: int
    direction_y_low: int
    held: int  # v0 that its contact with that sprocket has kept [m/s]
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
    open: int  # v0 kept if there is no contact [m/s]
    kept: int  # v0 kept [m/s]
    damper_speed: int  # at which the damper acted in the step before, then acts [m/s]
    press_x: int  # force on the roller [N]
    press_y: int
    size: int  # of the normal force [N]
    mu: int  # coefficient of friction [-]
    hold: int  # what friction's bristle holds of it [N]
    drag_x: int  # friction [N]
    drag_y: int
    moment_of: int  # on the partner's body [N m]
    damped: int  # power that contacts take but for friction [W]
    rubbed: int  # power of friction [W]
    least: int  # of links since their tallies were merged: least and greatest tension [N]
    greatest: int
    rates: int  # weighted sum of squares of rates of elongation
    strand: int  # that the link is on
    run_first: int  # of runs of rollers that can come near a partner soon (`neighbor_list`): the first roller
    run_count: int  # and how many they are
    runs: int  # of partner i of the drive
    room: int  # 0: steps for which they hold; 1: as long as none is faster [m/s]
    rubbing: int  # tally of the powers that the roller's joints take [W]


ROWS = tuple(field.name for field in fields(Rows))
"""Names of a scratch's rows."""


@cache
def rows(capacity: int) -> Rows:
    """The rows of a scratch whose rows hold `capacity` values."""
    firsts = {name: k * capacity for k, name in enumerate(ROWS)}
    for name in ("link_x", "link_y"):
        firsts[name] += 15  # so that what stands at i + 1 begins with a cache line, at both precisions
    return type("Rows", (), firsts)


@cache
def passes(Real: type, capacity: int) -> SimpleNamespace:
    """The passes over the rollers of one variant, for rows of `capacity` values of type `Real`."""
    kinds = types(Real)
    Chain = kinds.Chain
    vec2 = kinds.vec2
    compensated = Real == wp.float32
    load_row, store_row, whole = accessors(Real).load_row, accessors(Real).store_row, whole_lanes(Real)
    row = rows(capacity)

    @wp.func
    def fetch(state: kinds.State, lengths: wp.array[Real], w: wp.array[Real], first: int, n: int):
        """The state's x, y, vx, vy, what joints hold and the links' lengths, of the variant whose rollers begin at
        `first`, into the scratch.
        """
        for k in range(STATE_ROWS):
            for i in range(n):
                w[k * wp.static(capacity) + i] = state.rollers[STATE_ROWS * first + k * n + i]
        for i in range(n):
            w[row.length + i] = lengths[first + i]
            w[row.joint_hold + i] = state.joint_hold[first + i]
        w[row.joint_hold + n] = state.joint_hold[first]
        for i in range(whole(n)):
            w[row.direction_of + i] = Real(-1.0)

    @wp.func
    def put_back(state: kinds.State, w: wp.array[Real], first: int, n: int):
        """These back into the state, lengths apart."""
        for k in range(STATE_ROWS):
            for i in range(n):
                state.rollers[STATE_ROWS * first + k * n + i] = w[k * wp.static(capacity) + i]
        for i in range(1, n):
            state.joint_hold[first + i] = w[row.joint_hold + i]
        state.joint_hold[first] = w[row.joint_hold + n]

    @wp.func
    def clear(w: wp.array[Real], first: int, second: int, n: int):
        """Sets two rows to zero, which begin at `first` and `second`."""
        i = int(0)
        while i < n:
            store_row(w, first + i, Real(0.0))
            store_row(w, second + i, Real(0.0))
            i = i + 1

    @wp.func
    def place(w: wp.array[Real], i: int):
        """Position of roller i in float64 [m]."""
        if wp.static(compensated):
            return wp.vec2d(
                wp.float64(load_row(w, row.x + i)) + wp.float64(load_row(w, row.x_low + i)),
                wp.float64(load_row(w, row.y + i)) + wp.float64(load_row(w, row.y_low + i)),
            )
        else:
            return wp.vec2d(wp.float64(load_row(w, row.x + i)), wp.float64(load_row(w, row.y + i)))

    @wp.func
    def apart(w: wp.array[Real], i: int):
        """Vector from roller i to roller i + 1 [m], exact at float32 too."""
        d = vec2(
            load_row(w, row.x + i + 1) - load_row(w, row.x + i), load_row(w, row.y + i + 1) - load_row(w, row.y + i)
        )
        if wp.static(compensated):
            d += vec2(
                load_row(w, row.x_low + i + 1) - load_row(w, row.x_low + i),
                load_row(w, row.y_low + i + 1) - load_row(w, row.y_low + i),
            )
        return d

    @wp.func
    def parting(w: wp.array[Real], i: int):
        """Velocity of roller i + 1 relative to roller i [m/s]."""
        return vec2(
            load_row(w, row.vx + i + 1) - load_row(w, row.vx + i), load_row(w, row.vy + i + 1) - load_row(w, row.vy + i)
        )

    @wp.func
    def store_link(w: wp.array[Real], i: int, tension: Real, rate: Real, u: vec2):
        """Tension and force of link i; contact forces start at zero."""
        store_row(w, row.tension + i, tension)
        store_row(w, row.rate + i, rate)
        store_row(w, row.link_x + i + 1, tension * u[0])
        store_row(w, row.link_y + i + 1, tension * u[1])
        store_row(w, row.fx + i, Real(0.0))
        store_row(w, row.fy + i, Real(0.0))

    @wp.func
    def move(w: wp.array[Real], i: int, dx: Real, dy: Real):
        """Roller i by (dx, dy) [m]; what float32 rounds off is kept in the low part."""
        if wp.static(compensated):
            x, x_low = compensated_sum(load_row(w, row.x + i), load_row(w, row.x_low + i), dx)
            y, y_low = compensated_sum(load_row(w, row.y + i), load_row(w, row.y_low + i), dy)
            store_row(w, row.x + i, x)
            store_row(w, row.y + i, y)
            store_row(w, row.x_low + i, x_low)
            store_row(w, row.y_low + i, y_low)
        else:
            store_row(w, row.x + i, load_row(w, row.x + i) + dx)
            store_row(w, row.y + i, load_row(w, row.y + i) + dy)

    @wp.func
    def close(w: wp.array[Real], n: int):
        """Makes roller 0 stand again as roller n."""
        store_row(w, row.x + n, load_row(w, row.x))
        store_row(w, row.y + n, load_row(w, row.y))
        store_row(w, row.vx + n, load_row(w, row.vx))
        store_row(w, row.vy + n, load_row(w, row.vy))
        if wp.static(compensated):
            store_row(w, row.x_low + n, load_row(w, row.x_low))
            store_row(w, row.y_low + n, load_row(w, row.y_low))

    @wp.func
    def link_pass(w: wp.array[Real], n: int, chain: Chain):
        """Tension and force of every link, eq. (2), (3), link i's at i + 1; contact forces start at zero."""
        close(w, n)
        i = int(0)
        while i < whole(n):
            d, v = apart(w, i), parting(w, i)
            tension, rate, u = link_force(d, v, load_row(w, row.length + i), chain)
            store_link(w, i, tension, rate, u)
            i = i + 1
        store_row(w, row.link_x, load_row(w, row.link_x + n))
        store_row(w, row.link_y, load_row(w, row.link_y + n))

    @wp.func
    def accelerations(w: wp.array[Real], i: int, inverse_mass: Real, gravity: vec2):
        """Acceleration of roller i [m/s^2] in x and y: its two links, its contacts and gravity."""
        x = load_row(w, row.link_x + i + 1) - load_row(w, row.link_x + i) + load_row(w, row.fx + i)
        y = load_row(w, row.link_y + i + 1) - load_row(w, row.link_y + i) + load_row(w, row.fy + i)
        return acceleration_component(x, inverse_mass, gravity[0]), acceleration_component(y, inverse_mass, gravity[1])

    @wp.func
    def acceleration(w: wp.array[Real], i: int, inverse_mass: Real, gravity: vec2):
        """The same as a vector."""
        ax, ay = accelerations(w, i, inverse_mass, gravity)
        return vec2(ax, ay)

    @wp.func
    def kick_drift(w: wp.array[Real], n: int, chain: Chain, kick: Real, h: Real):
        """v += kick a, then x += h v; who can come near a partner holds for a step less, or no longer."""
        inverse_mass = chain.inverse_mass
        limit = load_row(w, row.room + 1) * load_row(w, row.room + 1)
        fast = int(0)
        i = int(0)
        while i < whole(n):
            a = acceleration(w, i, inverse_mass, chain.gravity)
            vx = load_row(w, row.vx + i) + kick * a[0]
            vy = load_row(w, row.vy + i) + kick * a[1]
            store_row(w, row.vx + i, vx)
            store_row(w, row.vy + i, vy)
            move(w, i, h * vx, h * vy)
            square = vx * vx + vy * vy
            fast = fast | wp.where(square <= limit, 0, wp.where(i < n, 1, 0))
            i = i + 1
        store_row(w, row.room, wp.where(fast != 0, Real(0.0), load_row(w, row.room) - Real(1.0)))

    @wp.func
    def inside(w: wp.array[Real], n: int, low: wp.vec2d, high: wp.vec2d):
        """1 while every roller is finite and within the box, else 0."""
        good = int(1)
        i = int(0)
        while i < n:
            x = wp.float64(load_row(w, row.x + i))
            y = wp.float64(load_row(w, row.y + i))
            if not (x > low[0] and x < high[0] and y > low[1] and y < high[1]):
                good = int(0)
            i = i + 1
        return good

    return SimpleNamespace(**locals())
