"""Arms and tensioners in modes: against closed forms of one arm, one mass behind oil, one strand that is pressed."""

import numpy as np
import pytest
from command import refused
from drives import example, of_long, two_sprockets
from tensioner_rig import oil_modulus

from warpchain.engine.force_probe import ForceProbe
from warpchain.errors import SimulationError
from warpchain.modal.campbell import base_drive_modes, campbell, mode_metrics
from warpchain.modal.eigenmodes import lowest_modes, modes
from warpchain.modal.mode_figures import carried_part_lines, mode_shapes_figure, mode_swing
from warpchain.modal.mode_page import modes_page
from warpchain.modal.mode_recording import write_mode_recording
from warpchain.modal.small_motion import drive_motion
from warpchain.modal.tensioner_modes import tensioner_elements
from warpchain.model import single_chain
from warpchain.model.oil import static_force, static_pressure

AREA = 0.25 * np.pi * 0.016**2
ARM = {
    "name": "lever",
    "pivot": [0.4, 0.5],
    "mass": 3.0,
    "center": [0.7, 0.4],
    "inertia": 2.0,
    "stiffness": 900.0,
    "free_angle": -4.0,
    "damping": 1.5,
}
SPRING = {
    "name": "pusher",
    "on": "lever",
    "at": [0.8, 0.45],
    "direction": [0.3, 1.0],
    "kind": "spring",
    "spring": {"stiffness": 6000.0, "preload": 120.0, "damping": 40.0},
}
OIL = {
    **SPRING,
    "kind": "hydraulic",
    "plunger": {"diameter": 0.016, "mass": 0.5, "gap": 5e-5, "length": 0.007},
    "chamber": {"volume": 1e-6},
    "valve": {"ball_radius": 0.003, "seat_diameter": 0.0014, "lift": 0.001, "stiffness": 75.0, "preload": 0.075},
    "oil": {"viscosity": 8e-5, "supply": 3e5},
}


def apart(tensioners, gravity=-9.81, **values):
    """Two sprockets, and an arm above them that no chain touches."""
    base = two_sprockets(links=58, span=19.03, gravity=gravity)
    return base.with_values({"arms": [{**ARM, **values}], "tensioners": tensioners})


def of(result, part):
    """Index of the mode in which a part has its largest share."""
    return int(np.argmax(result.participation[:, result.parts.index(part)]))


def levers(drive, angle):
    """Of the arm's tensioner at an angle: x' = h, x'' = -d . r, and m r . g of its weight, the second derivatives of
    extension and of height by the angle."""
    turn = np.exp(1j * angle)
    arm, tensioner = drive.arms[0], drive.tensioners[0]
    r, c = ((complex(*np.subtract(point, arm.pivot))) * turn for point in (tensioner.at, arm.center))
    d = complex(*tensioner.unit_direction)
    g = complex(*drive.run.gravity)
    return (d * r.conjugate()).imag, -(d * r.conjugate()).real, arm.mass * (c * g.conjugate()).real


def test_an_arm_on_its_springs():
    """A pendulum with springs: I omega^2 = k_t + k h^2 + F d . r + m r . g, with the damping c_t + c h^2.

    To 1e-6: steps of 1e-9 m against forces of 100 N.
    """
    drive = apart([SPRING])
    result = modes(drive, 8)
    k, angle = of(result, "lever"), result.placed[2, 2]
    assert abs(angle) > 0.01
    h, bent, weight = levers(drive, angle)
    spring = SPRING["spring"]
    r = np.subtract(SPRING["at"], ARM["pivot"]) @ [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]
    x = (r + ARM["pivot"] - SPRING["at"]) @ drive.tensioners[0].unit_direction
    force = spring["preload"] - spring["stiffness"] * x
    stiff = ARM["stiffness"] + spring["stiffness"] * h**2 - force * bent + weight
    drag = ARM["damping"] + spring["damping"] * h**2
    omega = np.sqrt(stiff / ARM["inertia"])
    assert 2 * np.pi * result.frequency[k] == pytest.approx(omega, rel=1e-6)
    assert result.damping_ratio[k] == pytest.approx(drag / (2 * ARM["inertia"] * omega), rel=1e-5)
    assert result.participation[k, result.parts.index("lever")] == pytest.approx(1.0, abs=1e-6)
    assert result.stored[k, 0] == pytest.approx(spring["stiffness"] * h**2 / stiff, rel=1e-5)
    assert result.lost[k, 0] == pytest.approx(spring["damping"] * h**2 / drag, rel=1e-5)
    assert np.abs(result.stroke[k, 0] / result.bodies[k, 2, 2]) == pytest.approx(h, rel=1e-6)


def cubic(drive, result):
    """Roots of a mass on a spring, with oil's stiffness k_o in series with its leakage c = A^2 / G:
    (I s^2 + C s + K)(c s + k_o) + h^2 k_o c (1 + d / A) s = 0. Here d / A = 2 h_gap / diameter = 0.6 % is the oil that
    the plunger drags."""
    tensioner, angle = drive.tensioners[0], result.placed[2, 2]
    h, bent, weight = levers(drive, angle)
    r = complex(*np.subtract(tensioner.at, ARM["pivot"]))
    x = (complex(*tensioner.unit_direction) * (r * (np.exp(1j * angle) - 1.0)).conjugate()).real
    oil = oil_modulus(tensioner, static_pressure(tensioner)) * AREA**2 / (1e-6 + AREA * x)
    gap = tensioner.area**2 / tensioner.leak_conductance
    spring = tensioner.spring_stiffness
    stiff = ARM["stiffness"] + spring * h**2 - static_force(tensioner, x) * bent + weight
    drag = ARM["damping"] + SPRING["spring"]["damping"] * h**2
    own = np.poly1d([single_chain(drive).arm_inertia(0), drag, stiff])
    dragged = 1.0 + tensioner.drag_flow / tensioner.area
    return (own * np.poly1d([gap, oil]) + np.poly1d([h**2 * oil * gap * dragged, 0.0])).roots


@pytest.mark.parametrize("viscosity", [1e-6, 8e-6, 4e-5, 2e-4, 3e-3])
def test_a_mass_behind_oil_that_leaks(viscosity):
    """K*(s) = k + k_o c s / (k_o + c s), a Maxwell element: the root locus over the leakage, from a damper's (thin oil;
    overdamped in between) to a spring's (thick).

    To 1e-4: the modulus by differences of forces. Real roots are among those that creep.
    """
    drive = apart([OIL]).with_values({"tensioners.pusher.oil.viscosity": viscosity})
    result = modes(drive, 80)
    for root in cubic(drive, result):
        if root.imag > 0.0:
            assert result.eigenvalue[of(result, "lever")] == pytest.approx(root, rel=1e-4)
        elif root.imag == 0.0:
            nearest = result.creeping[np.argmin(np.abs(result.creeping + root))]
            assert nearest == pytest.approx(-root.real, rel=1e-4)


def test_oil_shows_in_the_table():
    """Thick oil is a spring that holds nearly all; its pressure is -(E A / V) x c s / (c s + k_o). The plunger has its
    own share, m h^2 of I. 1 %: the oil that the plunger drags along, 0.6 %."""
    drive = apart([OIL]).with_values({"tensioners.pusher.oil.viscosity": 2e-4})
    found = drive_motion(drive)
    result, (part,) = lowest_modes(found, 80), found.parts
    k = of(result, "lever")
    tensioner, pressure = drive.tensioners[0], static_pressure(drive.tensioners[0])
    volume = 1e-6 + AREA * found.parts[0].extension[0]
    modulus, gap = oil_modulus(tensioner, pressure), AREA**2 / tensioner.leak_conductance
    late = gap * result.eigenvalue[k] / (gap * result.eigenvalue[k] + modulus * AREA**2 / volume)
    expected = -modulus * AREA / volume * late * result.stroke[k, 0]
    assert abs(result.pressure[k, 0] - expected) < 0.01 * abs(expected)
    assert result.stored[k, 0] > 0.95
    assert result.lost[k, 0] > 0.5
    share = result.participation[k, result.parts.index("pusher")]
    assert share == pytest.approx(
        0.5 * single_chain(drive).tensioner_lever(0) ** 2 / single_chain(drive).arm_inertia(0), rel=1e-6
    )
    assert tensioner_elements(part).force[0] == pytest.approx(static_force(tensioner, part.extension[0]), rel=1e-9)
    assert "check valve shut" in result.standing[1]


def test_a_slack_tensioner_takes_no_part():
    drive = apart([{**SPRING, "spring": {"stiffness": 6000.0, "preload": 1.0}}], gravity=0.0, free_angle=4.0)
    result = modes(drive, 8)
    k = of(result, "lever")
    assert 2 * np.pi * result.frequency[k] == pytest.approx(np.sqrt(900.0 / 2.0), rel=1e-6)
    assert result.stored[k, 0] == 0.0
    assert "too far to push" in result.standing[1]


def test_an_arm_on_its_stop():
    """The stop's stiffness stands beside the spring's; the line below the table says so."""
    drive = apart([], gravity=0.0, free_angle=30.0, stops=[-5.0, 5.0])
    result = modes(drive, 60)
    k = of(result, "lever")
    stiff = ARM["stiffness"] + single_chain(drive).stop_stiffness(0)
    assert 2 * np.pi * result.frequency[k] == pytest.approx(np.sqrt(stiff / 2.0), rel=1e-3)
    assert "on its upper stop" in result.standing[0]


def test_a_sprocket_on_a_slider_with_a_tensioner():
    """Of a heavy sprocket, M omega^2 rises by k when the tensioner that pushes it gets the stiffness k and pushes as
    much as before: the chain's inertia, 60 of 20,000 kg, and its own modes, ten times as high, are 0.3 % and 1 %."""
    mount = {"kind": "slider", "direction": [1.0, 0.0], "stiffness": 0.0, "damping": 0.0}
    push = {"name": "pusher", "on": "driven", "at": [1.1, 0.0], "direction": [1.0, 0.0], "kind": "spring"}
    base = two_sprockets(links=60, span=20.03, torque=0.0).with_values(
        {"sprockets.driven.mass": 20000.0, "sprockets.driven.mount": mount}
    )

    def pushed(stiffness, preload):
        spring = {"stiffness": stiffness, "preload": preload}
        return base.with_values({"tensioners": [{**push, "spring": spring}]})

    found = drive_motion(pushed(0.0, 9000.0))
    x = found.parts[0].extension[0]
    soft = lowest_modes(found, 12)
    stiff = modes(pushed(4e6, 9000.0 + 4e6 * x), 12)
    square = [(2 * np.pi * m.frequency[of(m, "driven.mount")]) ** 2 for m in (soft, stiff)]
    assert square[1] - square[0] == pytest.approx(4e6 / 20000.0, rel=0.01)


def pressed(push):
    """Two sprockets of 60 teeth, an arm pressed from below on the lower strand's middle, its pivot level with it."""
    base = two_sprockets(teeth=60, links=180, span=60.1, torque=0.0, inertia=200.0, stiffness=1e7)
    level, radius = -single_chain(base).pitch_radius(0), 4.0
    middle = 0.5 * 60.1 * 0.05
    return base.with_values(
        {
            "guides": [
                {
                    "name": "shoe",
                    "arcs": [{"center": [middle, level - 0.015 - radius], "radius": radius, "from": 92.0, "to": 88.0}],
                    "arm": "lever",
                }
            ],
            "arms": [
                {"name": "lever", "pivot": [middle - 0.6, level], "mass": 1.0, "center": [middle, level],
                 "inertia": 700.0}
            ],
            "tensioners": [
                {**SPRING, "at": [middle, level], "direction": [0.0, 1.0],
                 "spring": {"stiffness": 200.0, "preload": push, "damping": 0.0}}
            ],
            "contact.guide": {"restitution": 1.0, "impact_speed_floor": 0.02, "stiffness": 1e7},
        }
    )  # fmt: skip


def test_an_arm_pressed_on_a_strand():
    """I omega^2 = k h^2 + T sum (dy)^2 / p over the strand's links, rollers that touch moving with the arm by their
    levers, others on straight lines to the sprockets; chain of a triangle's inertia, m_l L / 3 at its top.

    1 %: the strand's ends give way on their seats by less than a link, and its sag is 0.4 % of its length.
    """
    drive = pressed(8.0)
    found = drive_motion(drive)
    result = lowest_modes(found, 4)
    k = of(result, "lever")
    probe = ForceProbe(found.parts[0].packed)
    on = np.flatnonzero(probe.touching_rollers(found.parts[0].state)[2])
    probe.close()
    assert 1 <= len(on) <= 4
    place = result.position[on]
    ends = 0.0, 60.1 * drive.chain.pitch
    order = np.argsort(place[:, 0])
    at = np.concatenate([[ends[0]], place[order, 0], [ends[1]]])
    lever = np.concatenate([[0.0], place[order, 0] - drive.arms[0].pivot[0], [0.0]])
    tension = result.tension[on[0]]
    strand = tension * (np.diff(lever) ** 2 / np.diff(at)).sum()
    mass = drive.chain.mass / drive.chain.pitch * 60.1 * 0.05 / 3.0
    expected = np.sqrt((200.0 * 0.6**2 + strand) / (700.0 + mass * 0.6**2))
    assert strand > 200.0 * 0.6**2
    assert 2 * np.pi * result.frequency[k] == pytest.approx(expected, rel=0.01)


@pytest.fixture(scope="module")
def car():
    return example("car")


def test_pictures_page_and_arrays_have_arms(car, tmp_path):
    found = drive_motion(car)
    result = lowest_modes(found, 26)
    k = of(result, "arm")
    assert result.damping_ratio[k] > 0.05
    out, back = (carried_part_lines(single_chain(car), mode_swing(result, k, phase)[0][2]) for phase in (0.0, np.pi))
    assert len(out) == 5  # three lines of the arm, its blade, the plunger
    assert all(np.abs(one - other).max() > 1e-4 for one, other in zip(out, back, strict=True))
    one = result.select_modes(np.array([k]))
    assert len(mode_shapes_figure(one).axes) == 1
    assert "tensioner holds" in modes_page(one)
    assert write_mode_recording(one, tmp_path / "modes.rrd").read_bytes()[:3] == b"RRF"
    assert result.lost.min() > -1e-6 and result.lost.max() < 1.0 + 1e-6
    arrays = result.arrays()
    assert arrays["stroke"].shape == arrays["pressure"].shape == (26, 1)
    assert arrays["bodies"].shape == (26, 4, 3)


@pytest.mark.long
def test_a_campbell_diagram_and_metrics_follow_an_arm(car):
    """A heavier arm's mode is lower, by its share of the kinetic energy: d omega / omega = -share dI / 2 I."""
    wanted = base_drive_modes(car, 26)
    k = wanted.names.index("arm 1")
    mine = "modes.arm 1.frequency"
    heavier = car.with_values({"arms.arm.inertia": 1.1 * car.arms[0].inertia})
    ratio = mode_metrics(wanted, heavier)[mine] / mode_metrics(wanted, car)[mine]
    share = wanted.participation[k, wanted.parts.index("arm")]
    assert ratio == pytest.approx(1.0 - 0.05 * share, abs=0.01)
    found = campbell(car, [0.0, 60.0], 26)
    assert np.isfinite(found.frequency[:, k]).all()
    assert found.names[k] == "arm 1"


@pytest.mark.parametrize(
    ("words", "line"),
    [
        *of_long((["--set", "sprockets.intake cam.load.torque=1e5"], "does not settle")),
        (["--speed", "50000"], "--speed 50000"),
    ],
)
def test_mistakes_are_said_in_one_line(words, line, capsys):
    assert line in refused(capsys, "modes", "car", *words)


def test_an_arm_that_nothing_holds_is_told_apart():
    """No spring, no weight, no tensioner: a motion without restoring force, not a mode."""
    drive = apart([], gravity=0.0, stiffness=0.0, damping=0.0)
    rest = modes(drive.with_values({"arms": []}), 8)
    free = modes(drive, 8)
    assert free.zeros == rest.zeros + 1
    assert free.frequency == pytest.approx(rest.frequency, rel=1e-5)


def test_a_valve_is_shut_or_open(car, capsys):
    with pytest.raises(SimulationError, match="must be 'shut' or 'open'"):
        modes(car, valve="ajar")
    assert "takes one speed" in refused(capsys, "modes", "car", "--valve", "open", "--speed", "0", "100")


@pytest.mark.long
def test_what_does_not_settle_is_refused():
    with pytest.raises(SimulationError, match="does not settle") as caught:
        modes(apart([SPRING]).with_values({"sprockets.driven.load.torque": 1e6}))
    assert "\n" not in str(caught.value)
