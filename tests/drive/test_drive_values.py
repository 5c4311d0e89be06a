"""Changed copies of drives, and values by key path."""

import numpy as np
import pytest
from drives import BLADE, MARINE, POSITIVE, STEEL

from warpchain.drive import Chain, Load, Material, dumps_drive, load_drive, loads_drive
from warpchain.errors import DriveError

SMALL = {"pitch": 1, "links": 4, "roller_mass": 1, "stiffness": 1, "damping": 0, "roller_radius": 0.1}
SMALL["joint"] = {"friction": 0.1, "pin_radius": 0.05}
MATERIALS = {
    "roller.youngs_modulus": 2e11,
    "roller.poissons_ratio": 0.3,
    "partner": STEEL,
    "width": 0.1,
    "reference_load": 1e3,
}


def test_with_values_changes_a_copy_and_shares_the_rest(marine):
    other = marine.with_values({"sprockets.camshaft.load.torque": 8e3, "run.gravity.1": 0, "guides.0.end_radius": 1})
    assert other.sprockets[2].load.torque == 8e3 and other.run.gravity == (0.0, 0.0) and other.guides[0].end_radius == 1
    assert marine == load_drive(MARINE)
    assert other.chain is marine.chain and other.sprockets[0] is marine.sprockets[0]
    assert other.sprockets[2].load.harmonics == marine.sprockets[2].load.harmonics
    assert marine.with_values({}) == marine


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("chain", Chain(**SMALL)),
        ("sprockets.2.teeth", 60),
        ("sprockets.camshaft.name", "cam"),
        ("sprockets.camshaft.center.0", 0.31),
        ("sprockets.camshaft.load.harmonics", ()),
        ("sprockets.camshaft.load.harmonics.0.phase", 1.5),
        ("sprockets.camshaft.load", None),
        ("guides.tight strand.contact.restitution", 0.25),
        ("guides", ()),
        ("run.step", "auto"),
        ("run.settle", False),
    ],
)
def test_values_that_can_be_set_can_be_got(marine, path, value):
    other = marine.with_values({path: value})
    if path == "sprockets.camshaft.name":
        path = "sprockets.cam.name"
    assert other.get_value(path) == value
    assert loads_drive(dumps_drive(other)) == other


def test_parts_may_be_given_as_tables(marine):
    other = marine.with_values({"sprockets.tightener.load": {"torque": 5}, "contact.sprocket.partner": STEEL})
    assert other.sprockets[1].load == Load(torque=5.0)
    assert other.contact == marine.contact


def test_optional_tables_are_made(marine):
    other = marine.with_values({"sprockets.tightener.load.torque": 5, "guides.0.contact.restitution": 0.9})
    assert other.sprockets[1].load == Load(torque=5.0)
    assert other.guide_contact(0).restitution == 0.9 and other.guide_contact(0).width == 0.063
    assert marine.get_value("sprockets.tightener.load.torque") is None


@pytest.mark.parametrize(
    ("values", "gone"),
    [
        ({"chain.mass_per_length": 60.0}, ["chain.roller_mass"]),
        ({"chain.damping_ratio": 0.1}, ["chain.damping"]),
        ({"contact.sprocket.stiffness": 1e9}, [f"contact.sprocket.{key}" for key in ("width", "roller", "partner")]),
        (
            {f"contact.guide.{key}": value for key, value in ({"stiffness": None} | MATERIALS).items()},
            ["contact.guide.stiffness"],
        ),
    ],
)
def test_alternatives_give_way(marine, values, gone):
    start = marine.with_values({"contact.guide.stiffness": 1e6})
    other = start.with_values(values)
    for path, value in values.items():
        assert other.get_value(path) == (Material(**value) if isinstance(value, dict) else value)
    assert [other.get_value(path) for path in gone] == [None] * len(gone)


@pytest.mark.parametrize("pair", [("roller_mass", "mass_per_length"), ("damping", "damping_ratio")])
def test_alternatives_both_set_are_an_error(marine, pair):
    with pytest.raises(DriveError, match="not together"):
        marine.with_values({f"chain.{key}": 1 for key in pair})


def test_taking_away_what_is_not_there_changes_nothing(marine):
    nothing = ("chain.mass_per_length", "contact.sprocket.stiffness", "sprockets.tightener.load.torque")
    assert marine.with_values(dict.fromkeys(nothing)) == marine


def test_taking_away_brings_the_default_or_an_error(marine):
    changed = marine.with_values({"run.gravity": None, "run.integrator": "rk4", "sprockets.camshaft.load.torque": None})
    assert changed.run.gravity == (0.0, -9.81) and changed.sprockets[2].load.torque == 0.0
    with pytest.raises(DriveError, match=r"^run\.duration: missing; must be a positive number$"):
        marine.with_values({"run.duration": None})


def test_guide_override_of_stiffness_or_materials(marine):
    stiff = marine.with_values({"guides.0.contact.stiffness": 1e6}).guide_contact(0)
    assert (stiff.stiffness, stiff.width, stiff.roller, stiff.restitution) == (1e6, None, None, 0.5)
    common = marine.with_values({"contact.guide.stiffness": 1e6})
    with pytest.raises(DriveError) as caught:
        common.with_values({"guides.0.contact.width": 0.05, "guides.0.contact.roller": STEEL})
    missing = [f"guides.tight strand.contact.{key}" for key in ("reference_load", "partner")]
    assert [line.split(":")[0] for line in caught.value.errors] == missing


@pytest.mark.parametrize(
    ("path", "line"),
    [
        ("sprockets.camshaft.lod.torque", "unknown path; did you mean sprockets.camshaft.load.torque?"),
        ("sprockets.camshat.teeth", "unknown path; did you mean sprockets.camshaft.teeth?"),
        ("chain.rollermass", "unknown path; did you mean chain.roller_mass?"),
        ("sprockets.9.teeth", "unknown path; allowed are crankshaft, tightener, camshaft under sprockets"),
        ("sprockets.-1.teeth", "unknown path; allowed are crankshaft, tightener, camshaft under sprockets"),
        ("sprockets.tightener.load.harmonics.0.phase", "unknown path; "),
        ("run.gravity.2", "unknown path; did you mean run.gravity.1?"),
        ("chain.pitch.x.y.z.very.long", "unknown path; chain.pitch has no keys"),
        ("zzz", "unknown path; allowed are chain, sprockets, guides, arms, tensioners, contact, run"),
        ("", "unknown path; allowed are chain, sprockets, guides, arms, tensioners, contact, run"),
    ],
)
def test_unknown_path_suggests_the_nearest(marine, path, line):
    for action in (lambda: marine.with_values({path: 1}), lambda: marine.get_value(path)):
        with pytest.raises(DriveError) as caught:
            action()
        assert len(caught.value.errors) == 1
        assert caught.value.errors[0].startswith(f"{path}: {line}")


def test_with_values_tells_all_errors(marine):
    values = {"chain.lnks": 3, "chain.pitch": "a", "sprockets.camshaft.teeth": 1, "run.step": 9.0}
    with pytest.raises(DriveError) as caught:
        marine.with_values(values)
    assert caught.value.errors == (
        "chain.lnks: unknown path; did you mean chain.links?",
        f'chain.pitch = "a": {POSITIVE}',
        "sprockets.camshaft.teeth = 1: must be an integer of at least 5",
        "run.step = 9.0: must be at most the duration, 2",
    )


def test_numpy_numbers_are_numbers(marine):
    values = {
        "chain.links": np.int64(164),
        "chain.pitch": np.float64(0.12),
        "sprockets.camshaft.center": np.array([0.3, 6.0]),
        "contact.guide.restitution": np.float32(0.25),
        "run.settle": np.bool_(False),
    }
    other = marine.with_values(values)
    assert [type(other.get_value(path)) for path in values] == [int, float, tuple, float, bool]
    assert loads_drive(dumps_drive(other)) == other
    with pytest.raises(DriveError, match=r"chain\.pitch = true"):
        marine.with_values({"chain.pitch": np.bool_(True)})


@pytest.mark.parametrize(
    ("drive", "left_out"),
    [(load_drive(MARINE), "-"), (loads_drive(BLADE), "chain")],  # a size needs the stiffness with it
    ids=["marine", "blade"],
)
def test_every_listed_path_can_be_got_and_set_to_its_value(drive, left_out):
    paths = drive.paths()
    assert len(set(paths)) == len(paths) and {"run.gravity.0", "chain.size"} < set(paths)
    for path in paths:
        assert path.startswith(left_out) or drive.with_values({path: drive.get_value(path)}) == drive, path


def test_paths_of_optional_tables_are_listed(marine):
    assert {"sprockets.tightener.load.torque", "guides.tight strand.contact.width"} < set(marine.paths())
