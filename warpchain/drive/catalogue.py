"""Roller chains of ISO 606: pitch, roller, inner width, mass, breaking load, and an estimate of a link's stiffness.

Pitch, largest roller diameter, least width between inner plates and least tensile strength of simplex chains are those
of ISO 606:2015, Table 1 (series B, formerly DIN 8187; series A, formerly DIN 8188, with the strengths of ASME B29.1).
The standard sets no masses: these are a maker's, and approximate. See docs/catalogue.md.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

ELONGATION_AT_BREAKING_LOAD = 0.01
"""Elongation of a link at the breaking load, were it elastic up to there [-]: what the stiffness estimate assumes."""

INNER_WIDTHS = 1.48
"""Width over the inner link b_2 over that between its plates b_1, of ISO 606 within 3 %: what a bush is long."""


@dataclass(frozen=True)
class CatalogueChain:
    """A simplex roller chain of ISO 606.

    Attributes:
        size: ISO number, such as "16B".
        pitch: [m].
        roller_diameter: largest [m].
        inner_width: between the inner plates, least [m].
        pin_diameter: d2, largest [m].
        mass_per_length: approximate [kg/m].
        breaking_load: least tensile strength [N].
    """

    size: str
    pitch: float
    roller_diameter: float
    inner_width: float
    pin_diameter: float
    mass_per_length: float
    breaking_load: float

    @property
    def roller_radius(self) -> float:
        """Outer radius of the roller [m]."""
        return self.roller_diameter / 2.0

    @property
    def pin_radius(self) -> float:
        """Radius of the pin [m]."""
        return self.pin_diameter / 2.0

    @property
    def estimated_stiffness(self) -> float:
        """Estimate of the axial stiffness of one link [N/m]: breaking load / (0.01 pitch).

        It gives the order of magnitude; a measured stiffness may be a third of it, or three times as much.
        """
        return self.breaking_load / (ELONGATION_AT_BREAKING_LOAD * self.pitch)


_TABLE = """
size  pitch  roller  width    pin   kg/m  breaking load
05B      8       5      3   2.31   0.20    4.4
06B  9.525    6.35   5.72   3.28   0.41    8.9
08B   12.7    8.51   7.75   4.45   0.69   17.8
10B  15.875   10.16   9.65   5.08   0.93   22.2
12B  19.05   12.07  11.68   5.72   1.15   28.9
16B   25.4   15.88  17.02   8.28   2.71     60
20B  31.75   19.05  19.56  10.19   3.70     95
24B   38.1    25.4   25.4  14.63   7.10    160
28B  44.45   27.94  30.99  15.90   8.50    200
32B   50.8   29.21  30.99  17.81  10.25    250
40B   63.5   39.37   38.1  22.89  16.35    355
48B   76.2   48.26  45.72  29.24  25.00    560
56B   88.9   53.98  53.34  34.32  35.78    850
64B  101.6    63.5  60.96  39.40  46.00   1120
72B  114.3   72.39  68.58  44.48  60.80   1400
08A   12.7    7.92   7.85   3.98   0.62   13.9
10A  15.875   10.16    9.4   5.09   1.02   21.8
12A  19.05   11.91  12.57   5.96   1.50   31.3
16A   25.4   15.88  15.75   7.94   2.60   55.6
20A  31.75   19.05   18.9   9.54   3.91     87
24A   38.1   22.23  25.22  11.11   5.62    125
28A  44.45    25.4  25.22  12.71   7.50    170
32A   50.8   28.58  31.55  14.29  10.10    223
36A  57.15   35.71  35.48  17.46  13.45    281
40A   63.5   39.68  37.85  19.85  16.15    347
48A   76.2   47.63  47.35  23.81  23.20    500
"""


def _read(table: str) -> Iterator[CatalogueChain]:
    for row in table.split("\n")[2:-1]:
        size, pitch, roller, width, pin, mass, load = row.split()
        yield CatalogueChain(
            size=size,
            pitch=float(f"{pitch}e-3"),
            roller_diameter=float(f"{roller}e-3"),
            inner_width=float(f"{width}e-3"),
            pin_diameter=float(f"{pin}e-3"),
            mass_per_length=float(mass),
            breaking_load=float(f"{load}e3"),
        )


CHAINS: dict[str, CatalogueChain] = {chain.size: chain for chain in _read(_TABLE)}
"""The chains by size: series B, then series A, each from small to large."""


def listing() -> str:
    """The table for a terminal."""
    lines = ["size   pitch   roller  inner width    pin       mass   breaking load  stiffness estimate"]
    lines += [
        f"{chain.size}  {1e3 * chain.pitch:7.3f} {1e3 * chain.roller_diameter:7.2f} {1e3 * chain.inner_width:9.2f} "
        f"{1e3 * chain.pin_diameter:9.2f} mm "
        f"{chain.mass_per_length:7.2f} kg/m {1e-3 * chain.breaking_load:8.1f} kN {chain.estimated_stiffness:11.3g} N/m"
        for chain in CHAINS.values()
    ]
    lines += [
        "",
        'In a drive file: size = "16B" under [chain] fills pitch, roller_radius and mass_per_length; stiffness =',
        f'"estimate" takes the last column: {100 * ELONGATION_AT_BREAKING_LOAD:g} % elongation at the breaking load, '
        "good to a factor of three. Masses are approximate.",
    ]
    return "\n".join(lines)
