"""The chain of a drive: links, their wear and stiffness, joints."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, Field, WithJsonSchema
from pydantic_core import PydanticCustomError

from warpchain.drive.catalogue import CHAINS
from warpchain.drive.plate import (
    BACK_HEIGHT,
    FLANK_ANGLE,
    FLANK_DISTANCE,
    PLATE_KEYS,
    TIP_RADIUS,
    TOE_DEPTHS,
    Plate,
    plate_problems,
)
from warpchain.drive.quantities import converted_number
from warpchain.drive.schema import (
    BARE,
    WRONG,
    Allowed,
    Finite,
    Name,
    NonNegative,
    Part,
    Positive,
    PositivePair,
    Problem,
    Value,
    allowed_text,
    are_numbers,
    at_most_rule,
    exactly_one_rule,
    nearest_key_text,
    node_list,
    node_value,
)
from warpchain.drive.stack_math import has_arrays, is_true_somewhere, radians, sqrt, where, with_last_axis

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

Links = Annotated[int, Field(strict=True, ge=3), Value("must be an integer of at least 3")]
LinkIndex = Annotated[int, Field(strict=True, ge=0), Value("must be an integer of at least 0")]
Every = Annotated[int, Field(strict=True, ge=1), Value("must be an integer of at least 1")]
Ends = Annotated[tuple[Name, Name], Allowed("must be a list of the names of two sprockets without teeth")]
Between = Annotated[tuple[Name, Name], Allowed("must be a list of the names of two sprockets, one after the other")]
Elongation = Annotated[float, Field(strict=True, ge=-0.05, le=0.1), Value("must be a number from -0.05 to 0.1")]

Kind = Annotated[Literal["roller", "silent"], Value('must be "roller" or "silent"')]
FlankAngle = Annotated[float, Field(strict=True, ge=20, le=45), Value("must be a number of degrees from 20 to 45")]

MOST_LINKS = 1_000_000

ESTIMATE = "estimate"
"""Word for the catalogue's stiffness."""


def _size_text(value: Any) -> str:
    """Error sentence on a size that the catalogue lacks."""
    return f"must be a size that `warpchain chains` lists; {nearest_key_text(str(value), CHAINS, 4)}"


def _check_size(value: str) -> str:
    """The size of a chain, if the catalogue has it."""
    if value not in CHAINS:
        raise PydanticCustomError(WRONG, "{text}", {"text": _size_text(value)})
    return value


Size = Annotated[
    Annotated[str, Field(strict=True), AfterValidator(_check_size)],
    WithJsonSchema({"type": "string", "enum": list(CHAINS)}),
    Allowed("must be a size that `warpchain chains` lists, such as 16B"),
]
Stiffness = Annotated[
    Annotated[float, Field(strict=True, gt=0, allow_inf_nan=False)],
    WithJsonSchema({"anyOf": [{"type": "number", "exclusiveMinimum": 0}, {"const": ESTIMATE}]}),
    Value('must be a positive number, or "estimate" together with a size'),
]


def _with_back_as_radius(values: Mapping[str, Any]) -> Mapping[str, Any]:
    """Values of a silent chain, its back's height as its pins' roller radius."""
    if values.get("roller_radius") is not None:
        return values
    key, part = ("pitch", BACK_HEIGHT) if values.get("back_height") is None else ("back_height", 1.0)
    own = values.get(key)
    length: Any = converted_number(own, "m") if isinstance(own, str) else own
    is_right = are_numbers(length) and 0.0 < length < math.inf  # if not, the key's own rule says so
    return {**values, "roller_radius": part * length if is_right else 1.0}


def chain_plate(chain: Any) -> Plate:
    """Plate of a silent chain or its values."""

    def value(key: str, part: float) -> Any:
        """A length [m], by default `part` of the pitch."""
        own = node_value(chain, key)
        return part * node_value(chain, "pitch") if own is None else own

    angle, depths = node_value(chain, "flank_angle"), node_value(chain, "toe_depths")
    return Plate(
        pitch=node_value(chain, "pitch"),
        flank_angle=radians(FLANK_ANGLE if angle is None else angle),
        flank_distance=value("flank_distance", FLANK_DISTANCE),
        back_height=value("back_height", BACK_HEIGHT),
        toe_depths=tuple(depths or (part * node_value(chain, "pitch") for part in TOE_DEPTHS)),
        tip_radius=value("tip_radius", TIP_RADIUS),
    )


class WornLink(Part):
    """One link with an elongation of its own.

    Attributes:
        link: index from 0; link i joins rollers i and i + 1, roller 0 the first on the first sprocket.
        elongation: wear over the pitch [-].
    """

    link: LinkIndex
    elongation: Elongation


class Attachment(Part):
    """Like masses on links of a chain: buckets, flights, pushers, lugs, or one of them.

    A chain's list adds up. A link's pins bear each mass by halves.

    Attributes:
        mass: mass of one attachment [kg].
        every: links from one attachment to the next; None: there is only the first.
        first: link that has the first one, from 0; link i joins rollers i and i + 1.
    """

    mass: NonNegative
    every: Every | None = None
    first: LinkIndex = 0

    def bearing_links(self, links: int) -> NDArray[np.int64]:
        """Indices of a chain's links that bear attachments."""
        import numpy as np

        return np.arange(self.first, links, self.every or links)


class StrandLoad(Part):
    """Goods that lie on one strand of a chain, and move with it.

    Attributes:
        load_per_length: mass of the goods on one meter [kg/m].
        between: names of the two sprockets between which the strand is, in the order of the chain's travel.
        begin: way along the strand at which goods come on [m].
        end: way at which they fall off [m]; None is the strand's end.
        feed_speed: speed along the strand at which they come on [m/s].
    """

    load_per_length: NonNegative
    between: Between
    begin: NonNegative = 0.0
    end: Positive | None = None
    feed_speed: Finite = 0.0

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        """Problems of a strand's goods."""
        begin, end = node_value(node, "begin"), node_value(node, "end")
        if are_numbers(begin, end) and end <= begin:
            yield Problem(("end",), end, f"must be more than begin, {begin:g}")


class Joint(Part):
    """Joints of a chain: pins that rub in bushes.

    Attributes:
        friction: coefficient of friction of pin and bush, mu_d [-].
        pin_radius: r_p [m]; None is d2/2.
        factor: spread of the pressure, kappa [-]: 1 line contact, 4/pi worn in, pi/2 new.
        static_friction: coefficient at rest, mu_s [-]; None is mu_d.
        stribeck_speed: speed over which mu falls from mu_s to mu_d, v_s [m/s].
    """

    friction: NonNegative
    pin_radius: Positive | None = None
    factor: Positive = 4.0 / math.pi
    static_friction: NonNegative | None = None
    stribeck_speed: Positive | None = None

    @property
    def has_friction(self) -> bool:
        """Whether the joints rub."""
        values = self.friction, self.static_friction
        return any(value is not None and is_true_somewhere(value > 0.0) for value in values)

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        """Problems of a chain joint's friction."""
        dynamic, static = node_value(node, "friction"), node_value(node, "static_friction")
        if are_numbers(dynamic, static) and static < dynamic:
            yield Problem(("static_friction",), static, f"must be at least friction, {dynamic:g}")
        if static is not None and node_value(node, "stribeck_speed") is None:
            text = f"missing; {allowed_text(cls, 'stribeck_speed')}; needed with static_friction"
            yield Problem(("stribeck_speed",), None, text, BARE)


class OuterLinks(Part):
    """Values of the outer links that differ from the inner ones'.

    Attributes:
        elongation: wear over the pitch [-].
        stiffness: stiffness of one outer link [N/m].
        damping: damping of one outer link [N s/m].
    """

    elongation: Elongation | None = None
    stiffness: Positive | None = None
    damping: NonNegative | None = None


class Chain(Part):
    """A chain: links between rollers that are point masses, eq. (1)-(3).

    Attributes:
        size: size of the catalogue, which fills pitch, roller_radius and mass, of a silent chain its kind.
        kind: "roller", or "silent" for plates whose toes press wheel teeth.
        pitch: unloaded length of a link [m].
        links: number of links, and of a loop's rollers.
        ends: names of the two sprockets without teeth that hold an open chain; None is a loop.
        roller_mass: mass of one pitch of chain [kg]; this or mass_per_length.
        mass_per_length: mass of one meter of chain [kg/m].
        stiffness: stiffness of one link [N/m]; "estimate" is the catalogue's for the size.
        damping: damping of one link [N s/m]; this or damping_ratio.
        damping_ratio: damping ratio of one link, zeta [-]: damping = 2 zeta sqrt(stiffness mass).
        roller_radius: radius of the rollers [m].
        elongation: wear of every link over the pitch [-].
        worn_links: links with an elongation of their own.
        joint: friction of its joints.
        outer: values of the outer links, those of even index, where they differ.
        play: way that a link moves out or in before its spring acts, s [m]; None is 0.
        attachments: masses on links.
        load: goods on a strand.
        flank_angle: angle of a toe's flank to its link's normal [degrees]; None is 30.
        flank_distance: distance of a flank's line from its pin's axis [m]; None is 0.375 p.
        back_height: height of the back above the line of the pins [m]; None is 0.4 p.
        toe_depths: depths below that line where a flank begins and ends [m]; None is 0.2 p, 0.5 p.
        tip_radius: rounding of a flank's ends [m]; None is 0.05 p.
    """

    size: Size | None = None
    kind: Kind = "roller"
    pitch: Positive
    links: Links
    ends: Ends | None = None
    roller_mass: Positive | None = None
    mass_per_length: Positive | None = None
    stiffness: Stiffness
    damping: NonNegative | None = None
    damping_ratio: NonNegative | None = None
    roller_radius: Positive
    elongation: Elongation = 0.0
    worn_links: Annotated[tuple[WornLink, ...], Allowed("must be a list of tables { link, elongation }")] = ()
    joint: Annotated[Joint | None, Allowed("must be a table { friction, pin_radius }")] = None
    outer: Annotated[OuterLinks | None, Allowed("must be a table { elongation, stiffness, damping }")] = None
    play: NonNegative | None = None
    attachments: Annotated[tuple[Attachment, ...], Allowed("must be a list of tables { mass, every, first }")] = ()
    load: Annotated[StrandLoad | None, Allowed("must be a table { load_per_length, between }")] = None
    flank_angle: FlankAngle | None = None
    flank_distance: Positive | None = None
    back_height: Positive | None = None
    toe_depths: PositivePair | None = None
    tip_radius: Positive | None = None

    _replaces: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "size": ("kind", "pitch", "roller_radius", "roller_mass", "mass_per_length", "stiffness"),
        "roller_mass": ("mass_per_length",),
        "mass_per_length": ("roller_mass",),
        "damping": ("damping_ratio",),
        "damping_ratio": ("damping",),
    }
    _filled: ClassVar[tuple[str, ...]] = ("pitch", "roller_radius")
    """Keys of a chain that a size fills."""
    _judged: ClassVar[frozenset[str]] = frozenset(
        {"links", "pitch", "roller_radius", "play", "worn_links", "attachments", *PLATE_KEYS}
    )

    @property
    def is_open(self) -> bool:
        """Whether the chain has ends, with a link absent between."""
        return self.ends is not None

    @property
    def is_silent(self) -> bool:
        """Whether the chain has toothed plates in place of rollers."""
        return self.kind == "silent"

    @property
    def plate(self) -> Plate:
        """Plate of a silent chain."""
        return chain_plate(self)

    @property
    def rollers(self) -> int:
        """Number of the chain's rollers, N."""
        return self.links + self.is_open

    @property
    def bare_mass(self) -> float:
        """Mass of a roller with its links, without attachments [kg]."""
        if self.roller_mass is not None:
            return self.roller_mass
        assert self.mass_per_length is not None  # the chain's own rule
        return self.mass_per_length * self.pitch

    @property
    def mass(self) -> float:
        """Mean mass of a roller, with links and attachments [kg]."""
        if not self.attachments:
            return self.bare_mass
        import numpy as np

        masses = self.roller_masses
        first = masses[..., 0]  # which is exact where all are alike
        mean = np.where((masses == first[..., None]).all(axis=-1), first, masses.mean(axis=-1))
        return mean if mean.ndim else float(mean)  # type: ignore[return-value]

    @property
    def lightest_mass(self) -> float:
        """Mass of the lightest roller, with links and attachments [kg]."""
        if not self.attachments:
            return self.bare_mass
        least = self.roller_masses.min(axis=-1)
        return least if least.ndim else float(least)

    @property
    def roller_masses(self) -> NDArray[np.float64]:
        """Masses of rollers, with links and attachments, (N,) or (V, N) [kg]."""
        import numpy as np

        columns: tuple[Any, ...] = self.bare_mass, *(of.mass for of in self.attachments)
        variants = next((len(column) for column in columns if has_arrays(column)), None)
        added = np.zeros(self.rollers if variants is None else (variants, self.rollers))
        rows = added.T
        for of in self.attachments:
            at = of.bearing_links(self.links)
            rows[at] += 0.5 * of.mass
            rows[(at + 1) % self.rollers] += 0.5 * of.mass
        return with_last_axis(self.bare_mass) + added

    @property
    def relative_masses(self) -> NDArray[np.float64]:
        """Masses of rollers over their mean, (N,) or (V, N)."""
        return self.roller_masses / with_last_axis(self.mass)

    @property
    def link_damping(self) -> float:
        """Damping of one link [N s/m]."""
        if self.damping is not None:
            return self.damping
        assert self.damping_ratio is not None  # the chain's own rule
        return 2.0 * self.damping_ratio * sqrt(self.stiffness * self.mass)

    @property
    def link_play(self) -> float:
        """Play of a link [m]."""
        return 0.0 if self.play is None else self.play

    @property
    def outer_pitch(self) -> float:
        """Unloaded length of an outer link [m]."""
        own = None if self.outer is None else self.outer.elongation
        return self.pitch * (1.0 + (self.elongation if own is None else own))

    @property
    def outer_stiffness(self) -> float:
        """Stiffness of an outer link [N/m]."""
        return self.stiffness if self.outer is None or self.outer.stiffness is None else self.outer.stiffness

    @property
    def outer_damping(self) -> float:
        """Damping of an outer link [N s/m]."""
        return self.link_damping if self.outer is None or self.outer.damping is None else self.outer.damping

    @property
    def mean_stiffness(self) -> float:
        """Stiffness of equal links in as stiff a chain [N/m]."""
        if self.outer is None:
            return self.stiffness
        series: float = 2.0 / (1.0 / self.stiffness + 1.0 / self.outer_stiffness)
        return where(self.outer_stiffness == self.stiffness, self.stiffness, series)

    @property
    def varied_links(self) -> bool:
        """Whether links differ in more than length, or have play."""
        played = self.play is not None and is_true_somewhere(self.play > 0.0)
        if self.outer is None:
            return played
        alike = (self.outer_stiffness == self.stiffness) & (self.outer_damping == self.link_damping)
        return played | (alike ^ True)

    @property
    def worn_pitch(self) -> float:
        """Mean length of a link where tension begins [m]."""
        inner = self.pitch * (1.0 + self.elongation)
        if self.outer is None:
            return inner + self.link_play
        return where(self.outer_pitch == inner, inner, 0.5 * (inner + self.outer_pitch)) + self.link_play

    @property
    def pulled_pair(self) -> tuple[float, float]:
        """Lengths of inner and outer links where tension begins [m]."""
        inner = self.pitch * (1.0 + self.elongation)
        return inner + self.link_play, self.outer_pitch + self.link_play

    @property
    def link_lengths(self) -> NDArray[np.float64]:
        """Unloaded lengths of links, (N,) or (V, N) [m]."""
        import numpy as np

        inner, outer = self.pitch * (1.0 + self.elongation), self.outer_pitch
        links: Any = self.worn_links[0].link if self.worn_links else 0  # of a stack, arrays of all worn ones or of none
        columns: tuple[Any, ...] = inner, outer, links
        variants = next((len(column) for column in columns if has_arrays(column)), None)
        lengths = np.empty(self.rollers if variants is None else (variants, self.rollers))
        rows, own = lengths.T, np.arange(len(links)) if has_arrays(links) else None
        rows[:] = inner
        if self.outer is not None:
            rows[::2] = outer
        for worn in self.worn_links:
            rows[worn.link if own is None else (worn.link, own)] = self.pitch * (1.0 + worn.elongation)
        return lengths

    @property
    def pulled_lengths(self) -> NDArray[np.float64]:
        """Lengths of links where tension begins, (N,) or (V, N) [m]."""
        return self.link_lengths + with_last_axis(self.link_play)

    @property
    def has_friction(self) -> bool:
        """Whether the chain's joints rub."""
        return self.joint is not None and self.joint.has_friction

    @property
    def pin_radius(self) -> float | None:
        """Radius of the chain's pins [m]; None without size."""
        if self.joint is not None and self.joint.pin_radius is not None:
            return self.joint.pin_radius
        return None if self.size is None else CHAINS[self.size].pin_radius

    @property
    def joint_area(self) -> float | None:
        """Bearing area of a chain's joint [m^2]; None without size."""
        if self.size is None or self.pin_radius is None:
            return None
        size = CHAINS[self.size]
        return 2.0 * self.pin_radius * size.bearing_share * size.inner_width * size.strands

    @property
    def breaking_load(self) -> float | None:
        """Least tensile strength of the chain [N]; None without size."""
        return None if self.size is None else CHAINS[self.size].breaking_load

    @property
    def stiffness_is_estimate(self) -> bool:
        """Whether the chain's stiffness is the catalogue's estimate."""
        return self.size is not None and self.stiffness == CHAINS[self.size].estimated_stiffness

    @classmethod
    def _unsaid_values(cls, values: Mapping[str, Any]) -> Mapping[str, Any]:
        """Roller radius of a silent chain, unsaid by files."""
        return {"roller_radius": values.get("roller_radius")} if values.get("kind") == "silent" else {}

    @classmethod
    def _complete_values(cls, values: Any) -> Any:
        """Values of a chain with those that its size fills."""
        if not isinstance(values, Mapping):
            return values
        if isinstance(size := values.get("size"), str):
            values = cls._with_values_of_size(values, size)
        return values if values.get("kind") in (None, "roller") else _with_back_as_radius(values)

    @classmethod
    def _with_values_of_size(cls, values: Mapping[str, Any], size: str) -> Mapping[str, Any]:
        """Values of a chain with those of a catalogue size."""
        if size not in CHAINS:  # which its own rule says; the stiffness that asks for its estimate is right
            return dict(values) | {"stiffness": 1.0} if values.get("stiffness") == ESTIMATE else values
        chain = CHAINS[size]
        filled: dict[str, Any] = {"kind": chain.kind, "pitch": chain.pitch}
        if chain.kind == "roller":
            filled["roller_radius"] = chain.roller_radius
        if values.get("roller_mass") is None:
            filled["mass_per_length"] = chain.mass_per_length
        whole = dict(values) | {key: value for key, value in filled.items() if values.get(key) is None}
        return whole | {"stiffness": chain.estimated_stiffness} if values.get("stiffness") == ESTIMATE else whole

    @classmethod
    def _missing_key_problem(cls, key: str, node: Any) -> Problem:
        """Problem of a chain's missing key, or of its size."""
        if node_value(node, "size") is not None and key in cls._filled:
            return Problem(("size",), node_value(node, "size"), _size_text(node_value(node, "size")))
        return super()._missing_key_problem(key, node)

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        """Problems of a chain's values."""
        radius, pitch = node_value(node, "roller_radius"), node_value(node, "pitch")
        if node_value(node, "size") is None or node_value(node, "roller_mass") is not None:
            yield from exactly_one_rule(node, "roller_mass", "mass_per_length")
        size, kind = node_value(node, "size"), node_value(node, "kind")
        if isinstance(size, str) and size in CHAINS and kind is not None and kind != CHAINS[size].kind:
            yield Problem(("kind",), kind, f'must be "{CHAINS[size].kind}", as size {size} is')
        yield from at_most_rule(node, "links", MOST_LINKS)
        if node_value(node, "outer") is not None and are_numbers(links := node_value(node, "links")) and links % 2:
            yield Problem(("links",), links, "must be even where outer links differ")
        play = node_value(node, "play")
        if are_numbers(play, pitch) and play > 0.1 * pitch > 0:
            yield Problem(("play",), play, f"must be at most a tenth of the pitch, {pitch / 10:g}")
        joint = node_value(node, "joint")
        if joint is not None and node_value(joint, "pin_radius") is None and node_value(node, "size") is None:
            text = "missing; must be a positive number; needed without a size"
            yield Problem(("joint", "pin_radius"), None, text, BARE)
        links, seen = node_value(node, "links"), set()
        listed = node_list(node, "worn_links")
        if are_numbers(links) and len(listed) > links:
            yield Problem(("worn_links",), None, f"has {len(listed)} elements; the chain has {links} links", BARE)
            listed = []
        for i, worn in enumerate(listed):
            link = node_value(worn, "link")
            if are_numbers(link, links) and link >= links:
                yield Problem(("worn_links", i, "link"), link, f"must be below the number of links, {links}")
            if are_numbers(link) and link in seen:
                yield Problem(("worn_links", i, "link"), link, "must be another link than those before")
            seen.add(link if are_numbers(link) else None)
        listed = node_list(node, "attachments")
        if are_numbers(links) and len(listed) > links:
            yield Problem(("attachments",), None, f"has {len(listed)} elements; the chain has {links} links", BARE)
            listed = []
        for i, one in enumerate(listed):
            first = node_value(one, "first")
            if are_numbers(first, links) and first >= links:
                yield Problem(("attachments", i, "first"), first, f"must be below the number of links, {links}")
        yield from exactly_one_rule(node, "damping", "damping_ratio", "must be a number of at least 0")
        yield from _plate_rules(node)
        if are_numbers(radius, pitch) and radius >= pitch / 2 > 0 and node_value(node, "kind") != "silent":
            yield Problem(("roller_radius",), radius, f"must be below half the pitch, {pitch / 2:g}")


def _plate_rules(node: Any) -> Iterable[Problem]:
    """Problems of a silent chain's plates, or of plates' keys in other chains."""
    pitch, radius = node_value(node, "pitch"), node_value(node, "roller_radius")
    if node_value(node, "kind") != "silent":
        for key in PLATE_KEYS:
            if (value := node_value(node, key)) is not None:
                yield Problem((key,), value if are_numbers(value) else None, 'only together with kind = "silent"',
                              WRONG if are_numbers(value) else BARE)  # fmt: skip
        return
    for key in ("attachments", "load", "ends"):
        if node_value(node, key):
            yield Problem((key,), None, 'not together with kind = "silent"', BARE)
    own = {key: value for key in PLATE_KEYS if (value := node_value(node, key)) is not None}
    depths = own.pop("toe_depths", (pitch, pitch))
    if not isinstance(depths, list | tuple) or len(depths) != 2:
        return
    if not are_numbers(*(numbers := (pitch, *depths, *own.values()))) or min(numbers) <= 0.0:
        return
    if not 20.0 <= own.get("flank_angle", FLANK_ANGLE) <= 45.0:
        return
    plate = chain_plate(node)
    if are_numbers(radius) and radius != plate.back_height:
        yield Problem(("roller_radius",), radius, 'not together with kind = "silent"; give back_height')
    for key, value, text in plate_problems(plate):
        yield Problem((key,), value, text)


class NamedChain(Chain):
    """One of several chains of a drive.

    Attributes:
        name: unique among all parts; prefix of its strands and metrics.
        plane: name of its plane; chains of one plane must not cross.
    """

    name: Name
    plane: Name | None = None
