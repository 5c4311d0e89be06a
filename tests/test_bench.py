"""What the benchmarks run and read."""

import pytest
from loading import load_script

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
    drives = bench.different(load_drive(drive_path("marine")), 10_000)
    ends = [drives[0], drives[-1]]
    pack(ends, [Schedule(1e-6, 10, 0, 10, 0)] * 2)
    a, b = (drive.chain for drive in ends)
    assert a.elongation != b.elongation and a.roller_mass != b.roller_mass and a.damping != b.damping
    assert ends[0].sprockets[1].center != ends[1].sprockets[1].center
    assert ends[0].sprockets[2].load.torque != ends[1].sprockets[2].load.torque


class Asked(dict):
    """Figures of no case, which notes whose are asked for."""

    def __init__(self):
        self.keys_asked = set()

    def get(self, key, default=None):
        self.keys_asked.add(key)
        return default


def test_what_is_aimed_at_is_measured_also_where_less_is(bench, tmp_path):
    asked = Asked()
    assert all(value != value for _, value, _ in bench.aims(asked))  # nothing was found
    quick = {task.key for name in bench.NAMES for task in bench.tasks_of(name, True, tmp_path)}
    every = {task.key for name in bench.NAMES for task in bench.tasks_of(name, False, tmp_path)}
    assert asked.keys_asked <= quick < every


def test_what_was_measured_is_not_measured_again(bench, tmp_path):
    path = tmp_path / "figures.json"
    first, second = bench.tasks_of("kinds", True, tmp_path)
    store = bench.Store(path)
    store.put(first, ("a line", {"times": 1.25}))
    store.put(second, bench.failure(second, RuntimeError("no memory\nmore")))
    assert store.lines[second.key][0] == "kinds float32: failed: no memory"
    assert bench.Store(path).lines == {first.key: ("a line", {"times": 1.25})}  # what failed is measured again
