"""What the benchmarks run and read."""

import sys
import time
import types
from concurrent.futures import Future
from itertools import count
from typing import ClassVar

import benching
import numpy as np
import pytest
import warp as wp
from loading import SCRIPTS, load_script

from warpchain import load_drive
from warpchain.drive.examples import drive_path
from warpchain.engine.pack import pack
from warpchain.results.schedule import Schedule


@pytest.fixture
def bench():
    return load_script("bench_gpu")


def test_the_lines_of_another_program_are_read(bench):
    lines = [
        "FMA peak f64: 52.2 TFLOP/s",
        "CUDA f64 V=1 N=118 steps=4000  3.82 ms  0.956 us/step  0.123 Groller-steps/s  T[-1,5] nan=0 om1=-12.0",
        "CUDA f32 V=16896 N=118 steps=2000  39.01 ms  19.5 us/step  102.200 Groller-steps/s  T[0,1] nan=0 om1=-12.0",
    ]
    assert bench.limit_rates(lines) == {("float64", 1): 0.123, ("float32", 16896): 102.2}


def test_the_kinds_are_224_and_can_be_assembled(bench):
    drives = bench.kinds_of(bench.DRIVES["two equal 30-tooth sprockets"])
    assert len({(drive.chain.links, drive.sprockets[0].teeth) for drive in drives}) == len(drives) == 224
    chosen = [drives[0], drives[15], drives[-16], drives[-1]]
    packed = pack(chosen, [Schedule(1e-6, 10, 0, 10, 0)] * len(chosen))
    # all hang alike: the wrap is half of each sprocket, so that the slack of 0.4 mm is the same
    strains = [assembly.strain for assembly in packed.assemblies]
    assert max(strains) < 1e-3


def test_drives_that_differ_do_so_in_five_values_and_can_be_assembled(bench):
    marine = load_drive(drive_path("marine"))
    ends = [*bench.different(marine, 1), bench.other(marine, 9_999)]  # of those that are measured
    pack(ends, [Schedule(1e-6, 10, 0, 10, 0)] * 2)
    a, b = (drive.chain for drive in ends)
    assert a.elongation != b.elongation and a.roller_mass != b.roller_mass and a.damping != b.damping
    assert ends[0].sprockets[1].center != ends[1].sprockets[1].center
    assert ends[0].sprockets[2].load.torque != ends[1].sprockets[2].load.torque


class Launched:
    """An engine that takes no time but for what its clock says, and notes what it is launched with."""

    asked: ClassVar[list] = []

    def __init__(self, packed, device):
        drives = packed.drives
        self.what = len(drives), drives["rollers"][0], drives["window_start"][0], drives["look_every"][0], packed.real

    def frame_buffer(self, steps):
        return steps

    def advance(self, steps, frames):
        self.asked.append((*self.what, steps))
        return []

    def progress(self):
        return {"diverged": np.zeros(1)}

    def close(self):
        pass


@pytest.mark.parametrize(("name", "links"), [("two", 118), ("marine", 162), ("engine", 132)])
def test_trees_are_compared_by_drives_of_any_name(bench, monkeypatch, capsys, name, links):
    Launched.asked.clear()
    monkeypatch.setitem(sys.modules, "bench_gpu", bench)
    monkeypatch.setattr(bench, "GpuEngine", Launched)
    monkeypatch.setattr(sys, "argv", ["-c", str(SCRIPTS.parent), name, "float32", "50", "3000", "1", "4224"])
    monkeypatch.setattr(sys, "path", [*sys.path, str(SCRIPTS)])
    clock = count(0)
    monkeypatch.setattr(time, "perf_counter", lambda: 1e-3 * next(clock))
    exec(load_script("bench_trees").ROWS, {})
    cases = [(variants, window) for variants in (1, 4224) for window in (load_script("bench_cpu").FOREVER - 1, 3000)]
    each = [[(*case, steps) for steps in (3064, 50)] for case in cases]
    expected = [(n, links, window, 64, wp.float32, steps) for rows in each for n, window, steps in rows]
    assert Launched.asked == expected
    rates = [float(line) for line in capsys.readouterr().out.splitlines()]
    assert rates == pytest.approx([variants * links * 50 / 1e9 / 1e-3 for variants, _ in cases])


class Asked(dict):
    """Figures of no case, which notes whose are asked for."""

    def __init__(self):
        self.keys_asked = set()

    def get(self, key, default=None):
        self.keys_asked.add(key)
        return default


def test_what_is_aimed_at_is_measured_also_where_less_is(bench, tmp_path):
    asked = Asked()
    found = list(bench.aims(asked))
    assert all(aim.value != aim.value for aim in found)  # nothing was found
    assert {aim.item for aim in found} == set(range(1, 10))
    assert {case for aim in found for case in aim.cases} == asked.keys_asked
    quick = {task.key for name in bench.NAMES for task in bench.tasks_of(name, True, tmp_path)}
    every = {task.key for name in bench.NAMES for task in bench.tasks_of(name, False, tmp_path)}
    assert asked.keys_asked <= quick < every


@pytest.mark.parametrize(("quick", "rounds"), [(True, 1), (False, 2)])
def test_whole_runs_are_measured_with_metrics_of_the_second_half_and_without(
    bench, tmp_path, monkeypatch, quick, rounds
):
    """Seconds 8, 10, then 9, 8.5 in turns: the best without metrics is 8, with them 10 or 8.5."""
    asked, seconds = [], iter([8.0, 10.0, 9.0, 8.5])

    def timed(drives, count, **options):
        asked.append((len(drives), count, options.get("window"), options["duration"], options["precision"]))
        return next(seconds)

    monkeypatch.setattr(bench, "timed", timed)
    task = bench.Task("runs", ("marine drive", "float32"), tmp_path, quick=quick)
    line, figures = bench.runs(task, *task.case)
    last = (2.0 - 1e-5, 2.0)  # its last step
    assert asked == [(16896, 1, last, 2.0, "float32"), (16896, 1, None, 2.0, "float32")] * rounds
    assert figures["of bare"] == 8.0 / (10.0 if quick else 8.5)
    assert f"{16896 * 162 * 2.0 / 1e-5 / 8.0 / 1e9:.2f}" in line


def test_float64_at_looks_does_not_count_as_that_of_a_step(bench, tmp_path, monkeypatch):
    monkeypatch.setattr(bench, "counts", lambda kind: (166, [136, 30]) if kind.measuring else (0, []))
    line, figures = bench.float64(bench.Task("float64", (), tmp_path))
    assert figures["loop"] == 0.0 and figures["metrics"] == 166.0 and "metrics 166" in line


def test_what_was_measured_is_not_measured_again(bench, tmp_path):
    path = tmp_path / "figures.json"
    first, second = bench.tasks_of("kinds", True, tmp_path)
    store = bench.Store(path)
    store.put(first, ("a line", {"times": 1.25}))
    store.put(second, ("kinds float32: failed: no memory", {}))
    assert bench.Store(path).lines == {first.key: ("a line", {"times": 1.25})}
    assert bench.Session([first, second], bench.Store(path), 1.0).left == [second]  # what failed is measured again


def test_cases_that_fail_die_or_hang_do_not_keep_others_from_being_measured(bench, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(SCRIPTS))  # as in the script, where the workers' processes look for their modules
    tasks = [bench.Task("some", (name,), tmp_path) for name in ("fails", "dies", "fine", "hangs", "late")]
    kept = {}
    begin = time.monotonic()
    coming = bench.results(
        tasks[:3], ["5"], benching.measured, begin + 60.0, lambda task, found: kept.update({task.key: found})
    )
    found = [future.result() for future in coming]
    assert found == [
        ("some fails: failed: no memory", {}),
        ("some dies: failed: its process died", {}),
        ("saw 5", {"value": 1.5}),
    ]
    assert list(kept.values()) == found
    until = time.monotonic() + 2.0
    late = [future.result() for future in bench.results(tasks[3:], ["5"], benching.measured, until)]
    assert [line for line, _ in late] == ["some hangs: failed: cut off", "some late: failed: no time was left for it"]
    assert time.monotonic() < until + 5.0  # what hangs for ten minutes is ended


def test_calls_are_noted_with_their_times_and_functions_put_back():
    owner = types.SimpleNamespace(wait=lambda seconds, more=0.0: time.sleep(seconds + more) or "waited", left=len)
    wait = owner.wait
    with load_script("bench_shares").noted([(owner, "wait", "waiting"), (owner, "left", "leaving")]) as found:
        assert owner.wait(0.02, more=0.01) == "waited" and owner.left("abc") == 3
    assert [part.word for part in found] == ["waiting", "leaving"]
    assert found[0].end - found[0].begin >= 0.03 > found[0].cpu >= 0.0 and found[1].begin >= found[0].end
    assert owner.wait is wait and owner.left is len


def session(bench, tmp_path, monkeypatch, lines):
    """A session over two kinds of case whose workers find these lines."""

    def results(tasks, workers, measure, until, keep=lambda task, found: None):
        futures = []
        for task in tasks:
            keep(task, lines[task.key])
            futures.append(Future())
            futures[-1].set_result(lines[task.key])
        return futures

    monkeypatch.setattr(bench, "results", results)
    monkeypatch.setattr(bench, "visible", lambda: ["0", "1"])
    names = ("kinds", "cpu")
    tasks = [task for name in names for task in bench.tasks_of(name, True, tmp_path)]
    made = bench.Session(tasks, bench.Store(tmp_path / "figures.json"), 100.0)
    made.measure()
    made.print_parts()
    made.print_aims()
    return made


def test_the_closing_table_says_what_was_not_found_and_why(bench, tmp_path, monkeypatch, capsys):
    cpu = dict.fromkeys((f"cpu {title}" for title in bench.DRIVES), (bench.NO_COMPILER, {}))
    lines = {"kinds float64": ("a line", {"times": 1.25}), "kinds float32": ("kinds float32: failed: no memory", {})}
    made = session(bench, tmp_path, monkeypatch, lines | cpu)
    said = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert "[ 0 s] kinds float64: done" in said
    assert "2 8,000 of 224 kinds beside one kind, float64 1.25 at most 1.5" in said
    assert "2 8,000 of 224 kinds beside one kind, float32 - at most 1.5; kinds float32: failed: no memory" in said
    assert any(line.startswith("8 ") and line.endswith("; not measured here: no CPU compiler") for line in said)
    assert not any(line.startswith("9 ") for line in said)  # was not asked for
    assert made.failed == 1  # what a machine cannot do has not failed
