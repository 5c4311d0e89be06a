"""Guides: the shape of their faces as a drive file gives it, and their profile (`warpchain.drive.face_profile`).

A face is a straight bar (start, end), a line through points with rounded corners, a chain of arcs, or a measured line
that biarcs are fitted to.
"""

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
    """Points in lists or arrays (n, 2) as tuples of tuples."""
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
"""Radii beyond are mistakes [m]."""

MOST_POINTS = 2000
"""Most points or arcs of a face: what is fitted to wild points takes as long as their square."""

SHAPES = ("points", "arcs", "profile")
"""Keys that give a face another shape than that of a bar from start to end."""


def _radius_rules(node: Any, key: str) -> Iterator[Problem]:
    """Problem of a radius that is 0, negative or far too large."""
    value = node_value(node, key)
    if isinstance(value, (int, float)) and value > 0.0 and not SMALLEST <= value <= LARGEST:
        yield Problem((key,), value, f"must be from {SMALLEST:g} to {LARGEST:g} m")


class _Arc(Part):
    """An arc of a face, between two angles as seen from its center; counter-clockwise if `to` is the larger one.

    Attributes:
        center: its center [m].
        radius: its radius [m].
        from, to: angles at which the face enters and leaves the arc [degrees]; less than a revolution apart.
    """

    center: Pair
    radius: Positive

    @property
    def angles(self) -> tuple[float, float]:
        """Angles at which the face enters and leaves the arc [rad]."""
        return math.radians(node_value(self, "from")), math.radians(node_value(self, "to"))

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
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
    """A straight face as the chain rides on it: on the left from start to end; its ends' radius [m]."""

    start: Point
    end: Point
    end_radius: float


class Guide(Part):
    """A guide: a face with rounded ends on which the chain rides.

    Attributes:
        name: unique among all parts.
        start, end: ends of a flat face [m]; not the same point.
        points: corners of a line, which are rounded [m]; this, start and end, arcs, or a profile.
        arcs: arcs that follow each other, with straight pieces where they only share a tangent.
        profile: points of a measured line [m], which biarcs follow; a drive file may name a file instead.
        end_radius: radius of both ends [m]; needed with start and end, else a pitch unless given.
        radius: radius of the rounded corners of `points` [m].
        side: side of the way from start to end on which the chain rides; None is the left.
        offset: distance from the face to the rollers' centers [m]; None is the rollers' radius.
        chain: name of the chain that it guides, where there are several.
        bolts: places at which a guide on the ground is screwed to the housing [m]; they share its force in exports.
        arm: arm that carries the guide, in the position that it has at the arm's angle 0; None is the ground.
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
        """True for a bar of one straight piece."""
        return self.start is not None

    @property
    def bar(self) -> Bar:
        """A straight bar's ends; only where `straight`."""
        assert self.start is not None and self.end is not None and self.end_radius is not None
        if self.side == "right":
            return Bar(self.end, self.start, self.end_radius)
        return Bar(self.start, self.end, self.end_radius)

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
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
        return () if changed.keys() <= {"offset", "contact"} else (_face_rules,)


def _face_rules(node: Any) -> Iterable[Problem]:
    """Problems of a guide's numbers, however the face is given."""
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
    """Problems of the face's geometry, where its values are whole."""
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
    """The key by which a guide's face is given, and its values; None where they are not whole."""
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
    """The pieces of a face that is given by a key and values."""
    if key == "points":
        return rounded_face(*values)
    if key == "profile":
        return fitted_face(*values)
    return arc_face(values) if key == "arcs" else straight_face(*values)


def guide_profile(node: Any, pitch: float) -> Profile | None:
    """The profile of a guide, or of the values that should become one; None where they are not whole.

    Args:
        node: the guide.
        pitch: of the chain, the radius of ends that have none of their own [m].
    """
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
    """The profile of a face that is given by a key and values."""
    return make_profile(_face_of_values(key, values), end_radius, side)
