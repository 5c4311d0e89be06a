"""A run advanced piece by piece: the bits of one run, inputs that are a drive's own tables, energy, states, errors."""

import math
import tomllib
from itertools import pairwise

import numpy as np
import pytest
from drives import SPRUNG, example, two_sprockets, with_parts
from parts import coupling, shaft

from warpchain import Record, WarpchainError, loads_drive, simulate, stepping
from warpchain.drive.toml import toml_text

pytestmark = pytest.mark.filterwarnings("ignore::warpchain.errors.SuspectWarning")
H, STEPS, EVERY = 1e-5, 600, 50
DURATION = STEPS * H
WHOLE = {"device": "cpu", "step": H, "duration": DURATION, "window": (0.0, DURATION)}
CUTS = [1, 2, 49, 50, 83, 100, 128, 150, 200, 301, 320, 350, 450, 555, 600]
"""Steps after which pieces end, some at frames of the run in one."""


def torques(count):
    return [two_sprockets(torque=100.0 + 20.0 * v) for v in range(count)]


def assert_same_frame(sim, trajectory, outputs, frame):
    for name in outputs:
        np.testing.assert_array_equal(sim.get(name), getattr(trajectory, name)[frame], err_msg=f"{name} {frame}")


@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("name", ["two", "marine", pytest.param("car", marks=pytest.mark.long), "conveyor"])
def test_in_any_pieces_it_has_the_bits_of_one_run(name, precision):
    drive = two_sprockets() if name == "two" else example(name)
    options = WHOLE | {"step": None if name == "car" else 2e-6 if name == "conveyor" else H, "precision": precision}
    outputs = ("tension", "position", "velocity", "sprocket_speed", "sprocket_angle", "sprocket_moment", "hub_force")
    inputs = [f"{name}.load_torque" for name in free_parts(drive)]
    with stepping(drive, inputs=inputs, outputs=outputs, **options | {"duration": 1.0}) as sim:
        options |= {"duration": STEPS * sim.step, "window": (0.0, STEPS * sim.step)}
    record = Record(rate=1.0 / (EVERY * options["duration"] / STEPS), channels=outputs)
    run = simulate(drive, record=record, **options)
    with stepping(drive, inputs=inputs, outputs=outputs, **options) as sim:
        assert_same_frame(sim, run[0], outputs, 0)
        for before, after in pairwise([0, *CUTS]):
            sim.advance((after - before) * sim.step)
            if after % EVERY == 0:
                assert_same_frame(sim, run[0], outputs, after // EVERY)
        mine, theirs = (table.to_pylist()[0] for table in (sim.metrics(), run.metrics))
    np.testing.assert_equal(mine, theirs)  # sums over links, too: nothing is merged where a piece ends


@pytest.mark.parametrize("name", ["two", "conveyor"])
def test_what_is_read_in_between_leaves_the_bits(name):
    """A state, a metric or a body that is read ends the scratch's hold on the variant, and the run goes on from it."""
    drive = two_sprockets() if name == "two" else example(name)
    options = WHOLE | {"step": 2e-6 if name == "conveyor" else H}
    inputs = [f"{name}.load_torque" for name in free_parts(drive)]
    options |= {"duration": STEPS * options["step"], "window": (0.0, STEPS * options["step"])}
    found = []
    for reads in (False, True):
        with stepping(drive, inputs=inputs, outputs=["tension", "position"], **options) as sim:
            for before, after in pairwise([0, *CUTS]):
                sim.advance((after - before) * sim.step)
                if reads:
                    kept = sim.state()
                    sim.advance(sim.step) if after < STEPS else None
                    sim.restore(kept)
            found.append((sim.get(), sim.metrics().to_pylist()[0]))
    (frame, row), (again, same) = found
    np.testing.assert_equal(again, frame)
    assert all(
        same[key] == pytest.approx(row[key], rel=1e-12) for key in ("tension_mean", "tension_max", "loss") if key in row
    )


@pytest.mark.gpu
@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_launches_that_are_repeated_have_the_bits_of_others(precision, monkeypatch):
    """On a GPU: pieces of equal length are captured once, but for those that begin or end the window."""
    from warpchain.engine.gpu import GpuEngine

    options = WHOLE | {"device": "cuda:0", "precision": precision, "window": (0.5 * DURATION, DURATION)}
    found, taken = [], []
    capture = GpuEngine._capture_piece
    monkeypatch.setattr(GpuEngine, "_capture_piece", lambda *of: taken.append(of) or capture(*of))
    for captures in (True, False):
        if not captures:
            monkeypatch.setattr(GpuEngine, "_repeated_kernel", lambda engine, steps: None)
        with stepping(torques(5), inputs=["driven.load_torque"], outputs=["tension"], **options) as sim:
            frames = []
            for piece, steps in enumerate([*[30] * 16, *[29, 31] * 2]):
                sim.set({"driven.load_torque": 100.0 + 10.0 * piece + 10.0 * np.arange(5)})
                sim.advance(steps * H)
                frames.append(sim.get("tension"))
            found.append((np.array(frames), sim.metrics().to_pylist()))
    np.testing.assert_array_equal(*(frames for frames, _ in found))
    assert found[0][1] == found[1][1]
    assert len(taken) == 5  # the first step, 30 before the window, 30, 29 and 31 in it


def free_parts(drive):
    """Names of sprockets with a load."""
    return [sprocket.name for sprocket in drive.sprockets if sprocket.load is not None]


def test_an_ensemble_has_the_bits_of_its_drives_though_their_steps_differ():
    drives = [two_sprockets(torque=100.0, step=1e-5), two_sprockets(torque=300.0, step=7e-6)]
    duration = 420e-5  # whole steps of both
    options = {"device": "cpu", "duration": duration}
    with stepping(drives, outputs=["tension", "driven.sprocket_speed"], **options) as sim:
        for _ in range(6):
            sim.advance(70e-5)
        np.testing.assert_allclose(sim.time, duration, rtol=1e-12)
        tension, speed = sim.get("tension"), sim.get("driven.sprocket_speed")
        assert not sim.diverged.any()
    for v, drive in enumerate(drives):
        run = simulate(drive, record=Record(rate=1.0 / duration), **options)
        np.testing.assert_array_equal(tension[v], run[0].tension[-1])
        assert speed[v] == run[0].sprocket_speed[-1, 1]


def led(**table):
    """Two sprockets, the driver's center or speed by a table."""
    return two_sprockets().with_values(table)


def clutched(clutch):
    """Two sprockets, and beside the driven one a flywheel behind a clutch."""
    text = toml_text(two_sprockets(torque=0.0).model_dump(mode="json", exclude_none=True))
    wheel = shaft("flywheel", inertia=1.5, load={"viscous": 20.0})
    return loads_drive(text + wheel + coupling("clutch", ["driven", "flywheel"], 1e5, damping=20.0, clutch=clutch))


def motored(motor):
    """A shaft with a motor, beside a chain at rest."""
    return with_parts(shaft("motor", inertia=0.5, motor=motor, initial_speed=10.0))


END = 0.5 * DURATION


def ramp(name, before, after, axis="time"):
    return {axis: [0.0, END], name: [before, after]}


AS_TABLES = {
    "load_torque": (two_sprockets(), led(**{"sprockets.driven.load": {"table": ramp("torque", 300.0, 900.0)}}),
                    "driven.load_torque", 900.0),
    "speed": (led(), led(**{"sprockets.driver.prescribed": {"table": ramp("speed", 10.0, 13.0)}}),
              "driver.speed", 13.0),
    "capacity": (clutched({"torque": 100.0}), clutched({"table": ramp("torque", 100.0, 20.0)}),
                 "clutch.capacity", 20.0),
}  # fmt: skip


@pytest.mark.parametrize("kind", AS_TABLES)
def test_an_input_along_a_line_is_a_table_of_the_drive(kind):
    """The same table in the drive, and closed energy: what leads and loads does its work through the input."""
    drive, tabled, name, value = AS_TABLES[kind]
    run = simulate(tabled, record=Record(rate=1.0 / (EVERY * H)), **WHOLE)
    with stepping(drive, inputs=[name], outputs=["tension", "sprocket_angle"], **WHOLE) as sim:
        sim.set({name: value}, over=END)
        for k in range(1, STEPS // EVERY + 1):
            sim.advance(EVERY * H)
            # the same law, whose numbers differ by round-off at most: 1e-12 of a position is 1e-5 N on a link
            np.testing.assert_allclose(sim.get("tension"), run[0].tension[k], rtol=1e-6, atol=1e-2)
            np.testing.assert_allclose(sim.get("sprocket_angle"), run[0].sprocket_angle[k], rtol=0, atol=1e-10)
        row = sim.metrics().to_pylist()[0]
    assert abs(row["energy_residual_relative"]) < 1e-4


ARM = {"name": "pendulum", "pivot": [0.5, -1.0], "mass": 2.0, "center": [0.5, -1.4], "inertia": 0.42}
STILL = {"time": [0.0, 1.0], "x": [0.0, 0.0]}
LED = {
    "driver.center": (
        {"sprockets.driver.mount": {"kind": "prescribed", "direction": [1.0, 0.0], "amplitude": 1e-4, "frequency": 9}},
        "driver.sprocket_center", [-1e-4, 2e-4],
    ),
    "pendulum.pivot": ({"arms": [ARM | {"pivot_table": STILL}]}, "pendulum.arm_angle", [0.503, -0.999]),
}  # fmt: skip


@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("name", LED)
def test_what_is_led_gets_there_at_rest_and_its_work_closes_the_energy(name, precision):
    """Halfway it is led elsewhere, without a jump of velocity, whose blow would be missing in the energy."""
    values, output, value = LED[name]
    drive, options = two_sprockets(viscous=5.0).with_values(values), WHOLE | {"precision": precision}
    long = options | {"duration": 10 * DURATION, "window": (0.0, 10 * DURATION)}
    with stepping(drive, inputs=[name], outputs=[output], **long) as sim:
        sim.advance(200 * H)
        sim.set({name: value}, over=2000 * H)
        sim.advance(1300 * H)
        sim.set({name: [value[0] - 1e-4, value[1]]}, over=3000 * H)
        sim.advance(3001 * H)
        place = sim.get(output)
        sim.advance(1499 * H)
        if name == "driver.center":
            np.testing.assert_allclose(place, [value[0] - 1e-4, value[1]], rtol=0, atol=1e-9)
            np.testing.assert_array_equal(sim.get(output), place)
        else:
            # m l / I of the pivot's way against it. Its acceleration begins with a whole kick in place of half of one:
            # 3 h D / T^2 more speed, which over the 5800 steps that follow is 0.4 % of the way; it goes up, too
            assert sim.get(output) == pytest.approx(-0.8 / 0.42 * 2.9e-3, rel=1e-2)
        row = sim.metrics().to_pylist()[0]
    still = simulate(drive, record=Record(variants="none"), **long).metrics.to_pylist()[0]
    # of the pivot what the arm is given and gives back at up to 1.5 D / T, beside what the running chain misses anyway
    turned = abs(row["input_work"]) if name == "driver.center" else 2.0 * (1.5 * 3e-3 / (2000 * H)) ** 2
    missed = 0.0 if name == "driver.center" else still["energy_residual"]
    assert abs(row["energy_residual"] - missed) < (1e-4 if precision == "float64" else 1e-3) * turned


def test_what_is_held_hangs_on_no_cut_and_is_the_load_of_another_drive():
    """Torque and speed are set at two instants, and in pieces of any length again and again to what they are."""
    options = {
        "inputs": ["driven.load_torque", "driver.speed"],
        "outputs": ["tension", "driver.sprocket_angle"],
        **WHOLE,
    }

    def run(cuts, again):
        with stepping(two_sprockets(ramp=1e-3), **options) as sim:
            for before, after in pairwise([0, *sorted({*cuts, 100, 350, 600})]):
                torque, speed = (250.0, 12.0) if before < 350 else (180.0, 9.0)
                if before in (100, 350) or (again and before > 100):
                    sim.set({"driven.load_torque": torque, "driver.speed": speed})
                sim.advance((after - before) * H)
            return sim.get(), sim.metrics().to_pylist()[0]

    once, row = run([], False)
    for cuts in (CUTS, range(7, 600, 31)):
        frame, _ = run(cuts, True)
        np.testing.assert_equal(frame, once)
    # 10 rad/s by a ramp of 1 ms, from step 101 on 12, from step 351 on 9
    angle = 10.0 * (101 * H - 0.5e-3) + 12.0 * 250 * H + 9.0 * 249 * H
    start = two_sprockets(ramp=1e-3)
    with stepping(start, outputs=["driver.sprocket_angle"], **WHOLE) as sim:
        assert once["driver.sprocket_angle"] - sim.get("driver.sprocket_angle") == pytest.approx(angle, rel=1e-12)
    assert abs(row["energy_residual_relative"]) < 1e-4


def test_a_torque_that_is_set_at_the_begin_has_the_bits_of_that_load():
    run = simulate(two_sprockets(torque=555.0), record=Record(rate=1.0 / (EVERY * H)), **WHOLE)
    with stepping(two_sprockets(torque=1.0), inputs=["driven.load_torque"], outputs=["tension"], **WHOLE) as sim:
        sim.set({"driven.load_torque": 555.0})
        for k in range(1, 13):
            sim.advance(EVERY * H)
            np.testing.assert_array_equal(sim.get("tension"), run[0].tension[k])


def sprung_blade():
    """A blade that springs press onto the slack strand."""
    tensioner = {
        "name": "plunger", "on": "tensioner arm", "at": [-0.055, 0.08], "direction": [2.0, 0.0], "kind": "spring",
        "spring": {"stiffness": 2000.0, "preload": 60.0, "damping": 20.0},
    }  # fmt: skip
    return loads_drive(toml_text(tomllib.loads(SPRUNG) | {"tensioners": [tensioner]}))


@pytest.mark.parametrize("stiffness", [0.0, 2000.0])
def test_a_force_on_an_arm_is_the_preload_of_its_tensioner_and_its_work_closes_the_energy(stiffness):
    drive = sprung_blade().with_values({"tensioners.plunger.spring.stiffness": stiffness})
    options = {"device": "cpu", "step": 1e-6, "duration": 4e-3, "window": (0.0, 4e-3)}
    ports = {"inputs": ["plunger.force"], "outputs": ["plunger.tensioner_force", "plunger.tensioner_extension"]}
    with stepping(drive, **ports, **options) as sim:
        before = sim.get("plunger.tensioner_force")
    with stepping(drive, **ports, **options) as sim:
        sim.set({"plunger.force": 80.0})
        assert sim.get("plunger.tensioner_force") == pytest.approx(before + 20.0, rel=1e-12)
        sim.advance(1e-3)
        for force in (120.0, 40.0, 100.0):
            sim.set({"plunger.force": force})
            sim.advance(1e-3)
        row = sim.metrics().to_pylist()[0]
    assert abs(row["energy_residual_relative"]) < 1e-4


def test_a_motor_turns_as_a_controller_wants():
    """A motor on a flywheel alone, torque by a proportional law: w' = K (w_0 - w) / J, sampled."""
    drive = motored({"torque": 1.0})
    with stepping(drive, inputs=["motor.motor_torque"], outputs=["motor.shaft_speed"], **WHOLE) as sim:
        speed = [sim.get("motor.shaft_speed")]
        for _ in range(STEPS // 10):
            sim.set({"motor.motor_torque": 400.0 * (12.0 - speed[-1])})
            sim.advance(10 * H)
            speed.append(sim.get("motor.shaft_speed"))
        row = sim.metrics().to_pylist()[0]
    expected = 12.0 + (10.0 - 12.0) * (1.0 - 400.0 / 0.5 * 10 * H) ** np.arange(STEPS // 10 + 1)
    # a torque acts from half a step after it is set, over the same time
    np.testing.assert_allclose(speed, expected, rtol=0, atol=400.0 / 0.5 * 2.0 * H)
    assert abs(row["energy_residual_relative"]) < 1e-4


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_from_a_state_the_same_bits_follow(precision):
    options = WHOLE | {"precision": precision}
    drives, ports = torques(3), {"inputs": ["driven.load_torque", "driver.speed"], "outputs": ["tension"]}
    with stepping(drives, **ports, **options) as sim:
        sim.set({"driver.speed": 12.0}, over=200 * H)
        sim.advance(111 * H)
        kept, then = sim.state(), sim.get("tension")
        results = []
        for _ in range(2):
            np.testing.assert_array_equal(sim.get("tension"), then)
            np.testing.assert_allclose(sim.time, 111 * H)
            sim.set({"driven.load_torque": [400.0, 10.0, 50.0]})
            sim.advance(250 * H)
            sim.advance(239 * H)
            results.append((sim.get("tension"), sim.metrics()))
            sim.set({"driver.speed": 5.0, "driven.load_torque": 1.0})
            sim.restore(kept)
        with stepping(drives, **ports, **options) as other:
            other.restore(kept)
            other.set({"driven.load_torque": [400.0, 10.0, 50.0]})
            other.advance(489 * H)
            np.testing.assert_array_equal(other.get("tension"), results[0][0])
    np.testing.assert_array_equal(results[0][0], results[1][0])
    assert results[0][1].equals(results[1][1])


def test_a_variant_that_diverges_gives_no_numbers_and_the_others_go_on():
    torn = two_sprockets(step=H).with_values({"sprockets.driver.prescribed": {"speed": 1e5, "ramp_time": 0.0}})
    with stepping([two_sprockets(), torn], outputs=["driven.sprocket_speed", "tension"], **WHOLE) as sim:
        sim.advance(300 * H)
        assert sim.diverged.tolist() == [False, True]
        assert np.isnan(sim.get("driven.sprocket_speed")).tolist() == [False, True]
        assert np.isfinite(sim.get("tension")[0]).all() and np.isnan(sim.get("tension")[1]).all()
        sim.advance(300 * H)


WRONG = [
    (
        {"inputs": ["driven.torque"]},
        "inputs: 'driven.torque': must be PART.KIND, such as driven.load_torque; kinds are",
    ),
    ({"inputs": ["drivn.load_torque"]}, "inputs: 'drivn.load_torque': no part 'drivn' in variant 0; parts are driver,"),
    ({"inputs": ["driver.load_torque"]}, "inputs: 'driver.load_torque': load_torque is an input of free sprockets and"),
    ({"inputs": ["driven.speed"]}, "inputs: 'driven.speed': speed is an input of sprockets and shafts whose speed is "),
    ({"inputs": ["driver.speed"] * 2}, "inputs: 'driver.speed' is there twice"),
    ({"inputs": "driver.speed"}, "inputs = 'driver.speed': must be a sequence, each a text"),
    ({"outputs": ["tensions"]}, "outputs: 'tensions' is unknown; allowed are "),
    ({"outputs": ["driven.tension"]}, "outputs: 'driven.tension': tension is of each link; name it without a part"),
    ({"outputs": ["drivn.sprocket_speed"]}, "outputs: 'drivn.sprocket_speed': there is no sprocket 'drivn' in variant"),
    ({"outputs": ["arm_angle"]}, "outputs: 'arm_angle': variant 0 has no arm"),
    ({"duration": -1.0}, "duration = -1.0: must be a finite number above 0"),
    ({"device": "gpu"}, "device = 'gpu': allowed are "),
    ({"precision": "float16"}, "precision = 'float16': must be 'float64' or 'float32'"),
]


@pytest.mark.parametrize(("options", "line"), WRONG)
def test_a_wrong_argument_is_one_line(options, line):
    with pytest.raises(WarpchainError) as caught:
        stepping(two_sprockets(), **WHOLE | options)
    assert str(caught.value).startswith(line) and "\n" not in str(caught.value)


def setting(value, **options):
    """A call that sets the torque."""
    return lambda sim: sim.set({"driven.load_torque": value}, **options)


TORQUE = "set: driven.load_torque: "


CALLS = [
    (lambda sim: sim.set({"driven.load": 1.0}), "set: 'driven.load' is none of the inputs; they are driven.load"),
    (setting(math.nan), TORQUE + "must be finite numbers [N m]"),
    (setting([1.0, math.inf]), TORQUE + "must be finite numbers [N m]"),
    (setting([1.0] * 3), TORQUE + "is of shape (3,); must be one number or (2,)"),
    (setting("50 N m"), TORQUE + "must be numbers [N m]"),
    (setting([[1.0], [1.0, 2.0]]), TORQUE + "must be numbers [N m]"),
    (lambda sim: sim.set(50.0), "set: must be a mapping from inputs to values"),
    (setting(1.0, over=-1.0), "over = -1.0: must be a finite number above 0 [s]"),
    (setting(1.0, over=1e-9), "over = 1e-09 s: must be more than a step, 1e-05 s"),
    (lambda sim: sim.advance(0.0), "dt = 0.0: must be a finite number above 0 [s]"),
    (lambda sim: sim.advance("1 s"), "dt = '1 s': must be a finite number above 0 [s]"),
    (lambda sim: sim.advance(1e-6), "dt = 1e-06 s: must be at least a step, 1e-05 s"),
    (lambda sim: sim.advance(1.0), "dt = 1 s: the run would come to 1 s, beyond its end at 0.006 s; give stepping a"),
    (lambda sim: sim.get("speed"), "get: 'speed' is none of the outputs; they are tension"),
    (lambda sim: sim.restore(None), "state = None: must be a SteppedState"),
]


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, "much", [1.0, 2.0, 3.0]])
def test_what_is_held_is_checked_as_before(value):
    with stepping(two_sprockets(), inputs=["driven.load_torque"], device="cpu") as sim:
        sim.set({"driven.load_torque": 1.0})
        with pytest.raises(WarpchainError, match=r"^set: driven\.load_torque: "):
            sim.set({"driven.load_torque": value})


@pytest.mark.parametrize("value", [[1.0, math.nan], [-math.inf, 1.0], [1.0, math.inf], [1.0] * 3, [[1.0, 2.0]]])
def test_arrays_that_are_held_are_checked_as_before(value):
    with stepping(torques(2), inputs=["driven.load_torque"], device="cpu") as sim:
        sim.set({"driven.load_torque": 1.0})
        with pytest.raises(WarpchainError, match=r"^set: driven\.load_torque: "):
            sim.set({"driven.load_torque": np.array(value)})


def test_arrays_that_are_held_are_lists_of_their_numbers():
    """What is handed over is copied: an array that changes afterwards changes nothing."""
    found = []
    for kind in (list, np.array):
        with stepping(torques(3), inputs=["driven.load_torque"], outputs=["tension"], **WHOLE) as sim:
            for piece in range(3):
                value = kind([100.0 * piece, 50.0, 200.0])
                sim.set({"driven.load_torque": value})
                value[1] = 1e6
                sim.advance(100 * H)
            sim.set({"driven.load_torque": 80.0}, over=50 * H)  # from what is held
            sim.advance(100 * H)
            found.append(sim.get("tension"))
    np.testing.assert_array_equal(*found)


def test_a_wrong_call_is_one_line_and_changes_nothing():
    with stepping(torques(2), inputs=["driven.load_torque"], outputs=["tension"], **WHOLE) as sim:
        for call, line in CALLS:
            with pytest.raises(WarpchainError) as caught:
                call(sim)
            assert str(caught.value).startswith(line) and "\n" not in str(caught.value)
        kept = sim.state()
        sim.advance(DURATION)
        tension = sim.get("tension")
    with stepping(torques(2), outputs=["tension"], **WHOLE) as plain:
        plain.advance(DURATION)
        np.testing.assert_array_equal(plain.get("tension"), tension)
        with pytest.raises(WarpchainError, match=r"^restore: the state is of other drives"):
            plain.restore(kept)
    for call, _ in CALLS[:-1]:
        with pytest.raises(WarpchainError, match=r"^stepping: the run has ended: its `with` block is over$"):
            call(sim)
    with pytest.raises(WarpchainError, match=r"^stepping: the run is not begun"):
        stepping(two_sprockets(), **WHOLE).advance(H)
    with pytest.raises(WarpchainError, match=r"^stepping: a run is begun once"), sim:
        pass


def test_led_places_and_forces_want_what_they_can_have():
    drive = two_sprockets().with_values(LED["driver.center"][0])
    with stepping(drive, inputs=["driver.center"], **WHOLE) as sim:
        for call, line in [
            (lambda: sim.set({"driver.center": [0.0, 0.0]}), "set: driver.center: needs over=, the time in which"),
            (lambda: sim.set({"driver.center": 1.0}, over=1e-3), "set: driver.center: is of shape (); must be (2,) or"),
        ]:
            with pytest.raises(WarpchainError) as caught:
                call()
            assert str(caught.value).startswith(line)
    with stepping(sprung_blade(), inputs=["plunger.force"], device="cpu") as sim:
        for call, line in [
            (lambda: sim.set({"plunger.force": -1.0}), "set: plunger.force = -1 N: must be at least 0"),
            (lambda: sim.set({"plunger.force": 1.0}, over=1e-3), "set: plunger.force: is held; set it without over="),
        ]:
            with pytest.raises(WarpchainError) as caught:
                call()
            assert str(caught.value).startswith(line)
