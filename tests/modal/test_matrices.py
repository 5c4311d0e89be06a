"""Stiffness and damping by differences against closed forms of a lumped strand, and against plain differences."""

import numpy as np
import pytest
from drives import example, of_long, two_sprockets
from raw import chain
from tensioner_rig import oil_modulus

from warpchain.engine.force_probe import ForceProbe
from warpchain.modal.eigenmodes import eigenpairs
from warpchain.modal.matrices import (
    MOST_VELOCITY_STEP,
    damping_matrix,
    free_coordinates,
    leakage_matrix,
    separate_roller_sets,
    stiffness_matrix,
    travel_matrix,
)
from warpchain.modal.small_motion import drive_motion, oil_conductances, standing_chains
from warpchain.model import single_chain
from warpchain.model.oil import static_pressure

MASS, PITCH, STIFFNESS, DAMPING, TENSION = 0.7, 0.05, 2e7, 300.0, 900.0
LENGTH = PITCH + TENSION / STIFFNESS


@pytest.fixture(scope="module")
def strand():
    """K and C of `n` rollers between two that are held, at tension T: the way out of a chain that lies out and back."""

    def made(n):
        place = np.concatenate([np.arange(n + 2), np.arange(n, 0, -1)])[:, None] * [LENGTH, 0.0]
        packed = chain(
            place, np.zeros_like(place), mass=MASS, pitch=PITCH, stiffness=STIFFNESS, damping=DAMPING, step=1.0, steps=1
        )
        packed.drives["sprockets"] = packed.drives["bodies"] = 0
        probe = ForceProbe(packed)
        at = free_coordinates(probe, probe.packed_state())
        inner = slice(2, 2 * n + 2)
        pair = (
            stiffness_matrix(probe, at, probe.packed_state(), PITCH),
            damping_matrix(probe, at, probe.packed_state()),
            at.mass_matrix,
        )
        probe.close()
        return [matrix[inner, inner] for matrix in pair]

    return made


@pytest.mark.parametrize("n", [9, 10, 11, *of_long(80)])
def test_a_strand_has_the_frequencies_of_its_lumps(strand, n):
    """(1/pi) sqrt(T / (m p)) sin(k pi / (2 (n + 1))) across, (1/pi) sqrt(k / m) sin(...) along.

    Rounding in a link's force, k eps p, over the step of 1e-7 p is 2e-9 of k, or 5e-5 of T / p; of its square root
    half as much in a mode that feels it all, less in others.
    """
    k, c, m = strand(n)
    value, _ = eigenpairs(m, 0.0 * c, k, n, np.sqrt(STIFFNESS / MASS) / n)
    found = np.abs(value) / (2 * np.pi)
    sines = np.sin(np.arange(1, n + 1) * np.pi / (2 * (n + 1))) / np.pi
    across, along = np.sqrt(TENSION / (MASS * LENGTH)) * sines, np.sqrt(STIFFNESS / MASS) * sines
    expected = np.sort(np.concatenate([across, along]))[: len(found)]
    assert np.allclose(np.sort(found)[: len(expected)], expected, rtol=1e-5)
    assert len(found) >= n


def test_links_damp_along_only(strand):
    """Along: zeta = c omega / (2 k); across, none: 300 N s/m against a velocity step's rounding, 1e-9 of it."""
    n = 12
    k, c, m = strand(n)
    value, _ = eigenpairs(m, c, k, n, np.sqrt(STIFFNESS / MASS) / n)
    size, ratio = np.abs(value), -value.real / np.abs(value)
    along = 2.0 * np.sqrt(STIFFNESS / MASS) * np.sin(np.arange(1, n + 1) * np.pi / (2 * (n + 1)))
    for omega in along:
        one = np.argmin(np.abs(size - omega))
        assert size[one] == pytest.approx(omega, rel=1e-6)
        assert ratio[one] == pytest.approx(DAMPING * omega / (2 * STIFFNESS), rel=1e-5)
    across = size < 2.0 * np.sqrt(TENSION / (MASS * LENGTH))
    assert across.sum() >= n
    assert np.abs(ratio[across]).max() < 1e-8


@pytest.mark.parametrize("share", [0.0, 0.3, 0.6])
def test_a_strand_that_travels_swings_as_a_travelling_string(strand, share):
    """f_n = n (c^2 - v^2) / (2 L c), c^2 = T / m_l; lumps of L / 81 miss by (n pi / 81)^2 / 24 and the like."""
    n = 80
    k, c, m = strand(n)
    wave = np.sqrt(TENSION * LENGTH / MASS)
    speed = share * wave
    rate = speed / LENGTH
    # what `modal.small_motion` does to links, eq. (a): their force on straight strands is -m f^2 D2
    second = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    k = k - MASS * rate**2 * np.kron(second, np.eye(2))
    travel = travel_matrix(n, MASS, rate, np.arange(n) < n - 1, 2 * n)
    value, _ = eigenpairs(m, travel, type(m)(k), 3, 2 * np.pi * wave / (2 * n * LENGTH))
    length = (n + 1) * LENGTH
    expected = np.arange(1, 4) * (wave**2 - speed**2) / (2 * length * wave)
    assert np.allclose(np.abs(value[:3]) / (2 * np.pi), expected, rtol=2e-3)


def test_rollers_moved_together_are_three_apart():
    for n in range(9, 16):
        sets = separate_roller_sets(n)
        assert sorted(np.concatenate(sets)) == list(range(n))
        for some in sets:
            gaps = np.diff(np.append(some, some[0] + n))
            assert gaps.min() >= 3


def plain(at, probe, base, moved, steps):
    """The derivative of the forces column by column, without any of its structure."""
    change = np.diag(steps)
    both = at.generalized_forces(probe, moved(base, np.concatenate([change, -change])))
    return -0.5 * ((both[: at.coordinate_count] - both[at.coordinate_count :]) / steps[:, None]).T


@pytest.mark.parametrize("mount", ['{ kind = "fixed" }', '{ kind = "slider", direction = [1.0, 0.3], stiffness = 1e6,'
                                   ' damping = 500.0 }', '{ kind = "elastic", stiffness = [1e7, 2e7], damping = [100.0,'
                                   ' 0.0] }'], ids=["fixed", "slider", "elastic"])  # fmt: skip
def test_structure_changes_nothing(mount):
    """Against plain differences: a step in x of 2^-25 m leaves 1e-8 of k, and no contact is just closed."""
    import tomllib

    kind = tomllib.loads(f"mount = {mount}")["mount"]
    drive = two_sprockets(torque=100.0, links=58, span=19.03).with_values(
        {
            "sprockets.driven.mass": 5.0,
            "sprockets.driven.mount": kind,
            "sprockets.driven.balance_wheel": {"mass": 0.5, "radius": 0.1, "phase": 0.4},
        }
    )
    ((_, _, packed, _),) = standing_chains(drive)
    probe = ForceProbe(packed)
    try:
        base = probe.packed_state()
        at = free_coordinates(probe, base)
        step = 2.0**-25
        k = plain(at, probe, base, at.displaced_states, np.full(at.coordinate_count, step))
        c = plain(at, probe, base, at.moving_states, np.full(at.coordinate_count, MOST_VELOCITY_STEP))
        own = stiffness_matrix(probe, at, base, drive.chain.pitch).toarray()
        assert at.coordinate_count - 2 * at.rollers == {"fixed": 1, "slider": 2, "elastic": 3}[kind["kind"]]
        assert np.abs(own - k).max() < 1e-6 * np.abs(k).max()
        assert np.abs(damping_matrix(probe, at, base).toarray() - c).max() < 1e-6 * np.abs(c).max()
        assert np.abs(c).max() > 0.0
    finally:
        probe.close()


DRAG = 2.0 * np.log(2.0) / np.hypot(np.pi, np.log(2.0)) * np.sqrt(2e8)


@pytest.mark.parametrize(
    ("values", "damper"),
    [
        ({}, lambda force: 0.75**2 * force / 0.02),
        ({"impact_speed_floor": 1e-8}, lambda force: 0.75**2 * force / 1e-8),
        ({"law": "flores", "restitution": 1e-3}, lambda force: 1.6 * 999.0 * force / 0.02),
        ({"law": "kelvin-voigt"}, lambda force: np.full_like(force, DRAG)),
    ],
    ids=["floor", "low floor", "much", "viscous"],
)
def test_contacts_damp_along_their_normals(values, damper):
    """C = sum of c g g': g the closing speed of a contact for a unit of each coordinate, c = d F / v_min or the law's
    own. A roller is pressed by F along the normal n against what its two links pull."""
    drive = two_sprockets(links=58, span=19.03, torque=100.0, damping=0.0)
    (found,) = drive_motion(
        drive.with_values({f"contact.sprocket.{name}": value for name, value in values.items()})
    ).parts
    place = found.state.position[0]
    along = np.roll(place, -1, axis=0) - place
    pull = found.tension[:, None] * along / np.hypot(*along.T)[:, None]
    push = np.roll(pull, 1, axis=0) - pull
    force = np.hypot(*push.T)
    on = np.flatnonzero(force > 0.1)
    normal, lever = push[on] / force[on, None], place[on] - drive.sprockets[1].center
    closing = np.zeros((len(on), found.at.coordinate_count))
    closing[np.arange(len(on)), 2 * on], closing[np.arange(len(on)), 2 * on + 1] = -normal.T
    turning = lever[:, 0] * normal[:, 1] - lever[:, 1] * normal[:, 0]
    closing[:, -1] = np.where(found.layout.arc[on] == 1, turning, 0.0)
    expected = closing.T @ (damper(force[on])[:, None] * closing)
    assert len(on) > 20
    assert np.abs(found.damping.toarray() - expected).max() < 1e-5 * np.abs(expected).max()


def test_structure_changes_nothing_for_arms_and_oil():
    """As above, of the example `car`: an arm that carries a curved guide, and a chamber
    of oil, whose damper forces do not show. Steps of 2^-30 m and 2^-26 rad."""
    drive = example("car")
    (found,) = drive_motion(drive).parts
    probe = ForceProbe(found.packed)
    try:
        base, at = probe.packed_state(), found.at
        steps = np.full(at.coordinate_count, 2.0**-30)
        steps[2 * at.rollers : at.oil_start] = 2.0**-26
        k = plain(at, probe, base, at.displaced_states, steps)
        c = plain(at, probe, base, at.moving_states, np.full(at.coordinate_count, MOST_VELOCITY_STEP))
        assert np.abs(found.stiffness.toarray() - k).max() < 1e-6 * np.abs(k).max()
        c += leakage_matrix(probe, at, oil_conductances(single_chain(drive), "shut")).toarray()
        assert np.abs(found.damping.toarray() - c).max() < 1e-6 * np.abs(c).max()
        arm, oil = at.oil_start - 1, at.oil_start
        assert at.coordinate_count == oil + 1
        assert found.stiffness[arm, oil] == pytest.approx(at.strokes[0, arm] * found.stiffness[oil, oil], rel=1e-6)
        (part, *_), x = drive.tensioners, found.extension[0]
        held = oil_modulus(part, static_pressure(part)) * part.area**2 / (part.chamber.volume + part.area * x)
        assert held == pytest.approx(found.stiffness[oil, oil], rel=1e-5)
    finally:
        probe.close()
