"""Copies of a drive that differ in the same numbers: what `with_values` gives, and what it says."""

import tomllib

import numpy as np
import pytest
from drives import BLADE, put

from warpchain.drive import Chain, Drive, load_drive
from warpchain.drive.drive import NUMBER_RULES
from warpchain.drive.examples import drive_path, example_names
from warpchain.drive.replace import Changes
from warpchain.errors import DriveError


def numbers(drive):
    """Every path of a drive that leads to a number."""
    return [path for path in drive.paths() if type(drive.get_value(path)) in (int, float)]


@pytest.mark.parametrize("name", example_names())
@pytest.mark.filterwarnings("ignore")
def test_copies_and_errors_are_those_of_with_values(name):
    """Each number of each example times factors of which some are not allowed: first alone, then two at a time."""
    base, random = load_drive(drive_path(name)), np.random.default_rng(1)
    every, refused = numbers(base), 0
    pairs = [(path,) for path in every] + [tuple(random.choice(every, 2, replace=False)) for _ in range(30)]
    for paths in pairs:
        changes = Changes(base)
        for factor in (1.0, 1.01, -1.0, 3, 1e7, np.nan, 0.98):  # times 3 whole numbers stay whole
            values = {path: base.get_value(path) * factor for path in paths}
            try:
                expected = base.with_values(values)
            except DriveError as error:
                refused += 1
                with pytest.raises(DriveError) as found:
                    changes.drive(values)
                assert str(found.value) == str(error)
            else:
                assert changes.drive(values) == expected
    assert refused > 50


def test_numbers_that_stand_for_others_replace_them():
    changes = Changes(load_drive(drive_path("marine")))
    for mass in (60.0, 61.0):
        made = changes.drive({"chain.mass_per_length": mass, "chain.damping_ratio": 0.1})
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
        if (self.within or key not in (*LISTS, "chain")) and not isinstance(value, str | None):
            self.notes.add(self.within + key)
        return value


@pytest.mark.parametrize("name", example_names())
def test_rules_read_no_more_than_they_say(name):
    for rule, keys in NUMBER_RULES.items():
        notes = set()
        assert not list(rule(Read(load_drive(drive_path(name)), notes)))
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
    changes = Changes(base)
    for _ in range(2):  # the second time by the form that the first has left
        assert changes.drive(allowed) == base.with_values(allowed)
    with pytest.raises(DriveError) as expected:
        base.with_values(refused)
    with pytest.raises(DriveError) as found:
        changes.drive(refused)
    assert str(found.value) == str(expected.value)


def test_other_values_go_the_long_way():
    base = load_drive(drive_path("marine"))
    changes = Changes(base)
    for values in ({"sprockets.1.load": {"torque": 1.0}}, {"sprockets.1.center": [1.2, 3.0]}):
        for _ in range(2):
            assert changes.drive(values) == base.with_values(values)
    same = {"sprockets.1.mass": 1.0, "sprockets.tightener.mass": 2.0}
    assert changes.drive(same) == changes.drive(same) == base.with_values(same)
    with pytest.raises(DriveError, match=r"chain\.stifness: unknown path; did you mean chain\.stiffness\?"):
        changes.drive({"chain.stifness": 1e9})


def test_what_is_not_changed_is_shared():
    base = load_drive(drive_path("marine"))
    changes = Changes(base)
    first, second = (changes.drive({"chain.stiffness": stiffness}) for stiffness in (1e9, 2e9))
    assert second.chain.stiffness == 2e9 and second.sprockets is first.sprockets and second.contact is first.contact
