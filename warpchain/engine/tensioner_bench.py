"""Test rig for tensioners: imposes sines on the plunger; returns force and pressure, as on a shaker."""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpchain.argument_checks import check_arguments
from warpchain.drive import Drive
from warpchain.drive.tensioners import Tensioner as TensionerPart
from warpchain.engine.body_struct_rows import fill_tensioner_element
from warpchain.engine.simulation import available_cores
from warpchain.errors import DriveError, SimulationError
from warpchain.kernels.cpu.rig import SAMPLE_COLUMNS, Ride, RideSums, shake_plungers
from warpchain.kernels.structs import Tensioner
from warpchain.model import ChainModel, Model
from warpchain.progress import Progress, progress_reporter
from warpchain.results.arrow_tables import table_with_units

if TYPE_CHECKING:
    import pyarrow as pa

SAMPLED_STEPS, SAMPLES_PER_CYCLE = 10_000, 500
"""Steps and samples of a tensioner rig's cycle."""
SWEEP_STEPS = 2_500
"""Steps of a rig's cycle without samples."""
MOST_CYCLES = 10_000
"""Most cycles of a ride, and of all sampled rides."""
FARTHEST = 1.0
"""Most amplitude and extension of a plunger [m]."""
SLOWEST, FASTEST = 1e-4, 1e5
"""Allowed frequencies of a rig [Hz]."""
THINNEST, THICKEST = 1e-8, 20.0
"""Allowed kinematic viscosities of oil [m^2/s]."""

SAMPLE_UNITS = {
    "time": "s", "extension": "m", "force": "N", "pressure": "Pa", "valve_lift": "m", "leaked": "m^3",
    "supplied": "m^3",
}  # fmt: skip
RIDE_UNITS = {
    "frequency": "Hz", "amplitude": "m", "extension": "m", "viscosity": "m^2/s",
    "force_min": "N", "force_max": "N", "pressure_min": "Pa", "pressure_max": "Pa", "lift_max": "m", "openings": "1",
    "leaked": "m^3", "supplied": "m^3", "relieved": "m^3", "vented": "m^3", "work": "J", "supply_work": "J",
    "leak_loss": "J", "valve_loss": "J", "damper_loss": "J", "suction_work": "J", "gained": "J",
    "vapor": "1",
}  # fmt: skip


@dataclass(frozen=True)
class PlungerMotion:
    """Sine that one ride imposes on a tensioner's plunger."""

    amplitude: float  # [m]
    frequency: float  # [Hz]
    extension: float = 0.0  # about which it swings [m]
    viscosity: float | None = None  # kinematic, in place of the tensioner's own [m^2/s]


@dataclass(frozen=True)
class RideTables:
    """Tables of rides of a tensioner."""

    rides: pa.Table  # a row each, with the columns of `RIDE_UNITS`
    samples: tuple[pa.Table, ...]  # a table a ride with the columns of `SAMPLE_UNITS`, or ()


@check_arguments(SimulationError)
def bench_tensioner(
    drive: Drive, name: str, *, amplitude: float, frequency: float, cycles: int = 10, extension: float = 0.0
) -> pa.Table:
    """Table of a tensioner's response to a sine, from rest.

    The force is of spring, oil and stops, without the plunger's inertia.

    Args:
        name: the tensioner's.
        amplitude: [m].
        frequency: [Hz].
        extension: about which it swings [m], 0 as drawn.

    Returns:
        A table with 500 rows a cycle and one more: time [s], extension [m], force [N], pressure [Pa], valve_lift [m],
        leaked and supplied since the start [m^3].

    Raises:
        DriveError: no such tensioner.
        SimulationError: an amplitude, frequency, number of cycles or extension that cannot be run.
    """
    return shake_tensioner(drive, name, [PlungerMotion(amplitude, frequency, extension)], cycles, samples=True).samples[
        0
    ]


def shake_tensioner(
    drive: Drive, name: str, shakes: Sequence[PlungerMotion], cycles: int = 10, samples: bool = False,
    progress: Progress = False,
) -> RideTables:  # fmt: skip
    """Tables of a tensioner's rides of many sines.

    Args:
        samples: whether to keep samples.
        progress: True shows a bar; a function gets ("rides", done, total).

    Raises:
        DriveError, SimulationError: as `bench_tensioner`.
    """
    tensioner = tensioner_by_name(drive, name)
    for one in shakes:
        _check_motion(tensioner, one, cycles)
    if samples and len(shakes) * cycles > MOST_CYCLES:
        text = f"{len(shakes)} rides of {cycles} cycles: must be {MOST_CYCLES} cycles together at most"
        raise SimulationError(text)
    pushed = next(model for model in Model(drive).chains if tensioner in model.tensioners)
    rides, rows = _struct_rows(pushed, tensioner, shakes, cycles, samples)
    count = cycles * SAMPLES_PER_CYCLE + 1 if samples else 1
    values = wp.zeros((len(shakes), count, len(SAMPLE_COLUMNS)), dtype=wp.float64, device="cpu")
    sums = wp.zeros(len(shakes), dtype=RideSums, device="cpu")
    given: list[Any] = [wp.array(rides, dtype=Ride, device="cpu"), wp.array(rows, dtype=Tensioner, device="cpu")]
    wp.load_module(shake_plungers.module, device="cpu")  # before any thread launches it

    def ride(first: int) -> None:
        """Shakes the plunger of one ride."""
        wp.launch(shake_plungers, dim=1, inputs=[*given, first, values, sums], device="cpu")

    with (
        ThreadPoolExecutor(available_cores(), thread_name_prefix="warpchain") as pool,
        progress_reporter(progress) as report,
    ):
        for done, _ in enumerate(pool.map(ride, range(len(shakes))), 1):
            report("rides", done, len(shakes))
    table = _ride_table(tensioner, shakes, sums.numpy())
    if not samples:
        return RideTables(table, ())
    return RideTables(table, tuple(map(_sample_table, shakes, values.numpy())))


def tensioner_by_name(drive: Drive, name: str) -> TensionerPart:
    """Tensioner by name, or DriveError with all names."""
    for tensioner in drive.tensioners:
        if tensioner.name == name:
            return tensioner
    known = ", ".join(tensioner.name for tensioner in drive.tensioners)
    raise DriveError(f"tensioner {name!r}: " + (f"allowed are {known}" if known else "the drive has no tensioners"))


def _check_motion(tensioner: TensionerPart, one: PlungerMotion, cycles: int) -> None:
    """Raises SimulationError for a plunger motion that cannot be run."""
    if not 0.0 < one.amplitude <= FARTHEST:
        raise SimulationError(f"amplitude = {one.amplitude:g}: must be a number above 0, at most {FARTHEST:g} m")
    if not SLOWEST <= one.frequency <= FASTEST:
        raise SimulationError(f"frequency = {one.frequency:g}: must be from {SLOWEST:g} to {FASTEST:g} Hz")
    if not 1 <= cycles <= MOST_CYCLES:
        raise SimulationError(f"cycles = {cycles}: must be 1 to {MOST_CYCLES}")
    if not abs(one.extension) <= FARTHEST:
        raise SimulationError(f"extension = {one.extension:g}: must be a number from {-FARTHEST:g} to {FARTHEST:g} m")
    if one.viscosity is not None and not tensioner.hydraulic:
        raise SimulationError(f"viscosity = {one.viscosity:g}: tensioner {tensioner.name!r} has no oil")
    if one.viscosity is not None and not THINNEST <= one.viscosity <= THICKEST:
        raise SimulationError(f"viscosity = {one.viscosity:g}: must be from {THINNEST:g} to {THICKEST:g} m^2/s")
    if tensioner.chamber is not None:
        deepest = tensioner.chamber.volume / tensioner.area
        if one.amplitude - one.extension >= deepest:
            text = f"the plunger must stay above the bottom of its chamber, {-deepest:g} m from where it is drawn"
            raise SimulationError(f"amplitude = {one.amplitude:g}, extension = {one.extension:g}: {text}")


def _struct_rows(
    model: ChainModel, tensioner: TensionerPart, shakes: Sequence[PlungerMotion], cycles: int, samples: bool
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Rows of `Ride` and `structs.Tensioner` for a tensioner's rides."""
    rides = np.zeros(len(shakes), dtype=Ride.numpy_dtype())
    rows = np.zeros(len(shakes), dtype=Tensioner.numpy_dtype())
    for ride, row, one in zip(rides, rows, shakes, strict=True):
        ride["center"], ride["amplitude"] = one.extension, one.amplitude
        steps = SAMPLED_STEPS if samples else SWEEP_STEPS
        ride["step"] = 1.0 / (one.frequency * steps)
        ride["cycle"], ride["cycles"] = steps, cycles
        ride["every"] = steps // SAMPLES_PER_CYCLE if samples else 0
        fill_tensioner_element(row, model, tensioner_with_viscosity(tensioner, one.viscosity))
    return rides, rows


def tensioner_with_viscosity(tensioner: TensionerPart, viscosity: float | None) -> TensionerPart:
    """Tensioner with another oil viscosity [m^2/s], None: its own."""
    if viscosity is None:
        return tensioner
    assert tensioner.oil is not None
    return tensioner.model_copy(update={"oil": tensioner.oil.model_copy(update={"viscosity": viscosity})})


def _ride_table(tensioner: TensionerPart, shakes: Sequence[PlungerMotion], sums: NDArray[Any]) -> pa.Table:
    """Table of a tensioner's rides from their sums."""
    own = math.nan if tensioner.oil is None else tensioner.oil.viscosity
    given = {
        "frequency": [one.frequency for one in shakes],
        "amplitude": [one.amplitude for one in shakes],
        "extension": [one.extension for one in shakes],
        "viscosity": [own if one.viscosity is None else one.viscosity for one in shakes],
    }
    flows: Any = sums["flows"]
    summed = {name: (flows if name in flows.dtype.names else sums)[name] for name in RIDE_UNITS if name not in given}
    return _unit_table(given | summed, RIDE_UNITS)


def _sample_table(one: PlungerMotion, values: NDArray[np.float64]) -> pa.Table:
    """Table of the samples of a tensioner's ride."""
    time = np.arange(len(values)) / (one.frequency * SAMPLES_PER_CYCLE)
    return _unit_table({"time": time} | dict(zip(SAMPLE_COLUMNS, values.T, strict=True)), SAMPLE_UNITS)


def _unit_table(columns: dict[str, Any], units: dict[str, str]) -> pa.Table:
    """Table of a tensioner's columns, units as metadata."""
    import pyarrow as pa

    return table_with_units({name: pa.array(np.ascontiguousarray(columns[name])) for name in units}, units)
