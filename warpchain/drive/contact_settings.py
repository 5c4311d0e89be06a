"""Contact settings of a drive: force law, restitution, and stiffness or materials."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, Field, create_model
from pydantic_core import PydanticCustomError

from warpchain.drive.laws import LAWS, Means, is_law
from warpchain.drive.schema import (
    BARE,
    WRONG,
    Allowed,
    NonNegative,
    Part,
    Positive,
    Problem,
    Switch,
    Value,
    allowed_text,
    are_numbers,
    node_value,
)

MATERIALS = ("width", "reference_load", "roller", "partner")
"""Keys from which a contact's stiffness is computed."""


def _check_law(value: str) -> str:
    """The name of a contact law, if it is known."""
    if not is_law(value):
        raise PydanticCustomError(WRONG, f"must be one of {', '.join(map(repr, LAWS))}".replace("'", '"'))
    return value


LawName = Annotated[
    str,
    Field(strict=True),
    Value("must be one of " + ", ".join(f'"{name}"' for name in LAWS)),
    AfterValidator(_check_law),
]
RestitutionMeans = Annotated[Means, Value('must be "parameter" or "rebound"')]
Restitution = Annotated[float, Field(strict=True, gt=0, le=1), Value("must be a number above 0, at most 1")]
Exponent = Annotated[float, Field(strict=True, ge=1, allow_inf_nan=False), Value("must be a number of at least 1")]
PoissonsRatio = Annotated[float, Field(strict=True, gt=-1, le=0.5), Value("must be a number above -1, at most 0.5")]
SeatAngle = Annotated[
    float, Field(strict=True, gt=0, lt=180), Value("must be a number of degrees above 0 and below 180")
]


class Material(Part):
    """An elastic, isotropic material.

    Attributes:
        youngs_modulus: Young's modulus [Pa].
        poissons_ratio: Poisson's ratio [-].
    """

    youngs_modulus: Positive
    poissons_ratio: PoissonsRatio


Body = Annotated[Material, Allowed("must be a table { youngs_modulus, poissons_ratio }")]

_STIFFNESS_OR_MATERIALS: Mapping[str, tuple[str, ...]] = {"stiffness": MATERIALS} | {
    key: ("stiffness",) for key in MATERIALS
}


def _stiffness_conflict_rules(node: Any) -> Iterator[Problem]:
    """Problems of a contact with both a stiffness and materials."""
    given = [key for key in MATERIALS if node_value(node, key) is not None]
    if node_value(node, "stiffness") is not None and given:
        text = f"not together with {', '.join(given)}; give stiffness, or {', '.join(MATERIALS)}"
        yield Problem(("stiffness",), node_value(node, "stiffness"), text)


def contact_stiffness_rules(node: Any) -> Iterator[Problem]:
    """Problems of a contact whose stiffness is given twice or not at all."""
    absent = [key for key in MATERIALS if node_value(node, key) is None]
    if node_value(node, "stiffness") is None and len(absent) == len(MATERIALS):
        text = f"missing; must be a positive number, or give {', '.join(MATERIALS)} instead"
        yield Problem(("stiffness",), None, text, BARE)
    elif node_value(node, "stiffness") is None:
        for key in absent:
            yield Problem((key,), None, f"missing; {allowed_text(ImpactLaw, key)}, or give stiffness instead", BARE)
    yield from _stiffness_conflict_rules(node)


def friction_rules(node: Any) -> Iterator[Problem]:
    """Problems of a contact's coefficients of friction."""
    dynamic, resting, speed = (node_value(node, key) for key in ("friction", "static_friction", "stribeck_speed"))
    if are_numbers(resting, dynamic) and resting < dynamic:
        yield Problem(("static_friction",), resting, f"must be at least friction, {dynamic:g}")
    for key, given, other in (("static_friction", resting, speed), ("stribeck_speed", speed, resting)):
        if given is None and other is not None:
            text = "missing; static_friction and stribeck_speed are given together"
            yield Problem((key,), None, text, BARE)


def contact_rules(node: Any) -> Iterator[Problem]:
    """Problems of a contact's values that contradict each other."""
    yield from contact_stiffness_rules(node)
    law, exponent = node_value(node, "law"), node_value(node, "exponent")
    if isinstance(law, str) and law in LAWS and LAWS[law].viscous and exponent not in (None, 1.0):
        yield Problem(("exponent",), exponent, f'must be 1 with law = "{law}", which is linear')
    yield from friction_rules(node)
    if node_value(node, "rolling") is True and node_value(node, "friction") is None:
        yield Problem(("friction",), None, f"missing; {allowed_text(ImpactLaw, 'friction')}; needed with rolling", BARE)


class ImpactLaw(Part):
    """A contact's force, never negative; by default K pen^n (1 + 3/4 (1 - e^2) v / v0).

    Pedersen et al. 2004, eq. (15), (18), (19); other laws: `warpchain.drive.laws`.

    Attributes:
        law: name of the contact law.
        restitution: coefficient of restitution, e [-].
        restitution_means: "parameter", e of the law's formula; or "rebound", e of a free roller.
        exponent: exponent of the penetration, n [-]; 1 is the linearised cylinder contact.
        impact_speed_floor: least approach speed at the begin of a contact, v0 [m/s].
        stiffness: generalized stiffness, K [N/m^n]; or width, load and materials.
        width: length of the line contact [m].
        reference_load: load at which materials give K [N].
        roller, partner: materials of roller and partner.
        friction: coefficient of dry friction, mu_d [-].
        static_friction: coefficient at rest, mu_s [-]; None is mu_d.
        stribeck_speed: v_s in mu = mu_d + (mu_s - mu_d) exp(-(v / v_s)^2) [m/s].
    """

    law: LawName = "lankarani-nikravesh"
    restitution: Restitution
    restitution_means: RestitutionMeans = "parameter"
    exponent: Exponent = 1.0
    impact_speed_floor: Positive
    stiffness: Positive | None = None
    width: Positive | None = None
    reference_load: Positive | None = None
    roller: Body | None = None
    partner: Body | None = None
    friction: NonNegative | None = None
    static_friction: NonNegative | None = None
    stribeck_speed: Positive | None = None

    _replaces: ClassVar[Mapping[str, tuple[str, ...]]] = _STIFFNESS_OR_MATERIALS

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        """Problems of a contact's values."""
        yield from contact_rules(node)


class GuideContact(ImpactLaw):
    """Contact of rollers with guides.

    Attributes:
        rolling: rollers roll on the guide: friction is at most what the bush transmits.
    """

    rolling: Switch | None = None


class SprocketContact(ImpactLaw):
    """Contact of rollers with sprocket teeth.

    Attributes:
        profile: shape of the tooth gap.
        gap: "minimum" or "maximum" gap, with profile "iso606".
        seat_angle: angle of the seat arc [degrees]; None is 140 - 90/z, less for few teeth.
        clearance: radius of the seat less radius of the roller [m]; needed with profile "circular".
        bush_stiffness: stiffness of bush and pin, in series with the tooth [N/m]; None is rigid.
    """

    profile: Annotated[Literal["circular", "iso606"], Value('must be "circular" or "iso606"')] = "circular"
    gap: Annotated[Literal["minimum", "maximum"], Value('must be "minimum" or "maximum"')] | None = None
    seat_angle: SeatAngle | None = None
    clearance: NonNegative | None = None
    bush_stiffness: Positive | None = None

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        """Problems of a sprocket contact's values."""
        yield from contact_rules(node)
        exponent = node_value(node, "exponent")
        curved = isinstance(exponent, (int, float)) and exponent > 1.0
        if node_value(node, "bush_stiffness") is not None and curved:
            yield Problem(("exponent",), exponent, "must be 1 with bush_stiffness, which is linear")
        if node_value(node, "profile") == "iso606":
            if node_value(node, "gap") is None:
                yield Problem(("gap",), None, f"missing; {allowed_text(cls, 'gap')}", BARE)
            for key in ("clearance", "seat_angle"):
                if node_value(node, key) is not None:
                    yield Problem((key,), node_value(node, key), 'not together with profile = "iso606", which sets it')
        else:
            if node_value(node, "clearance") is None:
                yield Problem(("clearance",), None, f"missing; {allowed_text(cls, 'clearance')}", BARE)
            if node_value(node, "gap") is not None:
                yield Problem(("gap",), node_value(node, "gap"), 'only together with profile = "iso606"')


class _Overrides(Part):
    """Contact settings of one guide in place of those in `[contact.guide]`."""

    _like: ClassVar[type[Part] | None] = GuideContact
    _replaces: ClassVar[Mapping[str, tuple[str, ...]]] = _STIFFNESS_OR_MATERIALS

    @classmethod
    def _rules(cls, node: Any) -> Iterable[Problem]:
        """Problems of one guide's contact settings."""
        yield from _stiffness_conflict_rules(node)


if TYPE_CHECKING:
    GuideOverrides = _Overrides
else:  # none of which must be given
    _KEYS = {key: (field.rebuild_annotation() | None, None) for key, field in GuideContact.model_fields.items()}
    GuideOverrides = create_model("GuideOverrides", __base__=_Overrides, __module__=__name__, **_KEYS)
    GuideOverrides.__doc__ = _Overrides.__doc__


class Contact(Part):
    """The contacts of a drive.

    Attributes:
        sprocket: rollers with sprockets.
        guide: rollers with guides; needed where there are any.
    """

    sprocket: SprocketContact
    guide: GuideContact | None = None


def merged_contact_values(base: Any, overrides: Any) -> dict[str, Any]:
    """Contact settings of a guide by key, its own over the common ones."""
    keys = GuideOverrides.model_fields
    own = {key: node_value(overrides, key) for key in keys if node_value(overrides, key) is not None}
    gone = {other for key in own for other in _STIFFNESS_OR_MATERIALS.get(key, ())}
    common = {key: node_value(base, key) for key in keys if key not in gone and node_value(base, key) is not None}
    return common | own
