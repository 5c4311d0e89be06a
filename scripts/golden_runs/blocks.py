"""The cases of `golden.py` for the GPU's block kernel, which runs on CPU fibers here."""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from common.drives import example_drive, two_sprockets

from golden_runs.drives import MOUNTS, PROFILES, TABLES, WORN
from warpchain import Drive
from warpchain.assembly.timestep import resolve_step, step_limit
from warpchain.engine.arrays import device_values, empty_sums, empty_tallies, upload_ensemble, upload_state
from warpchain.engine.gpu_kernels import block_shape, roller_capacity
from warpchain.engine.pack import pack
from warpchain.engine.packed_ensemble import PackedEnsemble
from warpchain.engine.settling import settling_ensemble
from warpchain.kernels.gpu.block import block_kernel
from warpchain.kernels.gpu.block_kinds import BY_SPEED, BlockKind, BlockShape, Friction, Parts
from warpchain.kernels.gpu.relax import block_relax_kernel
from warpchain.kernels.gpu.shared_memory import block_memory
from warpchain.kernels.gpu.statistics import tally_sum_kernel
from warpchain.kernels.relaxation import Settling
from warpchain.results.channels import DEFAULT_FRAME, drive_frame_width
from warpchain.results.schedule import Schedule

STRIBECK = {
    f"{part}.{key}": value
    for part in ("chain.joint", "contact.sprocket")
    for key, value in (("static_friction", 0.12), ("stribeck_speed", 0.1))
}
"""Friction of joints and teeth by the speed."""


@contextlib.contextmanager
def fiber_blocks() -> Iterator[None]:
    """Blocks of several threads on the CPU."""
    before = wp.config.enable_cpu_blocks
    wp.config.enable_cpu_blocks = True
    try:
        yield
    finally:
        wp.config.enable_cpu_blocks = before


def block_kind(packed: PackedEnsemble, shape: BlockShape, measuring: bool) -> BlockKind:
    """The kind of the block kernel for an ensemble of like drives."""
    varied = bool(packed.has_varied_links.any())
    contacts, joints = (
        BY_SPEED * bool(rubs.any()) for rubs in (packed.contact_friction_kinds, packed.joint_friction_kinds)
    )
    return BlockKind(
        packed.real,
        shape,
        Parts(int(packed.drives["sprockets"][0]), int(packed.drives["guides"][0]), prescribed=1),
        measuring=measuring,
        integrator=int(packed.drives["integrator"].max()),
        moving=bool(packed.mounts["active"].any()),
        friction=Friction(contacts, joints),
        links="varied" if varied else "lengths",
    )


def run_on_blocks(drives: list[Drive], many: bool, precision: str, measuring: bool = True) -> dict[str, Any]:
    """300 steps on blocks of fibers: state, sums and frames."""
    shape = block_shape(
        int(roller_capacity(np.array([drive.chain.links for drive in drives])).max()), 100 if many else 1
    )
    packed = pack(drives, [Schedule(resolve_step(drive), 300, 111, 290, 20) for drive in drives]).at_precision(
        precision
    )
    widths = [drive_frame_width(drive) * 16 for drive in drives]
    packed.drives["first_value"] = np.cumsum([0, *widths[:-1]])
    kind, blocks = block_kind(packed, shape, measuring), len(drives)
    of = block_memory(kind)
    with fiber_blocks():
        large = blocks * of.values, blocks * of.part_values
        ensemble, state = upload_ensemble(packed, "cpu", blocks=True), upload_state(packed, "cpu", large)
        sums, tallies = empty_sums(packed, "cpu", blocks=True), empty_tallies(packed, "cpu")
        frames = wp.full(sum(widths), np.nan, dtype=packed.real, device="cpu")
        kernel = block_kernel(kind, 4, DEFAULT_FRAME)
        begun: wp.array = wp.zeros(blocks, dtype=wp.int32, device="cpu")
        ends: wp.array = wp.full(blocks, 301 if measuring else 100, dtype=wp.int32, device="cpu")
        order: wp.array = wp.array(np.arange(blocks), dtype=wp.int32, device="cpu")
        inputs = [ensemble, state, sums, tallies, frames, order, ends, begun]
        wp.launch(kernel, dim=blocks * shape.threads, inputs=inputs, block_dim=shape.threads, device="cpu")
        wp.launch(tally_sum_kernel(packed.real), packed.variants, inputs=[ensemble.drives, tallies, sums], device="cpu")
    held = {name: getattr(state, name) for name in ("rollers", "seat", "progress")}
    bodies = device_values(state.bodies, "state", "bodies", packed.real)
    held["sprockets"] = {name: np.array(bodies[name]) for name in ("angle", "speed", "center", "velocity")}
    names = ("chain", "strand", "sprocket", "mount", "contact")
    found = {name: device_values(getattr(sums, name), "sums", name, packed.real) for name in names}
    return held | {"frames": frames, "sums": found}


def block_shapes(drives: list[Drive]) -> dict[str, Any]:
    """On few and on many blocks, in both precisions."""
    each = [(many, precision) for many in (False, True) for precision in ("float64", "float32")]
    return {
        f"{'many' if many else 'few'}/{precision}": run_on_blocks(drives, many, precision) for many, precision in each
    }


def guide_blocks(_: Path) -> dict[str, Any]:
    """Drives with a guide-bar, whose joints and contacts rub, evenly and by the speed; also by the kernel that takes
    no metrics."""
    other = {"sprockets.camshaft.load.torque": 5e3, "run.step": 8e-6} | STRIBECK
    drives = [example_drive("marine"), example_drive("marine", other)]
    return block_shapes(drives) | {"unmeasured": run_on_blocks(drives, True, "float64", False)}


def moving_body_blocks(_: Path) -> dict[str, Any]:
    """Mounts, balance wheels, tables, laws and worn links."""
    laws = {"contact.sprocket.law": "kelvin-voigt"} | PROFILES["maximum"] | TABLES[2]
    return block_shapes([two_sprockets(MOUNTS[0] | laws), two_sprockets(MOUNTS[1] | WORN | TABLES[0])])


def rk4_blocks(_: Path) -> dict[str, Any]:
    """The classical Runge-Kutta scheme, with moving sprockets."""
    return block_shapes([two_sprockets(values | {"run.integrator": "rk4"}) for values in ({}, MOUNTS[1])])


def settling_blocks(_: Path) -> dict[str, Any]:
    """Settling, by both shapes of blocks."""
    drive = two_sprockets()
    still = settling_ensemble(pack([drive], [Schedule(resolve_step(drive), 10, 0, 10, 0)]))
    shapes = {"64": BlockShape(96, 1), "32": BlockShape(32, 2)}
    return {name: settled_on_block(still, drive, shape) for name, shape in shapes.items()}


def settled_on_block(still: PackedEnsemble, drive: Drive, shape: BlockShape) -> dict[str, Any]:
    """4000 steps of relaxation on a block of fibers."""
    start = np.zeros(1, dtype=Settling.numpy_dtype())
    start["step"], start["tolerance"], start["limit"] = 0.7 * step_limit(drive), 1e-3, 4000
    with fiber_blocks():
        settling: wp.array = wp.array(start, dtype=Settling, device="cpu")
        state, order = upload_state(still, "cpu", (0, 0)), wp.zeros(1, dtype=wp.int32, device="cpu")
        kernel = block_relax_kernel(BlockKind(wp.float64, shape, Parts(2, 0)), 4)
        inputs = [upload_ensemble(still, "cpu", blocks=True), state, empty_tallies(still, "cpu"), settling, order, 4000]
        wp.launch(kernel, dim=shape.threads, inputs=inputs, block_dim=shape.threads, device="cpu")
    return {"settling": settling, "rollers": state.rollers}
