"""Hub forces, probes, tooth jump and wear of joints against rollers that are put where the answer is known."""

import numpy as np
import pytest
from drives import errors_of, marine_values, put, two_sprockets

from warpchain import Trajectory, dumps_drive, loads_drive
from warpchain.assembly.tooth_hold import top_radius
from warpchain.drive import Drive
from warpchain.errors import SimulationError
from warpchain.model import single_chain
from warpchain.results.engineering_report import EngineeringReport
from warpchain.results.joint_wear import elongation_rate, joint_wear
from warpchain.results.losses import friction_power, joint_turn_rates
from warpchain.results.shaft_signals import hub_forces
from warpchain.results.signals import probe_signals
from warpchain.results.tooth_jump import tooth_jump_margin
from warpchain.results.window_statistics import histogram_share_below

UNIQUE = "must be unique among the names of all parts"


def in_seats(drive, lift=0.0, s=0, force=0.0, turn=0.0):
    """One frame with a roller `lift` [m] above each seat of a sprocket that is turned by `turn`, pressed by `force`."""
    teeth, count = drive.sprockets[s].teeth, drive.chain.links
    angle = turn + 2.0 * np.pi * np.arange(teeth) / teeth
    place = (single_chain(drive).pitch_radius(s) + lift) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    centers = np.array([sprocket.center for sprocket in drive.sprockets])[None]
    position = np.full((1, count, 2), 1e3)
    position[0, :teeth] = place + centers[0, s]
    pressed = np.zeros((1, count))
    pressed[0, :teeth] = force
    turned = np.zeros((1, len(drive.sprockets)))
    turned[0, s] = turn
    return Trajectory(
        drive, np.zeros(1), position=position, sprocket_force=pressed, sprocket_angle=turned, sprocket_center=centers
    )


def test_rollers_pressed_into_their_seats_push_the_hub_inward():
    drive = two_sprockets()
    trajectory = in_seats(drive, lift=-5e-5, turn=0.3)
    trajectory.sprocket_force[0, 4] = 700.0
    angle = 0.3 + 2.0 * np.pi * 4 / 20
    found = hub_forces(trajectory)
    assert found.shape == (1, 2, 2)
    np.testing.assert_allclose(found[0, 0], -700.0 * np.array([np.cos(angle), np.sin(angle)]), atol=1e-9)
    assert not found[0, 1].any()
    np.testing.assert_allclose(hub_forces(in_seats(drive, -5e-5, 1, 100.0))[0, 1], 0.0, atol=1e-9)  # all around


def test_margin_to_tooth_jump():
    # no clearance and straight flanks at 50 degrees from the radius: the roller leaves them where its center is R_r
    # from the tip along their normal; lifted by h above its seat it has h less to climb
    drive = two_sprockets(clearance=1e-9, seat_angle=100.0)
    r, half = single_chain(drive).pitch_radius(0), np.radians(50.0)
    along = np.array([np.sin(half), np.cos(half)])
    start = np.array([r, 0.0]) + 0.015 * np.array([-np.cos(half), np.sin(half)])
    b, c = start @ along, start @ start - single_chain(drive).tip_radius(0) ** 2
    length = -b + np.sqrt(b * b - c)  # |start + length along| = tip radius
    assert np.arctan2(*(start + length * along)[::-1]) < np.pi / 20  # before the middle of the tooth: not pointed
    top = np.hypot(*([r, 0.0] + length * along))  # offset by R_r, the flank passes through the seat's center
    assert top_radius(single_chain(drive), 0) == pytest.approx(
        top, abs=2e-9
    )  # the clearance, and the outline's bisection
    for lift in (0.0, 1e-3, top - r):
        found = tooth_jump_margin(in_seats(drive, lift), 0)
        assert found.height == pytest.approx(top - r, abs=1e-9)
        assert found.margin[0] == pytest.approx(top - r - lift, abs=1e-9)


def test_the_roller_that_is_nearest_to_jumping_is_told():
    drive = two_sprockets()
    trajectory = in_seats(drive)
    place = trajectory.position[0, 10]  # half around: in the middle of the driver's wrap
    trajectory.position[0, 10] = place * (1.0 + 2e-3 / np.hypot(*place))
    found = tooth_jump_margin(trajectory, 0)
    assert found.margin[0] == pytest.approx(found.height - 2e-3, abs=1e-12)
    assert found.angle[0] == pytest.approx(np.pi / 2, abs=1e-3)
    trajectory.position[0, :] = 1e3
    assert np.isnan(tooth_jump_margin(trajectory, 0).margin[0])


def test_curved_flanks_lean_back_from_the_seat_to_the_tip():
    own = {"profile": "iso606", "gap": "minimum", "clearance": None, "seat_angle": None}
    drive = two_sprockets().with_values({f"contact.sprocket.{key}": value for key, value in own.items()})
    tooth, r = single_chain(drive).tooth(0), single_chain(drive).pitch_radius(0)
    half = 0.5 * tooth.seat_angle
    # the flank is an arc about the point that is seat and flank radius from the seat's center along the arc's end
    center = np.array([r, 0.0]) + (tooth.seat_radius + tooth.flank_radius) * np.array([-np.cos(half), np.sin(half)])
    top = top_radius(single_chain(drive), 0)
    turn = np.linspace(-0.5, 0.5, 200001)
    roller = center + (tooth.flank_radius + 0.015) * np.stack([np.cos(half + turn), -np.sin(half + turn)], axis=1)
    tip = center + tooth.flank_radius * np.stack([np.cos(half + turn), -np.sin(half + turn)], axis=1)
    at = np.abs(np.hypot(*tip.T) - tooth.tip_radius).argmin()
    assert top == pytest.approx(np.hypot(*roller[at]), abs=2e-7)  # steps of 5e-6 rad on an arc of 40 mm


def passing_chain():
    """A straight chain of 60 rollers a pitch apart that runs at (3, 4) m/s past (1, 1), 2 mm to the left of it."""
    drive = two_sprockets()
    time = np.arange(200) * 1e-4
    t, n = np.array([0.6, 0.8]), np.array([-0.8, 0.6])
    place = 0.05 * np.arange(60) - 1.5001 + 5.0 * time[:, None]
    position = np.array([1.0, 1.0]) + 2e-3 * n + place[..., None] * t
    position[:, [0, -1]] += 10.0 * n  # the link that closes the loop is elsewhere
    velocity = np.broadcast_to([3.0, 4.0], position.shape)
    tension = np.broadcast_to(100.0 * np.arange(60), place.shape)
    return Trajectory(drive, time, position=position, velocity=velocity, tension=tension), place


def test_a_probe_sees_the_link_that_passes():
    trajectory, place = passing_chain()
    seen = probe_signals(trajectory, (1.0, 1.0), 0.05)
    link = (place <= 0.0).sum(axis=1) - 1
    np.testing.assert_array_equal(seen.link, link)
    np.testing.assert_array_equal(seen.tension, 100.0 * link)
    np.testing.assert_allclose(seen.speed, 5.0, rtol=1e-12)
    np.testing.assert_allclose(seen.normal_speed, 0.0, atol=1e-12)
    np.testing.assert_allclose(seen.displacement, 2e-3, atol=1e-12)


def test_a_probe_sees_nothing_beyond_its_radius():
    trajectory, _ = passing_chain()
    seen = probe_signals(trajectory, (1.0, 1.0), 1.9e-3)
    assert (seen.link == -1).all() and np.isnan(seen.tension).all()


def folding(rate=8.0, frames=101):
    """Four links of a rhombus that folds at `rate`, each link under 500 N: every joint turns at twice that."""
    drive = two_sprockets().with_values({"chain.joint": {"friction": 0.1, "pin_radius": 0.004, "factor": 1.25}})
    time = np.linspace(0.0, 0.05, frames)
    a, p = 0.9 + rate * time, 0.05
    corner = p * np.stack([np.cos(a), np.sin(a)], axis=-1)
    other = p * np.stack([np.cos(a), -np.sin(a)], axis=-1)
    zero = np.zeros_like(corner)
    position = np.stack([zero, corner, corner + other, other], axis=1)
    va = rate * p * np.stack([-np.sin(a), np.cos(a)], axis=-1)
    vb = rate * p * np.stack([-np.sin(a), -np.cos(a)], axis=-1)
    velocity = np.stack([zero, va, va + vb, vb], axis=1)
    return Trajectory(drive, time, position=position, velocity=velocity, tension=np.full((frames, 4), -500.0))


def test_joints_of_a_rhombus_that_folds():
    trajectory = folding()
    np.testing.assert_allclose(np.abs(joint_turn_rates(trajectory)), 16.0, rtol=1e-9)
    # 4 joints of mu kappa r_p T |g|
    np.testing.assert_allclose(friction_power(trajectory)["joints"], 4 * 0.1 * 1.25 * 0.004 * 500.0 * 16.0, rtol=1e-9)
    wear = joint_wear(trajectory)
    slid = 0.004 * 16.0 * 0.05  # r_p times the angle that each joint turns by in 0.05 s
    np.testing.assert_allclose(wear.distance, slid, rtol=1e-9)
    np.testing.assert_allclose(wear.loaded, slid * 500.0, rtol=1e-9)
    np.testing.assert_allclose(wear.work, 0.125 * slid * 500.0, rtol=1e-9)
    # depth k L / A each joint, of a pitch each
    rate = elongation_rate(single_chain(trajectory.drive), wear, 2e-16, 5e-5)
    assert rate == pytest.approx(2e-16 * slid * 500.0 / 5e-5 / 0.05 / 0.05, rel=1e-9)


def test_bearing_area_of_a_size():
    # 08B: ISO 606 has d2 = 4.45 mm and b2 = 11.30 mm, 50 mm^2; within the 3 % of b2 / b1
    drive = two_sprockets().with_values({"chain.size": "08B", "chain.stiffness": 5e7})
    assert drive.chain.joint_area == pytest.approx(4.45e-3 * 11.30e-3, rel=0.03)
    assert two_sprockets().chain.joint_area is None
    assert joint_wear(Trajectory(two_sprockets(), np.zeros(2), position=np.zeros((2, 4, 2)),
                                 tension=np.zeros((2, 4)))) is None  # fmt: skip


def test_hub_forces_need_their_channels():
    with pytest.raises(SimulationError, match="recorded without"):
        _ = EngineeringReport(folding()).hub_forces


def test_share_below_is_the_inverse_of_the_quantile():
    edges = np.array([[-4.0, -2.0, 0.0, 2.0, 4.0]])
    counts = np.array([[2, 6, 12, 4]])
    assert histogram_share_below(counts, edges, [-3.0], [5.0], 0.0) == pytest.approx(8 / 24)
    assert histogram_share_below(counts, edges, [-3.0], [5.0], 1.0) == pytest.approx(14 / 24)  # half of the third bin
    assert histogram_share_below(counts, edges, [-3.0], [5.0], -9.0) == 0.0
    assert histogram_share_below(counts, edges, [-3.0], [5.0], 9.0) == 1.0
    assert histogram_share_below(counts, edges, [-3.0], [5.0], -2.5) == pytest.approx(1 / 24)  # from the least value on
    assert np.isnan(histogram_share_below(0 * counts, edges, [-3.0], [5.0], 0.0))


def test_probes_in_a_drive_file():
    probes = [{"name": "mid", "at": [1.0, 2.0]}, {"name": "low", "at": [1.0, 0.0], "radius": 0.2}]
    drive = Drive(**marine_values() | {"probes": probes})
    assert [probe.radius for probe in drive.probes] == [None, 0.2]
    assert loads_drive(dumps_drive(drive)) == drive
    assert drive.with_values({"probes.low.at": [0.5, 0.0]}).probes[1].at == (0.5, 0.0)


@pytest.mark.parametrize(
    ("path", "value", "line"),
    [
        ("probes/0/radius", 0.0, "probes.mid.radius = 0.0: must be a positive number"),
        ("probes/0/name", "camshaft", 'probes.camshaft.name = "camshaft": ' + UNIQUE),
        ("probes/1/name", "mid", 'probes.1.name = "mid": ' + UNIQUE),
        ("probes/0/at", [1.0], "probes.mid.at = [1.0]: must be two finite numbers [x, y]"),
        ("probes/0/at", [1e5, 0.0], "probes.mid.at = [100000.0, 0.0]: must be within 10000 m of the origin"),
        ("probes/0/at", None, "probes.mid.at: missing; must be two finite numbers [x, y]"),
        ("probes/0/places", 1, "probes.mid.places = 1: unknown key; allowed are name, at, radius, chain"),
    ],
)
def test_wrong_probes(path, value, line):
    values = marine_values()
    values["probes"] = [{"name": "mid", "at": [1.0, 2.0]}, {"name": "low", "at": [1.0, 0.0]}]
    put(values, path, value)
    assert errors_of(values) == (line,)
