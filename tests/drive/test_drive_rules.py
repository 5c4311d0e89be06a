"""Every rule of the drive file once, and all errors at once."""

import math

import pytest
from drives import MARINE, NOT_NEGATIVE, POSITIVE, errors_of, marine_values, put
from wrong_values import lines_of, wrong

from warpchain.drive import Drive, Sprocket, SprocketContact, dumps_drive, load_drive, loads_drive
from warpchain.errors import DriveError
from warpchain.model import single_chain

NAME = "must be a text that is not empty and not a whole number"
LAW_NAMES = 'must be one of "lankarani-nikravesh", "flores", "hunt-crossley", "kelvin-voigt"'
MOTION, HARMONIC = "sprockets.crankshaft.prescribed", "{ order, amplitude, phase }"
INSTEAD = "not together with width; give stiffness, or width, "
BAR = "guides.tight strand.contact"
UNIQUE = "must be unique among the names of all parts"
KINDS = '"fixed", "prescribed", "elastic", "free", "slider" or "arm"'
TOGETHER = "missing; static_friction and stribeck_speed are given together"
CRANK, CAM = "sprockets/0/prescribed", "sprockets/2"
ABOVE_0 = [f"{CAM}/pitch", f"{CAM}/mass", f"{CAM}/inertia", f"{CRANK}/harmonics/0/order", "chain/roller_mass"]
ABOVE_0 += ["guides/0/end_radius", "contact/guide/roller/youngs_modulus", "contact/sprocket/bush_stiffness"]
ABOVE_0 += ["run/duration", "run/sample_rate", "contact/sprocket/impact_speed_floor"]
FROM_0 = [f"{CRANK}/speed", f"{CRANK}/ramp_time", f"{CAM}/load/viscous", f"{CAM}/load/quadratic"]
FROM_0 += ["chain/damping", "contact/sprocket/friction", "contact/sprocket/clearance", f"{CAM}/load/ramp_time"]
RESTITUTIONS = ("guides/0/contact/restitution", "contact/sprocket/restitution")
RULES = [
    *wrong(
        marine_values(),
        ("chain/pitch", [0.0, "0.1", True, math.nan, math.inf, None], POSITIVE),
        *((path, [0, -1.0], POSITIVE) for path in ABOVE_0),
        *((path, [-1e-9], NOT_NEGATIVE) for path in FROM_0),
        *((path, [0, 1.1], "must be a number above 0, at most 1") for path in RESTITUTIONS),
        *((path, [1], "must be true or false") for path in ("run/settle", "contact/guide/rolling")),
        *((path, [3], "must be a table") for path in ("contact/guide/roller", "sprockets/1", "chain")),
        ("chain", [None], "must be a table"),
        ("chain/links", [162.0, True, 2], "must be an integer of at least 3"),
        ("chain/links", [10**6 + 1], "must be at most 1000000"),
        ("chain/roller_mass", [None], f"{POSITIVE}, or give mass_per_length instead"),
        ("chain/mass_per_length", [60.8], "not together with roller_mass; give one of the two"),
        ("chain/stiffness", [0, "estimate"], f'{POSITIVE}, or "estimate" together with a size'),
        ("chain/damping", [None], f"{NOT_NEGATIVE}, or give damping_ratio instead"),
        ("chain/damping_ratio", [0.1], "not together with damping; give one of the two"),
        ("chain/roller_radius", [0.05715], "must be below half the pitch, 0.05715"),
        ("chain/rollermass", [7], "unknown key; did you mean roller_mass?"),
        ("chains", [{}], "must be a list of chains"),
        ("self", [1], "unknown key; allowed are chain, chains, sprockets, guides, arms, tensioners, contact, run"),
        ("sprockets", [[], 3, None], "must be a list of at least 2 sprockets"),
        (f"{CAM}/name", ["", "a.b", "a->b", "a=b", "a/b", "a\nb", " a", "12", 12, None], NAME),
        (f"{CAM}/name", ["crankshaft"], UNIQUE),
        (f"{CAM}/teeth", [4, 57.0], "must be an integer of at least 5"),
        (f"{CAM}/teeth", [10**7], "must be at most 1000000"),
        (f"{CAM}/center", [[0.0], [0.0, math.inf], {1.0, 2.0}], "must be two finite numbers [x, y]"),
        (f"{CAM}/wrap", ["left"], 'must be "ccw" or "cw"'),
        (f"{CAM}/inertia", [None], f"{POSITIVE}; needed unless the sprocket is "),
        (f"{CRANK}/speed", [None], f"{NOT_NEGATIVE}, or give table instead"),
        (f"{CAM}/load/torque", ["9"], "must be a finite number"),
        (f"{CAM}/load/harmonics/0/amplitude", [None], "must be"),
        (f"{CAM}/mount", [1], f"must be {KINDS}"),
        ("guides/0/end", [[-0.8284, 4.8479]], "must be another point than start"),
        ("contact/guide", [None], "must be a table; needed where there are guides"),
        ("contact/sprocket/exponent", [0.9], "must be a number of at least 1"),
        ("contact/sprocket/law", ["hertz"], LAW_NAMES),
        ("contact/sprocket/restitution_means", ["speed"], 'must be "parameter" or "rebound"'),
        ("contact/sprocket/profile", ["oval"], 'must be "circular" or "iso606"'),
        ("contact/sprocket/gap", ["minimum"], 'only together with profile = "iso606"'),
        ("contact/sprocket/seat_angle", [180, 0], "must be a number of degrees above 0 and"),
        ("contact/sprocket/clearance", [0.4], "must be below half the pitch less the roller radius, 0.02095"),
        ("contact/sprocket/stiffness", [1.6e9], "not together with width, reference_load, roller, partner; "),
        ("contact/guide/roller/poissons_ratio", [0.6], "must be a number above"),
        ("contact/guide/reference_load", [1e9], "must be below 7.75806e+06 N"),
        ("run/step", ["fast", -1e-5], 'must be a positive number or "auto"'),
        ("run/step", [3.0], "must be at most the duration, 2"),
        ("run/integrator", ["euler"], 'must be "leapfrog" or "rk4"'),
        ("run/gravity", [[0, -9.81, 0]], "must be two finite numbers [x, y]"),
    ),
    ("chain/pitch", 10**400, f"chain.pitch = {'1' + '0' * 55} ...: {POSITIVE}"),
    (
        "a\nb",
        1,
        '"a\\nb" = 1: unknown key; allowed are chain, chains, sprockets, guides, arms, tensioners, contact, run',
    ),
    ("guides/0/name", "camshaft", f'guides.camshaft.name = "camshaft": {UNIQUE}'),
    (f"{CRANK}/harmonics", {"order": 1}, f"{MOTION}.harmonics = {{ order = 1 }}: must be a list of {HARMONIC}"),
    (f"{CAM}/balance_wheel/radius", 0.1, f"sprockets.camshaft.balance_wheel.mass: missing; {NOT_NEGATIVE}"),
    (f"{CAM}/mount", {}, f"sprockets.camshaft.mount.kind: missing; must be {KINDS}"),
    (f"{CAM}/mount", {"kind": "loose"}, f'sprockets.camshaft.mount.kind = "loose": must be {KINDS}'),
    (f"{CAM}/mount/kindd", 1, "sprockets.camshaft.mount.kind: missing; "),
    ("guides/0/contact", {"stiffness": 1e6, "width": 0.1}, f"{BAR}.stiffness = 1000000.0: {INSTEAD}"),
    ("guides/0/contact", {"law": "hertz"}, f'{BAR}.law = "hertz": {LAW_NAMES}'),
    ("guides/0/contact/width", 1e-4, f"{BAR}.reference_load = 2000.0: must be below 0.0310"),
    ("contact/sprocket/static_friction", 0.1, f"contact.sprocket.stribeck_speed: {TOGETHER}"),
    ("contact/guide/stribeck_speed", 0.1, f"contact.guide.static_friction: {TOGETHER}"),
]


@pytest.mark.parametrize(("path", "value", "line"), RULES)
def test_rule(values, path, value, line):
    if path.startswith("guides/0/contact/width"):  # an override of one of four materials
        put(values, "guides/0/contact", {})
    found = lines_of(values, path, value, line)
    if path != "contact/sprocket/width" and not path.startswith(("sprockets", "chain/roller_mass", "chains")):
        assert len(found) == 1, found


BLADE = {"name": "long", "end_radius": 0.3}
MANY = [BLADE | {"name": f"g{k}", "start": (k, 9.0), "end": (k, 10.0)} for k in range(257)]
SIZES = {
    "has 257 elements; must have at most 256": {"guides": MANY},
    # 20,000 pitches of 0.1143 m; the ends add pi r
    "guides.long: its face is 1e+04 m long; must be at most 2286 m, 20000 pitches": {
        "guides": [BLADE | {"start": (-5000.0, 9.0), "end": (5000.0, 9.0)}]},
    "guides.long: its face is 3139 m long; must be": {
        "guides": [BLADE | {"start": (0.0, 9.0), "end": (1.0, 9.0), "end_radius": 999.0}]},
    "guides.long: its face has 1001 pieces; all faces together must have at most 1000": {
        "guides": [BLADE | {"points": [(0.2 * k, 9.0 + 1e-3 * (k % 2)) for k in range(501)], "radius": 1.0}]},
    "guides.long.points: has 2001 elements; must have at most 2000": {
        "guides": [BLADE | {"points": [(1e-3 * k, 9.0) for k in range(2001)], "radius": 1.0}]},
    "guides.long.end_radius = 1e-10: must be from 1e-09 to 1e+09 m": {
        "guides": [BLADE | {"start": (0.0, 9.0), "end": (1.0, 9.0), "end_radius": 1e-10}]},
    "shafts: with sprockets must be at most 60; there are 6": {
        "shafts": [{"name": f"h{k}", "inertia": 1.0} for k in range(60)]},
    "chain.worn_links: has 163 elements; the chain has 162 links": {
        "chain/worn_links": [{"link": k % 162, "elongation": 0.001} for k in range(163)]},
    "prescribed.table.time: has 1000001 elements; must have at most 1000000": {
        f"{CRANK}": {"table": {"time": [float(k) for k in range(10**6 + 1)], "speed": [1.0] * (10**6 + 1)}}},
}  # fmt: skip
"""Sizes that time grows with, and the one line in which each ends, at once."""


@pytest.mark.parametrize("line", SIZES)
def test_a_size_beyond_all_reason_is_one_line(values, line):
    for path, value in SIZES[line].items():
        put(values, path, value)
    (told,) = errors_of(values)
    assert line in told


def test_very_many_lines_are_counted_behind_the_first(values):
    put(values, "chain/worn_links", [{"link": 0, "elongation": 0.001} for _ in range(150)])
    lines = errors_of(values)
    assert len(lines) == 101  # 149 are of a link that was there before
    assert lines[-1].endswith("49 more like these")


def test_one_sprocket_is_too_few(values):
    values["sprockets"] = values["sprockets"][:1]
    assert errors_of(values)[0].endswith(": must be a list of at least 2 sprockets")


STIFF = {"restitution": 0.5, "impact_speed_floor": 0.02, "stiffness": 6e5}
VOIGT, LAW = {"law": "kelvin-voigt"}, 'law = "kelvin-voigt"'
LINEAR = "must be 1 with {}, which is linear"
TIED = [
    (
        {"sprockets/0/prescribed": None, "sprockets/0/inertia": 3.0},
        "sprockets: none is prescribed; at least one sprocket must be",
    ),
    (
        {"contact/sprocket/static_friction": 0.01, "contact/sprocket/stribeck_speed": 0.1},
        "contact.sprocket.static_friction = 0.01: must be at least friction, 0.04",
    ),
    (
        {"contact/sprocket": {**STIFF, "clearance": 0.0, "static_friction": -1, "stribeck_speed": 0.1}},
        f"contact.sprocket.static_friction = -1: {NOT_NEGATIVE}",
    ),
    ({"contact/guide/friction": None}, f"contact.guide.friction: missing; {NOT_NEGATIVE}; needed with rolling"),
    (
        {"chain/joint": None},
        "contact.guide.rolling = true: must be false without chain.joint, whose friction rolling rollers pass on",
    ),
    ({"contact/sprocket/exponent": 1.5}, f"contact.sprocket.exponent = 1.5: {LINEAR.format('bush_stiffness')}"),
    ({"contact/guide/exponent": 1.5, "guides/0/contact": VOIGT}, f"{BAR}.exponent = 1.5: {LINEAR.format(LAW)}"),
    (
        {"contact/guide": VOIGT | STIFF | {"exponent": 2.0}},
        f"contact.guide.exponent = 2.0: {LINEAR.format(LAW)}",
    ),
    (
        {"contact/guide": {"restitution": 0.5, "impact_speed_floor": 0.02, "exponent": 1.5}},
        f"contact.guide.stiffness: missing; {POSITIVE}, or give width, reference_load, roller, partner instead",
    ),
]
"""Values that rule one another out, or need one another."""


@pytest.mark.parametrize(("changes", "line"), TIED, ids=[line[:40] for _, line in TIED])
def test_rules_that_tie_values_together(values, changes, line):
    for path, value in changes.items():
        put(values, path, value)
    assert errors_of(values) == (line,)


def test_prescribed_sprocket_may_have_inertia_and_load(values):
    values["sprockets"][0] |= {"inertia": 900.0, "load": {"torque": 3}}
    assert Drive(**values).sprockets[0].inertia == 900.0


def test_stiffness_instead_of_materials(values):
    values["contact"]["guide"] = {"restitution": 0.5, "impact_speed_floor": 0.02, "stiffness": 6e5, "exponent": 1.5}
    assert single_chain(Drive(**values)).guide_contact(0).stiffness == 6e5


SPOILED = {
    "chain/pitch": -1,
    "chain/mass_per_length": 60.8,
    "chain/colour": "red",
    "sprockets/0/teeth": 3,
    "sprockets/1/inertia": None,
    "sprockets/2/name": "tightener",
    "sprockets/2/mount": {"kind": "elastic", "stiffness": [1, -1], "damping": [1, 1]},
    "sprockets/2/mass": None,
    "guides/0/end": [-0.8284, 4.8479],
    "contact/guide": None,
    "contact/sprocket/restitution": 2,
    "contact/sprocket/stiffness": 1e9,
    "contact/sprocket/profile": "iso606",
    "run/duration": None,
}
SAID = """
chain.pitch = -1:
chain.colour = "red": unknown key;
chain.mass_per_length = 60.8: not together
sprockets.crankshaft.teeth = 3:
sprockets.1.inertia: missing;
sprockets.2.mount.stiffness = [1, -1]:
sprockets.2.mass: missing;
guides.tight strand.end =
contact.sprocket.restitution = 2:
contact.sprocket.stiffness = 1000000000.0: not together
contact.sprocket.gap: missing;
contact.sprocket.clearance = 0.0004: not together
contact.sprocket.seat_angle = 138.0: not together
run.duration: missing;
sprockets.2.name = "tightener": must be unique
contact.guide: missing;
"""


def test_all_errors_of_a_file_at_once(values):
    """Errors of single values hide neither those of other parts nor the rules that tie values together."""
    for path, value in SPOILED.items():
        put(values, path, value)
    for start, line in zip(SAID.strip().splitlines(), errors_of(values), strict=True):
        assert line.startswith(start), (start, line)


def test_file_errors_carry_the_file(tmp_path):
    path = tmp_path / "bad.toml"
    path.write_text(MARINE.read_text().replace("teeth = 25", "teeth = 3").replace("duration = 2.0", "duration = 0"))
    with pytest.raises(DriveError) as caught:
        load_drive(path)
    assert caught.value.errors == (
        f"{path}: sprockets.tightener.teeth = 3: must be an integer of at least 5",
        f"{path}: run.duration = 0: {POSITIVE}",
    )


def test_odd_number_of_links_only_warns(values):
    values["chain"]["links"] = 161
    with pytest.warns(UserWarning, match=r"^chain\.links = 161: an odd number needs an offset link$"):
        assert Drive(**values).chain.links == 161


ELASTIC = {"kind": "elastic", "stiffness": [1e8, 1e8], "damping": [1e4, 1e4]}
SLIDER = {"kind": "slider", "direction": [1, 0], "stiffness": 1e5, "damping": 1e3, "preload": 2e4}
MOVING = {"kind": "prescribed", "direction": [1.0, 0.0], "amplitude": 0.001, "frequency": 5.0}


def test_iso606_profile_needs_a_gap_and_nothing_else(values):
    values["contact"]["sprocket"] |= {"profile": "iso606", "gap": "minimum"}
    del values["contact"]["sprocket"]["clearance"], values["contact"]["sprocket"]["seat_angle"]
    assert Drive(**values).contact.sprocket == SprocketContact(**values["contact"]["sprocket"])
    values["contact"]["sprocket"]["reference_load"] = 1e12
    assert errors_of(values)[0].startswith("contact.sprocket.reference_load = 1000000000000.0: must be below")


@pytest.mark.parametrize("mount", [ELASTIC, SLIDER, MOVING])
def test_data_model_has_room_for_the_mounts(mount):
    sprocket = Sprocket(name="a", teeth=9, center=(0, 0), wrap="cw", inertia=1, mass=2, mount=mount)
    assert sprocket.mount.kind == mount["kind"]
    assert hash(sprocket) == hash(sprocket.model_copy())


def test_mount_values_are_checked_and_mass_needed():
    wrong_mount = SLIDER | {"direction": [0, 0], "damping": -1}
    with pytest.raises(DriveError) as caught:
        Sprocket(name="a", teeth=9, center=(0, 0), wrap="cw", inertia=1, mount=wrong_mount)
    assert caught.value.errors == (
        "Sprocket: mount.direction = [0, 0]: must be two finite numbers [x, y], not both 0",
        f"Sprocket: mount.damping = -1: {NOT_NEGATIVE}",
        f'Sprocket: mass: missing; {POSITIVE}; needed with mount kind "slider"',
    )


def test_balance_wheel_without_mass_is_fine(values):
    values["sprockets"][0]["balance_wheel"] = {"mass": 0.0, "radius": 0.0, "phase": 0.0}
    assert loads_drive(dumps_drive(Drive(**values))) == Drive(**values)
