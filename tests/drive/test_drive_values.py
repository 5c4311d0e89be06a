"""Changed copies of drives, alone and many in the same numbers, and values by key path."""

import tomllib

import numpy as np
import pytest
from drives import BLADE, LARGE, ONE_CHAIN, POSITIVE, STEEL, but, example, numbers, put

from warpchain.drive import Chain, Drive, Load, Material, dumps_drive, loads_drive
from warpchain.drive.changed_copies import DriveChanges
from warpchain.drive.drive import NUMBER_RULES
from warpchain.drive.examples import example_names
from warpchain.errors import DriveError
from warpchain.model import single_chain

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
    assert marine == example("marine")
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
    assert (
        single_chain(other).guide_contact(0).restitution == 0.9 and single_chain(other).guide_contact(0).width == 0.063
    )
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
    stiff = single_chain(marine.with_values({"guides.0.contact.stiffness": 1e6})).guide_contact(0)
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
        ("zzz", "unknown path; allowed are chain, chains, sprockets, guides, arms, tensioners, contact, run"),
        ("", "unknown path; allowed are chain, chains, sprockets, guides, arms, tensioners, contact, run"),
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
    [(example("marine"), "-"), (loads_drive(BLADE), "chain")],  # a size needs the stiffness with it
    ids=["marine", "blade"],
)
def test_every_listed_path_can_be_got_and_set_to_its_value(drive, left_out):
    paths = drive.paths()
    assert len(set(paths)) == len(paths) and {"run.gravity.0", "chain.size"} < set(paths)
    for path in paths:
        assert path.startswith(left_out) or drive.with_values({path: drive.get_value(path)}) == drive, path


def test_paths_of_optional_tables_are_listed(marine):
    assert {"sprockets.tightener.load.torque", "guides.tight strand.contact.width"} < set(marine.paths())


@pytest.mark.parametrize("name", but(example_names(), LARGE))
@pytest.mark.filterwarnings("ignore")
def test_copies_and_errors_are_those_of_with_values(name):
    """Each number of each example times factors of which some are not allowed: first alone, then two at a time."""
    base, random = example(name), np.random.default_rng(1)
    every, refused = numbers(base), 0
    pairs = [(path,) for path in every] + [tuple(random.choice(every, 2, replace=False)) for _ in range(30)]
    for paths in pairs:
        changes = DriveChanges(base)
        for factor in (1.0, 1.01, -1.0, 3, 1e7, 1e300, np.nan, 0.98):  # times 3 whole numbers stay whole
            values = {path: base.get_value(path) * factor for path in paths}
            try:
                expected = base.with_values(values)
            except DriveError as error:
                refused += 1
                with pytest.raises(DriveError) as found:
                    changes.changed_drive(values)
                assert str(found.value) == str(error)
            else:
                assert changes.changed_drive(values) == expected
    assert refused > 50


def test_numbers_that_stand_for_others_replace_them():
    changes = DriveChanges(example("marine"))
    for mass in (60.0, 61.0):
        made = changes.changed_drive({"chain.mass_per_length": mass, "chain.damping_ratio": 0.1})
        assert made == changes.base.with_values({"chain.mass_per_length": mass, "chain.damping_ratio": 0.1})
        assert made.chain.roller_mass is None and made.chain.damping is None


LISTS = ("sprockets", "guides", "arms", "tensioners", "probes")


def read_chain(chain, notes):
    """A chain that notes which numbers, or parts with some, are read of it."""

    class Read(Chain):
        def __getattribute__(self, key):
            value = super().__getattribute__(key)
            if key in Chain.model_fields and not isinstance(value, str | None):
                notes.add(f"chain.{key}")
            return value

    return Read.model_construct(**chain.__dict__)


class Read(dict):
    """A drive, or a part of one of its lists, as a mapping, which notes the same of itself."""

    def __init__(self, part, notes, within=""):
        super().__init__(part.__dict__)
        self.notes, self.within = notes, within
        if not within:
            self["chain"] = read_chain(part.chain, notes)
            self |= {kind: tuple(Read(inner, notes, f"{kind}.") for inner in getattr(part, kind)) for kind in LISTS}

    def get(self, key, default=None):
        value = super().get(key, default)
        if (self.within or key not in (*LISTS, "chain", "chains")) and not isinstance(value, str | None):
            self.notes.add(self.within + key)
        return value


@pytest.mark.parametrize("name", ONE_CHAIN)  # of one chain
def test_rules_read_no_more_than_they_say(name):
    for rule, keys in NUMBER_RULES.items():
        notes = set()
        assert not list(rule(Read(example(name), notes)))
        assert {note for note in notes if note.partition(".")[0] not in keys} <= keys


RULED = [
    ({"chain.links": 98}, {"chain.links": 80}),  # with a worn link of number 90
    ({"chain.links": 98}, {"chain.links": 2_000_000}),
    ({"chain.worn_links.0.link": 6}, {"chain.worn_links.0.link": 90}),
    ({"chain.play": 1.1e-5}, {"chain.play": 0.005}),
    ({"chain.pitch": 9.6e-3}, {"chain.pitch": 6e-3}),
    ({"chain.roller_radius": 3.1e-3}, {"chain.roller_radius": 5e-3}),
    ({"sprockets.0.teeth": 20}, {"sprockets.0.teeth": 2_000_000}),
    ({"sprockets.0.prescribed.ramp_time": 0.0}, {"sprockets.0.prescribed.ramp_time": 0.1}),  # with a table
    ({"guides.0.radius": 0.26}, {"guides.0.radius": 1e-10}),
    ({"guides.0.radius": 0.26}, {"guides.0.radius": 5e-3}),
    ({"guides.0.radius": 0.26}, {"guides.0.radius": 5.0}),
    ({"guides.0.points.1.0": -0.033}, {"guides.0.points.1.0": 2e4}),
    ({"guides.1.start.0": 0.056}, {"guides.1.start.0": 2e4}),
    ({"guides.1.start.0": 0.05, "guides.1.start.1": 0.2}, {"guides.1.start.0": 0.04, "guides.1.start.1": 0.08}),
    ({"guides.1.end_radius": 0.031}, {"guides.1.end_radius": 1e-10}),
    ({"guides.1.offset": 0.0041}, {"guides.1.offset": 0.02}),
    ({"arms.0.stops.0": -11.0}, {"arms.0.stops.0": 13.0}),
    ({"arms.0.pivot.0": -0.056}, {"arms.0.pivot.0": 2e4}),
    ({"tensioners.0.direction.0": 2.1}, {"tensioners.0.direction.0": -2.0}),
    ({"tensioners.0.plunger.gap": 5.1e-5}, {"tensioners.0.plunger.gap": 0.01}),
    ({"contact.sprocket.clearance": 1.1e-4}, {"contact.sprocket.clearance": 0.01}),
]
"""Numbers that are allowed, and others that only a rule forbids."""


@pytest.mark.parametrize(("allowed", "refused"), RULED)
@pytest.mark.filterwarnings("ignore")
def test_each_rule_is_asked_where_its_numbers_change(allowed, refused):
    values = tomllib.loads(BLADE)
    put(values, "chain/play", 1e-5)
    put(values, "chain/worn_links", [{"link": 5, "elongation": 0.01}, {"link": 90, "elongation": 0.02}])
    put(values, "sprockets/0/prescribed", {"table": {"time": [0.0, 0.05], "speed": [200.0, 210.0]}})
    base = Drive(**values)
    changes = DriveChanges(base)
    for _ in range(2):  # the second time by the form that the first has left
        assert changes.changed_drive(allowed) == base.with_values(allowed)
    with pytest.raises(DriveError) as expected:
        base.with_values(refused)
    with pytest.raises(DriveError) as found:
        changes.changed_drive(refused)
    assert str(found.value) == str(expected.value)


def test_other_values_go_the_long_way():
    base = example("marine")
    changes = DriveChanges(base)
    for values in ({"sprockets.1.load": {"torque": 1.0}}, {"sprockets.1.center": [1.2, 3.0]}):
        for _ in range(2):
            assert changes.changed_drive(values) == base.with_values(values)
    same = {"sprockets.1.mass": 1.0, "sprockets.tightener.mass": 2.0}
    assert changes.changed_drive(same) == changes.changed_drive(same) == base.with_values(same)
    with pytest.raises(DriveError, match=r"chain\.stifness: unknown path; did you mean chain\.stiffness\?"):
        changes.changed_drive({"chain.stifness": 1e9})


def test_what_is_not_changed_is_shared():
    base = example("marine")
    changes = DriveChanges(base)
    first, second = (changes.changed_drive({"chain.stiffness": stiffness}) for stiffness in (1e9, 2e9))
    assert second.chain.stiffness == 2e9 and second.sprockets is first.sprockets and second.contact is first.contact


@pytest.mark.parametrize("kind", [float, np.float64])
def test_refused_numbers_are_shown_without_the_digits_of_rounding(kind):
    """3 times 3 mm is 0.009000000000000001 m in float64."""
    with pytest.raises(DriveError, match=r"pitch = -0\.009: must be a positive number"):
        Chain(**SMALL | {"pitch": kind(-3 * 0.003)})
    with pytest.raises(DriveError, match=r"\.center = \[0\.009, inf\]: must be two finite numbers"):
        example("marine").with_values({"sprockets.0.center": [kind(3 * 0.003), kind("inf")]})
