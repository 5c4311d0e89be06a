"""Runs both kernels in Warp's debug build, in which an access out of an array's bounds ends the process.

    python tests/kernels/checked.py              # the serial kernel and, on fibers, the block kernel, over test drives
    python tests/kernels/checked.py beyond row   # a kernel that reads beyond a row (array, view): must not end well

A process of its own: the build is chosen where kernels are made.
"""

import sys
import time
import warnings
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import warp as wp

from warpchain.model import Model

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1])]
STEPS = 96
"""Enough for the window, samples, statistics, looks for divergence, and more than one course of prescribed motion."""


def beyond(how: str) -> None:
    """Reads the value after an array's last, as an array, as a row of one, or as a view that is too long."""
    from warpchain.kernels.gpu.shared_memory import VIEW_CODE
    from warpchain.kernels.native import row_access

    load_row = row_access(wp.float64).load

    @wp.kernel(module="unique")
    def reads(values: wp.array[wp.float64], found: wp.array[wp.float64], i: int):
        found[0] = values[i]

    @wp.func_native(VIEW_CODE)
    def view(all: wp.array[wp.float64], first: int, count: int) -> wp.array[wp.float64]: ...

    @wp.kernel(module="unique")
    def reads_view(values: wp.array[wp.float64], found: wp.array[wp.float64], i: int):
        found[0] = load_row(view(values, 2, i - 1), i - 2)

    @wp.kernel(module="unique")
    def reads_row(values: wp.array[wp.float64], found: wp.array[wp.float64], i: int):
        found[0] = load_row(values, i)

    values, found = (wp.zeros(8, dtype=wp.float64, device="cpu") for _ in range(2))
    kernel = {"array": reads, "row": reads_row, "view": reads_view}[how]
    for i in (7, 8):
        wp.launch(kernel, dim=1, inputs=[values, found, i], device="cpu")
        print(f"read value {i} of 8", flush=True)


def finished(engine, futures) -> None:
    for future in futures:
        future.result()
    engine.close()


def on_the_cpu(drives, precision: str) -> None:
    """Settling, and steps with frames of every channel, by the serial kernels."""
    from warpchain.engine.cpu import CpuEngine
    from warpchain.engine.settling import settling_ensemble

    packed, values = ensemble_of(drives)
    engine = CpuEngine(settling_ensemble(packed), 1)
    engine.start_settling(begun(packed))
    finished(engine, engine.settle(STEPS))
    engine = CpuEngine(packed.at_precision(precision), 1)
    finished(engine, engine.advance(STEPS + 1, engine.frame_buffer(values)))
    ended(engine.progress()[packed.first_rows], drives)


def on_blocks(drives, family, many: bool, precision: str, shape=None) -> None:
    """Steps with frames of every channel by the block kernel of the drives' family, its blocks' threads as fibers."""
    import blocks

    of_family, kind, frame = blocks.sharing(family, many, precision)
    variants = of_family[drives]
    packed, values = ensemble_of(variants, frame=frame)
    packed = packed.at_precision(precision)
    frames = wp.empty(values, dtype=packed.real, device="cpu")
    kind = replace(kind, shape=shape or kind.shape)
    state, _ = blocks.run_blocks(packed, kind, [STEPS + 1], list(range(len(variants))), frames)
    ended(state.progress.numpy()[packed.first_rows], variants)


def settle_on_blocks() -> None:
    """Relaxation by the block kernel, of a drive with a guide-bar."""
    import blocks

    from warpchain.engine.arrays import empty_tallies, upload_ensemble, upload_state
    from warpchain.engine.settling import settling_ensemble
    from warpchain.kernels.gpu.block_kinds import BlockKind, BlockShape, Parts
    from warpchain.kernels.gpu.relax import block_relax_kernel
    from warpchain.kernels.relaxation import Settling

    drives = blocks.marine()
    still = settling_ensemble(ensemble_of(drives)[0])
    settling = wp.array(begun(still), dtype=Settling, device="cpu")
    ensemble, state = upload_ensemble(still, "cpu"), upload_state(still, "cpu", (0, 0))
    shape, parts = (
        BlockShape(32, -(-drives[0].chain.links // 32)),
        Parts(len(drives[0].sprockets), len(drives[0].guides)),
    )
    kind = BlockKind(wp.float64, shape, parts)
    order = wp.array([1, 0], dtype=wp.int32, device="cpu")
    inputs = [ensemble, state, empty_tallies(still, "cpu"), settling, order, STEPS]
    wp.launch(blocks.on_fibers(block_relax_kernel(kind, 4)), dim=64, inputs=inputs, block_dim=32, device="cpu")
    assert (settling.numpy()["steps"] == STEPS).all()


def begun(packed):
    """Relaxation that is to take `SAMPLED_STEPS` steps."""
    from warpchain.kernels.relaxation import Settling

    start = np.zeros(packed.variants, dtype=Settling.numpy_dtype())
    start["step"], start["tolerance"], start["limit"] = 1e-6, 1e-3, STEPS
    return start


def ended(progress, drives) -> None:
    """All steps were taken, but by those that were to diverge, of which some did."""
    loads = [drive.sprockets[-1].load for drive in drives]
    wild = np.array([load is not None and load.viscous > 9e4 for load in loads])
    assert (progress["step"][~wild] == STEPS + 1).all() and progress["diverged"].any() == wild.any()


def diverging():
    """Loads that make the sprocket's angle, and then all that hangs on it, anything."""
    from drives import two_sprockets
    from test_bounds import mad

    return [*mad(5), *(two_sprockets(floor=1e-9, viscous=viscous, step=2e-5) for viscous in (1e10, 1e30))]


def moving_and_diverging():
    import blocks

    return [*blocks.moving_sprockets(), *diverging()]


def ensemble_of(drives, **more):
    """Drives packed for `SAMPLED_STEPS` steps, and how many values their frames take; not one more is there."""
    from blocks import pack_for

    from warpchain.results.channels import drive_frame_width
    from warpchain.results.schedule import Schedule

    schedules = [Schedule(drive.run.step, STEPS, 11, STEPS - 5, 8) for drive in drives]
    packed = replace(pack_for(drives, schedules, "float64"), **more)
    chains = [chain for drive in drives for chain in Model(drive).chains]
    widths = [drive_frame_width(chain, packed.frame) * (STEPS // 8 + 1) for chain in chains]
    packed.drives["first_value"] = np.cumsum([0, *widths[:-1]])
    return packed, sum(widths)


def cases():
    """What is run, by name."""
    import blocks as of

    from warpchain.kernels.gpu.block_kinds import BlockShape

    every = (of.marine, of.equal_sprockets, of.moving_sprockets, of.unusual_contacts, of.rk4, of.rubbing, of.bending)
    every += (of.rubbing_on_moving_sprockets, of.uneven, of.bending_rk4)
    everyone = [*(drive for some in every for drive in some()), *diverging()]
    yield "cpu float64", lambda: on_the_cpu(everyone, "float64")
    yield "cpu float32", lambda: on_the_cpu(everyone, "float32")
    families = [
        ((moving_and_diverging, of.rubbing_on_moving_sprockets), False, "float64"),
        ((of.uneven, of.bending), True, "float32"),
        ((of.rubbing_rk4,), False, "float64"),
        ((of.v6,), True, "float64"),
        ((of.v6,), False, "float32"),
    ]
    for family, *way in families:
        for drives in family:
            yield f"blocks {of.case_name(drives, *way)}", partial(on_blocks, drives, family, *way)
    yield "blocks settling", settle_on_blocks
    long, large = of.long_chains, BlockShape(64, 16)
    yield "blocks in global memory", partial(on_blocks, long, (long,), True, "float64", large)


def main() -> None:
    """Runs all; prints a line a case."""
    warnings.simplefilter("ignore")
    for name, case in cases():
        begun = time.perf_counter()
        case()
        print(f"{name}: within bounds, {time.perf_counter() - begun:.1f} s", flush=True)


if __name__ == "__main__":
    wp.config.mode = "debug"
    wp.config.log_level = wp.LOG_ERROR
    wp.config.enable_cpu_blocks = True
    if sys.argv[1:]:
        beyond(sys.argv[-1])
    else:
        main()
