"""The picture of a drive: the chain around guides, arms and tensioners where they stand; notebooks and `check`."""

import dataclasses

import numpy as np
import pytest
from command import run as command
from drives import example, two_sprockets
from matplotlib.collections import LineCollection

from warpchain import Record, simulate
from warpchain.assembly.arm_balance import RestingArm, chain_path
from warpchain.drive.examples import example_names
from warpchain.model import Model, single_chain
from warpchain.results.guide_load import face_coordinates, rollers_in_guide_frame
from warpchain.results.outlines import (
    chain_outline,
    guide_arm_tensioner_parts,
    pose_at_frame,
    pose_at_start,
    teeth_parts,
)
from warpchain.view.figures.drive_figure import PART_STYLES, drive_figure
from warpchain.view.html import picture_html
from warpchain.view.notebook import PICTURE_SIZE


@pytest.fixture(scope="module")
def moved():
    """The car's drive with its crank 4 mm nearer, which leaves more of the chain to the blade."""
    nearer = {"sprockets.crank.center": [0.0, 0.004], "run.duration": 0.004}
    return simulate(example("car").with_values(nearer), record=Record(rate=2000.0))[0]


def heights(model, points, arm):
    """(G, P) heights of points over the faces of guides [m], nan beyond their ends, with the arms at these angles."""
    found = []
    for g in range(len(model.guides)):
        a = model.arm_of(g)
        pivot = np.zeros(2) if a is None else np.asarray(model.arms[a].pivot)
        c, s = np.cos(0.0 if a is None else arm[a]), np.sin(0.0 if a is None else arm[a])
        found.append(face_coordinates(model.profile(g), (points - pivot) @ np.array([[c, -s], [s, c]]) + pivot)[1])
    return np.array(found)


def rides(model):
    """Asserts that the drawn chain touches every pitch circle and is on no guide's wrong side.

    A silent chain's links touch with their middles, so that its pins stand p^2 / (8 R) higher on an arc of radius R.
    """
    path = chain_path(model)
    line, pose = chain_outline(model, path), pose_at_start(model, path)
    assert model.chain.is_open or (line[0] == line[-1]).all()
    assert np.hypot(*np.diff(line, axis=0).T).max() < 1.01 * path.strand_length.max()
    for s, center in enumerate(pose.center):
        assert np.hypot(*(line - center).T).min() == pytest.approx(path.radius[s], rel=1e-9)
    for g, over in enumerate(heights(model, line, pose.arm)):
        radii = [at.arc.radius for string in path.strings if string for at in string.touches if at.arc.guide == g]
        lowest = np.nanmin(over) - model.guide_offset(g) if np.isfinite(over).any() else 0.0
        raised = model.chain.pitch**2 / 8.0 / max(radii) if radii and model.chain.is_silent else 0.0
        assert lowest == pytest.approx(raised, rel=1e-3, abs=1e-9) if radii else lowest > -1e-9


@pytest.mark.parametrize("name", example_names())
def test_the_drawn_chain_rides_on_sprockets_and_guides(name):
    """The line touches every pitch circle, and is never lower over a face than rollers on it are; where the chain bends
    around one it is on it. Its points lie on the path: to round-off."""
    for chain in Model(example(name)).chains:
        rides(chain)


def test_the_car_is_drawn_with_its_blade_against_the_chain(moved):
    """Of recorded rollers the nearest presses its guide: by less than a hundredth of its radius it lies in its face.
    At angle 0, as drawn, the blade stands 5.9 mm off."""
    drive, pose = moved.drive, pose_at_frame(moved, -1)
    assert abs(pose.arm[0]) > 0.01
    lowest = np.nanmin(heights(single_chain(drive), moved.position[-1], pose.arm), axis=1)
    offset = [single_chain(drive).guide_offset(g) for g in range(len(drive.guides))]
    assert lowest == pytest.approx(offset, rel=0.01)
    (blade,) = (part.points for part in guide_arm_tensioner_parts(single_chain(drive), pose) if part.name == "blade")
    places, angle = rollers_in_guide_frame(
        moved, 0, np.full(len(blade), len(moved.time) - 1), np.zeros(len(blade), int)
    )
    assert angle == pytest.approx(pose.arm[0])
    gap = np.hypot(*(blade[:, None] - moved.position[-1]).transpose(2, 0, 1)).min()
    assert gap == pytest.approx(offset[0], rel=0.01)


def test_plungers_are_drawn_where_they_push(moved):
    """At the recorded extension, which is kinematic, and at assembly at that of the arm in balance."""
    drive = moved.drive
    drawn = {
        part.name: part.points
        for part in guide_arm_tensioner_parts(single_chain(drive), pose_at_start(single_chain(drive)))
        if part.kind == "plunger"
    }
    still = RestingArm(single_chain(drive), 0).extension(
        drive.tensioners[0], chain_path(single_chain(drive)).arm_angle[0]
    )
    tensioner = drive.tensioners[0]
    for points, extension in (
        (drawn["tensioner"], still),
        (next(p.points for p in guide_arm_tensioner_parts(moved.model, pose_at_frame(moved, 3))
              if p.kind == "plunger"),
         moved.tensioner_extension[3, 0]),
    ):  # fmt: skip
        reach = ((points - tensioner.at) @ np.asarray(tensioner.unit_direction)).max()
        assert reach == pytest.approx(float(extension), abs=1e-12)


def test_bodies_of_which_nothing_was_recorded_are_where_the_run_began(moved):
    bare = dataclasses.replace(moved, arm_angle=None, sprocket_angle=None, sprocket_center=None)
    for own, start in zip(pose_at_frame(bare, 2), pose_at_start(single_chain(moved.drive)), strict=True):
        assert (own == start).all()


@pytest.mark.parametrize("name", ["car", "marine"])
def test_the_figure_has_every_part_at_its_place(name):
    drive = example(name)
    pose = pose_at_start(single_chain(drive))
    (axis,) = drive_figure(drive).axes
    parts = [*teeth_parts(single_chain(drive), pose, 4), *guide_arm_tensioner_parts(single_chain(drive), pose)]
    scale = 1e3 if "[mm]" in axis.get_xlabel() else 1.0
    drawn = [line.get_xydata() for line in axis.lines] + [patch.get_xy() for patch in axis.patches]
    for part in parts:
        assert any(len(line) >= len(part.points) and np.allclose(line[: len(part.points)], scale * part.points)
                   for line in drawn), part.name  # fmt: skip
    assert {part.kind for part in parts} <= set(PART_STYLES)
    words = {text.get_text() for text in axis.texts}
    assert words >= {part.name for part in (*drive.sprockets, *drive.guides, *drive.tensioners)}
    low, high = np.array([axis.get_xlim(), axis.get_ylim()]).T
    assert all((low < points).all() and (points < high).all() for points in drawn)


def test_a_frame_has_every_link_in_a_color():
    trajectory = simulate(two_sprockets(duration=0.002))[0]
    axis = drive_figure(trajectory, 5).axes[0]
    (chain,) = (part for part in axis.collections if isinstance(part, LineCollection))
    assert len(chain.get_segments()) == trajectory.drive.chain.links
    bare = dataclasses.replace(trajectory, tension=None, sprocket_force=None)
    assert not drive_figure(bare, 5).axes[0].collections and len(drive_figure(bare, 5).axes) == 1


def test_notebooks_show_that_figure(moved):
    """Of a trajectory its last frame."""
    last = len(moved.time) - 1
    for of, frame in ((moved, last), (moved.drive, None)):
        assert picture_html(drive_figure(of, frame, size=PICTURE_SIZE), "the drive", "png") in of._repr_html_()


def test_check_draws_the_drive(capsys, tmp_path):
    status, _, err = command(capsys, "check", "car", "-o", tmp_path / "car.svg")
    assert (status, err) == (0, []) and "</svg>" in (tmp_path / "car.svg").read_text()
    # also one whose chain does not fit, which is what the picture may tell
    status, *_ = command(capsys, "check", "car", "--set", "chain.links=140", "-o", tmp_path / "long.png")
    assert status == 2 and (tmp_path / "long.png").stat().st_size > 10_000
    status, _, err = command(capsys, "check", "car", "-o", tmp_path / "car.gif")
    assert status == 2 and err == [f"warpchain: error: -o {tmp_path / 'car.gif'}: must end in .png, .svg"]
