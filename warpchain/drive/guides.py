"""Guides: the shape of their faces in a drive file, and their profile."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, NamedTuple

from pydantic import BeforeValidator, Field, WithJsonSchema, create_model

from warpchain.drive.biarcs import fitted_face
from warpchain.drive.contact_settings import GuideOverrides
from warpchain.drive.face_profile import (
    Piece,
    Point,
    Profile,
    ProfileError,
    arc_face,
    make_profile,
    rounded_face,
    straight_face,
)
from warpchain.drive.schema import (
    BARE,
    FARTHEST,
    WRONG,
    Allowed,
    Finite,
    Name,
    Pair,
    Part,
    Positive,
    Problem,
    Rule,
    Value,
    allowed_text,
    are_numbers,
    node_list,
    node_value,
    place_rule,
    valid_part,
)

Side = Annotated[Literal["left", "right"], Value('must be "left" or "right", seen from start to end')]


def _plain_points(value: Any) -> Any:
    """Points of a guide in lists or arrays (n, 2) as tuples."""
    rows = value.tolist() if getattr(value, "ndim", 0) == 2 else value
    return tuple(tuple(row) if isinstance(row, list) else row for row in rows) if isinstance(rows, list) else rows


_Real = Annotated[float, Field(strict=True, allow_inf_nan=False)]
_Points = Annotated[
    tuple[Annotated[tuple[_Real, _Real], Field(strict=True)], ...],
    Field(strict=True, min_length=2),
    BeforeValidator(_plain_points),
]
Points = Annotated[_Points, Value("must be a list of at least 2 points [x, y] of finite numbers")]
_NUMBERS = {"type": "array", "items": {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2}}
Measured = Annotated[
    _Points,
    WithJsonSchema({"anyOf": [_NUMBERS, {"type": "string"}, {"type": "object", "required": ["file"]}]}),
    Value("must be a list of at least 2 points [x, y] of finite numbers; only drive files name a file of them"),
]

Bolts = Annotated[
    tuple[Annotated[tuple[_Real, _Real], Field(strict=True)], ...],
    Field(strict=True),
    BeforeValidator(_plain_points),
    Value("must be a list of points [x, y] of finite numbers"),
]

SMALLEST, LARGEST = 1e-9, 1e9
"""Radii that a face's arcs may have [m]."""

MOST_POINTS = 2000
"""Most points or arcs of a guide face."""

SHAPES = ("points", "arcs", "profile")
"""Keys of a face other than a straight bar."""


def _radius_rules(node: Any, key: str) -> Iterator[Problem]:
    """Problem of a face's radius far too small or large."""
    value = node_value(node, key)
    if isinstance(value, (int, float)) and value > 0.0 and not SMALLEST <= value <= LARGEST:
        yield Problem((key,), value, f"must be from {SMALLEST:g} to {LARGEST:g} m")


class _Arc(Part):
    """An arc of a guide face.

    Attributes:
        center: center [m].
        radius: radius [m].
        from, to: angles of entry and exit, seen from the center [degrees]; counter-clockwise if `to` is larger.
    """

    center: Pair
    radius: Positive

    @property
    def angles(self) -> tuple[float, float]:
        """Angles at which a guide's face enters and leaves the arc [rad]."""
        return math.radians(node_value(self, "from")), math.radians(node_value(self, "to"))

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        """Problems of a guide face's arc."""
        yield from place_rule(("center",), node_value(node, "center"))
        yield from _radius_rules(node, "radius")
        begin, end = node_value(node, "from"), node_value(node, "to")
        if are_numbers(begin, end) and not 0.0 < abs(end - begin) < 360.0:
            text = f"must be another angle than from, {begin:g}, less than 360 degrees away"
            yield Problem(("to",), end, text)


if TYPE_CHECKING:
    Arc = _Arc
else:  # a class body cannot name a field `from`
    Arc = create_model("Arc", __base__=_Arc, __module__=__name__, **{"from": (Finite, ...), "to": (Finite, ...)})
    Arc.__doc__ = _Arc.__doc__


class Bar(NamedTuple):
    """Straight guide face [m]; the chain rides on the left."""

    start: Point
    end: Point
    end_radius: float


class Guide(Part):
    """A guide: a face with rounded ends on which the chain rides.

    Attributes:
        name: unique among all parts.
        start, end: ends of a flat face [m].
        points: corners of a line, to be rounded [m].
        arcs: arcs, with straight pieces on common tangents.
        profile: points of a measured line [m]; a file may name a file.
        end_radius: radius of both ends [m]; None is a pitch, not with start and end.
        radius: radius of the rounded corners of `points` [m].
        side: on which the chain rides.
        offset: distance from the face to the rollers' centers [m]; None is the rollers' radius.
        chain: chain that it guides, where there are several.
        bolts: places of screws to the housing [m]; they share its force in exports.
        arm: arm that carries it; None is the ground.
        contact: contact settings that differ from `[contact.guide]`.
    """

    name: Name
    start: Pair | None = None
    end: Pair | None = None
    end_radius: Positive | None = None
    points: Points | None = None
    radius: Positive | None = None
    arcs: Annotated[tuple[Arc, ...], Allowed("must be a list of tables { center, radius, from, to }")] = ()
    profile: Measured | None = None
    side: Side | None = None
    offset: Positive | None = None
    chain: Name | None = None
    bolts: Bolts = ()
    arm: Name | None = None
    contact: GuideOverrides | None = None

    _replaces: ClassVar[dict[str, tuple[str, ...]]] = {
        "points": ("start", "end", "arcs", "profile"),
        "arcs": ("start", "end", "points", "radius", "profile"),
        "profile": ("start", "end", "points", "radius", "arcs"),
        "start": ("points", "radius", "arcs", "profile"),
        "end": ("points", "radius", "arcs", "profile"),
    }

    @property
    def straight(self) -> bool:
        """Whether the guide is one straight bar."""
        return self.start is not None

    @property
    def bar(self) -> Bar:
        """Ends and radius of a straight guide."""
        assert self.start is not None and self.end is not None and self.end_radius is not None
        if self.side == "right":
            return Bar(self.end, self.start, self.end_radius)
        return Bar(self.start, self.end, self.end_radius)

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        """Problems of a guide's values."""
        ends = [key for key in ("start", "end") if node_value(node, key) is not None]
        shapes = [key for key in SHAPES if node_value(node, key) not in (None, (), [])]
        for key in shapes[1:] if not ends else shapes:
            text = f"not together with {ends[0] if ends else shapes[0]}; give one of start and end, {', '.join(SHAPES)}"
            yield Problem((key,), node_value(node, key), text)
        if not shapes:
            other = "" if ends else ", or give points, arcs or profile instead"
            for key in ("start", "end"):
                if node_value(node, key) is None:
                    yield Problem((key,), None, f"missing; {allowed_text(cls, key)}{other}", BARE)
            if node_value(node, "end_radius") is None:
                yield Problem(("end_radius",), None, f"missing; {allowed_text(cls, 'end_radius')}", BARE)
        radius = node_value(node, "radius")
        if radius is not None and "points" not in shapes:
            yield Problem(("radius",), radius, "only together with points, whose corners it rounds")
        if radius is None and len(node_list(node, "points")) > 2:
            yield Problem(
                ("radius",), None, f"missing; {allowed_text(cls, 'radius')}; needed to round the points", BARE
            )
        bolts = node_list(node, "bolts")
        if len(bolts) and node_value(node, "arm") is not None:
            yield Problem(("bolts",), None, "only on the ground: what an arm carries, its pivot bears", BARE)
        for i, point in enumerate(bolts):
            yield from place_rule(("bolts", i), point)
        yield from _face_rules(node)

    @classmethod
    def _number_rules(cls, changed: Mapping[str, Any]) -> Sequence[Rule]:
        """Rules of the guide that changed numbers can break."""
        return () if changed.keys() <= {"offset", "contact"} else (_face_rules,)


def _face_rules(node: Any) -> Iterable[Problem]:
    """Problems of the numbers of a guide's face."""
    if list(node_list(node, "start")) == list(node_list(node, "end")) != []:
        yield Problem(("end",), node_value(node, "end"), "must be another point than start")
    far = [problem for key in ("points", "profile") for i, point in enumerate(node_list(node, key))
           for problem in place_rule((key, i), point)]  # fmt: skip
    yield from far
    many = [(key, count) for key in SHAPES if (count := len(node_list(node, key))) > MOST_POINTS]
    for key, count in many:
        yield Problem((key,), None, f"has {count} elements; must have at most {MOST_POINTS}", BARE)
    yield from _radius_rules(node, "end_radius")
    yield from _radius_rules(node, "radius")
    shapes = [key for key in SHAPES if node_list(node, key)]
    if len(shapes) == 1 and not (far or many) and node_value(node, "start") is None and node_value(node, "end") is None:
        yield from _face_shape_rules(node, shapes[0])


def _face_shape_rules(node: Any, shape: str) -> Iterable[Problem]:
    """Problems of the shape of a guide's face."""
    key, values = _face_shape(node)
    if key is None:
        return
    try:
        _face_of_values(key, values)
    except ProfileError as error:
        value = node_list(node, shape)[error.index]
        bare = shape == "arcs"
        yield Problem((shape, error.index), None if bare else list(value), str(error), BARE if bare else WRONG)


def _face_shape(node: Any) -> tuple[str | None, tuple[Any, ...]]:
    """Key and values that give a guide's face."""
    if any(len(node_list(node, key)) > MOST_POINTS for key in SHAPES):
        return None, ()
    for key in ("points", "profile"):
        if node_value(node, key) is not None:
            rows = _plain_points(node_value(node, key))
            whole = isinstance(node, Part) or (
                isinstance(rows, tuple)
                and len(rows) > 1
                and all(isinstance(row, tuple) and len(row) == 2 and are_numbers(*row) for row in rows)
                and not any(abs(x) > FARTHEST for row in rows for x in row)
            )
            if key == "profile":
                return (key, (rows,)) if whole else (None, ())
            radius = node_value(node, "radius")
            radius = 1.0 if radius is None and whole and len(rows) == 2 else radius  # it has no corners
            return (key, (rows, radius)) if whole and are_numbers(radius) and radius > 0.0 else (None, ())
    circles = [valid_part(Arc, arc) for arc in node_list(node, "arcs")]
    if circles:
        whole = all(circle is not None for circle in circles)
        return ("arcs", tuple((c.center, c.radius, *c.angles) for c in circles if c)) if whole else (None, ())
    start, end = (tuple(node_list(node, key)) for key in ("start", "end"))
    whole = len(start) == len(end) == 2 and are_numbers(*start, *end)
    return ("bar", (start, end)) if whole and start != end else (None, ())


@lru_cache(maxsize=1024)
def _face_of_values(key: str, values: tuple[Any, ...]) -> tuple[Piece, ...]:
    """Pieces of a guide face by key and values."""
    if key == "points":
        return rounded_face(*values)
    if key == "profile":
        return fitted_face(*values)
    return arc_face(values) if key == "arcs" else straight_face(*values)


def guide_profile(node: Any, pitch: float) -> Profile | None:
    """Profile of a guide or its values, or None; `pitch` is the default end radius [m]."""
    key, values = _face_shape(node)
    if key is None:
        return None
    end_radius = node_value(node, "end_radius")
    end_radius = pitch if end_radius is None else end_radius
    if not are_numbers(end_radius, pitch) or end_radius <= 0.0:
        return None
    try:
        return _profile_of_values(key, values, end_radius, "right" if node_value(node, "side") == "right" else "left")
    except ProfileError:
        return None


@lru_cache(maxsize=1024)
def _profile_of_values(key: str, values: tuple[Any, ...], end_radius: float, side: str) -> Profile:
    """Profile of a guide face by key and values."""
    return make_profile(_face_of_values(key, values), end_radius, side)
