"""A drive file may leave out much; what it leaves out follows from the rest, and `check` says so."""

import math
import tomllib

import pytest
from command import run as command

from warpchain import dumps_drive, load_drive, loads_drive, simulate
from warpchain.assembly import assemble
from warpchain.drive.catalogue import CHAINS
from warpchain.drive.defaults import default_values
from warpchain.errors import DriveError

SHORTEST = """
[chain]
size = "16B"
[[sprockets]]
teeth = 19
center = [0, 0]
prescribed = { speed = "300 rpm" }
[[sprockets]]
teeth = 57
center = ["1 m", 0]
load = { torque = 900 }
"""


def test_a_file_of_size_teeth_centers_speed_and_load_is_read():
    drive = loads_drive(SHORTEST)
    radius = 0.5 * 0.0254 / math.sin(math.pi / 57)
    mass = 7850.0 * math.pi * radius**2 * 0.93 * 0.01702
    assert [sprocket.name for sprocket in drive.sprockets] == ["sprocket 1", "sprocket 2"]
    assert [sprocket.wrap for sprocket in drive.sprockets] == ["ccw", "ccw"]
    assert drive.sprockets[1].inertia == pytest.approx(0.5 * mass * radius**2, rel=0.05)  # to two figures
    assert drive.chain.stiffness_is_estimate and drive.chain.damping_ratio == 0.02
    assert drive.contact.sprocket.reference_load == pytest.approx(900.0 / radius, rel=0.05)
    assert drive.contact.sprocket.clearance == pytest.approx(0.004 * 0.0254, rel=0.05)
    assert drive.run.step == "auto" and drive.run.sample_rate == 20 * 5 * 19  # a tooth 20, 5 turns a second
    assert drive.run.duration == pytest.approx(2.2 * drive.chain.links / 95.0, rel=0.05)
    # the next even number of links above the way around: not stretched, and less than two links slack
    assert 0.0 >= assemble(drive).strain > -2.0 / 118.0 and drive.chain.links == 118
    assert loads_drive(dumps_drive(drive)) == drive and default_values(tomllib.loads(dumps_drive(drive))) == {}


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_it_runs():
    metrics = simulate(loads_drive(SHORTEST), duration=0.1).metrics.to_pylist()[0]
    assert not metrics["diverged"] and 0.0 < metrics["tension_max"] < CHAINS["16B"].breaking_load


def test_links_go_around_every_sprocket_in_its_sense():
    """Against the path of the assembly, with a sprocket that the chain turns the other way."""
    text = """
[chain]
size = "08B"
[[sprockets]]
teeth = 17
center = [0, 0]
prescribed = { speed = 100.0 }
[[sprockets]]
teeth = 13
center = [0.25, 0.13]
[[sprockets]]
teeth = 40
center = [0.6, 0.02]
load = { torque = 20 }
[[sprockets]]
teeth = 15
center = [0.3, 0.06]
"""
    drive = loads_drive(text)
    assert [sprocket.wrap for sprocket in drive.sprockets] == ["cw", "cw", "cw", "ccw"]
    assert 0.0 >= assemble(drive).strain > -2.0 / drive.chain.links


def test_what_is_given_stays():
    text = SHORTEST.replace('size = "16B"', 'size = "16B"\nlinks = 120\nstiffness = 1e8\ndamping = 5.0')
    text += "[contact.sprocket]\nrestitution = 0.5\nstiffness = 1e8\n[run]\nduration = 0.2\n"
    drive = loads_drive(text)
    contact = drive.contact.sprocket
    assert (drive.chain.links, drive.chain.stiffness, drive.chain.damping) == (120, 1e8, 5.0)
    # a table that is there has what it needs, in the meaning that keys have without a default
    assert (contact.restitution_means, contact.stiffness, contact.width) == ("parameter", 1e8, None)
    assert contact.bush_stiffness is contact.friction is None and contact.impact_speed_floor == 0.02
    assert drive.run.duration == 0.2


@pytest.mark.parametrize(
    ("find", "put", "line"),
    [
        ("center = [0, 0]", 'center = [0, "x"]', 'sprockets.0.center = [0, "x"]: must be two finite numbers'),
        ("teeth = 57", "teeth = 0", "sprockets.1.teeth = 0: must be"),
        ("teeth = 57", "", "sprockets.1.teeth: missing"),
        ('size = "16B"', 'size = "16b"', 'chain.size = "16b": must be'),
        ("[chain]", "contact = 3\n[chain]", "contact = 3: must be a table"),
        ("[chain]", "run = [1]\n[chain]", "run = [1]: must be a table"),
        ("load = { torque = 900 }", 'load = { torque = "many" }', "sprockets.1.load.torque"),
    ],
)
def test_mistakes_are_still_said(find, put, line):
    with pytest.raises(DriveError) as caught:
        loads_drive(SHORTEST.replace(find, put))
    (error,) = caught.value.errors
    assert line in error


def test_without_a_size_links_and_masses_are_needed():
    with pytest.raises(DriveError) as caught:
        loads_drive(SHORTEST.replace('size = "16B"', "pitch = 0.0254"))
    missing = [error.removeprefix("<text>: ").partition(":")[0] for error in caught.value.errors]
    assert {"chain.links", "chain.stiffness", "sprockets.1.inertia", "run.duration"} <= set(missing)
    assert not [path for path in missing if path.startswith("contact") or path == "run.step"]


def test_check_lists_them(capsys, tmp_path):
    path = tmp_path / "first.toml"
    path.write_text(SHORTEST)
    status, out, err = command(capsys, "check", path)
    assert (status, err) == (0, [])
    said = [line for line in out if line.startswith("default, not in the file: ")]
    assert said[0] == 'default, not in the file: chain: stiffness = "estimate", damping_ratio = 0.02, links = 118'
    assert any(line.startswith("default, not in the file: contact.sprocket: restitution = 0.3, ") for line in said)
    assert not [line for line in command(capsys, "check", "marine")[1] if line.startswith("default")]
    whole = tmp_path / "whole.toml"
    whole.write_text(dumps_drive(load_drive(path)))
    assert not [line for line in command(capsys, "check", whole)[1] if line.startswith("default")]
