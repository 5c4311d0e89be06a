"""Set-up help: sprockets moved and links picked against closed forms, and drive files written back."""

import math

import numpy as np
import pytest
from drives import MARINE, SPRUNG, example
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from layouts import PITCH, Placed, drive_of, loops

from warpchain import Record, cli, load_drive, loads_drive, simulate
from warpchain.assembly import assemble
from warpchain.assembly.arm_balance import chain_path
from warpchain.assembly.fitting import fit_links, fit_position, fit_positions, fit_wrap, paths_as_drawn, strand_sag
from warpchain.assembly.summary import derived_quantities
from warpchain.cli.fit_command import _fit_state_lines
from warpchain.drive import save_drive
from warpchain.drive.drive_text import text_with_changes
from warpchain.errors import DriveError
from warpchain.model import single_chain

TEETH, SPAN = 20, 30


def pair(distance=SPAN * PITCH, links=TEETH + 2 * SPAN, angle=0.0, gravity=(0.0, -9.81)):
    """Two equal sprockets, which SPAN pitches apart hold the chain without strain."""
    center = (distance * math.cos(angle), distance * math.sin(angle))
    return drive_of([Placed(TEETH, (0.0, 0.0)), Placed(TEETH, center)], links, gravity)


def distance(drive):
    return math.dist(drive.sprockets[0].center, drive.sprockets[1].center)


# A chain of N links around two sprockets of z teeth has (N - z) / 2 links in each strand; where that is whole, both
# strands are straight from tangent point to tangent point and the centers (N - z) / 2 p (1 + strain) apart, exactly.
# Centers are rounded to 1e-10 m.


@pytest.mark.parametrize("start", [0.8, 0.95, 1.0, 1.3])
@pytest.mark.parametrize("strain", [0.0, 1e-4, 0.03])
def test_center_distance_from_links(start, strain):
    drive = fit_position(pair(start * SPAN * PITCH), "s1", (2.0, 0.0), strain=strain)
    assert distance(drive) == pytest.approx(SPAN * PITCH * (1.0 + strain), abs=2e-10)
    assert drive.sprockets[1].center[1] == 0.0 and drive.sprockets[0].center == (0.0, 0.0)


IDLER = drive_of(
    [Placed(20, (0.0, 0.0)), Placed(20, (SPAN * PITCH, 0.0)), Placed(12, (0.5 * SPAN * PITCH, 0.1), "cw")],
    2 * SPAN + 20,
    (0.0, -9.81),
)
"""An idler outside the upper strand of two equal sprockets."""


def idler_wrap(drive):
    """Wrap of the idler by triangles [degrees]: 2 (asin((R + r) / L) - atan(2 y / D)), L = sqrt(D^2 / 4 + y^2)."""
    both = sum(PITCH / (2.0 * math.sin(math.pi / z)) for z in (20, 12))
    half, y = 0.5 * SPAN * PITCH, drive.sprockets[2].center[1]
    return math.degrees(2.0 * (math.asin(both / math.hypot(half, y)) - math.atan2(y, half)))


@pytest.mark.parametrize("wrap", [10.0, 30.0, 45.0])
def test_an_idler_with_a_wanted_wrap(wrap):
    moved = fit_wrap(IDLER, "s2", (0.0, 1.0), wrap)
    assert idler_wrap(moved) == pytest.approx(wrap, abs=1e-6)
    assert moved.chain.links == IDLER.chain.links
    fitted = fit_links(moved)
    assert abs(assemble(fitted).strain) < 0.02
    # 0.1 degrees more on each of the others, for the idler's 0.2: the chain turns by 360 in all
    around = fit_wrap(IDLER, "s2", (0.0, 1.0), 180.0 + 0.5 * wrap, around="s0")
    assert around.sprockets[2].center[1] == pytest.approx(moved.sprockets[2].center[1], abs=1e-8)


def test_wraps_that_cannot_be():
    with pytest.raises(DriveError, match=r"wrap = 0: must be above 0 and below 360 degrees"):
        fit_wrap(IDLER, "s2", (0.0, 1.0), 0.0)
    with pytest.raises(DriveError, match=r'no place along .* gives 340 degrees of wrap around "s2"; it can have'):
        fit_wrap(IDLER, "s2", (0.0, 1.0), 340.0)  # there it meets the other strand, or crosses its own
    with pytest.raises(DriveError, match=r'sprocket "s9": no such name'):
        fit_wrap(IDLER, "s2", (0.0, 1.0), 60.0, around="s9")


def test_the_command_fits_a_wrap_and_then_the_links(tmp_path, capsys):
    path, words = tmp_path / "drive.toml", ["--sprocket", "s2", "--along", "0,1", "--wrap", "40"]
    save_drive(IDLER, path)
    assert cli.main(["fit", str(path), *words, "--links"]) == 0
    found = load_drive(path)
    assert idler_wrap(found) == pytest.approx(40.0, abs=1e-6)
    assert found.chain.links == fit_links(fit_wrap(IDLER, "s2", (0.0, 1.0), 40.0)).chain.links
    for wrong in (["--wrap", "60"], [*words, "--sag", "0.01"], [*words[:4], "--around", "s0", "--strain", "0"]):
        assert cli.main(["fit", str(path), *wrong, *([] if "--sprocket" in wrong else ["--links"])]) == 2
        assert len(capsys.readouterr().err.strip().splitlines()) == 1


def test_preload_is_stiffness_times_elongation():
    """A link of length p (1 + T / (k p)) carries T; 1e-10 m of 0.381 m are 3e-5 N here."""
    drive = fit_position(pair(angle=0.7), "s0", (math.cos(0.7), math.sin(0.7)), preload=500.0)
    assert distance(drive) == pytest.approx(SPAN * (PITCH + 500.0 / drive.chain.stiffness), abs=3e-10)
    assert derived_quantities(drive)["preload"] == pytest.approx(500.0, abs=1e-3)


def test_moves_along_any_line_to_the_nearest_place():
    """Across the line of centers the distance grows as the square: two places, either side; the nearer is taken."""
    wanted = SPAN * PITCH * 1.001
    aside = math.sqrt(wanted**2 - (SPAN * PITCH) ** 2)
    drive = pair().with_values({"sprockets.s1.center": (SPAN * PITCH, 1e-3)})
    assert fit_position(drive, "s1", (0.0, -1.0), strain=1e-3).sprockets[1].center[1] == pytest.approx(aside, rel=1e-3)
    below = drive.with_values({"sprockets.s1.center.1": -1e-3})
    assert fit_position(below, "s1", (0.0, 1.0), strain=1e-3).sprockets[1].center[1] == pytest.approx(-aside, rel=1e-3)


def test_moves_back_to_where_it_was():
    """The marine tightener, moved off, finds its place for the preload it had: T = k p strain = 2470 N."""
    marine = example("marine")
    preload = derived_quantities(marine)["preload"]
    off = marine.with_values({"sprockets.tightener.center.0": 1.5})
    back = fit_position(off, "tightener", (1.0, 0.0), preload=preload)
    assert back.sprockets[1].center == pytest.approx(marine.sprockets[1].center, abs=1e-9)


@settings(max_examples=15)
@given(loops(), st.integers(0, 5), st.floats(0.0, 2 * math.pi), st.sampled_from([0.0, 1e-3, -2e-3]))
def test_any_sprocket_of_any_loop(sprockets, which, angle, strain):
    """What is found has the strain asked for, to the rounding of centers; what is refused is outside, or jumped."""
    try:
        fitting = chain_path(single_chain(drive_of(sprockets, 100))).fitting_links()
    except DriveError:
        assume(False)
    assume(len(fitting) > 0)
    drive = drive_of(sprockets, fitting[len(fitting) // 2])
    try:
        fitted = fit_position(drive, f"s{which % len(sprockets)}", (math.cos(angle), math.sin(angle)), strain=strain)
    except DriveError as error:
        low, high = str(error).split("it can have ")[1].split(", moved")[0].split(" to ")
        assert not float(low) <= strain <= float(high) or str(error).endswith("jumps over that")
    else:
        assert assemble(fitted).strain == pytest.approx(strain, abs=1e-8)


def settled_sag(drive):
    """Depth below its chord of a settled strand's middle; the sprockets are held while it settles."""
    run = simulate(drive.with_values({"run.duration": 2e-6}), record=Record(rate=1e6, channels=("position",)))
    assembly = assemble(drive)
    first, links = int(assembly.strand_first[0]), int(assembly.strand_links[0])
    x = run[0].position[0, first : first + links + 1].astype(float)
    along = (x[-1] - x[0]) / np.hypot(*(x[-1] - x[0]))
    off = np.abs((x - x[0]) @ np.array([-along[1], along[0]]))
    return 0.5 * (off[links // 2] + off[(links + 1) // 2])


@pytest.mark.parametrize(("sag", "angle", "clearance"), [(4e-3, 0.0, 0.0), (12e-3, 0.7, 0.0), (8e-3, 0.0, 1e-4)])
def test_strand_settles_to_the_sag_asked_for(sag, angle, clearance):
    """Eq. (a): the parabola is good to (h/C)^2 = 0.001, settling to less than 1 %; that end rollers give way by the
    clearance is a rule, good to 20 % of what it adds, here 2 % of the sag."""
    start = pair(angle=angle).with_values({"contact.sprocket.clearance": clearance})
    drive = fit_position(start, "s1", (math.cos(angle), math.sin(angle)), sag=sag, strand="s0->s1")
    assert settled_sag(drive) == pytest.approx(sag, rel=0.03 if clearance else 0.01)
    assert strand_sag(single_chain(drive), assemble(drive), 0) == pytest.approx(sag, rel=1e-6)


def test_taut_strand_sags_by_its_weight_over_its_tension():
    """h = mu g C^2 / (8 T), T = k p strain: the sag's own length, 8 h^2 / (3 C^2), is 1e-3 of the strain here."""
    drive = fit_position(pair().with_values({"contact.sprocket.clearance": 0}), "s1", (1.0, 0.0), sag=4e-4)
    tension = 0.01 / PITCH * 9.81 * distance(drive) ** 2 / (8 * 4e-4)
    assert derived_quantities(drive)["preload"] == pytest.approx(tension, rel=2e-3)


def test_links_nearest_to_the_path():
    """20.3 pitches apart the path of two 20-tooth sprockets is 60.6 pitches long: 60 is taut by 0.6 / 40, 61 slack."""
    drive = pair(20.3 * PITCH, links=100)
    assert fit_links(drive).chain.links == 60
    assert fit_links(drive, odd=True).chain.links == 61
    assemble(fit_links(drive))


def test_links_that_leave_the_chain_on_the_arms_go_before_slack_ones():
    """With a stiff spring 94 links are taut by 0.55 %, 95 slack by 0.48 with the arm at its free angle. A little lower
    92 are taut by 2 %, twice what breaks the chain: then it is 94, slack by 0.2, and `fit` tells of the arm."""
    drive = loads_drive(SPRUNG).with_values(
        {"arms.tensioner arm.stiffness": 1e4, "arms.tensioner arm.free_angle": 10.0}
    )
    high, low = (drive.with_values({"sprockets.cam.center": (0.02, 0.30 + off)}) for off in (0.01, 0.006))
    assert fit_links(high, odd=True).chain.links == 94
    assert fit_links(low).chain.links == 94
    (line,) = [line for line in _fit_state_lines(fit_links(low)) if "LOOK AT" in line]
    assert line.startswith("LOOK AT arms.tensioner arm: stands at 10 degrees, as it would without a chain")


def test_no_number_of_links_fits():
    """7.5 pitches apart: 34 links are 15 / 14 too short, 36 are 15 / 16 too long; 35 fit but are odd."""
    drive = pair(7.5 * PITCH, links=100)
    with pytest.raises(DriveError, match=r"no even number .* 35\.000 pitches .*34: \+7\.14 %.*36: -6\.25 %") as failure:
        fit_links(drive)
    assert "\n" not in str(failure.value)
    assert fit_links(drive, odd=True).chain.links == 35


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ({}, "one of strain, preload and sag must be given, not none"),
        ({"strain": 0.01, "sag": 0.01}, "one of strain, preload and sag must be given, not strain and sag"),
        ({"strain": 0.06}, "strain = 0.06: must be within 0.05"),
        ({"strain": math.nan}, "strain = nan: must be within 0.05"),
        ({"preload": -1.0}, "preload = -1: must be at least 0 and at most 6350 N"),
        ({"sag": 0.0}, "sag = 0: must be a finite number above 0"),
        ({"sag": 0.01, "strand": "s1"}, 'strand "s1": no such name; allowed are s0->s1, s1->s0'),
        ({"strain": 0.0, "strand": "s0->s1"}, "strand: only together with sag"),
        ({"strain": 0.0, "sprocket": "s2"}, 'sprocket "s2": no such name; allowed are s0, s1'),
        ({"strain": 0.0, "direction": (0, 0)}, "direction (0, 0): must be two finite numbers, not both 0"),
    ],
)
def test_errors_say_what_is_allowed(words, line):
    values = {"sprocket": "s1", "direction": (1.0, 0.0)} | words
    with pytest.raises(DriveError) as failure:
        fit_position(pair(), values.pop("sprocket"), values.pop("direction"), **values)
    assert str(failure.value) == line


def test_upright_strand_has_no_sag():
    with pytest.raises(DriveError, match="gravity does not act across it"):
        fit_position(pair(angle=math.pi / 2), "s1", (0.0, 1.0), sag=0.01)
    with pytest.raises(DriveError, match="gravity does not act across it"):
        fit_position(pair(gravity=(0.0, 0.0)), "s1", (1.0, 0.0), sag=0.01)


def test_what_cannot_be_reached_names_what_can():
    """Across the line of centers the chain only gets tighter: no slack, and from 0 up."""
    with pytest.raises(DriveError) as failure:
        fit_position(pair(), "s1", (0.0, 1.0), strain=-0.01)
    message = str(failure.value)
    assert message.startswith('sprocket "s1": no place along [0.0, 1.0] gives strain -0.01; it can have 0 to 0.0')
    far = pair(links=400)
    with pytest.raises(DriveError, match="nowhere on the line does a chain of 24 links fit within 5 % strain"):
        fit_position(far.with_values({"chain.links": 24}), "s1", (0.0, 1.0), strain=0.0)


# ----------------------------------------------------------------------------------------------------------- files


@pytest.fixture
def copy(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(MARINE.read_text())
    return path


def test_file_keeps_all_but_the_center(copy, capsys):
    command = ["fit", str(copy), "--sprocket", "tightener", "--along=-1,0", "--preload", "5000"]
    assert cli.main(command) == 0
    old, new = MARINE.read_text().splitlines(), copy.read_text().splitlines()
    (changed,) = (a for a, b in zip(old, new, strict=True) if a != b)
    assert changed.startswith("center = [1.193057, 3.0]")
    assert derived_quantities(load_drive(copy))["preload"] == pytest.approx(5000.0, abs=0.1)
    out = capsys.readouterr().out
    assert "preload 5000 N" in out and "(was [1.193057, 3.0])" in out and f"written: {copy}" in out


def test_links_and_sprocket_together(copy, capsys):
    """Far off, with links that do not fit: first the links, then the exact place."""
    copy.write_text(copy.read_text().replace("links = 162", "links = 90 # as bought"))
    command = ["fit", str(copy), "--links", "--sprocket", "tightener", "--along", "1,0", "--strain", "0"]
    assert cli.main(command) == 0
    drive = load_drive(copy)
    assert drive.chain.links == 162 and abs(assemble(drive).strain) < 1e-9
    assert "links = 162 # as bought" in copy.read_text()
    assert "chain.links = 162 (was 90)" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ([], "nothing to fit: give --links, or --sprocket with --along and what is wanted"),
        (["--sprocket", "tightener", "--strain", "0"], "--sprocket and --along: give both, or none"),
        (["--links", "--preload", "1"], "--strain, --preload, --sag: need a sprocket to move"),
        (["--sprocket", "tightener", "--along", "1", "--strain", "0"], "--along 1: must be two numbers DX,DY"),
        (["--sprocket", "tightener", "--along", "x,y", "--strain", "0"], "--along x,y: must be two numbers DX,DY"),
    ],
)
def test_command_errors_leave_the_file(copy, capsys, words, line):
    assert cli.main(["fit", str(copy), *words]) == 2
    (error,) = capsys.readouterr().err.splitlines()
    assert error.startswith(f"warpchain: error: {line}")
    assert copy.read_text() == MARINE.read_text()


def test_examples_are_not_overwritten(capsys, tmp_path):
    before = MARINE.read_bytes()
    assert cli.main(["fit", "marine", "--links"]) == 2
    assert "marine comes with the package: give -o OUT.toml" in capsys.readouterr().err
    assert cli.main(["fit", "marine", "--links", "-o", str(tmp_path / "own.toml")]) == 0
    assert MARINE.read_bytes() == before == (tmp_path / "own.toml").read_bytes()


def test_any_way_to_write_a_file_is_kept():
    """Inline lists of tables, dotted keys, whole numbers, comments, blanks and line ends."""
    text = (
        "chain.links = 80 # all\r\nchain.pitch=1.0\r\n"
        'sprockets = [ {name="a", center = [ 0, 0 ]}, {center=[2,0], name="b"} ] # two\r\n'
    )
    drive = pair(distance=1.5, links=82)
    changed = text.replace("80", "82").replace("[2,0]", "[1.5,0]")
    assert text_with_changes(text, pair(distance=2.0, links=80), drive) == changed


# ------------------------------------------------------------------------------------------------------- together


def scattered(count):
    """Marine drives with places and numbers of teeth of their own, some of which no place makes fit."""
    random, base, found = np.random.default_rng(4), example("marine"), []
    for v in range(count):
        x, y = base.sprockets[2].center
        apart = random.normal(0.0, 0.2 * base.chain.pitch, 2)  # so far that some chains go around the bar
        values = {"sprockets.camshaft.center": (x + float(apart[0]), y + float(apart[1]))}
        if v % 3 == 0:
            values["sprockets.tightener.teeth"] = 25
        if v % 11 == 0:
            values["sprockets.camshaft.center"] = (x, y + 5.0)  # out of reach
        found.append(base.with_values(values))
    return found


def outcome(work):
    try:
        return work()
    except DriveError as error:
        return str(error)


def test_drives_moved_together_are_moved_as_if_alone():
    """To the last bit: what the searches of a stack ask for has the same bits alone; refusals read the same."""
    drives = scattered(24)
    strains, travels = np.linspace(-0.002, 0.002, 24).tolist(), [0.2] * 24
    together = fit_positions(drives, "tightener", (1.0, -0.2), strains, travels)
    for drive, strain, found in zip(drives, strains, together, strict=True):
        alone = outcome(lambda: fit_position(drive, "tightener", (1.0, -0.2), strain=strain, travel=0.2))  # noqa: B023
        assert (str(found) if isinstance(found, DriveError) else found) == alone
    moved = [drive for drive in together if not isinstance(drive, DriveError)]
    assert 0 < len(moved) < 24
    assert any(any(chain_path(single_chain(drive)).strings) for drive in moved)


def test_paths_of_drives_that_do_not_differ_are_one_path():
    drives = [pair(), pair(), pair()]
    paths = paths_as_drawn(list(map(single_chain, drives)))
    assert [path.nominal_strain for path in paths] == 3 * [chain_path(single_chain(pair())).nominal_strain]


def test_paths_drawn_together_are_those_drawn_alone():
    drives = [*scattered(8), pair(0.0001), pair()]
    paths = paths_as_drawn(list(map(single_chain, drives)))
    for drive, path in zip(drives, paths, strict=True):
        alone = outcome(lambda: chain_path(single_chain(drive)))  # noqa: B023
        if isinstance(alone, str):
            assert str(path) == alone
        else:
            assert path.nominal_strain == alone.nominal_strain
            assert path.strand_length.tolist() == alone.strand_length.tolist()
    assert isinstance(paths[8], DriveError)
