"""Drives at a temperature: what grows, what of the drive follows, oil, and that files keep their numbers."""

from typing import get_args

import numpy as np
import pytest
from drives import STARTING, example, two_sprockets

from warpchain import Record, dumps_drive, loads_drive, read_archive, simulate, write_archive
from warpchain.assembly.assembly import assemble
from warpchain.drive import Drive
from warpchain.drive.changed_copies import DriveChanges
from warpchain.drive.examples import example_names
from warpchain.drive.quantities import unit_of_key
from warpchain.drive.schema import Part
from warpchain.drive.thermal import GROWS, MATERIALS
from warpchain.drive.viscosity import THICKEST, THINNEST, walther_from_two_points
from warpchain.engine.pack import pack
from warpchain.errors import DriveError
from warpchain.fit import fit_position
from warpchain.model import Model, single_chain
from warpchain.model.stacks import stacks_of_drives
from warpchain.results.schedule import Schedule

STAY = {
    "arms.spring.free_length",  # steel that is wound
    "valves.profile.lift", "valves.table.lift", "tensioners.relief.diameter", "tensioners.relief.lift",
    "tensioners.vent.diameter", "sprockets.mount.table.x", "sprockets.mount.table.y", "sprockets.mount.offset",
    "sprockets.mount.amplitude", "arms.pivot_table.x", "arms.pivot_table.y",
    "tensioners.plunger.diameter", "tensioners.plunger.gap", "tensioners.plunger.length",
    "tensioners.valve.ball_radius", "tensioners.valve.seat_diameter", "tensioners.valve.lift",
    "tensioners.ratchet.pitch", "tensioners.ratchet.backlash", "chain.load.begin", "chain.load.end",
}  # fmt: skip
"""Lengths that are as files say: motions, lifts of valves, a tensioner's own parts, and where goods are fed."""
OIL = "tensioners.tensioner.oil"
POINTS = {f"{OIL}.viscosity_40": 62e-6, f"{OIL}.viscosity_100": 10.3e-6}
STEEL = {"expansion.block": "steel"}
PLAN = Schedule(1e-6, 1, 0, 1, 0)


def lengths(kind=Drive, above=()):
    """Keys of drive files whose unit is the meter."""

    def parts(source):
        if isinstance(source, type) and issubclass(source, Part):
            yield source
        for inner in get_args(source):
            yield from parts(inner)

    for key, field in kind.model_fields.items():
        inside = list(parts(field.annotation))
        if unit_of_key(kind, key) == "m":
            yield ".".join((*above, key))
        for inner in inside:
            yield from lengths(inner, (*above, "chain" if key == "chains" else key))


def car(**values):
    return example("car").with_values(POINTS | values)


def packed(drive):
    found = pack([drive], [PLAN])
    return {name: value for name, value in vars(found).items() if isinstance(value, np.ndarray)}


# --------------------------------------------------------------------------------------------------------- growth


def test_every_length_of_drive_files_grows_or_is_known_to_stay():
    every = set(lengths())
    assert every - GROWS.keys() - STAY == set()
    assert every >= STAY and not STAY & GROWS.keys()
    assert GROWS.keys() - every == {"chain.mass_per_length"}  # which keeps the mass of a link


def test_what_belongs_to_block_wheels_and_chain_grows_with_it():
    cold, hot = car(), car(temperature=100.0, **{"expansion.wheels": 1.1e-5, "expansion.chain": 1.1e-5})
    block, steel = 1.0 + 23e-6 * 80.0, 1.0 + 1.1e-5 * 80.0
    for of, grown in ((block, lambda d: d.sprockets[1].center), (block, lambda d: d.arms[0].pivot),
                      (block, lambda d: d.guides[0].arcs[0].radius), (block, lambda d: d.tensioners[0].at),
                      (steel, lambda d: d.chain.pitch), (steel, lambda d: single_chain(d).pitch_radius(1)),
                      (steel, lambda d: d.chain.pin_radius), (steel, lambda d: d.guides[0].offset),
                      (steel, lambda d: single_chain(d).tooth(0).seat_radius),
                      (steel, lambda d: single_chain(d).tip_radius(2)),
                      (1.0, lambda d: d.chain.mass), (1.0, lambda d: d.tensioners[0].area)):  # fmt: skip
        np.testing.assert_allclose(grown(hot), np.multiply(of, grown(cold)), rtol=1e-14)  # a few roundings
    assert (
        hot.as_read
        == cold.with_values({"temperature": 100.0, "expansion.wheels": 1.1e-5, "expansion.chain": 1.1e-5}).as_read
    )
    assert hot.get_value("chain.pitch") == cold.chain.pitch == hot.as_read.chain.pitch


def test_wheels_of_another_material_keep_the_pitch_and_the_seats_that_they_were_cut_with():
    hot, factor = car(temperature=100.0, **{"expansion.wheels": "aluminum"}), 1.0 + 80.0 * 23e-6
    assert single_chain(hot).pitch_radius(1) == pytest.approx(factor * single_chain(car()).pitch_radius(1), rel=1e-14)
    assert single_chain(hot).tooth(1).seat_radius == pytest.approx(
        factor * single_chain(car()).tooth(1).seat_radius, rel=1e-14
    )


def test_wheels_of_another_material_with_teeth_of_iso_606():
    teeth = {"profile": "iso606", "gap": "minimum", "restitution": 0.3, "impact_speed_floor": 0.02, "stiffness": 1e8}
    drive = two_sprockets().with_values({"contact.sprocket": teeth})
    hot = drive.with_values({"temperature": 120.0, "expansion.wheels": "aluminum"})
    assert single_chain(hot).pitch_radius(0) == pytest.approx(
        (1.0 + 23e-4) * single_chain(drive).pitch_radius(0), rel=1e-14
    )


def test_one_material_throughout_leaves_strain_and_angles():
    """All is larger by one factor: a figure that is similar to the cold one."""
    hot = assemble(example("marine").with_values({"temperature": 140.0} | STEEL))
    cold = assemble(example("marine"))
    assert hot.strain == pytest.approx(cold.strain, abs=1e-12)
    np.testing.assert_allclose(hot.sprocket_angle, cold.sprocket_angle, atol=1e-10)


def test_a_block_of_aluminum_stretches_the_chain():
    """Two like sprockets whose strands are whole links: the centers are (N - z)/2 p (1 + strain) apart, exactly."""
    hot = two_sprockets().with_values({"temperature": 120.0})
    assert assemble(hot).path.nominal_strain == pytest.approx((1.0 + 23e-4) / (1.0 + 12e-4) - 1.0, rel=1e-9)


# ------------------------------------------------------------------------------------------------------ unchanged


@pytest.mark.parametrize("name", ["car", "marine", "v6"])
def test_at_20_degrees_all_bits_are_as_without(name):
    drive = example(name)
    same = drive.with_values({"temperature": 20.0, "expansion.block": "cast iron"})
    assert same.as_read is same and same.expansion.block == MATERIALS["cast iron"]
    for chain, other in zip(Model(drive).chains, Model(same).chains, strict=True):
        before, after = packed(chain), packed(other)
        assert before.keys() == after.keys()
        for key, value in before.items():
            assert value.tobytes() == after[key].tobytes(), key


def test_every_example_can_be_warmed():
    for name in example_names():
        drive = example(name)
        oils = [f"tensioners.{t.name}.oil" for t in drive.tensioners if t.oil is not None]
        oil = {f"{at}.{key}": value for at in oils for key, value in (("viscosity_40", 6e-5), ("viscosity_100", 1e-5))}
        hot = drive.with_values({"temperature": 60.0, "expansion.block": "cast iron"} | oil)
        assert loads_drive(dumps_drive(hot)) == hot != drive


# -------------------------------------------------------------------------------------------------- files, copies


def test_files_keep_their_numbers_and_the_temperature():
    hot = car(temperature=95.0)
    text = dumps_drive(hot)
    assert text.startswith("temperature = 95.0\n") and "pitch = 0.009525\n" in text
    back = loads_drive(text)
    assert back == hot and back.chain.pitch == 0.009525 * (1.0 + 12e-6 * 75.0)
    assert dumps_drive(back.with_values({"temperature": None})) == dumps_drive(car())


def test_changed_copies_begin_at_the_files_numbers():
    hot = car(temperature=95.0)
    assert hot.with_values({"temperature": 20.0}).chain.pitch == 0.009525
    moved = hot.with_values({"sprockets.crank.center": [1e-3, 0.0]})
    assert moved.sprockets[0].center == (1e-3 * (1.0 + 23e-6 * 75.0), 0.0)
    assert moved.sprockets[1].center == hot.sprockets[1].center


def test_many_changed_copies_are_those_of_one():
    changes = DriveChanges(car())
    for temperature in (-30.0, 0.0, 20.0, 95.0):
        for preload in (40.0, 60.0):
            values = {"temperature": temperature, "tensioners.tensioner.spring.preload": preload}
            assert changes.changed_drive(values) == car().with_values(values)
    with pytest.raises(DriveError, match="ASTM D341"):
        changes.changed_drive({"temperature": -90.0, "tensioners.tensioner.spring.preload": 40.0})


def test_a_copy_with_other_parts_is_as_it_stands():
    hot = car(temperature=95.0)
    later = hot.model_copy(update={"run": hot.run.model_copy(update={"duration": 1.0})})
    assert later == hot.with_values({"run.duration": 1.0})
    other = hot.model_copy(update={"guides": ()})
    assert other.temperature is None and other.as_read is other and other.chain == hot.chain


def test_variants_at_several_temperatures_are_packed_as_each_alone():
    base = example("marine")
    drives = [base.with_values({"temperature": t}) for t in (20.0, -20.0, 0.0, 60.0)]
    assert len(stacks_of_drives(drives)) == 1  # straight bars on the ground
    together = pack(drives, [PLAN] * 4)
    for v, drive in enumerate(drives):
        part, alone = together.variant_range(v, v + 1), pack([drive], [PLAN])
        for key in ("rollers", "chains", "sprockets", "guides", "bodies"):
            assert getattr(part, key).tobytes() == getattr(alone, key).tobytes(), key


def test_fit_moves_the_sprocket_of_the_file():
    """The center at 120 degrees gives the strain; the file has it at 20."""
    hot = two_sprockets().with_values({"temperature": 120.0})
    fitted = fit_position(hot, "driven", (1.0, 0.0), strain=0.0)
    assert fitted.sprockets[1].center[0] == pytest.approx(1.0 + 12e-4, abs=2e-10)  # 20 links, grown; rounded to 1e-10
    assert fitted.as_read.sprockets[1].center[0] == pytest.approx((1.0 + 12e-4) / (1.0 + 23e-4), abs=1e-10)
    assert fitted.temperature == 120.0 and abs(assemble(fitted).strain) < 1e-8


def test_runs_and_their_archives_hold_the_temperature(tmp_path):
    hot = two_sprockets(torque=50.0, duration=0.02).with_values({"temperature": 120.0})
    grown = hot.model_copy(update={"guides": hot.guides, "sprockets": hot.sprockets})  # the same sizes, said as such
    run, said = (simulate(drive, record=Record(), device="cpu", limits=STARTING) for drive in (hot, grown))
    for key, value in run[0].channels().items():
        assert value.tobytes() == said[0].channels()[key].tobytes(), key
    write_archive(run, tmp_path / "hot.mcap")
    back = read_archive(tmp_path / "hot.mcap").drives[0]
    assert back == hot and back.as_read.chain.pitch == 0.05 and back.temperature == 120.0


# ------------------------------------------------------------------------------------------------------------ oil


def test_two_viscosities_give_the_rest():
    law = walther_from_two_points(62e-6, 10.3e-6)
    assert law.viscosity(40.0) == pytest.approx(62e-6, rel=1e-12)
    assert law.viscosity(100.0) == pytest.approx(10.3e-6, rel=1e-12)
    assert law.temperature(law.viscosity(-30.0)) == pytest.approx(-30.0, abs=1e-9)
    # a published calculator (B = 3.7449, with 273 K in place of 273.15) has 8.5 mm^2/s at 80 degrees
    vg32 = walther_from_two_points(32e-6, 5.4e-6)
    assert vg32.b == pytest.approx(3.7449, rel=1e-3) and vg32.viscosity(80.0) == pytest.approx(8.5e-6, abs=5e-8)


def test_oil_thins_with_the_drive():
    law = walther_from_two_points(62e-6, 10.3e-6)
    for temperature in (-30.0, 0.0, 95.0):
        oil = car(temperature=temperature).tensioners[0].oil
        assert oil.viscosity == law.viscosity(temperature) and oil.viscosity_40 is None
        assert car(temperature=temperature).as_read.tensioners[0].oil.viscosity_40 == 62e-6
    assert car().tensioners[0].oil.viscosity == law.viscosity(20.0)  # the reference
    thin = car(temperature=95.0, **{f"{OIL}.viscosity_100": "9 mm^2/s"})
    assert thin.tensioners[0].oil.viscosity < car(temperature=95.0).tensioners[0].oil.viscosity
    plain = car().with_values({f"{OIL}.viscosity": 2e-5})
    assert plain.tensioners[0].oil.viscosity_40 is None and plain.tensioners[0].oil.viscosity == 2e-5


BELOW = "must be from -74 to 222 degrees C, where it has the 2e-06 to 20 for which ASTM D341 holds"


@pytest.mark.parametrize(
    ("values", "line"),
    [
        ({"temperature": -80.0}, f"temperature = -80.0: the oil of tensioners.tensioner would have 123 m^2/s; {BELOW}"),
        (
            {"temperature": 250.0},
            f"temperature = 250.0: the oil of tensioners.tensioner would have 1.61e-06 m^2/s; {BELOW}",
        ),
        ({"temperature": -273.0}, "temperature = -273.0: must be a number of degrees C from -100 to 300"),
        ({"temperature": "hot"}, 'temperature = "hot": must be a number of degrees C from -100 to 300'),
        (
            {"expansion.block": "wood"},
            'expansion.block = "wood": must be a number per kelvin from 0 to 1e-3, or "steel", "aluminum", "cast iron"',
        ),
        ({"expansion.wheels": 12.0}, "expansion.wheels = 12.0: must be a number per kelvin from 0 to 1e-3"),
        (
            {f"{OIL}.viscosity_40": 1e-5},
            f"{OIL}.viscosity_100 = 1.03e-05: must be below viscosity_40, 1e-05: oil thins as it warms",
        ),
        (
            {f"{OIL}.viscosity_40": 1e-7},
            f"{OIL}.viscosity_40 = 1e-07: must be a number from {THINNEST:g} to {THICKEST:g}, for which ASTM D341",
        ),
        (
            {"temperature": -50.0, "expansion.wheels": "aluminum", "contact.sprocket.clearance": 0.0},
            "contact.sprocket.clearance = -2.44475",
        ),
    ],
)
def test_what_is_refused_is_said_in_one_line(values, line):
    with pytest.raises(DriveError) as caught:
        car(**values)
    (said,) = caught.value.errors
    assert said.startswith(line)


def test_a_temperature_needs_the_oils_two_viscosities():
    with pytest.raises(DriveError) as caught:
        example("car").with_values({"temperature": 95.0})
    assert caught.value.errors == (
        f"{OIL}.viscosity_40: missing; needed with viscosity_100 where temperature is not 20 degrees C",
    )
    with pytest.raises(DriveError, match="viscosity_100: missing"):
        example("car").with_values({f"{OIL}.viscosity_40": 62e-6})
