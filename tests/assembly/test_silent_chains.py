"""Silent chains against closed forms: forces along an arc, polygon action, strings, centrifugal tension, best speed.

A held wheel's teeth press each link with one flank, whose normal is at the angle a to the link. Its force F acts along
a line that crosses the line of the pins s pitches behind the pin nearer to the tight strand; a flank's point at the
depth d has s = (d - f sin a) / (p sin a cos a). The two pins' forces and F meet in one point. Where the pins' forces
fall by the same ratio from link to link they are inclined to the links by b, and with A = 2 pi / z

    s tan a tan b = (s tan a - tan a + tan b) tan(b - A),     T_{k+1} / T_k = sin(phi) / sin(phi + A),  phi = a - b, (a)

so that phi is a - A, half a tooth's angle, for s = 0, and a for s = 1; toes reach from s = 0.03 to 0.72.
"""

import math

import numpy as np
import pytest
from drives import STARTING
from scipy.optimize import brentq
from silent_chains import silent_drive

from warpchain import Record, loads_drive, simulate
from warpchain.assembly import assemble
from warpchain.assembly.statics import at_work, equilibrium
from warpchain.assembly.summary import derived_quantities
from warpchain.assembly.toe_energy import Wheel
from warpchain.modal.campbell import campbell
from warpchain.model import single_chain

FLANK = math.radians(30.0)
PULLED = {"chain.elongation": -1e-3, "chain.stiffness": 5e7}
"""Values of a chain that is pulled at both ends of its arcs."""


def forces_on_links(drive):
    """Tensions (N,) [N] at rest, and forces (N, 2, 2) [N] of the driver's teeth on links: toe of the first pin and of
    the second, tip and beginning."""
    model = single_chain(drive)
    (potential,), (x,) = equilibrium([model], [0.0], [assemble(drive)])
    pins, centers, angles = potential.parts_of_coordinates(x)
    wheel = Wheel(model, 0, 0.5 * model.sprocket_stiffness(0), 1.0)
    near, count = wheel.near_pins(pins - centers[0]), len(pins)
    found = np.zeros((count, 2, 2))
    for number in range(4):
        far = (near + (1 if number < 2 else -1)) % count
        wheel_at = np.tile([*centers[0], angles[0]], (len(near), 1))
        slope = wheel.energy(np.concatenate([pins[near], pins[far], wheel_at], axis=1), number)[1]
        found[near if number < 2 else far, number // 2, number % 2] = np.hypot(*slope[:, 4:6].T)
    return potential.tensions(x), found


def arc_drive(teeth, depths, **values):
    """Two equal wheels and a hard chain, toes between two depths [pitches]."""
    drive = silent_drive(teeth=teeth, links=3 * teeth, span=teeth, stiffness=5e9, **values)
    return drive.with_values({"chain.toe_depths": [depth * drive.chain.pitch for depth in depths]})


def pressure_angle(depth, teeth):
    """phi of (a) [rad] where a flank is pressed at a depth [pitches]."""
    turn, tangent = math.tau / teeth, math.tan(FLANK)
    s = (depth - 0.375 * math.sin(FLANK)) / (math.sin(FLANK) * math.cos(FLANK))

    def unbalance(b):
        return s * tangent * math.tan(b) - (s * tangent - tangent + math.tan(b)) * math.tan(b - turn)

    return FLANK - brentq(unbalance, 0.2 * turn * (1.0 - s), turn)


def falls(depth, teeth):
    """Ratio of a link's tension to that of the link before, (a)."""
    phi = pressure_angle(depth, teeth)
    return math.sin(phi) / math.sin(phi + math.tau / teeth)


def test_pressure_angle_at_its_ends():
    """Half a tooth's angle where the force's line meets the near pin, the flank's where it meets the far one."""
    foot, far = 0.375 * math.sin(FLANK), 0.375 * math.sin(FLANK) + math.sin(FLANK) * math.cos(FLANK)
    assert pressure_angle(foot, 30) == pytest.approx(FLANK - math.tau / 30)
    assert pressure_angle(0.9999 * far + 0.0001 * foot, 30) == pytest.approx(FLANK, abs=1e-3)


@pytest.mark.parametrize(("teeth", "links"), [(30, (11, 12)), (40, (14, 15, 16, 17))])
def test_tension_falls_fastest_where_flanks_begin(teeth, links):
    """Far from the tight strand only the flank's beginning bears; between, falls lie between those of its two ends.

    By links of 5e9 N/m: 6 kN lengthen them by 2e-5, contacts move a link by 1e-5 m, 2e-4 pitches: 3e-4.
    """
    tension, force = forces_on_links(arc_drive(teeth, (0.2, 0.5)))
    ratio = tension[1:] / tension[:-1]
    fastest, slowest = falls(0.2, teeth), falls(0.5, teeth)
    for k in links:
        assert force[k, 0, 0] == force[k, 1].sum() == 0.0 < force[k, 0, 1]
        assert ratio[k] == pytest.approx(fastest, abs=3e-4)
    both = [k for k in range(2, teeth // 2) if (force[k : k + 2, 0] > 0.0).all() and not force[k : k + 2, 1].any()]
    assert len(both) >= 5
    assert ((ratio[both] > fastest) & (ratio[both] < slowest)).all()


def test_short_flanks_set_the_fall_alone():
    """Between 0.25 and 0.26 pitches deep, wherever the force is on them, beyond the first links, which the strand's
    direction still inclines, and before the last, of a thousandth of the tension."""
    tension, force = forces_on_links(arc_drive(40, (0.25, 0.26)))
    ratio = (tension[1:] / tension[:-1])[5:15]
    assert (force[5:15, 0].sum(axis=1) > 0.0).all() and not force[5:15, 1].any()
    assert ((ratio > falls(0.25, 40)) & (ratio < falls(0.26, 40))).all()


def test_a_chain_pulled_at_both_ends_presses_both_flanks():
    """Each with F = T tan(pi / z) / sin a in the middle of the arc, as the pins' pull 2 T sin(pi / z) has it.

    There the tension stays, whatever moment the wheel takes near the arc's ends. What these add decays from link to
    link, to 3e-5 five links on.
    """
    for torque in (0.0, 50.0):
        tension, force = forces_on_links(arc_drive(30, (0.2, 0.5), torque=torque).with_values(PULLED))
        middle = slice(5, 10)
        expected = tension[middle, None] * math.tan(math.pi / 30) / math.sin(FLANK)
        assert force[middle].sum(axis=2) == pytest.approx(np.repeat(expected, 2, axis=1), rel=1e-4)
        assert np.ptp(tension[middle]) < 1e-3 * tension[7]


def four_bar_errors(teeth, span, angles):
    """Angle of a driven wheel behind its equal driver's: polygons of unit sides, `span` apart, a stiff taut strand.

    The strand is the upper common tangent; between its switches pins, wheels and strand are a four-bar linkage.
    """
    step, number = math.tau / teeth, np.arange(-3, 4)
    radius, off = 0.5 / math.sin(0.5 * step), span % 1.0

    def excess(other, angle):
        first = radius * np.exp(1j * (math.pi / 2 + angle + number * step))
        second = span + radius * np.exp(1j * (math.pi / 2 + other + (number + off) * step))
        for a in range(len(number)):
            for b in range(len(number)):
                strand = second[b] - first[a]
                corners = np.concatenate([first, second]) - first[a]
                if (np.imag(corners * np.conj(strand)) < 1e-12).all():
                    return abs(strand) - (span + number[a] - number[b] - off)
        raise AssertionError("no tangent")

    return np.array([brentq(excess, t - 0.45 * step, t + 0.45 * step, args=(t,)) - t for t in angles])


def wheel_angles(span, teeth=18):
    """Angles (F, 2) of two equal wheels of a stiff silent chain, the second half of four teeth."""
    speed, stiffness, pitch_angle = 0.4, 5e8, math.tau / teeth
    drive = silent_drive(
        teeth=teeth, links=round(2 * span) + teeth, span=span * (1 + 1e-5), stiffness=stiffness, contact=4 * stiffness,
        damping=1.2e-4 * stiffness, torque=400.0, speed=speed, duration=4 * pitch_angle / speed, step=4e-6,
        restitution=1.0, load_ramp=pitch_angle / speed,
    )  # fmt: skip
    record = Record(rate=2000.0, channels=("sprocket_angle",))
    angle = simulate(drive, record=record, limits=STARTING)[0].sprocket_angle
    return angle[len(angle) // 2 :]


def angle_range(span):
    """Range of the angle between two wheels [rad], by `wheel_angles`."""
    return float(np.ptp(np.diff(wheel_angles(span))))


def exact_range(span, teeth=18):
    """Range of the angle between two wheels [rad], by `four_bar_errors`."""
    return float(np.ptp(four_bar_errors(teeth, span, np.linspace(0.0, math.tau / teeth, 60, endpoint=False))))


@pytest.mark.filterwarnings("ignore:chain.links")
@pytest.mark.parametrize("span", [7.5, 7.0])
def test_polygon_action_is_that_of_a_four_bar_linkage(span):
    """Strands of 7.5 pitches between wheels of 18 teeth: angles 1.33e-3 rad apart; of 7 pitches: none.

    As the chain rings, by up to 4e-5 rad at 5e8 N/m.
    """
    assert exact_range(span) == pytest.approx(1.3316e-3 if span == 7.5 else 0.0, abs=1e-6)
    angle = wheel_angles(span)
    found = angle[:, 1] - angle[:, 0]
    grid = np.linspace(0.0, math.tau / 18, 60, endpoint=False)
    exact = four_bar_errors(18, span, grid)

    def apart(shift):
        of = np.interp(angle[:, 0] + shift, grid, exact, period=math.tau / 18)
        return np.abs(found - found.mean() - of + of.mean()).max()

    assert min(map(apart, grid)) < 8e-5


def test_strands_swing_as_travelling_strings():
    """f_1 = (c^2 - v^2) / (2 L c), as of rollers: lumps, and ends that give way on their seats, 1 %."""
    drive = silent_drive(teeth=60, links=180, span=60.1, torque=0.0, inertia=200.0, stiffness=1e7)
    found = campbell(drive, [0.0, 4.0], 4)
    length = 60.1 * drive.chain.pitch
    for result, speed in zip(found.modes, found.speed, strict=True):
        v = speed * single_chain(drive).pitch_radius(0)
        c = math.sqrt(result.tension[50:70].mean() * drive.chain.pitch / drive.chain.mass)
        strands = [k for k in range(4) if result.across[k] > 0.9][:2]
        assert result.frequency[strands] == pytest.approx((c * c - v * v) / (2.0 * length * c), rel=0.01)
    assert v > 0.2 * c


def test_wheels_bear_nothing_of_the_centrifugal_tension():
    """A slider of 4 kN keeps 2 kN on each strand beside m f^2 l, f links a second of the stretched length l.

    `check` has m v^2 / p of links that are not. The states of a pitch differ by 5e-6.
    """
    slider = {"kind": "slider", "direction": [1.0, 0.0], "stiffness": 0.0, "damping": 2000.0, "preload": 4000.0}
    values = {"sprockets.driven.mount": slider, "sprockets.driven.mass": 20.0}
    for speed in (1.0, 40.0, 80.0):
        drive = silent_drive(torque=0.0).with_values(values | {"sprockets.driver.prescribed.speed": speed})
        chain, steady = drive.chain, at_work(single_chain(drive))
        frequency = speed * 20 / math.tau
        assert steady.centrifugal == pytest.approx(chain.mass / chain.pitch * (frequency * chain.pitch) ** 2)
        length = chain.pitch + steady.tension / chain.stiffness
        assert steady.tension - chain.mass * frequency**2 * length == pytest.approx([2000.0, 2000.0], rel=1e-5)


def test_best_speed():
    """What an allowed tension leaves for the load, times v, is largest where m_l v^2 is a third of it: 2 T v / 3."""
    text = """
chain = {{ size = "SC304" }}
sprockets = [
    {{ name = "driver", teeth = 23, center = [0.0, 0.0], prescribed = {{ speed = {speed} }} }},
    {{ name = "driven", teeth = 23, center = [0.22395, 0.0], inertia = 1e-3 }},
]
"""
    allowed = 20.9e3 / 8.0
    mass = single_chain(loads_drive(text.format(speed=1.0))).chain.mass_per_length
    best = math.sqrt(allowed / (3.0 * mass))

    def power(part):
        drive = loads_drive(text.format(speed=part * best * math.tau / (23 * 9.525e-3)))
        strand = derived_quantities(drive)["strands"][0]
        return (allowed - strand["centrifugal_tension"]) * part * best

    below, most, above = map(power, (0.99, 1.0, 1.01))
    assert most == pytest.approx(2.0 / 3.0 * allowed * best)
    assert below < most > above
