"""Drives of several chains with gears, couplings, motors and bare shafts, against closed forms and one chain."""

import math

import chains
import numpy as np
import pytest
from blocks import pack_for
from drives import STARTING, assert_alone_as_in_a_crowd, periods, ran, swing
from parts import coupling, gears, shaft
from raw import stepped

from warpchain import Record, dumps_drive, loads_drive, simulate
from warpchain.assembly.summary import derived_quantities
from warpchain.assembly.timestep import step_limit
from warpchain.model import Model
from warpchain.results.chains import chain_trajectories
from warpchain.results.schedule import Schedule

pytestmark = pytest.mark.filterwarnings("ignore::warpchain.errors.SuspectWarning")

PUMP = chains.PUMP.replace('"mid"', '"B"').replace("load = { viscous = 2.0 }\n", "")


@pytest.fixture(scope="module")
def beside_each_other():
    """Two chains with a geared pump; with its inertia on their shaft instead; and one of twice everything with it."""
    short = {"duration": 0.02, "step": 2.5e-6}
    geared = chains.plus(chains.side_by_side(2, **short), PUMP)
    alone = chains.side_by_side(2, **short).with_values({"sprockets.b0.inertia": 2.0 + 0.25 * 0.8})
    one = chains.plus(chains.side_by_side(0, **short), PUMP.replace('"B"', '"b0"'))
    return simulate([geared, alone, one], device="cpu")


def test_a_geared_inertia_is_that_times_the_ratio_squared(beside_each_other):
    """rho = -1/2; to round-off, which contacts amplify."""
    geared, alone = beside_each_other[0], beside_each_other[1]
    np.testing.assert_allclose(geared.position, alone.position, rtol=0, atol=1e-10)
    pump = geared.drive.shafts.index(next(shaft for shaft in geared.drive.shafts if shaft.name == "pump"))
    np.testing.assert_allclose(geared.shaft_speed[:, pump], -0.5 * alone.sprocket_speed[:, 1], rtol=1e-12)
    rows = beside_each_other.metrics.to_pylist()
    assert rows[0]["c1.tension_mean"] == pytest.approx(rows[1]["c1.tension_mean"], rel=1e-12)
    assert abs(rows[0]["energy_residual_relative"]) < 1e-5


def test_a_brake_that_slips_is_a_load():
    """The damper has it bear all that it can from the first step on; to round-off, which contacts amplify."""
    loaded = chains.two_stages(duration=0.02, step=2.5e-6)
    brake = coupling("brake", ["ground", "out"], 1e4, damping=50.0, clutch={"torque": 100.0})
    braked = chains.plus(loaded.with_values({"sprockets.out.load.torque": 200.0}), brake)
    run = simulate([loaded, braked], device="cpu")
    np.testing.assert_allclose(run[1].position, run[0].position, rtol=0, atol=1e-9)
    one, other = run.metrics.to_pylist()
    assert other["brake.slip_loss"] + other["brake.damping_loss"] > 2.0
    lost = other["output_work"] + other["brake.slip_loss"] + other["brake.damping_loss"]
    assert lost == pytest.approx(one["output_work"], rel=1e-3)  # the spring's C^2 / 2k is not lost
    assert abs(other["energy_residual_relative"]) < 1e-5


def test_two_equal_chains_with_gears_are_one_of_twice_the_mass_stiffness_and_contact(beside_each_other):
    """To round-off, as the moments of two chains are added up one after the other."""
    two, one = beside_each_other[0], beside_each_other[2]
    for half in (slice(0, 60), slice(60, 120)):
        np.testing.assert_allclose(two.position[:, half], one.position, rtol=0, atol=1e-9)
    rows = beside_each_other.metrics.to_pylist()
    for name in ("pair.torque_mean", "pair.tooth_force_max", "output_work", "energy_change", "links.dissipated"):
        assert rows[0][name] == pytest.approx(rows[2][name], rel=1e-8), name


def test_contacts_take_light_geared_bodies_to_gain_what_they_gained_in_the_step_before():
    """To round-off, with their train, of which one turns at rho = -1/2 of another."""
    packed = pack_for([chains.light_gears(step=2e-6)], [Schedule(2e-6, 5000, 0, 5000, 0)], "float64")
    (before, _), (after, _) = stepped(packed, 4999), stepped(packed, 5000)
    taken = after.bodies()["angular"]
    gained = (after.bodies()["speed"] - before.bodies()["speed"]) / 2e-6
    moment = after.state.wrenches.numpy()["moment"]
    assert (np.abs(moment[[1, 3]]) > 10.0).all() and (np.abs(gained[[1, 3]]) > 10.0).all()
    np.testing.assert_allclose(taken[1:], gained[1:], rtol=1e-9)
    assert taken[1] == -2.0 * taken[3]


@pytest.mark.parametrize("lash", [0.0, 2e-3])
def test_two_inertias_swing_on_a_coupling_beside_two_chains(device, lash):
    """2 pi/w + 4 b/(w A), w = sqrt(k (1/Ja + 1/Jb)), A the twist beyond the lash; frames find a crossing to 1e-6."""
    drive = chains.plus(chains.side_by_side(2, duration=0.06), swing(lash=lash))
    run, _ = ran(drive)
    found = periods(run[0].time[200 * (lash > 0) :], run[0].coupling_twist[200 * (lash > 0) :, 0])
    omega, speed = math.sqrt(3e5 * (1.0 / 0.5 + 1.0 / 0.3)), 2.0
    assert len(found) > 2
    assert found.mean() == pytest.approx(2.0 * math.pi / omega + 4.0 * lash / speed, rel=2e-4 if lash else 1e-5)


@pytest.fixture(scope="module")
def turning():
    """Stages braked in proportion to speed, at rest in themselves after some 1 / 25 s: geared, and on a coupling."""
    braked = {"sprockets.out.load": {"viscous": 100.0}}
    cushed = chains.cushed_stages(duration=1.0).with_values(braked)
    geared = chains.plus(chains.two_stages(duration=1.0).with_values(braked), chains.PUMP)
    run = simulate([cushed, geared], device="cpu", window=(0.5, 1.0), record=Record(variants="none"))
    return run.metrics.to_pylist()


@pytest.mark.parametrize("which", [0, 1])
def test_speeds_follow_from_teeth_of_chains_and_gears(turning, which):
    """In the mean; what teeth do within a pitch, over the 5 rad of the window, is below 1e-3."""
    row = turning[which]
    assert row["out.speed_mean"] == pytest.approx(10.0 * (20 * 18) / (30 * 36), rel=1e-3)
    assert row["pump.speed_mean"] == pytest.approx(-10.0 * (20 * 20) / (30 * 40), rel=1e-3)
    sped_up = 0.8 * (row["pump.speed_max"] - row["pump.speed_min"]) / 0.5  # J times the acceleration, at most
    assert row["pair.torque_mean"] == pytest.approx(2.0 * row["pump.speed_mean"], abs=sped_up)
    assert abs(row["energy_residual_relative"]) < 1e-5


def test_a_coupling_between_a_shaft_and_a_sprocket_of_another_chain_passes_on_what_that_chain_asks(turning):
    """M z3 / z4, links pull at R cos(pi / z) to R: (pi / 18)^2 / 6 = 0.5 %; its damper's loss is in the balance."""
    row = turning[0]
    assert row["cush.torque_mean"] == pytest.approx(0.5 * 100.0 * row["out.speed_mean"], rel=0.01)
    assert row["cush.damping_loss"] > 0.0
    assert row["mid out.speed_mean"] == pytest.approx(row["mid.speed_mean"], rel=1e-3)


def test_a_motor_starts_two_chains(device):
    """All that it works goes into loads, losses and motion; the second chain's shaft stands still at first."""
    run, row = ran(chains.motored_stages(duration=0.1))
    assert (run[0].sprocket_speed[0] == 0.0).all() and (run[0].shaft_speed[0] == 0.0).all()
    assert row["input_work"] == pytest.approx(row["engine.motor_work"], rel=1e-12)
    assert row["engine.motor_work"] > 10.0 and run[0].shaft_speed[-1, -1] > 1.0
    assert abs(row["energy_residual_relative"]) < 1e-4


def test_a_prescribed_shaft_leads_chains_through_gears(device):
    """All bodies of its train move as it says, to round-off; the teeth pass on the moments of both chains."""
    base = chains.side_by_side(2, duration=0.02).with_values({"shafts.A.inertia": 1.0, "sprockets.a0.inertia": 0.5})
    led = shaft("input", prescribed={"speed": 20.0, "harmonics": [{"order": 2.0, "amplitude": 0.02}]})
    text = dumps_drive(base).replace("prescribed = { speed = 10.0, ramp_time = 0.0 }\n", "")
    drive = loads_drive(text + led + gears("pair", ["input", "A"], [20, 40]))
    run, row = ran(drive)
    speed = {shaft.name: run[0].shaft_speed[:, h] for h, shaft in enumerate(drive.shafts)}
    np.testing.assert_allclose(-0.5 * speed["input"], speed["A"], rtol=1e-12)
    for s in (0, 2):
        np.testing.assert_array_equal(run[0].sprocket_speed[:, s], speed["A"])
    assert np.abs(speed["input"]).max() == pytest.approx(20.4, rel=1e-3)
    assert abs(row["energy_residual_relative"]) < 1e-4
    # J of A's side times the mean acceleration over the window is what its speed changes by
    change = 1.5 * (speed["A"][-1] - speed["A"][0]) / drive.run.duration
    assert row["pair.torque_mean"] == pytest.approx(change - row["a0.moment_mean"] - row["a1.moment_mean"], rel=1e-3)


@pytest.mark.parametrize("precision", ["float64", pytest.param("float32", marks=pytest.mark.thorough)])
def test_a_variant_alone_is_the_same_in_a_crowd(precision):
    drives = [
        chains.motored_stages(duration=5e-3),
        chains.cushed_stages(duration=5e-3),
        chains.two_stages(duration=5e-3),
    ]
    assert_alone_as_in_a_crowd(drives, device="cpu", precision=precision, limits=STARTING)


def test_check_shares_loads_over_gears_couplings_and_chains():
    """In balance, without friction: 250 N m on the coupling; at the crank that, and the pump's load, by the ratios."""
    values = derived_quantities(chains.geared_stages())
    (joint,) = values["chains"]["second"]["couplings"]
    assert joint["working_torque"] == pytest.approx(250.0, rel=1e-3)
    assert joint["working_twist"] == pytest.approx(1e-3 + 250.0 / 4e4, rel=1e-3)
    first = values["chains"]["first"]
    slack, tight = (strand["working_tension"] for strand in first["strands"])
    moment = 0.5 * 250.0 + 0.5 * 2.0 * (10.0 / 3.0)
    assert (tight - slack) * first["sprockets"][1]["pitch_radius"] == pytest.approx(moment, rel=0.01)
    (cush,) = derived_quantities(chains.cushed_stages())["chains"]["first"]["couplings"]
    assert cush["working_torque"] == pytest.approx(0.5 * 300.0, rel=1e-3)


def test_shares_of_a_train_count_once_in_the_step_limit():
    """A geared inertia is one, whatever chains push the shaft."""
    alone = chains.side_by_side(2).with_values({"sprockets.b0.inertia": 2.0 + 0.25 * 0.8})
    geared = chains.plus(chains.side_by_side(2), PUMP)
    assert step_limit(geared) == pytest.approx(step_limit(alone), rel=1e-14)


def test_a_chain_is_a_drive_of_its_own_with_its_trajectory():
    drive = chains.cushed_stages(duration=2e-3)
    run = simulate(drive, device="cpu")[0]
    first, second = chain_trajectories(run).values()
    assert [shaft.name for shaft in first.parts.shafts] == ["mid", "pump", "mid out"]
    np.testing.assert_array_equal(first.shaft_speed[:, 2], second.sprocket_speed[:, 0])
    np.testing.assert_array_equal(first.coupling_twist, run.coupling_twist)
    assert [chain.places["couplings"] for chain in Model(drive).chains] == [(0,), ()]
