"""The block kernel: against the CPU kernel on cooperative fibers, and compiled for CUDA where there is no GPU."""

import numpy as np
import pytest
import warp as wp
from test_drive_physics import two_sprockets

from warpchain import load_drive
from warpchain.arrays import upload_ensemble, upload_state
from warpchain.cpu import CpuEngine
from warpchain.ensemble import REAL, Schedule, pack
from warpchain.examples import drive_path
from warpchain.kernels.block import block_kernel

FOREVER = 10**8
OTHER_TEETH = {
    "chain.worn_links": [{"link": 3, "elongation": 1e-3}],
    "contact.sprocket.law": "kelvin-voigt",
    "contact.sprocket.profile": "iso606",
    "contact.sprocket.gap": "maximum",
    "contact.sprocket.clearance": None,
    "contact.sprocket.seat_angle": None,
}


@pytest.fixture
def fibers():
    """Blocks of several threads on the CPU, for one test."""
    before = wp.config.enable_cpu_blocks
    wp.config.enable_cpu_blocks = True
    yield
    wp.config.enable_cpu_blocks = before


def marine():
    drive = load_drive(drive_path("marine"))
    return [drive, drive.with_values({"sprockets.camshaft.load.torque": 5e3, "run.step": 8e-6})], 192


def equal_sprockets():
    return [two_sprockets(), two_sprockets(teeth=24, links=64, torque=100.0).with_values(OTHER_TEETH)], 64


@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("drives", [marine, equal_sprockets])
def test_block_kernel_takes_the_steps_of_the_cpu_kernel(fibers, drives, precision):
    variants, threads = drives()
    schedules = [Schedule(drive.run.step, FOREVER, FOREVER - 1, FOREVER, 0) for drive in variants]
    packed = pack(variants, schedules).at_precision(precision)
    serial = CpuEngine(packed, 1)
    for future in serial.advance(300, serial.frame_buffer(1)):
        future.result()
    serial.close()
    ensemble, state = upload_ensemble(packed, "cpu"), upload_state(packed, "cpu")
    order = wp.array([1, 0], dtype=wp.int32, device="cpu")  # the launch's order of variants does not matter
    drive = variants[0]
    kernel = block_kernel(REAL[precision], threads, len(drive.sprockets), len(drive.guides))
    for block in (120, 180):  # nor does where launches end
        wp.launch(kernel, dim=2 * threads, inputs=[ensemble, state, order, block], block_dim=threads, device="cpu")
    assert state.progress.numpy()["step"].tolist() == [300, 300]
    # the same functions in the same order; moments are added up in another: round-off, which contacts amplify
    tolerance = 1e-12 if precision == "float64" else 1e-6
    np.testing.assert_allclose(state.rollers.numpy(), serial.state.rollers.numpy(), atol=tolerance, rtol=tolerance)
    np.testing.assert_array_equal(state.seat.numpy(), serial.state.seat.numpy())
    for name in ("angle", "speed"):
        mine, theirs = state.sprockets.numpy()[name], serial.state.sprockets.numpy()[name]
        np.testing.assert_allclose(mine, theirs, rtol=tolerance, atol=tolerance)


@pytest.mark.parametrize("arch", [75, 80, 90])
@pytest.mark.parametrize("real", [wp.float64, wp.float32], ids=["float64", "float32"])
def test_block_kernel_compiles_for_cuda_without_a_gpu(tmp_path, real, arch):
    kernel = block_kernel(real, 128, 2, 1)
    wp.compile_aot_module(kernel.module, device=None, arch=arch, module_dir=str(tmp_path))
    assert [path for path in tmp_path.iterdir() if path.suffix in (".cubin", ".ptx")]
