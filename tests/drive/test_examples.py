"""The example drives of the package: each loads, fits, and runs; what their comments claim holds."""

import warnings
from pathlib import Path

import numpy as np
import pytest
from drives import LARGE, STARTING, but, example
from loading import load_script

from warpchain import Record, cli, simulate
from warpchain.assembly.arm_balance import chain_path
from warpchain.assembly.crossings import assemble_chains
from warpchain.assembly.fitting import strand_sag
from warpchain.assembly.summary import derived_quantities
from warpchain.drive import dumps_drive, loads_drive
from warpchain.drive.examples import drive_path, example_names, is_example
from warpchain.model import Model, single_chain
from warpchain.results.chains import chain_trajectories
from warpchain.results.losses import losses

NAMES = example_names()
STARTS = "bucket_elevator", "fork_lift", "hoist", "motorcycle_drivetrain", "transfer_case"
STEADY = tuple(name for name in NAMES if name not in STARTS)
"""What runs steadily by the end."""


def load(name):
    return example(name)


def test_names():
    assert NAMES == (
        "balance_shafts",
        "bucket_elevator",
        "car",
        "chain_conveyor",
        "conveyor",
        "derailleur",
        "engine",
        "fork_lift",
        "hoist",
        "industrial",
        "marine",
        "marine_lever",
        "marine_no_guides",
        "motorcycle",
        "motorcycle_drivetrain",
        "silent_timing",
        "swing_idler",
        "transfer_case",
        "v6",
    )
    assert all(is_example(drive_path(name)) for name in NAMES)


def test_the_gallery_has_every_example():
    """Its picture, its file and the command that runs it."""
    docs = Path(__file__).resolve().parents[2] / "docs"
    gallery = (docs / "examples.md").read_text().split("## Gallery")[1].split("\n## ")[0]
    for name in NAMES:
        picture = f"images/{name.replace('_', '-')}-drive.png"
        file = f"../warpchain/drive/examples/{name}.toml"
        assert f"[![{name}]({picture})]({picture})<br>[`{name}`]({file})" in gallery
        assert (docs / picture).exists() and (docs / file).exists()


@pytest.mark.parametrize("name", but(NAMES, LARGE))
def test_loads_fits_and_is_checked_without_warnings(name, capsys):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        drive = load(name)
    assert all(abs(assembly.strain) < 5e-3 for assembly in assemble_chains(Model(drive)))
    assert loads_drive(dumps_drive(drive)) == drive
    values = derived_quantities(drive)
    assert values["step"] == pytest.approx(0.6 * values["step_limit"])
    for chain in values.get("chains", {"": values}).values():
        if chain["breaking_load"] is not None:
            largest = max(strand["working_tension"] for strand in chain["strands"])
            assert 0.005 < largest / chain["breaking_load"] < 1 / 7  # a usual least safety factor
    assert cli.main(["check", name]) == 0
    assert capsys.readouterr().err == ""


@pytest.fixture(scope="module")
def table():
    """The script of docs/examples.md's table."""
    return load_script("drawings.examples")


@pytest.fixture(scope="module")
def runs(table):
    """Every steady example for 0.6 of its time, and after them two more marine drives, 1e-9 and 2e-9 faster.

    The idler of `swing_idler` still swings then, and the empty strand of `chain_conveyor`: all of their time.
    """
    drives = [load(name) for name in STEADY] + table.nearby_copies(load("marine"), 3)[1:]
    whole = STEADY.index("swing_idler"), STEADY.index("chain_conveyor")
    lengths = [drive.run.duration * (1.0 if i in whole else 0.6) for i, drive in enumerate(drives)]
    drives = [drive.with_values({"run.duration": length}) for drive, length in zip(drives, lengths, strict=True)]
    channels = ("position", "tension", "sprocket_force", "sprocket_center")
    return simulate(drives, record=Record(range(len(STEADY)), rate=1000.0, channels=channels))


@pytest.mark.parametrize("name", STEADY)
def test_runs_that_can_be_believed(runs, name):
    """Judged ok, steady over its window, the energy balance within 1e-3 of the turnover; no link is pulled by 0.5 %."""
    i = STEADY.index(name)
    row, trajectory = runs.metrics.to_pylist()[i], runs[i]
    assert (row["status"], row["reason"]) == ("ok", "")
    assert row["steady"]
    assert abs(row["energy_residual_relative"]) < 1e-3
    for chain in chain_trajectories(trajectory).values():
        x = chain.position.astype(float)
        length = np.hypot(*np.moveaxis(np.roll(x, -1, axis=1) - x, -1, 0))
        assert length == pytest.approx(chain.parts.chain.pitch, rel=5e-3)


def test_a_gear_change_and_a_coast_down():
    """The whole of it: the balance within 1e-3 of the turnover, and where the energy goes."""
    drive = load("motorcycle_drivetrain")
    options = {"window": (0.0, drive.run.duration), "limits": STARTING}
    run = simulate(drive, record=Record(rate=1000.0, channels=("shaft_speed", "coupling_torque")), **options)
    (row,) = run.metrics.to_pylist()
    assert (row["status"], row["reason"]) == ("ok", "")
    assert abs(row["energy_residual_relative"]) < 1e-3
    lost, gone = losses(drive, row), row["input_work"] - row["output_work"] - row["energy_change"]
    assert sum(lost.values()) == pytest.approx(gone, rel=0.01)
    # the clutch bears 60 N m while the crankshaft comes down: three fifths of the whole loss
    assert 0.5 < lost["clutches and gear changes"] / gone < 0.8
    assert row["clutch.slip_loss"] > 0.0 and row["tire.slip_loss"] == 0.0
    # in second, then in third, basket and mainshaft as one: countershaft over basket is 17/29, then 18/23
    speed = np.abs(run[0].shaft_speed.astype(float))
    time, ratio = run[0].time, speed[:, 3] / speed[:, 1]
    for part, expected in (((0.05, 0.2), 17.0 / 29.0), ((0.45, 0.6), 18.0 / 23.0)):
        assert ratio[(time > part[0]) & (time < part[1])].mean() == pytest.approx(expected, rel=5e-3)
    # open, nothing comes through; then the engine pulls, and at last it brakes
    gearbox = run[0].coupling_torque[:, 1]
    assert (gearbox[(time > 0.226) & (time < 0.254)] == 0.0).all()
    assert gearbox[(time > 0.5) & (time < 0.6)].mean() > 10.0 > 0.0 > gearbox[time > 0.7].mean()


def test_gears_of_balance_shafts_pass_on_what_speeds_these_up(runs):
    """Their speed is 2 w (1 + a cos 2 phi), 2 phi of the crankshaft: J times its slope, 8 w^2 a J, at the pitch radius
    over cos 20 degrees, for both shafts over the first pair and for one over the second."""
    drive, row = load("balance_shafts"), runs.metrics.to_pylist()[STEADY.index("balance_shafts")]
    (harmonic,), speed = drive.shafts[0].prescribed.harmonics, drive.shafts[0].prescribed.speed
    for gear, count in zip(drive.gears, (2, 1), strict=True):
        most = count * drive.shafts[1].inertia * 4.0 * speed**2 * harmonic.amplitude
        lever = 0.5 * gear.teeth[1] * gear.module * np.cos(np.radians(20.0))
        assert row[f"{gear.name}.tooth_force_max"] == pytest.approx(most / lever, rel=2e-3)
    assert row["second balance shaft.speed_mean"] == pytest.approx(-2.0 * speed, rel=1e-3)
    assert row["tongue.torque_mean"] == pytest.approx(row["rotor.speed_mean"] ** 2 * -3.5e-5 - 0.5, rel=5e-3)


def test_marine_copies_agree(runs):
    """Speeds 1e-9 apart: without friction and bushes that give, mean tensions came out 1.3 % apart."""
    rows = runs.metrics.to_pylist()
    copies = [rows[STEADY.index("marine")], *rows[len(STEADY) :]]
    mean = np.array([row["tension_mean"] for row in copies])
    assert len(mean) == 3 and np.ptp(mean) < 5e-3 * mean[0]
    assert mean[0] == pytest.approx(20e3, rel=0.05)
    for row in copies:
        assert row["tension_min"] > 0.0
        assert row["tension_max"] < 60e3


def test_marine_chain_stays_in_its_gaps(runs, table):
    """Four fifths of the time at least; it was a third."""
    assert table.contact_share(runs[STEADY.index("marine")]) > 0.8


def test_conveyor_balances_its_load():
    """Steady: (tight - slack) R = moment = 900 + 15 omega; 1 % since the speed's ripple is averaged over 0.2 s only."""
    drive = load("industrial").with_values({"run.duration": 0.6, "run.step": 4e-6})
    (row,) = simulate(drive, record=Record("none"), window=(0.4, 0.6)).metrics.to_pylist()
    moment = 900.0 + 15.0 * 31.4 / 3.0
    assert row["conveyor.moment_mean"] == pytest.approx(moment, rel=0.01)
    pull = row["conveyor->motor.tension_mean"] - row["motor->conveyor.tension_mean"]
    assert pull * single_chain(drive).pitch_radius(1) == pytest.approx(moment, rel=0.01)


def test_cars_arm_and_guide_have_half_of_its_friction(runs):
    """Published: nearly 45 % (SAE 2017-01-0462, Figure 1), the arm most of it (SAE 2010-01-2202)."""
    row = runs.metrics.to_pylist()[STEADY.index("car")]
    blade, guide = row["blade.friction"], row["fixed guide.friction"]
    teeth = sum(row[f"{name}.friction"] for name in ("crank", "intake cam", "exhaust cam"))
    assert 0.3 < (blade + guide) / (blade + guide + teeth + row["joints.friction"]) < 0.7
    assert blade > guide
    assert row["blade.missed"] == row["fixed guide.missed"] == row["crank.slips"] == 0


def test_cars_guides_rub_as_belts_do(runs):
    """Friction power of a seated arc: mu(v) (T - m v^2/p) beta v, with the mean tension of its strand, whose two halves
    differ by that friction, and beta the angle by which the guide bends the path. Speed and tension ripple: 5 %."""
    row, drive = runs.metrics.to_pylist()[STEADY.index("car")], load("car")
    span, chain, rubbing = row["window_end"] - row["window_start"], drive.chain, drive.contact.guide
    v = drive.sprockets[0].prescribed.speed * drive.sprockets[0].teeth * chain.pitch / (2.0 * np.pi)
    mu = rubbing.friction + (rubbing.static_friction - rubbing.friction) * np.exp(-((v / rubbing.stribeck_speed) ** 2))
    for guide, strand, degrees in (("blade", 0, 21.9), ("fixed guide", 2, 9.8)):
        tension = row[f"{drive.strand_names[strand]}.tension_mean"] - chain.mass / chain.pitch * v**2
        power = mu * tension * np.radians(degrees) * v
        assert row[f"{guide}.friction"] / span == pytest.approx(power, rel=0.05)


def test_cars_arm_stands_between_chain_and_tensioner(runs):
    """Steady: the chain's mean moment on the arm is the tensioner's force times its lever. The arm turns by a few mrad,
    which changes the lever by as many thousandths; over the window its momentum changes by I omega, below 1 %: 2 %."""
    row, drive = runs.metrics.to_pylist()[STEADY.index("car")], load("car")
    tensioner, arm = drive.tensioners[0], drive.arms[0]
    reach = np.subtract(tensioner.at, arm.pivot)
    lever = reach[1] * tensioner.direction[0] - reach[0] * tensioner.direction[1]
    assert row["arm.moment_mean"] == pytest.approx(row["tensioner.force_mean"] * lever, rel=0.02)
    assert 50.0 < row["tensioner.force_mean"] < 200.0
    assert 100.0 < row["crank->intake cam.tension_mean"] < row["exhaust cam->crank.tension_mean"] < 500.0


def test_a_transfer_case_goes_from_rest_to_full_torque_and_back():
    """Ok as a start. At full torque (T_t - T_s) R is the load, within 1 %: links lean and their friction adds to it.

    At rest again both wheels have turned alike: strands that are 20 N m apart lag by less than 0.1 degrees.
    """
    drive = load("transfer_case")
    run = simulate(drive, record=Record(rate=1000.0, channels=("sprocket_angle",)), window=(0.35, 0.5))
    (row,) = run.metrics.to_pylist()
    assert (row["status"], row["reason"]) == ("ok", "")
    assert abs(row["energy_residual_relative"]) < 1e-6
    pull = row["front shaft->main shaft.tension_mean"] - row["main shaft->front shaft.tension_mean"]
    assert pull * single_chain(drive).pitch_radius(1) == pytest.approx(280.0 + 0.02 * 200.0, rel=0.01)
    assert row["efficiency"] == pytest.approx(0.9925, abs=1e-3)
    turned = run[0].sprocket_angle[-1] - run[0].sprocket_angle[0]
    assert np.ptp(turned) < np.radians(0.1)


def test_guides_rub_on_the_backs_of_a_silent_chain(runs):
    """Both bear all the time, as those of `car`, and take as much of the friction."""
    rows = runs.metrics.to_pylist()
    silent, roller = (rows[STEADY.index(name)] for name in ("silent_timing", "car"))
    assert abs(silent["energy_residual_relative"]) < 1e-4
    for guide in ("blade", "fixed guide"):
        assert silent[f"{guide}.missed"] == 0
        assert silent[f"{guide}.friction"] == pytest.approx(roller[f"{guide}.friction"], rel=0.1)


@pytest.mark.parametrize(("name", "sag"), [("industrial", 0.02), ("motorcycle", 0.02)])
def test_sags_are_as_the_comments_say(name, sag):
    """Centers are rounded to 1e-6 m: dh = 3 C / (16 h) 1e-6 is 1e-5 m at most."""
    drive = load(name)
    assert strand_sag(single_chain(drive), assemble_chains(Model(drive))[0], 0) == pytest.approx(sag, abs=1.5e-5)


def test_engine_fits_and_its_blade_indents_by_a_millimeter():
    drive = load("engine")
    assert abs(assemble_chains(Model(drive))[0].strain) < 1e-6
    path, (blade,) = chain_path(single_chain(drive)), drive.guides
    t = path.strand_end[3] - path.strand_start[3]
    t /= np.hypot(*t)
    for point in (blade.start, blade.end):
        off = (np.array(point) - path.strand_start[3]) @ np.array([-t[1], t[0]])
        assert off + drive.chain.roller_radius == pytest.approx(1e-3, abs=2e-6)


def test_engines_tensioner_holds_its_preload():
    """Steady: the mount pushes with the preload less its spring's travel, and that is what the chain's pull on the
    tensioner comes to: (T - (m/p) v^2) along the slide from each of its strands. Over the window the damper adds
    c dx / 0.1 s, dx twice the largest travel at most. Strands swing and curve: 2 %."""
    drive = load("engine").with_values({"run.duration": 0.2, "run.step": 1e-6})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run = simulate(drive, record=Record("none"), window=(0.1, 0.2))
    (row,) = run.metrics.to_pylist()
    mount, pitch = drive.sprockets[1].mount, drive.chain.pitch
    assert mount.kind == "slider" and drive.sprockets[1].name == "tensioner"
    force = row["tensioner.mount_force_mean"]
    damped = mount.damping * 2.0 * row["tensioner.travel_max"] / 0.1
    assert force == pytest.approx(mount.preload + mount.stiffness * row["tensioner.travel_x_mean"], abs=damped)
    assert force == pytest.approx(mount.preload, rel=0.02)
    assert row["tensioner.travel_max"] < 1.5e-3
    path, driver = chain_path(single_chain(drive)), drive.sprockets[0]
    speed = driver.prescribed.speed * driver.teeth * pitch / (2 * np.pi)
    pull = 0.0
    for strand, away in ((0, -1.0), (1, 1.0)):
        x = path.strand_end[strand] - path.strand_start[strand]
        tension = row[f"{drive.strand_names[strand]}.tension_mean"] - drive.chain.mass / pitch * speed**2
        pull += tension * away * x[0] / np.hypot(*x)
    assert force == pytest.approx(pull, rel=0.02)


def test_marine_without_guides_is_the_marine_drive_otherwise():
    bare = load("marine").with_values({"guides": (), "contact.guide": None})
    assert load("marine_no_guides") == bare


def test_the_derailleurs_cage_swings_with_its_strands():
    """After its axle has moved the cage stands where a taut chain's path has it, and twitches with the two long
    strands, sqrt(T p / m) / 2 L: their sag takes 0.1 degrees of the cage, and the swing of one draws on the other, 4 %
    at most.
    """
    script, drive = load_script("drawings.derailleur"), load("derailleur")
    run = simulate(script.hit_drive(drive), record=Record(rate=2000.0, channels=("arm_angle", "tension")))[0]
    time, height, level = script.cage_swings(run)
    assert len(time) > 2 and (np.diff(height) < 0.0).all()
    before, after = (
        np.degrees(chain_path(single_chain(one)).arm_angle[0]) for one in (drive, script.drive_after_move(drive))
    )
    sag = np.degrees(run.arm_angle[np.searchsorted(run.time, script.BEGIN), 0]) - before
    assert level - sag == pytest.approx(after, abs=0.1)
    path, pull = (
        chain_path(single_chain(script.drive_after_move(drive))),
        np.asarray(run.tension[run.time > time[-1]]).mean(),
    )
    wave = np.sqrt(pull * drive.chain.pitch / drive.chain.mass)
    lengths = [np.hypot(*(path.strand_end[k] - path.strand_start[k])) for k in (0, 3)]
    swing = np.mean([wave / (2.0 * length) for length in lengths])
    assert 1.0 / np.diff(time).mean() == pytest.approx(swing, rel=0.04)
    assert float(script.twitch_rate(run)) == pytest.approx(2.0 * swing, rel=0.04)  # one at each half swing


def test_the_derailleurs_axle_rises_on_any_path():
    """Its end is 36 mm higher; about a point it keeps its distance from there, and so does all of the rear end."""
    script, drive = load_script("drawings.derailleur"), load("derailleur")
    cog, hanger = drive.sprockets[script.COG].center, drive.arms[0].pivot
    for about in script.PATHS.values():
        way, other = (script.axle_table(place, cog, about) for place in (cog, hanger))
        assert way["y"][-1] == pytest.approx(script.RISE, rel=1e-9) and abs(way["x"][0]) + abs(way["y"][0]) < 1e-12
        if about is None:
            assert set(way["x"]) == {0.0} and other == way
            continue
        if about == "linkage":  # the rocker's rear end, on the stay, keeps its distance from its front end
            front, rear = script.ROCKER
            moves = script.axle_table(rear, cog, about)
            ends = [np.hypot(*(np.add(rear, (moves["x"][k], moves["y"][k])) - front)) for k in (0, -1)]
            assert ends[0] == pytest.approx(ends[1], rel=1e-9)
            continue
        for place, moves in ((cog, way), (hanger, other)):
            ends = [np.hypot(*(np.add(place, (moves["x"][k], moves["y"][k])) - about)) for k in (0, -1)]
            assert ends[0] == pytest.approx(ends[1], rel=1e-12)
