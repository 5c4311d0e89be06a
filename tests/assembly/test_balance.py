"""Arms in balance at assembly, at rest and at work, and what `check` and `fit` tell of them, against closed forms."""

import math

import numpy as np
import pytest
from assemblies import differences, link_lengths
from drives import timing, two_sprockets
from scipy.optimize import brentq

from warpchain import assemble
from warpchain.assembly.arm_balance import RestingArm, _secant_root, chain_moment, chain_path
from warpchain.assembly.fitting import fit_angle, fit_links, fit_position
from warpchain.assembly.layout_checks import layout_faults
from warpchain.assembly.path import path_at
from warpchain.assembly.potential import Potential
from warpchain.assembly.statics import at_work
from warpchain.assembly.summary import derived_quantities, report
from warpchain.errors import DriveError
from warpchain.model import single_chain
from warpchain.model.oil import static_force

PITCH, TEETH = 0.05, 20
RADIUS = PITCH / (2.0 * math.sin(math.pi / TEETH))
FACE, TOP, ROLLER = 0.5, 0.24, 0.015
PIVOT = (0.2, 0.05)
GUIDE = {"restitution": 0.3, "stiffness": 1e8, "impact_speed_floor": 0.02}
BARE = {"chain.joint": None, "contact.sprocket.friction": 0.0, "contact.guide.friction": 0.0}


def blade(name="blade", up=1.0, **more):
    """A round face inside the upper (or lower) strand, as the chain of `two_sprockets` runs."""
    low, high = (65.0, 115.0) if up > 0.0 else (-115.0, -65.0)
    arc = {"center": [0.5, up * (TOP - FACE)], "radius": FACE, "from": low, "to": high}
    return {"name": name, "arcs": [arc], "side": "right", **more}


def lever(name="lever", up=1.0, **more):
    pivot, center = [PIVOT[0], up * PIVOT[1]], [0.4, up * 0.1]
    return {"name": name, "pivot": pivot, "mass": 3.0, "center": center, "inertia": 0.3, **more}


def armed(links=60, **more):
    """Two sprockets, their upper strand around a guide on an arm."""
    values = {"contact.guide": GUIDE, "guides": [blade(arm="lever")]}
    return two_sprockets(links=links).with_values({**values, "arms": [lever(**more)]})


def by_hand(angle):
    """Pitches of the path on sprockets and in strands, from triangles: the face's center, turned about the pivot, and
    the tangents of its circle and the sprockets'."""
    dx, dy = 0.5 - PIVOT[0], TOP - FACE - PIVOT[1]
    x = PIVOT[0] + math.cos(angle) * dx - math.sin(angle) * dy
    y = PIVOT[1] + math.sin(angle) * dx + math.cos(angle) * dy
    reach = FACE + ROLLER
    slopes, straight = [], 0.0
    for sx, side in ((1.0, -1.0), (0.0, 1.0)):  # the chain comes from the right
        distance, h = math.hypot(x - sx, y), reach - RADIUS
        straight += math.sqrt(distance**2 - h**2)
        # the tangent's rise towards the guide, seen from its sprocket
        slopes.append(math.atan2(y, side * (x - sx)) + math.asin(h / distance))
    wrap = slopes[0] + slopes[1]
    strands = 1.0 / PITCH + straight / PITCH + wrap / (2.0 * math.asin(PITCH / (2.0 * reach)))
    wrapped = (2.0 * math.pi - wrap) * TEETH / (2.0 * math.pi)
    return wrapped, strands


def own_length(angle):
    """Length of the taut loop [m]: straight parts and arcs of the circles R and R'."""
    wrapped, strands = by_hand(angle)
    wrap = 2.0 * math.pi * (1.0 - wrapped / TEETH)
    straight = PITCH * strands - wrap * PITCH / (2.0 * math.asin(PITCH / (2.0 * (FACE + ROLLER))))
    return straight + wrap * (FACE + ROLLER) + (2.0 * math.pi - wrap) * RADIUS


def test_an_arm_with_a_spring_stands_where_triangles_put_it():
    """k p e(theta) (h_out - h_in) = k_t (theta - theta_0), e from the path's length by hand, (h_out - h_in) as minus
    the derivative of the loop's; solved for theta. 1e-8 rad: central differences of the length."""
    drive = armed(links=60, stiffness=2000.0, free_angle=8.0, stops=[-20.0, 20.0])

    def balance(angle):
        (wrapped, strands), d = by_hand(angle), 1e-6
        pull = drive.chain.mean_stiffness * PITCH * max(strands / (60 - wrapped) - 1.0, 0.0)
        slope = (own_length(angle + d) - own_length(angle - d)) / (2 * d)
        return -pull * slope - 2000.0 * (angle - math.radians(8.0))

    found = brentq(balance, math.radians(-19.0), math.radians(19.0), xtol=1e-14)
    path = chain_path(single_chain(drive))
    assert path.nominal_strain > 1e-4
    assert float(path.arm_angle[0]) == pytest.approx(found, abs=1e-8)


def test_the_path_by_hand_is_the_path():
    drive = armed(stops=[-20.0, 20.0])
    for angle in (-0.1, 0.0, 0.05):
        path = path_at(single_chain(drive), [angle])
        wrapped, strands = by_hand(angle)
        assert path.wrapped_pitches == pytest.approx(wrapped, rel=1e-12)
        assert float(path.strand_length.sum()) == pytest.approx(PITCH * strands, rel=1e-12)


@pytest.mark.parametrize("gravity", [0.0, -9.81])
def test_under_a_slack_chain_spring_weight_and_tensioner_hold_an_arm(gravity):
    """T = 0: k_t (theta - theta_0) = m (r_c - p) x g + l F, theta_0 taken for theta = 0.06; to the search's 1e-10."""
    angle, stiffness = 0.06, 400.0
    tensioner = {
        "name": "pusher", "on": "lever", "at": [0.6, 0.2], "direction": [0.0, 1.0], "kind": "spring",
        "spring": {"stiffness": 3000.0, "preload": 150.0},
    }  # fmt: skip
    cosine, sine = math.cos(angle), math.sin(angle)
    across = cosine * 0.2 - sine * 0.05  # of the center of mass, x
    arm, rise = cosine * 0.4 - sine * 0.15, sine * 0.4 + cosine * 0.15 - 0.15
    moment = 3.0 * across * gravity + arm * (150.0 - 3000.0 * rise)
    free = math.degrees(angle - moment / stiffness)
    drive = armed(links=62, stiffness=stiffness, free_angle=free, stops=[-20.0, 20.0])
    drive = drive.with_values({"tensioners": [tensioner], "run.gravity": [0.0, gravity]})
    assembly = assemble(drive)
    assert assembly.strain < 0.0
    assert float(assembly.arm_angle[0]) == pytest.approx(angle, abs=1e-9)
    still = RestingArm(single_chain(drive), 0)
    assert still.extension(drive.tensioners[0], angle) == pytest.approx(rise, abs=1e-15)
    d = 1e-6
    assert still.moment(0.1) == pytest.approx(-(still.energy(0.1 + d) - still.energy(0.1 - d)) / (2 * d), rel=1e-6)
    assert still.stiffness(0.1) == pytest.approx(-(still.moment(0.1 + d) - still.moment(0.1 - d)) / (2 * d), rel=1e-6)


def test_a_coil_spring_holds_an_arm():
    """T = 0, no weight: the arm stands where the spring has its free length, by the rule of cosines; to 1e-9 rad."""
    coil = {"at": [0.5, 0.3], "anchor": [0.3, -0.2], "stiffness": 3000.0, "free_length": 0.5}
    q, f = np.subtract(coil["at"], PIVOT), np.subtract(coil["anchor"], PIVOT)
    drawn = math.atan2(f[0] * q[1] - f[1] * q[0], f @ q)
    between = math.acos((q @ q + f @ f - 0.5**2) / (2.0 * math.sqrt((q @ q) * (f @ f))))
    drive = armed(links=62, spring=coil, stops=[-20.0, 20.0]).with_values({"run.gravity": [0.0, 0.0]})
    assembly = assemble(drive)
    assert assembly.strain < 0.0
    assert float(assembly.arm_angle[0]) == pytest.approx(between - drawn, abs=1e-9)
    still, d = RestingArm(single_chain(drive), 0), 1e-6
    assert still.moment(0.1) == pytest.approx(-(still.energy(0.1 + d) - still.energy(0.1 - d)) / (2 * d), rel=1e-6)
    assert still.stiffness(0.1) == pytest.approx(-(still.moment(0.1 + d) - still.moment(0.1 - d)) / (2 * d), rel=1e-6)


def test_two_arms_of_a_drive_that_is_its_own_mirror_image():
    """Mirrored top to bottom angles change sign; both stand in balance. 1e-8 rad: the seats are not mirrored to
    round-off."""
    spring = {"stiffness": 2000.0, "stops": [-20.0, 20.0]}
    drive = two_sprockets(links=60).with_values(
        {
            "contact.guide": GUIDE,
            "guides": [blade(arm="lever"), blade("lower blade", -1.0, arm="lower")],
            "arms": [lever(free_angle=8.0, **spring), lever("lower", -1.0, free_angle=-8.0, **spring)],
        }
    )
    path = chain_path(single_chain(drive))
    above, below = path.arm_angle.tolist()
    assert above == pytest.approx(-below, abs=1e-10)
    for a in range(2):
        still, pull = RestingArm(single_chain(drive), a), chain_moment(single_chain(drive), path, a)
        assert abs(pull) > 1.0
        assert still.moment(float(path.arm_angle[a])) == pytest.approx(-pull, rel=1e-7)


def test_an_arm_that_nothing_turns_stands_as_drawn():
    """Without weight, spring and chain its moment is 0 at every angle; the other arm is in balance as if alone."""
    spring = {"stiffness": 2000.0, "stops": [-20.0, 20.0], "free_angle": 8.0}
    alone = armed(**spring)
    beside = alone.with_values({"arms": [lever(**spring), lever("idle", -1.0)]})
    found = chain_path(single_chain(beside)).arm_angle
    assert found[1] == 0.0
    assert found[0] == pytest.approx(chain_path(single_chain(alone)).arm_angle[0], abs=1e-11)


def test_links_of_a_slack_guided_strand_are_unstrained():
    """Their rollers stand on the face or above it, a pitch apart, to round-off."""
    drive = two_sprockets(links=62).with_values({"contact.guide": GUIDE, "guides": [blade()]})
    assembly = assemble(drive)
    assert assembly.strain < 0.0
    own = (assembly.strand_first[1] + np.arange(assembly.strand_links[1])) % 62
    assert link_lengths(assembly)[own] == pytest.approx(PITCH, rel=1e-12)
    reach = np.hypot(*(assembly.position - [0.5, TOP - FACE]).T)
    assert reach[own].min() > FACE + ROLLER - 1e-9


def test_derivatives_with_an_arm_are_those_of_the_energy():
    """As of other drives in test_statics.py; the arm beyond its stop, on its tensioner, with weight."""
    drive = timing(**{"run.gravity": [0.0, -9.81], "arms.0.stops": [-4.0, 12.0]})
    potential, assembly = Potential(single_chain(drive), 600.0, np.array([0.0, 4.0, 4.0])), assemble(drive)
    angles = assembly.sprocket_angle, assembly.arm_angle - 1e-3
    x = np.concatenate([assembly.position.ravel(), potential.home.ravel(), *angles])
    x += np.random.default_rng(3).normal(size=len(x)) * 1e-5
    terms = potential.terms(x)
    whole = terms.hessian([(np.arange(len(x)), np.ones(len(x)))], len(x)).toarray()
    for i in [*range(40, 60), len(x) - 2, len(x) - 1]:
        slope, curvature = differences(potential, x, i)
        assert abs(slope - terms.gradient[i]) < 1e-4 * np.abs(terms.gradient).max()
        assert np.abs(curvature - whole[i]).max() < 1e-4 * np.abs(whole[i]).max()
    assert np.count_nonzero(whole[-1]) > 5  # rollers press on the blade


def test_the_tensioner_gives_the_working_tension():
    """T = F l / (h_in - h_out) + m v^2 / p of the strand at the angle at work; 3e-3: four states within a pitch."""
    drive = timing().with_values(BARE)
    steady = at_work(single_chain(drive))
    angle = float(steady.arm_angle[0])
    (string,) = [s for s in path_at(single_chain(drive), [angle]).strings if s and s.touches[0].arc.guide == 0]
    still, tensioner = RestingArm(single_chain(drive), 0), drive.tensioners[0]
    force = static_force(tensioner, still.extension(tensioner, angle))
    cosine, sine = math.cos(angle), math.sin(angle)
    (ax, ay), (px, py), (ux, uy) = tensioner.at, drive.arms[0].pivot, tensioner.unit_direction
    x, y = cosine * (ax - px) - sine * (ay - py), sine * (ax - px) + cosine * (ay - py)
    expected = -force * (x * uy - y * ux) / string.levers([0], (px, py))
    assert steady.failure is None
    assert steady.centrifugal > 10.0
    assert steady.tension[0] == pytest.approx(expected + steady.centrifugal, rel=3e-3)
    assert abs(angle - float(assemble(drive).arm_angle[0])) > 3e-3  # it is not where it was assembled


def test_check_tells_what_the_chain_touches():
    """On the face's circle T / R' a length over the wrapped angle b, 2 T sin(b/2) in all; frequencies are of the free
    parts, sqrt(l^2 - (R' - R)^2) each."""
    drive = two_sprockets(links=60).with_values({"contact.guide": GUIDE, "guides": [blade()]})
    values = derived_quantities(drive)
    (guide,), strand = values["guides"], values["strands"][1]
    touch, pull = guide["touch"], strand["working_tension"] - strand["centrifugal_tension"]
    wrap = touch["wrap"]
    assert touch["strand"] == "driven->driver"
    assert touch["load"] == pytest.approx(pull / (FACE + ROLLER), rel=1e-12)
    assert touch["force"] == pytest.approx(2.0 * pull * math.sin(0.5 * wrap), rel=1e-12)
    middle, half = 0.5 * guide["face_length"], 0.5 * wrap * FACE
    assert touch["places"] == pytest.approx([middle - half, middle + half], abs=1e-12)
    free = math.sqrt(0.5**2 + (TOP - FACE) ** 2 - (FACE + ROLLER - RADIUS) ** 2)
    assert strand["free_lengths"] == pytest.approx([free, free], rel=1e-12)
    wave = math.sqrt(strand["standing_tension"] * PITCH / drive.chain.mass)
    assert strand["standing_frequency"] == pytest.approx(wave / (2.0 * free), rel=1e-9)
    assert values["strands"][0]["free_lengths"] == [values["strands"][0]["length"]]
    assert any(line.split()[:2] == ["blade", "driven->driver"] for line in report(values).splitlines())


def test_check_tells_arms_and_tensioners():
    values = derived_quantities(timing())
    (arm,), (tensioner,) = values["arms"], values["tensioners"]
    drive, text = timing(), report(values)
    part = drive.tensioners[0]
    assert arm["stops"] == pytest.approx([-math.radians(12.0), math.radians(12.0)]) and arm["on_stop"] is None
    assert arm["stops"][0] < arm["working_angle"] < arm["standing_angle"] < arm["angle"] < 0.0
    assert tensioner["working_force"] == pytest.approx(static_force(part, tensioner["working_extension"]))
    assert tensioner["static_pressure"] > 1e5
    assert (
        f"{math.degrees(arm['working_angle']):+.3f} deg" in text
        and "-12 to 12 deg" in text
        and f"{1e3 * tensioner['extension']:+.3f} mm" in text
    )


def told(**changes):
    return layout_faults(single_chain(timing(**changes)))


def test_findings_of_guides_and_arms():
    assert told() == ()
    (away,) = told(**{"guides.fixed guide.side": "right"})
    assert away.startswith('guides.fixed guide: its face is turned away from strand "exhaust cam->crank"')
    assert 'side = "left"' in away
    arcs = [{"center": [1.0, -0.036238], "radius": 0.6, "from": 173.5869, "to": 152.5784}]
    (far,) = told(**{"guides.fixed guide.arcs": arcs})
    assert far.startswith("guides.fixed guide: no strand passes it: the nearest,")
    (none,) = told(**{"guides.fixed guide.arcs": [{**arcs[0], "center": [0.3, 0.0], "from": 100.0, "to": 80.0}]})
    assert none.startswith("guides.fixed guide: no strand passes it: none runs along its face")
    (stop,) = told(**{"arms.arm.stops": [-4.0, 12.0]})
    assert stop.startswith("arms.arm: stands on its lower stop at assembly")


def test_an_arm_without_a_balance_is_told_by_name():
    with pytest.raises(DriveError, match=r"^arms\.arm\.stops: missing; without them the arm finds no balance"):
        assemble(timing(**{"arms.arm.stops": None, "chain.links": 110}))
    with pytest.raises(DriveError, match=r"^arms\.arm: finds no balance .*look at its stops"):
        assemble(timing(**{"chain.links": 110}))


def test_fit_of_links_and_of_a_sprockets_place():
    """The links with the least strain; the place at which the arm stands where it is wanted, to 1e-6 degrees."""
    assert fit_links(timing(**{"chain.links": 120})).chain.links == 108
    assert fit_links(timing(), angle={"arm": 1.0}).chain.links == 106
    moved = fit_angle(timing(), "crank", (0.0, 1.0), {"arm": -3.0})
    assert math.degrees(assemble(moved).arm_angle[0]) == pytest.approx(-3.0, abs=1e-6)
    for wrong, words in (({"arm": -30.0}, "the stops of arms.arm"), ({"blade": 0.0}, "no such name")):
        with pytest.raises(DriveError, match=words):
            fit_angle(timing(), "crank", (0.0, 1.0), wrong)
    with pytest.raises(DriveError, match="lies on a guide, so that it has no sag"):
        fit_position(timing(), "crank", (0.0, 1.0), sag=1e-3, strand="crank->intake cam")


def kinked(angle, rest):
    """A moment [N m] that falls by 60 N m/rad below 0.1 rad and by 50,000 above, as at a stop, 0 at `rest`."""
    below, above = np.minimum(rest, 0.1) - np.minimum(angle, 0.1), np.maximum(rest, 0.1) - np.maximum(angle, 0.1)
    return 60.0 * below + 5e4 * above


def test_a_balance_beside_a_stop_is_found_in_few_steps():
    """Secants that jump over the kink to and fro are held between the angles known; 1e-11 rad is where they stop.

    Of at most 2 degrees, 9 steps at most lead there. A micrometer from the kink at a meter, halving alone would take 32
    more from 0.035 rad to 1e-11, and secants, which want both on one side of it, little less. Arrays give the same.
    """
    rests, near = np.array([0.0999, 0.1, 0.100001, 0.12, -0.05]), -0.2
    asked = []

    def alone(rest):
        return lambda angle: asked.append(angle) or float(kinked(angle, rest))

    found = []
    for rest in rests.tolist():
        asked.clear()
        angle, _ = _secant_root(alone(rest), near)
        assert angle == pytest.approx(rest, abs=1e-11)
        assert len(asked) < (36 if rest == 0.100001 else 16)
        found.append(angle)
    together, _ = _secant_root(lambda angle: kinked(angle, rests), near + 0.0 * rests)
    assert together.tolist() == found
