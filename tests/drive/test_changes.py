"""Copies of a drive that differ in the same numbers: what `with_values` gives, and what it says."""

import numpy as np
import pytest

from warpchain.drive import load_drive
from warpchain.drive.changes import Changes
from warpchain.drive.drive import NUMBER_RULES
from warpchain.drive.examples import drive_path, example_names
from warpchain.errors import DriveError

PATHS = (
    "chain.stiffness",
    "sprockets.0.center.1",
    "sprockets.0.prescribed.speed",
    "sprockets.1.teeth",
    "contact.sprocket.restitution",
    "run.duration",
)


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
        for factor in (1.0, 1.01, -1.0, 3.0, 1e7, np.nan, 0.98):
            values = {path: base.get_value(path) * factor for path in paths}
            if factor == 3.0:
                values = {path: base.get_value(path) * 3 for path in paths}  # whole numbers stay whole
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


class Read(dict):
    """A drive, or a part of one of its lists, as a mapping, which notes which numbers, or parts with some, are read."""

    def __init__(self, part, notes, within=""):
        super().__init__(part.__dict__)
        self.notes, self.within = notes, within
        for kind in LISTS if not within else ():
            self[kind] = tuple(Read(inner, notes, f"{kind}.") for inner in getattr(part, kind))

    def get(self, key, default=None):
        value = super().get(key, default)
        if (self.within or key not in LISTS) and not isinstance(value, str | None):
            self.notes.add(self.within + key)
        return value


@pytest.mark.parametrize("name", example_names())
def test_rules_read_no_more_than_they_say(name):
    for rule, keys in NUMBER_RULES.items():
        notes = set()
        assert not list(rule(Read(load_drive(drive_path(name)), notes)))
        assert {note for note in notes if note.partition(".")[0] not in keys} <= keys


def test_other_values_go_the_long_way():
    base = load_drive(drive_path("marine"))
    changes = Changes(base)
    for values in ({"sprockets.1.load": {"torque": 1.0}}, {"sprockets.1.center": [1.2, 3.0]}):
        for _ in range(2):
            assert changes.drive(values) == base.with_values(values)
    for same in ({"sprockets.1.mass": 1.0, "sprockets.tightener.mass": 2.0},):
        assert changes.drive(same) == changes.drive(same) == base.with_values(same)
    with pytest.raises(DriveError, match=r"chain\.stifness: unknown path; did you mean chain\.stiffness\?"):
        changes.drive({"chain.stifness": 1e9})


def test_what_is_not_changed_is_shared():
    base = load_drive(drive_path("marine"))
    changes = Changes(base)
    first, second = (changes.drive(dict.fromkeys(PATHS[:1], stiffness)) for stiffness in (1e9, 2e9))
    assert second.chain.stiffness == 2e9 and second.sprockets is first.sprockets and second.contact is first.contact
