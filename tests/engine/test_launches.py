"""How a GPU's launches are cut: every variant once, every step once, in order, and the GPU full to the end."""

from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp
from blocks import on_fibers
from drives import two_sprockets
from loading import load_script

from warpchain.engine import gpu, gpu_kernels
from warpchain.engine.launches import STEP_UNIT, launch_groups, next_launch_steps, steps_left
from warpchain.engine.pack import pack
from warpchain.engine.subensemble import _next_launch_steps
from warpchain.results.channels import drive_frame_width
from warpchain.results.schedule import Schedule


@pytest.mark.parametrize("count", [1, 1584, 1585, 16_896, 10_001])
def test_every_variant_is_in_one_group(count):
    parts = launch_groups(np.arange(count), 1584)
    assert sorted(v for part in parts for v in part.tolist()) == list(range(count))
    assert len(parts) == (1 if count <= 1584 else 2)
    assert max(map(len, parts)) - min(map(len, parts)) <= 1


@pytest.fixture
def counted():
    """The host's count of launches."""
    return load_script("benches.launches")


def spread(counted, count, steps, seed=0):
    """Variants whose steps differ twofold, in any order, measured over the latter half."""
    return counted.counted_runs((steps * np.random.default_rng(seed).uniform(0.67, 1.33, count)).astype(int))


def test_every_variant_takes_every_step_once_and_in_order_by_the_kernel_of_its_own_window(counted):
    drives = spread(counted, 100, 3000)
    at = np.zeros(len(drives), int)
    for lanes in counted.launch_calls(drives, 32 * 9, 60):
        assert len(lanes) == 2
        for launch in (launch for lane in lanes for launch in lane):
            assert len(set(launch.variants)) == len(launch.variants)
            mine, begin = drives[launch.variants], at[launch.variants]
            first = mine["window_start"] // STEP_UNIT * STEP_UNIT
            assert (launch.end_steps > begin).all()
            # results do not depend on where launches end where that is at whole units
            assert ((launch.end_steps % STEP_UNIT == 0) | (launch.end_steps == mine["steps"] + 1)).all()
            assert (launch.end_steps <= first).all() if launch.kernel == "advance" else (begin >= first).all()
            at[launch.variants] = launch.end_steps
    np.testing.assert_array_equal(at, drives["steps"] + 1)


def test_all_variants_end_in_the_same_call_and_none_takes_more_than_it_may(counted):
    drives = spread(counted, 1000, 3000)
    progress = np.zeros(len(drives), counted.PROGRESS)
    progress["step"][0], progress["diverged"][1] = drives["steps"][0] + 1, 1
    assert steps_left(drives, progress)[:2].tolist() == [0, 0]
    for calls_left in reversed(range(-(-drives["steps"].max() // 512))):
        share = next_launch_steps(steps_left(drives, progress), 512)
        assert share.max() <= 512
        progress["step"] += share
        assert (steps_left(drives, progress)[2:] == 0).all() == (calls_left == 0)


@pytest.mark.parametrize(("left", "most", "wanted"), [([7, 3], 2, [2, 1]), ([32], 4096, [32]), ([], 32, [])])
def test_short_launches_stay_whole(left, most, wanted):
    assert next_launch_steps(np.array(left, int), most).tolist() == wanted


@pytest.mark.parametrize("count", [10_000, 5000])
def test_a_gpu_is_full_until_all_variants_end(counted, count):
    """Steps that differ twofold, in any order, take at most 1.05 times as long as if they were spread evenly.

    Longest first, two groups of eight launches each; 1.15 where each launch took as many steps of all.
    """
    assert 1.0 <= counted.occupied_share(spread(counted, count, 30_000), 6144, 1584) <= 1.05


class WithoutStreams:
    """Warp for an engine whose blocks are fibers of the CPU: launches come one after another, without streams.

    A graph is the list of its launches.
    """

    graph = None

    def __getattr__(self, name):
        return getattr(wp, name)

    class Stream:
        def __init__(self, device):
            pass

        def record_event(self):
            return None

        def wait_event(self, event):
            pass

    def ScopedStream(self, stream, sync_enter=True):
        return nullcontext()

    synchronize_stream = synchronize_event = lambda self, of: None

    def get_device(self, name):
        return SimpleNamespace(sm_count=2, max_shared_memory_per_block=232_448, free_memory=2**33, is_cuda=False)

    def empty(self, size, dtype, device, pinned=False):
        return wp.zeros(size, dtype=dtype, device=device)

    def array(self, *values, pinned=False, **options):
        return wp.array(*values, **options)

    def launch(self, kernel, dim, inputs, device, block_dim=256, stream=None, record_cmd=False):
        def launch():
            wp.launch(on_fibers(kernel), dim, inputs=inputs, block_dim=block_dim, device=device)

        launch() if self.graph is None else self.graph.append(launch)

    def capture_begin(self, stream, force_module_load):
        self.graph = []

    def capture_end(self, stream):
        graph, self.graph = self.graph, None
        return graph

    def capture_launch(self, graph, stream):
        for launch in graph:
            launch()


ENDS, EVERY = (300, 231, 160, 288), (32, 0, 20, 0)


def test_how_steps_are_shared_out_changes_no_bit(fibers, monkeypatch):
    """Variants of unlike steps and windows, two of them with frames, in calls of 64 steps and in one call of all."""
    monkeypatch.setattr(gpu, "wp", WithoutStreams())
    monkeypatch.setattr(gpu_kernels, "wp", WithoutStreams())
    monkeypatch.setattr(gpu_kernels, "resident_variants", lambda kind: 1)  # so that four variants go in two groups
    drives = [two_sprockets(torque=torque) for torque in (100.0, 120.0, 140.0, 160.0)]
    schedules = [Schedule(1e-5, end, end // 2, end - 10, every) for end, every in zip(ENDS, EVERY, strict=True)]

    def run(most):
        packed = pack(drives, schedules)
        width = drive_frame_width(drives[0])
        packed.drives["first_value"] = [0, 0, width * (most // 32 + 1), 0]
        engine, frames = gpu.GpuEngine(packed, "cpu"), {0: [], 2: []}
        buffer = engine.frame_buffer(width * (most // 32 + most // 20 + 2))
        before = engine.progress().copy()
        while steps_left(packed.drives, before).any():
            for future in engine.advance(_next_launch_steps(engine, most, before, None), buffer):
                future.result()
            after = engine.progress().copy()
            for v, taken in frames.items():
                first, count = (packed.drives["first_value"][v], -(-after["step"][v] // EVERY[v]))
                count -= -(-before["step"][v] // EVERY[v])
                taken.append(buffer.device.numpy()[first : first + count * width].copy())
            before = after
        engine.close()
        joined = {f"frames {v}": np.concatenate(taken) for v, taken in frames.items()}
        return {"rollers": engine.rollers()} | joined | engine.sums()

    shared, once = run(64), run(320)
    assert once["frames 0"].size == 10 * drive_frame_width(drives[0]) and once["frames 0"].any()
    for name in ("rollers", "frames 0", "frames 2", "chain", "strand", "sprocket", "contact"):
        np.testing.assert_array_equal(shared[name], once[name], err_msg=name)


def test_a_piece_that_is_repeated_has_the_bits_of_one_that_is_not(fibers, monkeypatch):
    """Pieces as graphs and without: states, sums, frames, inputs on the device; one has diverged before the last."""
    monkeypatch.setattr(gpu, "wp", WithoutStreams())
    monkeypatch.setattr(gpu_kernels, "wp", WithoutStreams())
    monkeypatch.setattr(gpu_kernels, "resident_variants", lambda kind: 1)  # so that four variants go in two groups
    drives = [two_sprockets(torque=torque) for torque in (100.0, 120.0, 140.0, 160.0)]
    width = drive_frame_width(drives[0])

    def run(repeated):
        if not repeated:
            monkeypatch.setattr(gpu.GpuEngine, "_repeated_kernel", lambda engine, steps: None)
        packed = pack(drives, [Schedule(1e-5, 300, 96, 290, 20)] * 4)
        packed.drives["first_value"] = width * np.arange(4)
        packed.tables = np.append(packed.tables, [1.0, 2.0])
        engine = gpu.GpuEngine(packed, "cpu")
        tables, intervals = engine.stage_inputs(len(packed.tables) - 2)
        buffer, found = engine.frame_buffer(4 * width, np.arange(4 * width)), []
        for piece, steps in enumerate([1, *[20] * 4, 13, 7, *[20] * 3]):
            if piece == 9:
                gone = engine.fetch_array("state", "progress")
                gone["diverged"][2] = 1
                engine.set_array("state", "progress", gone)
            tables[-1], intervals[:] = piece, max(int(engine.progress()["step"][0]) + steps - 1, 1)
            engine.take_steps(steps, buffer)
            assert engine.ensemble.tables.numpy()[-2:].tolist() == [1.0, piece]
            assert (engine.ensemble.drives.numpy()["frame_interval"] == intervals).all()
            found += [buffer.numpy().copy(), engine.progress(), engine.diverged_view().copy()]
        engine.close()
        return found, engine.rollers(), engine.sums(), len(engine._graphs)

    (frames, rollers, sums, graphs), (others, same, again, none) = run(True), run(False)
    assert (graphs, none) == (4, 0)  # the first step, 20 and 13 before the window, 20 in it
    assert frames[-2]["step"].tolist() == [161, 161, 141, 161]
    for mine, theirs in zip([*frames, rollers, *sums.values()], [*others, same, *again.values()], strict=True):
        np.testing.assert_array_equal(mine, theirs)
