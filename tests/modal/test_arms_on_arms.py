"""Steady states and modes of arms on arms: a double pendulum, two long levers beside springs, a blade of segments."""

import numpy as np
import pytest
from drives import jointed_blade, two_sprockets
from scipy.linalg import eigh

from warpchain import modes
from warpchain.assembly.statics import at_rest, at_work
from warpchain.drive import Drive
from warpchain.modal.small_motion import standing_chains
from warpchain.model import single_chain

G = 9.81


def with_arms(drive, arms, **of_driven):
    """A drive with such arms, and with values of its second sprocket."""
    values = drive.model_dump(exclude_none=True)
    first, second = values["sprockets"]
    return Drive(**values | {"sprockets": [first, second | of_driven], "arms": arms})


@pytest.mark.parametrize("stiffness", [0.0, 3.0])
def test_modes_of_a_double_pendulum(stiffness):
    """Beside a chain that it does not touch: M theta'' = -K theta in absolute angles; differences of forces over small
    steps have eight digits.
    """
    upper = {"name": "upper", "pivot": [0.5, 0.9], "mass": 0.6, "center": [0.5, 0.6], "inertia": 0.07}
    lower = {"name": "lower", "arm": "upper", "pivot": [0.5, 0.4], "mass": 0.5, "center": [0.5, 0.28], "inertia": 0.012}
    drive = two_sprockets().with_values({"run.gravity": [0.0, -G]})
    found = modes(with_arms(drive, [upper, lower | {"stiffness": stiffness}]), 60)
    c, own = 0.5 * 0.12 * 0.5, 0.07 + 0.5 * 0.5**2
    mass = [[own, c], [c, 0.012]]
    joint = stiffness * np.array([[1.0, -1.0], [-1.0, 1.0]])
    square = eigh(np.diag([(0.6 * 0.3 + 0.5 * 0.5) * G, 0.5 * 0.12 * G]) + joint, mass)[0]
    arms = [found.parts.index(name) for name in ("upper", "lower")]
    swings = found.participation[:, arms].sum(axis=1) > 0.99
    assert np.abs(found.eigenvalue[swings]) == pytest.approx(np.sqrt(square), rel=1e-6)


SPRINGS = {"kind": "elastic", "stiffness": [1e6, 3e6], "damping": [0.0, 0.0], "preload": [2e3, -500.0]}


def on_levers(drive, length, far):
    """The second sprocket on an arm that takes it along x, on a far longer one that takes this along y."""
    (x, y), (kx, ky), (fx, fy) = drive.sprockets[1].center, SPRINGS["stiffness"], SPRINGS["preload"]
    small = {"mass": 1e-3, "inertia": 1e-3}
    upper = {"name": "upper", "pivot": [x - far, y - length], "center": [x - far, y - length]} | small
    upper |= {"stiffness": ky * far**2, "free_angle": np.degrees(fy / ky / far)}
    lower = {"name": "lower", "arm": "upper", "pivot": [x, y - length], "center": [x, y - length]} | small
    lower |= {"stiffness": kx * length**2, "free_angle": np.degrees(-fx / kx / length)}
    return with_arms(drive, [upper, lower], mount={"kind": "arm", "arm": "lower"})


@pytest.mark.long
def test_two_long_levers_are_a_center_on_two_springs():
    """The spring of the short one feels the long one's turn, too: length / far of it; both fall to a third here."""
    drive = two_sprockets().with_values({"sprockets.driven.mass": 30.0})
    springs = drive.with_values({"sprockets.driven.mount": SPRINGS})
    wanted, shapes = (at_rest(single_chain(springs)), at_work(single_chain(springs))), modes(springs, 6)
    off, moved = [], []
    for length, far in ((1.0, 100.0), (3.0, 900.0)):
        levers = on_levers(drive, length, far)
        for one, other in zip((at_rest(single_chain(levers)), at_work(single_chain(levers))), wanted, strict=True):
            assert one.failure is None
            assert one.tension == pytest.approx(other.tension, rel=2e-3 / length)
        rest = at_rest(single_chain(levers))
        off.append(float(rest.tension[0] / wanted[0].tension[0] - 1.0))
        moved.append(float(np.abs(rest.center[1] - wanted[0].center[1]).max()))
        assert np.abs(modes(levers, 6).eigenvalue) == pytest.approx(np.abs(shapes.eigenvalue), rel=3e-4)
    assert off[0] / off[1] == pytest.approx(3.0, rel=0.05)
    assert moved[0] / moved[1] == pytest.approx(3.0, rel=0.05)


def segments():
    """A blade of two segments on the slack strand, without the rail on the other one."""
    values = jointed_blade()
    return Drive(**values | {"guides": values["guides"][:2]})


def test_a_state_nearby_is_found_from_another():
    """What stands at a speed stands there when it is sought from what stands at another speed."""
    drive = segments()
    ((_, _, slow, _),) = standing_chains(drive, 20.0)
    ((_, _, one, first),), ((_, _, two, second),) = standing_chains(drive, 40.0, [slow]), standing_chains(drive, 40.0)
    assert one.bodies["angle"] == pytest.approx(two.bodies["angle"], abs=1e-9)
    assert one.bodies["center"] == pytest.approx(two.bodies["center"], abs=1e-10)
    assert first == pytest.approx(second, rel=1e-6)
    assert np.abs(one.bodies["angle"] - slow.bodies["angle"]).max() > 1e-6


def test_modes_of_a_blade_of_segments_name_its_arms():
    found = modes(segments(), 12)
    assert {"upper", "lower"} <= set(found.parts)
    assert any(line.startswith("lower stands at") for line in found.standing)
    assert len(found.growing) == 0
    joint = found.bodies[:, -1, :2]  # moves with the upper arm
    lever = np.subtract([-0.042, 0.15], [-0.055, 0.25])
    c, s = np.cos(found.placed[-2, 2]), np.sin(found.placed[-2, 2])
    x, y = c * lever[0] - s * lever[1], s * lever[0] + c * lever[1]
    assert joint == pytest.approx(found.bodies[:, -2, 2, None] * np.array([-y, x]), abs=1e-12)
