"""Which sprockets and guide-bars rollers may touch, and where rollers are seen from these."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from ..physics.face import in_body, near_face
from ..physics.profile import in_frame, near_profile
from ..physics.seat import away, near_line
from ..root import inside
from ..rows import accessors
from ..structs import types
from .block_kind import BlockKind
from .block_rows import block_rows
from .block_wheels import box_of, gears, load_line, load_wheel


@dataclass(frozen=True)
class NearFunctions:
    """Which partners are near, as functions of kernels; `SPROCKETS` are those partners' bits."""

    SPROCKETS: int
    near: wp.Function
    bar_of: wp.Function
    away_from: wp.Function
    in_carrier: wp.Function


@cache
def block_near(kind: BlockKind) -> NearFunctions:
    """The functions that tell what the rollers of one variant on a block may touch."""
    Real, sprockets, guides, bodies, profiles = kind.Real, kind.sprockets, kind.guides, kind.bodies, kind.profiles
    kinds = types(Real)
    vec2 = kinds.vec2
    row = block_rows(kind)
    place, X, Y, X_LOW, Y_LOW = row.place, row.X, row.Y, row.X_LOW, row.Y_LOW
    load_row, load_bar = accessors(Real).load_row, gears(kind).load_bar
    SPROCKETS = wp.constant((1 << sprockets) - 1)

    @wp.func
    def by_profile(bar: kinds.Guide):
        """Whether a guide has a profile."""
        if wp.static(profiles):
            return bar.pieces != 0
        else:
            return False

    @wp.func
    def bar_of(shared: kinds.Shared, g: int):
        """Guide g."""
        if wp.static(kind.paired and not profiles):
            return load_bar(shared.lines, g)
        else:
            return shared.bars[g]

    @wp.func
    def away_from(rows: wp.array[Real], j: int, center: vec2, low: vec2):
        """Roller j from a center, at float32."""
        return away(row.position(rows, j), vec2(load_row(rows, X_LOW + j), load_row(rows, Y_LOW + j)), center, low)

    @wp.func
    def in_carrier(shared: kinds.Shared, j: int, b: int):
        """Roller j from the center of body b that carries a guide, and in that body's frame, at float32."""
        carrier = load_wheel(shared.wheels, b)
        arm = away_from(shared.rows, j, carrier.center, carrier.center_low)
        q = arm
        if b < wp.static(bodies):  # the ground has not turned
            q = in_body(arm, carrier)
        return arm, q

    @wp.func
    def in_box_of(shared: kinds.Shared, j: int, g: int, bar: kinds.Guide):
        """1 where roller j is in the box about the chord of guide g, a profile."""
        if wp.static(kind.paired):
            arm, q = in_carrier(shared, j, bar.body)
            return near_face(q, load_line(shared.lines, g), box_of(shared.lines, g))
        else:
            pose = shared.poses[bar.body]
            return near_profile(in_frame(place(shared.rows, j, pose.center), pose), bar)

    @wp.func
    def near(shared: kinds.Shared, j: int, n: int):
        """The partners that roller j may touch, as bits: sprockets whose band it is in, guide-bars it is on."""
        rows = shared.rows
        x = load_row(rows, X + j)
        y = load_row(rows, Y + j)
        mask = int(0)
        for s in range(wp.static(sprockets)):
            band = shared.bands[s]
            from_x = x - band.center[0]
            from_y = y - band.center[1]
            square = from_x * from_x + from_y * from_y
            mask = mask | (inside(square, band.near_square, band.far_square) << s)
        for g in range(wp.static(guides)):
            bar = bar_of(shared, g)
            if by_profile(bar):
                mask = mask | (in_box_of(shared, j, g, bar) << (wp.static(sprockets) + g))
            elif wp.static(kind.paired):
                line = load_line(shared.lines, g)
                along_x = (x - line.start[0]) + (load_row(rows, X_LOW + j) - line.start_low[0])
                along_y = (y - line.start[1]) + (load_row(rows, Y_LOW + j) - line.start_low[1])
                mask = mask | (near_line(along_x, along_y, line, bar) << (wp.static(sprockets) + g))
            else:
                p = place(rows, j, bar.start)
                along = Real(wp.dot(p, bar.direction))
                across = Real(p[1] * bar.direction[0] - p[0] * bar.direction[1])
                reach = bar.end_radius + bar.roller_radius
                on_it = inside(across, -bar.end_radius, bar.roller_radius) & inside(along, -reach, bar.length + reach)
                mask = mask | (on_it << (wp.static(sprockets) + g))
        return wp.where(j < n, mask, 0)

    return NearFunctions(SPROCKETS=SPROCKETS, near=near, bar_of=bar_of, away_from=away_from, in_carrier=in_carrier)
