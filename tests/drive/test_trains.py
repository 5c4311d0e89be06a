"""Shafts, gears, couplings and motors as data: what contradicts what, ratios, speeds at the start and at the top."""

import math
import tomllib

import numpy as np
import pytest
from drives import errors_of, example, put, two_sprockets
from parts import coupling, gears, shaft

from warpchain import Drive, dumps_drive, load_drive, loads_drive
from warpchain.assembly import assemble
from warpchain.assembly.summary import derived_quantities, report
from warpchain.assembly.timestep import moving_bodies
from warpchain.drive.schema import NAME_TEXT
from warpchain.drive.shafts import Motor
from warpchain.errors import DriveError
from warpchain.model import Model, single_chain
from warpchain.model.trains import bodies_beyond_gear, body_speed_ratio, train_inertia, train_of_body

PARTS = (
    shaft("engine", inertia=0.4, motor={"torque": 50.0})
    + shaft("output", inertia=0.9, load={"viscous": 5.0})
    + gears("primary", ["driver", "engine"], [40, 20])
    + coupling("cush", ["driven", "output"], 4e4, damping=15.0, lash=0.001)
)


def values():
    """Two equal sprockets, the first geared to a motor, the second coupled to a load."""
    found = tomllib.loads(dumps_drive(two_sprockets(torque=0.0, settle="false")) + PARTS)
    del found["sprockets"][0]["prescribed"], found["sprockets"][1]["load"]
    found["sprockets"][0]["inertia"] = 0.7
    return found


SHAFT = {"name": "more", "inertia": 1.0, "load": {"torque": 1.0}}
SECOND = {"name": "second", "between": ["driven", "engine"], "teeth": [30, 20], "module": 0.004}
RING = {"name": "ring", "between": ["driver", "driven"], "teeth": [30, 30], "module": 0.004, "internal": True}
GEARBOX = {"time": [0.0, 0.1, 0.2], "ratio": [0.0, -2.5, -1.5]}
WRONG = {
    "a shaft that is not there": (
        {"sprockets/1/shaft": "cam"},
        'sprockets.driven.shaft = "cam": must be the name of a shaft; allowed are engine, output',
    ),
    "a gear on nothing": (
        {"gears/0/between": ["driver", "motor"]},
        'gears.primary.between.1 = "motor": must be the name of a shaft or a sprocket; allowed are driver, driven, '
        "engine, output",
    ),
    "gears that contradict the chain": (
        {"gears": [values()["gears"][0], SECOND]},
        'gears.second.teeth = [30, 20]: the rest of the drive turns "engine" 2 times as fast, the other way round, as '
        '"driven"; teeth as 2 to 1, internal = false would fit',
    ),
    "a coupling that would wind up": (
        {"couplings/0/between": ["engine", "output"], "sprockets/1/shaft": "output"},
        'couplings.cush.between = ["engine", "output"]: the rest of the drive turns "output" 0.5 times as fast, the '
        'other way round, as "engine"; a coupling needs two that turn alike',
    ),
    "two motions of one train": (
        {
            "shafts/0/prescribed": {"speed": 20.0},
            "shafts/0/motor": None,
            "sprockets/0/prescribed": {"speed": 10.0},
        },
        'shafts.engine.prescribed: not together with that of "driver", with which it turns as one; give one of the two',
    ),
    "a shaft that nothing turns": (
        {"shafts/1/load": None, "couplings/0/between": ["driven", "engine"], "gears": []},
        "shafts.output: nothing turns it: neither a sprocket on it, a gear or a coupling, nor a motor, load or "
        "prescribed",
    ),
    "speeds that do not fit": (
        {"shafts/0/initial_speed": 20.0, "shafts/1/initial_speed": 11.0, "sprockets/1/shaft": "output"}
        | {"couplings": []},
        'shafts.output.initial_speed = 11.0: must fit that of "engine", with which it turns: 10',
    ),
    "a load on a sprocket with a shaft": (
        {"sprockets/1/shaft": "output", "couplings": [], "sprockets/1/load": {"torque": 3.0}},
        'sprockets.driven.load: not on a sprocket with a shaft; give shafts."output".load instead',
    ),
    "a coupling within a train": (
        {"couplings/0/between": ["driver", "driven"], "gears": [RING]},
        'couplings.cush.between = ["driver", "driven"]: "driver" and "driven" turn as one already; must be two that do '
        "not",
    ),
    "a motor without a moment": (
        {"shafts/0/motor": {"ramp_time": 0.1}},
        "shafts.engine.motor.torque: missing; must be a positive number, or give table instead",
    ),
    "an inertia that is missing": (
        {"shafts/1/inertia": None},
        "shafts.output.inertia: missing; must be a positive number; needed unless the shaft is prescribed",
    ),
    "nothing that drives": (
        {"shafts/0/motor": None},
        "sprockets: none is prescribed; at least one sprocket must be, or a shaft, or have a motor or an initial_speed",
    ),
    "ratios out of order": (
        {"couplings/0/ratios": {"time": [0.0, 0.2, 0.1], "ratio": [2.0, 0.0, 1.5]}},
        "couplings.cush.ratios.time.2 = 0.1: must be above the element before, 0.2",
    ),
    "ratios that begin later": (
        {"couplings/0/ratios": {"time": [0.1, 0.2], "ratio": [2.0, 1.5]}},
        "couplings.cush.ratios.time.0 = 0.1: must be 0, from when on the first ratio is in use",
    ),
    "more times than ratios": (
        {"couplings/0/ratios": {"time": [0.0, 0.1, 0.2], "ratio": [2.0, 1.5]}},
        "couplings.cush.ratios.ratio = [2.0, 1.5]: must have as many elements as time, 3",
    ),
    "a ratio beyond all gears": (
        {"couplings/0/ratios": {"time": [0.0, 0.1], "ratio": [2.0, 1e-3]}},
        "couplings.cush.ratios.ratio.1 = 0.001: must be 0 (open), or 0.01 to 100 in magnitude",
    ),
    "a gearbox that never engages": (
        {"couplings/0/ratios": {"time": [0.0, 0.1], "ratio": [0.0, 0.0]}},
        "couplings.cush.ratios.ratio = [0.0, 0.0]: must have one that is not 0; without any the coupling never engages",
    ),
    "ratios between a shaft and a sprocket on it": (
        {"sprockets/1/shaft": "output", "sprockets/1/inertia": 1.0}
        | {"couplings/0/ratios": {"time": [0.0, 0.1], "ratio": [2.0, 1.0]}},
        "couplings.cush.ratios: not between a shaft and a sprocket on it; must be between two shafts",
    ),
    "a ratio that contradicts the chain": (
        {
            "couplings/0/between": ["engine", "driven"],
            "couplings/0/ratios": {"time": [0.0, 0.1], "ratio": [2.0, 0.0]},
            "sprockets/1/shaft": "output",
        },
        'couplings.cush.ratios.ratio: the rest of the drive turns "driven" 0.5 times as fast, the other way round, as '
        '"engine"; -2 would fit',
    ),
    "ratios that change beside a chain": (
        {
            "couplings/0/between": ["engine", "driven"],
            "couplings/0/ratios": {"time": [0.0, 0.1], "ratio": [-2.0, -1.5]},
            "sprockets/1/shaft": "output",
        },
        'couplings.cush.ratios.ratio: "engine" and "driven" turn in one ratio by the rest of the drive; must be one',
    ),
    "ratios that are no numbers": (
        {"couplings/0/ratios": {"time": [0.0, 0.1], "ratio": [[2.0], "x"]}},
        'couplings.cush.ratios.ratio = [[2.0], "x"]: must be a list of at least 2 finite numbers',
    ),
    "a shaft that is a list": (
        {"sprockets/1/shaft": ["output"], "couplings/0/ratios": GEARBOX},
        f'sprockets.driven.shaft = ["output"]: {NAME_TEXT}',
    ),
    "a clutch without a moment": (
        {"couplings/0/clutch": {}},
        "couplings.cush.clutch.torque: missing; must be a positive number, or give table instead",
    ),
    "a clutch with two moments": (
        {"couplings/0/clutch": {"torque": 5.0, "table": {"time": [0.0, 1.0], "torque": [5.0, 0.0]}}},
        "couplings.cush.clutch.torque = 5.0: not together with table",
    ),
    "a clutch that pushes": (
        {"couplings/0/clutch": {"table": {"time": [0.0, 1.0], "torque": [5.0, -1.0]}}},
        "couplings.cush.clutch.table.torque.1 = -1.0: must be at least 0",
    ),
    "a clutch that bears nothing": (
        {"couplings/0/clutch": {"table": {"time": [0.0, 1.0], "torque": [0.0, 0.0]}}},
        "couplings.cush.clutch.table.torque = [0.0, 0.0]: must have one above 0; without any the clutch bears nothing",
    ),
    "a clutch over an angle": (
        {"couplings/0/clutch": {"table": {"angle": [0.0, 2.0 * math.pi], "torque": [5.0, 5.0]}}},
        "couplings.cush.clutch.table.angle: not of a clutch; must be over time or speed",
    ),
    "a clutch over a speed backward": (
        {"couplings/0/clutch": {"table": {"speed": [-1.0, 1.0], "torque": [5.0, 5.0]}}},
        "couplings.cush.clutch.table.speed.0 = -1.0: must be at least 0: it is a magnitude",
    ),
    "a clutch over the speed of another": (
        {"couplings/0/clutch": {"table": {"speed": [0.0, 1.0], "torque": [5.0, 5.0], "shaft": "engine"}}},
        'couplings.cush.clutch.table.shaft = "engine": not of a clutch, whose speed is that of a shaft it is between',
    ),
    "a freewheel that is a number": (
        {"couplings/0/freewheel": 1},
        "couplings.cush.freewheel = 1: must be true or false",
    ),
    "the ground behind": (
        {"couplings/0/between": ["output", "ground"], "couplings/0/freewheel": True},
        'couplings.cush.between = ["output", "ground"]: must have "ground" first',
    ),
    "a spring to the ground": (
        {"couplings/0/between": ["ground", "output"]},
        "couplings.cush.clutch: missing; what is between the ground and a shaft must have one (a brake), or freewheel "
        "= true (a backstop)",
    ),
    "a gearbox to the ground": (
        {"couplings/0/between": ["ground", "output"], "couplings/0/freewheel": True, "couplings/0/ratios": GEARBOX},
        "couplings.cush.ratios: not to the ground",
    ),
    "a shaft that is the ground": (
        {"shafts/1/name": "ground", "couplings/0/between": ["driven", "driver"]},
        'shafts.ground.name = "ground": must be another name: couplings take it for what does not turn',
    ),
    "a backstop on a shaft": (
        {"shafts/1/backstop": True},
        'shafts.output.backstop = true: unknown key; give a coupling between "ground" and this one with freewheel = '
        "true",
    ),
    "a brake on a sprocket": (
        {"sprockets/1/brake": {"torque": 3.0}},
        'sprockets.driven.brake = { torque = 3.0 }: unknown key; give a coupling between "ground" and this one with a '
        "clutch",
    ),
    "a governor without a band": (
        {"shafts/0/motor/governor": {"speed": 7.0, "most": 0.5}},
        "shafts.engine.motor.governor.band: missing; must be a positive number",
        "shafts.engine.motor.governor.most = 0.5: must be a number of at least 1",
    ),
    "a table over two things": (
        {"shafts/0/motor": {"table": {"speed": [0.0, 1.0], "time": [0.0, 1.0], "torque": [1.0, 0.0]}}},
        "shafts.engine.motor.table.speed = [0.0, 1.0]: not together with time; give one of the two",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_contradictions_are_named(case):
    changes, *lines = WRONG[case]
    wrong = values()
    for path, value in changes.items():
        put(wrong, path, value)
    assert list(errors_of(wrong)) == lines


def test_a_governor_falls_with_the_speed():
    # the factor 1 + (w0 - w) / B times 50 N m, between 0 and `most`; its slope is that of a damper of 50 / B
    motor = Motor(torque=50.0, governor={"speed": 8.0, "band": 4.0, "most": 1.5})
    assert [motor.at(speed) for speed in (0.0, 7.0, 8.0, 10.0, 13.0)] == [75.0, 62.5, 50.0, 25.0, 0.0]
    assert (motor.largest_moment, motor.steepest_fall) == (75.0, 12.5)
    assert np.asarray(motor.at(np.array([7.0, 13.0]))).tolist() == [62.5, 0.0]


def test_sprockets_of_a_shaft_have_one_center():
    wrong = values()
    wrong["couplings"] = []
    for sprocket in wrong["sprockets"]:
        sprocket["shaft"] = "output"
    del wrong["gears"]
    assert errors_of(wrong)[0] == (
        'sprockets.driven.center = [1.0, 0.0]: must be that of "driver", which is on the same shaft: [0.0, 0.0]'
    )


def test_inertias_of_a_train():
    # as the driver sees it: 0.7 + 2^2 0.4; as the engine does, (1/2)^2 of that
    drive = Drive(**values())
    assert train_of_body(drive, 0) == ((0, 2), (1.0, -2.0))
    assert train_inertia(drive, 0) == pytest.approx(0.7 + 4.0 * 0.4, rel=1e-15)
    assert train_inertia(drive, 2) == pytest.approx(0.7 / 4.0 + 0.4, rel=1e-15)
    assert bodies_beyond_gear(drive, 0) == [2]


def test_a_loop_of_gears_that_fits_is_one_train():
    found = values()
    found["gears"] += [SECOND | {"teeth": [40, 20]}, RING]
    drive = Drive(**found)
    assert train_of_body(drive, 1) == ((0, 1, 2), (1.0, 1.0, -2.0))
    assert [bodies_beyond_gear(drive, g) for g in range(3)] == [
        [1, 2],
        [0, 2],
        [],
    ]  # the last pair of the loop carries nothing


def test_speeds_at_the_start_go_by_ratios():
    # the engine at 20 rad/s clockwise turns driver, chain, driven and, over the coupling, the output at 10 rad/s
    found = values()
    found["shafts"][0]["initial_speed"] = 20.0
    start = assemble(Drive(**found))
    assert start.sprocket_speed == pytest.approx([10.0, 10.0], rel=1e-12)
    assert start.shaft_speed == pytest.approx([-20.0, 10.0], rel=1e-12)
    found["shafts"][1]["initial_speed"] = 8.0  # a lash lets it be another
    assert assemble(Drive(**found)).shaft_speed == pytest.approx([-20.0, 8.0], rel=1e-12)


def test_top_speed_is_where_moments_balance():
    # 50 N m at the engine are 100 at the driver, against 5 N m s: 20 rad/s, if the run is long enough
    found = values()
    found["run"]["duration"] = 10.0
    drive = Drive(**found)
    assert Model(drive).driver_speed == pytest.approx(20.0, rel=1e-9)
    assert single_chain(drive).chain_speed == pytest.approx(20.0 * single_chain(drive).pitch_radius(0), rel=1e-9)
    found["shafts"][0]["motor"] = {"torque": 50.0, "power": 500.0}  # 500 W against 5 w^2
    assert Model(Drive(**found)).driver_speed == pytest.approx(10.0, rel=1e-9)


def test_a_coupling_lowers_the_step():
    # k (1/Ja + 1/Jb) beside the rollers on the driven sprocket's teeth, and c (1/Ja + 1/Jb)
    drive = Drive(**values())
    found = next(body for body in moving_bodies(drive) if body.name == 'coupling "cush"')
    alone = next(body for body in moving_bodies(drive) if body.name == 'sprocket "driven"')
    give = 1.0 / drive.sprockets[1].inertia + 1.0 / 0.9
    assert found.square == pytest.approx(4e4 * give + alone.square, rel=1e-12)
    assert found.rate == pytest.approx(15.0 * give, rel=1e-12)


def test_a_gearbox_ties_in_its_first_gear():
    # open at first, so the output starts from rest; speeds and frequencies are those of the first gear that comes
    found = values()
    found["shafts"][0]["initial_speed"], found["shafts"][1]["initial_speed"] = 20.0, 0.0
    found["couplings"][0]["ratios"] = GEARBOX
    drive = Drive(**found)
    assert body_speed_ratio(drive, 1, 3) == pytest.approx(2.5, rel=1e-12)
    assert assemble(drive).shaft_speed == pytest.approx([-20.0, 0.0], abs=1e-12)
    # k and c of the step's limit see 1/Ja + i^2/Jb of the largest ratio, check the first's
    body = next(body for body in moving_bodies(drive) if body.name == 'coupling "cush"')
    give = 1.0 / drive.sprockets[1].inertia + 6.25 / 0.9
    assert body.rate == pytest.approx(15.0 * give, rel=1e-12)
    (coupling,) = derived_quantities(drive)["couplings"]
    assert coupling["frequency"] == pytest.approx(math.sqrt(4e4 * give) / math.tau, rel=1e-12)
    assert coupling["ratios"] == [0.0, -2.5, -1.5]
    with_clutch = drive.with_values({"couplings.cush.clutch": {"table": {"time": [0.0, 0.1], "torque": [0.0, 80.0]}}})
    found = derived_quantities(with_clutch)
    assert found["couplings"][0]["clutch"] == 80.0
    line = next(line for line in report(found).splitlines() if line.split()[0:1] == ["cush"])
    assert line.split()[-11:-5] == ["open,", "-2.5,", "-1.5", "80", "N", "m"]
    assert loads_drive(dumps_drive(with_clutch)) == with_clutch


def grounded():
    """Those trains with a brake on the output whose torque rises with its speed, and a backstop."""
    found = values()
    table = {"speed": [0.0, 10.0, 20.0], "torque": [0.0, 30.0, 90.0]}
    own = {"stiffness": 5e3, "damping": 4.0}
    found["couplings"] += [
        own | {"name": "brake", "between": ["ground", "output"], "clutch": {"table": table}},
        own | {"name": "backstop", "between": ["ground", "driven"], "freewheel": True},
    ]
    return found


def test_the_ground_ties_nothing():
    # speeds, static state and ratios are those without; the step's limit has k / J, and c + dC/dw beside it
    without, drive = Drive(**values()), Drive(**grounded())
    assert Model(drive).driver_speed == Model(without).driver_speed
    assert derived_quantities(drive)["couplings"][0] == derived_quantities(without)["couplings"][0]
    brake, backstop = derived_quantities(drive)["couplings"][1:]
    assert (brake["working_torque"], backstop["working_torque"]) == (0.0, 0.0)
    assert (brake["freewheel"], backstop["freewheel"]) == (False, True)
    assert brake["frequency"] == pytest.approx(math.sqrt(5e3 / 0.9) / math.tau, rel=1e-12)
    body = next(body for body in moving_bodies(drive) if body.name == 'coupling "brake"')
    assert (body.square, body.rate) == pytest.approx((5e3 / 0.9, (4.0 + 6.0) / 0.9), rel=1e-12)
    assert "ground and driven, one way" in report(derived_quantities(drive))
    assert loads_drive(dumps_drive(drive)) == drive


def test_a_freewheel_contradicts_nothing():
    # the engine turns the output the other way and twice as fast as the chain does: whichever is faster drives it
    found = values()
    found["couplings"][0] |= {"between": ["engine", "output"], "freewheel": True}
    found["sprockets"][1]["shaft"] = "output"
    drive = Drive(**found)
    assert body_speed_ratio(drive, 3, 2) == 0.5
    found["couplings"][0]["freewheel"] = False
    assert "a coupling needs two that turn alike" in errors_of(found)[0]


def test_a_clutch_table_may_be_a_file(tmp_path):
    (tmp_path / "clutch.csv").write_text("time,torque\n0,0\n0.2,80\n")
    text = dumps_drive(Drive(**values())) + '[couplings.clutch]\ntable = { file = "clutch.csv" }\n'
    (tmp_path / "drive.toml").write_text(text)
    assert load_drive(tmp_path / "drive.toml").couplings[0].clutch.table.torque == (0.0, 80.0)


def test_drives_with_trains_are_written_and_read():
    drive = Drive(**values())
    assert loads_drive(dumps_drive(drive)) == drive
    assert drive.with_values({"gears.primary.module": 0.005}).gears[0].module == 0.005
    assert drive.with_values({"shafts.engine.motor.torque": "0.06 kNm"}).shafts[0].motor.torque == 60.0


def test_a_key_that_does_not_fit_is_refused():
    drive = Drive(**values())
    seated = math.degrees(assemble(drive).sprocket_angle[1])
    assert assemble(drive.with_values({"sprockets.driven.key": seated + 18.0})).sprocket_angle is not None
    with pytest.raises(DriveError, match=rf"sprockets.driven.key = .*: the chain seats at {seated:.4f} degrees"):
        assemble(drive.with_values({"sprockets.driven.key": seated + 5.0}))


def test_stacks_of_trains_have_the_bits_of_each():
    from warpchain.model.stacks import stacks_of_drives
    from warpchain.model.train_speeds import driver_top_speed

    drive = Drive(**values())
    drives = [drive.with_values({"shafts.engine.motor.torque": torque}) for torque in (50.0, 60.0, 70.0)]
    (stack,) = stacks_of_drives(drives)
    assert np.asarray(driver_top_speed(single_chain(stack.one))).tolist() == [Model(one).driver_speed for one in drives]


def test_bearings_rub_where_nothing_leads_and_gears_stand_still():
    drive = example("swing_idler")
    speed = Model(drive).driver_speed * drive.sprockets[drive.driver].teeth / drive.get_value("sprockets.idler.teeth")
    led = {"shafts": [{"name": "S", "prescribed": {"speed": speed}}], "sprockets.idler.shaft": "S"}
    line = (
        r'^sprockets\.idler\.bearing: not on a sprocket that turns with "S", whose prescribed motion nothing disturbs$'
    )
    with pytest.raises(DriveError, match=line):
        drive.with_values(led)
    gear = {"name": "g", "between": ["S", "idler"], "teeth": [20, 20], "module": 1e-3}
    line = r'^gears\.g\.between\.1 = "idler": must not be on an arm, which moves it from the other$'
    with pytest.raises(DriveError, match=line):
        drive.with_values({"shafts": [{"name": "S", "inertia": 1e-3}], "gears": [gear]})
