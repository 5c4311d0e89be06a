"""What motors and inertias do to a chain on the way to work: `check` against closed forms and against runs."""

import math

import chains
import numpy as np
import pytest
from drives import two_sprockets
from run_ups import bicycle, kart

from warpchain import Drive, Record, simulate
from warpchain.assembly.run_up import driver_run_up
from warpchain.assembly.summary import derived_quantities, report
from warpchain.model import Model, single_chain
from warpchain.model.stacks import stacks_of_drives
from warpchain.model.train_speeds import driver_top_speed


def smooth_peak(drive):
    """Largest tension of the run [N] as means over two teeth of the driver: what is left without the teeth's ripple."""
    run = simulate(drive, device="cpu", record=Record(rate=5e3), window=(0.0, drive.run.duration))
    tight = np.asarray(run[0].tension, float).max(axis=1)  # of the link that has most, at each frame
    (row,) = run.metrics.to_pylist()
    spell = int(5e3 * drive.run.duration / 10)
    return np.convolve(tight, np.ones(spell) / spell, "valid").max(), row


@pytest.mark.parametrize("drive", [bicycle(), kart()], ids=["bicycle", "kart"])
def test_the_strength_line_is_what_a_run_comes_to(drive):
    # friction, the teeth's ripple and waves are not in it: from 0.9 of the run's peak to 1.5 of it
    found = derived_quantities(drive)
    smooth, row = smooth_peak(drive)
    assert 0.9 * smooth < found["strength"]["peak"] < 1.5 * smooth
    assert found["driver"]["speed"] == pytest.approx(row["driver.speed_max"], rel=0.05)


def test_what_the_motor_keeps_for_itself_the_chain_does_not_carry():
    # (a): at the hub's sprocket T R = load + J w', w' from 88 N m at the crank, less the load, on all inertias as the
    # crank sees them; rollers beside the pitch circle and the slack strand's weight are a percent
    drive = bicycle()
    found = derived_quantities(drive)
    ratio, speed = 42.0 / 16.0, found["driver"]["speed"]
    load, behind = 2.0 + 0.012 * (ratio * speed) ** 2, 11.5 + 4.2e-5
    links = drive.chain.links * drive.chain.mass * single_chain(drive).pitch_radius(0) ** 2
    gained = (88.0 - ratio * load) / (0.05 + ratio**2 * behind + links)
    assert found["driver"] == {
        "name": "driver", "prescribed": False, "start": pytest.approx(20.0 / ratio, rel=1e-12), "speed": speed,
        "acceleration": pytest.approx(gained, rel=1e-9),
    }  # fmt: skip
    slack, tight = sorted(strand["working_tension"] for strand in found["strands"])
    assert tight - slack == pytest.approx(
        (load + behind * ratio * gained) / single_chain(drive).pitch_radius(1), rel=1e-2
    )
    lines = report(found).splitlines()
    assert any(line.startswith('speed: "driver" has 7.619 rad/s at the start and 8.0') for line in lines)
    assert "  none of these has vibration" in lines


def test_of_a_motors_curve_the_largest_torque_that_is_passed_counts():
    # from rest to 800 rad/s of the engine it passes 22 N m at 600; where it ends the road asks for most of what is left
    drive = kart(**{"run.duration": 10.0, "shafts.axle.load.quadratic": 0.006})
    found = derived_quantities(drive)["strength"]
    way = found["run_up"]
    assert way["speed"] == pytest.approx(600.0, rel=5e-3)
    own = 0.003 * way["acceleration"]  # of 22 N m, which the engine itself takes
    centrifugal = drive.chain.mass / drive.chain.pitch * (600.0 * single_chain(drive).pitch_radius(0)) ** 2
    # eleven teeth and the slack strand make 2 %
    assert way["tension"] == pytest.approx((22.0 - own) / single_chain(drive).pitch_radius(0) + centrifugal, rel=0.03)
    assert found["peak"] == way["tension"] > 1.1 * found["working"]
    assert 'the jerk of the motor on "engine", which comes on at once: up to twice as much' in found["left_out"]


def test_a_ramp_asks_for_the_inertia_at_its_steepest():
    # 1.5 w / t at the middle of a ramp of t = 0.1 s, on 2 kg m^2, and the load with it; the centrifugal part moves the
    # hardest place a little beyond the middle
    drive = two_sprockets(ramp=0.1).with_values({"chain.size": "32B", "chain.stiffness": 5e7, "chain.pitch": 0.05})
    found = derived_quantities(drive)["strength"]
    assert found["run_up"]["acceleration"] == pytest.approx(150.0, rel=1e-3)
    rise = 2.0 * (150.0) / single_chain(drive).pitch_radius(1)
    assert found["run_up"]["tension"] - found["working"] == pytest.approx(rise, rel=0.02)
    assert (
        derived_quantities(drive.with_values({"sprockets.driver.prescribed.ramp_time": 0.0}))["strength"]["run_up"]
        is None
    )


def test_a_run_up_in_a_table_counts_as_far_as_the_run_goes():
    table = {"time": [0.0, 0.1, 0.15, 0.3, 0.4], "speed": [0.0, 5.0, 10.0, 10.0, 50.0]}
    drive = two_sprockets(duration=0.2).with_values({"sprockets.driver.prescribed": {"table": table}})
    found = driver_run_up(single_chain(drive))
    assert found.acceleration.max() == pytest.approx(100.0) and found.acceleration[-1] == 0.0
    assert driver_run_up(single_chain(drive.with_values({"run.duration": 0.35}))).acceleration.max() == pytest.approx(
        400.0
    )


def test_chains_behind_ask_for_their_inertia_too():
    # a ramp of 0.1 s: 150 rad/s^2 at the crank, 100 at the shaft between, 50 at the output, which have 2 kg m^2 each;
    # the second chain's rollers go with the shaft between
    sizes = {"first": ("32B", 0.05), "second": ("24B", 0.04)}
    values = {f"chains.{name}.size": size for name, (size, _) in sizes.items()}
    values |= {f"chains.{name}.pitch": pitch for name, (_, pitch) in sizes.items()}
    values |= {f"chains.{name}.stiffness": 5e7 for name in sizes}
    drive = chains.two_stages().with_values({"sprockets.crank.prescribed.ramp_time": 0.1, **values})
    found = derived_quantities(drive)["chains"]
    ways = [found[name]["strength"]["run_up"] for name in ("first", "second")]
    assert [way["acceleration"] for way in ways] == pytest.approx([150.0, 100.0], rel=1e-3)
    first, second = Model(drive).chains
    rollers = second.chain.links * second.chain.mass * second.pitch_radius(0) ** 2
    asked = 0.5 * 300.0 + (2.0 + rollers + 0.25 * 2.0) * 100.0, 300.0 + 2.0 * 50.0
    pulls = [
        moment / one.pitch_radius(1) + one.chain.mass / one.chain.pitch * (way["speed"] * one.pitch_radius(0)) ** 2
        for moment, one, way in zip(asked, (first, second), ways, strict=True)
    ]
    # the slack strands hang, and are no more than some percent of it
    assert [way["tension"] for way in ways] == pytest.approx(pulls, rel=0.03)


def test_a_chain_that_another_leads_speeds_up_with_its_motor():
    found = derived_quantities(chains.motored_stages())["chains"]
    first, second = (found[name]["driver"] for name in ("first", "second"))
    assert first["acceleration"] > 1.0
    assert second["acceleration"] == pytest.approx(20.0 / 30.0 * first["acceleration"], rel=1e-12)


def test_a_motor_is_as_fast_as_the_run_lets_it():
    # torque T (1 - w / w0) on J alone: w = w0 (1 - exp(-T t / (J w0))), whatever its torque is at the start
    curve = {"speed": [0.0, 100.0], "torque": [20.0, 0.0]}

    def driven(duration, over=curve):
        values = two_sprockets(torque=0.0, duration=duration).model_dump(exclude_none=True)
        values["shafts"] = [{"name": "m", "inertia": 5.0, "motor": {"table": over}}]
        del values["sprockets"][0]["prescribed"]
        values["sprockets"][0]["shaft"] = "m"
        return Drive(**values)

    inertia = 7.0 + 60.0 * single_chain(driven(1.0)).pitch_radius(0) ** 2
    for time in (0.1, 10.0, 40.0):
        expected = 100.0 * (1.0 - math.exp(-20.0 * time / (inertia * 100.0)))
        assert Model(driven(time)).driver_speed == pytest.approx(expected, rel=1e-4)
    # one that rises from 0.1 N m with the speed comes beyond what its first torque would give: exp((T1 / J w1) t)
    rising = {"speed": [0.0, 100.0], "torque": [0.1, 100.1]}
    assert Model(driven(30.0, rising)).driver_speed == pytest.approx(0.1 * (math.exp(30.0 / inertia) - 1.0), rel=1e-3)
    # with a dip below the load it comes no farther than the dip
    dip = {"speed": [0.0, 10.0, 20.0, 30.0, 100.0], "torque": [50.0, 50.0, 5.0, 50.0, 0.0]}
    held = driven(100.0, dip).with_values({"sprockets.driven.load": {"torque": 23.0}})
    assert Model(held).driver_speed == pytest.approx(16.0, rel=1e-9)
    base = driven(10.0)
    drives = [base.with_values({"shafts.m.inertia": inertia}) for inertia in (0.5, 5.0, 50.0)]
    (stack,) = stacks_of_drives(drives)
    assert np.asarray(driver_top_speed(single_chain(stack.one))).tolist() == [Model(one).driver_speed for one in drives]
