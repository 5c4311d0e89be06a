"""Checks of a drive's layout before a run: faults, and advice."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly.arm_balance import chain_path, has_reached_stops, is_unloaded_arm, stop_name
from warpchain.assembly.guide_obstacles import BEHIND, OWN, cross, dot, nearest_strand
from warpchain.assembly.path import ChainPath
from warpchain.assembly.strength import HardestPull, strength_advice
from warpchain.drive.catalogue import ELONGATION_AT_BREAKING_LOAD
from warpchain.drive.stack_math import Condition, array_of_columns, with_last_axis
from warpchain.drive.tensioners import Tensioner
from warpchain.model import ChainModel
from warpchain.model.oil import filled_tensioner, filling_time, outlet_flows, static_pressure

if TYPE_CHECKING:
    from warpchain.assembly.taut_string import GuideTouch
    from warpchain.drive import Guide

Point = tuple[float, float]
Strand = tuple[Point, Point]


def layout_faults(model: ChainModel, path: ChainPath | None = None) -> tuple[str, ...]:
    """Faults of a drive's layout, a line each, with the remedy.

    Args:
        path: the chain's path, if known.

    Raises:
        DriveError: a path that cannot be drawn.
    """
    path = chain_path(model) if path is None else path
    strands = _strand_ends(model, path)
    found = [
        _crossing_fault(model, path, k, m, place)
        for k, m in combinations(range(len(strands)), 2)
        if (place := strand_crossing(strands[k], strands[m])) is not None
    ]
    for g, guide in enumerate(model.guides):
        if guide.straight and guide.arm is None:
            found += _bar_faults(model, guide, strands)
        else:
            found += _face_faults(model, path, g, strands)
    found += [line for a in range(len(model.arms)) if (line := _stop_fault(model, path, a)) is not None]
    return tuple(found)


def has_possible_faults(model: ChainModel, path: ChainPath) -> NDArray[np.bool_]:
    """Whether a layout may have faults, of each variant (V,) of a stack."""
    start, end = path.strand_start, path.strand_end
    found = np.zeros(len(start), dtype=bool)
    chord = end - start
    for k, m in combinations(range(start.shape[1]), 2):
        apart = start[:, m] - start[:, k]
        turn = cross(chord[:, k], chord[:, m])
        with np.errstate(divide="ignore", invalid="ignore"):
            here, there = cross(apart, chord[:, m]) / turn, cross(apart, chord[:, k]) / turn
        found |= (here > 0.0) & (here < 1.0) & (there > 0.0) & (there < 1.0)
    for g, guide in enumerate(model.guides):
        if guide.straight and guide.arm is None:
            found |= _has_possible_bar_faults(model, g, start, end)
        else:
            found |= ~_is_touching_guide(model, path, g)
    for a, arm in enumerate(model.arms):
        lower, upper = has_reached_stops(arm, path.arm_angle[:, a])
        found |= lower | upper
    return found


def _is_touching_guide(model: ChainModel, path: ChainPath, g: int) -> Condition:
    """Whether a chain touches guide g between its rounded ends, () or (V,)."""
    length, found = model.profile(g).face_length, False
    for first, last in (touch.places for touch in _guide_touches(path, g)):
        found = found | ((last > 0.0) & (first < length))
    return np.asarray(found)


def _guide_touches(path: ChainPath, g: int) -> list[GuideTouch]:
    """Touches of a chain's strings on guide g."""
    return [touch for string in path.strings if string is not None for touch in string.touches if touch.arc.guide == g]


def _has_possible_bar_faults(
    model: ChainModel, g: int, start: NDArray[np.float64], end: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Whether straight bar g may have layout faults (V,)."""
    bar, chain = model.guides[g].bar, model.chain
    a, face = array_of_columns(bar.start), array_of_columns(bar.end) - array_of_columns(bar.start)
    length = np.atleast_1d(np.hypot(face[..., 0], face[..., 1]))[:, None]
    a, t = np.atleast_2d(a)[:, None], np.atleast_2d(face)[:, None] / length[..., None]
    (first, last), (above, below) = (
        (of(start - a, t), of(end - a, t)) for of in (dot, lambda place, way: cross(way, place))
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = np.stack([(0.0 - first) / (last - first), (length - first) / (last - first)])
    begin, stop = np.maximum(0.0, shares.min(axis=0)), np.minimum(1.0, shares.max(axis=0))
    level = first == last
    beside = np.where(level, (first >= 0.0) & (first <= length), begin < stop)
    begin, stop = np.where(level, 0.0, begin), np.where(level, 1.0, stop)
    ends = np.stack([above + begin * (below - above), above + stop * (below - above)])
    front, depth = ends.max(axis=0), with_last_axis(chain.roller_radius) - ends.min(axis=0)
    deep = beside & (depth > with_last_axis(chain.pitch))
    cuts = deep & (front > 0.0)
    apart = np.where(beside & ~cuts, np.maximum(ends.sum(axis=0), -BEHIND * ends.sum(axis=0)), np.inf)
    own = np.arange(len(apart)), apart.argmin(axis=1)
    return np.asarray(cuts.any(axis=1) | (deep[own] & (front[own] <= 0.0)))


def _face_faults(model: ChainModel, path: ChainPath, g: int, strands: list[Strand]) -> list[str]:
    """Layout faults of curved or carried guide g, a line each."""
    if _is_touching_guide(model, path, g):
        return []
    guide, touches = model.guides[g], _guide_touches(path, g)
    hollow = sum(piece.curvature * piece.length for piece in model.profile(g).face) > 0.0
    nearest = nearest_strand(model, g, strands)
    if hollow and nearest is not None and (touches or nearest[2] < 0.0):
        other = "left" if guide.side == "right" else "right"
        return [
            f'guides.{guide.name}: its face is turned away from strand "{model.strand_names[nearest[0]]}": the chain '
            f'rides on the {guide.side or "left"} of its line; set side = "{other}", or run the line the other way'
        ]
    if nearest is None:
        return [f"guides.{guide.name}: no strand passes it: none runs along its face; move or turn it, or look at side"]
    k, _, height = nearest
    if not touches and abs(height) > OWN * math.dist(*strands[k]):
        return [
            f'guides.{guide.name}: no strand passes it: the nearest, "{model.strand_names[k]}", is {abs(height):.4g} m '
            f"{'off' if height > 0.0 else 'behind'} its face; move it, or look at side"
        ]
    return []


def _stop_fault(model: ChainModel, path: ChainPath, a: int) -> str | None:
    """Layout fault of arm a on a stop; None off its stops."""
    angle, arm = float(path.arm_angle[a]), model.arms[a]
    stop = stop_name(model, a, angle)
    if stop is None or arm.stops is None:
        return None
    return (
        f"arms.{arm.name}: stands on its {stop} stop at assembly, at {math.degrees(angle):.4g} of {arm.stops[0]:g} to "
        f"{arm.stops[1]:g} degrees, and takes up nothing beyond it: look at chain.links, at its stops, and at the "
        "springs and tensioners that turn it"
    )


def _strand_ends(model: ChainModel, path: ChainPath) -> list[Strand]:
    """Ends of the straight strands [m], as plain numbers."""
    ends = zip(path.strand_start.tolist(), path.strand_end.tolist(), strict=True)
    return [((x, y), (u, v)) for (x, y), (u, v) in ends][: len(model.strand_names)]


def strand_crossing(one: Strand, other: Strand) -> Point | None:
    """Point at which two strands cross [m], touching ends aside; None without one."""
    (ax, ay), (bx, by) = one
    (cx, cy), (dx, dy) = other
    ux, uy, vx, vy, wx, wy = bx - ax, by - ay, dx - cx, dy - cy, cx - ax, cy - ay
    turn = ux * vy - uy * vx
    if turn == 0.0:
        return None
    here, there = (wx * vy - wy * vx) / turn, (wx * uy - wy * ux) / turn
    if not (0.0 < here < 1.0 and 0.0 < there < 1.0):
        return None
    return ax + here * ux, ay + here * uy


def _crossing_fault(model: ChainModel, path: ChainPath, k: int, m: int, place: Point) -> str:
    """Layout fault of strands k and m that cross at a place."""
    ends = dict.fromkeys(s % len(model.sprockets) for s in (k, k + 1, m, m + 1))
    most = max(ends, key=lambda s: float(path.wrap_angle[s]))
    names = model.strand_names
    return (
        f'strands "{names[k]}" and "{names[m]}" cross at ({place[0]:.4g}, {place[1]:.4g}) m; no chain runs through '
        f'itself: look at wrap and center of "{model.sprockets[most].name}", around which it turns '
        f"{math.degrees(path.wrap_angle[most]):.0f} degrees, or at the order of the sprockets"
    )


def _bar_faults(model: ChainModel, guide: Guide, strands: list[Strand]) -> list[str]:
    """Layout faults of a straight bar, a line each."""
    (ax, ay), (bx, by), _ = guide.bar
    length = math.hypot(bx - ax, by - ay)
    tx, ty = (bx - ax) / length, (by - ay) / length
    radius, pitch = model.chain.roller_radius, model.chain.pitch
    lines: list[str] = []
    nearest, own = math.inf, ""
    for k, ((sx, sy), (ex, ey)) in enumerate(strands):
        first, last = (sx - ax) * tx + (sy - ay) * ty, (ex - ax) * tx + (ey - ay) * ty
        begin, end = _shares_within(first, last, length)
        if begin >= end:
            continue
        above, below = (sy - ay) * tx - (sx - ax) * ty, (ey - ay) * tx - (ex - ax) * ty
        ends = above + begin * (below - above), above + end * (below - above)
        front, depth = max(ends), radius - min(ends)
        if front > 0.0 and depth > pitch:
            share = begin + (end - begin) * ends[0] / (ends[0] - ends[1])
            x, y = sx + share * (ex - sx), sy + share * (ey - sy)
            lines.append(
                f"{_guide_fault_text(model, guide, 'cuts through', k)} at ({x:.4g}, {y:.4g}) m, which is {front:.4g} m "
                f"in front of it at one place and {-min(ends):.4g} m behind it at another: turn the bar along the "
                "strand, or shorten it (start, end)"
            )
        elif (apart := max(sum(ends), -BEHIND * sum(ends))) < nearest:
            nearest = apart
            strand = math.hypot(ex - sx, ey - sy)
            if not (front <= 0.0 and depth > pitch and -front < OWN * strand):
                own = ""
                continue
            away = f"move start and end back by {depth:.4g} m, or swap them if the chain rides on the other side"
            size = f"by {depth:.4g} m, {depth / pitch:.2g} pitches, out of its straight line"
            own = f"{_guide_fault_text(model, guide, 'dents', k)} {size}: {away}"
    return [*lines, own] if own else lines


def _guide_fault_text(model: ChainModel, guide: Guide, does: str, k: int) -> str:
    """First words of a layout fault of a guide and strand k."""
    return f'guides.{guide.name}: its face {does} strand "{model.strand_names[k]}"'


def _shares_within(first: float, last: float, length: float) -> tuple[float, float]:
    """Begin and end, from 0 to 1, of a line's part with values from 0 to `length`."""
    if first == last:
        return (0.0, 1.0) if 0.0 <= first <= length else (1.0, 0.0)
    shares = sorted(((0.0 - first) / (last - first), (length - first) / (last - first)))
    return max(0.0, shares[0]), min(1.0, shares[1])


LEAST_WRAP = 90.0
"""Least wrap of a sprocket that passes on a moment [degrees]."""
LEAST_TEETH = 3.0
"""Least number of teeth in mesh of an idler."""
NEAR = 0.5
"""Farthest that a strand may be off a straight bar, in pitches."""


def layout_advice(
    model: ChainModel,
    path: ChainPath | None = None,
    tensions: Sequence[float] = (),
    working: ChainPath | None = None,
    run_up: HardestPull | None = None,
) -> tuple[str, ...]:
    """Advice on a drive's layout, a line each, with the remedy.

    Args:
        path: the chain's path, if known.
        tensions: of the strands at work, if known [N].
        working: the path at work, if known.
        run_up: the largest tension on the way to work, if larger.

    Raises:
        DriveError: a path that cannot be drawn.
    """
    path = chain_path(model) if path is None else path
    shoes = _shoe_advice(model, path if working is None else working)
    return (
        *_wrap_advice(model, path),
        *_bar_advice(model, path),
        *shoes,
        *idle_arm_advice(model, path),
        *(line for tensioner in model.tensioners if tensioner.hydraulic for line in _oil_advice(model, tensioner)),
        *strength_advice(model, tensions, run_up),
    )


def _wrap_advice(model: ChainModel, path: ChainPath) -> list[str]:
    """Layout advice on small angles of wrap and few teeth in mesh."""
    lines = []
    for s, sprocket in enumerate(model.sprockets):
        if sprocket.is_end:
            continue
        wrap = math.degrees(float(path.wrap_angle[s]))
        mesh = sprocket.teeth * wrap / 360.0
        if sprocket.prescribed is not None or sprocket.load is not None or sprocket.shaft is not None:
            if wrap < LEAST_WRAP:
                lines.append(
                    f"sprockets.{sprocket.name}: passes on a moment with {wrap:.0f} degrees of wrap, where "
                    f"{LEAST_WRAP:g} are the least ({mesh:.1f} teeth in mesh): move it or its neighbors"
                )
        elif mesh < LEAST_TEETH:
            lines.append(
                f"sprockets.{sprocket.name}: {mesh:.1f} teeth in mesh ({wrap:.0f} degrees), where an idler wants "
                f"{LEAST_TEETH:g}: rollers hammer it one by one; push it further into the chain, or give it more teeth"
            )
    return lines


def _bar_advice(model: ChainModel, path: ChainPath) -> list[str]:
    """Layout advice on straight bars that strands miss."""
    lines = []
    radius, pitch = model.chain.roller_radius, model.chain.pitch
    for guide in model.guides:
        if guide.start is None or guide.end is None or guide.arm is not None:
            continue
        (ax, ay), (bx, by) = guide.start, guide.end
        length = math.hypot(bx - ax, by - ay)
        tx, ty = (bx - ax) / length, (by - ay) / length
        gaps = []
        for k, ((sx, sy), (ex, ey)) in enumerate(zip(path.strand_start, path.strand_end, strict=True)):
            first, last = (sx - ax) * tx + (sy - ay) * ty, (ex - ax) * tx + (ey - ay) * ty
            ends = [(sy - ay) * tx - (sx - ax) * ty, (ey - ay) * tx - (ex - ax) * ty]
            begin, end = _shares_within(first, last, length)
            if first != last and begin < end:
                # of rollers that ride on the face the center is a radius in front of it
                gaps.append((min(ends[0] + share * (ends[1] - ends[0]) for share in (begin, end)) - radius, k))
        nearest = min(gaps, key=lambda gap: abs(gap[0]), default=None)
        if nearest is None:
            lines.append(f"guides.{guide.name}: misses the chain: no strand passes over its face; move start and end")
            continue
        gap, k = nearest
        named = f'strand "{model.strand_names[k]}"'
        if gap > NEAR * pitch:
            lines.append(
                f"guides.{guide.name}: misses the chain: its face stands {1e3 * gap:.3g} mm, {gap / pitch:.2g} "
                f"pitches, off {named}; move start and end toward it unless it is there to catch swings"
            )
        elif -pitch <= gap < -NEAR * pitch:
            lines.append(
                f"guides.{guide.name}: dents {named} by {-1e3 * gap:.3g} mm, {-gap / pitch:.2g} pitches: its ends bear "
                "hard; move start and end back, or take a curved face"
            )
    return lines


def _shoe_advice(model: ChainModel, path: ChainPath) -> list[str]:
    """Layout advice on curved and carried guides."""
    lines = []
    strands = _strand_ends(model, path)
    for g, guide in enumerate(model.guides):
        if guide.straight and guide.arm is None:
            continue
        length = 1e3 * model.profile(g).face_length
        places = [1e3 * place for touch in _guide_touches(path, g) for place in touch.places]
        if places and (min(places) < 0.0 or max(places) > length):
            ends = " and ".join(["its start"] * (min(places) < 0.0) + ["its end"] * (max(places) > length))
            lines.append(
                f"guides.{guide.name}: the chain runs off {ends}: it lies on {min(places):.1f} to {max(places):.1f} mm "
                f"of a face of {length:.1f} mm, so on a rounded end of "
                f"{1e3 * (guide.end_radius or model.chain.pitch):.3g} mm radius, which bears hard: lengthen the face, "
                "or move or turn it"
            )
        elif not places and not _face_faults(model, path, g, strands):
            nearest = nearest_strand(model, g, strands)
            assert nearest is not None  # else that would be a fault
            lines.append(
                f'guides.{guide.name}: never touches the chain: strand "{model.strand_names[nearest[0]]}" passes '
                f"{1e3 * nearest[2]:.3g} mm off its face in the mean; move it toward the strand unless it is there to "
                "catch swings"
            )
    return lines


def strain_advice(model: ChainModel, strain: float) -> list[str]:
    """Layout advice on a chain that assembly stretches beyond its breaking load."""
    if strain <= ELONGATION_AT_BREAKING_LOAD:
        return []
    preload = model.chain.mean_stiffness * model.chain.pitch * strain
    return [
        f"chain: strain {100.0 * strain:+.2f} % at assembly, a preload of {preload:.4g} N, where chains break at about "
        f"{100.0 * ELONGATION_AT_BREAKING_LOAD:g} %: take more links, or move a sprocket (warpchain fit)"
    ]


MOST_VENTED = 0.5
"""Largest part of a tensioner's pressure at rest that a vent may take."""


def _oil_advice(model: ChainModel, tensioner: Tensioner) -> list[str]:
    """Layout advice on a tensioner's relief valve, vent, supply and filling."""
    oil, relief, lines, name = tensioner.oil, tensioner.relief, [], f"tensioners.{tensioner.name}"
    assert oil is not None
    rest = static_pressure(filled_tensioner(tensioner))
    relieved, vented = outlet_flows(tensioner, rest)
    if relief is not None and relieved > 0.0:
        lines.append(
            f"{name}.relief: stands open at rest and lets out {1e9 * relieved:.3g} mm^3/s: it opens at "
            f"{1e-5 * relief.pressure:.4g} bar, the supply has {1e-5 * oil.supply:.4g}; raise its pressure"
        )
    shut = static_pressure(filled_tensioner(tensioner).model_copy(update={"vent": None}))
    if vented > 0.0 and rest - oil.ambient < (1.0 - MOST_VENTED) * (shut - oil.ambient):
        lines.append(
            f"{name}.vent: lets out {1e9 * vented:.3g} mm^3/s at rest, and the pressure falls from "
            f"{1e-5 * shut:.4g} to {1e-5 * rest:.4g} bar: take a smaller diameter, or a wider check valve"
        )
    time = filling_time(tensioner)
    if tensioner.is_drained and time > model.run.duration:
        takes = f"takes {time:.3g} s or more to fill it" if math.isfinite(time) else "does not open the check valve"
        lines.append(
            f"{name}.chamber.drained: oil does not carry the plunger within the run of {model.run.duration:g} s: the "
            f"supply {takes}; raise it, or run longer"
        )
    table = oil.supply_table
    if not tensioner.is_drained and table is not None and table.time is not None:
        start = float(np.interp(0.0, table.over, table.values))
        if abs(start - oil.supply) > 1e-3 * oil.supply:
            lines.append(
                f"{name}.oil.supply_table: begins at {1e-5 * start:.4g} bar, where the drive stands at rest with "
                f"{1e-5 * oil.supply:.4g}: the pressure jumps as the run begins; make supply the same"
            )
    return lines


def idle_arm_advice(model: ChainModel, path: ChainPath) -> list[str]:
    """Layout advice on arms that stand where they would without a chain."""
    return [
        f"arms.{arm.name}: stands at {math.degrees(angle):.4g} degrees, as it would without a chain"
        f"{', its free angle' if arm.stiffness > 0.0 else ''}: it presses on nothing; take fewer links, or let its "
        "spring (free_angle, stiffness) or a tensioner press it further into the chain"
        for a, (arm, angle) in enumerate(zip(model.arms, path.arm_angle.tolist(), strict=True))
        if stop_name(model, a, angle) is None and is_unloaded_arm(model, a, angle)
    ]
