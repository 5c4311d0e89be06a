"""`stepping`: a run that is advanced piece by piece, its inputs set and its outputs read in between.

Step n evaluates forces at t = n h and moves everything to t + h. A piece that ends at t has all evaluated up to t, as
outputs show it; what is then set acts from t + h on, what is set before the first piece from t = 0.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from numbers import Real
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from warpchain.argument_checks import FiniteNumber, PositiveNumber, Workers, check_arguments
from warpchain.drive import Drive
from warpchain.engine.simulation import available_cores, schedules_of
from warpchain.errors import LayoutWarning, SimulationError, SuspectWarning, warn_caller
from warpchain.gc_tuning import rare_collections
from warpchain.model.stacks import stacks_of_drives
from warpchain.progress import Progress, interruptible_work, progress_reporter
from warpchain.results.judgement import Limits, judgement_warning
from warpchain.results.metrics import metrics_table
from warpchain.results.own_metrics import table_with_own_metrics
from warpchain.results.run import Record, check_channel_names

if TYPE_CHECKING:
    import pyarrow as pa

    from warpchain.engine.arrays import Engine
    from warpchain.engine.input_ports import InputPort
    from warpchain.engine.output_ports import OutputPort
    from warpchain.engine.subensemble import DeviceSettings, Subensemble

SHORTEST_PIECE = 1.0 - 1e-9
"""Shortest piece's length, in steps."""


@dataclass(frozen=True)
class SteppedState:
    """State of a stepped run at one instant, to go on from.

    Attributes:
        key: what a run must have in common to take it over.
        arrays: of the engine.
        inputs: what was set.
        clock: steps taken, target, energies, outputs.
    """

    key: tuple[Any, ...]
    arrays: Mapping[tuple[str, str], NDArray[Any]]
    inputs: tuple[Mapping[str, InputPort], Mapping[str, NDArray[Any]]]
    clock: tuple[Any, ...]


@check_arguments(SimulationError)
@rare_collections()
def stepping(
    drives: Drive | Sequence[Drive],
    *,
    inputs: Sequence[str] = (),
    outputs: Sequence[str] = (),
    device: str | None = None,
    precision: Literal["float64", "float32"] = "float64",
    duration: PositiveNumber | None = None,
    step: PositiveNumber | Literal["auto"] | None = None,
    window: tuple[FiniteNumber, FiniteNumber] | None = None,
    progress: Progress = False,
    workers: Workers | None = None,
) -> SteppedRun:
    """A run that is advanced piece by piece, as a context.

    In any pieces it has the states of one `simulate` run, on a CPU to the last bit.

    Args:
        drives: one drive, whose values have no axis for variants, or V drives, whose values have that first.
        inputs: PART.KIND each: "driven.load_torque", against forward rotation, and "motor.motor_torque", forward, in
            place of torque and table of the load or motor [N m]; "clutch.capacity" [N m]; "driver.speed" of a
            prescribed sprocket or shaft, forward [rad/s]; "tightener.center" of a sprocket and "blade.pivot" of an arm
            that are led [m]; "tensioner.force", the preload of a tensioner's spring on its arm [N].
        outputs: channels of `Trajectory`, such as "tension", of all parts, or PART.CHANNEL, such as
            "driven.sprocket_speed".
        device, precision, step, progress, workers: as of `simulate`; one GPU at most.
        duration: most simulated time [s]; None: each drive's own.
        window: (start, end) of metrics and energy balance [s]; None: the second half of `duration`.

    Returns:
        The run, a context that frees the device's memory at its end.

    Raises:
        DriveError: a chain that does not fit, or a step beyond its limit.
        SimulationError: an invalid argument, or an unknown input, output or device.
    """
    from warpchain.engine import start_warp
    from warpchain.engine.devices import choose_devices
    from warpchain.engine.own_laws import add_laws
    from warpchain.engine.packed_ensemble import real_type
    from warpchain.engine.subensemble import DeviceSettings, Subensemble, Variants
    from warpchain.kernels.structs import types
    from warpchain.results.channels import WHOLE_FRAME, frame_with_channels

    start_warp()
    add_laws()
    chosen = (drives,) if isinstance(drives, Drive) else tuple(drives)
    if not chosen:
        raise SimulationError("drives: none given; at least one is needed")
    for what, names in (("inputs", inputs), ("outputs", outputs)):
        if len(set(names)) < len(names):
            raise SimulationError(f"{what}: {next(n for n in names if list(names).count(n) > 1)!r} is there twice")
    channels = [name.rpartition(".")[2] for name in outputs]
    check_channel_names("outputs", channels)
    stacks = stacks_of_drives(chosen, len(chosen))
    schedules = schedules_of(chosen, duration, step, Record(variants="none"), window, stacks)
    cores = workers or available_cores()
    types(real_type(precision))
    part = Subensemble(Variants(chosen, schedules, stacks, np.arange(len(chosen))), frame_with_channels(channels))
    choice = choose_devices(device, part.packed, precision, cores, 1)
    if choice.devices == ("cpu",):
        part.packed.frame = WHOLE_FRAME
    return SteppedRun(
        part,
        DeviceSettings(choice.devices[0], precision, cores),
        (tuple(inputs), tuple(outputs)),
        is_single=isinstance(drives, Drive),
        progress=progress,
    )


class Clock:
    """Steps that a stepped run's variants have taken, in groups of equal time steps.

    Attributes:
        step: (V,) time steps [s].
        group: (V,) their groups.
        steps: time steps of groups [s].
        taken: step up to which each group is evaluated, at first -1.
        target: sum of all pieces [s].
    """

    def __init__(self, step: NDArray[np.float64], last: NDArray[np.int64]) -> None:
        self.step = step
        steps, self.group = np.unique(step, return_inverse=True)
        self.steps, self.longest = steps.tolist(), float(steps[-1])
        self._last = [int(last[self.group == g].min()) for g in range(len(steps))]
        self.taken, self.target = [-1] * len(steps), 0.0

    @property
    def taken_by_variant(self) -> NDArray[np.int64]:
        """Step (V,) up to which variants are evaluated."""
        return np.array(self.taken)[self.group]

    @property
    def now(self) -> NDArray[np.float64]:
        """Instant (V,) [s] of variants' last evaluated step."""
        return np.array([max(n, 0) * h for n, h in zip(self.taken, self.steps, strict=True)])[self.group]

    @property
    def next(self) -> NDArray[np.float64]:
        """Instant (V,) [s] of variants' next step."""
        return np.array([(n + 1) * h for n, h in zip(self.taken, self.steps, strict=True)])[self.group]

    def steps_after(self, dt: float) -> tuple[list[int], float]:
        """Steps to which a piece of `dt` [s] takes each group, and the sum of all pieces [s].

        Raises:
            SimulationError: less than a step, or beyond the end.
        """
        if dt < SHORTEST_PIECE * self.longest:
            raise SimulationError(f"dt = {dt:g} s: must be at least a step, {self.longest:.6g} s")
        target, until = self.target + dt, []
        for h, taken, last in zip(self.steps, self.taken, self._last, strict=True):
            n = max(int(target / h + 0.5), taken + 1, 1)
            until.append(n)
            if n > last:
                raise SimulationError(
                    f"dt = {dt:g} s: the run would come to {target:g} s, beyond its end at {last * h:g} s; give "
                    "stepping a longer duration"
                )
        return until, target


def _checked_duration(name: str, value: Any) -> float:
    """Length of time [s] as a plain number."""
    if isinstance(value, Real) and not isinstance(value, bool) and 0.0 < float(value) < math.inf:
        return float(value)
    raise SimulationError(f"{name} = {value!r}: must be a finite number above 0 [s]")


class SteppedRun:
    """A run that is advanced piece by piece, a context, by `stepping`.

    Attributes:
        drives: (V,) of the variants.
        step: time step [s], of V drives (V,).
    """

    def __init__(
        self,
        part: Subensemble,
        settings: DeviceSettings,
        names: tuple[tuple[str, ...], tuple[str, ...]],
        is_single: bool,
        progress: Progress,
    ) -> None:
        from warpchain.engine.input_ports import make_ports
        from warpchain.engine.output_ports import lay_out_frames, make_outputs

        self._part, self._settings, self._is_single, self._progress = part, settings, is_single, progress
        self.drives, rows = part.variants.drives, part.rows
        columns = part.variants.schedules.columns
        self._clock = Clock(columns["step"], columns["steps"])
        self._values = lay_out_frames(rows, part.packed)
        self._first_table = part.packed.tables.size
        self._inputs = make_ports(names[0], rows, part.packed)
        self._outputs = make_outputs(names[1], rows, part.packed)
        self._stored = np.zeros(len(rows.models))
        self._first_rows = rows.first_rows[:-1]
        self._row_groups = self._clock.group[rows.variant_of_row]
        self._engine: Engine | None = None
        self._state = "is not begun: advance it within `with warpchain.stepping(...) as run:`"

    def __enter__(self) -> SteppedRun:
        from warpchain.assembly.stack_assembly import layout_faults_line
        from warpchain.engine.devices import make_engine

        if self._engine is not None or self._state == CLOSED:
            raise SimulationError("stepping: a run is begun once; make another")
        line = layout_faults_line(self._part.layout_faults)
        if line is not None:
            warn_caller(line, LayoutWarning)
        settings = self._settings
        with progress_reporter(self._progress) as report, interruptible_work() as stop:
            self._settled = self._part.settle(settings, None, report, stop)
            if stop.is_asked:
                raise KeyboardInterrupt
        packed = self._part.packed.at_precision(settings.precision)
        self._engine = make_engine(settings.device, packed, settings.cores)
        packed.tables, self._frame_intervals = self._engine.stage_inputs(self._first_table)
        self._diverged = self._engine.diverged_view()
        read = [np.zeros(0, dtype=np.int64), *(port.places.reshape(-1) for port in self._outputs.values())]
        self._frames = self._engine.frame_buffer(self._values, np.unique(np.concatenate(read)))
        self._host_frames = (
            self._frames.numpy if settings.device != "cpu" else partial(np.asarray, self._frames.numpy())
        )
        return self

    def __exit__(self, *_: object) -> None:
        engine, self._engine, self._state = self._engine, None, CLOSED
        if engine is not None:
            engine.close()

    @property
    def _running(self) -> Engine:
        """The engine, while the run can be advanced."""
        if self._engine is None:
            raise SimulationError(f"stepping: the run {self._state}")
        return self._engine

    def launch_parts(self) -> tuple[Engine, Any, Mapping[str, InputPort], Mapping[str, OutputPort]]:
        """Engine, buffer of frames, inputs and outputs by name of a stepped run, to export it."""
        return self._running, self._frames, self._inputs, self._outputs

    def _of_variants(self, values: NDArray[Any]) -> Any:
        """Values (V, ...) as handed out: of one drive without that axis."""
        return values[0].item() if self._is_single and values.ndim == 1 else values[0] if self._is_single else values

    @property
    def step(self) -> Any:
        """Time step [s], (V,) of V drives."""
        return self._of_variants(self._clock.step)

    @property
    def time(self) -> Any:
        """Instant to which the run has come [s], (V,) of V drives: whole steps."""
        return self._of_variants(self._clock.now)

    @property
    def diverged(self) -> Any:
        """Whether the run has diverged and stands still, (V,) of V drives."""
        return self._of_variants(self._running.progress()["diverged"][self._first_rows] != 0)

    def set(self, values: Mapping[str, Any], over: float | None = None) -> None:
        """Sets inputs, from the next evaluated step on.

        Args:
            values: by input, a number for all variants or (V,); of centers and pivots (2,) or (V, 2).
            over: time to reach the values along a line [s]; None: at once, then held. Centers and pivots need one: from
                their velocity they come to rest in it.

        Raises:
            SimulationError: an unknown input, an invalid shape or value, or too short a time.
        """
        engine = self._running
        if over is None and self._hold(values):
            return
        time, end = self._clock.next, None
        if not isinstance(values, Mapping):
            raise SimulationError('set: must be a mapping from inputs to values, such as {"driven.load_torque": 50.0}')
        if over is not None:
            end = self._clock.now + _checked_duration("over", over)
            if over <= self._clock.longest / SHORTEST_PIECE:
                raise SimulationError(f"over = {over:g} s: must be more than a step, {self._clock.longest:.4g} s")
        changed: set[str] = set()
        for port, value in [self._checked_values(name, value, over) for name, value in values.items()]:
            if not port.kind.tables:
                self._note_stored_energy(port, value)
            changed |= port.set_values(engine.packed, value, time, end)
        for name in changed - {"tables"}:
            engine.set_constants(name, getattr(engine.packed, name))

    def _hold(self, values: Any) -> bool:
        """Holds inputs at other numbers, if all are held already; returns whether they are."""
        if type(values) is not dict:
            return False
        for name, value in values.items():
            port = self._inputs.get(name)
            if port is None or not port.is_plainly_held:
                return False
            if type(value) is float:
                low = high = value
            elif type(value) is np.ndarray and value.dtype == np.float64 and value.shape == port.after.shape[:1]:
                low, high = value.min(), value.max()
            else:
                return False
            if not (port.kind.least <= low and high < math.inf and low > -math.inf):
                return False
        for name, value in values.items():
            self._inputs[name].hold(value, self._running.packed.tables)
        return True

    def _checked_values(self, name: str, value: Any, over: float | None) -> tuple[InputPort, NDArray[np.float64]]:
        """An input, and its values (V, axes) as kernels take them."""
        port = self._inputs.get(name)
        if port is None:
            raise SimulationError(f"set: {name!r} is none of the inputs; they are {', '.join(self._inputs) or 'none'}")
        kind, shape = port.kind, port.places.shape
        try:
            plain = np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError):
            raise SimulationError(f"set: {name}: must be numbers [{kind.unit}]") from None
        one, many = (shape[1:], shape) if kind.is_led else ((), shape[:1])
        if plain.shape not in (one, many):
            words = " or ".join(str(of) if of else "one number" for of in (one, many))
            raise SimulationError(f"set: {name}: is of shape {plain.shape}; must be {words}")
        if not np.isfinite(plain).all():
            raise SimulationError(f"set: {name}: must be finite numbers [{kind.unit}]")
        if kind.least > -math.inf and (plain < kind.least).any():
            raise SimulationError(f"set: {name} = {plain.min():g} {kind.unit}: must be at least {kind.least:g}")
        if kind.is_led and over is None:
            raise SimulationError(f"set: {name}: needs over=, the time in which it gets there [s]")
        if not kind.tables and over is not None:
            raise SimulationError(f"set: {name}: is held; set it without over=")
        if kind.is_led:
            return port, np.broadcast_to(plain, shape) - self._running.packed.mounts["home"][port.first_rows]
        found = np.empty(shape)
        found[:] = plain.reshape(-1, 1)
        return port, found

    def _note_stored_energy(self, port: InputPort, values: NDArray[np.float64]) -> None:
        """Notes jumps in energy of tensioners' springs as preloads change."""
        engine, packed = self._running, self._running.packed
        rows = np.repeat(np.arange(packed.variants), packed.drives["tensioners"])[port.rows]
        elements, step = packed.tensioners[port.rows], self._clock.taken_by_variant[port.owners] + 1
        body = engine.bodies()[packed.drives["first_body"][rows] + elements["body"]]
        after = elements.copy()
        after["preload"] = values[port.owners, 0]
        jump = spring_energy(after, body) - spring_energy(elements, body)
        starts, ends = packed.drives["window_start"][rows], packed.drives["window_end"][rows]
        np.add.at(self._stored, rows, np.where((step > starts) & (step <= ends), jump, 0.0))

    def advance(self, dt: float) -> None:
        """Advances the run by `dt` [s], to the whole step nearest to the sum of all pieces.

        Raises:
            SimulationError: no number above 0, less than a step, or beyond the run's end.
        """
        engine = self._running
        if type(dt) is not float or not 0.0 < dt < math.inf:
            dt = _checked_duration("dt", dt)
        until, target = self._clock.steps_after(dt)
        if self._clock.taken[0] < 0:
            self._begin(engine)
        self._take_steps(engine, until)
        self._clock.target = target

    def _begin(self, engine: Engine) -> None:
        """Evaluates the state at t = 0."""
        self._take_steps(engine, [0] * len(self._clock.steps))

    def _take_steps(self, engine: Engine, until: list[int]) -> None:
        """Takes variants to steps `until`, by group, each with a frame of the last."""
        counts = [n - taken for n, taken in zip(until, self._clock.taken, strict=True)]
        if len(until) == 1:
            self._frame_intervals[:] = max(until[0], 1)
            engine.take_steps(counts[0], self._frames)
        else:
            self._frame_intervals[:] = np.maximum(until, 1)[self._row_groups]
            engine.take_steps(np.array(counts)[self._row_groups], self._frames)
        self._clock.taken = until

    def get(self, name: str | None = None) -> Any:
        """Value of an output at `time`, or all by name; NaN where the run has diverged.

        PART.CHANNEL is a number or (2,), CHANNEL (parts,) or (parts, 2); of V drives behind an axis (V, ...).

        Raises:
            SimulationError: an unknown output.
        """
        engine = self._running
        if name is not None and name not in self._outputs:
            known = ", ".join(self._outputs) or "none"
            raise SimulationError(f"get: {name!r} is none of the outputs; they are {known}")
        if self._clock.taken[0] < 0:
            self._begin(engine)
        values, diverged = self._host_frames(), self._diverged
        found, stands = {}, np.count_nonzero(diverged)
        for port in (self._outputs[name],) if name is not None else self._outputs.values():
            of = values[port.places]
            if stands:
                of[diverged[self._first_rows] != 0] = np.nan
            found[port.name] = self._of_variants(of)
        return found if name is None else found[name]

    def state(self) -> SteppedState:
        """State of the run, from which `restore` goes on with the same bits.

        Also in another run of the same drives, precision, kind of device, inputs, outputs and window.
        """
        engine = self._running
        changed = {"tables", *(port.kind.array for port in self._inputs.values())}
        constants = {name: getattr(engine.packed, name).copy() for name in changed}
        clock = (self._clock.taken, self._clock.target, self._stored.copy(), self._host_frames().copy())
        return SteppedState(self._key(), engine.copy_state(), (copy.deepcopy(self._inputs), constants), clock)

    @check_arguments(SimulationError)
    def restore(self, state: SteppedState) -> None:
        """Takes the run to a `state`.

        Raises:
            SimulationError: the state of another run.
        """
        engine = self._running
        if state.key != self._key():
            raise SimulationError("restore: the state is of other drives, inputs, outputs, precision, device or window")
        engine.restore_state(state.arrays)
        self._inputs = copy.deepcopy(dict(state.inputs[0]))
        for name, values in state.inputs[1].items():
            getattr(engine.packed, name)[:] = values
            engine.set_constants(name, values)
        self._clock.taken, self._clock.target, stored, frames = state.clock
        self._stored = stored.copy()
        self._host_frames()[:] = frames

    def _key(self) -> tuple[Any, ...]:
        """Facts that a run and its state must share."""
        columns = self._part.variants.schedules.columns
        settings = self._settings
        return (
            tuple(self.drives),
            settings.precision,
            settings.device.partition(":")[0],
            tuple(self._inputs),
            tuple(self._outputs),
            *(columns[name].tobytes() for name in sorted(columns)),
        )

    @check_arguments(SimulationError)
    def metrics(self, limits: Limits | None = None) -> pa.Table:
        """Metrics over the window as of `simulate`, the energy balance with what came through inputs.

        Missing: those of a window that has not ended, and plug-ins' that read frames.

        Warns:
            SuspectWarning: variants that are not "ok".
        """
        engine = self._running
        if self._clock.taken[0] < 0:
            self._begin(engine)
        ended, blocks = self._part.outcome(engine, self._settled, self._stored)
        table = table_with_own_metrics(metrics_table(ended, blocks(), limits), self.drives)
        line = judgement_warning(table["status"].to_pylist(), table["reason"].to_pylist())
        if line is not None and ended.is_measured.all():
            warn_caller(line, SuspectWarning)
        return table


CLOSED = "has ended: its `with` block is over"
"""Why a run that has been left does nothing."""


def spring_energy(tensioners: NDArray[Any], bodies: NDArray[Any]) -> NDArray[np.float64]:
    """Energy (R,) [J] of tensioners' springs at their bodies, as `kernels.physics.tensioner`."""
    cosine, sine, point = np.cos(bodies["angle"]), np.sin(bodies["angle"]), tensioners["point"]
    arm = np.stack([cosine * point[:, 0] - sine * point[:, 1], sine * point[:, 0] + cosine * point[:, 1]], axis=1)
    reach = ((bodies["center"] + arm - tensioners["home"]) * tensioners["direction"]).sum(axis=1)
    dry = (tensioners["hydraulic"] == 0) & (tensioners["stiffness"] > 0.0)
    stiffness = np.where(tensioners["stiffness"] > 0.0, tensioners["stiffness"], 1.0)
    reach = np.where(dry, np.minimum(reach, tensioners["preload"] / stiffness), reach)
    return np.asarray(reach * (0.5 * tensioners["stiffness"] * reach - tensioners["preload"]))
