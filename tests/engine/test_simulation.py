"""The call that runs an ensemble: crowds, threads, blocks, recording, windows, interruption, and what it refuses."""

import os
import signal
import threading

import numpy as np
import pytest
import warp as wp
from drives import example, two_sprockets

from warpchain import Record, simulate
from warpchain.engine.arrays import ARRAYS, empty_sums, sums_bytes
from warpchain.engine.pack import pack
from warpchain.engine.simulation import schedules_of
from warpchain.errors import DriveError, SimulationError
from warpchain.kernels.sums import MERGE_EVERY


def short(**changes):
    return two_sprockets(**{"duration": 0.004, "settle": "false", **changes})


def crowd():
    """Drives that differ in values, links, teeth, sprockets, guide-bars, step and integrator."""
    marine = example("marine").with_values({"run.duration": 0.004, "run.settle": False})
    return [short(), short(torque=100.0, step=3e-6), marine, short(teeth=24, links=64), short(integrator="rk4"),
            marine.with_values({"guides": (), "sprockets.camshaft.inertia": 500.0})]  # fmt: skip


def same(one, other):
    return all(np.array_equal(values, other.channels()[name]) for name, values in one.channels().items())


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_a_variant_alone_equals_itself_in_a_crowd_bitwise(precision):
    drives = crowd()
    together = simulate(drives, precision=precision, workers=2)
    for index, drive in enumerate(drives):
        alone = simulate(drive, precision=precision, workers=1)
        assert same(alone[0], together[index]), index
        mine = together.metrics.to_pylist()[index]
        assert {k: v for k, v in alone.metrics.to_pylist()[0].items() if k != "variant"}.items() <= mine.items()


def test_blocks_do_not_change_the_result(monkeypatch):
    whole = simulate(short())
    monkeypatch.setattr("warpchain.engine.subensemble.LAUNCH_WORK", 60 * 37)
    parts = simulate(short())
    assert same(whole[0], parts[0])
    assert np.array_equal(whole[0].time, parts[0].time)
    assert whole.metrics.equals(parts.metrics)


@pytest.mark.usefixtures("device")
def test_frames_begin_at_zero_and_follow_the_rate():
    drive = short(step=4e-6)  # 20 kHz asked: 12.5 steps, rounded to 12
    trajectory = simulate(drive)[0]
    assert trajectory.time[0] == 0.0
    np.testing.assert_allclose(np.diff(trajectory.time), 12 * 4e-6, rtol=1e-9)
    assert trajectory.position.shape == (len(trajectory.time), 60, 2)
    assert trajectory.sprocket_center.shape == (len(trajectory.time), 2, 2)
    slower = simulate(drive, record=Record(rate=1000.0))[0]
    np.testing.assert_allclose(slower.time, np.arange(5) * 1e-3, atol=1e-9)
    every = {time.round(9): index for index, time in enumerate(simulate(drive, record=Record(rate=1 / 4e-6))[0].time)}
    assert len(every) == 1001


@pytest.mark.usefixtures("device")
def test_recorded_tension_is_the_law_applied_to_recorded_positions():
    drive = short(damping=0.0)
    trajectory = simulate(drive)[0]
    d = np.roll(trajectory.position, -1, axis=1) - trajectory.position
    expected = drive.chain.stiffness * (np.hypot(d[..., 0], d[..., 1]) - drive.chain.pitch)
    np.testing.assert_allclose(trajectory.tension, expected, atol=1e-6)


@pytest.mark.usefixtures("device")
def test_recorded_velocity_is_the_slope_of_recorded_positions():
    trajectory = simulate(short(), record=Record(rate=2e5))[0]
    slope = (trajectory.position[2:] - trajectory.position[:-2]) / (trajectory.time[2:] - trajectory.time[:-2])[
        :, None, None
    ]
    np.testing.assert_allclose(trajectory.velocity[1:-1], slope, atol=1e-9)  # leapfrog: v(n) is the central difference


@pytest.mark.usefixtures("device")
def test_metrics_equal_those_taken_from_what_was_recorded():
    """Tension at the window's start and every 32nd step, all else at each."""
    drive = short(duration=0.003)
    run = simulate(drive, record=Record(rate=1 / 5e-6), window=(0.001, 0.003))
    trajectory, metrics = run[0], run.metrics.to_pylist()[0]
    inside = slice(200, 601)
    steps, tension = np.arange(200, 601), trajectory.tension[inside]
    assert (metrics["tension_min"], metrics["tension_max"]) == (tension.min(), tension.max())
    tension = tension[(steps % int(MERGE_EVERY) == 0) | (steps == 200)]
    assert metrics["tension_mean"] == pytest.approx(tension.mean(), rel=1e-12)
    assert metrics["tension_std"] == pytest.approx(tension.std(), rel=1e-9)
    speed, moment = trajectory.sprocket_speed[inside, 1], trajectory.sprocket_moment[inside, 1]
    assert metrics["driven.speed_mean"] == pytest.approx(np.trapezoid(speed) / 400, rel=1e-12)
    assert metrics["driven.moment_mean"] == pytest.approx(np.trapezoid(moment) / 400, rel=1e-9)
    assert metrics["driven.speed_min"] == speed.min()
    assert metrics["input_work"] == pytest.approx(
        -np.trapezoid(trajectory.sprocket_moment[inside, 0] * trajectory.sprocket_speed[inside, 0]) * 5e-6, rel=1e-9
    )


@pytest.mark.usefixtures("device")
def test_columns_have_units_and_absent_parts_are_null():
    table = simulate([short(), example("marine").with_values({"run.duration": 0.002})], record=Record("none")).metrics
    units = {field.name: field.metadata[b"unit"].decode() for field in table.schema}
    assert units["tension_mean"] == "N"
    assert units["driven.speed_std"] == "rad/s"
    assert units["driver->driven.displacement_rms"] == "m"
    assert units["driver.impacts"] == "1"
    assert table["camshaft.moment_mean"].to_pylist()[0] is None
    assert table["driven.moment_mean"].to_pylist()[1] is None
    assert table["tight strand.force_max"].to_pylist()[0] is None
    assert table["tight strand.force_max"].to_pylist()[1] >= 0.0


@pytest.mark.usefixtures("device")
def test_channels_and_variants_that_are_not_wanted_are_left_out():
    run = simulate([short(), short()], record=Record(variants=[1], channels=("tension",)))
    assert list(run) == [1]
    assert run[1].position is None
    assert run[1].tension is not None
    with pytest.raises(SimulationError, match="variant 0 was not recorded"):
        run[0]


@pytest.mark.usefixtures("device")
def test_divergence_stops_one_variant_and_leaves_the_others():
    mad = short(contact=2e8, floor=1e-9, duration=0.02, torque=5e7, viscous=1e8)
    run = simulate([mad, short()])
    first, second = run.metrics.to_pylist()
    assert first["diverged"] and 0.0 < first["diverged_time"] < 0.02
    assert first["tension_mean"] is None
    assert run[0].time[-1] <= first["diverged_time"]
    assert not second["diverged"]
    assert same(run[1], simulate(short())[0])


@pytest.mark.usefixtures("device")
def test_settling_leaves_no_net_force():
    drive = two_sprockets(duration=1e-4, gravity=-9.81, span=20.01)
    metrics = simulate(drive).metrics.to_pylist()[0]
    assert metrics["settle_residual"] < 1e-3
    assert 0 < metrics["settle_steps"] < 100_000


@pytest.mark.usefixtures("device")
def test_slack_strand_settles_to_its_catenary():
    # both strands horizontal, slack, gravity: sag = mu g L^2 / (8 T) for a shallow one, tension from where it settles
    drive = two_sprockets(duration=5e-6, speed=0.0, torque=0.0, gravity=-9.81, span=19.98, step=5e-6)
    trajectory = simulate(drive)[0]
    position, tension = trajectory.position[0], trajectory.tension[0]
    low = position[(position[:, 1] < 0) & (np.abs(position[:, 0] - 0.5) < 0.45)]
    middle = np.abs(low[:, 0] - 0.5).argmin()
    fit = np.polyfit(low[:, 0] - low[middle, 0], low[:, 1], 2)
    hanging = tension[(position[:, 1] < 0) & (np.abs(position[:, 0] - 0.5) < 0.2)].mean()
    assert fit[0] == pytest.approx((1.0 / 0.05) * 9.81 / (2 * hanging), rel=0.05)


def test_progress_reaches_its_total():
    seen = []
    simulate(two_sprockets(duration=0.001), progress=lambda phase, done, total: seen.append((phase, done, total)))
    assert {phase for phase, _, _ in seen} == {"settling", "simulating"}
    assert seen[-1][1] == seen[-1][2] == pytest.approx(0.001, rel=0.01)  # in simulated time, whole steps of it


def test_ctrl_c_keeps_what_was_recorded():
    drive = short(duration=100.0).with_values({"run.sample_rate": 100.0})
    timer = threading.Timer(2.0, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    run = simulate(drive)
    assert run.info.ended == "interrupted"
    assert 1 < len(run[0].time) < 10_001
    assert np.isfinite(run[0].position).all()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"device": "cuda:7"}, "device = 'cuda:7'"),
        ({"precision": "float16"}, "precision = 'float16'"),
        ({"duration": -1.0}, "duration = -1.0"),
        ({"window": (0.003, 0.001)}, "window ="),
        ({"window": (0.0, 1.0)}, "window ="),
        ({"memory": 1000}, "memory budget"),
        ({"record": Record(variants=[3])}, "record.variants: 3"),
    ],
)
@pytest.mark.usefixtures("device")
def test_bad_options_are_one_line(options, message):
    with pytest.raises(SimulationError, match=message) as caught:
        simulate(short(), **options)
    assert "\n" not in str(caught.value)


def test_sums_and_statistics_count_in_the_memory_budget():
    """What is counted is what is there; what they leave is for the record, of which 20 kB hold no three frames."""
    drives = [short(), short(teeth=12, links=52), short()]
    packed = pack(drives, schedules_of(drives, 1e-4, None, Record(), None))
    sums = empty_sums(packed, "cpu")
    held = [getattr(sums, name) for name in ARRAYS["sums"]]
    taken = sums_bytes(packed)
    assert taken == sum(array.size * wp.types.type_size_in_bytes(array.dtype) for array in held)
    assert taken > 3 * 3 * 1000  # about a kilobyte a strand, and of links on none
    with pytest.raises(
        SimulationError, match=r"the statistics of 3 variants take .* simulate fewer variants at a time"
    ):
        simulate(drives, device="cpu", duration=1e-4, record=Record("none"), memory=taken - 1)
    assert simulate(drives, device="cpu", duration=1e-4, record=Record("none"), memory=taken).info.ended == "complete"
    with pytest.raises(SimulationError, match=r"the memory budget of .* GiB"):
        simulate(drives, device="cpu", duration=1e-4, memory=taken + 20_000)


@pytest.mark.usefixtures("device")
def test_step_beyond_the_limit_states_the_limit():
    with pytest.raises(DriveError, match=r"variant 1: run\.step = 7e-05: must be above 0 and below 6\.18\d*e-05 s"):
        simulate([short(), short(stiffness=1.5e8, contact=1.5e8)], step=7e-5)


def test_bad_records():
    for options in ({"variants": "some"}, {"rate": 0.0}, {"channels": ("speed",)}):
        with pytest.raises(SimulationError):
            Record(**options)
