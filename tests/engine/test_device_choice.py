"""What a run is estimated to take on a device, and which one is chosen; devices here are numbers."""

import math

import pytest
import warp as wp
from command import run as command
from drives import two_sprockets

from warpchain import Record, read_archive, simulate
from warpchain.engine import device_choice, devices
from warpchain.engine.device_choice import estimated_seconds, fastest_devices
from warpchain.engine.pack import pack
from warpchain.results.schedule import Schedule

CORE, GPU, LATENCY, START = 1e8, 5e10, 2e-6, 0.5
STEPS = 100_000
ROLLERS = 60


def ensemble(variants, steps=STEPS, measured=False):
    """Equal variants of 60 rollers; without metrics but at the last step, or with metrics all the time."""
    return pack([two_sprockets()] * variants, [Schedule(1e-5, steps, 0 if measured else steps, steps, 0)] * variants)


@pytest.fixture
def known(monkeypatch):
    """A machine of one CPU and two GPUs with the speeds above, whose kernels are compiled."""
    monkeypatch.setattr(device_choice, "CORE_RATE", CORE)
    monkeypatch.setattr(device_choice, "GPU_START", START)
    monkeypatch.setattr(device_choice, "gpu_speed", lambda *_: (GPU, LATENCY))
    monkeypatch.setattr(device_choice, "has_uncompiled_kernels", lambda *_: False)


def test_estimates_are_what_the_equations_say(known):
    # one step with metrics more is 1e-5 of all
    for count, cores, seconds in ((1, 4, 0.06), (8, 4, 0.12), (8, 2, 0.24)):
        assert estimated_seconds(["cpu"], ensemble(count), "float64", cores) == pytest.approx(seconds, rel=2e-5)
    for count, gpus in ((1, ["cuda:0"]), (1000, ["cuda:0"]), (1000, ["cuda:0", "cuda:1"])):
        full = count * STEPS * ROLLERS / GPU / len(gpus)
        seconds = START + math.hypot(STEPS * LATENCY, full)
        assert estimated_seconds(gpus, ensemble(count), "float64", 4) == pytest.approx(seconds, rel=2e-5)
        half = ensemble(count // 2 or 1)
        assert estimated_seconds(gpus, half, "float64", 4, count / len(half.first_rows)) == pytest.approx(
            seconds, rel=2e-5
        )
    for names, begin in ((["cpu"], 0.0), (["cuda:0"], START)):
        bare, measured = (estimated_seconds(names, ensemble(1, measured=of), "float64", 4) - begin for of in (0, 1))
        assert measured / bare == pytest.approx(device_choice.METRICS_FACTOR, rel=3e-5)


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
    monkeypatch.setattr(device_choice, "gpu_speed", lambda *_: (4.0 * CORE, 0.0))
    monkeypatch.setattr(device_choice, "GPU_START", 0.0)
    assert fastest_devices(("cuda:0",), ensemble(8), "float64", 4).devices == ("cpu",)


def test_what_has_to_be_compiled_first_counts(known, monkeypatch):
    """100 variants: 1.5 s of the CPU, 0.7 s of a GPU; 8 s and 10 s of compiling where kernels are not there."""
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


def test_the_command_lists_devices(monkeypatch, capsys):
    monkeypatch.setattr(devices, "_gpu_architectures", dict)
    status, out, _ = command(capsys, "devices")
    assert status == 0 and out == [out[0], "no NVIDIA GPU that Warp can use: runs take the CPU"]
    assert out[0].startswith("cpu: ") and out[0].endswith(" cores")
