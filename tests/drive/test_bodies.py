"""Guides of every shape, arms and tensioners as data: what follows from them, and the line said of each wrong one."""

import copy
import math
import pickle
import tomllib

import numpy as np
import pytest
from drives import BLADE, NOT_NEGATIVE, POSITIVE, errors_of, example, put
from wrong_values import lines_of, wrong

from warpchain.drive import Arm, Drive, Tensioner, dumps_drive, load_drive, loads_drive
from warpchain.drive.examples import drive_path
from warpchain.errors import DriveError
from warpchain.model import single_chain
from warpchain.model.stacks import stacks_of_drives

PITCH = 0.009525
ARCS = [  # an S that bends left, then right, and a straight piece between
    {"center": [0.0, 0.0], "radius": 0.2, "from": -90.0, "to": 0.0},
    {"center": [0.4, 0.05], "radius": 0.2, "from": 180.0, "to": 90.0},
]
POINTS = "must be a list of at least 2 points [x, y] of finite numbers"
DEGREES = "must be a number of degrees from -3600 to 3600"


@pytest.fixture
def values():
    return tomllib.loads(BLADE)


@pytest.fixture(scope="module")
def blade():
    return loads_drive(BLADE)


def test_every_shape_reads_back_equal(values):
    for shape in ({"arcs": ARCS}, {"profile": [[0.0, 0.0], [0.1, 0.01], [0.2, 0.0]]}, {"points": [[0, 0], [0.1, 0]]}):
        values["guides"][0] = {"name": "blade"} | shape
        drive = Drive(**values)
        assert loads_drive(dumps_drive(drive)) == drive and pickle.loads(pickle.dumps(drive)) == drive


def test_without_bodies_a_drive_is_written_as_before():
    """No key of guides, arms and tensioners that is not given stands in the file."""
    text = dumps_drive(example("marine"))
    assert not any(word in text for word in ("arms", "tensioners", "side", "offset", "arcs", "points"))


def test_who_carries_whom(blade):
    assert (single_chain(blade).arm_index("tensioner arm"), single_chain(blade).arm_index("blade")) == (0, None)
    assert [single_chain(blade).arm_of(g) for g in (0, 1)] == [0, None] and single_chain(blade).guides_of(0) == (0,)
    assert single_chain(blade).tensioner_body(0) == 2  # after the sprockets
    assert [single_chain(blade).guide_offset(g) for g in (0, 1)] == [blade.chain.roller_radius, 0.004]
    assert [guide.straight for guide in blade.guides] == [False, True]


def test_a_bar_with_the_chain_on_its_right_is_one_from_its_end(blade):
    bar, profile = blade.guides[1].bar, single_chain(blade).profile(1)
    assert (bar.start, bar.end) == ((0.04, 0.08), (0.055, 0.22)) and profile.reversed
    assert profile.face[0].start == pytest.approx(bar.start) and profile.face[0].end == pytest.approx(bar.end)
    assert profile.end_radius == pytest.approx(0.03)


def test_the_ends_of_a_profile_are_a_pitch_round(blade):
    assert single_chain(blade).profile(0).end_radius == pytest.approx(PITCH)
    other = blade.with_values({"guides.blade.end_radius": 0.02})
    assert single_chain(other).profile(0).end_radius == pytest.approx(0.02)


def test_arcs_are_in_degrees(values):
    """Where the S of ARCS ends: at the top of its second circle, after two quarters and 0.05 m between."""
    values["guides"][0] = {"name": "blade", "arcs": ARCS}
    profile = single_chain(Drive(**values)).profile(0)
    assert [piece.curvature for piece in profile.face] == [5.0, 0.0, -5.0]
    assert profile.face[-1].end == pytest.approx((0.4, 0.25))
    assert profile.face_length == pytest.approx(0.05 + 0.2 * math.pi)


def test_angles_of_an_arm_in_radians(blade):
    arm = blade.arms[0]
    assert (*arm.stops_rad, arm.free_angle_rad) == pytest.approx((-math.pi / 18, math.pi / 15, math.pi / 36))
    free = blade.with_values({"arms.tensioner arm.stops": None}).arms[0]
    assert free.stops_rad == (-math.inf, math.inf)


def test_stops_are_as_stiff_as_a_link_but_no_faster(blade):
    """k r^2 of the farthest place of the face, unless a roller of mass m between its links would swing slower."""
    arm, chain = blade.arms[0], blade.chain
    lever = math.dist((-0.045, 0.05), arm.pivot)
    assert single_chain(blade).arm_lever(0) == pytest.approx(lever, rel=1e-12)
    assert arm.inertia / chain.mass > lever**2  # here the lever counts
    assert single_chain(blade).stop_stiffness(0) == pytest.approx(chain.stiffness * lever**2, rel=1e-12)
    light = blade.with_values({"arms.tensioner arm.inertia": 1e-5, "arms.tensioner arm.mass": 1e-4})
    assert single_chain(light).stop_stiffness(0) / 1e-5 == pytest.approx(chain.stiffness / chain.mass)
    critical = 2.0 * math.sqrt(single_chain(blade).stop_stiffness(0) * arm.inertia)
    assert single_chain(blade).stop_damping(0) == pytest.approx(0.5 * critical)
    own = blade.with_values({"arms.tensioner arm.stop_stiffness": 7.0, "arms.tensioner arm.stop_damping": 0.0})
    assert (single_chain(own).stop_stiffness(0), single_chain(own).stop_damping(0)) == (7.0, 0.0)


def test_numbers_of_the_published_tensioner(blade):
    """The formulas of docs/tensioners.md in the numbers that stand there."""
    tensioner = blade.tensioners[0]
    assert tensioner.area == pytest.approx(math.pi * 0.008**2)
    assert tensioner.hole_area == pytest.approx(math.pi * 0.0007**2)
    eta = 800.0 * 8e-5
    assert tensioner.oil.dynamic_viscosity == pytest.approx(eta)
    conductance = math.pi * 0.016 * 5e-5**3 * (1 + 1.5 * 0.81) / (12 * eta * 0.007)
    assert tensioner.leak_conductance == pytest.approx(conductance)
    assert tensioner.drag_flow == pytest.approx(math.pi * 0.016 * 5e-5 / 2)
    assert tensioner.valve.cracking_pressure == pytest.approx(0.075 / (math.pi * 0.0007**2))
    assert tensioner.valve.flow_area(1e-3) == pytest.approx(math.pi * 1e-3 * (0.006 + 1e-3 * math.sqrt(2.0)))
    assert tensioner.unit_direction == (1.0, 0.0)
    assert (tensioner.spring_stiffness, tensioner.spring_preload, tensioner.plunger_mass) == (3500.0, 90.0, 0.033)


def test_a_spring_has_no_oil():
    spring = Tensioner(name="t", on="a", at=(0, 0), direction=(1, 0), kind="spring", spring={"stiffness": 1e3})
    nothing = (spring.area, spring.hole_area, spring.leak_conductance, spring.drag_flow, spring.plunger_mass)
    assert nothing == (0.0,) * 5 and not spring.hydraulic and spring.spring_damping == 0.0


def test_values_by_key_path(blade):
    stiff = {"arms.tensioner arm.stiffness": 2.5, "tensioners.chain tensioner.oil.viscosity": 1e-5}
    other = blade.with_values(stiff | {"guides.blade.points.1.0": -0.03, "tensioners.0.ratchet": None})
    assert other.arms[0].stiffness == 2.5 and other.tensioners[0].oil.viscosity == 1e-5
    assert other.guides[0].points[1] == (-0.03, 0.15) and other.tensioners[0].ratchet is None
    assert other.get_value("tensioners.chain tensioner.plunger.gap") == 5e-5
    listed = {"arms.tensioner arm.stops.1", "guides.blade.points.0", "tensioners.chain tensioner.valve.lift"}
    assert listed < set(blade.paths())


def test_an_angle_of_an_arc_by_key_path(values):
    values["guides"][0] = {"name": "blade", "arcs": ARCS}
    drive = Drive(**values)
    other = drive.with_values({"guides.blade.arcs.1.to": 100.0, "guides.blade.arcs.0.from": -80})
    assert other.guides[0].arcs[1].angles == pytest.approx((math.pi, math.radians(100.0)))
    assert other.get_value("guides.blade.arcs.0.from") == -80.0


def test_one_shape_replaces_another(blade):
    ends = {"guides.blade.start": (-0.04, 0.2), "guides.blade.end": (-0.04, 0.1), "guides.0.end_radius": 0.1}
    bar = blade.with_values(ends)
    assert bar.guides[0].straight and bar.guides[0].points is None and bar.guides[0].radius is None
    line = bar.with_values({"guides.blade.profile": np.array([[-0.04, 0.2], [-0.04, 0.15], [-0.041, 0.1]])})
    assert line.guides[0].start is None and line.guides[0].profile[1] == (-0.04, 0.15)


def test_drives_of_a_kind_have_the_same_bodies(blade):
    """Values may differ where arms turn; an arm with a spring is of another kind than one without."""
    load, stiff = {"sprockets.cam.load.torque": 6.0}, {"arms.tensioner arm.stiffness": 2.5}
    oil = {"tensioners.chain tensioner.oil.viscosity": 1e-5}
    drives = [blade, *(blade.with_values(change) for change in (load, stiff, oil, stiff | load))]
    drives.append(drives[2].with_values({"sprockets.cam.load.torque": 7.0}))
    assert [stack.members.tolist() for stack in stacks_of_drives(drives)] == [[0, 1, 3], [2, 4, 5]]


def test_an_arm_lighter_about_its_pivot_than_its_mass_is_warned_of(values):
    put(values, "arms/0/inertia", 1e-4)
    with pytest.warns(UserWarning, match=r"^arms\.tensioner arm\.inertia = 0\.0001: its mass at its center alone has"):
        Drive(**values)


HYDRAULIC = 'needed with kind "hydraulic"'
PUSHER = "tensioners.chain tensioner"
APART, SHOWN = "not together with", "(Arc(center=(0.0, 0.0), radius=0.2, from=-90.0, to=0.0),"
SHAPES = "give one of start and end, points, arcs, profile"
BAR, TENSIONER = "guides.blade", "tensioners/0"
PAIR = "must be two finite numbers [x, y]"
UNIQUE = "must be unique among the names of all parts"
WITHIN = "must be within 10000 m of the origin"
OILS = ("supply", "ambient")
ABOVE_0 = ["guides/0/offset", "arms/0/mass", "arms/0/inertia"]
ABOVE_0 += [f"{TENSIONER}/{key}" for key in ("chamber/volume", "oil/supply", "ratchet/pitch")]
RULES = [
    *wrong(
        tomllib.loads(BLADE),
        *((path, [0, -1.0], POSITIVE) for path in ABOVE_0),
        *((path, [None], POSITIVE) for path in ("guides/1/end_radius", f"{TENSIONER}/oil/viscosity")),
        *((path, [-1.0], NOT_NEGATIVE) for path in ("arms/0/stiffness", f"{TENSIONER}/ratchet/backlash")),
        *((path, [None], PAIR) for path in ("guides/1/start", "arms/0/pivot")),
        ("guides/0/side", ["up"], 'must be "left" or "right", seen from start to end'),
        ("guides/0/offset", [0.01], "must be at most a pitch, 0.009525"),
        ("guides/0/arm", ["tensoner arm"], "must be the name of an arm; did you mean tens"),
        ("guides/0/points", [[[0, 0]], [[0, 0], [1, math.nan]], [[0, 0], [1]], 3], POINTS),
        ("guides/0/points/1", [[-0.05, 0.24]], "must be another point than the one"),
        ("guides/0/radius", [None], f"{POSITIVE}; needed to round the points"),
        ("guides/0/radius", [0.005], "must be at least a pitch, 0.009525; links cannot follow"),
        ("guides/1/radius", [0.1], "only together with points, whose corners it rounds"),
        ("arms/0/free_angle", [4000], DEGREES),
        ("arms/0/stops", [[12.0, -10.0]], "must be the lower angle first, then the upper"),
        ("arms/0/stops", [[5.0]], "must be two numbers of degrees from -360 to 360, [lower"),
        ("arms/0/lever", [1], "unknown key; "),
        (f"{TENSIONER}/on", ["tensioner am"], "must be the name of an arm, or of a sprocket on"),
        (f"{TENSIONER}/on", ["cam"], "must be the name of an arm, or of a sprocket on a slider; the mo"),
        (f"{TENSIONER}/kind", ["oil"], 'must be "spring" or "hydraulic"'),
        (f"{TENSIONER}/direction", [[-1.0, 0.0]], 'turns "tensioner arm" away from the chain'),
        (f"{TENSIONER}/direction", [[0.0, 1.0]], 'points through the pivot of "tensioner arm"'),
        (f"{TENSIONER}/direction", [[0, 0]], f"{PAIR}, not both 0"),
        (f"{TENSIONER}/plunger", [None], "must be a table { diameter, mass, gap, length"),
        (f"{TENSIONER}/chamber", [None], f"must be a table {{ volume }}; {HYDRAULIC}"),
        (f"{TENSIONER}/valve", [None], "must be a table { ball_radius, seat_diameter, lift"),
        (f"{TENSIONER}/oil", [None], f"must be a table {{ viscosity, supply }}; {HYDRAULIC}"),
        (f"{TENSIONER}/plunger/gap", [None], f"{POSITIVE}; {HYDRAULIC}"),
        (f"{TENSIONER}/plunger/gap", [0.008], "must be below half the diameter, 0.008"),
        (f"{TENSIONER}/plunger/eccentricity", [1.1], "must be a number from 0 to 1"),
        (f"{TENSIONER}/valve/seat_diameter", [0.006], "must be below the ball's diam"),
        (f"{TENSIONER}/valve/seat_angle", [90], "must be a number of degrees above 0, bel"),
        (f"{TENSIONER}/valve/discharge", [2], "must be a number above 0, at most 1"),
        (f"{TENSIONER}/oil/air", [1], "must be a number of at least 0 and below 1"),
        *((f"{TENSIONER}/oil/{key}", [3.0, 1000.0], "must be above the oil's vapor pressure, 1000 Pa") for key in OILS),
        (f"{TENSIONER}/oil/supply", [9e4], "must be at least the ambient pressure, 100000 Pa"),
    ),
    ("guides/0/points/1/1", 0.24e5, f"{BAR}.points.1 = [-0.032, 24000.0]: {WITHIN}"),
    ("guides/0/radius", 1.0, f"{BAR}.points.1 = [-0.032, 0.15]: leaves no room for radius 1: its corner of 18.7"),
    ("guides/0/start", [0, 0], f"{BAR}.points = [[-0.05, 0.24], [-0.032, 0.15], [-0.045, 0.05]]: not together wit"),
    ("guides/1/arcs", ARCS, f"guides.fixed rail.arcs = {SHOWN} ...: {APART} start; {SHAPES}"),
    ("guides/0/profile", [[0, 0], [1, 0]], f"{BAR}.profile = [[0.0, 0.0], [1.0, 0.0]]: {APART} points; {SHAPES}"),
    ("arms/0/pivot/0", 2e4, f"arms.tensioner arm.pivot = [20000.0, 0.25]: {WITHIN}"),
    ("arms/0/name", "cam", f'arms.cam.name = "cam": {UNIQUE}'),
    ("tensioners/0/name", "blade", f'tensioners.blade.name = "blade": {UNIQUE}'),
]


FOLLOWED = {"guides/0/points/1/1", "arms/0/pivot/0", "arms/0/name"}
"""Where other parts go wrong, too."""


COIL = {"at": [-0.04, 0.15], "anchor": [-0.1, 0.1], "stiffness": 9.0, "free_length": 0.1}
SPRINGS = {
    "a point at the pivot": ({"at": None}, "spring.at = {pivot}: must not be the pivot, about which it then turns"),
    "an anchor at the pivot": ({"anchor": None}, "spring.anchor = {pivot}: must not be the pivot"),
    "one point twice": ({"anchor": COIL["at"]}, "spring.anchor = [-0.04, 0.15]: must be another point than at"),
    "an anchor far off": ({"anchor": [2e4, 0.0]}, "spring.anchor = [20000.0, 0.0]: must be within 10000 m"),
    "a spring without stiffness": ({"stiffness": 0.0}, "spring.stiffness = 0.0: must be a positive number"),
    "a spring of no length": ({"free_length": -1.0}, "spring.free_length = -1.0: must be a positive number"),
    "a damper that drives": ({"damping": -1.0}, "spring.damping = -1.0: must be a number of at least 0"),
    "an unknown key": ({"preload": 5.0}, "spring.preload = 5.0: unknown key; allowed are at, anchor"),
}


@pytest.mark.parametrize("case", SPRINGS)
def test_wrong_springs_of_arms_are_named(case, values):
    changes, line = SPRINGS[case]
    pivot = list(values["arms"][0]["pivot"])
    values["arms"][0]["spring"] = COIL | {key: pivot if value is None else value for key, value in changes.items()}
    (found,) = errors_of(values)
    assert found.startswith(f"arms.tensioner arm.{line.format(pivot=pivot)}")


@pytest.mark.parametrize(("path", "value", "line"), RULES)
@pytest.mark.filterwarnings("ignore")
def test_rule(values, path, value, line):
    found = lines_of(values, path, value, line)
    if path not in FOLLOWED:
        assert len(found) == 1, found


SWING = tomllib.loads(drive_path("swing_idler").read_text())
IDLER = "sprockets/1"
CARRIED = wrong(
    SWING,
    (f"{IDLER}/mount/arm", ["swing am"], "must be the name of an arm; did you mean swing arm?"),
    (f"{IDLER}/mount/arm", [3], "must be a text that is not empty"),
    (f"{IDLER}/mount/kind", ["lever"], 'must be "fixed", "prescribed", "elastic", "free", "slider" or "arm"'),
    (f"{IDLER}/mount/pivot", [[0.0, 0.0]], "unknown key; allowed are kind, arm"),
    (f"{IDLER}/center", [[0.05, -0.11]], 'must not be the pivot of "swing arm", which carries it'),
    (f"{IDLER}/mass", [None], f'{POSITIVE}; needed with mount kind "arm"'),
    (f"{IDLER}/bearing/friction", [-0.1], NOT_NEGATIVE),
    (f"{IDLER}/bearing/radius", [0, None], POSITIVE),
)
CARRIED += [
    (f"{IDLER}/balance_wheel", {"mass": 1.0, "radius": 0.1}, "sprockets.idler.balance_wheel: not together with mount"),
    ("sprockets/0/bearing", {"friction": 0.1, "radius": 0.01}, "sprockets.gearbox.bearing: not together with prescri"),
    ("arms", None, 'sprockets.idler.mount.arm = "swing arm": must be the name of an arm; there are none'),
    (
        "tensioners",
        [
            {
                "name": "t",
                "on": "swing arm",
                "at": [0.1, 0.0],
                "direction": [0, -1],
                "kind": "spring",
                "spring": {"stiffness": 1e3},
            }
        ],
        'tensioners.t.direction = [0.0, -1.0]: turns "idler" the way its strands pull it, (0.06, -0.77); must push',
    ),
]


@pytest.mark.parametrize(("path", "value", "line"), CARRIED)
def test_rule_of_a_sprocket_on_an_arm(path, value, line):
    assert len(lines_of(copy.deepcopy(SWING), path, value, line)) == 1


def test_a_center_is_not_moved_into_its_arms_pivot():
    drive = Drive(**SWING)
    with pytest.raises(DriveError, match='must not be the pivot of "swing arm"'):
        drive.with_values({"sprockets.idler.center": [0.05, -0.11]})
    assert errors_of(SWING | {"sprockets": [*SWING["sprockets"][:1], SWING["sprockets"][1] | {"center": 0}]})


def test_a_sprocket_on_an_arm_weighs_on_it():
    """Its mass times its distance squared is the arm's, its inertia is not; the chain reaches as far as it is."""
    drive = Drive(**SWING)
    distance = math.dist((0.189, -0.02), (0.05, -0.11))
    assert (single_chain(drive).carrier(1), single_chain(drive).carrier(0), single_chain(drive).sprockets_on(0)) == (
        0,
        None,
        (1,),
    )
    assert single_chain(drive).arm_lever(0) == single_chain(drive).center_lever(1) == pytest.approx(distance)
    assert single_chain(drive).arm_inertia(0) == pytest.approx(7e-3 + 0.7 * distance**2)
    assert loads_drive(dumps_drive(drive)) == drive


def test_a_spring_takes_no_oil(values):
    put(values, "tensioners/0/kind", "spring")
    put(values, "tensioners/0/spring", None)
    text = "missing; must be a table { stiffness, preload, damping }"
    assert errors_of(values) == (
        f'{PUSHER}.spring: {text}; needed with kind "spring"',
        *(f'{PUSHER}.{key}: only with kind "hydraulic"' for key in ("chamber", "valve", "oil")),
    )


OUTLETS = tomllib.loads(BLADE)
OUTLETS["tensioners"][0]["relief"] = {"pressure": 1e6, "diameter": 2e-3, "stiffness": 2e4, "lift": 3e-4}
OUTLETS["tensioners"][0]["vent"] = {"diameter": 2e-4}
OUTLETS["tensioners"][0]["oil"]["supply_table"] = {"speed": [0.0, 100.0], "pressure": [1e5, 4e5], "shaft": "crank"}
SUPPLY = f"{TENSIONER}/oil/supply_table"
OUTLET_RULES = wrong(
    OUTLETS,
    *((f"{TENSIONER}/relief/{key}", [None, 0.0], POSITIVE) for key in ("diameter", "stiffness", "lift")),
    (f"{TENSIONER}/relief/pressure", [1e5, 20.0], "must be above the ambient pressure, 100000 Pa; pressures are absol"),
    (f"{TENSIONER}/relief/discharge", [1.5], "must be a number above 0, at most 1"),
    (f"{TENSIONER}/relief", [3], "must be a table"),
    (f"{TENSIONER}/chamber/drained", [-0.1, 1.1], "must be a number from 0 to 1"),
    (f"{TENSIONER}/vent/diameter", [None, -1.0], POSITIVE),
    (f"{TENSIONER}/vent", ["open"], "must be a table"),
    (f"{SUPPLY}/pressure/1", [9e4, 4.0], "must be at least the ambient pressure, 100000 Pa; pressures are absolute"),
    (f"{SUPPLY}/factor", [0.1], "times the pressure 100000 must be at least the ambient pressure"),
    (f"{SUPPLY}/pressure", [[1e5, 2e5, 3e5]], "must have as many elements as speed, 2"),
    (f"{SUPPLY}/speed/1", [0.0], "must be above the element before, 0"),
    (f"{SUPPLY}/shaft", ["crnk"], "must be the name of a sprocket or a shaft; did you mean crank?"),
    (f"{SUPPLY}/file", ["oil.csv"], "only drive files name a file; give the columns themselves"),
)
OUTLET_RULES += [
    (f"{SUPPLY}/time", [0.0, 1.0], f"{PUSHER}.oil.supply_table.speed = [0.0, 100.0]: not together with time; give one"),
    (f"{SUPPLY}/angle", [0.0, 6.3], f"{PUSHER}.oil.supply_table.angle: no pressure is over angle; give time or speed"),
    (
        f"{SUPPLY}/speed",
        None,
        f"{PUSHER}.oil.supply_table.time: missing; must be a list of numbers, or give speed or f",
    ),
]


@pytest.mark.parametrize(("path", "value", "line"), OUTLET_RULES)
def test_rule_of_valves_and_supply(path, value, line):
    lines_of(copy.deepcopy(OUTLETS), path, value, line)


def test_a_pump_of_several_chains_is_on_the_tensioner_s_own():
    base, path = example("v6"), "tensioners.right tensioner.oil.supply_table"
    table = {"speed": [0.0, 100.0], "pressure": [1e5, 4e5]}
    assert base.with_values({path: table | {"shaft": "right cam"}}).tensioners[2].oil.supply_table.shaft == "right cam"
    with pytest.raises(
        DriveError, match='"left cam": must be the name of a sprocket of its chain; allowed are idler right'
    ):
        base.with_values({path: table | {"shaft": "left cam"}})


def test_outlets_read_back_equal_and_only_with_oil():
    drive = Drive(**copy.deepcopy(OUTLETS))
    assert loads_drive(dumps_drive(drive)) == drive and pickle.loads(pickle.dumps(drive)) == drive
    part = drive.tensioners[0]
    assert part.relief.preload(1e5) == pytest.approx(9e5 * math.pi * 1e-6)
    assert part.vent.flow_area == pytest.approx(0.6 * math.pi * 1e-8)
    spring = copy.deepcopy(OUTLETS)
    spring["tensioners"][0] |= {"kind": "spring", "spring": {"stiffness": 1e3}}
    for key in ("chamber", "valve", "oil"):
        del spring["tensioners"][0][key]
    assert errors_of(spring) == tuple(f'{PUSHER}.{key}: only with kind "hydraulic"' for key in ("relief", "vent"))


def test_a_supply_from_a_csv_file(tmp_path):
    """Over speed in rpm, in bar; by a name beside the drive file."""
    values = copy.deepcopy(OUTLETS)
    text = dumps_drive(Drive(**values))
    begin = text.index("supply_table")
    end = text.index("}", begin)
    (tmp_path / "drive.toml").write_text(
        text[:begin] + 'supply_table = { file = "oil.csv", shaft = "crank" ' + text[end:]
    )
    (tmp_path / "oil.csv").write_text("speed_rpm,pressure_bar\n0,1\n3000,4.5\n")
    table = load_drive(tmp_path / "drive.toml").tensioners[0].oil.supply_table
    assert table.speed == pytest.approx((0.0, 100.0 * math.pi)) and table.pressure == pytest.approx((1e5, 4.5e5))
    (tmp_path / "oil.csv").write_text("angle,pressure\n0,1\n3000,4.5\n")
    with pytest.raises(
        DriveError, match='line 1: column #1, "angle", is not known; must be pressure over time or speed'
    ):
        load_drive(tmp_path / "drive.toml")


def test_stops_that_are_not_there_have_no_stiffness():
    with pytest.raises(DriveError, match=r"stop_stiffness = 5\.0: only together with stops"):
        Arm(name="a", pivot=(0, 0), mass=1, center=(0, 0), inertia=1, stop_stiffness=5)


def test_a_guide_without_a_shape(values):
    values["guides"][0] = {"name": "blade"}
    pair = "missing; must be two finite numbers [x, y], or give points, arcs or profile instead"
    assert errors_of(values) == (
        f"guides.blade.start: {pair}",
        f"guides.blade.end: {pair}",
        f"guides.blade.end_radius: missing; {POSITIVE}",
    )


def test_a_guide_on_an_arm_where_there_are_none(values):
    del values["arms"], values["tensioners"]
    assert errors_of(values) == ('guides.blade.arm = "tensioner arm": must be the name of an arm; there are none',)


ARC, BEFORE = f"{BAR}.arcs.1", "the end of the arc before"
ARC_RULES = wrong(  # the first draws the arcs apart, too
    {"guides": [{"name": "blade"}]},
    ("guides/0/arcs/0/radius", [0.005], "must be at least a pitch, 0.009525; links cannot"),
    ("guides/0/arcs/1/to", [180.0, -200.0], "must be another angle than from, 180, less than 360 degrees"),
    ("guides/0/arcs/1/from", [None], "must be a finite number"),
)
ARC_RULES += [
    ("guides/0/arcs/1/center", [0.45, 0.05], f"{ARC}: begins 0.0707 m from {BEFORE}; it must begin there"),
    ("guides/0/arcs/1/from", 170.0, f"{ARC}: turns by -10 degrees against {BEFORE}; both must head"),
]


@pytest.mark.parametrize(("path", "value", "line"), ARC_RULES)
def test_rule_of_arcs(values, path, value, line):
    values["guides"][0] = {"name": "blade", "arcs": [dict(arc) for arc in ARCS]}
    lines_of(values, path, value, line)


def slider(values, push, slide=(1.0, 0.0)):
    """The cam on a slider across the drive's height, pushed by the tensioner."""
    mount = {"kind": "slider", "direction": list(slide), "stiffness": 0.0, "damping": 10.0}
    values["sprockets"][1] |= {"mount": mount, "mass": 1.0}
    values["tensioners"][0] |= {"on": "cam", "at": [0.02, 0.3], "direction": list(push)}
    return values


def test_a_tensioner_pushes_a_sprocket_against_its_strands(values):
    """The cam stands above the crank, which pulls it down: up is right, whichever way the slider is said to run."""
    for slide in ((0.0, 1.0), (0.0, -1.0)):
        drive = Drive(**slider(values, (0.0, 1.0), slide))
        assert single_chain(drive).tensioner_body(0) == 1
        (line,) = errors_of(slider(values, (0.0, -1.0), slide))
        assert line.startswith(f'{PUSHER}.direction = [0.0, -1.0]: pushes "cam" the way its strands pull it, (')
    (line,) = errors_of(slider(values, (1.0, 0.0), (0.0, 1.0)))
    assert line.startswith(f'{PUSHER}.direction = [1.0, 0.0]: pushes across the slider of "cam", whose direction is')


def test_all_errors_at_once(values):
    spoiled = {"guides/0/arm": "arm", "guides/1/start": None, "arms/0/stops": [3, 2], "arms/0/mass": 0}
    tensioner = {"tensioners/0/oil/supply": 3.0, "tensioners/0/valve": None, "tensioners/0/plunger/gap": -1}
    put(values, "chain/links", 1)
    for path, value in (spoiled | tensioner).items():
        put(values, path, value)
    assert len(errors_of(values)) == 8
