"""Guides moved until they press a strand in by a depth, against triangles."""

import math

import numpy as np
import pytest
from drives import timing, two_sprockets

from warpchain import cli
from warpchain.assembly.arm_balance import chain_path
from warpchain.assembly.fitting import fit_links
from warpchain.assembly.guide_fit import fit_indentation
from warpchain.drive import load_drive, save_drive
from warpchain.errors import DriveError
from warpchain.model import single_chain

RADIUS, ROLLER = 0.05 / (2.0 * math.sin(math.pi / 20)), 0.015
CONTACT = {"restitution": 0.3, "stiffness": 1e8, "impact_speed_floor": 0.02}
ARC = {"center": [0.5, -0.3], "radius": 0.5, "from": 65.0, "to": 115.0}
SHAPES = {
    "bar": {"start": [0.4, 0.1], "end": [0.6, 0.1], "end_radius": 0.05, "side": "left"},
    "points": {"points": [[0.7, 0.1], [0.3, 0.1]], "side": "right"},
    "arcs": {"arcs": [ARC], "side": "right"},
}


def guided(shape, **more):
    """Two sprockets, their upper strand over a guide inside of it."""
    guide = {"name": "blade"} | SHAPES[shape] | more
    return two_sprockets().with_values({"contact.guide": CONTACT, "guides": [guide]})


def top(drive):
    """Height of the highest point of a guide's face [m]."""
    guide = drive.guides[0]
    if guide.arcs:
        return guide.arcs[0].center[1] + guide.arcs[0].radius
    return (guide.start or guide.points[0])[1]


@pytest.mark.parametrize("depth", [-0.01, 0.0, 0.012])
@pytest.mark.parametrize("shape", SHAPES)
def test_rollers_on_the_face_are_a_depth_off_the_tangent(shape, depth):
    # the upper strand runs at the height R: a face at R + d - r has rollers' centers d above it, to what files round
    moved = fit_indentation(guided(shape), "blade", depth)
    assert top(moved) == pytest.approx(RADIUS + depth - ROLLER, abs=2e-9)
    before, after = guided(shape).guides[0], moved.guides[0]
    assert after.model_copy(update={key: getattr(before, key) for key in ("start", "end", "points", "arcs")}) == before


def test_the_path_goes_over_the_blade():
    # a strand from tangent to tangent around an arc of radius 0.5 + r: longer by about its turn; it fits other links
    moved = fit_links(fit_indentation(guided("arcs"), "blade", 0.05))
    path = chain_path(single_chain(moved))
    (string,) = [string for string in path.strings if string is not None]
    assert string is not None
    assert abs(path.nominal_strain) < 0.02


def test_a_guide_below_presses_the_other_way():
    below = guided("points", points=[[0.3, -0.1], [0.7, -0.1]])
    moved = fit_indentation(below, "blade", 0.01)
    assert moved.guides[0].points[0] == pytest.approx((0.3, -(RADIUS + 0.01 - ROLLER)), abs=1e-9)


def test_wrong_depths_are_named():
    with pytest.raises(DriveError, match=r'guide "bar": no such name; allowed are blade'):
        fit_indentation(guided("arcs"), "bar", 0.01)
    with pytest.raises(DriveError, match=r"indentation = 9: must be within 0.5 m, half of the strand"):
        fit_indentation(guided("arcs"), "blade", 9.0)
    measured = guided("points", points=None, radius=None, profile=[[0.7, 0.1], [0.5, 0.11], [0.3, 0.1]])
    with pytest.raises(DriveError, match=r"guides.blade.profile: is measured; only start and end, points or arcs"):
        fit_indentation(measured, "blade", 0.01)


def test_the_command_moves_a_blade_and_picks_links(tmp_path, capsys):
    path = tmp_path / "drive.toml"
    save_drive(guided("arcs"), path)
    assert cli.main(["fit", str(path), "--guide", "blade", "--indentation", "0.01", "--links"]) == 0
    assert top(load_drive(path)) == pytest.approx(RADIUS + 0.01 - ROLLER, abs=2e-9)
    for wrong in (["--guide", "blade"], ["--indentation", "0.01"], ["--guide", "x", "--indentation", "0.01"]):
        assert cli.main(["fit", str(path), *wrong]) == 2
        assert len(capsys.readouterr().err.strip().splitlines()) == 1


def test_blades_on_arms_move_in_the_drawing():
    # beside an arm with a sprocket, whose place the path needs: as deep as asked, with the arm as drawn
    drive = timing()
    names = [guide.name for guide in drive.guides if guide.arm is not None]
    moved = fit_indentation(drive, names[0], 0.004)
    again = fit_indentation(moved, names[0], 0.004)
    assert again.guides[0].points == pytest.approx(np.array(moved.guides[0].points), abs=2e-9)
    assert moved != drive
