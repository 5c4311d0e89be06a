"""Catalogue of chains by size: dimensions, mass, breaking load, estimated stiffness.

Of ISO 606:2015, ISO 10190:2008, ASME B29.1 and B29.2M; docs/catalogue.md has all sources and estimates.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

from warpchain.drive.plate import BACK_HEIGHT, PIN_RADIUS, PLATE_AREA

ELONGATION_AT_BREAKING_LOAD = 0.01
"""Elongation of an elastic link at the breaking load [-]."""

INNER_WIDTHS = 1.48
"""Width of a bush over that between inner plates [-]."""


STEEL = 7850.0
"""Density of steel [kg/m^3]."""
SERIES_A_STRENGTH = 12_500.0 * 4.4482216152605 / 0.0254**2
"""Series A strand's strength over squared pitch [N/m^2]."""


@dataclass(frozen=True)
class CatalogueChain:
    """Chain of a size of the catalogue.

    Attributes:
        size: such as "16B-2" with two strands.
        pitch: p [m].
        roller_diameter: d1 [m]; of a bush chain the bush's, of a silent one twice its back's height.
        inner_width: b1 [m]; of a silent chain its nominal width.
        pin_diameter: d2 [m].
        mass_per_length: approximate [kg/m].
        breaking_load: F_u [N].
        standard: "" for none.
        estimate: which values are estimates, and how formed; "" for none.
        kind: "roller", also of bush chains, or "silent".
    """

    size: str
    pitch: float
    roller_diameter: float
    inner_width: float
    pin_diameter: float
    mass_per_length: float
    breaking_load: float
    strands: int = 1
    standard: str = "ISO 606"
    estimate: str = ""
    kind: str = "roller"

    @property
    def roller_radius(self) -> float:
        """Outer radius of the chain's roller [m]."""
        return self.roller_diameter / 2.0

    @property
    def pin_radius(self) -> float:
        """Radius of the chain's pin [m]."""
        return self.pin_diameter / 2.0

    @property
    def bearing_share(self) -> float:
        """Width of a chain joint's bearing over `inner_width` [-]."""
        return 0.5 if self.kind == "silent" else INNER_WIDTHS

    @property
    def estimated_stiffness(self) -> float:
        """Estimated axial stiffness of a link, within a factor of 3 [N/m]."""
        return self.breaking_load / (ELONGATION_AT_BREAKING_LOAD * self.pitch)


_TABLE = """
size  pitch  roller  width    pin   kg/m  breaking load: simplex, duplex, triplex
05B      8       5      3   2.31   0.20    4.4    7.8   11.1
06B  9.525    6.35   5.72   3.28   0.41    8.9   16.9   24.9
08B   12.7    8.51   7.75   4.45   0.69   17.8   31.1   44.5
10B  15.875   10.16   9.65   5.08   0.93   22.2   44.5   66.7
12B  19.05   12.07  11.68   5.72   1.15   28.9   57.8   86.7
16B   25.4   15.88  17.02   8.28   2.71     60    106    160
20B  31.75   19.05  19.56  10.19   3.70     95    170    250
24B   38.1    25.4   25.4  14.63   7.10    160    280    425
28B  44.45   27.94  30.99  15.90   8.50    200    360    530
32B   50.8   29.21  30.99  17.81  10.25    250    450    670
40B   63.5   39.37   38.1  22.89  16.35    355    630    950
48B   76.2   48.26  45.72  29.24  25.00    560   1000   1500
56B   88.9   53.98  53.34  34.32  35.78    850   1600   2240
64B  101.6    63.5  60.96  39.40  46.00   1120   2000   3000
72B  114.3   72.39  68.58  44.48  60.80   1400   2500   3750
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
"""Dimensions of ISO 606 [mm] and loads [kN]."""
_BUSH_TABLE = """
size  pitch  roller  width    pin   kg/m  breaking load
06C   9.525    5.08   4.68   3.60  0.342    7.9
04C    6.35     3.3    3.1   2.31  0.152    3.5
"""
_LIGHT_TABLE = """
size  pitch  roller  width    pin   kg/m  breaking load
081    12.7    7.75    3.3   3.66   0.28    8.0
083    12.7    7.75   4.88   4.09   0.42   11.6
084    12.7    7.75   4.88   4.09   0.56   15.6
085    12.7    7.77   6.25   3.60  0.405    6.7
"""
_ESTIMATED = {
    "084": "mass: that of 083 times the ratio of the breaking loads",
    "085": "mass: half a maker's duplex chain's",
}
_HEAVY_TABLE = """
size   like   kg/m
60H     12A   1.87
80H     16A   3.10
100H    20A   4.52
120H    24A   6.60
140H    28A   8.30
160H    32A  10.30
180H    36A  14.83
200H    40A  19.16
240H    48A  30.40
"""
"""Heavy series: series A with thicker plates."""
_KART = CatalogueChain(
    size="219H",
    pitch=7.774e-3,
    roller_diameter=4.59e-3,
    inner_width=5e-3,
    pin_diameter=3.01e-3,
    mass_per_length=0.298,
    breaking_load=7.35e3,
    standard="",
    estimate="mass: 0.87 of that of 06C",
)
_MOTORCYCLE_TABLE = """
size  pitch  roller  width    pin   like  breaking load
415    12.7    7.77   4.68   3.97    08A   11.8
420    12.7    7.77   6.25   3.97    08A   15.6
428    12.7    8.51   7.85   4.51    08B   16.7
520  15.875   10.16   6.25   5.09    10A   26.4
525  15.875   10.16   7.85   5.09    10A   26.4
530  15.875   10.16    9.4   5.09    10A   26.4
630   19.05   11.91    9.4   5.96    12A   35.3
"""
_SILENT_WIDTHS = {
    3: (2, 3, 4, 6, 8),
    4: (2, 3, 4, 6, 8),
    5: (4, 6, 8, 10),
    6: (4, 6, 8, 12),
    8: (8, 12, 16),
    10: (12, 16, 20),
    12: (12, 16, 24),
    16: (16, 24, 32),
}
"""Usual widths of silent chains [1/4 in] by pitch [1/8 in]."""


def _catalogue_rows(table: str) -> Iterator[tuple[list[str], CatalogueChain]]:
    """Cells and chains of a catalogue table's lines."""
    for line in table.split("\n")[2:-1]:
        cells = line.split()
        size, pitch, roller, width, pin, mass, load = cells[:7]
        yield (
            cells,
            CatalogueChain(
                size=size,
                pitch=float(f"{pitch}e-3"),
                roller_diameter=float(f"{roller}e-3"),
                inner_width=float(f"{width}e-3"),
                pin_diameter=float(f"{pin}e-3"),
                mass_per_length=0.0 if mass.endswith(("A", "B")) else float(mass),
                breaking_load=float(f"{load}e3"),
            ),
        )


def _multi_strand_chains(chain: CatalogueChain, duplex: str = "", triplex: str = "") -> Iterator[CatalogueChain]:
    """Simplex, duplex and triplex chain of a size; loads in kN."""
    yield chain
    for strands, load in ((2, duplex), (3, triplex)):
        yield replace(
            chain,
            size=f"{chain.size}-{strands}",
            strands=strands,
            mass_per_length=strands * chain.mass_per_length,
            breaking_load=float(f"{load}e3") if load else strands * chain.breaking_load,
            estimate=f"mass: {strands} times the simplex chain's, good to a tenth",
        )


def _motorcycle_chain(chain: CatalogueChain, like: CatalogueChain) -> CatalogueChain:
    """Motorcycle chain, its mass from a chain of another width."""
    more = STEEL * math.pi * chain.roller_diameter**2 * (chain.inner_width - like.inner_width) / (4.0 * chain.pitch)
    estimate = f"mass: of {like.size} with its own width, good to a tenth"
    return replace(chain, mass_per_length=like.mass_per_length + more, standard="ISO 10190", estimate=estimate)


def _bush_chain(pitch: float, like: CatalogueChain) -> CatalogueChain:
    """Bush chain of a pitch in another's proportions."""
    scale = pitch / like.pitch
    return CatalogueChain(
        size=f"bush-{1e3 * pitch:g}",
        pitch=pitch,
        roller_diameter=scale * like.roller_diameter,
        inner_width=scale * like.inner_width,
        pin_diameter=scale * like.pin_diameter,
        mass_per_length=scale**2 * like.mass_per_length,
        breaking_load=scale**2 * like.breaking_load,
        standard="",
        estimate=f"all but the pitch: {like.size} scaled, as no standard has it; engines' own are often stronger",
    )


def _silent_chain(size: str, pitch: float, width: float, standard: str = "") -> CatalogueChain:
    """Silent chain of a pitch and nominal width."""
    kept = "pitch and width" if standard else "the pitch; its width is two pitches"
    return CatalogueChain(
        size=size,
        pitch=pitch,
        roller_diameter=2.0 * BACK_HEIGHT * pitch,
        inner_width=width,
        pin_diameter=2.0 * PIN_RADIUS * pitch,
        mass_per_length=float(f"{0.5 * PLATE_AREA * STEEL * pitch * width:.3g}"),
        breaking_load=float(f"{SERIES_A_STRENGTH * pitch * width:.3g}"),
        standard=standard,
        estimate=f"all but {kept}: plates in half the width, as strong as series A for pitch times width",
        kind="silent",
    )


def _catalogue_chains() -> Iterator[CatalogueChain]:
    """Chains of the catalogue."""
    plain = {}
    for cells, chain in _catalogue_rows(_TABLE):
        plain[chain.size] = chain
        yield from _multi_strand_chains(chain, *cells[7:])
    bushes = [
        replace(chain, estimate="mass: half a maker's duplex 06C, with p^2")
        for _, chain in _catalogue_rows(_BUSH_TABLE)
    ]
    for chain in bushes:
        yield from _multi_strand_chains(chain)
    for _, chain in _catalogue_rows(_LIGHT_TABLE):
        yield replace(chain, estimate=_ESTIMATED.get(chain.size, ""))
    for size, like, mass in (line.split() for line in _HEAVY_TABLE.split("\n")[2:-1]):
        yield from _multi_strand_chains(replace(plain[like], size=size, mass_per_length=float(mass)))
    for cells, chain in _catalogue_rows(_MOTORCYCLE_TABLE):
        yield _motorcycle_chain(chain, plain[cells[5]])
    for pitch in (0.007, 0.008):
        yield _bush_chain(pitch, bushes[0])
    yield _KART
    for eighths, widths in _SILENT_WIDTHS.items():
        for quarters in widths:
            pitch, width = (float(f"{size:g}e-3") for size in (3.175 * eighths, 6.35 * quarters))
            yield _silent_chain(f"SC{eighths}{quarters:02d}", pitch, width, "ASME B29.2M")
    for pitch in (0.00635, 0.008):
        yield _silent_chain(f"silent-{1e3 * pitch:g}", pitch, 2.0 * pitch)


CHAINS: dict[str, CatalogueChain] = {chain.size: chain for chain in _catalogue_chains()}


def _roller_text(chain: CatalogueChain) -> str:
    """Text of a chain's roller diameter in mm, or a dash."""
    return "-" if chain.kind == "silent" else f"{1e3 * chain.roller_diameter:.2f}"


def catalogue_text() -> str:
    """The catalogue of chains as a table for a terminal."""
    lines = ["size           pitch   roller  inner width    pin        mass   breaking load  stiffness estimate"]
    lines += [
        f"{chain.size:13} {1e3 * chain.pitch:7.3f} {_roller_text(chain):>7} {1e3 * chain.inner_width:9.2f} "
        f"{1e3 * chain.pin_diameter:9.2f} mm "
        f"{'~' * bool(chain.estimate) + format(chain.mass_per_length, '.2f'):>8} kg/m "
        f"{1e-3 * chain.breaking_load:8.1f} kN {chain.estimated_stiffness:11.3g} N/m"
        for chain in CHAINS.values()
    ]
    lines += [
        "",
        'In a drive file: size = "16B" under [chain] fills pitch, roller_radius and mass_per_length; stiffness =',
        f'"estimate" takes the last column: {100 * ELONGATION_AT_BREAKING_LOAD:g} % elongation at the breaking load, '
        "good to a factor of three. Masses are approximate;",
        "~ marks estimates: of bush-7 and bush-8 all but the pitch, of the others the mass. "
        "04C and 06C are the bush chains of 6.35 and 9.525 mm.",
        "SC302 to silent-8 are silent chains, without rollers and of that width: all but pitch and width are "
        "estimates, of silent-6.35 and silent-8 the width, too.",
    ]
    return "\n".join(lines)
