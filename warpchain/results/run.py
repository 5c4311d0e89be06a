"""Recording options and results of a run: trajectories of chosen variants and a row of metrics a variant."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from warpchain.argument_checks import Index, PositiveNumber, check_arguments
from warpchain.errors import SimulationError
from warpchain.model import ChainModel, single_chain
from warpchain.notebook_renderer import rendered_html
from warpchain.results.channels import CHANNEL_NAMES, DEFAULT_CHANNELS
from warpchain.results.judgement import MOST_NAMED, OK
from warpchain.results.replicate_metrics import COPY_COLUMN, DRIVE_COLUMN, summarize_copies

if TYPE_CHECKING:
    import pyarrow as pa
    import xarray as xr

    from warpchain.drive import Drive


def check_channel_names(what: str, names: Iterable[str]) -> None:
    """Raises SimulationError for unknown names of channels."""
    for name in names:
        if name not in CHANNEL_NAMES:
            raise SimulationError(f"{what}: {name!r} is unknown; allowed are {', '.join(CHANNEL_NAMES)}")


@check_arguments(SimulationError, "record.")
@dataclass(frozen=True)
class Record:
    """Recording options: variants, rate and channels kept as trajectories.

    Attributes:
        variants: "all", "none", or indices of variants.
        rate: samples a second [Hz]; None takes each drive's `run.sample_rate`.
        channels: of `results.channels.CHANNEL_NAMES`.

    Raises:
        SimulationError: an unknown channel or word, or a rate that is not positive.
    """

    variants: Literal["all", "none"] | Sequence[Index] = "all"
    rate: PositiveNumber | None = None
    channels: Sequence[str] = DEFAULT_CHANNELS

    def __post_init__(self) -> None:
        check_channel_names("record.channels", self.channels)

    @check_arguments(SimulationError)
    def indices(self, variants: Index) -> tuple[int, ...]:
        """Numbers of recorded variants out of `variants`, ascending."""
        if isinstance(self.variants, str):
            return tuple(range(variants)) if self.variants == "all" else ()
        chosen = sorted({int(index) for index in self.variants})
        if chosen and chosen[-1] >= variants:
            raise SimulationError(f"record.variants: {chosen[-1]} is not among the {variants} variants (from 0)")
        return tuple(chosen)


def _add_channel_fields(kind: type) -> type:
    """Class with a dataclass field for each channel."""
    for name in CHANNEL_NAMES:
        if name not in kind.__annotations__:
            kind.__annotations__[name] = "NDArray[np.floating] | None"
            setattr(kind, name, None)
    return kind


@dataclass(frozen=True)
@_add_channel_fields
class Trajectory:
    """Trajectory: recorded motion of one variant over F frames.

    Attributes:
        drive: the simulated drive.
        time: (F,) [s]; frame 0 is t = 0.
        position: (F, N, 2) of rollers [m].
        velocity: (F, N, 2) of rollers [m/s].
        tension: (F, N) of links [N]; link i joins rollers i and i + 1 (2).
        sprocket_force: (F, N) of sprockets on rollers [N] (15).
        guide_force: (F, N) of guides on rollers [N] (15), (23).
        sprocket_angle: (F, S) counter-clockwise [rad].
        sprocket_speed: (F, S) counter-clockwise [rad/s].
        sprocket_moment: (F, S) of contact forces, counter-clockwise [N m] (16).
        sprocket_center: (F, S, 2) [m].
        joint_friction_power: (F, N) dissipated in joints [W]; with leapfrog sometimes below 0. On request.
        arm_angle: (F, A) from the drawing, counter-clockwise [rad].
        arm_speed: (F, A) [rad/s].
        arm_moment: (F, A) of contact forces about pivots [N m].
        tensioner_extension: (F, T) from the drawing [m].
        tensioner_force: (F, T) on the bodies that they push [N].
        chamber_pressure: (F, T) absolute [Pa].
        shaft_angle: (F, H) since the start, counter-clockwise [rad].
        shaft_speed: (F, H) counter-clockwise [rad/s].
        coupling_twist: (F, C) since the start [rad].
        coupling_torque: (F, C) on second shafts [N m].
        hub_force: (F, S, 2) of the chain on sprockets, with friction [N]. On request.
        valve_torque: (F, V) of valve groups against forward rotation [N m].
        valve_force: (F, V) least of a group's cams [N].
        window: of the metrics, (from, to) [s]; or None.
        chain: the one chain whose parts the channels are of; None where they are the whole drive's.
    """

    drive: Drive
    time: NDArray[np.float64]
    position: NDArray[np.floating] | None = None
    velocity: NDArray[np.floating] | None = None
    tension: NDArray[np.floating] | None = None
    sprocket_force: NDArray[np.floating] | None = None
    guide_force: NDArray[np.floating] | None = None
    sprocket_angle: NDArray[np.floating] | None = None
    sprocket_speed: NDArray[np.floating] | None = None
    sprocket_moment: NDArray[np.floating] | None = None
    sprocket_center: NDArray[np.floating] | None = None
    joint_friction_power: NDArray[np.floating] | None = None
    arm_angle: NDArray[np.floating] | None = None
    arm_speed: NDArray[np.floating] | None = None
    arm_moment: NDArray[np.floating] | None = None
    tensioner_extension: NDArray[np.floating] | None = None
    tensioner_force: NDArray[np.floating] | None = None
    chamber_pressure: NDArray[np.floating] | None = None
    shaft_angle: NDArray[np.floating] | None = None
    shaft_speed: NDArray[np.floating] | None = None
    coupling_twist: NDArray[np.floating] | None = None
    coupling_torque: NDArray[np.floating] | None = None
    hub_force: NDArray[np.floating] | None = None
    valve_torque: NDArray[np.floating] | None = None
    valve_force: NDArray[np.floating] | None = None
    window: Any = None  # of any type to mypy, so that channels may be given as **mapping
    chain: Any = None

    @property
    def parts(self) -> Drive | ChainModel:
        """Parts that channels are of: a drive's, or a chain's."""
        return self.drive if self.chain is None else self.chain

    @property
    def model(self) -> ChainModel:
        """Model of the one chain that the trajectory is of.

        Raises:
            DriveError: of a drive of several.
        """
        return single_chain(self.parts)

    def __repr__(self) -> str:
        """Line on the trajectory: frames, time, channels."""
        end = f"{self.time[0]:g} to {self.time[-1]:g} s" if len(self.time) else "none"
        return f"Trajectory({len(self.time)} frames, {end}: {', '.join(self.channels())})"

    def _repr_html_(self) -> str:
        """HTML of the trajectory for notebooks."""
        return rendered_html(self)

    def channels(self) -> dict[str, NDArray[np.floating]]:
        """Recorded channels of the trajectory by name, without time."""
        held = {name: getattr(self, name) for name in CHANNEL_NAMES}
        return {name: values for name, values in held.items() if values is not None}

    @check_arguments(SimulationError)
    def at(self, frames: slice | Sequence[int] | NDArray[Any]) -> Trajectory:
        """Trajectory at some of its frames.

        Raises:
            SimulationError: a frame that there is not.
        """
        try:
            self.time[frames]
        except (IndexError, TypeError) as error:
            raise SimulationError(f"frames of a trajectory of {len(self.time)}: {error}") from None
        held: dict[str, Any] = {name: values[frames] for name, values in self.channels().items()}
        return replace(self, time=self.time[frames], **held)

    def to_arrow(self) -> pa.Table:
        """Pyarrow table of the trajectory, a row a frame."""
        from warpchain.results.arrow_tables import trajectory_table

        return trajectory_table(self.time, self.channels())

    def to_xarray(self) -> xr.Dataset:
        """Xarray dataset (extra `xarray`) of the trajectory."""
        from warpchain.results.arrow_tables import trajectory_dataset

        return trajectory_dataset(self.time, self.channels(), self.parts)


def require_channels(
    trajectory: Trajectory, *channels: str, name: str = "the variant"
) -> tuple[NDArray[np.floating], ...]:
    """Channels of a trajectory by name, in order.

    Raises:
        SimulationError: naming those that are missing.
    """
    missing = [channel for channel in channels if getattr(trajectory, channel) is None]
    if missing:
        raise SimulationError(f"{name} was recorded without {', '.join(missing)}, which this needs")
    return tuple(getattr(trajectory, channel) for channel in channels)


@dataclass(frozen=True)
class RunInfo:
    """Provenance of a run: version, device, precision, time.

    Attributes:
        ended: "complete", or "interrupted" by the user.
        wall_time: [s].
        created: UTC time of the start, ISO 8601.
        step: [s]; None where variants differ.
        seed: of the variants' design.
        choice: why it ran on that device.
        plugins: names and SHA-256 digests of plug-ins, if any.
    """

    version: str
    device: str
    precision: str
    ended: str = "complete"
    wall_time: float = 0.0
    created: str = ""
    step: float | None = None
    seed: int | None = None
    choice: str | None = None
    plugins: str | None = None


@dataclass(frozen=True)
class Run(Mapping[int, Trajectory]):
    """Result of `simulate`: `run[i]` a trajectory, `run.metrics` a table.

    Attributes:
        drives: the drives simulated, in order.
        metrics: pyarrow table, `unit` in the fields' metadata; null where a variant lacks a quantity.
        trajectories: of recorded variants.
        info: how the run was made.
    """

    drives: Sequence[Drive]
    metrics: pa.Table
    trajectories: Mapping[int, Trajectory] = field(repr=False)
    info: RunInfo

    def __repr__(self) -> str:
        """Line on the run: variants, device, time."""
        shape = f"{len(self.drives)} variants, {len(self)} recorded, {self.metrics.num_columns} metrics"
        return f"{type(self).__name__}({shape}, {self.info.device}, {self.info.precision}, {self.info.ended})"

    def _repr_html_(self) -> str:
        """HTML of the run for notebooks."""
        return rendered_html(self)

    @property
    def numbers(self) -> Sequence[int]:
        """Numbers of the run's variants."""
        return getattr(self.trajectories, "numbers", range(len(self.drives)))

    @check_arguments(SimulationError)
    def row_of(self, variant: int) -> int:
        """Row of a variant in the run's metrics.

        Raises:
            SimulationError: no such variant.
        """
        if variant not in self.numbers:
            held = ", ".join(map(str, self.numbers[:MOST_NAMED])) + (", ..." if len(self.numbers) > MOST_NAMED else "")
            raise SimulationError(f"variant {variant}: not in this run, whose {len(self.numbers)} are {held}")
        return self.numbers.index(variant)

    @property
    def ok(self) -> NDArray[np.bool_]:
        """(V,) whether the run's variants are ok."""
        if "status" not in self.metrics.column_names:
            return np.ones(len(self.drives), dtype=bool)
        return np.array([word == OK for word in self.metrics["status"].to_pylist()], dtype=bool)

    @property
    def replicates(self) -> int:
        """Number of copies of each drive in the run."""
        if COPY_COLUMN not in self.metrics.column_names or not self.metrics.num_rows:
            return 1
        return 1 + max(self.metrics[COPY_COLUMN].to_pylist())

    @property
    def summary(self) -> pa.Table:
        """Pyarrow table of means over copies, a row a drive.

        Errors are `METRIC_se`, the number of copies is `n` (`results.replicate_metrics`).
        """
        import pyarrow as pa

        table = self.metrics
        if DRIVE_COLUMN not in table.column_names:
            table = table.append_column(pa.field(DRIVE_COLUMN, pa.int64(), metadata={"unit": "1"}), table["variant"])
        return summarize_copies(table, DRIVE_COLUMN)

    @check_arguments(SimulationError)
    def __getitem__(self, variant: int) -> Trajectory:
        try:
            return self.trajectories[variant]
        except KeyError:
            recorded = ", ".join(map(str, self.trajectories)) or "none"
            raise SimulationError(f"variant {variant} was not recorded (recorded: {recorded})") from None

    @property
    def first(self) -> int:
        """Number of the run's first recorded variant.

        Raises:
            SimulationError: none was recorded.
        """
        for variant in self.trajectories:
            return variant
        raise SimulationError("no variant was recorded: nothing to draw or export")

    def __contains__(self, variant: object) -> bool:
        return variant in self.trajectories

    def __iter__(self) -> Iterator[int]:
        return iter(self.trajectories)

    def __len__(self) -> int:
        return len(self.trajectories)
