"""Worn chains: links of their own length in kernels and assembly, rollers that climb the flanks, what is refused."""

import math

import numpy as np
import pytest
from assemblies import link_lengths, strand_of_link, strand_rollers
from drives import errors_of, marine_values, put, two_sprockets
from hypothesis import assume, given
from hypothesis import strategies as st
from layouts import PITCH, Placed, drive_of
from raw import chain, run, state

from warpchain import Record, simulate
from warpchain.assembly import assemble
from warpchain.assembly.arm_balance import chain_path
from warpchain.assembly.summary import derived_quantities, report
from warpchain.drive import dumps_drive, loads_drive
from warpchain.errors import DriveError
from warpchain.model import single_chain

pytestmark = pytest.mark.filterwarnings("ignore:chain.links:UserWarning")

PLACED = [Placed(20, (0.0, 0.0)), Placed(13, (20.3 * PITCH, 0.01)), Placed(9, (5.1 * PITCH, 9.2 * PITCH))]


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_links_at_their_own_lengths_pull_nothing(precision):
    # a convex polygon of unlike sides, each the length of its link: nothing moves; with a neighbor's length it would
    rng = np.random.default_rng(3)
    angle = np.sort(rng.uniform(0, 2 * np.pi, 24))
    corners = np.stack([2.0 * np.cos(angle), 1.3 * np.sin(angle)], axis=1)
    packed = chain(corners, np.zeros_like(corners), mass=1.0, pitch=0.1, stiffness=1e6, step=1e-5, steps=500,
                   precision=precision)  # fmt: skip
    packed.lengths[:] = np.hypot(*(np.roll(corners, -1, axis=0) - corners).T)
    engine, _ = run(packed)
    # float32 rounds the lengths: k 1e-7 m for 500 steps is at most 1e-6 m
    assert np.abs(state(engine)[:2].T - corners).max() < (1e-13 if precision == "float64" else 1e-6)
    packed.lengths[:] = np.roll(packed.lengths, 1)
    engine, _ = run(packed)
    assert np.abs(state(engine)[:2].T - corners).max() > 1e-2


def worn(sprockets, pick, elongation, links):
    """A drive with a worn chain that fits: common elongation, and links (index, elongation) of their own."""
    values = {"chain.elongation": elongation, "chain.links": 100}
    drive = drive_of(sprockets, 100).with_values(values)
    fitting = chain_path(single_chain(drive)).fitting_links()
    count = fitting[round(pick * (len(fitting) - 1))]
    table = [{"link": i % count, "elongation": e} for i, e in links]
    return drive.with_values({"chain.links": count, "chain.worn_links": table})


@given(
    st.floats(0.0, 1.0), st.floats(0.0, 0.03), st.dictionaries(st.integers(0, 40), st.floats(-0.04, 0.04), max_size=4)
)
def test_every_strand_closes_with_its_own_links(pick, elongation, links):
    # taut: every strand link strained alike; slack: every one at its own length; arcs without force, but for own links
    drive = worn(PLACED, pick, elongation, sorted(links.items()))
    try:
        assembly = assemble(drive)
    except DriveError:
        assume(False)
    natural, found, strand = drive.chain.link_lengths, link_lengths(assembly), strand_of_link(assembly)
    in_strand = strand >= 0
    if assembly.strain >= 0 or 1 not in assembly.strand_links:
        expected = natural[in_strand] * (1 + max(assembly.strain, 0.0))
        np.testing.assert_allclose(found[in_strand], expected, rtol=0, atol=1e-9 * PITCH)
    np.testing.assert_allclose(found[~in_strand], drive.chain.worn_pitch, rtol=0, atol=1e-10 * PITCH)
    for k, count in enumerate(assembly.strand_links):
        rollers = strand_rollers(assembly, k)
        first = assembly.strand_first[k]
        if count > 1 or assembly.strain >= 0:
            length = natural[(first + np.arange(count)) % len(natural)].sum()
            chord = np.hypot(*(rollers[-1] - rollers[0]))
            assert chord == pytest.approx(length * (1 + assembly.strain), abs=1e-9 * PITCH)


@pytest.mark.usefixtures("device")
def test_a_worn_chain_stands_off_its_seats_without_force():
    drive = worn(PLACED, 0.5, 0.02, [])
    assembly = assemble(drive)
    for s in range(3):
        arm = assembly.position[assembly.seat_sprocket == s] - drive.sprockets[s].center
        np.testing.assert_allclose(np.hypot(*arm.T), 1.02 * single_chain(drive).pitch_radius(s), rtol=1e-12)
    small = worn(PLACED, 0.5, 0.0, []).with_values({"sprockets.s1.pitch": PITCH / 1.01})
    assert single_chain(small).riding_radius(1) == pytest.approx(1.01 * single_chain(small).pitch_radius(1), rel=1e-12)
    arc = strand_of_link(assemble(small)) < 0
    np.testing.assert_allclose(link_lengths(assemble(small))[arc], PITCH, rtol=1e-12)


@given(st.floats(0.0, 1.0), st.floats(1e-4, 0.03), st.floats(0.0, 0.01))
def test_outer_links_span_more_than_a_tooth_and_inner_ones_less(pick, outer, elongation):
    # all rollers of an arc at one radius, every link of it at its own length: the chain starts without force on arcs
    fitting = chain_path(
        single_chain(drive_of(PLACED, 100).with_values({"chain.outer": {"elongation": outer}}))
    ).fitting_links()
    even = [links for links in fitting if links % 2 == 0]
    count = even[round(pick * (len(even) - 1))]
    values = {"chain.outer": {"elongation": outer}, "chain.elongation": elongation, "chain.links": count}
    drive = drive_of(PLACED, 100).with_values(values)
    try:
        assembly = assemble(drive)
    except DriveError:
        assume(False)
    natural, found, strand = drive.chain.link_lengths, link_lengths(assembly), strand_of_link(assembly)
    np.testing.assert_allclose(found[strand < 0], natural[strand < 0], rtol=0, atol=1e-10 * PITCH)
    if assembly.strain >= 0:
        taut = natural[strand >= 0] * (1 + assembly.strain)
        np.testing.assert_allclose(found[strand >= 0], taut, rtol=0, atol=1e-9 * PITCH)
    for s, sprocket in enumerate(drive.sprockets):
        held = np.flatnonzero(assembly.seat_sprocket == s)
        arm = assembly.position[held] - sprocket.center
        np.testing.assert_allclose(np.hypot(*arm.T), single_chain(drive).riding_radius(s), rtol=1e-12)
        seat = assembly.sprocket_angle[s] + assembly.seat_index[held] * 2 * math.pi / sprocket.teeth
        off = np.angle(np.exp(1j * (np.arctan2(arm[:, 1], arm[:, 0]) - seat)))
        np.testing.assert_allclose(
            off, sprocket.sign * single_chain(drive).riding_lean(s) * np.where(held % 2, 1, -1), atol=1e-12
        )


def test_worn_outer_links_settle():
    radial, metrics = climbed(0.01, outer=0.02)
    assert metrics["settle_residual"] <= 1e-3
    assert metrics["settle_steps"] < 10_000
    assert radial.max() == pytest.approx(0.01, rel=0.3)
    assert metrics["tension_max"] < 1.5e3


def test_worn_outer_links_start_without_force_on_arcs():
    # unsettled; with rollers a mean pitch apart each link there was off by 1 % of a pitch: k p / 100 = 25 kN
    drive = two_sprockets(span=20.0 * 1.01 + 0.001, settle="false").with_values({"chain.outer": {"elongation": 0.02}})
    run = simulate(drive, duration=1e-4, record=Record(channels=["tension"]))
    arc = strand_of_link(assemble(drive)) < 0
    assert np.abs(run[0].tension[0, arc]).max() < 1e-3  # k times the round-off of positions


def test_a_slack_chain_without_weight_settles():
    # the sprockets held, it has drawn itself free of them, and no force is left to measure what round-off leaves by
    drive = two_sprockets(span=20.0 * (1 + 1e-4))
    metrics = simulate(drive, duration=1e-4, record=Record("none")).metrics.to_pylist()[0]
    assert metrics["settle_steps"] < 50_000
    assert metrics["settle_force"] <= 1e-3 * 5e7 * 1e-9


def climbed(elongation, links=(), outer=None):
    """Rollers of the driver after settling: radius over the pitch radius, less one; and the run's metrics.

    The chain is longer by `elongation`: all links, or with `outer` the outer ones alone by that.
    """
    wear = {"chain.elongation": elongation} if outer is None else {"chain.outer": {"elongation": outer}}
    drive = two_sprockets(
        span=20.0 * (1 + elongation) + 0.001, torque=100.0, gravity=-9.81, duration=0.005
    ).with_values(wear | {"chain.worn_links": [{"link": i, "elongation": e} for i, e in links]})
    run = simulate(drive, record=Record(rate=1000.0))
    arm = run[0].position[0] - run[0].sprocket_center[0, 0]
    radius, angle = np.hypot(*arm.T), np.arctan2(arm[:, 1], arm[:, 0])
    return (radius / single_chain(drive).pitch_radius(0) - 1)[np.abs(angle) > 0.6 * math.pi], run.metrics.to_pylist()[0]


@pytest.mark.parametrize("elongation", [0.01, 0.02])
def test_rollers_climb_by_the_elongation(elongation):
    # settled: one or two rollers near their seats, from them both ways up to where longer links span a tooth each,
    # R (1 + elongation); a new chain stays within the clearance and what links stretch, 1.5e-3 R
    radial, metrics = climbed(elongation)
    new, _ = climbed(0.0)
    assert metrics["settle_residual"] <= 1e-3
    assert np.abs(new).max() < 1.5e-3
    assert radial.max() == pytest.approx(elongation, rel=0.15)
    assert radial.min() < 0.3 * elongation
    assert (radial > 0.5 * elongation).sum() >= 3


def test_one_worn_link_on_an_arc_settles():
    # link 4 joins the fifth and sixth roller on the driver: it starts compressed by 2 % of a pitch, 50 kN
    radial, metrics = climbed(0.0, [(4, 0.02)])
    assert metrics["settle_residual"] <= 1e-3
    assert radial.max() > 2e-3
    assert metrics["tension_max"] < 5e3


@pytest.mark.usefixtures("device")
def test_energy_balance_of_a_worn_chain():
    # the residual is of the step's order, as for a new chain (2e-3 at 2e-6 s)
    drive = two_sprockets(span=20.0 * 1.01 + 0.001, step=2e-6, duration=0.3).with_values({"chain.elongation": 0.01})
    values = simulate(drive, record=Record("none")).metrics.to_pylist()[0]
    assert abs(values["energy_residual_relative"]) < 2e-3
    assert values["driver.dissipated"] > 0.0


def test_a_chain_that_would_ride_over_the_tips_is_refused():
    drive = two_sprockets().with_values({"chain.elongation": 0.09})
    limit = single_chain(drive).tip_radius(0) * 2 * math.sin(math.pi / 20)
    with pytest.raises(DriveError, match=r'^sprocket "driver": links of 0\.0545 m would ride over its tips') as caught:
        assemble(drive)
    assert str(caught.value).endswith(f"allowed are links of at most {limit:.6g} m")


@pytest.mark.parametrize(
    ("path", "value", "line"),
    [
        ("chain/elongation", 0.2, "chain.elongation = 0.2: must be a number from -0.05 to 0.1"),
        ("chain/elongation", "much", 'chain.elongation = "much": must be a number from -0.05 to 0.1'),
        ("chain/worn_links", 3, "chain.worn_links = 3: must be a list of tables { link, elongation }"),
        ("chain/worn_links", [{"link": 3}], "chain.worn_links.0.elongation: missing; must be a number from -0.05"),
        (
            "chain/worn_links",
            [{"link": 162, "elongation": 0.01}],
            "chain.worn_links.0.link = 162: must be below the number of links, 162",
        ),
        (
            "chain/worn_links",
            [{"link": 1, "elongation": 0.01}, {"link": 1, "elongation": 0.02}],
            "chain.worn_links.1.link = 1: must be another link than those before",
        ),
        (
            "chain/worn_links",
            [{"link": -1, "elongation": 0.01}],
            "chain.worn_links.0.link = -1: must be an integer of at least 0",
        ),
    ],
)
def test_rules_of_wear(path, value, line):
    values = marine_values()
    put(values, path, value)
    (found,) = errors_of(values)
    assert found.startswith(line)


def test_worn_links_read_back_and_vary():
    drive = two_sprockets().with_values({"chain.worn_links": [{"link": 3, "elongation": 0.01}]})
    assert loads_drive(dumps_drive(drive)) == drive
    more = drive.with_values({"chain.worn_links.0.elongation": 0.02})
    expected = np.full(60, 0.05)
    expected[3] = 0.051
    np.testing.assert_allclose(more.chain.link_lengths, expected, rtol=1e-14)


def test_check_tells_the_wear():
    values = derived_quantities(two_sprockets(span=20.2).with_values({"chain.elongation": 0.01}))
    assert values["elongation"] == pytest.approx(0.01, rel=1e-9)
    assert values["sprockets"][0]["riding_radius"] == pytest.approx(1.01 * values["sprockets"][0]["pitch_radius"])
    assert "links of 50 mm, worn by 1 %" in report(values)
    assert "worn" not in report(derived_quantities(two_sprockets()))
