"""The example studies: each fits its drive, and says what it says it does."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
from drives import example

import warpchain.study
from warpchain.assembly.arm_balance import chain_path
from warpchain.model import single_chain

FOLDER = Path(warpchain.study.__file__).parent / "examples"
NAMES = (
    "car-over-noise",
    "car-tensioner",
    "cold-to-hot",
    "engine-tensioner",
    "guide-indentation",
    "marine-lever",
    "pitch-elongation",
    "speed-sweep",
    "swing-idler",
)


def study(name):
    return tomllib.loads((FOLDER / f"{name}.toml").read_text())


def test_these_are_all():
    assert sorted(path.stem for path in FOLDER.glob("*.toml")) == sorted(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_the_study_reader_takes_them(name):
    spec = pytest.importorskip("warpchain.study.spec")
    loaded = spec.load_study(FOLDER / f"{name}.toml")
    spec.check_base_drive(loaded, example(loaded.study.drive), name)  # raises what does not fit the drive
    assert [factor.name for factor in loaded.factors] == [factor["name"] for factor in study(name)["factors"]]


@pytest.mark.parametrize("indentation", [-0.01, 0.0, 0.036])
def test_the_bar_stands_where_the_study_says(indentation):
    """At indentation d the rollers of the straight strand would be d deep in the bar's face, at both of its ends."""
    values = study("guide-indentation")
    drive = example("marine")
    given = {"indentation": indentation}
    changes = {each["path"]: eval(each["expression"], given) for each in values["factors"] if "path" in each}
    moved = drive.with_values(changes)
    path = chain_path(single_chain(drive))  # which a bar so deep would bend
    start, along = path.strand_start[2], path.strand_end[2] - path.strand_start[2]
    normal = np.array([-along[1], along[0]]) / np.hypot(*along)
    for end in (moved.guides[0].start, moved.guides[0].end):
        # the drive's coordinates are given to 0.1 mm
        assert (np.subtract(end, start)) @ normal + drive.chain.roller_radius == pytest.approx(indentation, abs=5e-5)


def test_the_elongated_chain_keeps_the_sprockets_pitch():
    factors = {factor["name"]: factor for factor in study("pitch-elongation")["factors"]}
    drive = example("marine")
    assert eval(factors["chain_pitch"]["expression"], {"elongation": 0.0}) == drive.chain.pitch
    assert float(factors["sprocket_pitch"]["expression"]) == drive.chain.pitch
    assert set(factors["sprocket_pitch"]["paths"]) == {f"sprockets.{s.name}.pitch" for s in drive.sprockets}


def test_the_cars_blade_keeps_its_middle_and_its_length():
    """Of any radius; with the drawn one and the drawn lever it is the drive as drawn, to what the file rounds."""
    bench = warpchain.open_study(FOLDER / "car-tensioner.toml")
    drawn = example("car")
    here = drawn.tensioners[0].at
    lever = float(np.hypot(*np.subtract(here, drawn.arms[0].pivot)))
    same, flat = bench.drives([{"preload": 40.0, "lever": lever, "radius": r} for r in (0.25, 0.4)])
    faces = [
        single_chain(drive).profile([guide.name for guide in drive.guides].index("blade"))
        for drive in (drawn, same, flat)
    ]
    middles = [face.at(0.5 * face.face_length)[0] for face in faces]
    np.testing.assert_allclose(middles[1:], [middles[0]] * 2, atol=2e-6)
    for face in faces:
        assert face.face_length == pytest.approx(0.2007129, abs=1e-6)  # 46 degrees of 250 mm
    np.testing.assert_allclose(same.tensioners[0].at, here, atol=2e-6)
