"""The guard of speed: what it measures, what it marks, and what it does about a commit that is none."""

import time
from contextlib import contextmanager
from itertools import count
from typing import ClassVar

import numpy as np
import pytest
import warp as wp
from loading import load_script

from warpchain.drive.examples import drive_path


@pytest.fixture
def guard():
    return load_script("benches.guard")


def asked(*words):
    return load_script("bench").parser().parse_args(["guard", *words])


def test_cases_below_the_limit_are_marked(guard):
    before = {"loop": 100.0, "metrics": 100.0, "assembly": 10.0}
    after = {"loop": 97.0, "metrics": 96.9, "assembly": 20.0}
    assert [row[-1] for row in guard.guard_table(before, after, 0.97)] == [
        "",
        "",
        "slower",
        "",
    ]  # the first row is the head


def test_the_status_says_whether_a_case_is_slower(guard, monkeypatch, tmp_path):
    @contextmanager
    def checkout(folder, name, commit):
        yield tmp_path / name

    found, speed = [], [0.0]

    def rates(tree, what):
        found.append(tree.name)
        return {"loop": 100.0 if tree.name == "a" else speed[0] * len(found)}

    monkeypatch.setattr(guard, "tree_checkout", checkout)
    monkeypatch.setattr(guard, "tree_rates", rates)
    words = asked("main", "HEAD", "--rounds", "2", "--drives", "two")
    for speed[0], slower in ((10.0, True), (20.0, False)):  # the best of B is its last, the eighth: 80 and 160
        found.clear()
        rows = []
        try:
            rows.extend(guard.guard.run(words))
            ended = 0
        except SystemExit as left:
            ended = left.code
        assert ended == int(slower)
        assert sorted(found[:4]) == ["a", "a", "b", "b"]  # to compile, side by side
        assert found[4:] == ["a", "b"] * 2  # then in turns


class Launched:
    """An engine that takes no time but for what its clock says, and notes what it is launched with."""

    asked: ClassVar[list] = []

    def __init__(self, packed, device, cores):
        drives = packed.drives
        self.what = (
            len(drives),
            drives["rollers"][0],
            drives["window_start"][0],
            drives["sample_interval"][0],
            packed.real,
        )

    def frame_buffer(self, steps):
        return steps

    def advance(self, steps, frames):
        self.asked.append((*self.what, steps))
        return []

    def progress(self):
        return {"diverged": np.zeros(1)}

    def close(self):
        pass


@pytest.mark.parametrize(("name", "links", "looks"), [("two", 118, 64), ("smooth", 162, 32), ("engine", 132, 32)])
def test_drives_of_any_name_are_measured_with_metrics_and_without(guard, monkeypatch, name, links, looks):
    probe = load_script("benches.probe")
    Launched.asked.clear()
    monkeypatch.setattr(probe, "engine_of_device", Launched)
    clock = count(0)
    monkeypatch.setattr(time, "perf_counter", lambda: 1e-3 * next(clock))
    found = probe.rates_by_case(
        {
            "drives": guard.guard_drives(guard.ROOT, [name]),
            "precisions": ["float32"],
            "variants": [1, 4224],
            "device": "cuda:0",
            "steps": 50,
            "after": 3000,
            "repeats": 1,
            "assemble": 0,
        }
    )
    cases = [(variants, window) for variants in (1, 4224) for window in (probe.FOREVER - 1, 3000)]
    each = [[(*case, steps) for steps in (3064, 50)] for case in cases]
    wanted = [(n, links, window, looks, wp.float32, steps) for rows in each for n, window, steps in rows]
    assert Launched.asked == wanted
    assert list(found.values()) == pytest.approx([variants * links * 50 / 1e6 / 1e-3 for variants, _ in cases])


def test_both_trees_run_the_drives_of_one(guard, tmp_path):
    found = guard.guard_drives(tmp_path, ["marine", "smooth"])
    assert found["marine"][0].startswith(str(tmp_path)) and found["smooth"][0] == found["marine"][0]
    assert guard.guard_drives(guard.ROOT, ["marine"])["marine"] == (str(drive_path("marine")), {})


def test_a_commit_that_is_none_is_named_in_one_line(guard, tmp_path):
    refused = pytest.raises(SystemExit, match=r"^no-such-commit: .*invalid reference: no-such-commit$")
    with refused, guard.tree_checkout(tmp_path, "a", "no-such-commit"):
        pass
    assert not (tmp_path / "a").exists()


def test_a_folder_is_taken_as_it_is(guard, tmp_path):
    with guard.tree_checkout(tmp_path, "a", str(guard.ROOT)) as tree:
        assert tree == guard.ROOT
    assert tree.exists()


@pytest.mark.parametrize(
    ("rates", "taken"),
    [([], 0.0), ([3.0], 3.0), ([2.0, 4.0], 4.0), ([5.0, 900.0, 4.0], 5.0), ([1.0, 3.0, 2.0, 4.0], 3.0)],
)
def test_a_clock_that_once_jumps_makes_no_best(guard, rates, taken):
    assert guard.second_best_rate(rates) == taken
