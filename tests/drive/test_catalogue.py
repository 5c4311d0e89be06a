"""The catalogue of chains, and drives that name a size."""

import copy
import math
import re
from itertools import pairwise

import pytest
from drives import errors_of

from warpchain import cli
from warpchain.assembly.summary import derived_quantities, report
from warpchain.drive import Chain, Drive, dumps_drive, loads_drive
from warpchain.drive.catalogue import CHAINS
from warpchain.drive.plate import PLATE_AREA, Plate
from warpchain.results.plate_outlines import plate_outline

SIZED = {"size": "16B", "links": 100, "stiffness": "estimate", "damping_ratio": 0.02}


SIMPLEX = {size: chain for size, chain in CHAINS.items() if re.fullmatch(r"\d\d[AB]", size)}


def sized(values, size="72B", stiffness="estimate"):
    """The marine drive's values with a size instead of dimensions."""
    for key in ("pitch", "roller_radius", "roller_mass"):
        del values["chain"][key]
    values["chain"] |= {"size": size, "stiffness": stiffness}
    return values


def test_sizes_are_sixteenths_of_an_inch():
    """The number of a size is its pitch in sixteenths of an inch; 05B, 8 mm, is the metric exception."""
    assert CHAINS["05B"].pitch == 0.008
    assert all(size == chain.size for size, chain in CHAINS.items())
    sized = {size: chain for size, chain in CHAINS.items() if re.match(r"\d\d[ABC]", size)}
    for size, chain in sized.items():
        if not size.startswith("05B"):
            assert chain.pitch == pytest.approx(int(size[:2]) * 25.4e-3 / 16, rel=1e-12)


def test_series_a_has_the_strength_of_asme_b29_1():
    """12,500 lbf for each square inch of pitch; ISO 606 rounds to three figures."""
    for size, chain in CHAINS.items():
        if "A" in size:
            load = chain.strands * 12500 * 4.4482216 * (chain.pitch / 25.4e-3) ** 2
            assert chain.breaking_load == pytest.approx(load, rel=4e-3), size


def test_pins_of_series_a_are_those_of_asme_b29_1():
    """Inches of ANSI 40, 50, 60, 80, ..., 240; ISO 606 gives the largest, by at most 0.03 mm more."""
    inches = (0.156, 0.200, 0.234, 0.312, 0.375, 0.437, 0.500, 0.562, 0.687, 0.781, 0.937)
    pins = [chain.pin_diameter for size, chain in SIMPLEX.items() if size.endswith("A")]
    assert pins == pytest.approx([25.4e-3 * inch for inch in inches], abs=0.03e-3)


def test_a_size_gives_the_pin_radius(values):
    drive = Drive(**sized(values)).with_values({"chain.joint": {"friction": 0.1}})
    assert drive.chain.pin_radius == pytest.approx(22.24e-3, abs=1e-12)
    assert drive.with_values({"chain.size": "64B", "chain.stiffness": "estimate"}).chain.pin_radius == 19.7e-3
    assert drive.with_values({"chain.joint.pin_radius": 0.02}).chain.pin_radius == 0.02
    assert "joints: friction 0.1, pins of 22.24 mm radius" in report(derived_quantities(drive))


def test_pins_of_series_b_are_those_of_a_maker():
    """Of Galaxy Chain, 08B to 40B, as ISO 606's largest; rounded to 0.01 mm."""
    pins = (4.45, 5.08, 5.72, 8.28, 10.19, 14.63, 15.90, 17.81, 22.88)
    sizes = ("08B", "10B", "12B", "16B", "20B", "24B", "28B", "32B", "40B")
    assert [1e3 * CHAINS[size].pin_diameter for size in sizes] == pytest.approx(pins, abs=0.011)


@pytest.mark.parametrize("series", ["A", "B"])
def test_sizes_grow_alike(series):
    """Everything grows with the pitch; rollers fit between pitch and half of it; masses follow width and height."""
    chains = [chain for chain in SIMPLEX.values() if chain.size.endswith(series)]
    for small, large in pairwise(chains):
        for name in ("pitch", "roller_diameter", "pin_diameter", "mass_per_length", "breaking_load"):
            assert getattr(small, name) < getattr(large, name)
    for chain in chains:
        assert 0.5 < chain.roller_diameter / chain.pitch < 0.7
        assert 0.35 < chain.inner_width / chain.pitch < 0.73
        assert 0.28 < chain.pin_diameter / chain.pitch < 0.4
        # a chain of one shape weighs and carries with the square of its size
        assert 2800 < chain.mass_per_length / chain.pitch**2 < 5200
        assert 6e7 < chain.breaking_load / chain.pitch**2 < 1.2e8


def test_size_fills_and_explicit_keys_override():
    chain = Chain(**SIZED)
    assert (chain.pitch, chain.roller_radius, chain.mass_per_length) == (0.0254, 0.00794, 2.71)
    assert chain.breaking_load == 60e3
    # 1 % of 25.4 mm at 60 kN
    assert chain.stiffness == pytest.approx(60e3 / 0.254e-3)
    assert chain.stiffness_is_estimate
    own = Chain(**SIZED | {"roller_mass": 0.07, "pitch": 0.0255, "roller_radius": 0.0079, "stiffness": 1e8})
    assert (own.pitch, own.roller_radius, own.mass, own.stiffness) == (0.0255, 0.0079, 0.07, 1e8)
    assert own.mass_per_length is None and not own.stiffness_is_estimate


def test_sized_drive_round_trips_and_changes(values):
    drive = Drive(**sized(values))
    assert loads_drive(dumps_drive(drive)) == drive
    other = drive.with_values({"chain.size": "64B", "chain.stiffness": "estimate"})
    assert other.chain.pitch == 0.1016 and other.chain.mass_per_length == 46.0
    assert other.chain.stiffness == CHAINS["64B"].estimated_stiffness
    assert drive.with_values({"chain.size": "64B"}) == other


def test_size_errors_name_size_and_sizes(values):
    values = sized(values, stiffness=1e9)

    def refused(size):
        return errors_of(values | {"chain": values["chain"] | {"size": size}})[0]

    line = refused("16b")
    assert line == 'chain.size = "16b": must be a size that `warpchain chains` lists; did you mean 16B?'
    assert refused("large").endswith(f"allowed are 05B, 05B-2, 05B-3, 06B and {len(CHAINS) - 4} more")
    assert refused(16) == "chain.size = 16: must be a size that `warpchain chains` lists, such as 16B"


MAKERS = {  # kg/m of duplex and triplex chains: two makers' catalogs
    "08B": (1.300, 1.920), "10B": (1.856, 2.785), "12B": (2.487, 3.731), "16B": (5.213, 7.819), "20B": (7.605, 11.407),
    "24B": (14.278, 21.417), "28B": (17.909, 26.864), "32B": (19.391, 29.086), "40B": (31.734, 47.703),
    "48B": (50.0, 75.0), "56B": (71.48, 107.18), "64B": (91.0, 136.0), "72B": (120.4, 180.0), "12A": (3.011, 4.516),
    "16A": (5.143, 7.715), "20A": (7.814, 11.804), "24A": (11.976, 17.994), "28A": (15.246, 22.869),
    "32A": (20.360, 30.600), "36A": (29.22, 38.22), "40A": (32.24, 49.03), "48A": (45.23, 71.60),
}  # fmt: skip
POUNDS_PER_FOOT = {  # of duplex chains, a third maker's
    "06C": 0.46, "08A": 0.85, "10A": 1.37, "12A": 2.04, "16A": 3.41, "20A": 5.28, "24A": 7.88, "28A": 10.03,
    "32A": 13.48, "36A": 17.65, "40A": 21.95, "48A": 32.44,
}  # fmt: skip


def test_strands_weigh_what_makers_say():
    """n times a simplex chain: within the tenth that the catalogue states."""
    for size, (duplex, triplex) in MAKERS.items():
        assert CHAINS[f"{size}-2"].mass_per_length == pytest.approx(duplex, rel=0.1), size
        assert CHAINS[f"{size}-3"].mass_per_length == pytest.approx(triplex, rel=0.1), size
    for size, weight in POUNDS_PER_FOOT.items():
        assert CHAINS[f"{size}-2"].mass_per_length == pytest.approx(weight * 0.45359237 / 0.3048, rel=0.1), size


def test_strands_share_dimensions_and_add_strength():
    """Those of series B carry less than as many simplex chains, as the standard has it; A and C as much."""
    for size, chain in [*SIMPLEX.items(), *((size, CHAINS[size]) for size in ("04C", "06C"))]:
        for strands in (2, 3):
            many = CHAINS[f"{size}-{strands}"]
            for name in ("pitch", "roller_diameter", "inner_width", "pin_diameter"):
                assert getattr(many, name) == getattr(chain, name)
            assert many.strands == strands and "good to a tenth" in many.estimate
            share = many.breaking_load / (strands * chain.breaking_load)
            assert share == pytest.approx(1.0, rel=1e-9) if size[2] != "B" else 0.8 < share < 1.01


def test_motorcycles_are_those_of_their_pitch_but_for_the_width():
    """Eq. (b) by hand for 520: 10A has 1.02 kg/m and 9.4 mm; 3.15 mm of a cylinder of 10.16 mm less a pitch."""
    less = 7850 * math.pi / 4 * 10.16e-3**2 * 3.15e-3 / 15.875e-3
    assert CHAINS["520"].mass_per_length == pytest.approx(1.02 - less, rel=1e-9)
    widths = [CHAINS[size].inner_width for size in ("520", "525", "530")]
    masses = [CHAINS[size].mass_per_length for size in ("520", "525", "530")]
    assert widths == sorted(widths) and masses == sorted(masses)
    for size in ("415", "420", "428", "520", "525", "530", "630"):
        # the first digit is the pitch in eighths of an inch, the others the width in eightieths, 428 aside
        chain = CHAINS[size]
        assert chain.pitch == pytest.approx(int(size[0]) * 25.4e-3 / 8, rel=1e-9) and chain.standard == "ISO 10190"
        if size != "428":
            assert chain.inner_width == pytest.approx(int(size[1:]) * 25.4e-3 / 80, rel=0.025)


PLATES = {"60": 1, "80": 1, "100": 1, "120": 1, "140": 1, "160": 1, "180": 1, "200": 2, "240": 4}
"""By how many 32nds of an inch the plates of the heavy series are thicker (ASME B29.1)."""


def test_the_heavy_series_is_series_a_with_thicker_plates():
    """A plate is an oblong of the pitch with round ends, in the mean 0.885 p high (0.95 and 0.82 p, ASME B29.1).

    With pins and bushes in its holes its area is 0.885 p^2 + pi (0.885 p)^2 / 4, two of them a pitch. Makers' plates
    are waisted, or straight at the edges, and their thicknesses round: within a tenth.
    """
    for size, more in PLATES.items():
        heavy, like = CHAINS[f"{size}H"], CHAINS[f"{int(size) // 5:02d}A"]
        for name in ("pitch", "roller_diameter", "inner_width", "pin_diameter", "breaking_load", "estimate"):
            assert getattr(heavy, name) == getattr(like, name)
        area = (0.885 + math.pi / 4 * 0.885**2) * like.pitch**2
        mass = like.mass_per_length + 7850 * 2 * area * more * 25.4e-3 / 32 / like.pitch
        assert heavy.mass_per_length == pytest.approx(mass, rel=0.1), size
        assert CHAINS[f"{size}H-3"].mass_per_length == 3 * heavy.mass_per_length


def test_narrow_chains_of_half_an_inch_weigh_with_width_and_plates():
    """Within a tenth of a second maker's (Donghua: 415B/083, 415H); 084 is 083 with thicker plates, (d)."""
    for size, second in (("083", 0.45), ("415", 0.55)):
        assert CHAINS[size].mass_per_length == pytest.approx(second, rel=0.1)
    thick, thin = CHAINS["084"], CHAINS["083"]
    mass = thin.mass_per_length * thick.breaking_load / thin.breaking_load
    assert thick.mass_per_length == pytest.approx(mass, rel=0.01) and "083" in thick.estimate
    assert CHAINS["081"].mass_per_length < thin.mass_per_length and not CHAINS["081"].estimate + thin.estimate


def test_bush_chains_have_one_shape():
    """04C and 06C of the standard are alike within 6 %, which is what scaling one to 7 and 8 mm rests on."""
    like = CHAINS["06C"]
    for size in ("04C", "bush-7", "bush-8"):
        chain, scale = CHAINS[size], CHAINS[size].pitch / like.pitch
        for name, power in (("roller_diameter", 1), ("inner_width", 1), ("pin_diameter", 1), ("breaking_load", 2)):
            assert getattr(chain, name) == pytest.approx(scale**power * getattr(like, name), rel=0.06), (size, name)
    assert CHAINS["bush-7"].standard == "" and CHAINS["bush-7"].estimate.startswith("all but the pitch")


def test_check_says_what_of_a_size_is_an_estimate(values):
    drive = Drive(**sized(values, size="72B-2"))
    text = report(derived_quantities(drive))
    assert "an ESTIMATE of the catalogue, mass: 2 times the simplex chain's, good to a tenth" in text
    assert "of the catalogue" not in report(
        derived_quantities(drive.with_values({"chain.size": "72B", "chain.stiffness": 1e9}))
    )


def test_strands_share_the_bearing_load(values):
    one, three = (Drive(**sized(copy.deepcopy(values), size=size)) for size in ("72B", "72B-3"))
    assert three.chain.joint_area == pytest.approx(3.0 * one.chain.joint_area, rel=1e-12)


def test_check_says_that_the_stiffness_is_an_estimate(values):
    drive = Drive(**sized(values))
    text = report(derived_quantities(drive))
    assert "size: 72B (ISO 606), breaking load 1400 kN" in text and "N/m, an ESTIMATE" in text
    measured = report(derived_quantities(drive.with_values({"chain.stiffness": 1.5e9})))
    assert "size: 72B" in measured and "N/m, an ESTIMATE" not in measured


def test_silent_chains_have_the_numbers_of_the_standard():
    """SC, pitch in eighths and width in quarters of an inch: SC302 3/8 by 1/2, SC1012 1 1/4 by 3 (ASME B29.2M)."""
    found = {size: (chain.pitch, chain.inner_width) for size, chain in CHAINS.items() if size.startswith("SC")}
    for size, pitch, width in (("SC302", 3 / 8, 1 / 2), ("SC1012", 5 / 4, 3), ("SC404", 1 / 2, 1), ("SC1624", 2, 6)):
        assert found[size] == pytest.approx((0.0254 * pitch, 0.0254 * width), rel=1e-15)
    assert {round(1e3 * pitch, 3) for pitch, _ in found.values()} == {
        9.525, 12.7, 15.875, 19.05, 25.4, 31.75, 38.1, 50.8,
    }  # fmt: skip


def test_masses_and_strengths_of_silent_chains_are_the_estimates():
    """Eq. (e) by hand for SC404: half a square inch; 6250 lbf = 27.8 kN; 0.95 of 7850 kg/m^3 over half the width."""
    chain = CHAINS["SC404"]
    assert chain.breaking_load == pytest.approx(6250 * 4.4482216, rel=2e-3)
    assert chain.mass_per_length == pytest.approx(0.95 * 7850 * 0.0127 * 0.0127, abs=5e-3)  # three figures
    assert chain.estimate.startswith("all but pitch and width")
    assert CHAINS["silent-8"].inner_width == 0.016 and CHAINS["silent-8"].standard == ""
    plate = Plate(1.0, math.radians(30.0), 0.375, 0.4, (0.2, 0.5), 0.05)
    x, y = plate_outline(plate, 200).T
    area = 0.5 * abs(x[:-1] @ y[1:] - x[1:] @ y[:-1])
    assert area == pytest.approx(PLATE_AREA, rel=0.01)


def test_chains_command_lists_every_size(capsys):
    assert cli.main(["chains"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[1 : 1 + len(CHAINS)]] == list(CHAINS)
    row = next(line for line in lines if line.startswith("16B")).split()
    assert [float(row[i]) for i in (1, 2, 3, 4, 6, 8)] == [25.4, 15.88, 17.02, 8.28, 2.71, 60.0]
    assert math.isclose(float(row[10]), CHAINS["16B"].estimated_stiffness, rel_tol=1e-2)
