"""Modes of whole drives: against closed forms, and against runs in time."""

import numpy as np
import pytest
from drives import example, timing, two_sprockets
from scipy.optimize import least_squares
from silent_chains import pulled_silent_drive

from warpchain import assemble
from warpchain.assembly.timestep import step_limit
from warpchain.engine.cpu import CpuEngine
from warpchain.engine.pack import fill_step_dependence
from warpchain.errors import SimulationError
from warpchain.modal.eigenmodes import lowest_modes, modes
from warpchain.modal.small_motion import drive_motion
from warpchain.modal.tensioner_modes import tensioner_elements
from warpchain.model import single_chain

KICK = 1e-9
"""Amplitude [m]: less than what holds any contact closed."""


def swung(found, result, chosen, cycles=2.5, fed=True):
    """Eigenvalues [1/s] that a run shows when the standing drive is let go displaced and kicked as one of its modes.

    What the drive does without a kick (it stands to 1e-6 of its tension, no better) is taken off.
    """
    step = 0.5 * step_limit(found.drive)
    (part,) = found.parts
    packed = part.packed.pick_variants([0] * (len(chosen) + 1))
    if fed:
        steadily_fed(packed)
    packed.drives["step"], packed.drives["steps"] = step, 2**30
    fill_step_dependence(packed)
    packed.drives["window_start"] = packed.drives["window_end"] = 2**30
    weights = []
    for v, k in enumerate(chosen):
        shape, bodies, s = result.shape[k], result.bodies[k], result.eigenvalue[k]
        size = KICK / np.abs(shape).max()
        packed.roller_rows(v)[0:2] += size * shape.T.real
        packed.roller_rows(v)[2:4] = size * (s * shape).T.real
        mine = packed.bodies[v * len(bodies) : (v + 1) * len(bodies)]
        mine["center"] += size * bodies[:, :2].real
        mine["angle"] += size * bodies[:, 2].real
        mine["velocity"], mine["speed"] = size * (s * bodies[:, :2]).real, size * (s * bodies[:, 2]).real
        if found.drive.tensioners:
            wet, every = part.at.chambers, len(found.drive.tensioners)
            leaked = -result.pressure[k, wet] * part.at.area / tensioner_elements(part).oil[wet] - result.stroke[k, wet]
            packed.oil["content"][v * every + wet] += size * (part.at.content_rate * leaked).real
        weights.append(shape.T.real / np.abs(shape).max() / KICK)
    engine = CpuEngine(packed, 1)
    frames = engine.frame_buffer(1)
    rows = engine.state.rollers.numpy().reshape(len(chosen) + 1, 6, -1)
    slowest, fastest = result.frequency[chosen].min(), result.frequency[chosen].max()
    every = int(1.0 / (40.0 * fastest * step))
    signals = []
    for _ in range(int(cycles / (slowest * every * step))):
        signals.append([(weight * (row[:2] - rows[-1, :2])).sum() for weight, row in zip(weights, rows, strict=False)])
        for future in engine.advance(every, frames):
            future.result()
    engine.close()
    assert not engine.progress()["diverged"].any()
    times = every * step * np.arange(len(signals))
    return [fitted(times, signal, result.eigenvalue[k]) for k, signal in zip(chosen, np.array(signals).T, strict=True)]


def steadily_fed(packed):
    """Check valves that let in what leaks at rest, whatever the pressure: a small hole, a million times the pressure
    before it. (Modes are with valves shut; what leaks meanwhile is left out as all that the drive does unkicked.)"""
    of, valve = packed.tensioners, packed.tensioners["check"]
    wet = of["hydraulic"] == 1
    supply = 1e12
    flow = of["leak"] * (of["rest"] - of["ambient"])
    reach = np.sqrt(2.0 * supply / np.where(wet, of["density"], 1.0)) * np.pi * valve["discharge"] * valve["seat_width"]
    of["supply"] = np.where(wet, supply, of["supply"])
    for name, value in (
        ("lift_max", flow / np.where(wet, reach, 1.0)), ("hole_area", 1.0), ("preload", 0.0), ("compliance", 1e30),
        ("seat_growth", 0.0),
    ):  # fmt: skip
        valve[name] = np.where(wet, value, valve[name])


def fitted(times, signal, guess):
    """The s of the decaying oscillation Re(a exp(s t)) nearest to a signal, over `guess`'s first two and a half cycles
    or the time in which it decays to a tenth."""
    until = min(2.5 * 2.0 * np.pi / guess.imag, 2.3 / max(-guess.real, 1e-12))
    times, signal = times[times <= until], signal[times <= until]

    def misses(s):
        waves = np.exp(s[0] * guess.imag * times)[:, None] * np.stack(
            [np.cos(s[1] * guess.imag * times), np.sin(s[1] * guess.imag * times)], axis=1
        )
        return waves @ np.linalg.lstsq(waves, signal, rcond=None)[0] - signal

    found = least_squares(misses, [guess.real / guess.imag, 1.0]).x
    return guess.imag * complex(*found)


@pytest.mark.parametrize(
    ("name", "chosen"),
    [
        ("engine", [0, 6, 11, 18]),
        ("industrial", [0, 5, 12]),
        ("motorcycle", [0, 5, 17]),
        ("car", [0, 1, 13, 24]),
    ],
)
def test_a_kicked_drive_swings_as_its_modes(name, chosen):
    """Frequency and damping to a tenth of the 2 % that are asked for."""
    found = drive_motion(example(name))
    result = lowest_modes(found, max(chosen) + 1)
    run = np.array(swung(found, result, chosen))
    assert (np.abs(run - result.eigenvalue[chosen]) < 2e-3 * np.abs(run)).all()


@pytest.mark.parametrize(("restitution", "zeta", "exact"), [(0.3, 1.4717e-3, 5e-3), (1.0, 1.9e-4, 0.03)])
def test_rollers_on_their_seats_damp_a_sprocket_that_swings(restitution, zeta, exact):
    """Against an independent Jacobian, and against a run at half the step's limit."""
    base = two_sprockets(teeth=19, links=72, stiffness=1.2e7, contact=2.4e7, damping=30.0, torque=2.0, inertia=0.05,
                         speed=0.0, restitution=restitution, clearance=5e-5, mass=0.0088)  # fmt: skip
    own = {"chain.pitch": 0.0127, "chain.roller_radius": 0.004255, "contact.sprocket.restitution_means": "rebound"}
    place = {"sprockets.driven.center": [26.5 * 1.004 * 0.0127, 0.0], "contact.sprocket.seat_angle": None}
    found = drive_motion(base.with_values(own | place))
    result = lowest_modes(found, 6)
    k = result.names.index("driven 1")
    assert result.damping_ratio[k] == pytest.approx(zeta, rel=exact)
    (run,) = swung(found, result, [k])
    assert abs(run.real / result.eigenvalue[k].real - 1.0) < 2e-3
    if restitution < 1.0:
        assert result.frequency[k] == pytest.approx(25.0749, rel=1e-4)


def test_contacts_of_the_engine_damp_its_strands():
    """Against an independent Jacobian: ten to a hundred times what the links alone damp."""
    result = modes(example("engine"), 12)
    zeta = dict(zip(result.names, result.damping_ratio, strict=True))
    assert zeta["idler->crankshaft 1"] == pytest.approx(2.0e-4, rel=0.02)
    assert zeta["intake cam->idler 2"] == pytest.approx(1.40e-4, rel=0.02)
    assert zeta["exhaust cam->intake cam 2"] == pytest.approx(1.5e-4, rel=0.04)


def test_a_slide_on_oil_swings_as_its_modes():
    """As above: the sprocket of `engine` that tensions the chain, on its slide with a plunger of oil 80 mm^2/s."""
    place = {"name": "element", "on": "tensioner", "at": [0.038317, 0.18], "direction": [-1.0, 0.0]}
    element = timing().tensioners[0].model_dump() | place
    elastic = {"contact.sprocket.restitution": 1.0, "contact.guide.restitution": 1.0}
    drive = example("engine").with_values({"tensioners": [element], **elastic})
    found = drive_motion(drive)
    result = lowest_modes(found, 10)
    chosen = [0, int(np.argmax(result.stored[:, 0]))]
    assert result.damping_ratio[chosen[1]] > 0.02
    run = np.array(swung(found, result, chosen))
    assert (np.abs(run - result.eigenvalue[chosen]) < 2e-3 * np.abs(run)).all()


def test_the_faintest_motion_of_a_car_has_its_valve_open():
    """As above, of the drive as it is: a kick of 1 nm changes the pressure by some Pa; 3 kPa would shut the valve,
    which passes fifty times what the gap does. The arm's mode then has 104 Hz instead of 580, and 7 % instead of 11."""
    elastic = {"contact.sprocket.restitution": 1.0, "contact.guide.restitution": 1.0}
    found = drive_motion(example("car").with_values(elastic), valve="open")
    result = lowest_modes(found, 30)
    chosen = [0, int(np.argmax(result.participation[:, result.parts.index("arm")]))]
    shut = lowest_modes(drive_motion(found.drive), 30)
    run = np.array(swung(found, result, chosen, fed=False))
    assert (np.abs(run - result.eigenvalue[chosen]) < 2e-3 * np.abs(run)).all()
    own = int(np.argmax(shut.participation[:, shut.parts.index("arm")]))
    assert result.frequency[chosen[1]] < 0.2 * shut.frequency[own]


def test_a_driven_sprocket_between_two_strands():
    """R sqrt(k_1 + k_2) / (2 pi sqrt J), the strands' links in series with the seated rollers at both of their ends.

    From the roller seated last, the arc is a ladder of seats kappa and links k', whose stiffness without its first seat
    is (-kappa + sqrt(kappa^2 + 4 k' kappa)) / 2. Without clearance a seat is a spring kappa in any direction, and a
    link on the arc also draws its roller inwards: 1/k' = 1/k + (2 pi / z)^2 / kappa. Left out are the chain's own
    inertia, 0.4 % of the sprocket's, of which less than half turns with it, and the lever's cos(pi/z), 0.3 % at most.
    """
    teeth, k, kappa, inertia = 40, 5e7, 5e6, 2000.0
    drive = two_sprockets(
        teeth=teeth, links=80, span=20.04, stiffness=k, contact=kappa, torque=0.0, inertia=inertia, clearance=0.0,
        seat_angle=145.0,
    )  # fmt: skip
    result = modes(drive, 5)
    first = int(np.argmax(result.participation[:, result.parts.index("driven")]))
    give = 1.0 / (1.0 / k + (2.0 * np.pi / teeth) ** 2 / kappa)
    arc = 0.5 * (-kappa + np.sqrt(kappa**2 + 4.0 * give * kappa)) + kappa
    strand = 1.0 / (20.0 / k + 2.0 / arc)
    expected = single_chain(drive).pitch_radius(1) * np.sqrt(2.0 * strand / inertia) / (2.0 * np.pi)
    assert result.frequency[first] == pytest.approx(expected, rel=4e-3)
    assert result.names[first] == "driven 1"


def test_shares_sum_to_one_and_shapes_are_of_unit_modal_mass():
    result = modes(two_sprockets(links=58, span=19.03, gravity=-9.81), 6)
    assert np.allclose(result.participation.sum(axis=1), 1.0)
    rollers = (np.abs(result.shape) ** 2).sum(axis=(1, 2))
    assert np.allclose(rollers + 2.0 * np.abs(result.bodies[:, 1, 2]) ** 2, 1.0)
    assert result.names[0].rpartition(" ")[0] in result.parts


def test_a_chain_without_tension_has_motions_that_nothing_restores():
    result = modes(two_sprockets(links=58, span=18.9, torque=0.0), 6)
    assert result.zeros > 0
    assert len(result) == 6
    assert result.frequency.min() > 0.1


def test_a_drive_that_does_not_settle_is_refused_in_one_line():
    with pytest.raises(SimulationError, match="does not settle") as caught:
        modes(two_sprockets(links=58, span=19.03, torque=1e6))
    assert "\n" not in str(caught.value)


def test_a_strand_with_a_moving_end_runs_away_within_its_tongue():
    """Its tension swings by e at nearly 2 f: growth omega (sqrt(e^2 / 16 - d^2) - zeta), d = f_end / (2 f) - 1.

    So the threshold is e = 4 zeta at d = 0, and the tongue's half width e / 4. The share e is the mode's own, from its
    frequency with the end moved out and in; the chain damps the mode by 2e-6 only. Left out is what is of second order
    in e = 0.04, and what of the start still decays off the tongue's middle, 3 % of the growth rate there.
    """
    amplitude = 5e-5

    found = drive_motion(swaying(0.0))
    result = lowest_modes(found, 2)
    frequency = result.frequency[0]
    share = swing_of_tension(amplitude, 0)
    detuned = np.array([0.0, 0.15, -0.15, 0.4]) * share
    packed = found.parts[0].packed.pick_variants([0] * len(detuned))
    packed.mounts["amplitude"][1::2] = amplitude
    packed.mounts["frequency"][1::2] = 4.0 * np.pi * frequency * (1.0 + detuned)
    size, growth = grown(packed, found, result, 0)
    omega = 2.0 * np.pi * frequency
    expected = omega * np.sqrt(np.maximum(share**2 / 16.0 - detuned**2, 0.0))
    assert growth[0] == pytest.approx(expected[0], rel=0.01)
    assert growth[1:3] == pytest.approx(expected[1:3], rel=0.03)
    beats = size[:, 3]
    assert beats.max() < 2.0 * beats[0]
    assert size[-1, 0] > 20.0 * size[0, 0]


def swaying(offset, **driver):
    """Two strands whose one end stands off by an offset [m]; `driver` are values of the sprocket at their other end."""
    mount = {"kind": "prescribed", "direction": [1.0, 0.0], "offset": offset, "frequency": 0.0}
    base = two_sprockets(span=20.03, torque=0.0, restitution=1.0, stiffness=5e6)
    held = {f"sprockets.driver.{key}": value for key, value in driver.items()}
    return base.with_values({"sprockets.driven.mass": 5.0, "sprockets.driven.mount": mount, **held})


def swing_of_tension(amplitude, k, **driver):
    """e of mode k: by its frequency with the end moved out and in."""
    inner, outer = (modes(swaying(off, **driver), k + 1).frequency[k] for off in (-amplitude, amplitude))
    return (outer**2 - inner**2) / (outer**2 + inner**2)


def grown(packed, found, result, k, halves=100):
    """How large mode k is every half of its periods (halves, variants), and its rate of growth in the second half of
    those [1/s]; the ends of the variants' strands move."""
    step = 0.5 * step_limit(found.drive)
    packed.drives["step"], packed.drives["steps"] = step, 2**30
    fill_step_dependence(packed)
    packed.drives["window_start"] = packed.drives["window_end"] = 2**30
    shape, frequency, omega = result.shape[k].real, result.frequency[k], 2.0 * np.pi * result.frequency[k]
    for v in range(packed.variants):
        packed.roller_rows(v)[0:2] += 1e-6 * shape.T / np.abs(shape).max()
    engine = CpuEngine(packed, 1)
    frames = engine.frame_buffer(1)
    rows = engine.state.rollers.numpy().reshape(packed.variants, 6, -1)
    still = found.parts[0].state.position[0].T
    size, every = [], int(0.5 / (frequency * step))
    for _ in range(halves):
        for future in engine.advance(every, frames):
            future.result()
        place = ((rows[:, 0:2] - still) * shape.T).sum(axis=(1, 2))
        speed = (rows[:, 2:4] * shape.T).sum(axis=(1, 2)) / omega
        size.append(np.hypot(place, speed))
    engine.close()
    late = np.log(np.array(size))[halves // 2 :]
    times = every * step * np.arange(len(late))
    return np.array(size), np.array([np.polyfit(times, one, 1)[0] for one in late.T])


@pytest.mark.long
def test_a_damped_strand_runs_away_beyond_four_zeta():
    """The share e at which growth begins, between two that are measured, is 4 zeta for a mode that damps by 0.5 to 2 %
    (its other end gives way on a spring and a damper).

    Mathieu's equation itself asks for no more than 4 zeta (1 + zeta^2 / 32) in the tongue's middle. The strand has
    other modes, which its swinging tension couples: of the order e^2, 16 zeta^2 = 0.6 % at 2 %; 0.4 % are found there.
    """
    near = np.array([0.85, 1.15])
    ratio, threshold = [], []
    for drag in (130.0, 450.0, 1000.0):
        held = {"mass": 5.0, "mount": {"kind": "slider", "direction": [0.0, 1.0], "stiffness": 1.5e4, "damping": drag}}
        found = drive_motion(swaying(0.0, **held))
        result = lowest_modes(found, 1)
        zeta, tried = result.damping_ratio[0], 1e-4
        packed = found.parts[0].packed.pick_variants([0] * len(near))
        packed.mounts["amplitude"][1::2] = near * 4.0 * zeta * tried / swing_of_tension(tried, 0, **held)
        packed.mounts["frequency"][1::2] = 4.0 * np.pi * result.frequency[0]
        _, growth = grown(packed, found, result, 0, 60)
        ratio.append(zeta)
        threshold.append(4.0 * zeta * np.interp(0.0, growth, near))
    assert min(ratio) < 0.006
    assert max(ratio) > 0.019
    assert np.array(threshold) == pytest.approx(4.0 * np.array(ratio), rel=0.01)


def test_a_guided_strand_has_the_frequency_of_its_free_part():
    """A taut string's from the guide to a sprocket, c / 2 L with c^2 = T p / m; the mean of T over the strand's links
    at rest under load. 5 %: links bend at the ends of a short string, rollers lift off the guide's ends."""
    drive = timing(**{"chain.joint": None, "contact.sprocket.friction": 0.0, "contact.guide.friction": 0.0})
    found, assembly = modes(drive, 6), assemble(drive)
    first = found.names.index("crank->intake cam 1")
    links = assembly.strand_first[0] + np.arange(assembly.strand_links[0])
    wave = np.sqrt(found.tension[links].mean() * drive.chain.pitch / drive.chain.mass)
    free = max(assembly.path.free_lengths(0))
    assert free < 0.7 * assembly.path.strand_length[0]
    assert found.frequency[first] == pytest.approx(wave / (2.0 * free), rel=0.05)


def test_strands_of_a_silent_chain_hang_between_the_pins_whose_flanks_touch():
    found = modes(pulled_silent_drive(), count=2)
    assert sorted(found.names) == ["drive->driven 1", "driven->drive 1"]
    (places,) = [part.layout for part in drive_motion(pulled_silent_drive(), 0.0).parts]
    # 180 degrees of each wheel hold 23 / 2 pins, and one more or less
    assert all(abs((places.arc == s).sum() - 11.5) <= 1.5 for s in (0, 1))
    assert sorted({*places.strand}) == [-1, 0, 1] and ((places.arc < 0) == (places.strand >= 0)).all()
