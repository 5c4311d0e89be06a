"""Quantities with units in drive files, such as "540 rpm", and the units of keys."""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Iterator
from fractions import Fraction
from functools import cache
from typing import NamedTuple


class Unit(NamedTuple):
    """Unit: factor to SI, power of pi, and powers of m, kg, s, rad."""

    factor: Fraction
    pi: int = 0
    powers: tuple[int, int, int, int] = (0, 0, 0, 0)

    def times(self, other: Unit, power: int) -> Unit:
        """The unit times a power of another."""
        powers = tuple(a + power * b for a, b in zip(self.powers, other.powers, strict=True))
        return Unit(self.factor * other.factor**power, self.pi + power * other.pi, powers)  # type: ignore[arg-type]


ONE = Unit(Fraction(1))
METER, KILOGRAM, SECOND, RADIAN = (1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)
NEWTON, TORQUE, PASCAL, HERTZ, TURNING = (1, 1, -2, 0), (2, 1, -2, 0), (-1, 1, -2, 0), (0, 0, -1, 0), (0, 0, -1, 1)
WATT = (2, 1, -3, 0)
UNITS = {
    name: Unit(Fraction(factor), pi, powers)
    for names, factor, pi, powers in (
        ("m", "1", 0, METER), ("mm", "1e-3", 0, METER), ("cm", "1e-2", 0, METER), ("um µm μm", "1e-6", 0, METER),
        ("in inch", "0.0254", 0, METER), ("kg", "1", 0, KILOGRAM), ("g", "1e-3", 0, KILOGRAM),
        ("s", "1", 0, SECOND), ("ms", "1e-3", 0, SECOND), ("us µs μs", "1e-6", 0, SECOND), ("min", "60", 0, SECOND),
        ("rad", "1", 0, RADIAN), ("deg degrees °", "1/180", 1, RADIAN), ("rev", "2", 1, RADIAN),
        ("rpm", "1/30", 1, TURNING), ("Hz", "1", 0, HERTZ), ("kHz", "1e3", 0, HERTZ),
        ("W", "1", 0, WATT), ("kW", "1e3", 0, WATT),
        ("hp", "745.69987158227022", 0, WATT),
        ("N", "1", 0, NEWTON), ("mN", "1e-3", 0, NEWTON), ("kN", "1e3", 0, NEWTON), ("MN", "1e6", 0, NEWTON),
        ("daN", "10", 0, NEWTON), ("kgf", "9.80665", 0, NEWTON), ("lbf", "4.4482216152605", 0, NEWTON),
        ("Nm", "1", 0, TORQUE), ("kNm", "1e3", 0, TORQUE), ("lbf-ft", "1.3558179483314004", 0, TORQUE),
        ("lbf-in", "0.1129848290276167", 0, TORQUE),
        ("Pa", "1", 0, PASCAL), ("hPa", "1e2", 0, PASCAL), ("kPa", "1e3", 0, PASCAL), ("MPa", "1e6", 0, PASCAL),
        ("GPa", "1e9", 0, PASCAL), ("mbar", "1e2", 0, PASCAL), ("bar", "1e5", 0, PASCAL),
        ("psi", "6894.757293168361", 0, PASCAL), ("-", "1", 0, (0, 0, 0, 0)), ("%", "1e-2", 0, (0, 0, 0, 0)),
    )
    for name in names.split()
}  # fmt: skip
SPELLINGS = {
    word: sign
    for words, sign in (
        ("RPM Rpm r·p·m. U/min 1/min /min min-1 min^-1 r/min Umdr/min Upm tr/min giri/min obr/min", "rpm"),
        ("sec second seconds Second Seconds", "s"),
        ("msec", "ms"), ("inches Inch in. Zoll ″", "in"), ("kp", "kgf"), ("psia", "psi"), ("bara", "bar"),
        ("N-m", "Nm"), ("kN-m", "kNm"), ("lb-ft ft-lb ft-lbf lbf·ft ft·lbf lb·ft ft·lb", "lbf-ft"),
        ("lb-in in-lb in-lbf lbf·in in·lbf lb·in in·lb", "lbf-in"),
        ("Deg DEG degree CAD °CA degCA deg·CA °·CA °KW degKW deg·KW °·KW °crank deg·crank °CRK degCRK", "deg"),
        ("°NW degNW deg·NW °·NW °cam deg·cam °CAM degCAM", "deg"),
    )
    for word in words.split()
}  # fmt: skip
_SIGNS = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻−⋅∙×", "0123456789--···")

QUANTITY = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?+)\s*([A-Za-z°µμ%].*?)\s*")
LONGEST = 100
"""Most characters of a quantity."""
FACTOR = re.compile(r"([ */·]*)([^\s*/·^\d]+)\^?(-?\d{0,2})")


def match_quantity(text: str) -> re.Match[str] | None:
    """Match of a quantity's number and unit, or None."""
    return QUANTITY.fullmatch(text) if len(text) <= LONGEST else None


@cache
def unit_from_text(text: str) -> Unit | None:
    """Unit that a text such as "N s/m" names, or None."""
    if len(text) > LONGEST:
        return None
    text = re.sub(r"[ *]+|(?<=[A-Za-z])\.(?=[A-Za-z])", "·", text.strip().translate(_SIGNS))
    text = SPELLINGS.get(text, text)
    found, end = ONE, 0
    for match in FACTOR.finditer(text):
        mark, sign, power = match.groups()
        if match.start() != end or sign not in UNITS:
            return None
        found, end = found.times(UNITS[sign], int(power or 1) * (-1 if "/" in mark else 1)), match.end()
    return found if text and end == len(text) else None


@cache
def attribute_descriptions(kind: type) -> dict[str, str]:
    """Descriptions of a part's keys in the docstrings of its classes."""
    found: dict[str, str] = {}
    like = getattr(kind, "_like", None) or object
    for base in (*reversed(like.__mro__), *reversed(kind.__mro__)):
        block = re.search(r"^Attributes:\n((?:    .*\n?|\n)*)", inspect.cleandoc(base.__doc__ or ""), re.MULTILINE)
        entries = re.findall(r"^    (\w[\w, ]*): (.*(?:\n {5,}.*)*)", block[1] if block else "", re.MULTILINE)
        for names, words in entries:
            found |= dict.fromkeys(names.split(", "), " ".join(words.split()))
    return found


@cache
def unit_of_key(kind: type, key: str) -> str:
    """Unit of a part's key in its docstring's brackets, or ""."""
    named = re.search(r"\[([^\]]+)\]", attribute_descriptions(kind).get(key, ""))
    return named[1] if named and unit_from_text(named[1]) else ""


def equivalent_units(wanted: str) -> Iterator[str]:
    """Signs of units for the same quantity, `wanted` first."""
    powers = (unit_from_text(wanted) or ONE).powers
    yield from dict.fromkeys(
        [wanted, *(name for name, one in UNITS.items() if one.powers == powers and name.isascii())]
    )


def unit_factor(given: str, wanted: str) -> float | None:
    """Factor from one unit to another; None for unlike kinds."""
    one, other = unit_from_text(given), unit_from_text(wanted)
    if one is None or other is None or one.powers != other.powers:
        return None
    return float(one.factor / other.factor) * math.pi ** (one.pi - other.pi)


def converted_number(text: str, wanted: str) -> float | None:
    """Number of a quantity in a unit, or infinite; None for unlike kinds."""
    match, to = match_quantity(text), unit_from_text(wanted)
    given = unit_from_text(match[2]) if match else None
    if match is None or to is None or given is None or given.powers != to.powers:
        return None
    exact = Fraction(match[1]) * given.factor / to.factor
    try:
        return float(exact) * math.pi ** (given.pi - to.pi)
    except OverflowError:
        return math.inf if exact > 0 else -math.inf
