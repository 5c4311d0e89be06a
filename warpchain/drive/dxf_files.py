"""Contours of DXF drawings, entities end to end: open faces of guides, closed teeth of sprockets."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import count, islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpchain.errors import DriveError, WarpchainError
from warpchain.extras import require_extra
from warpchain.files import check_file_size

Array = NDArray[np.float64]

GAP = 2e-6
"""Largest distance of two ends that join [m]."""
SAG = 1e-6
"""Largest distance of a curve from points [m]."""
STRETCHES, MOST_STRETCHES = 40, 800
"""Parts of a straight piece, and the most of all."""
MOST_LOOSE = 1000
"""Most loose ends whose narrowest gap is sought."""
ALIKE = 2e-5
"""Largest difference of like teeth, and spline and arc [m]."""
CORNER = math.radians(2.0)
"""Largest corner between seat and flank [rad]."""
STRAIGHT = 1e3
"""Radius that counts as a straight line [m]."""
KINDS = ("LINE", "ARC", "LWPOLYLINE", "POLYLINE", "ELLIPSE", "SPLINE")
INSUNITS = (
    "", "in", "ft", "mile", "mm", "cm", "m", "km", "microinch", "mil", "yd", "angstrom", "nm", "um", "dm", "dam", "hm",
    "Gm", "au", "ly", "pc", "US survey ft", "US survey in", "US survey yd", "US survey mile",
)  # fmt: skip
"""Units of drawings by DXF's number; 0 is none."""
LENGTHS = {
    "in": 0.0254, "ft": 0.3048, "mile": 1609.344, "mm": 1e-3, "cm": 1e-2, "m": 1.0, "km": 1e3, "microinch": 2.54e-8,
    "mil": 2.54e-5, "yd": 0.9144, "angstrom": 1e-10, "nm": 1e-9, "um": 1e-6, "dm": 0.1, "dam": 10.0, "hm": 100.0,
    "Gm": 1e9, "au": 149597870700.0, "ly": 9460730472580800.0, "pc": 3.0856775814913673e16,
    "US survey ft": 1200 / 3937, "US survey in": 100 / 3937, "US survey yd": 3600 / 3937,
    "US survey mile": 6336000 / 3937,
}  # fmt: skip
"""Meters of each unit of drawings."""
LARGEST = 1000.0
"""Largest curve of a drawing [m]."""
FARTHEST = 1e6
"""Farthest place from a drawing's origin [m]."""
DEEPEST, MOST_ENTITIES = 16, 100_000
"""Most levels of blocks, and entities of placed blocks."""
MOST_PIECES, MOST_POINTS = 10_000, 100_000
"""Most edges of a contour, and points along them."""
MOST_DEGREE = 11


@dataclass(frozen=True)
class Edge:
    """Edge of a contour: an entity of a drawing, or a polyline's piece.

    Attributes:
        name: as in CAD programs.
        points: (n, 2) along it [m].
    """

    name: str
    points: Array
    straight: bool

    @property
    def reversed_edge(self) -> Edge:
        """The contour's edge from its end to its start."""
        return replace(self, points=self.points[::-1])


def read_edges(path: Path, layer: str | None, unit: str | None = None, key: str = "profile_unit") -> list[Edge]:
    """Edges of a contour in a DXF drawing [m].

    Args:
        unit: one of `LENGTHS`; None is the file's.
        key: drive file's key of that unit.

    Raises:
        DriveError: the drawing is wrong; names the entity.
        WarpchainError: no package ezdxf.
    """
    require_extra("dxf", "DXF", WarpchainError)
    import ezdxf

    try:
        check_file_size(path)
        document = ezdxf.readfile(path)
    except OSError as error:
        raise DriveError(f"cannot be read: {(error.strerror or 'is no DXF file').lower()}") from None
    except (ezdxf.DXFError, ValueError, KeyError, IndexError):
        raise DriveError("cannot be read: is no dxf file, or is damaged") from None
    if unit is None:
        number = document.header.get("$INSUNITS", 0)
        if not isinstance(number, int) or not 1 <= number < len(INSUNITS):
            raise DriveError(
                "says no unit of length ($INSUNITS); must be one such as millimeters (4) or meters (6), or be said in "
                f'the drive file, as {key} = "mm"'
            )
        unit = INSUNITS[number]
    entities = list(_entities_in_space(document.modelspace(), None, 0, count()))
    if not entities:
        raise DriveError("has no entities in its model space")
    layers = sorted({on for on, _, _ in entities})
    if layer is not None and layer not in layers:
        raise DriveError(f'has nothing on layer "{layer}"; allowed is one of {", ".join(layers)}')
    chosen = [(entity, name) for on, entity, name in entities if layer in (None, on)]
    for entity, name in chosen:
        _check_kind(entity, name)
    pieces = sum(_piece_count(entity) for entity, _ in chosen)
    if pieces > MOST_PIECES:
        raise DriveError(f"the contour has {pieces} lines, curves and points of splines; must be at most {MOST_PIECES}")
    edges: list[Edge] = []
    left = MOST_POINTS
    for entity, name in chosen:
        found = _edges_of_entity(entity, name, unit, left)
        edges += found
        left -= sum(len(edge.points) for edge in found)
    return edges


def _entities_in_space(
    space: Any, insert: tuple[str, str] | None, depth: int, passed: Iterator[int]
) -> Iterator[tuple[str, Any, str]]:
    """Layer, entity and name of a drawing's entities, blocks placed.

    Args:
        insert: layer and name of the block's reference.
        depth: of references.
        passed: counter of entities, points and references.

    Raises:
        DriveError: a wrong reference.
    """
    if depth > DEEPEST:
        raise DriveError(f"{insert and insert[1]}: has blocks within blocks, {DEEPEST} deep and more")

    def refuse(entity: Any, why: str) -> None:
        """Raises a DriveError on an entity of a placed block."""
        raise DriveError(f"{entity.dxftype()} of {name}: cannot be drawn as its block is placed ({why})")

    for entity in space:
        on = insert[0] if insert and entity.dxf.layer == "0" else entity.dxf.layer
        name = f"{entity.dxftype()} of {insert[1]}" if insert else f"{entity.dxftype()} {entity.dxf.handle}"
        references = entity.mcount if entity.dxftype() == "INSERT" else 0  # also to an empty block
        pieces = min((_piece_count(entity) if insert else 0) + references, MOST_ENTITIES + 1)
        if pieces and next(islice(passed, pieces - 1, None)) >= MOST_ENTITIES:
            raise DriveError(f"{name}: is one of more than {MOST_ENTITIES} entities of blocks")
        if entity.dxftype() != "INSERT":
            if entity.dxftype() not in ("ATTRIB", "ATTDEF"):  # texts of a block
                yield on, entity, name
            continue
        if entity.block() is None or entity.block().block.is_xref:
            raise DriveError(f'{name}: its block "{entity.dxf.name}" is not in the file')
        for one in entity.multi_insert() if entity.mcount > 1 else (entity,):
            with _reported_curve_errors(name):
                inner = list(islice(one.virtual_entities(skipped_entity_callback=refuse), MOST_ENTITIES + 1))
            yield from _entities_in_space(inner, (on, name), depth + 1, passed)


@contextmanager
def _reported_curve_errors(name: str) -> Iterator[None]:
    """Context that turns ezdxf's errors on an entity into a DriveError."""
    try:
        with np.errstate(all="ignore"):
            yield
    except DriveError:
        raise
    except Exception:
        raise DriveError(f"{name}: its numbers make no curve; must be finite, and its points differ") from None


def _piece_count(entity: Any) -> int:
    """Number of pieces of a drawing's entity."""
    kind = entity.dxftype()
    if kind == "SPLINE":
        return max(1, len(entity.control_points) + len(entity.fit_points), len(entity.knots) - MOST_DEGREE - 1)
    return max(1, len(entity)) if kind in ("LWPOLYLINE", "POLYLINE") else 1


def _check_kind(entity: Any, name: str) -> None:
    """Raises a DriveError for a drawing's entity that is no edge."""
    kind, allowed = entity.dxftype(), ", ".join(KINDS)
    if kind not in KINDS:
        raise DriveError(f"{name}: is no edge of a contour ({allowed}); put the contour on a layer, as FILE.dxf#LAYER")
    if kind == "POLYLINE" and not (entity.is_2d_polyline or entity.is_3d_polyline):
        raise DriveError(f"{name}: is a mesh, no edge of a contour ({allowed})")
    if kind == "SPLINE":
        if not 1 <= entity.dxf.degree <= MOST_DEGREE:
            raise DriveError(f"{name}: is a spline of degree {entity.dxf.degree}; must be 1 to {MOST_DEGREE}")
        if not ((np.diff(entity.knots) >= 0.0).all() and (np.array(entity.weights) > 0.0).all()):
            raise DriveError(f"{name}: must have knots that ascend, and weights above 0")


def _edges_of_entity(entity: Any, name: str, unit: str, most: int) -> list[Edge]:
    """Edges of a drawing's entity, with at most `most` points."""
    scale = LENGTHS[unit]
    with _reported_curve_errors(name):
        pieces = list(entity.virtual_entities()) if entity.dxftype() in ("LWPOLYLINE", "POLYLINE") else [entity]
    found: list[Edge] = []
    for piece in pieces:
        straight = piece.dxftype() == "LINE"
        with _reported_curve_errors(name):
            size = scale * _entity_size(piece)
            if not size <= LARGEST:
                large = f"is {size:.3g} m large in the drawing's unit, {unit}"
                large = large if math.isfinite(size) else "is without bounds, or has numbers that are not finite"
                raise DriveError(f"{name}: {large}; must be at most {LARGEST:g} m")
            ends = (piece.dxf.start, piece.dxf.end) if straight else piece.flattening(SAG / scale)
            points = np.array([(p.x, p.y) for p in islice(ends, most + 1)]).reshape(-1, 2) * scale
        most -= len(points)
        if most < 0:
            raise DriveError(
                f"{name}: the curves up to it have more than {MOST_POINTS} points; must be fewer, or smaller"
            )
        if len(points) < 2 or np.ptp(points, axis=0).max() == 0.0:
            raise DriveError(f"{name}: has no length")
        if not (np.abs(points) <= FARTHEST).all():
            raise DriveError(f"{name}: has places that are not within {FARTHEST:g} m of the drawing's origin")
        found.append(Edge(name, points, straight))
    if not found:
        raise DriveError(f"{name}: has no length")
    return found


def _entity_size(piece: Any) -> float:
    """Approximate size of an entity in the drawing's unit."""
    kind = piece.dxftype()
    if kind == "LINE":
        return float(piece.dxf.start.distance(piece.dxf.end))
    if kind == "ARC":
        return float(abs(piece.dxf.radius))
    if kind == "ELLIPSE":
        return float(piece.dxf.major_axis.magnitude * max(1.0, abs(piece.dxf.ratio)))
    points = np.array([(p[0], p[1]) for p in (*piece.control_points, *piece.fit_points)])
    return float(np.ptp(points, axis=0).max()) if len(points) else 0.0


def joined_edges(edges: list[Edge]) -> tuple[list[Edge], bool]:
    """Edges of a drawing in their contour's order, and whether it closes.

    Raises:
        DriveError: edges that join none, or a third.
    """
    from scipy.spatial import cKDTree  # here, since it takes a tenth of a second

    ends = np.array([[edge.points[0], edge.points[-1]] for edge in edges])
    flat = ends.reshape(-1, 2)
    # three nearest, of which one is the end itself: two others are too many, whatever their number
    _, place, times = np.unique(flat, axis=0, return_inverse=True, return_counts=True)
    meeting = times[place.reshape(-1)]
    if meeting.max() <= 2:  # a tree is slow where many points are one
        gaps, near = cKDTree(flat).query(flat, k=3, distance_upper_bound=np.nextafter(GAP, 1.0))
        meeting = np.isfinite(gaps).sum(axis=1)
    if meeting.max() > 2:
        crowded = int((meeting > 2).argmax())
        raise DriveError(f"{edges[crowded // 2].name}: two others begin or end where it ends; must be one line")
    own = np.arange(len(flat))
    other = np.where(near[:, 0] == own, near[:, 1], near[:, 0])
    loose = np.flatnonzero(meeting == 1)
    if len(loose) > 2:
        _raise_open_contour(edges, loose, flat)
    at = begin = int(loose[0]) if len(loose) else 0
    chain: dict[int, Edge] = {}
    while True:
        edge = edges[at // 2]
        chain[at // 2] = edge if at % 2 == 0 else edge.reversed_edge
        at ^= 1
        if meeting[at] == 1 or other[at] == begin:
            break
        at = int(other[at])
    if len(chain) < len(edges):
        beside = next(edge for k, edge in enumerate(edges) if k not in chain)
        raise DriveError(f"{beside.name}: is of another contour than {edges[begin // 2].name}; must be one line")
    return list(chain.values()), not len(loose)


def _raise_open_contour(edges: list[Edge], loose: NDArray[np.intp], ends: Array) -> None:
    """Raises a DriveError on an open contour's narrowest gap."""
    loose = loose[:MOST_LOOSE]
    gaps = np.hypot(*np.moveaxis(ends[loose][:, None] - ends[loose][None], -1, 0))
    np.fill_diagonal(gaps, np.inf)
    a, b = np.unravel_index(int(gaps.argmin()), gaps.shape)
    first, second = (edges[int(loose[i]) // 2].name for i in sorted((a, b)))
    x, y = edges[int(loose[a]) // 2].points[0 if loose[a] % 2 == 0 else -1]
    raise DriveError(
        f"the contour is open: {first} and {second} are {1e3 * gaps[a, b]:.3g} mm apart at [{x:.4g}, {y:.4g}] m; "
        f"must meet within {1e3 * GAP:g} mm"
    )


def read_face(path: Path, layer: str | None, unit: str | None = None) -> list[list[float]]:
    """Points of a guide's face in a drawing [m].

    Raises:
        DriveError, WarpchainError: as `read_edges`; or for a closed contour.
    """
    edges, closed = joined_edges(read_edges(path, layer, unit))
    if closed:
        raise DriveError(f"{edges[0].name}: the contour is closed; must be the open line that the chain rides on")
    points: list[Array] = []
    stretches = max(1, min(STRETCHES, MOST_STRETCHES // max(1, sum(edge.straight for edge in edges))))
    for edge in edges:
        places = edge.points
        if edge.straight:
            places = np.linspace(places[0], places[-1], stretches + 1)
        points.append(places if not points else places[1:])
    return [[float(x), float(y)] for x, y in np.concatenate(points)]


@dataclass(frozen=True)
class _OutlineArc:
    """Arc or line (radius infinite, turn 0) of a sprocket's outline."""

    edge: Edge
    center: Array
    radius: float
    turn: float

    @property
    def tangents(self) -> Array:
        """Unit tangents (2, 2) at an outline arc's ends."""
        if math.isinf(self.radius):
            along = self.edge.points[-1] - self.edge.points[0]
            return np.stack([along, along]) / np.hypot(*along)
        out = (self.edge.points[[0, -1]] - self.center) / self.radius
        return math.copysign(1.0, self.turn) * np.stack([-out[:, 1], out[:, 0]], axis=-1)


def _fitted_arc(edge: Edge) -> _OutlineArc:
    """Circle or line through an edge's points, by least squares.

    Raises:
        DriveError: the points follow neither.
    """
    points = edge.points
    nothing = np.zeros(2)
    if edge.straight or len(points) == 2:
        return _OutlineArc(edge, nothing, math.inf, 0.0)
    middle = points.mean(axis=0)
    x = points - middle
    system = np.column_stack([2.0 * x, np.ones(len(x))])
    (a, b, c), _, rank, _ = np.linalg.lstsq(system, (x**2).sum(axis=1), rcond=None)
    radius = math.sqrt(max(c + a * a + b * b, 0.0)) if rank == 3 else math.inf
    if radius > STRAIGHT:
        return _OutlineArc(edge, nothing, math.inf, 0.0)
    off = np.abs(np.hypot(x[:, 0] - a, x[:, 1] - b) - radius).max()
    if off > ALIKE:
        raise DriveError(f"{edge.name}: is {1e3 * off:.2g} mm off its best arc; teeth are of arcs and lines")
    angle = np.unwrap(np.arctan2(x[:, 1] - b, x[:, 0] - a))
    return _OutlineArc(edge, middle + np.array([a, b]), radius, float(angle[-1] - angle[0]))


def read_teeth(path: Path, layer: str | None, teeth: int, unit: str | None = None) -> dict[str, float | None]:
    """Tooth gap and pitch of a sprocket's drawing, by key of `ToothGap`.

    Raises:
        DriveError, WarpchainError: as `read_edges`; or for an open outline, unlike teeth, or flanks not tangent to
            seats.
    """
    edges, closed = joined_edges(read_edges(path, layer, unit, "tooth_unit"))
    if not closed:
        first, last = edges[0].name, edges[-1].name
        raise DriveError(f"the contour is open: nothing joins {last} and {first}; teeth are a closed outline")
    points = np.concatenate([edge.points[:-1] for edge in edges])
    area = float((points[:, 0] * np.roll(points[:, 1], -1) - points[:, 1] * np.roll(points[:, 0], -1)).sum())
    if area < 0.0:
        edges = [edge.reversed_edge for edge in reversed(edges)]
    arcs = _merged_arcs([_fitted_arc(edge) for edge in edges])
    seats = [k for k, arc in enumerate(arcs) if arc.turn < 0.0]  # hollow, where the material is on the left
    if len(seats) != teeth:
        raise DriveError(f"has {len(seats)} hollow arcs; must have a seat for each of the {teeth} teeth")
    center = np.mean([arcs[k].center for k in seats], axis=0)
    flanks = [(arcs[k - 1], arcs[(k + 1) % len(arcs)]) for k in seats]
    for k, beside in zip(seats, flanks, strict=True):
        for flank, (mine, other) in zip(beside, ((0, 1), (1, 0)), strict=True):
            bend = float(np.dot(arcs[k].tangents[mine], flank.tangents[other]))
            if bend < math.cos(CORNER):
                angle = math.degrees(math.acos(max(-1.0, bend)))
                raise DriveError(
                    f"{flank.edge.name}: leaves its seat with a corner of {angle:.3g} degrees; must be tangent"
                )
    reach = np.hypot(*(np.array([arcs[k].center for k in seats]) - center).T)
    radii = np.array([arcs[k].radius for k in seats])
    flank_radii = np.array([flank.radius for pair in flanks for flank in pair])
    for what, values in (("seats", reach), ("seats' radii", radii), ("flanks' radii", flank_radii)):
        if np.isinf(values).any() != np.isinf(values).all() or (np.isfinite(values[0]) and np.ptp(values) > ALIKE):
            raise DriveError(f"the {what} differ, by {1e3 * np.ptp(values):.3g} mm; teeth must be alike")
    straight = bool(np.isinf(flank_radii[0]))
    return {
        "seat_radius": float(radii.mean()),
        "seat_angle": math.degrees(float(np.mean([abs(arcs[k].turn) for k in seats]))),
        "flank_radius": None if straight else float(flank_radii.mean()),
        "tip_radius": float(np.hypot(*(points - center).T).max()),
        "pitch": 2.0 * float(reach.mean()) * math.sin(math.pi / teeth),
    }


def _merged_arcs(arcs: list[_OutlineArc]) -> list[_OutlineArc]:
    """Arcs of an outline, neighbors on one circle merged."""
    found: list[_OutlineArc] = []
    for arc in arcs:
        if found and _is_same_circle(found[-1], arc):
            found[-1] = _joined_arc(found[-1], arc)
        else:
            found.append(arc)
    if len(found) > 1 and _is_same_circle(found[-1], found[0]):
        found[0] = _joined_arc(found.pop(), found[0])
    return found


def _is_same_circle(a: _OutlineArc, b: _OutlineArc) -> bool:
    """Whether two outline arcs are of one circle."""
    if math.isinf(a.radius) or math.isinf(b.radius) or a.turn * b.turn <= 0.0:
        return False
    return abs(a.radius - b.radius) <= ALIKE and float(np.hypot(*(a.center - b.center))) <= ALIKE


def _joined_arc(a: _OutlineArc, b: _OutlineArc) -> _OutlineArc:
    """One outline arc from `a` to `b`."""
    edge = replace(a.edge, points=np.concatenate([a.edge.points, b.edge.points[1:]]))
    return replace(a, edge=edge, turn=a.turn + b.turn)
