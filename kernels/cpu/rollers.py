"""The CPU kernel's passes over the rollers of one variant: link forces, teeth, kick and drift.

The rollers lie in a scratch of rows of constant length (`rows`), read and written through `load_row` and `store_row`,
which tell the compiler that neighbors in a row are neighbors in memory; with plain loops (`while`, not `range`) it then
vectorizes the passes without branches: 1,080 million link forces a second on one core with AVX-512, against 115 with
Warp's strided array indexing (docs/performance.md).
"""

from dataclasses import dataclass, fields
from functools import cache

import warp as wp

from ..physics.link import link_force
from ..physics.roller import acceleration_along, two_sum
from ..rows import STATE_ROWS, accessors, whole_lanes
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
    bend_x: int  # n / L of link i at i + 1 [1/m], then the force of its joints' couple on roller i [N]
    bend_y: int
    x0: int  # rk4: the state at the step's start
    y0: int
    vx0: int
    vy0: int
    x0_low: int
    y0_low: int
    sum_x: int  # rk4: sums of weighted slopes
    sum_y: int
    sum_vx: int
    sum_vy: int
    before: int  # of contacts with the partner at hand (`contacts`): v0 until now [m/s]
    near: int  # 1: near the partner at hand, else 0
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
    penetration: int  # [m]
    normal_x: int  # towards the roller
    normal_y: int
    relative_x: int  # velocity of the partner's material point less the roller's [m/s]
    relative_y: int
    open: int  # v0 kept if there is no contact [m/s]
    kept: int  # v0 kept [m/s]
    press_x: int  # force on the roller [N]
    press_y: int
    size: int  # of the normal force [N]
    damper: int  # what of it damps [N]
    drag_x: int  # friction [N]
    drag_y: int
    moment_of: int  # on the partner's body [N m]
    damped: int  # power that dampers take [W]
    rubbed: int  # power of friction [W]
    least: int  # of links since their tallies were merged: least and greatest tension [N]
    greatest: int
    rates: int  # weighted sum of squares of rates of elongation
    strand: int  # that the link is on
    run_first: int  # of runs of rollers that can come near a partner soon (`runs`): the first roller
    run_count: int  # and how many they are
    runs: int  # of partner i of the drive
    room: int  # 0: steps for which they hold; 1: as long as none is faster [m/s]


ROWS = tuple(field.name for field in fields(Rows))
"""Names of a scratch's rows."""


@cache
def rows(capacity: int) -> Rows:
    """The rows of a scratch whose rows hold `capacity` values."""
    firsts = {name: k * capacity for k, name in enumerate(ROWS)}
    for name in ("link_x", "link_y"):
        firsts[name] += 15  # so that what stands at i + 1 begins with a cache line, at both precisions
    return Rows(**{name: wp.constant(first) for name, first in firsts.items()})


@dataclass(frozen=True)
class Passes:
    """The passes over the rollers of one variant."""

    fetch: wp.Function
    put_back: wp.Function
    close: wp.Function
    apart: wp.Function
    parting: wp.Function
    store_link: wp.Function
    move: wp.Function
    link_pass: wp.Function
    place: wp.Function
    accelerations: wp.Function
    acceleration: wp.Function
    kick_drift: wp.Function
    inside: wp.Function


@cache
def passes(Real: type, capacity: int) -> Passes:
    """The passes over the rollers of one variant, for rows of `capacity` values of type `Real`."""
    kinds = types(Real)
    vec2 = kinds.vec2
    compensated = Real == wp.float32
    load_row, store_row, whole = accessors(Real).load_row, accessors(Real).store_row, whole_lanes(Real)
    at = rows(capacity)
    X, Y, VX, VY, X_LOW, Y_LOW, LINK_X, LINK_Y = at.x, at.y, at.vx, at.vy, at.x_low, at.y_low, at.link_x, at.link_y
    LENGTH, FX, FY, TENSION, RATE, DIRECTION_OF = at.length, at.fx, at.fy, at.tension, at.rate, at.direction_of
    ROOM = at.room

    @wp.func
    def fetch(rollers: wp.array[Real], lengths: wp.array[Real], w: wp.array[Real], first: int, n: int):
        """The state's x, y, vx, vy and the links' lengths, of the variant whose rollers begin at `first`, into the
        scratch.
        """
        for row in range(STATE_ROWS):
            for i in range(n):
                w[row * wp.static(capacity) + i] = rollers[STATE_ROWS * first + row * n + i]
        for i in range(n):
            w[LENGTH + i] = lengths[first + i]
        for i in range(whole(n)):
            w[DIRECTION_OF + i] = Real(-1.0)

    @wp.func
    def put_back(rollers: wp.array[Real], w: wp.array[Real], first: int, n: int):
        """The scratch's x, y, vx, vy back into the state."""
        for row in range(STATE_ROWS):
            for i in range(n):
                rollers[first + row * n + i] = w[row * wp.static(capacity) + i]

    @wp.func
    def place(w: wp.array[Real], i: int):
        """Position of roller i in float64 [m]."""
        if wp.static(compensated):
            return wp.vec2d(
                wp.float64(load_row(w, X + i)) + wp.float64(load_row(w, X_LOW + i)),
                wp.float64(load_row(w, Y + i)) + wp.float64(load_row(w, Y_LOW + i)),
            )
        else:
            return wp.vec2d(wp.float64(load_row(w, X + i)), wp.float64(load_row(w, Y + i)))

    @wp.func
    def apart(w: wp.array[Real], i: int):
        """Vector from roller i to roller i + 1 [m], exact at float32 too."""
        d = vec2(load_row(w, X + i + 1) - load_row(w, X + i), load_row(w, Y + i + 1) - load_row(w, Y + i))
        if wp.static(compensated):
            d += vec2(
                load_row(w, X_LOW + i + 1) - load_row(w, X_LOW + i), load_row(w, Y_LOW + i + 1) - load_row(w, Y_LOW + i)
            )
        return d

    @wp.func
    def parting(w: wp.array[Real], i: int):
        """Velocity of roller i + 1 relative to roller i [m/s]."""
        return vec2(load_row(w, VX + i + 1) - load_row(w, VX + i), load_row(w, VY + i + 1) - load_row(w, VY + i))

    @wp.func
    def store_link(w: wp.array[Real], i: int, tension: Real, rate: Real, u: vec2):
        """Tension and force of link i; contact forces start at zero."""
        store_row(w, TENSION + i, tension)
        store_row(w, RATE + i, rate)
        store_row(w, LINK_X + i + 1, tension * u[0])
        store_row(w, LINK_Y + i + 1, tension * u[1])
        store_row(w, FX + i, Real(0.0))
        store_row(w, FY + i, Real(0.0))

    @wp.func
    def move(w: wp.array[Real], i: int, dx: Real, dy: Real):
        """Roller i by (dx, dy) [m]; what float32 rounds off is kept in the low part."""
        if wp.static(compensated):
            x, x_low = two_sum(load_row(w, X + i), load_row(w, X_LOW + i), dx)
            y, y_low = two_sum(load_row(w, Y + i), load_row(w, Y_LOW + i), dy)
            store_row(w, X + i, x)
            store_row(w, Y + i, y)
            store_row(w, X_LOW + i, x_low)
            store_row(w, Y_LOW + i, y_low)
        else:
            store_row(w, X + i, load_row(w, X + i) + dx)
            store_row(w, Y + i, load_row(w, Y + i) + dy)

    @wp.func
    def close(w: wp.array[Real], n: int):
        """Makes roller 0 stand again as roller n."""
        store_row(w, X + n, load_row(w, X))
        store_row(w, Y + n, load_row(w, Y))
        store_row(w, VX + n, load_row(w, VX))
        store_row(w, VY + n, load_row(w, VY))
        if wp.static(compensated):
            store_row(w, X_LOW + n, load_row(w, X_LOW))
            store_row(w, Y_LOW + n, load_row(w, Y_LOW))

    @wp.func
    def link_pass(w: wp.array[Real], n: int, chain: kinds.Chain):
        """Tension and force of every link, eq. (2), (3), link i's at i + 1; contact forces start at zero."""
        close(w, n)
        i = int(0)
        while i < whole(n):
            d, v = apart(w, i), parting(w, i)
            tension, rate, u = link_force(d, v, load_row(w, LENGTH + i), chain.stiffness, chain.damping)
            store_link(w, i, tension, rate, u)
            i = i + 1
        store_row(w, LINK_X, load_row(w, LINK_X + n))
        store_row(w, LINK_Y, load_row(w, LINK_Y + n))

    @wp.func
    def accelerations(w: wp.array[Real], i: int, inverse_mass: Real, gravity: vec2):
        """Acceleration of roller i [m/s^2] in x and y: its two links, its contacts and gravity."""
        x = load_row(w, LINK_X + i + 1) - load_row(w, LINK_X + i) + load_row(w, FX + i)
        y = load_row(w, LINK_Y + i + 1) - load_row(w, LINK_Y + i) + load_row(w, FY + i)
        return acceleration_along(x, inverse_mass, gravity[0]), acceleration_along(y, inverse_mass, gravity[1])

    @wp.func
    def acceleration(w: wp.array[Real], i: int, inverse_mass: Real, gravity: vec2):
        """The same as a vector."""
        ax, ay = accelerations(w, i, inverse_mass, gravity)
        return vec2(ax, ay)

    @wp.func
    def kick_drift(w: wp.array[Real], n: int, chain: kinds.Chain, kick: Real, h: Real):
        """v += kick a, then x += h v; who can come near a partner holds for a step less, or no longer."""
        inverse_mass = chain.inverse_mass
        limit = load_row(w, ROOM + 1) * load_row(w, ROOM + 1)
        fast = int(0)
        i = int(0)
        while i < whole(n):
            a = acceleration(w, i, inverse_mass, chain.gravity)
            vx = load_row(w, VX + i) + kick * a[0]
            vy = load_row(w, VY + i) + kick * a[1]
            store_row(w, VX + i, vx)
            store_row(w, VY + i, vy)
            move(w, i, h * vx, h * vy)
            square = vx * vx + vy * vy
            fast = fast | wp.where(square <= limit, 0, wp.where(i < n, 1, 0))
            i = i + 1
        store_row(w, ROOM, wp.where(fast != 0, Real(0.0), load_row(w, ROOM) - Real(1.0)))

    @wp.func
    def inside(w: wp.array[Real], n: int, low: wp.vec2d, high: wp.vec2d):
        """1 while every roller is finite and within the box, else 0."""
        good = int(1)
        i = int(0)
        while i < n:
            x = wp.float64(load_row(w, X + i))
            y = wp.float64(load_row(w, Y + i))
            if not (x > low[0] and x < high[0] and y > low[1] and y < high[1]):
                good = int(0)
            i = i + 1
        return good

    return Passes(
        fetch=fetch,
        put_back=put_back,
        close=close,
        apart=apart,
        parting=parting,
        store_link=store_link,
        move=move,
        link_pass=link_pass,
        place=place,
        accelerations=accelerations,
        acceleration=acceleration,
        kick_drift=kick_drift,
        inside=inside,
    )
