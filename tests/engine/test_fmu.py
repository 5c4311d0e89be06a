"""Drives as FMUs: the bits of `simulate` and `stepping`, states, energy, a load outside, other importers, refusals."""

import math
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path

import fmus
import numpy as np
import pytest
from command import refused, run
from drives import example, two_sprockets
from fmus import ERROR, Fmu, Slave
from parts import coupling, shaft

from warpchain import Record, export_fmu, loads_drive, simulate, stepping
from warpchain.drive.examples import example_names
from warpchain.drive.toml import toml_text
from warpchain.results.channels import CHANNEL_BY_NAME

pytestmark = pytest.mark.filterwarnings("ignore::warpchain.errors.SuspectWarning")
H, EVERY = 1e-5, 50
CUTS = [1, 2, 49, 50, 83, 100, 128, 150, 200, 301, 320, 350, 450, 555, 600]
"""Steps after which pieces end, some at frames of the run in one."""


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """Function that exports a drive and opens the FMU."""

    def opened(drive, **options):
        folder = tmp_path_factory.mktemp("fmu")
        return Fmu(export_fmu(drive, folder / "drive.fmu", **options), folder / "unpacked")

    return opened


@pytest.fixture(scope="module")
def plain(exported):
    """FMU of two sprockets, with the load's torque and the speed as inputs."""
    inputs = ["driven.load_torque", "driver.speed"]
    return exported(two_sprockets(), inputs=inputs, outputs=["sprocket_speed", "sprocket_angle", "tension"], step=H)


def recorded_value(trajectory, name, frame):
    """Value of a trajectory's frame by the name of an FMU's variable."""
    words = name.split(".")
    axis = "xy".index(words.pop()) if words[-1] in ("x", "y") else None
    if words[0] in CHANNEL_BY_NAME:
        channel, number = words[0], int(words[1])
    else:
        channel = words[1]
        parts = getattr(trajectory.drive, f"{CHANNEL_BY_NAME[channel].per}s")
        number = [each.name for each in parts].index(words[0])
    value = getattr(trajectory, channel)[frame][number]
    return float(value if axis is None else value[axis])


OTHERS = sorted({*example_names()} - {"car", "v6"})


@pytest.mark.parametrize(
    "name",
    ["two", "car", pytest.param("v6", marks=pytest.mark.long)]
    + [pytest.param(name, marks=pytest.mark.thorough) for name in OTHERS],
)
def test_in_any_pieces_it_has_the_bits_of_simulate(name, exported):
    drive = two_sprockets() if name == "two" else example(name)
    fmu = exported(
        drive, outputs=["tension", "position", "sprocket_speed", "sprocket_center"] if name == "two" else None
    )
    step = fmu.step
    recorded = simulate(drive, device="cpu", duration=600 * step, record=Record(rate=1.0 / (EVERY * step)))[0]
    slave = Slave(fmu).initialize()
    names = fmu.outputs()
    assert len(names) == {"two": 60 + 120 + 2 + 4, "car": 25, "v6": 62}.get(name, len(names))

    def compare(frame):
        theirs = [recorded_value(recorded, each, frame) for each in names]
        np.testing.assert_array_equal(slave.get(*names), theirs, err_msg=str(frame))

    compare(0)
    for before, after in pairwise([0, *CUTS]):
        assert slave.do_step((after - before) * step) == pytest.approx(after * step, rel=1e-12)
        if after % EVERY == 0:
            compare(after // EVERY)
    slave.free()


def everything():
    """Two sprockets, and beside them a part for each kind of input."""
    text = toml_text(two_sprockets().model_dump(mode="json", exclude_none=True))
    text += shaft("flywheel", inertia=1.5, load={"viscous": 20.0}) + shaft("fan", inertia=0.5, motor={"torque": 1.0})
    text += coupling("clutch", ["driven", "flywheel"], 1e5, damping=20.0, clutch={"torque": 100.0})
    arm = {"name": "pendulum", "pivot": [0.5, -1.0], "mass": 2.0, "center": [0.5, -1.4], "inertia": 0.42}
    arm["pivot_table"] = {"time": [0.0, 1.0], "x": [0.0, 0.01]}
    spring = {"stiffness": 2000.0, "preload": 60.0, "damping": 20.0}
    pusher = {"name": "pusher", "on": "pendulum", "at": [0.5, -1.3], "direction": [1.0, 0.0], "kind": "spring"}
    text += toml_text({"arms": [arm], "tensioners": [pusher | {"spring": spring}]})
    mount = {"kind": "prescribed", "direction": [1.0, 0.0], "amplitude": 1e-4, "frequency": 9.0}
    return loads_drive(text).with_values({"sprockets.driver.mount": mount})


ALL_INPUTS = {
    "driven.load_torque": (400.0, 120.0),
    "flywheel.load_torque": (30.0, 5.0),
    "driver.speed": (12.0, 9.0),
    "clutch.capacity": (20.0, 60.0),
    "fan.motor_torque": (3.0, -2.0),
    "driver.center": ([-1e-4, 2e-4], [1e-4, 0.0]),
    "pendulum.pivot": ([0.501, -1.0], [0.5, -1.001]),
    "pusher.force": (80.0, 40.0),
}
"""Values at two instants, for each kind of input."""


def flat_values(values):
    """Values by the names of variables, places as two."""
    return {
        f"{name}{end}": number
        for name, value in values.items()
        for end, number in (zip((".x", ".y"), value, strict=True) if isinstance(value, list) else [("", value)])
    }


def test_each_kind_of_input_has_the_bits_that_it_has_in_stepping(exported):
    """So the energy balance of `stepping` holds here; numpy's sine of the own motion may differ in the last bit."""
    drive = everything()
    channels = ["driven.sprocket_speed", "driver.sprocket_angle", "driver.sprocket_center", "flywheel.shaft_speed"]
    channels += ["fan.shaft_angle", "pendulum.arm_angle", "pusher.tensioner_force", "clutch.coupling_torque"]
    options = {"inputs": [*ALL_INPUTS], "outputs": channels}
    fmu = exported(drive, step=H, **options)
    # before it moves
    assert (
        fmu.attributes["pendulum.pivot.x"]["start"] == "0.5" and fmu.attributes["clutch.capacity"]["start"] == "100.0"
    )
    assert fmu.attributes["driver.speed"] | {"start": "10.0", "unit": "rad/s"} == fmu.attributes["driver.speed"]
    slave = Slave(fmu).initialize()
    with stepping(drive, device="cpu", step=H, duration=0.02, window=(0.0, 0.02), **options) as sim:
        for piece in range(20):
            if piece in (3, 11):
                now = {name: both[piece > 3] for name, both in ALL_INPUTS.items()}
                led = {name for name, value in now.items() if isinstance(value, list)}
                sim.set({name: value for name, value in now.items() if name not in led})
                sim.set({name: now[name] for name in led}, over=100 * H)
                slave.set(flat_values(now))
            sim.advance(100 * H)
            slave.do_step(100 * H)
            theirs = np.concatenate([np.ravel(value) for value in sim.get().values()])
            np.testing.assert_allclose(slave.get(*fmu.outputs()), theirs, rtol=1e-9, atol=1e-12)
        row = sim.metrics().to_pylist()[0]
    assert abs(row["energy_residual_relative"]) < 1e-3
    slave.free()


def test_held_inputs_have_the_bits_of_stepping_at_the_start_too(plain):
    """What is set in initialization acts from t = 0; outputs read in between change nothing."""
    ports = {"inputs": ["driven.load_torque", "driver.speed"], "outputs": ["tension"]}
    slave, other = Slave(plain), Slave(plain)
    slave.initialize(**{"driven.load_torque": 555.0, "driver.speed": 9.0})
    other.call("EnterInitializationMode", *[fmus.c_bool(False), fmus.c_double(0.0)] * 2, fmus.c_double(0.0))
    other.set({"driven.load_torque": 1.0})
    assert other.get("tension.3") != 0.0
    other.set({"driven.load_torque": 555.0, "driver.speed": 9.0})
    assert other.get("tension.3") == slave.get("tension.3")
    other.call("ExitInitializationMode")
    with stepping(two_sprockets(), device="cpu", step=H, duration=0.02, **ports) as sim:
        sim.set({"driven.load_torque": 555.0, "driver.speed": 9.0})
        for count in (1, 7, 92, 200):
            for each in (slave, other):
                each.do_step(count * H)
            sim.advance(count * H)
            theirs = sim.get("tension").tolist()
            for each in (slave, other):
                assert each.get(*(f"tension.{i}" for i in range(60))) == theirs
                each.set({"driver.speed": 9.0 + count})
            sim.set({"driver.speed": 9.0 + count})
    for each in (slave, other):
        each.free()


def test_from_a_state_the_same_bits_follow_in_this_instance_and_in_another(plain):
    slave, names = Slave(plain).initialize(), plain.outputs()
    slave.do_step(111 * H)
    slave.set({"driven.load_torque": 400.0})
    state = slave.state()
    content = slave.bytes_of_state(state)

    def followed(by):
        by.do_step(250 * H)
        by.set({"driver.speed": 5.0})
        by.do_step(239 * H)
        return by.get(*names)

    once = followed(slave)
    slave.restore(state)
    assert followed(slave) == once
    other = Slave(plain).initialize()
    other.do_step(33 * H)
    other.restore((other.state_of_bytes(content)[0], state[1]))
    assert other.bytes_of_state(other.state()) == content
    assert followed(other) == once
    other.state_of_bytes(content[:-1], status=ERROR)
    other.state_of_bytes(bytes(len(content)), status=ERROR)
    assert other.lines == ["deserializeFMUState: these bytes are no state of this FMU"] * 2
    slave.call("Reset")
    slave.time = 0.0
    fresh = Slave(plain).initialize()
    for each in (slave.initialize(), fresh):
        each.do_step(100 * H)
    assert slave.get(*names) == fresh.get(*names)
    for each in (slave, other, fresh):
        each.free()


def test_work_through_an_input_is_what_the_drive_gains(exported):
    """A motor on a flywheel alone: torques times the angles turned are the kinetic energy gained.

    A torque acts from half a step after it is set on, over the same time: of each jump M h / 2 times the speed differs.
    """
    text = toml_text(two_sprockets().model_dump(mode="json", exclude_none=True))
    drive = loads_drive(text + shaft("fan", inertia=0.5, motor={"torque": 1.0}, initial_speed=10.0))
    fmu = exported(drive, inputs=["fan.motor_torque"], outputs=["fan.shaft_speed", "fan.shaft_angle"], step=H)
    slave, work, jumps = Slave(fmu).initialize(), 0.0, 0.0
    first, before = slave.get("fan.shaft_speed", "fan.shaft_angle")
    assert first == 10.0
    speed, torque = first, 0.0
    for _ in range(60):
        wanted = 400.0 * (12.0 - speed)
        jumps += abs(wanted - torque) * speed * H
        torque = wanted
        slave.set({"fan.motor_torque": torque})
        slave.do_step(10 * H)
        speed, angle = slave.get("fan.shaft_speed", "fan.shaft_angle")
        work += torque * (angle - before)
        before = angle
    gained = 0.5 * 0.5 * (speed * speed - first * first)
    assert speed == pytest.approx(12.0 - 2.0 * (1.0 - 400.0 / 0.5 * 10 * H) ** 60, rel=2e-3)
    assert work == pytest.approx(gained, abs=jumps) and jumps < 0.03 * gained
    slave.free()


def test_a_load_outside_comes_to_one_inside_as_the_communication_step_shrinks(exported):
    """A flywheel behind an elastic coupling, inside the drive or moved by another integrator, coupled explicitly.

    What either gets of the other is a communication step old, so that errors are of the first order.
    """
    stiffness, damping, inertia, torque = 400.0, 4.0, 1.5, 60.0
    base = two_sprockets(torque=torque, ramp=2e-2)
    wheel = shaft("wheel", inertia=inertia) + coupling("elastic", ["driven", "wheel"], stiffness, damping=damping)
    whole = loads_drive(toml_text(base.model_dump(mode="json", exclude_none=True)) + wheel)
    duration = 0.08
    with stepping(whole, outputs=["wheel.shaft_speed"], device="cpu", step=H, duration=duration) as sim:
        inside = []
        for _ in range(20):
            sim.advance(duration / 20)
            inside.append(sim.get("wheel.shaft_speed"))
    fmu = exported(base, outputs=["sprocket_angle", "sprocket_speed"], step=H)

    def outside(piece):
        slave, phi, omega, found = Slave(fmu).initialize(), 0.0, 0.0, []
        first = angle = slave.get("driven.sprocket_angle")
        speed, fine = slave.get("driven.sprocket_speed"), 40
        for _ in range(round(duration / piece)):
            moment = stiffness * (angle - first - phi) + damping * (speed - omega)
            slave.set({"driven.load_torque": torque + moment})
            for k in range(fine):  # the driven sprocket goes on at its speed meanwhile
                ahead = (k + 0.5) * piece / fine
                twist = angle + speed * ahead - first - phi
                omega += piece / fine * (stiffness * twist + damping * (speed - omega)) / inertia
                phi += piece / fine * omega
            slave.do_step(piece)
            angle, speed = slave.get("driven.sprocket_angle", "driven.sprocket_speed")
            found.append(omega)
        slave.free()
        every = round(duration / piece / 20)
        return np.array(found[every - 1 :: every])

    errors = [np.abs(outside(piece) - inside).max() for piece in (2e-3, 1e-3, 5e-4, 2.5e-4)]
    assert errors[0] < 0.05 * max(np.abs(inside)), errors
    for coarse, fine in pairwise(errors):
        assert 1.6 < coarse / fine < 2.6, errors


def test_wrong_calls_are_errors_of_one_line(plain):
    assert Slave(plain, token="{0}").handle is None
    slave = Slave(plain)
    slave.do_step(H, status=ERROR)
    slave.initialize()
    slave.set({"driver.sprocket_speed": 1.0}, status=ERROR)
    slave.set({"driver.speed": math.nan}, status=ERROR)
    slave.do_step(-H, status=ERROR)
    slave.time = 1.0
    slave.do_step(H, status=ERROR)
    slave.time = 0.0
    slave.do_step(1e9, status=ERROR)
    slave.call("GetInt32", (fmus.c_uint32 * 1)(1), fmus.c_size_t(1), None, fmus.c_size_t(1), status=ERROR)
    slave.call("EnterEventMode", status=ERROR)
    assert slave.lines == [
        "doStep: needs an instance that is initialized and not terminated",
        "setFloat64: variable 3 is no input",
        "driver.speed = nan: must be a finite number, at least -inf",
        "doStep: a step size of -1e-05 s: must be a finite number above 0",
        "doStep: from t = 1 s, but the drive stands at 0 s",
        "doStep: to t = 1e+09 s: it counts steps up to 21474.8 s",
        "fmi3GetInt32: all variables are Float64",
        "fmi3EnterEventMode: is not provided",
    ]
    slave.do_step(0.2 * H)  # to the nearest step: none
    assert slave.get("time") == 0.0
    slave.do_step(0.9 * H)
    assert slave.get("time") == H
    slave.free()


def test_a_start_later_than_0_is_the_drive_s_own_0(plain):
    slave, other = Slave(plain, start=5.0).initialize(), Slave(plain).initialize()
    for each in (slave, other):
        each.do_step(100 * H)
    assert slave.get("time") == pytest.approx(5.0 + 100 * H) and slave.get("tension.5") == other.get("tension.5")
    for each in (slave, other):
        each.free()


def test_instances_run_side_by_side(plain):
    """Each in a thread of its own, its load of its own: what each alone gives."""

    def speed(torque):
        slave = Slave(plain).initialize(**{"driven.load_torque": torque})
        for _ in range(20):
            slave.do_step(50 * H)
        found = slave.get("driven.sprocket_speed")
        slave.free()
        return found

    torques = [100.0 * k for k in range(8)]
    with ThreadPoolExecutor(4) as pool:
        together = [*pool.map(speed, torques)]
    assert together == [speed(torque) for torque in torques] and len(set(together)) == len(torques)


def test_divergence_is_an_error_with_a_line(exported):
    torn = two_sprockets().with_values({"sprockets.driver.prescribed": {"speed": 1e5, "ramp_time": 0.0}})
    slave = Slave(exported(torn, outputs=["driven.sprocket_speed"], step=H)).initialize()
    last = slave.do_step(300 * H, status=ERROR)
    assert 0.0 < last < 300 * H
    assert slave.lines[0].startswith(f"diverged at t = {last:.6g} s: a roller or a body has left the drive")
    assert math.isnan(slave.get("driven.sprocket_speed"))
    slave.do_step(H, status=ERROR)
    slave.free()


def test_it_needs_no_package_and_no_library_but_those_of_c(plain, tmp_path):
    code = (
        "import sys; sys.path[:0] = sys.argv[1:2]; from pathlib import Path; from fmus import Fmu, Slave\n"
        "slave = Slave(Fmu(Path(sys.argv[2]), Path(sys.argv[3]))).initialize(); slave.do_step(1e-3)\n"
        "assert slave.get('driven.sprocket_speed') != 0.0 and not {'numpy', 'warp'} & {*sys.modules}\n"
        "maps = Path('/proc/self/maps').read_text(); assert 'drive_drive.so' in maps and 'warp' not in maps\n"
    )
    path = export_fmu(two_sprockets(), tmp_path / "drive.fmu", inputs=[], step=H)
    words = [str(Path(fmus.__file__).parent), str(path), str(tmp_path / "unpacked")]
    done = subprocess.run([sys.executable, "-I", "-c", code, *words], cwd="/", capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_any_name_of_a_part_goes_through_xml_and_c(tmp_path):
    name = 'Räd "x" <&> %d?'
    values = two_sprockets().model_dump(mode="json", exclude_none=True)
    values["sprockets"][1]["name"] = name
    fmu = Fmu(export_fmu(loads_drive(toml_text(values)), tmp_path / "ü b-1.fmu", step=H), tmp_path / "unpacked")
    slave = Slave(fmu).initialize()
    slave.set({f"{name}.load_torque": math.inf}, status=ERROR)
    assert slave.lines == [f"{name}.load_torque = inf: must be a finite number, at least -inf"]
    slave.do_step(100 * H)
    assert slave.get(f"{name}.sprocket_speed") > 0.0
    slave.free()


def test_the_same_drive_has_the_same_file(tmp_path):
    first, second = (export_fmu(two_sprockets(), tmp_path / name / "drive.fmu", step=H) for name in made(tmp_path))
    assert first.read_bytes() == second.read_bytes()


def made(folder):
    """Two new folders."""
    for name in ("a", "b"):
        (folder / name).mkdir()
        yield name


def test_fmpy_validates_and_runs_it(tmp_path):
    fmpy = pytest.importorskip("fmpy")
    from fmpy.validation import validate_fmu

    path = export_fmu(two_sprockets(), tmp_path / "drive.fmu", step=H)
    assert validate_fmu(str(path)) == []
    torque = np.array([(0.0, 100.0), (1e-3, 100.0), (1e-3, 500.0), (1.0, 500.0)],
                      dtype=[("time", float), ("driven.load_torque", float)])  # fmt: skip
    asked = {"stop_time": 4e-3, "output_interval": 1e-4, "input": torque, "output": ["driven.sprocket_speed"]}
    found = fmpy.simulate_fmu(str(path), **asked)["driven.sprocket_speed"]
    ports = {"inputs": ["driven.load_torque"], "outputs": ["driven.sprocket_speed"]}
    with stepping(two_sprockets(), device="cpu", step=H, duration=1.0, **ports) as sim:
        sim.set({"driven.load_torque": 100.0})
        for k in range(1, 41):
            sim.advance(1e-4)
            assert found[k] == sim.get("driven.sprocket_speed"), k
            if k == 10:
                sim.set({"driven.load_torque": 500.0})


REFUSALS = {
    "--inputs driven.torque": "inputs: 'driven.torque': must be PART.KIND, such as driven.load_torque; kinds are",
    "--inputs crank.load_torque": "inputs: 'crank.load_torque': load_torque is an input of free sprockets and shafts",
    "--outputs tensions": "outputs: 'tensions' is unknown; allowed are position, velocity, tension",
    "--outputs tension crank.tension": "outputs: 'crank.tension': tension is of each link; name it without a part",
    "--outputs sprocket_speed crank.sprocket_speed": "outputs: 'crank.sprocket_speed' is there twice",
    "--step 1": "variant 0: run.step = 1: must be above 0 and below",
    "--metrics": "--metrics: only of an archive, not of a drive",
    "--variant 3": "--variant: only of an archive, not of a drive",
    "--device cuda": "unrecognized arguments: --device cuda",
    "--precision float32": "unrecognized arguments: --precision float32",
}


@pytest.mark.parametrize("words", REFUSALS)
def test_a_wrong_option_is_one_line(words, capsys, tmp_path):
    line = refused(capsys, "export", "car", "-o", tmp_path / "drive.fmu", *words.split())
    assert line.partition(": error: ")[2].startswith(REFUSALS[words]), line
    assert not [*tmp_path.iterdir()]


def test_options_of_drives_are_refused_with_an_archive(capsys, tmp_path):
    line = refused(capsys, "export", tmp_path / "run.mcap", "-o", tmp_path / "run.csv", "--inputs", "a.speed")
    assert line.endswith("--inputs: only with -o OUT.fmu")


def test_without_a_compiler_one_line_says_so(capsys, tmp_path, monkeypatch):
    words = ("export", "car", "-o", tmp_path / "drive.fmu")
    monkeypatch.setenv("CC", "no-such-compiler -m64")
    line = (
        "an FMU needs a C compiler: CC = 'no-such-compiler' is no program; install one, or name it by the variable CC"
    )
    assert refused(capsys, *words).endswith(line)
    monkeypatch.setenv("CC", "false")
    assert refused(capsys, *words).endswith("false: cannot make the FMU's library: exit status 1")
    monkeypatch.delenv("CC")
    monkeypatch.setenv("PATH", str(tmp_path))
    assert "an FMU needs a C compiler: none of cc, gcc, clang is here; install one" in refused(capsys, *words)
    assert not [*tmp_path.iterdir()]


def test_the_command_prints_the_file(capsys, tmp_path):
    path = tmp_path / "car.fmu"
    words = ("--inputs", "crank.speed", "--outputs", "tensioner.tensioner_force", "--set", "run.duration=0.01")
    assert run(capsys, "export", "car", "-o", path, *words) == (0, [str(path)], [])
    fmu = Fmu(path, tmp_path / "unpacked")
    assert [*fmu.references] == ["time", "crank.speed", "tensioner.tensioner_force"]
    assert fmu.description.find("DefaultExperiment").get("stopTime") == "0.01"
