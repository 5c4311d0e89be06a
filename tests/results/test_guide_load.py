"""Guide load and friction over arc length against a chain that slides along a bar under a known force."""

import numpy as np
import pytest
from drives import two_sprockets
from drives import with_bar as bar_drive

from warpchain import Trajectory
from warpchain.drive.face_profile import Piece, make_profile
from warpchain.model import single_chain
from warpchain.results.guide_load import face_coordinates, face_tangents, guide_loads, recorded_guide_contacts
from warpchain.results.losses import friction_power

PITCH, RADIUS, SPEED, FORCE, MU = 0.05, 0.015, 4.0, 30.0, 0.2
BAR = {"start": (0.1, 0.2), "end": (0.5, 0.5)}
"""0.5 m long, its heading (0.8, 0.6)."""


def with_bar():
    stiff = {"contact.guide.stiffness": 1e8, "contact.guide.friction": MU}
    return bar_drive(BAR["start"], BAR["end"], 0.05).with_values(stiff)


def sliding(frames=2000, backward=False):
    """60 rollers a pitch apart pass along the bar's line at `SPEED`, pressed by `FORCE` while they are on its face."""
    drive = with_bar()
    time = np.arange(frames) * (PITCH / SPEED) / 100.0  # a hundred frames a pitch, whole pitches
    t, n = np.array([0.8, 0.6]), np.array([-0.6, 0.8])
    place = PITCH * (np.arange(60) + 0.005) - 2.0 + SPEED * time[:, None] * (-1.0 if backward else 1.0)
    place = np.mod(place + 1.0, 60 * PITCH) - 1.0
    position = np.array(BAR["start"]) + place[..., None] * t + RADIUS * n
    velocity = np.broadcast_to(t * (-SPEED if backward else SPEED), position.shape)
    on = (place >= 0.0) & (place < 0.5)
    return Trajectory(
        drive, time, position=position, velocity=velocity, guide_force=np.where(on, FORCE, 0.0),
        sprocket_force=np.zeros(on.shape), tension=np.zeros(on.shape),
    )  # fmt: skip


@pytest.mark.parametrize("backward", [False, True])
def test_load_of_a_chain_that_slides_along_a_bar(backward):
    # a roller a pitch under the force P makes p = P / pitch and p v = P v / pitch everywhere along the face
    (load,) = guide_loads(sliding(backward=backward))
    on = (load.place > 0.0) & (load.place < 0.5)
    assert on.sum() == 40  # four stretches a pitch, ten pitches
    np.testing.assert_allclose(load.mean[on], FORCE / PITCH, rtol=1e-9)  # whole passings: nothing is left over
    np.testing.assert_allclose(load.pv[on], FORCE * SPEED / PITCH, rtol=1e-9)
    np.testing.assert_allclose(load.pv_peak[on], FORCE * SPEED / PITCH, rtol=1e-9)
    np.testing.assert_allclose(load.peak[on], FORCE, rtol=1e-12)
    np.testing.assert_allclose(load.speed[on], SPEED, rtol=1e-12)
    assert not load.mean[~on].any() and np.isnan(load.speed[~on]).all()
    assert load.touching == 1.0
    # the integral of p over the face is the mean force on it: ten rollers
    width = load.place[1] - load.place[0]
    assert load.mean.sum() * width == pytest.approx(10 * FORCE, rel=1e-12)


def test_friction_power_of_a_bar_is_that_of_its_rollers():
    power = friction_power(sliding())
    assert list(power) == ["bar"]  # neither joints nor teeth rub
    np.testing.assert_allclose(power["bar"], 10 * MU * FORCE * SPEED, rtol=1e-9)


def test_places_on_straight_face_and_rounded_ends():
    face = single_chain(with_bar()).profile(0)
    t, n, start = np.array([0.8, 0.6]), np.array([-0.6, 0.8]), np.array(BAR["start"])
    along = np.array([0.0, 0.1, 0.5])
    place, height = face_coordinates(face, start + along[:, None] * t + 0.02 * n)
    np.testing.assert_allclose(place, along, atol=1e-14)
    np.testing.assert_allclose(height, 0.02, atol=1e-14)
    # 30 degrees before the start and after the end, around the centers of the rounded ends, 0.01 above their surface
    angle = np.radians(30.0)
    arm = 0.06 * np.array([np.cos(angle) * n - np.sin(angle) * t, np.cos(angle) * n + np.sin(angle) * t])
    place, height = face_coordinates(face, np.array([start, start + 0.5 * t]) - 0.05 * n + arm)
    np.testing.assert_allclose(place, [-0.05 * angle, 0.5 + 0.05 * angle], atol=1e-14)
    np.testing.assert_allclose(height, 0.01, atol=1e-14)
    headings = face_tangents(face, place)  # turned by 30 degrees each way
    np.testing.assert_allclose(headings @ t, np.cos(angle), atol=1e-14)
    assert headings[0] @ n > 0.0 > headings[1] @ n
    beyond, _ = face_coordinates(face, start[None] - 0.3 * t - 0.06 * n)
    assert np.isnan(beyond).all()
    bar = face.pieces[1]
    ahead = face_tangents(face, np.array(face.places[1:2]))[0]
    np.testing.assert_allclose(bar.start + bar.length * ahead, face.pieces[2].start, atol=1e-14)


def test_places_on_a_curved_face():
    # a quarter circle of radius 0.3 that turns left about (0, 0.3): height is what is missing to the center
    face = make_profile([Piece((0.0, 0.0), 0.0, 1.0 / 0.3, 0.15 * np.pi)], 0.01)
    angle, height = np.radians([1.0, 44.0, 89.0]), np.array([0.01, 0.05, -0.02])
    radius = 0.3 - height
    place, found = face_coordinates(face, np.stack([radius * np.sin(angle), 0.3 - radius * np.cos(angle)], axis=1))
    np.testing.assert_allclose(place, 0.3 * angle, rtol=1e-12)
    np.testing.assert_allclose(found, height, atol=1e-15)


def test_a_guide_on_an_arm_is_seen_in_the_arm_s_frame():
    # the same chain and bar, both turned by 0.3 rad about the arm's pivot
    still = sliding(200)
    pivot, c, s = np.array([0.2, 0.1]), np.cos(0.3), np.sin(0.3)
    turn = np.array([[c, s], [-s, c]])  # rows from the right: counter-clockwise
    arm = {"name": "arm", "pivot": tuple(pivot), "mass": 0.2, "center": (0.3, 0.3), "inertia": 0.05,
           "stops": (-30.0, 30.0)}  # fmt: skip
    drive = still.drive.with_values({"arms": (arm,), "guides.bar.arm": "arm"})
    turned = Trajectory(
        drive, still.time, position=pivot + (still.position - pivot) @ turn, velocity=still.velocity @ turn,
        guide_force=still.guide_force, arm_angle=np.full((200, 1), 0.3),
    )  # fmt: skip
    (mine,), (theirs,) = recorded_guide_contacts(still), recorded_guide_contacts(turned)
    np.testing.assert_allclose(theirs.place, mine.place, atol=1e-12)
    np.testing.assert_allclose(theirs.speed, mine.speed, rtol=1e-12)


def test_a_drive_without_guides_has_no_loads():
    drive = two_sprockets()
    nothing = np.zeros((3, drive.chain.links))
    trajectory = Trajectory(drive, np.arange(3.0), position=np.zeros((*nothing.shape, 2)), guide_force=nothing)
    assert recorded_guide_contacts(trajectory) == [] and guide_loads(trajectory) == []


def test_a_chain_that_slides_around_a_curved_guide():
    # rollers ride at the offset over an arc of radius 0.4 from 30 to 90 degrees: a roller a pitch of the rollers' path,
    # (0.4 + offset) / 0.4 of the face's, so that p = P (0.4 + offset) / (0.4 pitch), v the face's share of theirs
    arc = {"name": "blade", "arcs": ({"center": (0.0, 0.0), "radius": 0.4, "from": 90.0, "to": 30.0},), "side": "left"}
    contact = {"restitution": 0.5, "impact_speed_floor": 0.02, "stiffness": 1e8}
    drive = two_sprockets().with_values({"contact.guide": contact, "guides": (arc,)})
    out, frames = 0.4 + single_chain(drive).guide_offset(0), 2000
    time = np.arange(frames) * (PITCH / SPEED) / 100.0
    way = np.mod(PITCH * (np.arange(60) + 0.005) + SPEED * time[:, None], 60 * PITCH)  # 3 m: 7.2 radians around
    angle = np.radians(90.0) + 0.5 - way / out
    position = out * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    velocity = SPEED * np.stack([np.sin(angle), -np.cos(angle)], axis=-1)
    on = (angle < np.radians(90.0)) & (angle > np.radians(30.0))
    trajectory = Trajectory(
        drive, time, position=position, velocity=velocity, guide_force=np.where(on, FORCE, 0.0),
        sprocket_force=np.zeros(on.shape),
    )  # fmt: skip
    (load,) = guide_loads(trajectory)
    inner = (load.place > 0.02) & (load.place < 0.4 * np.pi / 3 - 0.02)
    expected = FORCE * out / 0.4 / PITCH
    # stretches do not hold whole numbers of the hundredths of a pitch that rollers are seen at: one in 24
    np.testing.assert_allclose(load.mean[inner], expected, rtol=0.05)
    assert load.mean[inner].mean() == pytest.approx(expected, rel=0.005)
    np.testing.assert_allclose(load.speed[inner], SPEED, rtol=1e-12)
    width = load.place[1] - load.place[0]
    rollers = FORCE * on.sum() / frames
    assert load.mean.sum() * width == pytest.approx(rollers, rel=1e-9)  # none is lost
