"""Devices by name, and the forms of blocks of threads on GPUs."""

import subprocess
import sys
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
import warp as wp
from drives import assert_same_frames, example, timing, two_sprockets

from warpchain import Record, simulate
from warpchain.assembly.timestep import resolve_step
from warpchain.engine.devices import devices_by_name
from warpchain.engine.gpu import GpuEngine, gpu_launch_steps, gpu_refusal
from warpchain.engine.gpu_kernels import (
    FEW_VARIANTS,
    FULL_AT_FLOAT32,
    FULL_OF_OIL,
    FULL_WITH_METRICS,
    ROLLER_CAPACITIES,
    VARIANTS_PER_BLOCK,
    Bucket,
    _distinct_rows,
    block_shape,
    global_memory_values,
    kernel_kind,
    resident_variants,
    roller_capacity,
)
from warpchain.engine.pack import pack
from warpchain.errors import SimulationError
from warpchain.kernels.gpu.block_kinds import DECLARED, EVEN, BlockKind, BlockShape, Friction, Parts
from warpchain.kernels.gpu.shared_memory import LONGEST_IN_ORDER, block_memory
from warpchain.results.schedule import Schedule


def mixed():
    """Three drives, unlike in links, sprockets and guide-bars."""
    marine = example("marine")
    return [two_sprockets(), marine, two_sprockets(teeth=24, links=64), marine, two_sprockets()]


def test_launches_take_whole_units_of_steps_and_about_equal_time():
    assert gpu_launch_steps(162.0, 10**9) == 131_072  # one marine drive: bounded by steps
    assert gpu_launch_steps(1.62e6, 10**9) == 6144  # ten thousand: by work, 1e10 / 1.62e6 = 6172, down to units of 32
    assert gpu_launch_steps(162.0, 50) == 32
    assert gpu_launch_steps(162.0, 7) == 7  # a frame buffer this small


def kinds_of(real=wp.float64, *, links=128, each=100, most_shared=DECLARED, guides=0, **more):
    """The kinds of the kernels of drives with two sprockets: without metrics, with, and settling."""
    kind = BlockKind(real, block_shape(links, each, most_shared), Parts(2, guides), links="alike", **more)
    return [
        kernel_kind(name, Bucket(kind, np.arange(7), None, most_shared)) for name in ("advance", "measure", "relax")
    ]


def test_oil_has_a_warp_where_a_multiprocessor_gets_more_variants_than_it_holds_by_themselves():
    def abreast(real, each, tensioners=1, oil=1, most_shared=232_448):
        parts = Parts(3, 2, arms=1, tensioners=tensioners, hydraulic=oil)
        kind = BlockKind(real, block_shape(128, each, most_shared), parts, profiles=True)
        bucket = Bucket(kind, np.arange(7), None, most_shared, each)
        kinds = [kernel_kind(name, bucket) for name in ("advance", "measure", "relax")]
        return [kind.shape.variants_per_block if kind.has_oil_warp else 0 for kind in kinds]

    full, at_float32 = FULL_OF_OIL, FULL_AT_FLOAT32
    assert abreast(wp.float64, 8) == abreast(wp.float32, 8) == [0, 0, 0]  # each has more registers so
    assert abreast(wp.float64, 9) == [full, FULL_WITH_METRICS, 0]
    assert abreast(wp.float32, 9) == [0, full, 0]
    assert abreast(wp.float32, 13) == [at_float32, full, 0]
    assert abreast(wp.float64, 100, oil=0) == [0, 0, 0]  # springs
    assert abreast(wp.float64, 100, tensioners=3) == [0, FULL_WITH_METRICS, 0]  # of 11 more than a warp's threads
    assert abreast(wp.float64, 100, tensioners=5) == [0, 0, 0]  # and of 7
    assert abreast(wp.float64, 100, most_shared=101_376) == [0, FULL_WITH_METRICS, 0]  # of a workstation's GPU


def test_registers_of_a_block_fit_a_multiprocessor():
    for real, links, each in product(
        (wp.float64, wp.float32), (*ROLLER_CAPACITIES, 2048, 4096, 16_384), (1, 4, 8, 100)
    ):
        for kind in kinds_of(real, links=links, each=each, linear_hysteretic=True, most_shared=232_448):
            assert 65536 // (kind.shape.threads * resident_variants(kind)) >= 64, kind


def test_a_drive_has_two_kernels_however_many_there_are():
    for links in (128, 192, 512):
        few, many = ({repr(kinds_of(links=links, each=each)) for each in of} for of in ((1,), (2, 3, 8, 100)))
        assert len(few) == len(many) == 1
        (settling,) = {repr(kinds_of(links=links, each=each)[2]) for each in (1, 3, 100)}  # and settles by one
        assert settling


def test_variants_share_a_block_where_a_multiprocessor_has_memory_for_enough_of_them():
    def shared(real, links, most_shared, **more):
        kinds = kinds_of(real, links=links, most_shared=most_shared, **{"linear_hysteretic": True} | more)
        return [kind.shape.variants_per_block for kind in kinds]

    # of an H200, and of a workstation's GPU, on which seven fit one by one and four together
    large, small, several = 232_448, 101_376, VARIANTS_PER_BLOCK
    assert shared(wp.float32, 128, large) == [1, several, 1]
    assert shared(wp.float32, 192, large) == [several, several, 1]
    assert shared(wp.float32, 128, large, friction=Friction(EVEN, EVEN)) == [1, several, 1]
    one_by_one = [
        shared(wp.float32, 192, small),
        shared(wp.float64, 128, large),
        shared(wp.float64, 192, large),
        shared(wp.float32, 128, large, moving=True),
        shared(wp.float32, 256, large),
    ]
    assert one_by_one == [[1, 1, 1]] * len(one_by_one)


def test_short_kernels_that_share_blocks_are_more_on_a_multiprocessor():
    kind = kinds_of(wp.float32, linear_hysteretic=True, most_shared=232_448)[1]
    rubs, longer = (
        replace(kind, friction=Friction(EVEN)),
        replace(kind, shape=replace(kind.shape, rollers_per_thread=6)),
    )
    assert [resident_variants(one) for one in (kind, rubs, longer)] == [20, 16, 16]


def test_blocks_have_room_for_the_chain_and_little_more():
    links = np.array([3, 32, 33, 118, 162, 257, 1000, 1024, 1025, 2049, 4000, 4097, 16_384])
    most = roller_capacity(links)
    assert (most >= links).all()
    assert most.tolist() == [32, 32, 64, 128, 192, 320, 1024, 1024, 1280, 2560, 4096, 5120, 16_384]
    for each in (1, FEW_VARIANTS + 1):
        shapes = [block_shape(int(r), each) for r in most]
        assert [shape.room for shape in shapes] == most.tolist()
        # moments are added up in the order of rollers on one warp, and up to 512 rollers on several
        assert all(shape.threads == 32 or shape.room <= LONGEST_IN_ORDER or shape.room > 512 for shape in shapes)
        assert all(shape.body_warp == (each == 1 and shape.room <= 512) for shape in shapes)
    # longer chains have one shape however many they are: their order is that of threads
    assert all(block_shape(int(r), 1) == block_shape(int(r), FEW_VARIANTS + 1) for r in most if r > 512)
    assert [block_shape(room, FEW_VARIANTS + 1) for room in (512, 640)] == [BlockShape(32, 16), BlockShape(128, 5)]


@pytest.mark.parametrize("moves", [False, True])
@pytest.mark.parametrize("most", [DECLARED, 232_448], ids=["old", "new"])  # bytes of shared memory a block may have
@pytest.mark.parametrize("room_", [128, 640, 768, 1024, 4096])
def test_every_kernel_finds_its_rows(room_, most, moves):
    # what does not fit into shared memory must be there in global memory, for whichever kernel of a bucket runs
    kind = BlockKind(wp.float64, block_shape(room_, 1, most), Parts(3, 1), moving=moves)
    bucket = Bucket(kind, np.arange(7), None)
    other = Bucket(BlockKind(wp.float64, block_shape(32, FEW_VARIANTS + 1, most), Parts(2, 0)), np.arange(5), None)
    there = global_memory_values([other, bucket])
    for name, moving, measuring in (("advance", moves, False), ("measure", moves, True), ("relax", False, False)):
        found = kernel_kind(name, bucket)
        assert found.shape.room >= room_
        assert (found.moving, found.measuring) == (moving, measuring)
        of = block_memory(found)
        assert there[0] >= 7 * of.values and there[1] >= 7 * of.part_values
    # a roller has 6 values, 48 bytes: 1,024 need 49,152 of 47,000 bytes, 4,096 need 196,608 of 232,448
    assert (there[0] >= 7 * 6 * room_) == (room_ >= 1024 and most == DECLARED)


def test_kinds_of_variants_are_found_the_largest_first():
    keys = np.array([[32, 0, 1], [64, 0, 0], [32, 0, 1], [64, 0, 1]])
    assert _distinct_rows(keys) == [(64, 0, 1), (64, 0, 0), (32, 0, 1)]
    assert _distinct_rows(keys[[0, 2]]) == [(32, 0, 1)]


def test_no_gpu_is_told_in_one_line(monkeypatch):
    monkeypatch.setattr("warpchain.engine.devices._gpu_architectures", dict)
    packed = pack([two_sprockets()], [Schedule(1e-5, 100, 0, 100, 0)])
    assert devices_by_name(None, packed) == ("cpu",)
    assert devices_by_name("cpu", packed) == ("cpu",)
    with pytest.raises(SimulationError, match=r"device = 'cuda': no NVIDIA GPU .*use device=\"cpu\""):
        devices_by_name("cuda", packed)
    with pytest.raises(SimulationError, match=r"device = 'gpu': allowed are \"cpu\", \"cuda\""):
        devices_by_name("gpu", packed)


def test_gpus_are_chosen_by_name_and_age(monkeypatch):
    monkeypatch.setattr(
        "warpchain.engine.devices._gpu_architectures", lambda: {"cuda:0": 90, "cuda:1": 61, "cuda:2": 75}
    )
    packed = pack([two_sprockets()], [Schedule(1e-5, 100, 0, 100, 0)])
    assert devices_by_name(None, packed) == ("cuda:0", "cuda:2")
    assert devices_by_name("cuda:2", packed) == ("cuda:2",)
    with pytest.raises(SimulationError, match=r"device cuda:1: compute capability 6.1 is too old"):
        devices_by_name("cuda", packed)
    with pytest.raises(SimulationError, match=r"there is no such GPU; there are cuda:0, cuda:1, cuda:2"):
        devices_by_name("cuda:7", packed)


def test_what_a_gpu_cannot_run_goes_to_the_cpu_or_is_told(monkeypatch):
    monkeypatch.setattr("warpchain.engine.devices._gpu_architectures", lambda: {"cuda:0": 90})
    drives = [two_sprockets(), two_sprockets().with_values({"run.integrator": "rk4"})]
    packed = pack(drives, [Schedule(1e-5, 100, 0, 100, 0)] * 2)
    assert gpu_refusal(packed) is None
    packed.drives["rollers"][1] = 20_000
    assert devices_by_name(None, packed) == ("cpu",)
    with pytest.raises(SimulationError, match=r"variant 1: chain.links = 20000: a GPU takes up to 16384"):
        devices_by_name("cuda", packed)


@pytest.mark.gpu
@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_gpu_runs_are_bitwise_repeatable_and_variants_independent(precision):
    drives = mixed()
    options = {"device": "cuda", "duration": 0.02, "precision": precision, "record": Record(rate=2000.0)}
    crowd, again = simulate(drives, **options), simulate(drives, **options)
    assert crowd.metrics.equals(again.metrics)
    for v in (1, 2):
        (alone,) = simulate(drives[v], **options).values()
        assert_same_frames(alone, crowd[v])
        assert_same_frames(alone, again[v])


@pytest.mark.gpu
def test_gpu_gives_what_the_cpu_gives():
    if not wp.is_cpu_available():
        pytest.skip("needs Warp's compiler for the CPU")
    drives = mixed()
    options = {"duration": 0.005, "record": Record(rate=2000.0)}
    cpu, gpu = simulate(drives, device="cpu", **options), simulate(drives, device="cuda", **options)
    for v in range(len(drives)):
        # settling ends within its tolerance of equilibrium, not at one point: forces agree to that tolerance
        np.testing.assert_allclose(gpu[v].position, cpu[v].position, atol=2e-6)
        np.testing.assert_allclose(gpu[v].tension.mean(), cpu[v].tension.mean(), rtol=1e-2)


@pytest.mark.gpu
def test_oil_is_the_same_whichever_warp_has_it():
    drive, processors, ends = timing(), wp.get_device("cuda:0").sm_count, []
    for count in (2 * processors, FULL_OF_OIL * processors + 1):
        packed = pack([drive] * count, [Schedule(drive.run.step, 2000, 500, 2000, 0)] * count)
        engine = GpuEngine(packed, "cuda:0")
        for future in engine.advance(2001, engine.frame_buffer(0)):
            future.result()
        sums, oil = engine.sums(), engine.fetch_array("state", "tensioners")
        assert kernel_kind("measure", engine.buckets[0]).has_oil_warp == (count > FULL_OF_OIL * processors)
        ends.append((engine.rollers()[-6 * drive.chain.links :], oil[-1], sums["chain"][-1], sums["tensioner"][-1]))
        engine.close()
    for by_itself, by_another in zip(*ends, strict=True):
        np.testing.assert_array_equal(by_another, by_itself)


@pytest.mark.gpu
@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_a_conveyor_of_4000_links_runs_on_a_gpu(precision):
    drive = two_sprockets(links=4000, span=1990.0, duration=2e-3, settle="false")
    runs = [simulate([drive] * count, device="cuda:0", precision=precision) for count in (1, 2)]
    row = runs[0].metrics.to_pylist()[0]
    assert not row["diverged"]
    assert abs(row["energy_residual_relative"]) < 1e-2  # the balance that shorter chains are held to as well
    assert runs[1].metrics.to_pylist()[1]["tension_mean"] == row["tension_mean"]  # bitwise, beside another


@pytest.mark.gpu
@pytest.mark.parametrize("teeth", [30, 150])  # with 150, several rollers of a thread are on the sprocket at once
@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_a_variant_alone_takes_the_steps_it_takes_in_a_large_crowd(precision, teeth):
    drive = two_sprockets() if teeth == 30 else two_sprockets(teeth=150, links=250, span=50.0)
    processors = wp.get_device("cuda:0").sm_count
    ends = []
    for count in (1, (FEW_VARIANTS + 1) * processors, 16 * processors):
        packed = pack([drive] * count, [Schedule(drive.run.step, 2000, 500, 2000, 0)] * count).at_precision(precision)
        engine = GpuEngine(packed, "cuda:0")
        frames = engine.frame_buffer(0)
        for future in engine.advance(2001, frames):
            future.result()
        kind = kernel_kind("measure", engine.buckets[0])
        ends.append((engine.rollers()[-6 * drive.chain.links :], engine.sums()["chain"][-1], kind))
        engine.close()
    assert len({kind for _, _, kind in ends}) == 2  # a roller a thread, and a variant a warp
    assert ends[-1][2].shape.variants_per_block == (VARIANTS_PER_BLOCK if teeth == 30 and precision == "float32" else 1)
    for rollers, chain, _ in ends[1:]:
        np.testing.assert_array_equal(rollers, ends[0][0])
        assert chain == ends[0][1]


@pytest.mark.gpu
@pytest.mark.parametrize(
    ("name", "precision"),
    [("two sprockets", "float64"), ("two sprockets", "float32"), ("marine without friction", "float32")],
)
def test_metrics_leave_a_large_crowds_rollers_their_bits(name, precision):
    smooth = {"chain.joint": None, "contact.sprocket.friction": 0.0}
    smooth |= {"contact.guide.friction": 0.0, "contact.guide.rolling": False}
    drive = two_sprockets() if name == "two sprockets" else example("marine").with_values(smooth)
    count = 20 * wp.get_device("cuda:0").sm_count
    ends = []
    for start in (0, 400):  # metrics of all steps, or of the last one alone
        packed = pack([drive], [Schedule(resolve_step(drive), 400, start, 400, 0)]).at_precision(precision)
        engine = GpuEngine(packed.pick_variants([0] * count), "cuda:0")
        for future in engine.advance(401, engine.frame_buffer(0)):
            future.result()
        ends.append(engine.rollers())
        engine.close()
    np.testing.assert_array_equal(*ends)


def said(code):
    """What a script of its own prints and says."""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stdout, done.stderr


SCRIPT = """
import sys
sys.path.insert(0, "tests")
from drives import STARTING, two_sprockets
from raw import Frames
from warpchain import simulate
print(simulate(two_sprockets(duration=0.0005, settle="false"), limits=STARTING).metrics["status"].to_pylist())
print([name for name in ("pandas", "scipy", "warpchain.kernels.gpu", "matplotlib", "rerun") if name in sys.modules])
"""


@pytest.fixture(scope="module")
def script():
    """What the script prints, line by line, and says."""
    out, err = said(SCRIPT)
    return out.splitlines(), err


def test_a_script_prints_what_it_prints_and_nothing_of_warp(script):
    (status, _), err = script
    assert (status, err) == ("['ok']", "")


@pytest.mark.long
def test_warps_messages_come_where_they_are_asked_for():
    out, err = said("import warp\nwarp.config.log_level = warp.LOG_DEBUG\n" + SCRIPT)
    assert "Warp" in out + err
    out, err = said("import warp\nwarp.init()\n" + SCRIPT)
    assert "Warp" in out + err and "load on device" in out + err


@pytest.mark.skipif(wp.is_cuda_available(), reason="with a GPU its engine is asked whether it could run the drive")
def test_a_run_loads_nothing_that_it_does_not_need(script):
    pytest.importorskip("pandas")  # which pyarrow loads wherever it is installed, unless it is given buffers
    assert script[0][1] == "[]"
