"""Any drive reads back equal; any value anywhere is a drive or lines of errors."""

import pickle
import tomllib
import warnings

import tomlkit
from drives import BLADE, example
from hypothesis import given
from hypothesis import strategies as st

from warpchain.drive import Drive, dumps_drive, loads_drive
from warpchain.drive import toml as drive_toml
from warpchain.drive.schema import is_name
from warpchain.drive.shafts import FIXED
from warpchain.errors import DriveError

positive = st.floats(1e-6, 1e9)
not_negative = st.floats(0.0, 1e9)
number = st.floats(-1e6, 1e6)
place = st.floats(-1e4, 1e4)
pairs = st.tuples(place, place)
words = st.text(st.characters(codec="utf-8"), min_size=1, max_size=8).filter(is_name)
names = words.filter(lambda word: word != FIXED)  # which couplings take for what does not turn
harmonics = st.lists(st.fixed_dictionaries({"order": positive, "amplitude": number, "phase": number}), max_size=2)
loads = st.fixed_dictionaries(
    {}, optional={"torque": number, "viscous": not_negative, "ramp_time": not_negative, "harmonics": harmonics}
)
motions = st.fixed_dictionaries({"speed": not_negative}, optional={"ramp_time": positive, "harmonics": harmonics})
materials = st.fixed_dictionaries(
    {"youngs_modulus": st.floats(1e5, 1e12), "poissons_ratio": st.floats(-1, 0.5, exclude_min=True)}
)
by_materials = st.fixed_dictionaries(
    {"width": st.floats(0.01, 1.0), "reference_load": st.floats(1e-3, 1.0), "roller": materials, "partner": materials}
)
stiffness = st.one_of(by_materials, st.fixed_dictionaries({"stiffness": positive}))
common = {"restitution": st.floats(0, 1, exclude_min=True), "impact_speed_floor": positive}


def joined(*parts):
    """Dictionaries drawn from each strategy, as one."""
    return st.tuples(*parts).map(lambda drawn: {key: value for part in drawn for key, value in part.items()})


@st.composite
def chains(draw):
    pitch = draw(st.floats(1e-3, 1.0))
    values = {"pitch": pitch, "links": 2 * draw(st.integers(2, 500)), "stiffness": draw(positive)}
    values["roller_radius"] = pitch * draw(st.floats(0.1, 0.45))
    values[draw(st.sampled_from(["roller_mass", "mass_per_length"]))] = draw(positive)
    values[draw(st.sampled_from(["damping", "damping_ratio"]))] = draw(not_negative)
    return values


@st.composite
def bars(draw, pitch):
    """Bars of up to 14,142 pitches anywhere, whose ends are up to pi 1000 pitches long: 20,000 are allowed."""
    ways = st.floats(-1e4 * pitch, 1e4 * pitch)
    ends = st.tuples(pairs, ways, ways).map(lambda drawn: (drawn[0], _from(*drawn)))
    start, end = draw(ends.filter(lambda both: both[0] != both[1]))
    return {"start": start, "end": end, "end_radius": draw(st.floats(1e-6, 1e3).map(lambda r: max(r * pitch, 1e-9)))}


def _from(start, x, y):
    """A place so far from another, none beyond what is allowed."""
    return tuple(min(max(a + b, -1e4), 1e4) for a, b in zip(start, (x, y), strict=True))


@st.composite
def drives(draw):
    chain = draw(chains())
    words = draw(st.lists(names, min_size=4, max_size=6, unique=True))
    sprocket = st.fixed_dictionaries(
        {"teeth": st.integers(5, 99), "center": pairs, "wrap": st.sampled_from(["ccw", "cw"]), "inertia": positive},
        optional={"pitch": positive, "mass": positive, "load": loads, "prescribed": motions},
    )
    sprockets = [{"name": word, **draw(sprocket)} for word in words[:-2]]
    sprockets[draw(st.integers(0, len(sprockets) - 1))]["prescribed"] = draw(motions)
    override = joined(st.fixed_dictionaries({}, optional=common), st.one_of(st.just({}), stiffness))
    guides = []
    for word in words[-2 : len(words) - draw(st.integers(0, 2))]:
        guides.append({"name": word, **draw(bars(chain["pitch"]))})
        if draw(st.booleans()):
            guides[-1]["contact"] = draw(override)
    contact = joined(st.fixed_dictionaries(common, optional={"exponent": st.floats(1, 3)}), stiffness)
    tooth = {"clearance": chain["pitch"] * draw(st.floats(0, 0.04))}
    if draw(st.booleans()):
        tooth["seat_angle"] = draw(st.floats(1, 179))
    duration = draw(positive)
    run = {"duration": duration, "step": draw(st.sampled_from(["auto", duration / 3])), "sample_rate": draw(positive)}
    run["settle"] = draw(st.booleans())
    return Drive(
        chain=chain,
        sprockets=sprockets,
        guides=guides,
        contact={"sprocket": tooth | draw(contact), "guide": draw(contact)},
        run=run,
    )


@given(drives())
def test_round_trip_of_any_drive(drive):
    again = loads_drive(dumps_drive(drive))
    assert again == drive and hash(again) == hash(drive)
    assert pickle.loads(pickle.dumps(drive)) == drive


@given(drives(), st.data())
def test_any_path_of_any_drive_can_be_set_to_its_value(drive, data):
    path = data.draw(st.sampled_from(drive.paths()))
    assert drive.with_values({path: drive.get_value(path)}) == drive


@given(st.recursive(st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=3) | st.just([]),
                    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner)),
       st.data())  # fmt: skip
def test_any_wrong_value_anywhere_is_a_drive_error_or_nothing(value, data):
    """No value whatever, at any place of the file, makes anything but a drive or lines of errors."""
    drive = data.draw(st.sampled_from([example("marine"), loads_drive(BLADE)]))
    path = data.draw(st.sampled_from(drive.paths()))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # an odd number of links
        try:
            assert isinstance(drive.with_values({path: value}), Drive)
        except DriveError as error:
            assert all(": " in line for line in error.errors)


@given(st.dictionaries(st.text(max_size=5), st.floats(allow_nan=False) | st.integers() | st.text() | st.booleans()
                       | st.lists(st.text(max_size=5), max_size=3)))  # fmt: skip
def test_written_values_read_back(table):
    values = {"table": table, "list": [table, {}]}
    text = drive_toml.toml_text(values)
    assert tomllib.loads(text) == values
    document = tomlkit.parse(text)  # with which `warpchain fit` edits drive files
    assert document.unwrap() == values
    assert tomlkit.dumps(document) == text
