"""Every rule of the drive file once, and all errors at once."""

import math
import warnings

import pytest
from drives import MARINE, NOT_NEGATIVE, POSITIVE, errors_of, marine_values, put

from warpchain.drive import (
    Drive,
    Sprocket,
    SprocketContact,
    dumps_drive,
    load_drive,
    loads_drive,
)
from warpchain.errors import DriveError


@pytest.fixture
def values():
    return marine_values()


NAME = "must be a text that is not empty and not a whole number"
LAW_NAMES = 'must be one of "lankarani-nikravesh", "flores", "hunt-crossley", "kelvin-voigt"'

RULES = [
    # chain
    ("chain/pitch", 0.0, f"chain.pitch = 0.0: {POSITIVE}"),
    ("chain/pitch", "0.1", f'chain.pitch = "0.1": {POSITIVE}'),
    ("chain/pitch", True, f"chain.pitch = true: {POSITIVE}"),
    ("chain/pitch", math.nan, f"chain.pitch = nan: {POSITIVE}"),
    ("chain/pitch", math.inf, f"chain.pitch = inf: {POSITIVE}"),
    ("chain/pitch", 10**400, f"chain.pitch = {'1' + '0' * 55} ...: {POSITIVE}"),
    ("chain/pitch", None, f"chain.pitch: missing; {POSITIVE}"),
    ("chain/links", 162.0, "chain.links = 162.0: must be an integer of at least 3"),
    ("chain/links", True, "chain.links = true: must be an integer of at least 3"),
    ("chain/links", 2, "chain.links = 2: must be an integer of at least 3"),
    ("chain/links", 10**6 + 1, "chain.links = 1000001: must be at most 1000000"),
    ("chain/roller_mass", -1.0, f"chain.roller_mass = -1.0: {POSITIVE}"),
    ("chain/roller_mass", None, f"chain.roller_mass: missing; {POSITIVE}, or give mass_per_length instead"),
    ("chain/mass_per_length", 60.8, "chain.mass_per_length = 60.8: not together with roller_mass; give one of the two"),
    ("chain/stiffness", 0, f'chain.stiffness = 0: {POSITIVE}, or "estimate" together with a size'),
    ("chain/damping", -1e-9, f"chain.damping = -1e-09: {NOT_NEGATIVE}"),
    ("chain/damping", None, f"chain.damping: missing; {NOT_NEGATIVE}, or give damping_ratio instead"),
    ("chain/damping_ratio", 0.1, "chain.damping_ratio = 0.1: not together with damping; give one of the two"),
    ("chain/roller_radius", 0.05715, "chain.roller_radius = 0.05715: must be below half the pitch, 0.05715"),
    ("chain/rollermass", 7, "chain.rollermass = 7: unknown key; did you mean roller_mass?"),
    ("chain", 7, "chain = 7: must be a table"),
    ("chain", None, "chain: missing; must be a table"),
    ("chains", {}, "chains = {}: unknown key; did you mean chain?"),
    ("self", 1, "self = 1: unknown key; allowed are chain, sprockets, guides, arms, tensioners, contact, run"),
    ("a\nb", 1, '"a\\nb" = 1: unknown key; allowed are chain, sprockets, guides, arms, tensioners, contact, run'),
    # sprockets
    ("sprockets", [], "sprockets = []: must be a list of at least 2 sprockets"),
    ("sprockets", 3, "sprockets = 3: must be a list of at least 2 sprockets"),
    ("sprockets", None, "sprockets: missing; must be a list of at least 2 sprockets"),
    ("sprockets/1", 3, "sprockets.1 = 3: must be a table"),
    ("sprockets/2/name", "", f'sprockets.2.name = "": {NAME}'),
    ("sprockets/2/name", "a.b", f'sprockets.2.name = "a.b": {NAME}'),
    ("sprockets/2/name", "a->b", f'sprockets.2.name = "a->b": {NAME}'),
    ("sprockets/2/name", "a=b", f'sprockets.2.name = "a=b": {NAME}'),
    ("sprockets/2/name", "a/b", f'sprockets.2.name = "a/b": {NAME}'),
    ("sprockets/2/name", "a\nb", f'sprockets.2.name = "a\\nb": {NAME}'),
    ("sprockets/2/name", " a", f'sprockets.2.name = " a": {NAME}'),
    ("sprockets/2/name", "12", f'sprockets.2.name = "12": {NAME}'),
    ("sprockets/2/name", 12, f"sprockets.2.name = 12: {NAME}"),
    ("sprockets/2/name", None, f"sprockets.2.name: missing; {NAME}"),
    (
        "sprockets/2/name",
        "crankshaft",
        'sprockets.2.name = "crankshaft": must be unique among sprockets, guides, arms and tensioners',
    ),
    (
        "guides/0/name",
        "camshaft",
        'guides.camshaft.name = "camshaft": must be unique among sprockets, guides, arms and tensioners',
    ),
    ("sprockets/2/teeth", 4, "sprockets.camshaft.teeth = 4: must be an integer of at least 5"),
    ("sprockets/2/teeth", 57.0, "sprockets.camshaft.teeth = 57.0: must be an integer of at least 5"),
    ("sprockets/2/teeth", 10**7, "sprockets.camshaft.teeth = 10000000: must be at most 1000000"),
    ("sprockets/2/center", [0.0], "sprockets.camshaft.center = [0.0]: must be two finite numbers [x, y]"),
    ("sprockets/2/center", [0.0, math.inf], "sprockets.camshaft.center = [0.0, inf]: must be two finite numbers"),
    ("sprockets/2/center", {1.0, 2.0}, "sprockets.camshaft.center = {1.0, 2.0}: must be two finite numbers [x, y]"),
    ("sprockets/2/wrap", "left", 'sprockets.camshaft.wrap = "left": must be "ccw" or "cw"'),
    ("sprockets/2/pitch", 0.0, f"sprockets.camshaft.pitch = 0.0: {POSITIVE}"),
    ("sprockets/2/mass", 0.0, f"sprockets.camshaft.mass = 0.0: {POSITIVE}"),
    ("sprockets/2/inertia", 0.0, f"sprockets.camshaft.inertia = 0.0: {POSITIVE}"),
    ("sprockets/2/inertia", None, f"sprockets.camshaft.inertia: missing; {POSITIVE}; needed unless the sprocket is "),
    ("sprockets/0/prescribed/speed", -1.0, f"sprockets.crankshaft.prescribed.speed = -1.0: {NOT_NEGATIVE}"),
    (
        "sprockets/0/prescribed/speed",
        None,
        f"sprockets.crankshaft.prescribed.speed: missing; {NOT_NEGATIVE}, or give table instead",
    ),
    ("sprockets/0/prescribed/ramp_time", -1.0, f"sprockets.crankshaft.prescribed.ramp_time = -1.0: {NOT_NEGATIVE}"),
    (
        "sprockets/0/prescribed/harmonics/0/order",
        0,
        f"sprockets.crankshaft.prescribed.harmonics.0.order = 0: {POSITIVE}",
    ),
    (
        "sprockets/0/prescribed/harmonics",
        {"order": 1},
        "sprockets.crankshaft.prescribed.harmonics = { order = 1 }: must be a list of { order, amplitude, phase }",
    ),
    ("sprockets/2/load/torque", "9", 'sprockets.camshaft.load.torque = "9": must be a finite number'),
    ("sprockets/2/load/viscous", -1, f"sprockets.camshaft.load.viscous = -1: {NOT_NEGATIVE}"),
    ("sprockets/2/load/quadratic", -1, f"sprockets.camshaft.load.quadratic = -1: {NOT_NEGATIVE}"),
    ("sprockets/2/load/ramp_time", -1, f"sprockets.camshaft.load.ramp_time = -1: {NOT_NEGATIVE}"),
    ("sprockets/2/load/harmonics/0/amplitude", None, "sprockets.camshaft.load.harmonics.0.amplitude: missing; must be"),
    ("sprockets/2/balance_wheel/radius", 0.1, f"sprockets.camshaft.balance_wheel.mass: missing; {NOT_NEGATIVE}"),
    ("sprockets/2/mount", {}, 'sprockets.camshaft.mount.kind: missing; must be "fixed", "prescribed", "elastic" or'),
    ("sprockets/2/mount", {"kind": "loose"}, 'sprockets.camshaft.mount.kind = "loose": must be "fixed", "prescribed",'),
    ("sprockets/2/mount", 1, 'sprockets.camshaft.mount = 1: must be "fixed", "prescribed", "elastic" or "slider"'),
    ("sprockets/2/mount/kindd", 1, "sprockets.camshaft.mount.kind: missing; "),
    # guides
    (
        "guides/0/end",
        [-0.8284, 4.8479],
        "guides.tight strand.end = [-0.8284, 4.8479]: must be another point than start",
    ),
    ("guides/0/end_radius", 0, f"guides.tight strand.end_radius = 0: {POSITIVE}"),
    ("guides/0/contact/restitution", 0, "guides.tight strand.contact.restitution = 0: must be a number above 0, at mo"),
    (
        "guides/0/contact",
        {"stiffness": 1e6, "width": 0.1},
        "guides.tight strand.contact.stiffness = 1000000.0: not together with width; give stiffness, or width, ",
    ),
    ("contact/guide", None, "contact.guide: missing; must be a table; needed where there are guides"),
    # contact
    ("contact/sprocket/restitution", 1.1, "contact.sprocket.restitution = 1.1: must be a number above 0, at most 1"),
    ("contact/sprocket/restitution", 0, "contact.sprocket.restitution = 0: must be a number above 0, at most 1"),
    ("contact/sprocket/exponent", 0.9, "contact.sprocket.exponent = 0.9: must be a number of at least 1"),
    ("contact/sprocket/impact_speed_floor", 0, f"contact.sprocket.impact_speed_floor = 0: {POSITIVE}"),
    ("contact/sprocket/impact_speed_floor", None, f"contact.sprocket.impact_speed_floor: missing; {POSITIVE}"),
    ("contact/sprocket/law", "hertz", f'contact.sprocket.law = "hertz": {LAW_NAMES}'),
    ("guides/0/contact", {"law": "hertz"}, f'guides.tight strand.contact.law = "hertz": {LAW_NAMES}'),
    (
        "contact/sprocket/restitution_means",
        "speed",
        'contact.sprocket.restitution_means = "speed": must be "parameter" or "rebound"',
    ),
    ("contact/sprocket/profile", "oval", 'contact.sprocket.profile = "oval": must be "circular" or "iso606"'),
    ("contact/sprocket/gap", "minimum", 'contact.sprocket.gap = "minimum": only together with profile = "iso606"'),
    ("contact/sprocket/seat_angle", 180, "contact.sprocket.seat_angle = 180: must be a number of degrees above 0 and"),
    ("contact/sprocket/seat_angle", 0, "contact.sprocket.seat_angle = 0: must be a number of degrees above 0 and"),
    ("contact/sprocket/clearance", -1e-6, f"contact.sprocket.clearance = -1e-06: {NOT_NEGATIVE}"),
    ("contact/sprocket/clearance", None, f"contact.sprocket.clearance: missing; {NOT_NEGATIVE}"),
    (
        "contact/sprocket/clearance",
        0.4,
        "contact.sprocket.clearance = 0.4: must be below half the pitch less the roller radius, 0.02095",
    ),
    (
        "contact/sprocket/stiffness",
        1.6e9,
        "contact.sprocket.stiffness = 1600000000.0: not together with width, reference_load, roller, partner; ",
    ),
    ("contact/sprocket/width", None, f"contact.sprocket.width: missing; {POSITIVE}, or give stiffness instead"),
    (
        "contact/guide/roller/poissons_ratio",
        0.6,
        "contact.guide.roller.poissons_ratio = 0.6: must be a number above",
    ),
    ("contact/guide/roller/youngs_modulus", 0, f"contact.guide.roller.youngs_modulus = 0: {POSITIVE}"),
    ("contact/guide/roller", 3, "contact.guide.roller = 3: must be a table"),
    ("contact/sprocket/friction", -0.1, f"contact.sprocket.friction = -0.1: {NOT_NEGATIVE}"),
    ("contact/guide/rolling", 1, "contact.guide.rolling = 1: must be true or false"),
    ("contact/sprocket/bush_stiffness", 0, f"contact.sprocket.bush_stiffness = 0: {POSITIVE}"),
    (
        "contact/sprocket/static_friction",
        0.1,
        "contact.sprocket.stribeck_speed: missing; static_friction and stribeck_speed are given together",
    ),
    (
        "contact/guide/stribeck_speed",
        0.1,
        "contact.guide.static_friction: missing; static_friction and stribeck_speed are given together",
    ),
    ("contact/guide/reference_load", 1e9, "contact.guide.reference_load = 1000000000.0: must be below 7.75806e+06 N"),
    (
        "guides/0/contact/width",
        1e-4,
        "guides.tight strand.contact.reference_load = 2000.0: must be below 0.0310",
    ),
    # run
    ("run/settle", 1, "run.settle = 1: must be true or false"),
    ("run/duration", 0, f"run.duration = 0: {POSITIVE}"),
    ("run/step", "fast", 'run.step = "fast": must be a positive number or "auto"'),
    ("run/step", -1e-5, 'run.step = -1e-05: must be a positive number or "auto"'),
    ("run/step", 3.0, "run.step = 3.0: must be at most the duration, 2"),
    ("run/step", None, 'run.step: missing; must be a positive number or "auto"'),
    ("run/integrator", "euler", 'run.integrator = "euler": must be "leapfrog" or "rk4"'),
    ("run/sample_rate", 0, f"run.sample_rate = 0: {POSITIVE}"),
    ("run/gravity", [0, -9.81, 0], "run.gravity = [0, -9.81, 0]: must be two finite numbers [x, y]"),
]


@pytest.mark.parametrize(("path", "value", "line"), RULES, ids=[f"{rule[0]}={rule[1]!r}"[:60] for rule in RULES])
def test_rule(values, path, value, line):
    if path.startswith("guides/0/contact/width"):  # an override of one of four materials
        put(values, "guides/0/contact", {})
    put(values, path, value)
    found = errors_of(values)
    assert any(error.startswith(line) for error in found), found
    if path != "contact/sprocket/width" and not path.startswith(("sprockets", "chain/roller_mass", "chains")):
        assert len(found) == 1, found


def test_one_sprocket_is_too_few(values):
    values["sprockets"] = values["sprockets"][:1]
    assert errors_of(values)[0].endswith(": must be a list of at least 2 sprockets")


def test_one_sprocket_must_be_prescribed(values):
    del values["sprockets"][0]["prescribed"]
    values["sprockets"][0]["inertia"] = 3.0
    assert errors_of(values) == ("sprockets: none is prescribed; at least one sprocket must be",)


def test_prescribed_sprocket_may_have_inertia_and_load(values):
    values["sprockets"][0] |= {"inertia": 900.0, "load": {"torque": 3}}
    assert Drive(**values).sprockets[0].inertia == 900.0


def test_stiffness_instead_of_materials(values):
    values["contact"]["guide"] = {"restitution": 0.5, "impact_speed_floor": 0.02, "stiffness": 6e5, "exponent": 1.5}
    assert Drive(**values).guide_contact(0).stiffness == 6e5
    del values["contact"]["guide"]["stiffness"]
    text = "missing; must be a positive number, or give width, reference_load, roller, partner instead"
    assert errors_of(values) == (f"contact.guide.stiffness: {text}",)


def test_friction_at_rest_is_no_less_than_in_motion(values):
    values["contact"]["sprocket"] |= {"friction": 0.2, "static_friction": 0.1, "stribeck_speed": 0.1}
    assert list(errors_of(values)) == ["contact.sprocket.static_friction = 0.1: must be at least friction, 0.2"]


def test_rolling_needs_friction_and_the_joints(values):
    values["contact"]["guide"] |= {"rolling": True}
    put(values, "contact/guide/friction", None)
    found = errors_of(values)
    assert "contact.guide.friction: missing; must be a number of at least 0; needed with rolling" in found
    values["contact"]["guide"] |= {"friction": 0.2}
    put(values, "chain/joint", None)
    assert list(errors_of(values)) == [
        "contact.guide.rolling = true: must be false without chain.joint, whose friction rolling rollers pass on"
    ]


def test_a_bush_in_series_is_linear(values):
    values["contact"]["sprocket"] |= {"bush_stiffness": 8e8, "exponent": 1.5}
    assert list(errors_of(values)) == [
        "contact.sprocket.exponent = 1.5: must be 1 with bush_stiffness, which is linear"
    ]


def test_kelvin_voigt_is_linear(values):
    values["contact"]["guide"] |= {"exponent": 1.5}
    values["guides"][0]["contact"] = {"law": "kelvin-voigt"}
    line = 'contact.exponent = 1.5: must be 1 with law = "kelvin-voigt", which is linear'
    assert errors_of(values) == (f"guides.tight strand.{line}",)
    values["contact"]["sprocket"] |= {"law": "kelvin-voigt", "exponent": 2.0}
    assert errors_of(values)[0] == f"contact.sprocket.{line.removeprefix('contact.').replace('1.5', '2.0')}"


def test_all_errors_of_a_file_at_once(values, tmp_path):
    """Errors of single values hide neither those of other parts nor the rules that tie values together."""
    put(values, "chain/pitch", -1)
    put(values, "chain/mass_per_length", 60.8)
    put(values, "chain/colour", "red")
    put(values, "sprockets/0/teeth", 3)
    put(values, "sprockets/1/inertia", None)
    put(values, "sprockets/2/name", "tightener")
    put(values, "sprockets/2/mount", {"kind": "elastic", "stiffness": [1, -1], "damping": [1, 1]})
    put(values, "guides/0/end", values["guides"][0]["start"])
    put(values, "contact/guide", None)
    put(values, "contact/sprocket/restitution", 2)
    put(values, "contact/sprocket/stiffness", 1e9)
    put(values, "contact/sprocket/profile", "iso606")
    put(values, "run/duration", None)
    del values["sprockets"][2]["mass"]
    found = errors_of(values)
    expected = [
        "chain.pitch = -1:",
        'chain.colour = "red": unknown key;',
        "chain.mass_per_length = 60.8: not together",
        "sprockets.crankshaft.teeth = 3:",
        "sprockets.1.inertia: missing;",
        "sprockets.2.mount.stiffness = [1, -1]:",
        "sprockets.2.mass: missing;",
        "guides.tight strand.end = ",
        "contact.sprocket.restitution = 2:",
        "contact.sprocket.stiffness = 1000000000.0: not together",
        "contact.sprocket.gap: missing;",
        "contact.sprocket.clearance = 0.0004: not together",
        "contact.sprocket.seat_angle = 138.0: not together",
        "run.duration: missing;",
        'sprockets.2.name = "tightener": must be unique',
        "contact.guide: missing;",
    ]
    assert len(found) == len(expected), found
    for start, line in zip(expected, found, strict=True):
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


def test_even_number_of_links_does_not_warn(values):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        Drive(**values)


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
    with pytest.raises(DriveError) as caught:
        Sprocket(
            name="a", teeth=9, center=(0, 0), wrap="cw", inertia=1, mount=SLIDER | {"direction": [0, 0], "damping": -1}
        )
    assert caught.value.errors == (
        "Sprocket: mount.direction = [0, 0]: must be two finite numbers [x, y], not both 0",
        f"Sprocket: mount.damping = -1: {NOT_NEGATIVE}",
        f'Sprocket: mass: missing; {POSITIVE}; needed with mount kind "slider"',
    )


def test_balance_wheel_without_mass_is_fine(values):
    values["sprockets"][0]["balance_wheel"] = {"mass": 0.0, "radius": 0.0, "phase": 0.0}
    assert loads_drive(dumps_drive(Drive(**values))) == Drive(**values)
