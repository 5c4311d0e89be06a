"""Modes over speed: travelling strands, what excites a drive, where it meets the modes, and what is written of it."""

import numpy as np
import pytest
from command import refused, run
from drives import example, of_long, two_sprockets

from warpchain.assembly.frequencies import Order, excitation_orders
from warpchain.errors import SimulationError
from warpchain.modal.campbell import Campbell, campbell, modal_assurance, pitch_averaged_campbell
from warpchain.modal.eigenmodes import lowest_modes, modes
from warpchain.modal.mode_figures import mode_campbell_figure, mode_shapes_figure
from warpchain.modal.mode_page import modes_page
from warpchain.modal.mode_recording import write_mode_recording
from warpchain.modal.small_motion import drive_motion
from warpchain.model import single_chain


@pytest.fixture(scope="module")
def taut():
    """Two sprockets of 60 teeth, strands of 60 links at some 8 kN, over speeds up to a third of the wave's."""
    drive = two_sprockets(teeth=60, links=180, span=60.1, torque=0.0, inertia=200.0, stiffness=1e7)
    return campbell(drive, [0.0, 1.0, 2.0, 3.0, 4.0], 4)


def test_strands_of_a_running_chain_swing_as_travelling_strings(taut):
    """f_1 = (c^2 - v^2) / (2 L c), c^2 = T / m_l, T as it is at that speed, L from the seat left to the seat reached.

    Of sixty lumps the first mode is (pi/120)^2 / 6 = 0.01 % low; the ends give way on their seats by less than a link's
    share of the strand, 1 %.
    """
    drive = taut.drive
    assert np.isfinite(taut.frequency).all()
    for result, speed in zip(taut.modes, taut.speed, strict=True):
        v = speed * single_chain(drive).pitch_radius(0)
        tension = result.tension[50:70].mean()  # a link far from both sprockets
        c = np.sqrt(tension * drive.chain.pitch / drive.chain.mass)
        length = 60.1 * drive.chain.pitch
        strands = [k for k in range(4) if result.across[k] > 0.9][:2]
        assert len(strands) == 2
        assert result.frequency[strands] == pytest.approx((c * c - v * v) / (2.0 * length * c), rel=0.01)
    assert v > 0.2 * c


def test_orders_of_the_engine():
    """20 teeth drive 17, 40 and 40 by 132 links; order 2 of the crankshaft, order 4 of camshafts at half its speed."""
    found = excitation_orders(example("engine"))
    assert [order.value for order in found] == pytest.approx([20 / 132, 0.5, 1.0, 20 / 17, 2.0, 20.0, 40.0])
    assert "load of exhaust cam" in found[4].cause
    assert "motion of crankshaft" in found[4].cause


def test_unlike_links_excite_half_the_tooth_frequency():
    drive = two_sprockets(links=58, span=19.03)
    assert 10.0 not in [order.value for order in excitation_orders(drive)]
    worn = [{"link": i, "elongation": 0.01} for i in range(0, 58, 2)]
    unlike = drive.with_values({"chain.worn_links": worn})
    assert Order(10.0, "links of two kinds") in excitation_orders(unlike)


@pytest.mark.long
def test_means_over_a_pitch_lie_between_phases():
    """Roots of means of squares. Half a pitch later both strands of this drive are a link longer at one end and shorter
    at the other: a share of 1 / 19.5 of their length, and what that does to their tension, 1 % more."""
    drive = two_sprockets(span=20.03, torque=100.0, stiffness=2e7)
    found, phases = pitch_averaged_campbell(drive, [0.0, 2.0], 2, 2)
    assert phases.shape == (2, 2, 2)
    assert np.isfinite(phases).all()
    assert found.frequency == pytest.approx(np.sqrt((phases**2).mean(axis=0)))
    assert 0.0 < np.abs(phases[1] / phases[0] - 1.0).max() < 0.06
    alone = campbell(drive.with_values({"run.phase": 0.5}), [0.0, 2.0], 2)
    assert np.sort(phases[1], axis=1) == pytest.approx(np.sort(alone.frequency, axis=1), rel=1e-6)


def test_all_diagrams_tell_how_far_they_are():
    told = []
    campbell(two_sprockets(), [1.0, 2.0], 1, progress=lambda *of: told.append(of))
    pitch_averaged_campbell(two_sprockets(), [1.0, 2.0], 1, 1, progress=lambda *of: told.append(of))
    assert told == [("speeds", 1, 2), ("speeds", 2, 2), ("phases", 1, 1)]


def test_crossings_and_tongues_lie_where_lines_meet(taut):
    """Two modes that are straight lines, 10 + s and 30 - s Hz; order 2 pi is s Hz at a speed s [rad/s]."""
    speed = np.array([0.0, 8.0, 30.0])
    lines = np.stack([10.0 + speed / 2.0, 30.0 - speed], axis=1)
    ratio = np.tile([0.01, 0.02], (3, 1))
    found = Campbell(taut.drive, speed, ("a", "b"), lines, ratio, (Order(2.0 * np.pi, "tooth"),), ())
    first, second = found.crossings()
    assert (first.mode, first.speed, first.frequency) == ("b", pytest.approx(15.0), pytest.approx(15.0))
    assert (second.mode, second.speed, second.frequency) == ("a", pytest.approx(20.0), pytest.approx(20.0))
    assert second.damping_ratio == pytest.approx(0.01)
    rate = 60.0 / (2.0 * np.pi)  # tooth frequency over speed
    near, far = found.tongues()
    assert near.mode, far.mode == ("a", "b")
    assert near.speed == pytest.approx(20.0 / (rate - 1.0))
    assert far.speed == pytest.approx(60.0 / (rate + 2.0))
    assert (near.threshold, far.threshold) == pytest.approx((0.04, 0.08))


def test_a_mode_is_alike_to_itself_alone():
    """Modes of a drive at rest that hardly damps are orthogonal: but for damping, the assurance is the identity."""
    found = drive_motion(two_sprockets(links=58, span=19.03, damping=0.0, restitution=1.0, gravity=-3.0))
    result = lowest_modes(found, 8)
    assert np.allclose(modal_assurance(result, result, found), np.eye(8), atol=1e-3)


def test_speeds_must_ascend():
    with pytest.raises(SimulationError, match="ascending"):
        campbell(two_sprockets(), [3.0, 1.0])


def test_figures_page_and_recording(taut, tmp_path):
    result = taut.modes[0].first(3)
    assert len(result) == 3
    assert len(mode_shapes_figure(result).axes) == 3
    assert len(mode_campbell_figure(taut).axes) == 1
    text = modes_page(result, taut)
    assert text.count("<img ") == 2
    assert all(name.replace(">", "&gt;") in text for name in result.names)
    assert write_mode_recording(result, tmp_path / "modes.rrd").read_bytes()[:3] == b"RRF"


def test_the_command_prints_the_table_and_writes_arrays(tmp_path, capsys):
    target = tmp_path / "modes.npz"
    status, said, _ = run(capsys, "modes", "industrial", "--count", "3", "-o", target)
    assert status == 0
    for words in ("motor->conveyor 1", "floor of their impact speed", "friction of joints, teeth and guides"):
        assert any(words in line for line in said)
    stored = np.load(target)
    assert stored["shape"].shape == (3, 118, 2)
    assert np.allclose(stored["frequency"], modes(example("industrial"), 3).frequency, rtol=1e-6)


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["--speed", "1", "2", "3"], "must be one or two speeds"),
        (["--speed", "3", "1"], "--speed 3 1: must be one or two speeds of at least 0, the second above the first"),
        (["-o", "modes.pdf"], "must end in .html"),
        (["--phases", "4"], "takes a diagram over two speeds"),
        *of_long((["--set", "sprockets.conveyor.load.torque=1e7"], "does not settle")),
    ],
)
def test_mistakes_are_said_in_one_line(words, line, capsys):
    assert line in refused(capsys, "modes", "industrial", *words)


def test_phases_points_and_speeds_beyond_all_bounds_are_one_line(capsys):
    diagram = "modes", "conveyor", "--speed", "0", "10"
    assert "--phases 1000000000: must be 1 to 1000" in refused(capsys, *diagram, "--phases", "1000000000")
    assert "--points 1000000000: must be 1 to 10000" in refused(capsys, *diagram, "--points", "1000000000")
    said = refused(capsys, "modes", "conveyor", "--speed", "1e308")
    assert "--speed 1e+308: must be within 1e+30 rad/s of 0" in said
    with pytest.raises(SimulationError, match="phases = 1001: must be a whole number from 1 to 1000"):
        pitch_averaged_campbell(two_sprockets(), [1.0, 2.0], 2, 1001)
