"""An arm under a running chain: the mean moment on it, its energy, and where tensioners settle."""

import numpy as np
import pytest
from drives import timing

from warpchain import Record, simulate
from warpchain.model.oil import static_force

BARE = {"chain.joint": None, "contact.sprocket.friction": 0.0, "contact.guide.friction": 0.0}
LEFT = (0.012, 0.27)  # heights at which the slack strand passes below and above its blade [m]


def crossing(trajectory, height):
    """Where links cross a height on the left, their directions and tensions: (F, 2), (F, 2), (F,)."""
    x, n = trajectory.position, trajectory.position.shape[1]
    after = np.roll(x, -1, axis=1)
    passing = (x[..., 1] <= height) & (after[..., 1] > height) & (x[..., 0] < 0.0)
    frame, link = np.nonzero(passing)
    assert (frame == np.arange(len(x))).all()
    a, b = x[frame, link], x[frame, (link + 1) % n]
    share = ((height - a[:, 1]) / (b[:, 1] - a[:, 1]))[:, None]
    along = (b - a) / np.hypot(*(b - a).T)[:, None]
    assert trajectory.guide_force[frame, link].max() == trajectory.guide_force[frame, (link + 1) % n].max() == 0.0
    return a + share * (b - a), along, trajectory.tension[frame, link]


def lever(point, along, pivot):
    """Lever of a line about a pivot [m]."""
    r = point - pivot
    return r[0] * along[1] - r[1] * along[0]


def test_mean_moment_of_the_chain_on_an_arm(device):
    # model, section 14: frictionless it is (T - m v^2/p)(h_out - h_in) whatever the profile, T and the lines of the two
    # strands in the mean. What is left over of a run's window is what the arm gains in it and how the strands whip:
    # 3 % of the moment's own size
    drive = timing(**{"run.duration": 0.08, "arms.0.damping": 0.5}).with_values(BARE)
    run = simulate(drive, record=Record(rate=20_000.0), window=(0.04, 0.08))
    row, late = run.metrics.to_pylist()[0], run[0].time >= 0.04
    pivot = np.array(drive.arms[0].pivot)
    (before, into, pull_in), (after, out_of, pull_out) = (crossing(run[0], height) for height in LEFT)
    lines = [(point[late].mean(axis=0), along[late].mean(axis=0)) for point, along in ((before, into), (after, out_of))]
    h_in, h_out = (lever(point, along, pivot) for point, along in lines)
    speed = np.linalg.norm(run[0].velocity[late], axis=-1).mean()
    tension = 0.5 * (pull_in[late].mean() + pull_out[late].mean())
    flow = drive.chain.mass * speed**2 / drive.chain.pitch
    expected = (tension - flow) * (h_out - h_in)
    assert flow > 0.05 * tension  # the moving chain's part would be missed
    assert row["arm.moment_mean"] == pytest.approx(expected, rel=0.03)
    assert row["status"] == "ok", row["reason"]


def test_energy_of_a_drive_with_arm_and_oil(device):
    # all of it: chain, contacts, friction, arm, plunger, oil, gap, valve, supply: the balance closes as without arms
    row = simulate(timing(**{"run.duration": 0.03}), record=Record("none")).metrics.to_pylist()[0]
    assert abs(row["energy_residual_relative"]) < 2e-4
    assert row["tensioner.oil_loss"] > 0.0 and row["tensioner.supply_work"] > 0.0
    assert row["blade.friction"] > 0.0 and row["blade.missed"] == 0


def test_an_arm_settles_where_its_tensioner_and_the_chain_balance(device):
    # at rest and without weight the chain's moment is the tensioner's: F times its lever, to settling's residual
    still = {
        "run.gravity": [0.0, 0.0],
        "sprockets.0.prescribed.speed": 0.0,
        "sprockets.1.load": None,
        "sprockets.2.load": None,
    }
    drive = timing(**{"run.duration": 1e-4}).with_values(still | BARE)
    run = simulate(drive, record=Record(rate=50_000.0))
    first = run[0]
    angle, tensioner = float(first.arm_angle[0, 0]), drive.tensioners[0]
    pivot, direction = np.array(drive.arms[0].pivot), np.array(tensioner.unit_direction)
    arm = np.array(tensioner.at) - pivot
    c, s = np.cos(angle), np.sin(angle)
    point = pivot + np.array([c * arm[0] - s * arm[1], s * arm[0] + c * arm[1]])
    x = float((point - tensioner.at) @ direction)
    assert first.tensioner_extension[0, 0] == pytest.approx(x, rel=1e-9)
    assert first.tensioner_force[0, 0] == pytest.approx(static_force(tensioner, x), rel=1e-6)
    moment = lever(point, direction, pivot) * first.tensioner_force[0, 0]
    assert first.arm_moment[0, 0] == pytest.approx(-moment, rel=1e-2)
