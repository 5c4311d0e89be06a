"""The initial state: rollers on seats, links of the right length, and everything moving along the path."""

import math

import numpy as np
import pytest
from assemblies import link_lengths, strand_of_link, strand_rollers
from drives import example
from hypothesis import assume, given
from hypothesis import strategies as st
from layouts import PITCH, Placed, drive_of, loops, tangles

from warpchain.assembly import assemble
from warpchain.assembly.arm_balance import chain_path
from warpchain.assembly.stack_assembly import assemble_stacks
from warpchain.errors import DriveError
from warpchain.model import single_chain
from warpchain.model.stacks import stacks_of_drives

pytestmark = pytest.mark.filterwarnings("ignore:chain.links:UserWarning")  # any number that fits, odd ones too


def turned(drive, assembly):
    """Total turning of the closed polygon of rollers."""
    link = np.roll(assembly.position, -1, axis=0) - assembly.position
    heading = np.arctan2(link[:, 1], link[:, 0])
    turn = np.roll(heading, -1) - heading
    return np.sum((turn + np.pi) % (2 * np.pi) - np.pi)


def check_seats(drive, assembly):
    """Every seated roller on its seat, in the order of travel, consecutive seats; nothing else seated."""
    seated = assembly.seat_sprocket >= 0
    np.testing.assert_array_equal(seated, assembly.seat_index >= 0)
    runs = []
    for i in np.flatnonzero(seated):
        s, j = assembly.seat_sprocket[i], assembly.seat_index[i]
        teeth = drive.sprockets[s].teeth
        assert 0 <= j < teeth
        polar = assembly.sprocket_angle[s] + j * 2 * np.pi / teeth
        seat = np.add(
            drive.sprockets[s].center, single_chain(drive).pitch_radius(s) * np.array([np.cos(polar), np.sin(polar)])
        )
        np.testing.assert_allclose(assembly.position[i], seat, rtol=0, atol=1e-12)
        if seated[i - 1] and assembly.seat_sprocket[i - 1] == s:
            assert (assembly.seat_index[i - 1] + drive.sprockets[s].sign - j) % teeth == 0
        if not runs or runs[-1] != s:
            runs.append(s)
    assert runs == list(range(len(drive.sprockets)))
    last = [np.flatnonzero(assembly.seat_sprocket == s)[-1] for s in runs]
    np.testing.assert_array_equal(assembly.strand_first, last)
    assert assembly.seat_sprocket[0] == 0
    assert assembly.strand_links.sum() + seated.sum() - len(runs) == drive.chain.links


def check_links(drive, assembly):
    """Arcs and slack strands at the pitch, taut strands strained alike; chords as the strain says."""
    pitch, strand = drive.chain.pitch, strand_of_link(assembly)
    expected = np.where(strand >= 0, pitch * (1 + max(assembly.strain, 0.0)), pitch)
    np.testing.assert_allclose(link_lengths(assembly), expected, rtol=0, atol=1e-10 * pitch)
    for k, links in enumerate(assembly.strand_links):
        rollers = strand_rollers(assembly, k)
        chord = np.hypot(*(rollers[-1] - rollers[0]))
        if links > 1 or assembly.strain >= 0:
            assert chord == pytest.approx(links * pitch * (1 + assembly.strain), abs=1e-10 * pitch)


def check_ends(drive, assembly):
    """Strands end within about half a tooth of the tangent points; a taut one's rollers stay out of the tooth gaps."""
    path = assembly.path
    for k in range(len(drive.sprockets)):
        following = (k + 1) % len(drive.sprockets)
        rollers = strand_rollers(assembly, k)
        for s, seat, point in ((k, rollers[0], path.strand_start[k]), (following, rollers[-1], path.strand_end[k])):
            assert np.hypot(*(seat - point)) < 0.65 * drive.chain.pitch
            radius = np.hypot(*(rollers - drive.sprockets[s].center).T)
            if assembly.strain >= 0:
                assert radius.min() > single_chain(drive).pitch_radius(s) - 1e-5 * drive.chain.pitch


def check_velocities(drive, assembly):
    """Seated rollers turn with their sprockets; no link of a free drive stretches faster than polygon action allows."""
    path = assembly.path
    driver = drive.driver
    travel = drive.sprockets[driver].prescribed.speed * single_chain(drive).pitch_radius(driver)
    for s, sprocket in enumerate(drive.sprockets):
        assert assembly.sprocket_speed[s] == pytest.approx(sprocket.sign * travel / single_chain(drive).pitch_radius(s))
    for i in np.flatnonzero(assembly.seat_sprocket >= 0):
        s = assembly.seat_sprocket[i]
        x, y = assembly.position[i] - drive.sprockets[s].center
        np.testing.assert_allclose(assembly.velocity[i], assembly.sprocket_speed[s] * np.array([-y, x]), atol=1e-9)
    span = np.roll(assembly.position, -1, axis=0) - assembly.position
    unit = span / np.hypot(*span.T)[:, None]
    rate = np.einsum("ij,ij->i", np.roll(assembly.velocity, -1, axis=0) - assembly.velocity, unit)
    strand = strand_of_link(assembly)
    assert np.all(np.abs(rate[strand < 0]) <= 1e-9 * (1 + travel))
    for k, links in enumerate(assembly.strand_links):
        ends = strand_rollers(assembly, k)[[0, -1]]
        first, last = assembly.strand_first[k], (assembly.strand_first[k] + links) % len(rate)
        chord = (ends[1] - ends[0]) / np.hypot(*(ends[1] - ends[0]))
        stretch = (assembly.velocity[last] - assembly.velocity[first]) @ chord
        fewest = min(drive.sprockets[k].teeth, drive.sprockets[(k + 1) % len(path.strand_length)].teeth)
        assert abs(stretch) <= travel * (1 - math.cos(1.4 * math.pi / fewest)) + 1e-12
        along = np.einsum("ij,ij->i", assembly.velocity[strand == k], unit[strand == k])
        if assembly.strain >= 0 and travel > 0:
            assert np.all(along > 0.5 * travel)


def check(drive, assembly):
    check_seats(drive, assembly)
    check_links(drive, assembly)
    check_ends(drive, assembly)
    check_velocities(drive, assembly)


def assembled(sprockets, pick, gravity=(0.0, -9.81)):
    """A drive of these sprockets with one of the numbers of links that fit, and its assembly."""
    try:
        path = chain_path(single_chain(drive_of(sprockets, 100)))
    except DriveError:
        assume(False)
    fitting = path.fitting_links()
    assume(len(fitting) > 0)
    drive = drive_of(sprockets, fitting[round(pick * (len(fitting) - 1))], gravity)
    return drive, assemble(drive)


@given(loops(), st.floats(0.0, 1.0))
def test_random_loops(sprockets, pick):
    drive, assembly = assembled(sprockets, pick)
    assert assembly.position.shape == assembly.velocity.shape == (drive.chain.links, 2)
    check(drive, assembly)
    assume(
        assembly.path.wrap_angle.max() < 1.5 * math.pi
    )  # else large neighbors' strand would pass a small one outside
    assert abs(assembly.path.turning) == 2 * math.pi
    assert turned(drive, assembly) == pytest.approx(assembly.path.turning, abs=1e-9)


@given(tangles(), st.floats(0.0, 1.0))
def test_random_tangles(sprockets, pick):
    drive, assembly = assembled(sprockets, pick)
    check(drive, assembly)
    assert turned(drive, assembly) == pytest.approx(assembly.path.turning, abs=1e-9)


@given(loops(), st.floats(0.0, 2 * math.pi))
def test_slack_strands_sag_along_gravity(sprockets, direction):
    gravity = (9.81 * math.cos(direction), 9.81 * math.sin(direction))
    _, assembly = assembled(sprockets, 1.0, gravity)
    assume(assembly.strain < -1e-6)
    for k in range(len(sprockets)):
        rollers = strand_rollers(assembly, k)
        chord = (rollers[-1] - rollers[0]) / np.hypot(*(rollers[-1] - rollers[0]))
        left = np.array([-chord[1], chord[0]])
        pull = left @ gravity
        if len(rollers) < 3 or abs(pull) < 1e-6:
            continue
        off = (rollers[1:-1] - rollers[0]) @ left
        assert np.all(off * np.sign(pull) > 0.0)
        # on one circle: the turn from link to link is the same at every roller
        link = np.diff(rollers, axis=0)
        turn = np.arcsin((link[:-1, 0] * link[1:, 1] - link[:-1, 1] * link[1:, 0]) / PITCH**2)
        np.testing.assert_allclose(turn, turn[0], atol=1e-7)


@given(loops())
def test_misfit_names_links_that_assemble(sprockets):
    try:
        path = chain_path(single_chain(drive_of(sprockets, 100)))
    except DriveError:
        assume(False)
    fitting = path.fitting_links()
    assume(len(fitting) > 0)
    with pytest.raises(DriveError) as failure:
        assemble(drive_of(sprockets, fitting[-1] + 1))
    best = int(str(failure.value).split("links that fit: ")[1].split(" (")[0].split("best ")[-1])
    assert abs(path.strain(best)) == min(abs(path.strain(links)) for links in fitting)
    check_links(drive := drive_of(sprockets, best), assemble(drive))


def test_whole_number_of_pitches():
    """Two equal sprockets, a whole number of pitches apart: a stadium without strain, seats on all tangent points."""
    drive = drive_of([Placed(20, (0.0, 0.0)), Placed(20, (20 * PITCH, 0.0))], 60)
    assembly = assemble(drive)
    radius = single_chain(drive).pitch_radius(0)
    assert assembly.strain == pytest.approx(0.0, abs=1e-13)
    np.testing.assert_allclose(assembly.sprocket_angle, 0.0, atol=1e-13)
    np.testing.assert_array_equal(assembly.strand_links, [20, 20])
    np.testing.assert_array_equal(assembly.strand_first, [10, 40])
    np.testing.assert_array_equal(assembly.seat_index[:11], np.arange(5, 16))
    np.testing.assert_allclose(assembly.position[0], [0.0, radius], atol=1e-13)
    straight = np.stack([PITCH * np.arange(21), np.full(21, -radius)], axis=1)
    np.testing.assert_allclose(assembly.position[10:31], straight, atol=1e-12)


def test_half_odd_number_of_pitches():
    """Half a pitch further apart the driven seats stand half a tooth off: the strands drop by the chordal rise."""
    teeth, links = 20, 20
    drive = drive_of([Placed(teeth, (0.0, 0.0)), Placed(teeth, ((links + 0.5) * PITCH, 0.0))], 61)
    assembly = assemble(drive)
    rise = 0.5 * PITCH * math.tan(0.5 * math.pi / teeth)  # R (1 - cos(pi/z))
    assert rise == pytest.approx(single_chain(drive).pitch_radius(0) * (1 - math.cos(math.pi / teeth)))
    assert assembly.strain == pytest.approx(math.hypot(1.0, rise / (links * PITCH)) - 1.0, rel=1e-6)
    np.testing.assert_array_equal(assembly.strand_links, [links, links])
    assert abs(assembly.sprocket_angle[1]) == pytest.approx(math.pi / teeth)
    check_seats(drive, assembly)


@pytest.mark.parametrize("extra", [1, 2])
def test_slack_without_gravity_bulges_outward(extra):
    for wrap, order in (("ccw", 1), ("cw", -1)):
        sprockets = [Placed(20, (0.0, 0.0), wrap), Placed(16, (0.1, 0.3), wrap), Placed(16, (-0.3, 0.1), wrap)][::order]
        path = chain_path(single_chain(drive_of(sprockets, 100)))
        tight = min(path.fitting_links(), key=lambda links: abs(path.strain(links)))
        drive = drive_of(sprockets, tight + extra, gravity=(0.0, 0.0))
        assembly = assemble(drive)
        assert assembly.strain < 0
        middle = np.mean([sprocket.center for sprocket in sprockets], axis=0)
        for k in range(3):
            rollers = strand_rollers(assembly, k)
            bulge = rollers[len(rollers) // 2] - 0.5 * (rollers[0] + rollers[-1])
            assert bulge @ (0.5 * (rollers[0] + rollers[-1]) - middle) > 0.0
        check_links(drive, assembly)


def test_sag_of_shallow_arc():
    """h = sqrt(3 s / 8) C for the slack s of a shallow arc on the chord C."""
    drive = drive_of([Placed(20, (0.0, 0.0)), Placed(20, (199.8 * PITCH, 0.0))], 420)
    assembly = assemble(drive)
    rollers = strand_rollers(assembly, 0)
    slack = -assembly.strain
    assert 0 < slack < 0.002
    chord = rollers[-1, 0] - rollers[0, 0]
    sag = 0.5 * (rollers[0, 1] + rollers[-1, 1]) - rollers[:, 1].min()
    assert sag == pytest.approx(math.sqrt(3 * slack / 8) * chord, rel=2e-3)


def test_seats_follow_the_solved_angles():
    """A case where the path's own count leaves the next roller of a strand 0.3 % of a pitch inside the tooth gaps."""
    drive = drive_of([Placed(9, (0.0, 0.0)), Placed(11, (0.1739, 0.02)), Placed(10, (0.0696, 0.12))], 45)
    assembly = assemble(drive)
    np.testing.assert_array_equal(assembly.strand_links, [13, 11, 11])
    check_seats(drive, assembly)
    check_links(drive, assembly)
    check_ends(drive, assembly)


def test_short_slack_strand_keeps_its_pitch():
    """A strand of one link cannot sag: it keeps its pitch and the others take the slack."""
    big, small = Placed(20, (0.0, 0.0)), Placed(10, (0.0, 0.0), "cw")
    gap = math.hypot(big.radius + small.radius, 1.02 * PITCH)
    sprockets = [big, Placed(10, (gap * 0.35, -gap * math.sqrt(1 - 0.35**2)), "cw"), Placed(20, (0.35, 0.05))]
    path = chain_path(single_chain(drive_of(sprockets, 100)))
    assert path.strand_length[0] == pytest.approx(1.02 * PITCH)
    found = 0
    for links in path.fitting_links():
        drive = drive_of(sprockets, links)
        assembly = assemble(drive)
        check_seats(drive, assembly)
        check_links(drive, assembly)
        if assembly.strain < 0 and 1 in assembly.strand_links:
            found += 1
    assert found > 0


def test_strand_without_room_for_a_link():
    sprockets = [Placed(20, (0.0, 0.0)), Placed(20, (0.0, 0.0), "cw")]
    gap = math.hypot(2 * sprockets[0].radius, 0.3 * PITCH)
    sprockets = [sprockets[0], Placed(20, (gap, 0.0), "cw"), Placed(20, (0.5 * gap, 0.5))]
    path = chain_path(single_chain(drive_of(sprockets, 100)))
    assert path.strand_length[0] == pytest.approx(0.3 * PITCH)
    with pytest.raises(DriveError, match=r'strand "s0->s1": 0\.00381 m long, which leaves no link'):
        for links in path.fitting_links():
            assemble(drive_of(sprockets, links))


def test_worn_sprocket_keeps_seats():
    """A sprocket of its own pitch: its arc's links span that, all others the chain's."""
    worn = PITCH * 1.002
    drive = drive_of([Placed(20, (0.0, 0.0)), Placed(30, (0.3, 0.1), pitch=worn)], 74)
    assembly = assemble(drive)
    check_seats(drive, assembly)
    lengths = link_lengths(assembly)
    first = np.flatnonzero(assembly.seat_sprocket == 1)[:-1]
    np.testing.assert_allclose(lengths[first], worn, atol=1e-13)
    rest = np.setdiff1d(np.flatnonzero(strand_of_link(assembly) < 0), first)
    np.testing.assert_allclose(lengths[rest], PITCH, atol=1e-13)
    strands = lengths[strand_of_link(assembly) >= 0]
    np.testing.assert_allclose(strands, PITCH * (1 + max(assembly.strain, 0.0)), atol=1e-12)


def test_driver_has_a_seat_where_the_path_arrives():
    sprockets = [Placed(17, (0.0, 0.0)), Placed(23, (0.33, 0.05)), Placed(19, (0.1, 0.3), speed=12.0)]
    path = chain_path(single_chain(drive_of(sprockets, 100)))
    for links in path.fitting_links():
        assembly = assemble(drive_of(sprockets, links))
        first = np.flatnonzero(assembly.seat_sprocket == 2)[0]
        np.testing.assert_allclose(assembly.position[first], path.strand_end[1], atol=1e-13)
        assert np.all(np.abs(assembly.sprocket_angle) <= np.pi / np.array([17, 23, 19]) + 1e-9)


def test_initial_speeds():
    driver = Placed(20, (0.0, 0.0), speed=10.0, harmonics=((2, 0.1, 0.0), (3, 0.2, math.pi / 3)))
    other = Placed(16, (0.4, 0.0), speed=7.0)
    idler = Placed(12, (0.2, 0.04), "cw")
    sprockets = [driver, other, idler]
    path = chain_path(single_chain(drive_of(sprockets, 100)))
    links = path.fitting_links()[0]
    assembly = assemble(drive_of(sprockets, links))
    travel = 10.0 * (1 + 0.1 + 0.2 * 0.5) * driver.radius
    np.testing.assert_allclose(assembly.sprocket_speed, [12.0, 7.0, -travel / idler.radius], rtol=1e-13)
    ramped = Placed(20, (0.0, 0.0), speed=10.0, ramp_time=0.1)
    assembly = assemble(drive_of([ramped, other, idler], links))
    np.testing.assert_array_equal(assembly.sprocket_speed, [0.0, 7.0, 0.0])
    assembly = assemble(drive_of([ramped, Placed(16, (0.4, 0.0)), idler], links))
    assert not assembly.velocity.any()


def test_strand_velocities_run_between_the_end_seats():
    drive = drive_of([Placed(20, (0.0, 0.0)), Placed(13, (20.3 * PITCH, 0.0))], 57)
    assembly = assemble(drive)
    first, links = assembly.strand_first[0], assembly.strand_links[0]
    ends = assembly.velocity[[first, first + links]]
    assert np.hypot(*(ends[1] - ends[0])) > 0.01 * np.hypot(*ends[0])
    expected = np.linspace(*ends, links + 1)
    np.testing.assert_allclose(assembly.velocity[first : first + links + 1], expected, atol=1e-13)


def test_marine_drive():
    drive = example("marine")
    assembly = assemble(drive)
    assert assembly.strain == pytest.approx(2.81e-4, rel=0.01)
    tension = drive.chain.stiffness * (link_lengths(assembly) - drive.chain.pitch)
    scale = drive.chain.stiffness * drive.chain.pitch
    strand = strand_of_link(assembly) >= 0
    np.testing.assert_allclose(tension[strand], scale * assembly.strain, atol=1e-9 * scale)
    np.testing.assert_allclose(tension[~strand], 0.0, atol=1e-9 * scale)
    check_seats(drive, assembly)
    check_ends(drive, assembly)
    again = assemble(drive)
    np.testing.assert_array_equal(again.position, assembly.position)


def test_what_the_initial_state_hangs_on_is_all_that_tells_drives_apart():
    # drives with the same layout share their state: every value that changes the state must change the layout
    drive = example("marine")
    before, kept = assemble(drive), []
    for path, value in {
        "chain.pitch": 0.11431,
        "chain.elongation": 1e-4,
        "chain.worn_links": [{"link": 3, "elongation": 1e-3}],
        "sprockets.camshaft.center": [-1.38, 5.8995],
        "sprockets.camshaft.load.torque": 1.0,
        "sprockets.camshaft.inertia": 1.0,
        "sprockets.crankshaft.prescribed.speed": 9.0,
        "sprockets.camshaft.balance_wheel": {"mass": 2.0, "radius": 0.1, "phase": 0.0},
        "contact.sprocket.clearance": 2e-4,
        "chain.stiffness": 1e9,
        "chain.damping": 1e3,
        "chain.roller_radius": 0.036,
        "run.gravity": [1.0, 0.0],
        "run.duration": 0.5,
    }.items():
        try:
            other = drive.with_values({path: value})
            after = assemble(other)
        except DriveError:
            continue
        same = all(np.array_equal(getattr(before, name), getattr(after, name)) for name in ("position", "velocity"))
        same = same and np.array_equal(before.sprocket_angle, after.sprocket_angle)
        together = assemble_stacks(stacks_of_drives(list(map(single_chain, [drive, other, drive]))))
        for mine, alone in zip(together, (before, after, before), strict=True):
            assert np.array_equal(mine.position, alone.position), path
            assert np.array_equal(mine.velocity, alone.velocity), path
            assert np.array_equal(mine.sprocket_angle, alone.sprocket_angle), path
        kept.append(same)
    assert any(kept) and not all(kept)
