"""The steady state that `check` prints: derivatives of its energy, balances in closed form, and what a run shows."""

import math

import numpy as np
import pytest
from assemblies import differences
from blocks import folded
from drives import SPRUNG, example, jointed_blade, two_sprockets
from scipy.linalg import eig

from warpchain import Drive, Record, loads_drive, simulate
from warpchain.assembly import assemble
from warpchain.assembly.frequencies import moving_frequency, strand_frequency
from warpchain.assembly.potential import Potential
from warpchain.assembly.statics import _assembled_coordinates, _coordinate_name, _Solver, at_rest, at_work, load_moments
from warpchain.assembly.summary import derived_quantities, report
from warpchain.model import Model, single_chain

ISO = {"contact.sprocket.profile": "iso606", "contact.sprocket.gap": "maximum"} | {
    f"contact.sprocket.{key}": None for key in ("clearance", "seat_angle")
}


def pair(**options):
    """Two sprockets of 20 teeth, taut, fixed: teeth pass at 3.2 Hz, far below the strands' first 13 Hz or more, and
    what links damp soon dies away, so that a run of it hardly vibrates."""
    return two_sprockets(span=20.05, speed=1.0, mass=0.2, ramp=0.05, load_ramp=0.05, **options)


def engine():
    return example("engine")


@pytest.mark.parametrize("changes", [{}, ISO | {"contact.guide.exponent": 1.5}])
def test_derivatives_are_those_of_the_energy(changes):
    """Central differences at a state that is bent at random: seats, flanks, tips, the bar's face and ends all press.
    Their error is d^2 times a third derivative, which within a gap is force / clearance^2: 1e-4 of the largest."""
    drive = engine().with_values(changes)
    potential, assembly = Potential(single_chain(drive), 1000.0, np.array([0.0, 0.0, 3.0, 4.0, 0.0])), assemble(drive)
    x = np.concatenate([assembly.position.ravel(), potential.home.ravel(), assembly.sprocket_angle])
    x += np.random.default_rng(3).normal(size=len(x)) * 3e-4
    terms = potential.terms(x)
    slope, curvature = map(np.array, zip(*(differences(potential, x, i) for i in range(len(x))), strict=True))
    assert np.abs(slope - terms.gradient).max() < 1e-4 * np.abs(terms.gradient).max()
    whole = terms.hessian([(np.arange(len(x)), np.ones(len(x)))], len(x)).toarray()
    assert np.abs(curvature - whole).max() < 1e-4 * np.abs(whole).max()
    assert np.abs(whole - whole.T).max() < 1e-12 * np.abs(whole).max()


@pytest.mark.parametrize("drive", [Drive(**jointed_blade()), folded()[0]], ids=["guides", "sprocket"])
def test_derivatives_by_angles_of_arms_on_arms(drive):
    """Central differences along what arms carry with them, of a state in which guides and teeth press: as above."""
    assembly = assemble(drive)
    potential = Potential(
        single_chain(drive),
        50.0,
        load_moments(single_chain(drive), Model(drive).driver_speed),
        laid=assembly.sprocket_angle,
    )
    solver, d = _Solver([potential], [assembly]), 1e-6

    def at(x):
        potential.move_carried(x)
        solver._move_levers(x)
        terms = solver._terms(x)
        return terms, terms.gradient_of_coordinates(solver.maps, solver.count)

    x = _assembled_coordinates(potential, assembly)
    x[potential.first_arm : potential.first_pivot] += 0.02
    x[: 2 * potential.rollers] += np.random.default_rng(0).normal(size=2 * potential.rollers) * 1e-5
    terms, slope = at(x)
    whole = terms.hessian(solver.maps, solver.count).toarray()
    for column in solver.maps[0][0][potential.first_arm : potential.first_pivot]:
        way = sum(weight * (of == column) for of, weight in solver.maps)
        (after, up), (before, down) = at(x + d * way), at(x - d * way)
        at(x)
        assert (after.energy - before.energy) / (2 * d) == pytest.approx(slope[column], rel=1e-6)
        assert (up - down) / (2 * d) == pytest.approx(whole[:, column], abs=1e-6 * np.abs(whole[:, column]).max())
    assert np.abs(whole - whole.T).max() < 1e-12 * np.abs(whole).max()


def test_tension_rises_by_the_load_over_the_mean_lever():
    """A turn takes z links by, tight ones in and slack ones out: with what they store, 2 pi M =
    z [(T_t - T_s) p + (T_t^2 - T_s^2) / (2 k)]. Four states within a pitch average its ripple: 3e-4."""
    drive = pair(viscous=5.0)
    steady = at_work(single_chain(drive))
    assert steady.failure is None
    slack, tight = steady.tension
    work = 20 * ((tight - slack) * 0.05 + (tight**2 - slack**2) / (2.0 * 5e7))
    assert work == pytest.approx(2.0 * math.pi * (300.0 + 5.0 * 1.0), rel=3e-4)
    assert load_moments(single_chain(drive), 1.0) == pytest.approx([0.0, 305.0])
    assert steady.centrifugal == pytest.approx(0.2 * 0.05 * (1.0 * 20 / (2 * math.pi)) ** 2)


def test_a_slider_bears_on_the_chain_with_its_preload():
    """Along the slide preload less spring equals the pull of both strands less m v^2 / p each; 1 %: strands turn by
    up to half a pitch's rise as the polygon turns, and the mean of products is not that of the means."""
    drive = engine()
    mount, steady = drive.sprockets[1].mount, at_work(single_chain(drive))
    path, pull = assemble(drive).path, 0.0
    for strand, away in ((0, -1.0), (1, 1.0)):
        x = path.strand_end[strand] - path.strand_start[strand]
        pull += (steady.tension[strand] - steady.centrifugal) * away * x[0] / np.hypot(*x)
    travel = drive.sprockets[1].center[0] - steady.center[1, 0]
    assert pull == pytest.approx(mount.preload - mount.stiffness * travel, rel=0.01)


def test_a_slack_strand_carries_its_weight():
    """Flat catenary at rest, sag f << C: T = m g C^2 / (8 p f) at its lowest; 3 %: links of finite length, slopes at
    the ends."""
    drive = two_sprockets(span=19.98, gravity=-9.81, torque=0.0)
    steady = at_rest(single_chain(drive))
    sag = np.abs(steady.displacement)
    length = 19.98 * 0.05
    for k in (0, 1):
        assert steady.tension[k] == pytest.approx(9.81 * length**2 / (8 * 0.05 * sag[k]), rel=0.03)


@pytest.mark.parametrize("changes", [{}, {"chain.elongation": 2e-4}, ISO])
def test_a_quiet_run_shows_these_tensions(changes):
    """Slow and damped, so that nothing but the energy's minimum is left; 2 % of the tightest strand: contact dampers
    hold entering rollers back a little."""
    drive = pair().with_values(changes)
    (row,) = simulate(drive, record=Record("none"), duration=0.95, window=(0.322, 0.95)).metrics.to_pylist()
    found = np.array([row[f"{name}.tension_mean"] for name in drive.strand_names])
    steady = at_work(single_chain(drive))
    assert steady.failure is None
    assert steady.tension == pytest.approx(found, abs=0.02 * found.max())


@pytest.mark.parametrize(("name", "step", "start", "end"), [("engine", 1e-6, 0.05, 0.1), ("industrial", 4e-6, 0.4, 0.5),
    ("marine", 1e-5, 0.6, 1.2), ("motorcycle", 2e-6, 0.07, 0.12)])  # fmt: skip
def test_examples_run_at_what_check_prints(name, step, start, end):
    """Each strand within 15 % of the tightest one's mean; friction and vibration add 1 to 3 %, 14 to the marine drive
    (docs/solving.md)."""
    drive = example(name).with_values({"run.step": step})
    (row,) = simulate(drive, record=Record("none"), duration=end, window=(start, end)).metrics.to_pylist()
    found = np.array([row[f"{strand}.tension_mean"] for strand in drive.strand_names])
    strands = derived_quantities(drive)["strands"]
    assert [strand["working_tension"] for strand in strands] == pytest.approx(found, abs=0.15 * found.max())


def test_the_report_says_where_it_only_estimates():
    """Two drivers of unlike speeds lead no chain steadily."""
    drive = two_sprockets().with_values({"sprockets.driven.prescribed.speed": 11.0, "sprockets.driven.load": None})
    values = derived_quantities(drive)
    assert values["tensions_estimated"] == '"driver" and "driven" lead the chain at unlike speeds'
    assert "ESTIMATES, without seats, mounts and weight" in report(values)
    assert all(
        strand["working_tension"] > 0.0 and strand["working_displacement"] is None for strand in values["strands"]
    )
    assert "ESTIMATES" not in report(derived_quantities(pair()))


def test_the_longest_chains_are_only_estimated():
    values = derived_quantities(two_sprockets(links=2200, span=1090.02))
    assert values["tensions_estimated"] == "not sought for a chain of more than 2000 links"
    assert values["standing_preload"] == pytest.approx(values["preload"])


@pytest.mark.parametrize("ratio", [0.0, 0.3, 0.8])
def test_frequencies_of_a_moving_string(ratio):
    """Against the eigenvalues of w_tt + 2 v w_xt - (c^2 - v^2) w_xx = 0 in 40 sines (Galerkin, gyroscopic term exact):
    the sines converge as 1 / n^3, 1e-3 for modes 1 and 2."""
    drive = two_sprockets()
    length, tension, n = 1.0, 2000.0, 40
    wave = math.sqrt(tension * 0.05)
    v = ratio * wave
    j, k = np.meshgrid(np.arange(1, n + 1), np.arange(1, n + 1), indexing="ij")
    odd = (j + k) % 2 == 1
    gyro = np.where(odd, 8.0 * v * j * k / np.where(odd, j * j - k * k, 1) / length, 0.0)
    stiff = np.diag((wave**2 - v**2) * (np.arange(1, n + 1) * np.pi / length) ** 2)
    zero, one = np.zeros((n, n)), np.eye(n)
    rates = eig(np.block([[zero, one], [-stiff, -gyro]]), right=False).imag
    found = np.sort(rates[rates > 0]) / (2 * np.pi)
    for mode in (1, 2):
        assert moving_frequency(single_chain(drive), length, tension, v, mode) == pytest.approx(
            found[mode - 1], rel=1e-3
        )
    assert moving_frequency(single_chain(drive), length, tension, wave) == 0.0


def test_at_rest_both_frequencies_agree():
    """Many links: sin(x) = x (1 - x^2 / 6), x = pi / 800: 3e-6."""
    drive = two_sprockets()
    assert moving_frequency(single_chain(drive), 400 * 0.05, 500.0, 0.0) == pytest.approx(
        strand_frequency(single_chain(drive), 400, 500.0), rel=3e-6
    )


def test_where_no_equilibrium_is_found_it_says_why_and_what_to_do():
    """A rail that pushes its strand out by 1.4 pitches, which the layout tells of, holds rollers with kN where the
    chain pulls 49 N. A sprocket turned by a tooth has lost its chain."""
    drive = loads_drive(SPRUNG)
    failure = at_rest(single_chain(drive)).failure
    assert failure.startswith("at rest no equilibrium was found: after 400 steps ")
    assert 'N are left on a roller of strand "cam->crank"' in failure and "(warpchain fit)" in failure
    still = two_sprockets()
    assembly, potential = assemble(still), Potential(single_chain(still), 0.0, np.zeros(2))
    solver = _Solver([potential], [assembly])
    x = _assembled_coordinates(potential, assembly)
    x[potential.first_arm - 1] += 2.0 * math.pi / 20
    assert solver.failure(x, math.inf) == (
        'the chain does not stay on the teeth of "driven": take more preload or wrap (warpchain fit), or less load'
    )
    parts = {_coordinate_name(potential, assembly, i) for i in range(potential.size)}
    assert parts == {
        'a roller on "driver"', 'a roller on "driven"', 'a roller of strand "driver->driven"',
        'a roller of strand "driven->driver"', 'sprocket "driver"', 'sprocket "driven"',
    }  # fmt: skip
