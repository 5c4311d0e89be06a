"""What a run is estimated to take on a device, and which one is chosen; devices here are numbers."""

import json
import math
from dataclasses import replace

import pytest
import warp as wp
from command import run as command
from drives import two_sprockets

from warpchain import Record, read_archive, simulate
from warpchain.engine import device_choice, devices
from warpchain.engine.device_choice import DeviceSpeed, estimated_seconds, fastest_devices
from warpchain.engine.pack import pack
from warpchain.results.schedule import Schedule

CPU = DeviceSpeed(1e8, cores=4.0)
GPU = DeviceSpeed(5e10, latency=2e-6, start=0.5)
STEPS = 100_000
ROLLERS = 60


def ensemble(variants, steps=STEPS, measured=False):
    """Equal variants of 60 rollers; without metrics but at the last step, or with metrics all the time."""
    return pack([two_sprockets()] * variants, [Schedule(1e-5, steps, 0 if measured else steps, steps, 0)] * variants)


@pytest.fixture
def known(monkeypatch, tmp_path):
    """A machine of one CPU and two GPUs, whose speeds are `CPU` and `GPU` by their class; nothing is stored."""
    monkeypatch.setattr(device_choice, "speeds_file", lambda: tmp_path / "speeds.json")
    monkeypatch.setattr(device_choice, "machine_facts", lambda gpus: {"cpu": "a", "gpus": list(gpus)})
    monkeypatch.setattr(device_choice, "class_speed", lambda device, *_: CPU if device == "cpu" else GPU)
    monkeypatch.setattr(device_choice, "measure_speeds", lambda *_: pytest.fail("measured"))
    monkeypatch.setattr(device_choice, "has_uncompiled_kernels", lambda *_: False)
    return tmp_path / "speeds.json"


def test_estimates_are_what_the_equations_say():
    # one step with metrics more is 1e-5 of all
    assert estimated_seconds(["cpu"], ensemble(1), 4, CPU) == pytest.approx(STEPS * ROLLERS / 1e8, rel=2e-5)
    assert estimated_seconds(["cpu"], ensemble(8), 4, CPU) == pytest.approx(2 * STEPS * ROLLERS / 1e8, rel=2e-5)
    assert estimated_seconds(["cpu"], ensemble(8), 2, CPU) == pytest.approx(
        4 * STEPS * ROLLERS / 1e8, rel=2e-5
    )  # two threads
    for count, gpus in ((1, ["cuda:0"]), (1000, ["cuda:0"]), (1000, ["cuda:0", "cuda:1"])):
        full = count * STEPS * ROLLERS / 5e10 / len(gpus)
        assert estimated_seconds(gpus, ensemble(count), 4, GPU) == pytest.approx(
            0.5 + math.hypot(STEPS * 2e-6, full), rel=2e-5
        )
    for names, kind, speed in ((["cpu"], "cpu", CPU), (["cuda:0"], "gpu", DeviceSpeed(5e10, 2e-6))):
        bare, measured = (estimated_seconds(names, ensemble(1, measured=of), 4, speed) for of in (False, True))
        assert measured / bare == pytest.approx(device_choice.METRICS_FACTOR[kind], rel=3e-5)


def test_what_finishes_first_is_chosen_and_told(known):
    gpus = ("cuda:0", "cuda:1")
    alone = fastest_devices(gpus, ensemble(1), "float64", 4)
    # 0.06 s of the CPU; 0.5 + 0.2 s of a GPU
    assert alone == (("cpu",), "0.06 s estimated against 0.7 s on cuda:0 and 0.7 s on cuda:0,cuda:1")
    # 1.5 s of four cores, 0.5 + hypot(0.2, 0.012) s of a GPU, hardly less of two: not worth a second one
    crowd = fastest_devices(gpus, ensemble(100), "float64", 4)
    assert crowd == (("cuda:0",), "0.7 s estimated against 1.5 s on cpu and 0.7 s on cuda:0,cuda:1")
    # 0.5 + hypot(0.2, 1.2) s of a GPU, 0.6 s less of two
    assert fastest_devices(gpus, ensemble(10_000), "float64", 4).devices == gpus


def test_of_equal_ones_the_plainest_is_chosen(known, monkeypatch):
    monkeypatch.setattr(device_choice, "class_speed", lambda device, *_: DeviceSpeed(1e8))
    assert fastest_devices(("cuda:0",), ensemble(1), "float64", 4).devices == ("cpu",)


def test_what_has_to_be_compiled_first_counts(known, monkeypatch):
    """100 variants: 1.5 s of the CPU, 0.7 s of a GPU; 8 s and 10 s of compiling where kernels are not there."""
    found = {"cpu": replace(CPU, compile_seconds=8.0), "cuda:0": replace(GPU, compile_seconds=10.0)}
    monkeypatch.setattr(device_choice, "class_speed", lambda device, *_: found[device])
    looked = []

    def chosen(*lacking):
        looked.clear()
        monkeypatch.setattr(
            device_choice, "has_uncompiled_kernels", lambda device, *_: looked.append(device) or device in lacking
        )
        return fastest_devices(("cuda:0", "cuda:1"), ensemble(100), "float64", 4)

    assert chosen().devices == ("cuda:0",) and looked == ["cuda:0"]
    assert chosen("cpu").devices == ("cuda:0",) and looked == ["cuda:0"]  # nobody asks: it is slower anyway
    choice = chosen("cuda:0")
    assert choice == (("cpu",), "1.5 s estimated against 11 s on cuda:0 and 11 s on cuda:0,cuda:1")
    assert looked == ["cuda:0", "cpu"]
    assert chosen("cuda:0", "cpu").devices == ("cpu",) and looked == ["cuda:0", "cpu"]  # 9.5 s


@pytest.mark.parametrize("on", [("cpu", "float64"), pytest.param(("cuda:0", "float32"), marks=pytest.mark.gpu)])
def test_a_kernel_is_known_to_be_compiled(on, monkeypatch, tmp_path):
    (device, precision), drive = on, two_sprockets(duration=5e-4, settle="false")
    simulate(drive, device=device, precision=precision, step=1e-6, record=Record("none"))
    packed = pack([drive], [Schedule(1e-6, 500, 250, 500, 0)])
    assert not device_choice.has_uncompiled_kernels(device, packed, precision)
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(tmp_path))
    assert device_choice.has_uncompiled_kernels(device, packed, precision)


def test_it_is_measured_once_and_only_where_it_pays(known, monkeypatch):
    asked = []

    def measured(gpus, precision, cores):
        asked.append(precision)
        found = {f"cpu {precision}": CPU, f"cuda:0 {precision}": DeviceSpeed(1e7, 2e-6, 0.5)}  # slower than its class
        held = {name: device_choice.asdict(speed) for name, speed in found.items()}
        known.write_text(json.dumps({"machine": device_choice.machine_facts(gpus), "speeds": held}))
        return found

    monkeypatch.setattr(device_choice, "measure_speeds", measured)
    long = ensemble(1, 1500 * STEPS)  # 90 s of the CPU, 300 s of the GPU by their class
    fastest_devices(("cuda:0",), ensemble(1), "float64", 4)  # too short for that
    fastest_devices(("cuda:0",), ensemble(10_000, 60 * STEPS), "float64", 4)  # 9000 s and 73 s: plain
    assert asked == []
    assert fastest_devices(("cuda:0",), long, "float64", 4) == (("cpu",), "90 s estimated against 9.5e+02 s on cuda:0")
    assert fastest_devices(("cuda:0",), ensemble(100), "float64", 4).devices == ("cpu",)  # from what is stored
    assert asked == ["float64"]
    fastest_devices(("cuda:0",), long, "float32", 4)
    assert asked == ["float64", "float32"]


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "[]",
        "null",
        '{"machine": {"cpu": "b", "gpus": ["cuda:0"]}, "speeds": {}}',
        '{"machine": {"cpu": "a", "gpus": ["cuda:0"]}}',
        '{"machine": {"cpu": "a", "gpus": ["cuda:0"]}, "speeds": {"cpu float64": {"pace": 1}}}',
        '{"machine": {"cpu": "a", "gpus": ["cuda:0"]}, "speeds": {"cpu float64": {"rate": -1.0}}}',
        '{"machine": {"cpu": "a", "gpus": ["cuda:0"]}, "speeds": {"cpu float64": {"rate": NaN}}}',
        '{"machine": {"cpu": "a", "gpus": ["cuda:0"]}, "speeds": {"cpu float64": {"rate": "fast"}}}',
        "\udcff",
    ],
)
def test_what_is_broken_or_of_another_machine_does_not_count(known, text):
    known.write_bytes(text.encode(errors="surrogateescape"))
    assert device_choice.stored_speeds(["cuda:0"]) == {}


def test_what_is_measured_is_stored_beside_what_was(monkeypatch, tmp_path):
    monkeypatch.setattr(device_choice, "speeds_file", lambda: tmp_path / "speeds.json")
    monkeypatch.setattr(device_choice, "measure_cpu", lambda precision, cores: CPU)
    assert device_choice.stored_speeds([]) == {}
    device_choice.measure_speeds([], "float64", 4)
    device_choice.measure_speeds([], "float32", 4)
    assert device_choice.stored_speeds([]) == {"cpu float64": CPU, "cpu float32": CPU}
    (tmp_path / "speeds.json").write_text("{")
    device_choice.measure_speeds([], "float64", 4)  # made anew
    assert device_choice.stored_speeds([]) == {"cpu float64": CPU}


def test_where_nothing_can_be_stored_runs_go_on(monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    monkeypatch.setattr(device_choice, "speeds_file", lambda: tmp_path / "file" / "speeds.json")
    monkeypatch.setattr(device_choice, "measure_cpu", lambda precision, cores: CPU)
    assert device_choice.measure_speeds([], "float64", 4) == {"cpu float64": CPU}


def test_a_device_that_cannot_be_measured_has_the_numbers_of_its_class(known, monkeypatch):
    def refuses(*_):
        raise RuntimeError("no compiler")

    monkeypatch.undo()
    monkeypatch.setattr(device_choice, "speeds_file", lambda: known)
    monkeypatch.setattr(device_choice, "measure_cpu", refuses)
    assert device_choice.measure_speeds([], "float64", 4) == {
        "cpu float64": device_choice.class_speed("cpu", "float64", 4)
    }


def test_a_processor_is_measured():
    # the machine is what it is: within a factor of a hundred of a core's 1e8 roller-steps a second
    speed = device_choice.measure_cpu("float64", 2)
    assert speed.is_plausible and 1e6 < speed.rate < 1e10 and 1.0 <= speed.cores < 8.0


def test_a_run_tells_why_it_ran_where_it_did(known, monkeypatch, tmp_path):
    monkeypatch.setattr(devices, "_gpu_architectures", lambda: {"cuda:0": 90})
    drive = two_sprockets(duration=5e-4, settle="false")
    run = simulate(drive, archive=tmp_path / "a.mcap")
    assert run.info.device == "cpu"
    assert run.info.choice.endswith(" s estimated against 0.5 s on cuda:0")
    assert read_archive(tmp_path / "a.mcap").info.choice == run.info.choice
    assert simulate(drive, device="cpu", archive=tmp_path / "b.mcap").info.choice is None
    assert read_archive(tmp_path / "b.mcap").info.choice is None


def test_without_a_gpu_there_is_no_choice_and_nothing_is_estimated(monkeypatch):
    monkeypatch.setattr(devices, "_gpu_architectures", dict)
    monkeypatch.setattr(devices, "fastest_devices", lambda *_: pytest.fail("estimated"))
    assert devices.choose_devices(None, ensemble(1), "float64", 4, 1) == (("cpu",), None)


def test_the_command_lists_and_measures(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(devices, "_gpu_architectures", dict)
    monkeypatch.setattr(device_choice, "speeds_file", lambda: tmp_path / "speeds.json")
    monkeypatch.setattr(device_choice, "measure_cpu", lambda precision, cores: replace(CPU, compile_seconds=7.5))
    status, out, _ = command(capsys, "devices")
    assert status == 0 and out[1:] == [
        "no NVIDIA GPU that Warp can use: runs take the CPU",
        "not measured: the choice of a device goes by its class (warpchain devices --calibrate measures)",
    ]
    status, out, _ = command(capsys, "devices", "--calibrate")
    numbers = "100 million roller-steps a second a core, 4 times that on all, 7.5 s to compile kernels"
    assert status == 0 and out[2:] == [
        f"cpu float32, measured: {numbers}",
        f"cpu float64, measured: {numbers}",
        f"stored in {tmp_path / 'speeds.json'}",
    ]
