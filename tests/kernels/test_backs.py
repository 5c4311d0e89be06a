"""Backs of silent chains on guides: forces against an energy and closed forms, balance of energy."""

import math

import numpy as np
import pytest
from blocks import assert_steps_of_the_cpu, silent_guided
from drives import STARTING, two_sprockets
from silent_chains import guided_silent_drive

from warpchain import Drive, Record, simulate
from warpchain.assembly import assemble
from warpchain.assembly.back_energy import Backs
from warpchain.assembly.guide_obstacles import profile_at
from warpchain.assembly.potential import Potential
from warpchain.assembly.statics import equilibrium
from warpchain.assembly.timestep import automatic_step
from warpchain.drive.drive import drive_values
from warpchain.drive.plate import CROWN
from warpchain.engine.force_probe import ForceProbe
from warpchain.engine.pack import pack
from warpchain.kernels.physics.back import ROW_MARGIN
from warpchain.model import single_chain
from warpchain.results.guide_load import recorded_guide_contacts
from warpchain.results.schedule import Schedule

DEPTH = 1e-4
"""Penetration of the link that is laid into a guide [m]."""


def link_on_face(model, profile, place, foot):
    """Pins (2, 2) [m] of a link whose back touches a face at a place [m], `DEPTH` deep, `foot` [pitches] ahead of the
    link's middle, and the face's normal there.

    The crown's normal there leans by asin(foot / R_c) to the link's.
    """
    chain, (point, heading) = model.chain, profile.at(place)
    normal = np.array([-math.sin(heading), math.cos(heading)])
    sine = -foot / CROWN
    cosine = math.sqrt(1.0 - sine * sine)
    w = np.array([cosine * normal[0] - sine * normal[1], sine * normal[0] + cosine * normal[1]])
    u = model.sprockets[0].sign * np.array([w[1], -w[0]])
    touch = np.array(point) - DEPTH * normal
    middle = touch + CROWN * chain.pitch * (normal - w) + chain.plate.back_height * w
    return np.stack([middle - 0.5 * chain.pitch * u, middle + 0.5 * chain.pitch * u]), normal


PLACES = {
    "flat, in mid-link": (0, 0.06, 0.0),
    "arc, in mid-link": (0, 0.03, 0.0),
    "arc, off it": (0, 0.033, 0.3),
    "near the first pin": (0, 0.03, -0.49),
    "near the second pin": (0, 0.03, 0.49),
    "flat to arc": (0, 0.0365, -0.1),
    "at the rail's end": (0, -0.001, 0.2),
    "bar, near a pin": (1, 0.04, 0.48),
    "at the bar's end": (1, -0.002, 0.1),
}
"""Guide, place on its face [m] and foot [pitches] of a link's contact; the rail's arcs are 0.0247 to 0.0365 m on it."""


@pytest.mark.parametrize("name", PLACES)
def test_forces_are_the_slope_of_the_energy(name):
    """Of a link laid into the rail, which an arm carries, or into the bar, wherever it touches: K times its depth.

    The energy is written a second time, with numpy; the chain is soft, so that its links hardly pull.
    """
    g, place, foot = PLACES[name]
    drive = silent_guided()[0].with_values({"chain.stiffness": 1e-3, "chain.joint": None})
    model = single_chain(drive)
    packed = pack([drive], [Schedule(1e-6, 10, 1, 10, 0)])
    probe = ForceProbe(packed)
    states, n = probe.packed_state(), probe.rollers
    profile = profile_at(model, g, states.bodies[0, 2:, 2])
    laid, normal = link_on_face(model, profile, place, foot)
    pin = int(np.argmin(np.hypot(*(states.position[0] - laid[0]).T)))
    states.position[0, pin], states.position[0, (pin + 1) % n] = laid
    straight, turned, _ = probe(states)
    probe.close()
    stiffness = model.guide_stiffness(g)
    backs = Backs(drive.chain, 1.0, profile, np.zeros(2), model.guide_offset(g), stiffness, 1.0)
    of_link, slope = backs.energy(np.concatenate([laid.ravel(), np.zeros(3)])[None])
    force, pins = stiffness * DEPTH, slope[0, :4].reshape(2, 2)
    assert of_link[0] == pytest.approx(0.5 * force * DEPTH, rel=1e-6)
    np.testing.assert_allclose(pins.sum(axis=0), -force * normal, atol=1e-6 * force)
    along = foot * (1.0 - model.guide_offset(g) / (CROWN * drive.chain.pitch))  # where it crosses the pins' line
    assert pins @ normal / -force == pytest.approx([0.5 - along, 0.5 + along], abs=1e-3)
    energy = Potential(model, 0.0, np.zeros(2), held=[False] * 2)
    x = np.concatenate([states.position.ravel(), states.bodies[0, :2, :2].ravel(), states.bodies[0, :, 2]])
    found = energy.terms(x).gradient
    largest = np.abs(found[: 2 * n]).max()
    assert largest > 0.4 * force
    np.testing.assert_allclose(drive.chain.mass * straight[0].ravel(), -found[: 2 * n], atol=1e-6 * largest)
    assert drive.arms[0].inertia * turned[0, 2, 2] == pytest.approx(-found[2 * n + 6], abs=1e-6 * largest)


def wrapped_drive(radius, **values):
    """`guided_silent_drive` with a single rail, an arc about which many links lie."""
    pitch = 9.525e-3
    top = 0.5 * pitch / math.sin(math.pi / 23) + 0.4 * pitch
    drive = drive_values(guided_silent_drive())
    arc = {"center": [0.112, top + radius - 0.02], "radius": radius, "from": -60.0, "to": -120.0}
    drive["guides"] = [{"name": "rail", "arcs": [arc], "end_radius": 0.005}]
    drive["sprockets"][1]["center"] = [0.2217, 0.0]
    return Drive(**drive).with_values(values)


def pin_heights(radius):
    """Height of pins in the middle of an arc over what it would be on a flat face [m], found and in closed form.

    They stand at sqrt((R + o - N/K)^2 + l^2/4), N = T l / (R + o - N/K) what two links of tension T press a third with.
    Links are as long as they stretch. At the arc's ends they lean, in turn ahead and back all along it, by which pins
    stand higher and lower: (1, 2, 1)/4 of three pins has that out, but for the square of 10 um over the pitch.
    """
    drive = wrapped_drive(radius)
    model = single_chain(drive)
    (energy,), (x,) = equilibrium([model], [0.0], [assemble(drive)])
    flat = radius + drive.chain.plate.back_height
    height = np.hypot(*(energy.parts_of_coordinates(x)[0] - np.array(drive.guides[0].arcs[0].center)).T) - flat
    on = np.flatnonzero(np.abs(height) < 1.5e-5 / radius)
    assert len(on) >= 5 and (np.diff(on) == 1).all()
    k = on[len(on) // 2]
    tension = energy.tensions(x)[k]
    length = drive.chain.pitch + tension / drive.chain.stiffness
    reach = flat - tension * length / flat / model.guide_stiffness(0)
    return np.array([0.25, 0.5, 0.25]) @ height[k - 1 : k + 2], math.hypot(reach, 0.5 * length) - flat


@pytest.mark.parametrize("radius", [0.08, 0.15])
def test_pins_stand_off_an_arc(radius):
    """By p^2 / (8 (R + o)), 135 and 74 um, less what the contact gives way."""
    found, exact = pin_heights(radius)
    assert exact == pytest.approx(9.525e-3**2 / (8.0 * (radius + 0.4 * 9.525e-3)), rel=0.07)
    assert found == pytest.approx(exact, abs=5e-7)


def test_energy_is_kept_to_the_second_order_of_the_step():
    """Of a chain that runs over a rail, which rubs: below 1e-4 at the automatic step, a quarter at half of it."""
    drive = wrapped_drive(0.15, **{"contact.guide.friction": 0.1, "run.duration": 0.05}).with_values(
        {"sprockets.drive.prescribed.ramp_time": 0.02, "sprockets.driven.load": {"torque": 10.0, "ramp_time": 0.02}}
    )
    step = automatic_step(drive)
    both = [drive.with_values({"run.step": part * step}) for part in (1.0, 0.5)]
    metrics = simulate(both, device="cpu").metrics.to_pydict()
    coarse, fine = np.abs(metrics["energy_residual_relative"])
    assert coarse < 1e-4 and fine < 0.5 * coarse
    assert min(metrics["rail.friction"]) > 0.0


def test_a_mirrored_drive_is_the_same():
    """Without weight, its wheels turning the other way: to round-off, which contacts amplify."""
    drive = guided_silent_drive(**{"run.duration": 0.004, "contact.guide.friction": 0.1, "run.gravity": [0.0, 0.0]})
    values = drive_values(drive)
    for part in values["sprockets"]:
        part |= {"wrap": "cw"}
    for guide in values["guides"]:
        ends = [key for key in ("start", "end", "points") if key in guide]
        places = {key: np.multiply(guide[key], (1.0, -1.0)).tolist() for key in ends}
        guide |= places | {"side": "right"}
    metrics = simulate([drive, Drive(**values)], device="cpu", limits=STARTING).metrics.to_pydict()
    for name in ("tension_max", "rail.impulse", "rail.friction", "bar.force_max", "bar.dissipated"):
        first, other = metrics[name]
        assert other == pytest.approx(first, rel=1e-7), name


def test_forces_on_backs_are_found_along_the_face():
    """Of all frames, none is lost at the ends of the face, and most are where the strand lies on it."""
    drive = wrapped_drive(0.15, **{"run.duration": 0.02})
    record = Record(rate=2e3, channels=("position", "guide_force"))
    recorded = simulate(drive, record=record, device="cpu", limits=STARTING)[0]
    (found,) = recorded_guide_contacts(recorded)
    assert found.force.sum() == pytest.approx(recorded.guide_force.sum(), rel=1e-6)
    face = recorded.model.profile(0).face_length
    assert found.force[(found.place > 0.0) & (found.place < face)].sum() > 0.9 * found.force.sum()


def test_roller_chains_have_no_rows_of_backs():
    """Their kernels have no code for them: what they read is as before."""
    bar = {"name": "bar", "start": [0.0, 9.0], "end": [1.0, 9.0], "end_radius": 0.1}
    values = drive_values(two_sprockets()) | {"guides": [bar]}
    values["contact"]["guide"] = {"restitution": 0.5, "impact_speed_floor": 0.02, "stiffness": 1e6}
    packed = pack([Drive(**values)], [Schedule(1e-6, 10, 1, 10, 0)])
    assert (
        ROW_MARGIN * CROWN > 1.0
    )  # and those of silent chains are a pitch wider, so that both pins of a link are near
    assert packed.drives["guides"].tolist() == [1] and not packed.guides["back_radius"].any()


def silent_pair():
    """Two chains of `silent_guided` on one block, each with its own slider."""
    values = drive_values(silent_guided()[0])
    chain = values.pop("chain")
    pair: dict[str, list] = {"chains": [], "sprockets": [], "guides": [], "arms": []}
    for name in "ab":
        named = {sort: [of | {"name": of["name"] + name} for of in values[sort]] for sort in list(pair)[1:]}
        pair["chains"].append(chain | {"name": name})
        for part in named["sprockets"] + named["guides"]:
            part |= {"chain": name} | ({"arm": part["arm"] + name} if "arm" in part else {})
        for sort, parts in named.items():
            pair[sort] += parts
    drive = Drive(**values | pair)
    return [drive, drive.with_values({"sprockets.driveb.prescribed.speed": 100.0})]


@pytest.mark.long
def test_chains_of_a_block_keep_the_forces_on_their_links_apart(fibers):
    assert_steps_of_the_cpu(silent_pair, False, "float64")
