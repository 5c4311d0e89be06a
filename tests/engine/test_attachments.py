"""Masses on links: what they weigh, their inertia and energy, against chains of heavier rollers and closed forms."""

import numpy as np
import pytest
from drives import two_sprockets
from raw import chain, polygon, run, settling, state
from scipy.linalg import eigh
from scipy.optimize import least_squares

from warpchain import Record, dumps_drive, loads_drive, simulate
from warpchain.assembly.potential import Potential
from warpchain.assembly.statics import at_work
from warpchain.assembly.timestep import highest_frequency, step_limit
from warpchain.engine.pack import pack
from warpchain.errors import DriveError
from warpchain.modal.eigenmodes import modes
from warpchain.model import single_chain
from warpchain.results.schedule import Schedule

PITCH, MASS, STIFFNESS = 0.1, 2.0, 5e6
THIRD = [{"every": 3, "mass": 4.0}]


def attached(*rows, **options):
    """Two sprockets with attachments."""
    return two_sprockets(**options).with_values({"chain.attachments": list(rows)})


def metrics(drive, **options):
    (row,) = simulate(drive, record=Record("none"), **options).metrics.to_pylist()
    return row


def test_each_mass_is_on_the_pins_of_its_link_by_halves():
    bearing = attached({"every": 20, "mass": 4.0, "first": 19}, {"mass": 1.0, "first": 39}).chain
    expected = np.ones(60)
    for link, mass in ((19, 4.0), (39, 4.0), (59, 4.0), (39, 1.0)):
        expected[link] += mass / 2
        expected[(link + 1) % 60] += mass / 2
    np.testing.assert_array_equal(bearing.roller_masses, expected)
    assert bearing.mass == pytest.approx(1.0 + 13.0 / 60, rel=1e-15)
    assert bearing.lightest_mass == 1.0


@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("integrator", ["leapfrog", "rk4"])
def test_attachments_everywhere_are_heavier_rollers_bitwise(precision, integrator):
    # m' on every link is m'/2 + m'/2 on every roller, which is exact; so is every second link's, m'/2 each
    options = {"duration": 0.01, "gravity": -9.81, "integrator": integrator, "step": 2e-6}
    heavy = two_sprockets(mass=1.7, **options)
    everywhere, second = attached({"every": 1, "mass": 0.7}, **options), attached({"every": 2, "mass": 1.4}, **options)
    found = simulate([heavy, everywhere, second], precision=precision)
    for v in (1, 2):
        for name, values in found[0].channels().items():
            np.testing.assert_array_equal(found[v].channels()[name], values, err_msg=name)
    rows = [dict(row) for row in found.metrics.to_pylist()]
    for row in rows:
        row.pop("variant")
    assert rows[1] == rows[0]
    assert rows[2] == rows[0]
    one, other = single_chain(heavy), single_chain(everywhere)
    np.testing.assert_array_equal(at_work(other).tension, at_work(one).tension)
    assert step_limit(everywhere) == step_limit(heavy)


def test_modes_of_attachments_everywhere_are_those_of_heavier_rollers():
    options = {"gravity": -9.81, "torque": 300.0}
    one, other = modes(two_sprockets(mass=1.7, **options), 6), modes(attached({"every": 1, "mass": 0.7}, **options), 6)
    np.testing.assert_array_equal(other.frequency, one.frequency)


def uneven(relative, velocity=None, **options):
    """A ring of rollers of such masses over `MASS`, made by hand."""
    vertices, _ = polygon(len(relative), PITCH)
    velocity = np.random.default_rng(7).normal(scale=0.3, size=vertices.shape) if velocity is None else velocity
    packed = chain(vertices, velocity, mass=MASS, pitch=PITCH, stiffness=STIFFNESS, **options)
    packed.relative_mass[:], packed.chains["unlike_masses"] = relative, 1
    return packed, velocity


def test_momentum_and_energy_of_a_ring_with_masses_on_every_third_link():
    relative = np.tile([3.0, 3.0, 1.0], 8)
    packed, velocity = uneven(relative, step=8e-6, steps=5000)
    x, y, vx, vy = state(run(packed)[0])
    # forces between two rollers are opposite to the last bit; what is left is the rounding of 5000 sums
    total = MASS * relative @ velocity
    np.testing.assert_allclose(MASS * relative @ np.stack([vx, vy], axis=1), total, atol=1e-10)
    errors = []
    for step in (8e-6, 4e-6):
        packed, _ = uneven(relative, step=step, steps=round(0.04 / step), gravity=(0.0, -9.81))
        sums = run(packed)[0].sums()["chain"][0]
        errors.append(sums["energy_end"] - sums["energy_start"])
    # leapfrog keeps energy but for (omega h)^2 / 4 of it, omega = 2 sqrt(k / m) of the lightest; of second order
    energy = 0.5 * MASS * (relative @ velocity**2).sum()
    assert abs(errors[0]) < STIFFNESS / MASS * 8e-6**2 * energy
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.02)


def rigidly_turning(relative, omega):
    """Places at which a ring turns rigidly about its center of mass: link forces are -m omega^2 r on each roller."""
    vertices, _ = polygon(len(relative), PITCH)
    masses = MASS * relative[:, None]

    def lacking(flat):
        place = flat.reshape(-1, 2)
        side = np.roll(place, -1, axis=0) - place
        length = np.hypot(*side.T)[:, None]
        pull = STIFFNESS * (length - PITCH) * side / length
        return (pull - np.roll(pull, 1, axis=0) + masses * omega**2 * place).ravel()

    found = least_squares(lacking, vertices.ravel(), xtol=1e-15, ftol=1e-15, gtol=1e-15)
    assert np.abs(found.fun).max() < 1e-6
    return found.x.reshape(-1, 2)


def test_a_spinning_ring_with_masses_has_the_centrifugal_tension_of_their_mean():
    # it turns as a rigid body, where sum T L = sum m v^2 exactly (virial): T = m' v^2 of the mean mass m' / p but for
    # the sag between masses
    relative, omega = np.tile([3.0, 3.0, 1.0], 8), 30.0
    place = rigidly_turning(relative, omega)
    side = np.roll(place, -1, axis=0) - place
    pull, speeds = STIFFNESS * (np.hypot(*side.T) - PITCH), omega**2 * (place**2).sum(axis=1)
    assert (pull * np.hypot(*side.T)).sum() == pytest.approx(MASS * relative @ speeds, rel=1e-9)
    assert pull.mean() == pytest.approx(MASS * relative.mean() * speeds.mean() / PITCH, rel=0.01)
    spin = omega * np.stack([-place[:, 1], place[:, 0]], axis=1)
    packed = chain(place, spin, mass=MASS, pitch=PITCH, stiffness=STIFFNESS, step=1e-6, steps=20_000)
    packed.relative_mass[:], packed.chains["unlike_masses"] = relative, 1
    sums = run(packed)[0].sums()["chain"][0]
    # leapfrog's own circle is off by (omega h)^2 / 12 < 1e-10 of its radius, what is lacking in place by 1e-6 N
    assert sums["tension"] / sums["samples"] / 24 == pytest.approx(pull.mean(), rel=1e-6)
    assert sums["tension_max"] == pytest.approx(pull.max(), rel=1e-6)
    assert sums["tension_min"] == pytest.approx(pull.min(), rel=1e-6)


@pytest.mark.parametrize("k", [0, 1, 2])
def test_string_modes_of_a_strand_with_attachments(k):
    # across: K = T / l times (-1, 2, -1), M the rollers' masses, between ends of 1e9 times their mass; leapfrog
    # shortens periods by (omega h)^2 / 24 < 2e-6; the amplitude is small
    count, tension = 9, 2000.0
    relative = np.array([1e9, 1, 3, 3, 1, 3, 3, 1, 1, 5, 1e9])
    spacing = PITCH * (1 + tension / (STIFFNESS * PITCH))
    stiffness = tension / spacing * (2 * np.eye(count) - np.eye(count, k=1) - np.eye(count, k=-1))
    square, shapes = eigh(stiffness, np.diag(MASS * relative[1:-1]))
    place = np.zeros((count + 2, 2))
    place[:, 0] = spacing * np.arange(count + 2)
    place[1:-1, 1] = 1e-7 * shapes[:, k] / np.abs(shapes[:, k]).max()
    step, cycles = 0.002 * np.pi * np.sqrt(MASS / STIFFNESS), 10
    steps = int(cycles * 2 * np.pi / (np.sqrt(square[k]) * step))
    packed = chain(place, np.zeros_like(place), mass=MASS, pitch=PITCH, stiffness=STIFFNESS, step=step, steps=steps,
                   frame_interval=1)  # fmt: skip
    packed.relative_mass[:], packed.chains["unlike_masses"] = relative, 1
    packed.lengths[-1] = spacing * (count + 1) + tension / STIFFNESS  # that closes the chain and holds the ends apart
    _, frames = run(packed)
    signal = frames[:, count + 2 : 2 * (count + 2)] @ (relative * place[:, 1])
    rising = np.flatnonzero((signal[:-1] < 0) & (signal[1:] >= 0))
    crossings = rising + signal[rising] / (signal[rising] - signal[rising + 1])
    found = (len(crossings) - 1) / ((crossings[-1] - crossings[0]) * step)
    assert found == pytest.approx(np.sqrt(square[k]) / (2 * np.pi), rel=3e-6)


@pytest.mark.parametrize(("precision", "most"), [("float64", 1e-5), ("float32", 1e-4)])
def test_energy_balance_of_a_drive_with_masses_on_every_third_link(precision, most):
    row = metrics(attached(*THIRD, gravity=-9.81), precision=precision)
    assert abs(row["energy_residual_relative"]) < most


@pytest.mark.parametrize("integrator", ["leapfrog", "rk4"])
def test_halving_the_step_changes_little_where_contacts_damp_much(integrator):
    # a damper of 2 m / h of the lightest roller: each roller's own mass centers it in time, or bounds it
    values = {"contact.sprocket.law": "kelvin-voigt", "contact.sprocket.restitution": 0.01}
    drive = attached(*THIRD, gravity=-9.81, integrator=integrator, step=4e-6, duration=0.1).with_values(values)
    whole, half = metrics(drive), metrics(drive, step=2e-6)
    assert abs(whole["energy_residual_relative"]) < 1e-4
    assert whole["tension_mean"] == pytest.approx(half["tension_mean"], rel=1e-3)
    assert whole["driven.dissipated"] == pytest.approx(half["driven.dissipated"], rel=0.05)


def test_settling_and_statics_weigh_each_mass():
    # a slack strand at rest: the difference of its ends' vertical pulls is the weight between them; the gradient of the
    # energy, by no kernel, is nothing in that state
    drive = attached(*THIRD, speed=0.0, torque=0.0, gravity=-9.81, span=19.98)
    packed = pack([drive], [Schedule(5e-6, 1, 1, 1, 0)])
    engine, _ = settling(packed, 0.3 * step_limit(drive), 1e-8, 1_000_000)
    assert engine.settling_states()["settled"][0] == 1
    place, masses = state(engine)[:2].T, drive.chain.roller_masses
    side = np.roll(place, -1, axis=0) - place
    pull = 5e7 * (np.hypot(*side.T) - 0.05)
    force = pull[:, None] * side / np.hypot(*side.T)[:, None]
    low = np.flatnonzero((place[:, 1] < 0) & (np.abs(place[:, 0] - 0.5) < 0.4))
    first, last = low.min(), low.max()
    weight = 9.81 * masses[first : last + 1].sum()
    assert force[last, 1] - force[first - 1, 1] == pytest.approx(weight, rel=1e-5)  # settled to 1e-8 of a tension
    potential = Potential(single_chain(drive), 0.0, np.zeros(2))
    x = np.zeros(potential.size)
    rollers, centers, angles = potential.parts_of_coordinates(x)
    rollers[:], centers[:], angles[:] = place, packed.bodies["center"], packed.bodies["angle"]
    assert np.abs(potential.terms(x).gradient[: 2 * len(place)]).max() < 1e-6 * pull.max()


def test_check_counts_the_mean_mass_and_the_lightest():
    drive = attached(*THIRD)
    mean = 1.0 + 4.0 / 3.0
    assert drive.chain.mass == pytest.approx(mean, rel=1e-15)
    # 20 teeth at 10 rad/s: m' v^2 with v = p z omega / (2 pi)
    assert at_work(single_chain(drive)).centrifugal == pytest.approx(
        mean * 0.05 * (200.0 / (2 * np.pi)) ** 2, rel=1e-12
    )
    heavy = two_sprockets(mass=mean)
    # free rollers between like links and contacts: the limit is the bare roller's, as without attachments
    assert highest_frequency(drive) > highest_frequency(heavy)


@pytest.mark.parametrize(
    ("rows", "line"),
    [
        ([{"mass": -1.0}], "chain.attachments.0.mass = -1.0: must be a number of at least 0"),
        ([{"every": 0, "mass": 1.0}], "chain.attachments.0.every = 0: must be an integer of at least 1"),
        (
            [{"every": 3, "mass": 1.0, "first": 60}],
            "chain.attachments.0.first = 60: must be below the number of links, 60",
        ),
        ([{"every": 3}], "chain.attachments.0.mass: missing; must be a number of at least 0"),
        ([{"mass": 1.0, "links": 3}], "chain.attachments.0.links = 3: unknown key; "),
    ],
)
def test_what_is_wrong_is_one_line(rows, line):
    with pytest.raises(DriveError) as caught:
        attached(*rows)
    assert line in str(caught.value)
    assert "\n" not in str(caught.value)


def test_files_keep_them():
    drive = attached(*THIRD, {"mass": 1.0, "first": 5})
    assert loads_drive(dumps_drive(drive)) == drive
