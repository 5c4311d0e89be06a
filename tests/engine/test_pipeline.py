"""Runs in shares, packed one after the other while those before are stepped; CPU engines stand for GPUs."""

import os
import re
import signal
import threading
import time
import warnings
from concurrent.futures import Future
from types import SimpleNamespace

import chains
import numpy as np
import pytest
import warp as wp
from drives import assert_same_frames, example, of_long, two_sprockets
from loading import load_script
from raw import Frames

from warpchain import Record, read_archive, simulate
from warpchain.engine import devices, gpu, pipeline, subensemble
from warpchain.engine.arrays import sums_bytes
from warpchain.engine.checkpoint import States
from warpchain.engine.pack import pack
from warpchain.engine.simulation import schedules_of
from warpchain.engine.subensemble import Variants
from warpchain.errors import DeviceError, DriveError, LayoutWarning, SimulationError, SuspectWarning
from warpchain.model.stacks import stacks_of_drives

NONE = Record("none")


@pytest.fixture
def gpus(monkeypatch):
    """A machine of two GPUs, each of which gets up to two shares of two variants or more."""
    monkeypatch.setattr(devices, "_gpu_architectures", lambda: {"cuda:0": 90, "cuda:1": 90})
    monkeypatch.setattr(devices, "fastest_devices", lambda names, *_: devices.DeviceChoice(tuple(names), "as told"))
    monkeypatch.setattr(gpu, "GpuEngine", lambda packed, name: Frames(packed, 1))
    monkeypatch.setattr(gpu, "compile_missing_kernels", lambda *_: None)
    monkeypatch.setattr(pipeline, "FEWEST_PER_SUBENSEMBLE", 2)
    monkeypatch.setattr(pipeline, "MOST_PER_GPU", 2)


def short(**changes):
    return two_sprockets(**{"duration": 0.002, "settle": "false", **changes})


def mixed():
    """Nine drives, unlike in values, links, sprockets, steps and settling; the sixth diverges."""
    marine = example("marine").with_values({"run.duration": 0.002})
    mad = short(contact=2e8, floor=1e-9, torque=5e7, viscous=1e8)
    settling = [two_sprockets(duration=0.002, torque=50.0 * k) for k in (1, 2)]
    return [short(), short(torque=100.0, step=3e-6), marine, *settling, mad, marine, short(teeth=24, links=64),
            short(torque=7.0)]  # fmt: skip


def run(drives, **options):
    """A run with its warnings."""
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        found = simulate(drives, **{"record": NONE, **options})
    return found, [(of.category, str(of.message)) for of in told if issubclass(of.category, UserWarning)]


def shared(counts):
    """Notes how many variants are packed at a time."""
    made = subensemble.pack

    def pack(drives, *rest):
        counts.append(len(drives))
        return made(drives, *rest)

    return made, pack


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_a_run_in_shares_gives_the_same_table(gpus, monkeypatch, precision):
    """Bitwise, with the same warnings; 9 variants on two GPUs are four shares, as each is to have two or more."""
    counts = []
    made, noting = shared(counts)
    drives = mixed()
    alone, told = run(drives, device="cpu", workers=1, precision=precision)
    monkeypatch.setattr(subensemble, "pack", noting)
    for device, parts in (("cuda", 4), (None, 4), ("cuda:1", 2)):
        counts.clear()
        several, said = run(drives, device=device, workers=1, precision=precision)
        assert len(counts) == parts and sum(counts) == len(drives)
        assert several.metrics.equals(alone.metrics, check_metadata=True)
        assert said == told and {kind for kind, _ in said} >= {SuspectWarning}
        assert several.info.device == {"cuda:1": "cuda:1"}.get(device, "cuda:0,cuda:1")
        assert several.info.choice == ("as told" if device is None else None)
        assert several.info.ended == "complete" and several.info.step is None and not list(several)
        assert several.drives == tuple(drives)
    assert alone.metrics["diverged"].to_pylist() == [v == 5 for v in range(9)]


def test_copies_windows_and_limits_are_those_of_the_whole(gpus):
    drives = [short(), short(torque=100.0), short(torque=9.0)]
    options = {
        "replicates": 3,
        "replicate_by": "perturbation",
        "window": (0.0005, 0.001),
        "duration": 0.001,
        "workers": 1,
    }
    one, _ = run(drives, device="cpu", **options)
    many, _ = run(drives, device="cuda", **options)
    assert many.metrics.equals(one.metrics, check_metadata=True)
    assert many.summary.equals(one.summary) and many.replicates == 3


def test_what_is_recorded_has_the_same_frames_in_shares(gpus, monkeypatch, tmp_path):
    """An archive's variants are written side by side: in one share a GPU."""
    counts = []
    _, noting = shared(counts)
    drives = mixed()
    monkeypatch.setattr(subensemble, "pack", noting)
    one, _ = run(drives, device="cpu", record=Record((1, 6)), workers=1)
    many, _ = run(drives, device="cuda", record=Record((1, 6)), workers=1)
    run(drives, device="cuda", archive=tmp_path / "x.mcap", record=Record((1, 6)), workers=1)
    run(drives, device="cuda", archive=tmp_path / "y.mcap", record=Record("all"), workers=1)
    assert list(map(len, (counts[:1], counts[1:5], counts[5:7], counts[7:]))) == [1, 4, 2, 2]
    for of in (many, read_archive(tmp_path / "x.mcap")):
        assert list(of) == [1, 6]
        for v in (1, 6):
            assert_same_frames(one[v], of[v])
        assert of.metrics.equals(one.metrics)
    assert list(read_archive(tmp_path / "y.mcap")) == list(range(9))


def test_states_are_kept_and_gone_on_with_in_shares(gpus):
    drives = [two_sprockets(torque=torque) for torque in (1.0, 2.0, 3.0, 4.0, 5.0)]
    options = {"workers": 1, "window": (0.0, 0.001)}
    one, many = States(), States()
    for device, states in (("cpu", one), ("cuda", many)):
        run(drives, device=device, duration=0.001, states=states, **options)
    assert [kept.data for kept in many.kept] == [kept.data for kept in one.kept]
    longer = {"duration": 0.002, "window": (0.0, 0.002), "workers": 1}
    on = States(begin=[many.kept[0], None, *many.kept[2:]])
    gone_on, _ = run(drives, device="cuda", states=on, **longer)
    whole, _ = run(drives, device="cpu", **longer)
    assert on.used == [True, False, True, True, True]
    assert gone_on.metrics.equals(whole.metrics)


def test_shares_have_their_variants_part_of_the_memory(gpus):
    """What is enough for a run at once is enough for its shares, here of one long drive and of three short ones.

    But for 1 kB each: a pack without guides counts one.
    """
    drives = [short(duration=0.008, step=1e-6), *[short(step=1e-6)] * 3]
    taken = sums_bytes(pack(drives, schedules_of(drives, None, None, NONE, None)))
    found, _ = run(drives, device="cuda", memory=taken + 4 * 1000, workers=1)
    assert found.info.ended == "complete"
    with pytest.raises(SimulationError, match=r"the statistics of 1 variants take .* has for them"):
        run(drives, device="cuda", memory=taken - 4 * 1000, workers=1)


def test_the_second_share_is_packed_before_the_first_has_ended(gpus, monkeypatch):
    """The first share's engine does not end before the last share has been packed: else this would wait for ever."""
    packing, packed = [], threading.Event()
    made = subensemble.pack

    def pack(drives, schedules, stacks, numbers):
        packing.append(numbers.tolist())
        found = made(drives, schedules, stacks, numbers)
        if len(packing) == 4:
            packed.set()
        return found

    class Waiting(Frames):
        def advance(self, steps, frames):
            assert packed.wait(30.0)
            return super().advance(steps, frames)

    monkeypatch.setattr(subensemble, "pack", pack)
    monkeypatch.setattr(gpu, "GpuEngine", lambda part, name: Waiting(part, 1))
    found, _ = run([short(torque=float(k)) for k in range(8)], device="cuda")
    assert sorted(v for of in packing for v in of) == list(range(8)) and found.info.ended == "complete"


def test_progress_is_one_bar_told_by_the_caller(gpus):
    """All phases are one, whose total is known from the beginning: the simulated time of all."""
    seen = []
    drives = [two_sprockets(duration=0.002, torque=float(k)) for k in range(8)]
    run(drives, device="cuda", progress=lambda *told: seen.append((*told, threading.current_thread())))
    ((phase, total),) = {(phase, total) for phase, _, total, _ in seen}
    assert phase == "simulating" and total == pytest.approx(8.0 * 0.002)
    assert {thread for *_, thread in seen} == {threading.current_thread()}
    done = [done for _, done, _, _ in seen]
    assert done == sorted(done) and done[-1] == pytest.approx(total)


def test_progress_of_compiling_is_told_by_the_caller_too(gpus, monkeypatch):
    """A share that compiles waits here until the caller has told; steps follow."""
    seen, told = [], threading.Event()

    def compile_lacking(device, packed, precision, settles, cores, report, stop):
        report("compiling", 1, 2)
        assert told.wait(30.0)
        report("compiling", 2, 2)

    def report(phase, done, total):
        seen.append((phase, done, total))
        if phase == "compiling":
            told.set()

    monkeypatch.setattr(gpu, "compile_missing_kernels", compile_lacking)
    run([short()] * 8, device="cuda", progress=report)
    assert ("compiling", 1, 2) in seen and seen[-1][0] == "simulating"


def gone():
    """Whether all threads of shares have ended."""
    return not [thread for thread in threading.enumerate() if thread.name.startswith("warpchain")]


@pytest.mark.parametrize("bad", [0, 3, 7])
def test_a_chain_that_does_not_fit_is_named_and_stops_the_others(gpus, bad, tmp_path):
    drives = [short(duration=1000.0) for _ in range(8)]
    drives[bad] = short(duration=1000.0, links=50)
    begin = time.monotonic()
    for options in ({}, {"archive": tmp_path / "x.mcap", "record": Record([1], rate=10.0)}):
        with pytest.raises(DriveError, match=f"^variant {bad}: .*chain"):
            run(drives, device="cuda", **options)
        assert gone()
    assert time.monotonic() - begin < 60.0  # the others would take hours
    assert not list(tmp_path.iterdir())


def test_steps_beyond_their_limit_are_told_before_anything_is_packed(gpus, monkeypatch):
    monkeypatch.setattr(subensemble, "pack", lambda *_: pytest.fail("packed"))
    drives = [short(), short(), short(), short(stiffness=1.5e8, contact=1.5e8)]
    with pytest.raises(DriveError, match=r"variant 3: run\.step = 7e-05"):
        run(drives, device="cuda", step=7e-5)


def test_what_fails_on_a_gpu_ends_the_run(gpus, monkeypatch):
    class Failing(Frames):
        def advance(self, steps, frames):
            if (self.packed.drives["steps"] == 400).any():
                failed = Future()
                failed.set_exception(SimulationError("device cuda:1: out of memory"))
                return [failed]
            return super().advance(steps, frames)

    monkeypatch.setattr(gpu, "GpuEngine", lambda part, name: Failing(part, 1))
    begin = time.monotonic()
    with pytest.raises(SimulationError, match="cuda:1: out of memory"):
        run([*[short(duration=1000.0)] * 2, short(), short(), *[short(duration=1000.0)] * 2], device="cuda")
    assert gone() and time.monotonic() - begin < 30.0


def test_a_raise_of_the_callers_own_ends_the_run(gpus):
    def report(phase, done, total):
        if done > 0.0:
            raise KeyError("enough")

    with pytest.raises(KeyError, match="enough"):
        run([short(duration=1000.0)] * 8, device="cuda", progress=report)
    assert gone()


def cut_into(monkeypatch, cut):
    """Makes shares of variants (V,) by the numbers in `cut`."""
    ways = [cut == k for k in range(int(cut.max()) + 1)]
    monkeypatch.setattr(pipeline, "split_variants", lambda members, *_: [members.select(way) for way in ways])


def test_ctrl_c_keeps_all_variants_in_their_order(gpus, monkeypatch):
    """Shares are a short variant and one that takes hours. When it is stopped, two shares have begun."""
    drives = [short(torque=1.0 + k) if k % 2 == 0 else short(duration=1000.0) for k in range(8)]
    whole, _ = run(drives[::2], device="cpu", workers=1)
    cut_into(monkeypatch, np.arange(8) // 2)
    timer = threading.Timer(3.0, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    found, _ = run(drives, device="cuda")
    assert found.info.ended == "interrupted" and gone()
    assert found.metrics["variant"].to_pylist() == list(range(8))
    means = whole.metrics["tension_mean"].to_pylist()
    assert found.metrics["tension_mean"].to_pylist() == [means[0], None, means[1], *[None] * 5]


def test_a_stop_while_kernels_are_compiled_launches_none(gpus, monkeypatch):
    monkeypatch.setattr(gpu, "compile_missing_kernels", lambda *rest: rest[-1].ask_to_stop())
    for name in ("settle", "advance"):
        monkeypatch.setattr(Frames, name, lambda *_: pytest.fail("launched"))
    found, _ = run([two_sprockets(duration=0.002)] * 8, device="cuda")
    assert found.info.ended == "interrupted" and found.metrics["variant"].to_pylist() == list(range(8))


@pytest.mark.parametrize(("chosen", "packed"), [(("cpu",), [8]), (("cuda:0",), [4, 4])])
def test_where_not_all_gpus_are_chosen_variants_are_cut_anew(gpus, monkeypatch, chosen, packed):
    counts = []
    _, noting = shared(counts)
    monkeypatch.setattr(subensemble, "pack", noting)
    asked = []

    def quickest(names, packed, precision, cores, times):
        asked.append((packed.variants, times))
        return devices.DeviceChoice(chosen, "small")

    monkeypatch.setattr(devices, "fastest_devices", quickest)
    found, _ = run([short()] * 8, device=None)
    assert counts == [1, *packed] and asked == [(1, 8.0)]
    assert (found.info.device, found.info.choice) == (*chosen, "small")


def test_layouts_are_told_once_for_all(gpus):
    crossed = two_sprockets().model_dump(exclude_none=True)
    crossed["sprockets"][1]["wrap"] = "cw"
    wrong = type(short())(**{**crossed, "chain": {**crossed["chain"], "links": 64}})
    drives = [short(), wrong, short(), short(), short(), short(), short(), wrong]
    one, told = run(drives, device="cpu", duration=1e-4)
    many, said = run(drives, device="cuda", duration=1e-4)
    assert said == told and said[0][0] is LayoutWarning and "variant 1, and of 1 further" in said[0][1]
    assert many.metrics.equals(one.metrics)


def members_of(drives):
    """Variants of a run of these drives."""
    schedules = schedules_of(drives, None, None, NONE, None)
    return Variants(drives, schedules, stacks_of_drives(drives, len(drives)), np.arange(len(drives)))


def test_a_gpu_gets_shares_of_2048_variants_or_more_and_each_one_at_least():
    members = members_of([short()] * 10_000)
    for gpus, most, number in ((0, 4, 1), (1, 4, 4), (1, 1, 1), (2, 4, 4), (4, 4, 4), (8, 4, 8), (2, 1, 2)):
        assert len(pipeline.split_variants(members, gpus, most)) == number
    few = members_of([short()] * 3)
    assert [len(part.drives) for part in pipeline.split_variants(few, 2, 4)] == [2, 1]
    assert len(pipeline.split_variants(few, 8, 4)) == 3
    long = two_sprockets(links=20_000, span=9990.0)
    assert len(pipeline.split_variants(members_of([long, long]), 2, 4)) == 1  # which a GPU does not take


def test_shares_have_alike_work_and_variants_of_all_lengths():
    """A list sorted by steps, which differ twofold, of one kind, and a tenth of two other kinds."""
    drives = [short(duration=0.002 + 1e-6 * k) for k in range(2000)]
    drives += [short(links=links) for links in (62, 64) for _ in range(50)]
    members = members_of(drives)
    rollers = np.array([drive.chain.links for drive in drives])
    np.testing.assert_array_equal(members.roller_steps, rollers * [of.steps + 1.0 for of in members.schedules])
    parts = [members.select(chosen) for chosen in pipeline.deal_variants(members, 5, 5)]
    assert sorted(v for part in parts for v in part.numbers.tolist()) == list(range(len(drives)))
    work = [part.roller_steps.sum() for part in parts]
    assert max(work) < 1.02 * min(work)
    for part in parts:
        assert part.drives == [drives[v] for v in part.numbers]
        assert sorted(v for stack in part.stacks for v in stack.members.tolist()) == list(range(len(part.drives)))
        for stack in part.stacks:
            assert {stack.one.links} == {part.drives[v].links for v in stack.members}
        steps = [of.steps for of, drive in zip(part.schedules, part.drives, strict=True) if drive.links == 60]
        assert 0.95 < np.mean(steps) / 600.0 < 1.05
    assert sum(len(part.stacks) for part in parts) == 7  # kinds of 50 stay together


def test_the_first_shares_of_several_gpus_have_two_fifths_of_the_work_of_others():
    members = members_of([short()] * 2800)
    for gpus, wanted in ((1, [700] * 4), (2, [400, 400, 1000, 1000]), (4, [700] * 4)):
        parts = [members.select(chosen) for chosen in pipeline.deal_variants(members, 4, gpus)]
        assert [len(part.drives) for part in parts] == pytest.approx(wanted, rel=0.05)


def bits(table):
    """The bytes of a table's columns, by name."""
    columns = {name: table[name].combine_chunks().buffers() for name in table.column_names}
    return {name: [held and held.to_pybytes() for held in buffers] for name, buffers in columns.items()}


def cuts_of(count):
    """Shares of so many variants, cut in several ways: one by one and the rest, in halves, and every third."""
    v = np.arange(count)
    return (np.minimum(v, 3), v >= count // 2, v % 3)


SEVERAL = [chains.two_stages(duration=0.002, torque=torque) for torque in (100.0, 130.0, 70.0, 90.0, 110.0, 80.0, 95.0)]
DESIGNS = ["marine", "car", *of_long("engine", "industrial")]


@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("name", [*DESIGNS, "several chains"])
def test_no_cut_into_shares_changes_a_bit_of_any_column(gpus, monkeypatch, name, precision):
    """Designs that settle; those of `car` have guides that bend their chains, and arms."""
    designs = load_script("benches.drives").varied_designs
    drives = SEVERAL if name == "several chains" else designs(example(name), name, 7)
    options = {"precision": precision, "workers": 1, "duration": 0.001}
    whole = bits(run(drives, device="cpu", **options)[0].metrics)
    for cut in cuts_of(7):
        cut_into(monkeypatch, cut)
        found = bits(run(drives, device="cuda", **options)[0].metrics)
        assert list(found) == list(whole)
        assert [column for column in whole if found[column] != whole[column]] == []


class Lost(Frames):
    """An engine on a GPU that fails at a launch."""

    def __init__(self, packed, name, failing):
        super().__init__(packed, 1)
        self.name, self.failing, self.launches = name, failing, 0

    def advance(self, steps, frames):
        self.launches += 1
        if self.name in self.failing and self.launches > 1:
            failed = Future()
            failed.set_exception(DeviceError(f"device {self.name} failed, see nvidia-smi: CUDA error 719"))
            return [failed]
        return super().advance(steps, frames)


@pytest.mark.parametrize("failing", ["cuda:0", "cuda:1"])
def test_what_a_failed_gpu_had_is_done_again_on_another(gpus, monkeypatch, failing):
    """Bitwise, frames too; launches are short, so that it fails in the midst of a share."""
    drives = mixed()
    options = {"record": Record((1, 6)), "workers": 1}
    whole, told = run(drives, device="cpu", **options)
    monkeypatch.setattr(gpu, "GpuEngine", lambda packed, name: Lost(packed, name, [failing]))
    monkeypatch.setattr(devices, "launch_step_limit", lambda *_: 64)
    monkeypatch.setattr(subensemble, "launch_step_limit", lambda *_: 64)
    found, said = run(drives, device="cuda", **options)
    assert bits(found.metrics) == bits(whole.metrics)
    for v in (1, 6):
        assert_same_frames(found[v], whole[v])
    (line,) = [line for line in said if line not in told]
    assert line == (
        UserWarning,
        f"device {failing} failed, see nvidia-smi: CUDA error 719; another GPU took what it had",
    )
    assert gone()


def test_a_run_ends_in_one_line_where_no_gpu_is_left(gpus, monkeypatch):
    monkeypatch.setattr(gpu, "GpuEngine", lambda packed, name: Lost(packed, name, ["cuda:0", "cuda:1"]))
    monkeypatch.setattr(subensemble, "launch_step_limit", lambda *_: 64)
    for drives in ([short()] * 8, [short()]):
        with pytest.raises(SimulationError, match=r"^device cuda:. failed, see nvidia-smi: CUDA error 719$"):
            run(drives, device="cuda", duration=1.0)
    assert gone()


def test_an_archive_keeps_what_was_written_before_a_gpu_failed(gpus, monkeypatch, tmp_path):
    """Frames of its share are there already: nothing is run again."""
    monkeypatch.setattr(gpu, "GpuEngine", lambda packed, name: Lost(packed, name, ["cuda:1"]))
    monkeypatch.setattr(subensemble, "launch_step_limit", lambda *_: 6400)
    drives = [short(duration=0.1, torque=float(k)).with_values({"run.sample_rate": 2e5}) for k in range(4)]
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        with pytest.raises(DeviceError, match=r"^device cuda:1 failed"):
            simulate(drives, device="cuda", archive=tmp_path / "x.mcap")
    assert any("was not finished; what was written until then is in" in str(of.message) for of in told)


def test_a_gpu_that_does_not_answer_is_told_from_one_without_memory(monkeypatch):
    text = "Failed to synchronize device cuda:0: Warp CUDA error 700: an illegal memory access"

    def answering(device):
        raise RuntimeError(f"{text} (in function wp_cuda_context_synchronize, warp.cu:2000)")

    answers = SimpleNamespace(
        synchronize_device=lambda device: None, get_device=lambda device: SimpleNamespace(free_memory=2**30)
    )
    failed = SimpleNamespace(synchronize_device=answering)
    for warp, raised, line in (
        (answers, "Failed to allocate 8 bytes", "device cuda:0: out of memory with 5 variants (1 GiB are free)"),
        (failed, "Failed to allocate 8 bytes", f"device cuda:0 failed, see nvidia-smi: {text}"),
        (failed, "Warp copy error", f"device cuda:0 failed, see nvidia-smi: {text}"),
        (answers, "anything else", "anything else"),
    ):
        monkeypatch.setattr(gpu, "wp", warp)
        with pytest.raises(Exception, match=f"^{re.escape(line)}") as found, gpu.explain_gpu_failures("cuda:0", 5):
            raise RuntimeError(raised)
        assert isinstance(found.value, RuntimeError) == (raised == "anything else")
        assert isinstance(found.value, DeviceError) == (warp is failed)


GPUS = range(1, wp.get_cuda_device_count() + 1 if wp.is_cuda_available() else 1)


@pytest.mark.gpu
@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("name", ["marine", "car", "engine", "industrial"])
def test_no_cut_into_shares_changes_a_bit_on_a_gpu(monkeypatch, name, precision):
    """Designs in one share, and in several, whose blocks of threads have another form as they are few."""
    drives = load_script("benches.drives").varied_designs(example(name), name, 600)
    options = {"device": "cuda:0", "precision": precision, "duration": 0.002}
    whole = bits(run(drives, **options)[0].metrics)
    monkeypatch.setattr(pipeline, "FEWEST_PER_SUBENSEMBLE", 20)
    found = bits(run(drives, **options)[0].metrics)
    assert [column for column in whole if found[column] != whole[column]] == []


@pytest.mark.gpu
@pytest.mark.skipif(len(GPUS) < 2, reason="needs two GPUs")
@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("name", ["marine", "car", "engine", "industrial", "several chains"])
def test_two_gpus_give_the_bits_of_one(name, precision):
    """As many designs as fill both, settled."""
    count = 60 if name == "several chains" else 4400
    designs = load_script("benches.drives").varied_designs
    drives = SEVERAL * (count // 7) if name == "several chains" else designs(example(name), name, count)
    options = {"precision": precision, "duration": 0.002}
    one, two = (run(drives, device=device, **options)[0] for device in ("cuda:1", "cuda"))
    assert two.info.device.count("cuda:") == len(GPUS)
    found, whole = bits(two.metrics), bits(one.metrics)
    assert [column for column in whole if found[column] != whole[column]] == []


@pytest.mark.gpu
@pytest.mark.skipif(len(GPUS) < 2, reason="needs two GPUs")
def test_frames_and_archives_of_two_gpus_are_those_of_one(tmp_path):
    drives = mixed()
    one, _ = run(drives, device="cuda:0", record=Record("all"))
    two, _ = run(drives, device="cuda", record=Record("all"))
    run(drives, device="cuda", record=Record("all"), archive=tmp_path / "x.mcap")
    for of in (two, read_archive(tmp_path / "x.mcap")):
        for v in range(len(drives)):
            assert_same_frames(one[v], of[v])


@pytest.mark.gpu
@pytest.mark.skipif(len(GPUS) < 2, reason="needs two GPUs")
def test_a_real_gpu_takes_what_another_had_that_is_said_to_fail(monkeypatch):
    made, launches = gpu.GpuEngine.advance, []

    def advance(engine, steps, frames):
        launches.append(engine.device)
        if engine.device == "cuda:1" and launches.count("cuda:1") == 2:
            raise DeviceError("device cuda:1 failed, see nvidia-smi: as told")
        return made(engine, steps, frames)

    drives = [two_sprockets(torque=float(k)) for k in range(64)]
    options = {"duration": 0.02}
    whole, told = run(drives, device="cuda:0", **options)
    monkeypatch.setattr(gpu.GpuEngine, "advance", advance)
    monkeypatch.setattr(gpu, "LAUNCH_STEPS", 256)
    found, said = run(drives, device="cuda", **options)
    assert bits(found.metrics) == bits(whole.metrics)
    (line,) = [line for line in said if line not in told]
    assert line == (UserWarning, "device cuda:1 failed, see nvidia-smi: as told; another GPU took what it had")
