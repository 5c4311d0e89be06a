"""Runs in shares, packed one after the other while those before are stepped; CPU engines stand for GPUs."""

import os
import signal
import threading
import time
import warnings
from concurrent.futures import Future
from itertools import pairwise

import numpy as np
import pytest
from drives import assert_same_frames, example, two_sprockets
from raw import Frames

from warpchain import Record, read_archive, simulate
from warpchain.drive.batch import stacks_of
from warpchain.engine import devices, gpu, pipeline, share
from warpchain.engine.arrays import sums_bytes
from warpchain.engine.pack import pack
from warpchain.engine.share import Members
from warpchain.engine.simulation import schedules_of
from warpchain.errors import DriveError, LayoutWarning, SimulationError, SuspectWarning

NONE = Record("none")


@pytest.fixture
def gpus(monkeypatch):
    """A machine of two GPUs, each of which gets up to two shares of two variants or more."""
    monkeypatch.setattr(devices, "_gpus", lambda: {"cuda:0": 90, "cuda:1": 90})
    monkeypatch.setattr(devices, "quickest", lambda names, *_: devices.Choice(tuple(names), "as told"))
    monkeypatch.setattr(gpu, "GpuEngine", lambda packed, name: Frames(packed, 1))
    monkeypatch.setattr(gpu, "compile_lacking", lambda *_: None)
    monkeypatch.setattr(pipeline, "LEAST", 2)
    monkeypatch.setattr(pipeline, "WORTH", 1)
    monkeypatch.setattr(pipeline, "MOST", 2)


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
    made = share.pack

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
    monkeypatch.setattr(share, "pack", noting)
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


def test_what_is_recorded_goes_in_one_share_with_the_same_frames(gpus, monkeypatch, tmp_path):
    counts = []
    _, noting = shared(counts)
    drives = mixed()
    monkeypatch.setattr(share, "pack", noting)
    one, _ = run(drives, device="cpu", record=Record((1, 6)), workers=1)
    many, _ = run(drives, device="cuda", record=Record((1, 6)), workers=1)
    run(drives, device="cuda", archive=tmp_path / "x.mcap", record=Record((1, 6)), workers=1)
    run(drives, device="cuda", archive=tmp_path / "y.mcap", workers=1)
    assert counts == [9] * 4
    for of in (many, read_archive(tmp_path / "x.mcap")):
        for v in (1, 6):
            assert_same_frames(one[v], of[v])
        assert of.metrics.equals(one.metrics)


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
    made = share.pack

    def pack(drives, schedules, stacks, first):
        packing.append(first)
        found = made(drives, schedules, stacks, first)
        if len(packing) == 4:
            packed.set()
        return found

    class Waiting(Frames):
        def advance(self, steps, frames):
            assert packed.wait(30.0)
            return super().advance(steps, frames)

    monkeypatch.setattr(share, "pack", pack)
    monkeypatch.setattr(gpu, "GpuEngine", lambda part, name: Waiting(part, 1))
    found, _ = run([short(torque=float(k)) for k in range(8)], device="cuda")
    assert packing == [0, 2, 4, 6] and found.info.ended == "complete"


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

    def compile_lacking(parts, precision, settles, cores, report, stop):
        report("compiling", 1, 2)
        assert told.wait(30.0)
        report("compiling", 2, 2)

    def report(phase, done, total):
        seen.append((phase, done, total))
        if phase == "compiling":
            told.set()

    monkeypatch.setattr(gpu, "compile_lacking", compile_lacking)
    run([short()] * 8, device="cuda", progress=report)
    assert ("compiling", 1, 2) in seen and seen[-1][0] == "simulating"


def gone():
    """Whether all threads of shares have ended."""
    return not [thread for thread in threading.enumerate() if thread.name.startswith("warpchain")]


@pytest.mark.parametrize("bad", [0, 3, 7])
def test_a_chain_that_does_not_fit_is_named_and_stops_the_others(gpus, bad, tmp_path):
    drives = [short(duration=1000.0) for _ in range(8)]
    drives[bad] = short(links=50)
    begin = time.monotonic()
    for options in ({}, {"archive": tmp_path / "x.mcap", "record": Record([1], rate=10.0)}):
        with pytest.raises(DriveError, match=f"^variant {bad}: .*chain"):
            run(drives, device="cuda", **options)
        assert gone()
    assert time.monotonic() - begin < 60.0  # the others would take hours
    assert not list(tmp_path.iterdir())


def test_steps_beyond_their_limit_are_told_before_anything_is_packed(gpus, monkeypatch):
    monkeypatch.setattr(share, "pack", lambda *_: pytest.fail("packed"))
    drives = [short(), short(), short(), short(stiffness=1.5e8, contact=1.5e8)]
    with pytest.raises(DriveError, match=r"variant 3: run\.step = 7e-05"):
        run(drives, device="cuda", step=7e-5)


def test_what_fails_on_a_gpu_ends_the_run(gpus, monkeypatch):
    class Failing(Frames):
        def advance(self, steps, frames):
            if self.packed.drives["steps"][0] == 400:
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


def test_ctrl_c_keeps_all_variants_in_their_order(gpus):
    """Shares are a short variant and one that takes hours. When it is stopped, two shares have begun."""
    drives = [short(torque=float(k)) if k % 2 == 0 else short(duration=1000.0) for k in range(8)]
    whole, _ = run(drives[::2], device="cpu", workers=1)
    timer = threading.Timer(3.0, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    found, _ = run(drives, device="cuda")
    assert found.info.ended == "interrupted" and gone()
    assert found.metrics["variant"].to_pylist() == list(range(8))
    means = whole.metrics["tension_mean"].to_pylist()
    assert found.metrics["tension_mean"].to_pylist() == [means[0], None, means[1], *[None] * 5]


def test_a_stop_while_kernels_are_compiled_launches_none(gpus, monkeypatch):
    monkeypatch.setattr(gpu, "compile_lacking", lambda *rest: rest[-1].ask())
    for name in ("settle", "advance"):
        monkeypatch.setattr(Frames, name, lambda *_: pytest.fail("launched"))
    found, _ = run([two_sprockets(duration=0.002)] * 8, device="cuda")
    assert found.info.ended == "interrupted" and found.metrics["variant"].to_pylist() == list(range(8))


@pytest.mark.parametrize(("chosen", "packed"), [(("cpu",), [8]), (("cuda:0",), [4, 4])])
def test_where_not_all_gpus_are_chosen_variants_are_cut_anew(gpus, monkeypatch, chosen, packed):
    counts = []
    _, noting = shared(counts)
    monkeypatch.setattr(share, "pack", noting)
    asked = []

    def quickest(names, packed, precision, cores, times):
        asked.append((packed.variants, times))
        return devices.Choice(chosen, "small")

    monkeypatch.setattr(devices, "quickest", quickest)
    found, _ = run([short()] * 8, device=None)
    assert counts == [2, *packed] and asked == [(2, 4.0)]
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


def test_shares_are_cut_by_links_times_steps_where_they_are_worth_it(monkeypatch):
    """12,000 variants: of 4,096 at least, four a GPU at most; one a GPU from 1,024 on."""
    for name, value in (("LEAST", 4096), ("WORTH", 1024), ("MOST", 4)):
        monkeypatch.setattr(pipeline, name, value)
    drives = [short(), *[short(links=64, teeth=24)] * 3] * 3000
    schedules = schedules_of(drives, None, None, NONE, None)
    members = Members(drives, schedules, stacks_of(drives))
    assert (members.work == [drive.chain.links * 401.0 for drive in drives]).all()
    for count, number in ((0, 1), (1, 2), (2, 2), (4, 4), (11, 11), (12, 1)):
        parts = pipeline.parts_of(members, count)
        assert len(parts) == number
        assert [part.first for part in parts] == np.cumsum([0, *(len(part.drives) for part in parts)])[:-1].tolist()
        assert [drive for part in parts for drive in part.drives] == drives
        work = [part.work.sum() for part in parts]
        assert max(work) - min(work) <= 2 * members.work.max()
        for part in parts:
            assert sorted(v for stack in part.stacks for v in stack.members.tolist()) == list(range(len(part.drives)))
    few = members.part(0, 1000)
    assert len(pipeline.parts_of(few, 1)) == len(pipeline.parts_of(few, 2)) == 1
    long = Members([two_sprockets(links=20_000, span=9990.0)], schedules[:1], stacks_of([two_sprockets(links=20_000)]))
    assert pipeline._too_large(long)
    assert all(a.first < b.first for a, b in pairwise(pipeline.parts_of(members, 3)))


@pytest.mark.gpu
@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_shares_on_real_gpus_give_the_same_table_bitwise(monkeypatch, precision):
    """Fewer variants a GPU have another kernel, which rounds alike; windows are the same here."""
    drives = [two_sprockets(torque=float(k)) for k in range(600)]
    options = {"device": "cuda", "precision": precision, "duration": 0.005}
    whole, _ = run(drives, **options)
    monkeypatch.setattr(pipeline, "LEAST", 20)
    monkeypatch.setattr(pipeline, "WORTH", 1)
    several, _ = run(drives, **options)
    assert several.metrics.equals(whole.metrics, check_metadata=True)
