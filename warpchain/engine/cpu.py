"""CPU engine: an ensemble in the machine's memory, its variants spread over threads."""

from __future__ import annotations

import ctypes
import queue
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpchain.engine.arrays import ARRAYS, Engine, empty_sums, upload_ensemble, upload_state
from warpchain.engine.packed_ensemble import PackedEnsemble, real_type
from warpchain.kernels import relaxation
from warpchain.kernels.cpu.advance import IS_KEPT, KEEP, SCRATCH_ROWS, advance_kernel
from warpchain.kernels.cpu.relax import relax_kernel

CAPACITIES = (264, 1048, 4120, 16408, 65560)
"""Row lengths of the CPU's scratch, a kernel each."""

SPARE_VALUES = 32
"""Spare values of CPU scratch rows, for whole lanes."""


def cpu_kernel(name: str, packed: PackedEnsemble, precision: str) -> Any:
    """CPU kernel "advance" or "relax", not loaded yet."""
    form = real_type(precision), _row_capacity(packed)
    silent = bool(packed.drives["points"].max() > 1)
    if name == "relax":
        return relax_kernel(*form, silent=silent)
    return advance_kernel(*form, packed.frame, several=bool(packed.drives["chains"].max() > 1), silent=silent)


class PreparedLaunch:
    """Launch of the kernel "advance", repeated without Warp's checks of arguments."""

    def __init__(self, command: Any, scratch: wp.array) -> None:
        self.bounds, *values = command.params
        names = [arg.label for arg in command.kernel.adj.args]
        fields = [(name, type(value)) for name, value in zip(names, values, strict=True)]
        self.arguments = type("Arguments", (ctypes.Structure,), {"_fields_": fields})(*values)
        self.scratch, self._command = scratch, command  # which keeps the arrays alive
        self._places = ctypes.byref(self.bounds), ctypes.byref(self.arguments)

    def launch(self, steps: int, kept: int) -> None:
        """Takes all rows so many steps on, by bits `KEEP`, `IS_KEPT`."""
        self.arguments.steps, self.arguments.kept = steps, kept
        self._command.hooks.forward(*self._places)


class CpuEngine(Engine):
    """CPU engine that steps an ensemble by `workers` threads."""

    def __init__(self, packed: PackedEnsemble, workers: int) -> None:
        self.packed = packed
        self.workers = workers
        self.variants = len(packed.assemblies)
        self.capacity = _row_capacity(packed)
        self._kernels: dict[str, Any] = {}
        self._pool = ThreadPoolExecutor(workers, thread_name_prefix="warpchain")
        self._scratch: queue.SimpleQueue[wp.array] = queue.SimpleQueue()
        shape = (int(packed.drives["chains"].max()), (SCRATCH_ROWS + _contact_rows(packed)) * self.capacity)
        for _ in range(workers):
            self._scratch.put(wp.zeros(shape, dtype=packed.real, device="cpu"))
        self.ensemble = upload_ensemble(packed, "cpu")
        self.state = upload_state(packed, "cpu")
        self.cpu_sums = empty_sums(packed, "cpu")
        self._settling: wp.array = wp.empty(0, dtype=relaxation.Settling, device="cpu")
        self._progress = self.state.progress.numpy()
        self._prepared: tuple[PreparedLaunch, wp.array] | None = None
        self._keeps, self._is_kept = int((packed.drives["chains"] > 0).sum()) == 1, False

    def _kernel(self, name: str) -> Any:
        """Compiled CPU kernel, loaded."""
        if name not in self._kernels:
            kernel = cpu_kernel(name, self.packed, self.packed.precision)
            wp.load_module(kernel.module, device="cpu", block_dim=1)
            self._kernels[name] = kernel
        return self._kernels[name]

    def _launch(
        self, name: str, before: list[Any], after: list[Any], begin: int = 0, end: int | None = None
    ) -> list[Future[None]]:
        """Launches a CPU kernel over variants `begin` to before `end`, by default all."""
        kernel, end = self._kernel(name), self.variants if end is None else end
        group = max(1, -(-(end - begin) // (8 * self.workers)))

        def work(first: int) -> None:
            """Launches the CPU kernel over a group of variants."""
            scratch = self._scratch.get()
            try:
                count = min(group, end - first)
                rows = scratch if name == "advance" else scratch[0]
                wp.launch(kernel, dim=count, inputs=[*before, rows, first, *after], device="cpu", block_dim=1)
            finally:
                self._scratch.put(scratch)

        return [self._pool.submit(work, first) for first in range(begin, end, group)]

    def advance(self, steps: int, frames: wp.array) -> list[Future[None]]:
        return self._launch("advance", [self.ensemble, self.state, self.cpu_sums, frames], [0, steps])

    def take_steps(self, steps: int | NDArray[np.integer], frames: wp.array) -> None:
        if isinstance(steps, int):
            if self.workers == 1 or self.variants == 1:
                self._step_here(steps, frames)
            else:
                self._step_rows(0, self.variants, steps, frames)
            return
        begins = np.flatnonzero(np.append(True, steps[1:] != steps[:-1]))
        for first, end in zip(begins.tolist(), [*begins[1:].tolist(), len(steps)], strict=True):
            self._step_rows(first, end, int(steps[first]), frames)

    def _step_rows(self, first: int, end: int, steps: int, frames: wp.array) -> None:
        """Takes `steps` steps of rows `first` to before `end` on the CPU."""
        before = [self.ensemble, self.state, self.cpu_sums, frames]
        for future in self._launch("advance", before, [0, steps], first, end):
            future.result()

    def _step_here(self, steps: int, frames: wp.array) -> None:
        """Takes all rows so many steps on in this thread.

        One variant alone stays in the scratch, until its state is read.
        """
        if self._prepared is None or self._prepared[1] is not frames:
            self._put_back()
            self._prepared = self.prepared_launch(frames), frames
        self._prepared[0].launch(steps, int(KEEP) * self._keeps | int(IS_KEPT) * self._is_kept)
        self._is_kept = self._keeps

    def _put_back(self) -> None:
        """Copies a variant that stays in the scratch into the state."""
        if self._is_kept and self._prepared is not None:
            self._prepared[0].launch(0, int(IS_KEPT))
            self._is_kept = False

    def prepared_launch(self, frames: wp.array) -> PreparedLaunch:
        """Launch of the kernel "advance" over all rows, not made yet."""
        scratch = self._scratch.get()
        self._scratch.put(scratch)
        inputs = [self.ensemble, self.state, self.cpu_sums, frames, scratch, 0, 0, 1]
        kernel = self._kernel("advance")
        command = wp.launch(kernel, self.variants, inputs=inputs, device="cpu", block_dim=1, record_cmd=True)
        return PreparedLaunch(command, scratch)

    def start_settling(self, settling: NDArray[Any]) -> None:
        self._settling = wp.array(settling, dtype=relaxation.Settling, device="cpu")

    def settle(self, steps: int) -> list[Future[None]]:
        return self._launch("relax", [self.ensemble, self.state, self._settling], [steps])

    def settling_states(self) -> NDArray[Any]:
        return np.array(self._settling.numpy(), copy=True)

    def changing_structs(self) -> dict[str, Any]:
        self._put_back()
        return {"state": self.state, "sums": self.cpu_sums}

    def fetch_array(self, group: str, name: str) -> NDArray[Any]:
        return np.array(getattr(self.changing_structs()[group], name).numpy(), copy=True)

    def set_array(self, group: str, name: str, values: NDArray[Any]) -> None:
        getattr(self.changing_structs()[group], name).numpy()[: len(values)] = values

    def sums(self) -> dict[str, NDArray[Any]]:
        return {name: self.fetch_array("sums", name) for name in ARRAYS["sums"]}

    def progress(self) -> NDArray[Any]:
        return self._progress.copy()

    def set_constants(self, name: str, values: NDArray[Any]) -> None:
        held = getattr(self.ensemble, name).numpy()
        if held.dtype == values.dtype and held.dtype.names:  # as bytes: field by field it takes ten times as long
            held, values = (of.view(f"V{of.dtype.itemsize}") for of in (held, values))
        held[: len(values)] = values

    def stage_inputs(self, first: int) -> tuple[NDArray[Any], NDArray[Any]]:
        return self.ensemble.tables.numpy(), self.ensemble.drives.numpy()["frame_interval"]

    def diverged_view(self) -> NDArray[Any]:
        view: NDArray[Any] = self._progress["diverged"]
        return view

    def frame_buffer(self, values: int, wanted: NDArray[np.integer] | None = None) -> wp.array:
        return wp.empty(max(values, 1), dtype=self.packed.real, device="cpu")

    def close(self) -> None:
        self._pool.shutdown(wait=True, cancel_futures=True)


def _contact_rows(packed: PackedEnsemble) -> int:
    """Most CPU scratch rows of a chain's contacts."""
    drives = packed.drives
    silent = drives["points"] > 1
    links = silent * (drives["sprockets"] * drives["points"] + drives["guides"] // 2)
    own = drives["sprockets"] * drives["points"] + drives["guides"] + 2 * links
    return int((own + silent * SCRATCH_ROWS).max())


def _row_capacity(packed: PackedEnsemble) -> int:
    """Shortest CPU scratch row for the longest chain."""
    from warpchain.errors import SimulationError

    longest = int(packed.drives["rollers"].max())
    for capacity in CAPACITIES:
        if capacity > longest + SPARE_VALUES:
            return capacity
    raise SimulationError(
        f"chain.links = {longest}: the CPU engine takes up to {CAPACITIES[-1] - SPARE_VALUES - 1} links"
    )
