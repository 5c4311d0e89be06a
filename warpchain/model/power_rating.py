"""Power ratings of chains by standards, with lubrication and elongation limits."""

from __future__ import annotations

import math
from typing import NamedTuple

from warpchain.drive.catalogue import CHAINS, SERIES_A_STRENGTH
from warpchain.drive.stack_math import Number, minimum, power

HORSEPOWER, INCH, FOOT_A_MINUTE = 745.6998715822702, 0.0254, 0.00508
"""Imperial units [W], [m], [m/s]."""
STRAND_FACTORS = {1: 1.0, 2: 1.7, 3: 2.5}
"""Rated power over one strand's [-]."""
SERVICE_FACTORS = {
    "smooth": {"motor": 1.0, "hydraulic": 1.0, "engine": 1.2},
    "moderate": {"motor": 1.3, "hydraulic": 1.2, "engine": 1.4},
    "heavy": {"motor": 1.5, "hydraulic": 1.4, "engine": 1.7},
}
"""Service factors of power by load and driver (Tsubaki, Table 4.2)."""
RATED_HOURS = 15_000.0
"""Rated life up to the elongation limit [h]."""
LEFT_OUT = "acceleration, shocks beyond a service factor, vibration, guides and more than two sprockets"
"""Effects that power ratings leave out."""
WEAR_COEFFICIENT = 2e-16
"""Wear coefficient of oiled pin and bush, of ISO 10823's ratings [m^2/N]."""
LUBRICATION = {"A": "by hand or drop by drop", "B": "oil bath or disc", "C": "stream of oil under pressure"}
"""Lubrication classes of ASME B29.1."""
_LUBRICATED_TO = """
pitch  0.25  0.375   0.5  0.625  0.75     1  1.25   1.5  1.75     2  2.25   2.5     3
A       500    370   300    250   220   170   150   130   115   100    95    85    75
B      3500   2800  2300   2000  1800  1500  1300  1200  1100  1000   950   900   800
"""
"""Highest chain speeds [ft/min] by pitch [in] (Machinery's Handbook)."""


class SizeRating(NamedTuple):
    """Power rating coefficients of a chain size: K_s of plates, K_r of rollers."""

    plates: float
    rollers: float
    standard: str


def size_rating(size: str | None) -> SizeRating | None:
    """Power rating coefficients of a chain size, or None."""
    name = "" if size is None else size.partition("-")[0]
    if name not in CHAINS or size is None:
        return None
    chain, strands = CHAINS[name], STRAND_FACTORS[CHAINS[size].strands]
    plates, rollers, standard = 0.004, 17.0, "ASME B29.1"
    if name == "085":
        plates, rollers = 0.0022, 3.4
    elif name.endswith("C"):
        rollers = 29.0
    elif name.endswith("B"):
        plates *= chain.breaking_load / (SERIES_A_STRENGTH * chain.pitch**2)
        standard = "ISO 10823, an ESTIMATE by ASME B29.1"
    elif not (name.endswith(("A", "H")) and chain.standard):
        return None
    return SizeRating(strands * plates, strands * rollers, standard)


class RatedPower(NamedTuple):
    """Rated power of plates, and of rollers and bushings [W]."""

    plates: Number
    rollers: Number

    @property
    def least(self) -> Number:
        """Smaller of the rated powers [W]."""
        return minimum(self.plates, self.rollers)

    @property
    def limited_by(self) -> str:
        """Name of the part with the smaller rated power."""
        return "link plates" if self.plates <= self.rollers else "rollers and bushings"


def rated_power(size: str, teeth: int, speed: Number) -> RatedPower:
    """Rated power of a chain size [W].

    Args:
        teeth, speed: of the smaller sprocket [-], [rad/s].
    """
    rating, pitch, rpm = size_rating(size), CHAINS[size].pitch / INCH, speed * (30.0 / math.pi)
    assert rating is not None
    plates = HORSEPOWER * rating.plates * teeth**1.08 * pitch ** (3.0 - 0.07 * pitch)
    rollers = HORSEPOWER * 1000.0 * rating.rollers * teeth**1.5 * pitch**0.8
    return RatedPower(plates * power(rpm, 0.9), rollers * power(rpm, -1.5))


def lubrication_limits(pitch: float) -> tuple[float, float]:
    """Highest chain speeds of lubrication A and B [m/s]."""
    import numpy as np

    rows = [[math.log(float(cell)) for cell in line.split()[1:]] for line in _LUBRICATED_TO.split("\n")[1:-1]]
    slow, fast = (math.exp(float(np.interp(math.log(pitch / INCH), rows[0], row))) for row in rows[1:])
    return FOOT_A_MINUTE * slow, FOOT_A_MINUTE * fast


def lubrication_class(pitch: float, speed: float) -> str:
    """Lubrication class of a chain by pitch and speed."""
    slow, fast = lubrication_limits(pitch)
    return "A" if speed <= slow else "B" if speed <= fast else "C"


def elongation_limit(teeth: int) -> float:
    """Elongation limit of a chain [-]: 3 %, less above 67 teeth."""
    return 0.03 if teeth <= 67 else 2.0 / teeth
