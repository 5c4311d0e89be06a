"""Drives of several chains: what files may say, ratios, and each chain as a drive of its own."""

import chains
import pytest

from warpchain.assembly.summary import derived_quantities
from warpchain.drive import dumps_drive, loads_drive
from warpchain.drive.examples import drive_path
from warpchain.errors import DriveError
from warpchain.model import Model
from warpchain.model.trains import is_free_body, train_inertia


def test_a_drive_of_two_chains_reads_back_equal():
    drive = chains.two_stages()
    assert loads_drive(dumps_drive(drive)) == drive
    assert drive.strand_names == (
        "first.crank->mid in", "first.mid in->crank", "second.mid out->out", "second.out->mid out",
    )  # fmt: skip


def test_a_single_chain_of_the_list_is_the_chain():
    alone = chains.side_by_side(1)
    assert not alone.chains and alone.chain.links == 60
    assert {sprocket.chain for sprocket in alone.sprockets} == {None}


def test_code_for_one_chain_refuses_several_in_one_line():
    with pytest.raises(DriveError, match=r"^chains: there are several, first, second; this takes drives of one chain"):
        _ = chains.two_stages().chain


def test_ratios_multiply_stage_by_stage():
    drive = chains.two_stages(teeth=(20, 30, 18, 36))
    assert Model(drive).shaft_ratios == {"mid": 2 / 3}
    assert Model(drive).speed_ratio(3, 0) == (20 * 18) / (30 * 36)


def test_each_chain_is_a_drive_with_the_inertia_of_its_shafts():
    first, second = Model(chains.two_stages()).chains
    assert [s.inertia for s in first.sprockets] == [None, 1.0] and train_inertia(first, 1) == 2.0
    assert [s.inertia for s in second.sprockets] == [2.0, 2.0]
    assert second.sprockets[0].prescribed.speed == pytest.approx(10.0 * 20 / 30)
    assert is_free_body(second, 0) and second.places["sprockets"] == (2, 3)


def error(text):
    with pytest.raises(DriveError) as caught:
        loads_drive(text)
    return str(caught.value).replace("<text>: ", "")


def text_of(**changes):
    """Two chains between the same two shafts, with other teeth on the second's driven sprocket and the like."""
    of = {"teeth": 20, "center": (0.0, 0.0), "shaft": "A", "chain": "b", "motion": "", "more": ""} | changes
    return (
        chains.chain("a", 60)
        + chains.chain("b", 60)
        + '[[shafts]]\nname = "A"\n[[shafts]]\nname = "B"\n'
        + chains.sprocket("a1", 20, (0.0, 0.0), "a", "A", "prescribed = { speed = 10.0 }")
        + chains.sprocket("a2", 40, (1.0, 0.0), "a", "B", "inertia = 1.0")
        + chains.sprocket("b1", of["teeth"], of["center"], of["chain"], of["shaft"], of["motion"])
        + chains.sprocket("b2", 41, (1.0, 0.0), "b", "B", of["more"])
        + chains.CONTACT
        + chains.run()
    )


WRONG = {
    'sprockets.b2.shaft = "B": the rest of the drive turns "b2" 0.97561 times as fast as "B"; teeth = 40 would fit': {},
    "sprockets.b1.chain = \"c\": must be the name of a chain; allowed are a, b": {"chain": "c"},
    'chains.b.name = "b": must be named by at least 2 sprockets, is by 1': {"chain": "a", "shaft": "B"},
    "sprockets.b1.chain: missing; must be the name of a chain: a, b": {"chain": ""},
    'sprockets.b1.shaft = "C": must be the name of a shaft; allowed are A, B': {"shaft": "C"},
    'sprockets.b1.center = [0.1, 0.0]: must be [0.0, 0.0], as of "a1" on the shaft "A"': {"center": (0.1, 0.0)},
    'sprockets.a2.mount.kind': None,
    'sprockets.b2.mount: must be the same as of "a2" on the shaft "B"': {
        "more": 'mount = { kind = "prescribed", direction = [1.0, 0.0], amplitude = 1e-4, frequency = 3.0 }'
    },
    'sprockets.b2.mount.kind = "elastic": must be "fixed" or "prescribed", as the shaft "B" has several sprockets': {
        "more": 'mass = 1.0\nmount = { kind = "elastic", stiffness = [1e6, 1e6], damping = [0.0, 0.0] }'
    },
}  # fmt: skip
del WRONG["sprockets.a2.mount.kind"]


@pytest.mark.parametrize("line", WRONG)
def test_wrong_values_are_named_in_a_line(line):
    assert line in error(text_of(**WRONG[line])).split("\n")


MISTYPED = {
    ('chain = "left"', 'chian = "left"'): [
        'sprockets.idler left.chian = "left": unknown key; did you mean chain?',
        "sprockets.idler left.chain: missing; must be the name of a chain: primary, left, right, exhaust",
    ],
    ('chain = "left"', 'chain = "lefft"'): [
        'sprockets.idler left.chain = "lefft": must be the name of a chain; did you mean left?'
    ],
    ('shaft = "idler shaft"', 'shaft = "idle shaft"'): [
        'sprockets.idler.shaft = "idle shaft": must be the name of a shaft; did you mean idler shaft?'
    ],
}


@pytest.mark.parametrize("words", MISTYPED)
def test_a_mistyped_name_is_told_alone(words):
    """Nothing is said of what only follows from it: chains without sprockets, or that nothing turns."""
    assert error(drive_path("v6").read_text().replace(*words, 1)).split("\n") == MISTYPED[words]


def test_a_list_of_chains_under_chain_is_one_error():
    (line,) = error(drive_path("v6").read_text().replace("[[chains]]", "[[chain]]")).split("\n")
    assert line.startswith("chain = [{ name") and line.endswith(
        ": must be a table; a list of them is chains, [[chains]]"
    )


SHAFT = '[[shafts]]\nname = "A"\n'
GIVEN = "prescribed = { speed = 10.0 }"
PAIR = '[[gears]]\nname = "g"\nbetween = ["A", "B"]\nteeth = [{teeth}]\nmodule = 1e-3\n{more}'
GEARED = {
    'gears.g.teeth = [9, 9]: the rest of the drive turns "B" 0.5 times as fast as "A"; '
    "teeth as 1 to 2, internal = true would fit": PAIR.format(teeth="9, 9", more=""),
    'couplings.c.between = ["A", "C"]: the rest of the drive turns "C" 0.5 times as fast, the other way round, as "A"; '
    "a coupling needs two that turn alike":
        SHAFT + '[[shafts]]\nname = "C"\ninertia = 1.0\n' + PAIR.format(teeth="9, 18", more="").replace('"B"', '"C"')
        + '[[couplings]]\nname = "c"\nbetween = ["A", "C"]\nstiffness = 9.0\n',
    'couplings.c.between = ["a1", "C"]: the rest of the drive turns "C" 0.5 times as fast, the other way round, '
    'as "a1"; a coupling needs two that turn alike':
        SHAFT + '[[shafts]]\nname = "C"\ninertia = 1.0\n' + PAIR.format(teeth="9, 18", more="").replace('"B"', '"C"')
        + '[[couplings]]\nname = "c"\nbetween = ["a1", "C"]\nstiffness = 9.0\n',
    'couplings.c.between = ["A", "B"]: the rest of the drive turns "B" 0.5 times as fast as "A"; '
    "a coupling needs two that turn alike": '[[couplings]]\nname = "c"\nbetween = ["A", "B"]\nstiffness = 9.0\n',
    'sprockets.a1.prescribed: not together with shafts."A".motor; give one of the two':
        SHAFT + "motor = { torque = 1.0 }\n",
    'sprockets.a2.prescribed.speed = 3.0: must fit that of "a1", which is prescribed, too, and turns it: 5':
        SHAFT + '[[shafts]]\nname = "C"\ninertia = 1.0\n' + PAIR.format(teeth="9, 18", more="").replace('"B"', '"C"'),
    'shafts.A.initial_speed = 1.0: not where "a1" is prescribed, with which it turns': SHAFT + "initial_speed = 1.0\n",
    "shafts.C: nothing turns it: neither a sprocket on it, a gear or a coupling, nor a motor, load or prescribed":
        SHAFT + '[[shafts]]\nname = "C"\ninertia = 1.0\n',
    'shafts.C.inertia: missing; must be a positive number; needed as nothing prescribes "C"':
        SHAFT + '[[shafts]]\nname = "C"\nload = { torque = 1.0 }\n',
    'shafts.A.prescribed: not together with that of "a1", with which it turns as one; give one of the two':
        f"{SHAFT}{GIVEN}\n",
}  # fmt: skip
"""Contradictions beside several chains, or what is given twice."""


@pytest.mark.parametrize("line", GEARED)
def test_contradictions_of_gears_and_chains_are_refused_in_a_line(line):
    text, more = text_of(more="").replace("41", "40"), GEARED[line]
    loads_drive(text)
    text = text.replace("inertia = 1.0", "prescribed = { speed = 3.0 }", 1) if "too, and turns" in line else text
    assert error(text.replace(SHAFT, more) if SHAFT in more else text + more) == line


ALONE = {
    ('["M", "A"]', '["N", "A"]'): 'gears.g.between.0 = "N": must be the name of a shaft or a sprocket; allowed are',
    ('["M", "A"]', '["M", "M"]'): 'gears.g.between = ["M", "M"]: must be two different shafts',
    ("[9, 18]", "[9, -18]"): "gears.g.teeth = [9, -18]: must be two integers",
    ("[[gears]]", "[gears]"): "gears = { name",
    ('chain = "b"', ""): "sprockets.b1.chain: missing; must be the name of a chain: a, b",
    ('shaft = "A"', 'shaft = "AA"'): 'sprockets.a1.shaft = "AA": must be the name of a shaft; did you mean A?',
    ("motor = { torque = 5.0 }", "motor = { }"): "shafts.M.motor.torque: missing; must be a positive number, or",
    ("motor = {", "load = {"): "sprockets: none is prescribed; at least one sprocket must be, or a shaft, or have a",
    ("motor = { torque = 5.0 }", "initial_speed = 0.0"): "sprockets: none is prescribed; at least one sprocket must be",
}


@pytest.mark.parametrize("words", ALONE)
def test_a_fault_of_what_turns_chains_is_told_alone(words):
    """Not beside it that nothing turns the chains, or that something lacks an inertia."""
    text = text_of().replace("41", "40").replace(GIVEN, "inertia = 1.0")
    text += '[[shafts]]\nname = "M"\ninertia = 1.0\nmotor = { torque = 5.0 }\n'
    text += PAIR.format(teeth="9, 18", more="").replace('["A", "B"]', '["M", "A"]')
    loads_drive(text)
    (line,) = error(text.replace(*words, 1)).split("\n")
    assert line.startswith(ALONE[words])


def test_ratios_of_chains_that_contradict_each_other_beside_gears_name_the_teeth():
    pump = PAIR.format(teeth="9, 18", more="").replace('"B"', '"C"') + '[[shafts]]\nname = "C"\ninertia = 1.0\n'
    line = (
        'sprockets.b2.shaft = "B": the rest of the drive turns "b2" 0.97561 times as fast as "B"; teeth = 40 would fit'
    )
    assert error(text_of(more="") + pump) == line


def test_one_sprocket_of_a_shaft_is_prescribed():
    text = text_of(motion="prescribed = { speed = 10.0 }").replace("41", "40")
    line = 'sprockets.b1.prescribed: not together with that of "a1", with which it turns as one; give one of the two'
    assert error(text) == line


def test_bearings_do_not_rub_where_the_shaft_is_prescribed():
    text = text_of(motion="bearing = { friction = 0.1, radius = 0.01 }").replace("41", "40")
    line = 'sprockets.b1.bearing: not on a sprocket that turns with "a1", whose prescribed motion nothing disturbs'
    assert error(text) == line


def test_a_shaft_gives_what_it_has_to_its_first_sprocket():
    on_sprockets = chains.side_by_side(2)
    values = {f"sprockets.{name}": None for name in ("a0.prescribed", "b0.load", "b0.inertia")}
    values |= {"shafts.A.prescribed.speed": 10.0, "shafts.B.load.torque": 600.0, "shafts.B.inertia": 2.0}
    on_shafts = on_sprockets.with_values(values)
    assert (on_shafts.driver, Model(on_shafts).driver_speed) == (0, 10.0)
    tensions = [
        [
            strand["working_tension"]
            for chain in derived_quantities(of)["chains"].values()
            for strand in chain["strands"]
        ]
        for of in (on_shafts, on_sprockets)
    ]
    assert tensions[0] == pytest.approx(tensions[1], rel=1e-9)
    both = on_shafts.with_values({"sprockets.b1.inertia": 3.0})
    assert [train_inertia(chain, 1) for chain in Model(both).chains] == [5.0, 5.0]
    assert loads_drive(dumps_drive(both)) == both


def test_harmonics_count_the_turns_of_shafts_over_chains():
    harmonic = {"order": 2.0, "amplitude": 1.0, "shaft": "mid"}
    drive = chains.two_stages().with_values({"sprockets.out.load.harmonics": [harmonic]})
    _, second = Model(drive).chains
    (found,) = second.sprockets[1].load.harmonics
    assert (found.shaft, found.order) == (None, 2.0 * 36 / 18)


def test_a_chain_that_nothing_turns_is_named():
    text = text_of(shaft="").replace('chain = "b"\nshaft = "B"', 'chain = "b"')
    line = 'chains.b.name = "b": is turned by nothing: neither a sprocket of it, nor what that turns with'
    assert line in error(text)


def test_chains_with_a_shaft_in_common_are_not_in_one_plane():
    plane = '\nplane = "front"\n[[chains]]'
    text = text_of(teeth=40).replace("41", "80").replace("\n[[chains]]", plane, 2).replace(plane, "\n[[chains]]", 1)
    text = text.replace('[[shafts]]\nname = "A"', 'plane = "front"\n[[shafts]]\nname = "A"', 1)
    line = 'chains.b.plane = "front": must be another than of the chain "a", which has a sprocket on the same shaft'
    assert line in error(text).split("\n")


def test_both_chain_and_chains_are_too_many():
    alone = chains.chain("x", 60).replace("[[chains]]", "[chain]").replace('name = "x"', "")
    assert "chains = 2: not together with chain; give one of the two" in error(alone + text_of())
