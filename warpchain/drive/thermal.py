"""Sizes and oil of a drive at its temperature."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, NamedTuple

from pydantic import Field, WithJsonSchema

from warpchain.drive.schema import BARE, Allowed, Part, Problem, Value, node_value
from warpchain.drive.viscosity import REFERENCE, THICKEST, THINNEST

COLDEST, HOTTEST = -100.0, 300.0
"""Coldest and hottest temperature of a drive [degrees C]."""
MATERIALS = {"steel": 12e-6, "aluminum": 23e-6, "cast iron": 11e-6}
"""Coefficients of linear expansion by material [1/K]."""

_NAMES = ", ".join(f'"{name}"' for name in MATERIALS)
_Number = Annotated[float, Field(strict=True, ge=0.0, le=1e-3)]
Coefficient = Annotated[
    Annotated[_Number, WithJsonSchema({"anyOf": [{"type": "number", "minimum": 0}, {"enum": list(MATERIALS)}]})],
    Value(f"must be a number per kelvin from 0 to 1e-3, or {_NAMES}"),
]
Temperature = Annotated[
    float,
    Field(strict=True, ge=COLDEST, le=HOTTEST),
    Value(f"must be a number of degrees C from {COLDEST:g} to {HOTTEST:g}"),
]


class Expansion(Part):
    """Coefficients of linear expansion, or names of materials.

    Attributes:
        block: coefficient of the housing that holds centers, guides and pivots [1/K].
        wheels: coefficient of the sprockets [1/K].
        chain: coefficient of the chains [1/K].
    """

    block: Coefficient = MATERIALS["aluminum"]
    wheels: Coefficient = MATERIALS["steel"]
    chain: Coefficient = MATERIALS["steel"]

    @classmethod
    def _complete_values(cls, values: Any) -> Any:
        """Values of an expansion with materials as numbers."""
        if not isinstance(values, Mapping):
            return values
        return {key: MATERIALS.get(value, value) if isinstance(value, str) else value for key, value in values.items()}


Expansions = Annotated[Expansion | None, Allowed("must be a table { block, wheels, chain }")]


class ExpansionRule(NamedTuple):
    """Part with which a number of drive files expands.

    Attributes:
        of: key of `Expansion`.
        power: of its factor.
    """

    of: str
    power: int = 1


_BLOCK, _WHEELS, _CHAIN = ExpansionRule("block"), ExpansionRule("wheels"), ExpansionRule("chain")
GROWS = {
    "chain.pitch": _CHAIN,
    "chain.mass_per_length": ExpansionRule("chain", -1),
    "chain.roller_radius": _CHAIN,
    "chain.joint.pin_radius": _CHAIN,
    "chain.play": _CHAIN,
    "chain.flank_distance": _CHAIN,
    "chain.back_height": _CHAIN,
    "chain.toe_depths": _CHAIN,
    "chain.tip_radius": _CHAIN,
    "sprockets.center": _BLOCK,
    "sprockets.pitch": _WHEELS,
    "sprockets.tooth.seat_radius": _WHEELS,
    "sprockets.tooth.flank_radius": _WHEELS,
    "sprockets.tooth.tip_radius": _WHEELS,
    "sprockets.balance_wheel.radius": _WHEELS,
    "sprockets.bearing.radius": _WHEELS,
    "sprockets.rim": _WHEELS,
    "guides.start": _BLOCK,
    "guides.end": _BLOCK,
    "guides.end_radius": _BLOCK,
    "guides.points": _BLOCK,
    "guides.radius": _BLOCK,
    "guides.arcs.center": _BLOCK,
    "guides.arcs.radius": _BLOCK,
    "guides.profile": _BLOCK,
    "guides.bolts": _BLOCK,
    "guides.offset": _CHAIN,
    "guides.contact.width": _BLOCK,
    "arms.pivot": _BLOCK,
    "arms.center": _BLOCK,
    "arms.spring.at": _BLOCK,
    "arms.spring.anchor": _BLOCK,
    "tensioners.at": _BLOCK,
    "contact.sprocket.width": _WHEELS,
    "contact.sprocket.clearance": _WHEELS,
    "contact.guide.width": _BLOCK,
    "probes.at": _BLOCK,
    "probes.radius": _BLOCK,
    "gears.module": _WHEELS,
}
"""Expansion of numbers by key, others constant."""


def has_other_temperature(drive: Any) -> bool:
    """Whether a drive's temperature is not the reference."""
    return drive.temperature is not None and drive.temperature != REFERENCE


def expansion_factor(drive: Any, of: str) -> float:
    """Thermal expansion l/l_0 of a part of a drive [-]."""
    if not has_other_temperature(drive):
        return 1.0
    assert drive.temperature is not None
    coefficient: float = getattr(drive.expansion or Expansion(), of)
    return 1.0 + coefficient * (drive.temperature - REFERENCE)


def expanded_parts(drive: Any) -> dict[str, Any]:
    """Parts of a drive that change at its temperature, by key."""
    factors = {of: expansion_factor(drive, of) for of in Expansion.model_fields}
    found: dict[str, Any] = {}
    for key, value in drive.__dict__.items():
        new = _expanded_value(value, "chain" if key == "chains" else key, factors)
        if new is not value:
            found[key] = new
    for key in ("chain", "chains"):
        if found.get(key):
            found[key] = _chains_with_pins(found[key], factors["chain"])
    if factors["wheels"] != factors["chain"]:
        found |= _wheel_changes(drive, found, factors)
    tensioners = found.get("tensioners", ())
    found["tensioners"] = tuple(_tensioner_with_oil(tensioner, drive.temperature) for tensioner in tensioners)
    return found


def _expanded_value(value: Any, path: str, factors: Mapping[str, float]) -> Any:
    """A part, number or list at temperature, itself if unchanged."""
    if isinstance(value, Part):
        new = {key: _expanded_value(inner, f"{path}.{key}", factors) for key, inner in value.__dict__.items()}
        changed = {key: inner for key, inner in new.items() if inner is not value.__dict__[key]}
        return value.model_copy(update=changed) if changed else value
    if isinstance(value, tuple) and value and isinstance(value[0], Part):
        return tuple(_expanded_value(inner, path, factors) for inner in value)
    if path not in GROWS or value is None:
        return value
    of, power = GROWS[path]
    return _scaled_value(value, factors[of] ** power)


def _scaled_value(value: Any, factor: float) -> Any:
    """A number, or each of a list, times an expansion factor."""
    return tuple(_scaled_value(inner, factor) for inner in value) if isinstance(value, tuple) else value * factor


def _chains_with_pins(chain: Any, factor: float) -> Any:
    """Chains with the pins of their sizes, expanded."""
    if isinstance(chain, tuple):
        return tuple(_chains_with_pins(one, factor) for one in chain)
    if chain.joint is None or chain.joint.pin_radius is not None:
        return chain
    return chain.model_copy(update={"joint": chain.joint.model_copy(update={"pin_radius": factor * chain.pin_radius})})


def _wheel_changes(drive: Any, found: Mapping[str, Any], factors: Mapping[str, float]) -> dict[str, Any]:
    """Pitch and clearance of sprockets that expand unlike the chain."""
    chains = drive.each_chain
    pitches = {node_value(chain, "name"): chain.pitch for chain in chains}
    radii = [chain.roller_radius for chain in chains]
    sprockets = tuple(
        sprocket if sprocket.pitch is not None
        else sprocket.model_copy(update={"pitch": factors["wheels"] * pitches[sprocket.chain]})
        for sprocket in found["sprockets"]
    )  # fmt: skip
    contact = found.get("contact", drive.contact)
    law = contact.sprocket
    if law.clearance is None:
        return {"sprockets": sprockets}
    clearance = law.clearance + min(radius * (factors["wheels"] - factors["chain"]) for radius in radii)
    law = law.model_copy(update={"clearance": clearance})
    return {"sprockets": sprockets, "contact": contact.model_copy(update={"sprocket": law})}


def _tensioner_with_oil(tensioner: Any, temperature: float | None) -> Any:
    """A tensioner with its oil at a temperature."""
    law = None if tensioner.oil is None else tensioner.oil.walther
    if law is None:
        return tensioner
    own = {"viscosity": law.viscosity(temperature), "viscosity_40": None, "viscosity_100": None}
    return tensioner.model_copy(update={"oil": tensioner.oil.model_copy(update=own)})


def clearance_rules(drive: Any) -> Iterator[Problem]:
    """Problems of rollers that do not fit seats at temperature."""
    clearance = drive.contact.sprocket.clearance
    if clearance is not None and clearance < 0.0:
        text = "must be at least 0: wheels of another material than the chain grow into its rollers"
        yield Problem(("contact", "sprocket", "clearance"), clearance, text)


def oil_rules(drive: Any) -> Iterator[Problem]:
    """Problems of oils unknown or solid at the drive's temperature."""
    temperature = drive.temperature
    assert temperature is not None
    for t, tensioner in enumerate(drive.tensioners):
        if tensioner.oil is None:
            continue
        law = tensioner.oil.walther
        if law is None:
            text = f"missing; needed with viscosity_100 where temperature is not {REFERENCE:g} degrees C"
            yield Problem(("tensioners", t, "oil", "viscosity_40"), None, text, BARE)
        elif not THINNEST <= (viscosity := law.viscosity(temperature)) <= THICKEST:
            low, high = law.temperature(THICKEST), law.temperature(THINNEST)
            text = (
                f"the oil of tensioners.{tensioner.name} would have {viscosity:.3g} m^2/s; must be from {low:.0f} to "
                f"{high:.0f} degrees C, where it has the {THINNEST:g} to {THICKEST:g} for which ASTM D341 holds"
            )
            yield Problem(("temperature",), temperature, text)
