"""The registry of metrics: every column of a table of metrics, with its unit, its title and how it is formed.

A new metric is a row here; if it needs a sum of its own, also a field of that sum in `kernels/structs.py` and the
line of `kernels/sums.py` that adds to it. Names, units and kinds of the table, and the lists in `docs/metrics.md`,
go by the row.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpchain.drive.batch import Stack, stacks_of
from warpchain.drive.friction_coefficients import guide_rubbing, tooth_rubbing
from warpchain.drive.mounts import moves
from warpchain.drive.rings import rings_of
from warpchain.drive.trains import is_free
from warpchain.results.batch_means import ERROR
from warpchain.results.formulas import (
    THINGS,
    Values,
    deviation,
    displacement_std,
    error_of,
    filling_time,
    flowed,
    friction_power,
    impact_impulse,
    mean,
    peak_factor,
    per_revolution,
    rms,
    tension_quantile,
    tension_share_below,
    total,
)
from warpchain.results.resolution import joint_give, joint_resolution, partner_resolution, ramps

if TYPE_CHECKING:
    from warpchain.drive import Drive


@dataclass(frozen=True)
class Column:
    """One metric.

    Attributes:
        name: its own; the name of what it is of, and a dot, stand before it: `camshaft.speed_mean`.
        unit: SI unit, "1" for a count, ratio or flag.
        title: what it is, in words.
        value: forms it from what its group gives (`Summed`, `Balance` or `Judged`) of one variant or of many at once,
            masked where there is none (`formulas.where`); left out where the number comes from elsewhere.
        kind: float, int, bool or str.
        aside: says how good other metrics are, or more of the same: studies analyze it only where it is named.
    """

    name: str
    unit: str
    title: str
    value: Callable[[Any], Values] | None = None
    kind: type = float
    aside: bool = False


@dataclass(frozen=True)
class Group:
    """Columns of one kind of thing that are formed alike.

    Attributes:
        of: key of `THINGS`.
        columns: in the table's order.
        source: the field of `kernels.structs.Sums` that they are formed from, if it is one.
        weight: of rows of those sums, from the window's length [s] and the number of rollers; where 0, there is no such
            thing in the window.
        where: whether the drive's thing of this index has them; left out if every one has.
    """

    of: str
    columns: tuple[Column, ...]
    source: str = ""
    weight: Callable[[Any, Values, Values], Values] = lambda sums, duration, rollers: duration
    where: Callable[[Drive, int], bool] | None = None


def rubs_on(drive: Drive, index: int) -> bool:
    """Whether rollers rub on a partner."""
    sprockets = len(drive.sprockets)
    return (tooth_rubbing(drive) if index < sprockets else guide_rubbing(drive, index - sprockets)).rubs


QUANTILES = {"q001": 0.001, "q01": 0.01, "q50": 0.5, "q99": 0.99, "q999": 0.999}
"""Quantiles of link tension by what ends their names: the digits of the share after the point."""


@cache
def error_column(column: Column) -> Column:
    """The column of the standard error of a mean, one for each mean."""
    assert column.value is not None
    title = f"standard error of the {column.title}"
    return Column(f"{column.name}{ERROR}", column.unit, title, error_of(column.value), aside=True)


def with_errors(*columns: Column) -> tuple[Column, ...]:
    """Columns of one group of sums, each mean followed by its standard error."""
    found: list[Column] = []
    for column in columns:
        found += [column, error_column(column)] if column.name.endswith("_mean") else [column]
    return tuple(found)


TENSION_MIN = Column("tension_min", "N", "smallest link tension", total("tension_min"))
TENSION_MAX = Column("tension_max", "N", "largest link tension", total("tension_max"))
TENSION_MEAN = Column("tension_mean", "N", "mean link tension", mean("tension"))
TENSION_STD = Column("tension_std", "N", "standard deviation of link tension", deviation("tension"))
TENSION_QUANTILES = tuple(
    Column(
        f"tension_{name}",
        "N",
        f"tension that {100.0 * share:g} % of links and instants are below",
        tension_quantile(share),
        aside=name not in ("q001", "q999"),
    )
    for name, share in QUANTILES.items()
)
TENSION_SLACK = Column(
    "slack", "1", "share of links and instants without tension", tension_share_below(0.0), aside=True
)

MOMENT_MEAN = Column("moment_mean", "N m", "mean moment of the contact forces, counter-clockwise", mean("moment"))
FORCE_MAX = Column(
    "force_max", "N", "largest contact force on a roller; of a tensioner, its largest", total("force_max")
)
DAMPING_LOSS = Column("damping_loss", "J", "energy that its dampers and stops take", total("dissipated"))

CHAIN = Group(
    "chain",
    with_errors(TENSION_MIN, TENSION_MAX, TENSION_MEAN, TENSION_STD, *TENSION_QUANTILES, TENSION_SLACK),
    source="chain",
    weight=lambda sums, duration, rollers: sums["samples"] * rollers,
)
STRAND_TENSION = Group(
    "strand",
    with_errors(TENSION_MIN, TENSION_MEAN, TENSION_MAX, TENSION_STD, *TENSION_QUANTILES, TENSION_SLACK),
    source="strand",
    weight=lambda sums, duration, rollers: sums["links"],
)
STRAND_DISPLACEMENT = Group(
    "strand",
    with_errors(
        Column("displacement_min", "m", "smallest mid-strand displacement, left positive", total("displacement_min")),
        Column("displacement_mean", "m", "mean mid-strand displacement", mean("displacement")),
        Column("displacement_max", "m", "largest mid-strand displacement", total("displacement_max")),
        Column("displacement_rms", "m", "root mean square of the mid-strand displacement", rms("displacement")),
    ),
    source="strand",
    weight=lambda sums, duration, rollers: sums["samples"],
)
SPROCKET = Group(
    "sprocket",
    with_errors(
        Column("speed_min", "rad/s", "smallest angular velocity, counter-clockwise", total("speed_min")),
        Column("speed_mean", "rad/s", "mean angular velocity", mean("speed")),
        Column("speed_max", "rad/s", "largest angular velocity", total("speed_max")),
        Column("speed_std", "rad/s", "standard deviation of the angular velocity", deviation("speed")),
        MOMENT_MEAN,
        Column("hub_force_x_mean", "N", "mean force of the chain on the sprocket to the right", mean("force", 0)),
        Column("hub_force_y_mean", "N", "mean force of the chain on the sprocket upward", mean("force", 1)),
        Column("hub_force_max", "N", "largest force of the chain on the sprocket", total("force_max")),
    ),
    source="sprocket",
)
MOUNT = Group(
    "sprocket",
    with_errors(
        Column("travel_x_mean", "m", "mean displacement of the center to the right", mean("travel", 0)),
        Column("travel_y_mean", "m", "mean displacement of the center upward", mean("travel", 1)),
        Column("travel_max", "m", "largest distance of the center from where it is stated", total("travel_max")),
        Column("mount_force_mean", "N", "mean magnitude of what holds the center", mean("force")),
        Column("mount_dissipated", "J", "energy dissipated in the mount's damper", total("dissipated")),
    ),
    source="mount",
    where=lambda drive, index: moves(drive.sprockets[index]),
)
BEARING = Group(
    "sprocket",
    (Column("bearing_friction", "J", "energy dissipated by friction in its bearing", total("friction")),),
    source="mount",
    where=lambda drive, index: drive.sprockets[index].bearing is not None,
)
SLIP = Group(
    "sprocket",
    (Column("slips", "1", "teeth that the chain jumped", total("slips"), kind=int),),
    source="slip",
)
CONTACT = Group(
    "partner",
    (
        FORCE_MAX,
        Column("impacts", "1", "contacts that began", total("impacts"), kind=int),
        Column("impulse", "N s", "time integral of the contact forces", total("impulse")),
        Column("dissipated", "J", "energy dissipated in the contacts", total("dissipated")),
    ),
    source="contact",
)
FRICTION = Group(
    "partner",
    (Column("friction", "J", "energy dissipated by friction in the contacts", total("friction")),),
    source="contact",
    where=rubs_on,
)
TOUCHES = Group(
    "partner",
    (
        Column(
            "contacts",
            "1",
            "rollers that came into contact for the first time in their pass",
            total("contacts"),
            kind=int,
        ),
    ),
    source="contact",
    where=lambda drive, index: index < len(drive.sprockets),
)
MISSED = Group(
    "partner",
    (Column("missed", "1", "rollers in the bar that did not come through its face", total("missed"), kind=int),),
    source="contact",
    where=lambda drive, index: index >= len(drive.sprockets),
)
ARM = Group(
    "arm",
    (
        Column("angle_min", "rad", "smallest angle, counter-clockwise from the drawing", total("angle_min")),
        Column("angle_mean", "rad", "mean angle", mean("angle")),
        Column("angle_max", "rad", "largest angle", total("angle_max")),
        Column("angle_std", "rad", "standard deviation of the angle", deviation("angle")),
        MOMENT_MEAN,
        DAMPING_LOSS,
    ),
    source="arm",
)
PIVOT = Group(
    "arm",
    (Column("pivot_work", "J", "work done on it by what leads its pivot", total("work")),),
    source="arm",
    where=lambda drive, index: drive.arms[index].pivot_table is not None,
)
TENSIONER = Group(
    "tensioner",
    (
        Column("force_min", "N", "smallest force on its body", total("force_min")),
        Column("force_mean", "N", "mean force on its body", mean("force")),
        FORCE_MAX,
        Column("extension_min", "m", "smallest extension, from the drawing", total("extension_min")),
        Column("extension_mean", "m", "mean extension", mean("extension")),
        Column("extension_max", "m", "largest extension", total("extension_max")),
        DAMPING_LOSS,
    ),
    source="tensioner",
)
OIL = Group(
    "tensioner",
    (
        Column("pressure_min", "Pa", "smallest absolute pressure in the chamber", total("pressure_min")),
        Column("pressure_mean", "Pa", "mean absolute pressure in the chamber", mean("pressure")),
        Column("pressure_max", "Pa", "largest absolute pressure in the chamber", total("pressure_max")),
        Column("leaked", "m^3", "oil that leaked through the gap", flowed("leaked")),
        Column("supplied", "m^3", "oil that came in through the check valve", flowed("supplied")),
        Column("oil_loss", "J", "energy that gap and valves take", flowed("leak_loss", "valve_loss")),
        Column("supply_work", "J", "work of the oil supply", flowed("supply_work")),
        Column(
            "suction_work",
            "J",
            "work on its plunger where oil and spring would draw it back; one that stayed behind would have none",
            total("suction_work"),
        ),
    ),
    source="tensioner",
    where=lambda drive, index: drive.tensioners[index].hydraulic,
)
RELIEF = Group(
    "tensioner",
    (Column("relieved", "m^3", "oil that its relief valve let out", flowed("relieved")),),
    source="tensioner",
    where=lambda drive, index: drive.tensioners[index].relief is not None,
)
DRAINED = Group(
    "tensioner",
    (Column("filling_time", "s", "time until oil had filled its chamber; none where it has not", filling_time),),
    source="tensioner",
    where=lambda drive, index: drive.tensioners[index].drained,
)
VENT = Group(
    "tensioner",
    (Column("vented", "m^3", "oil that went out through its vent", flowed("vented")),),
    source="tensioner",
    where=lambda drive, index: drive.tensioners[index].vent is not None,
)
SPEEDS = ("speed_min", "speed_mean", "speed_max", "speed_std")
SHAFT = Group(
    "shaft",
    tuple(column for column in SPROCKET.columns if column.name in SPEEDS),
    source="shaft",
)
MOTOR = Group(
    "shaft",
    (
        Column("motor_moment_mean", "N m", "mean moment of its motor, counter-clockwise", mean("motor")),
        Column("motor_moment_max", "N m", "largest magnitude of that", total("motor_max")),
        Column("motor_work", "J", "work of its motor", total("motor_work")),
    ),
    source="shaft",
    where=lambda drive, index: drive.shafts[index].motor is not None,
)
TORQUE_MEAN = Column("torque_mean", "N m", "mean moment that it passes on to its second shaft", mean("moment"))
COUPLING = Group(
    "coupling",
    (
        Column("twist_min", "rad", "smallest twist", total("twist_min")),
        Column("twist_mean", "rad", "mean twist", mean("twist")),
        Column("twist_max", "rad", "largest twist", total("twist_max")),
        Column("torque_min", "N m", "smallest moment that it passes on", total("moment_min")),
        TORQUE_MEAN,
        Column("torque_max", "N m", "largest moment that it passes on", total("moment_max")),
        DAMPING_LOSS,
    ),
    source="coupling",
)
SLIPPING = Group(
    "coupling",
    (Column("slip_loss", "J", "energy lost as its clutch slips and its ratio changes", total("slip_loss")),),
    source="coupling",
    where=lambda drive, index: drive.couplings[index].slips,
)
GEAR = Group(
    "gear",
    (
        TORQUE_MEAN,
        Column("tooth_force_mean", "N", "mean magnitude of the force between its teeth", mean("force")),
        Column("tooth_force_max", "N", "largest magnitude of the force between its teeth", total("force_max")),
    ),
    source="gear",
)
VALVE = Group(
    "valve",
    (
        Column("cam_torque_min", "N m", "smallest moment against forward rotation", total("torque_min")),
        Column("cam_torque_mean", "N m", "mean moment against forward rotation", mean("torque")),
        Column("cam_torque_max", "N m", "largest moment against forward rotation", total("torque_max")),
        Column("cam_force_min", "N", "smallest force of a cam on its follower", total("force_min")),
        Column("valve_float", "1", "share of time for which a follower would lift off its cam", mean("afloat")),
    ),
    source="valve",
)
JOINTS = Group(
    "chain",
    (Column("joints.friction", "J", "energy dissipated by friction in the joints", total("friction")),),
    source="chain",
    where=lambda drive, index: drive.chain.rubs,
)
BALANCE = Group(
    "chain",
    (
        Column("input_work", "J", "work of what prescribes angles and centers", lambda balance: balance.input),
        Column("output_work", "J", "work against the loads", lambda balance: balance.output),
        Column(
            "efficiency",
            "1",
            "output work over itself and the losses",
            lambda balance: balance.efficiency,
        ),
        Column("links.dissipated", "J", "energy dissipated in the links", lambda balance: balance.links),
        Column("energy_change", "J", "change of the mechanical energy", lambda balance: balance.change),
        Column("energy_change_relative", "1", "that change over the losses", lambda balance: balance.relative_change),
        Column("energy_residual", "J", "what the energy balance misses", lambda balance: balance.residual),
        Column(
            "energy_residual_relative", "1", "residual over the energy turned over", lambda balance: balance.relative
        ),
    ),
)
STEADY = Group(
    "chain",
    (
        Column("tension_drift", "N", "change of the mean tension over the window", lambda of: of.change, aside=True),
        Column("tension_drift_p", "1", "probability of such a change by chance", lambda of: of.chance, aside=True),
        Column("steady", "1", "whether neither tension nor speeds drift", lambda of: of.steady, bool, aside=True),
    ),
)
PEAK_FACTOR = Column("peak_factor", "1", "largest over mean tension", peak_factor)
PER_REVOLUTION = Column(
    "contact_energy_per_revolution",
    "J",
    "wear index: energy that contacts dissipate in a revolution of the driver",
    per_revolution,
)
VIBRATION = Column("displacement_std", "m", "vibration: deviation of the displacement from its mean", displacement_std)
NOISE = Column(
    "impact_impulse",
    "N s",
    "noise proxy: sqrt(2 m E), the blow that would lose the energy E which a tooth passing loses",
    impact_impulse,
)
RESOLVED = (
    Group(
        "chain",
        (
            Column(
                "joints.resolution",
                "1",
                "steps in which friction bends a joint by a tooth",
                joint_resolution,
                aside=True,
            ),
        ),
        where=lambda drive, index: drive.chain.rubs,
    ),
    Group(
        "strand",
        (
            Column(
                "joint_give",
                "1",
                "tension that the give of joints that stick stands for, over `tension_q999`",
                joint_give,
                aside=True,
            ),
        ),
        where=lambda drive, index: drive.chain.rubs,
    ),
    Group(
        "partner",
        (
            Column(
                "resolution",
                "1",
                "steps in which friction moves a roller by a pitch, or in its ramp, where these are fewer",
                partner_resolution,
                aside=True,
            ),
        ),
        where=lambda drive, index: rubs_on(drive, index) or ramps(drive, index),
    ),
)
RUBBED = Group(
    "chain",
    (Column("friction_power", "W", "power that friction takes in joints, on teeth and on guide-bars", friction_power),),
    where=lambda drive, index: (
        drive.chain.rubs or any(rubs_on(drive, k) for k in range(len(drive.sprockets) + len(drive.guides)))
    ),
)
RUN = Group(
    "chain",
    (
        Column("variant", "1", "number of the variant", kind=int),
        Column("status", "1", 'what it is judged to be: "ok", "suspect" or "diverged"', kind=str),
        Column("reason", "1", 'why it is not ok, "" where it is', kind=str),
        Column("diverged", "1", "whether the variant was stopped as diverged", kind=bool),
        Column("diverged_time", "s", "when it diverged"),
        Column("window_start", "s", "start of the window that metrics are taken over"),
        Column("window_end", "s", "its end"),
    ),
)
ENGAGED = Group(
    "sprocket",
    (Column("engaged", "1", "rollers on its teeth at the end of the run, over those at assembly"),),
)
SETTLING = Group(
    "chain",
    (
        Column("settle_steps", "1", "steps that settling took", kind=int),
        Column("settle_residual", "1", "largest net force left on a roller over the largest link force"),
        Column("settle_force", "N", "largest net force left on a roller"),
    ),
    where=lambda drive, index: drive.run.settle,
)
RECORDED = (
    Group(
        "sprocket",
        (
            Column("transmission_error_rms", "rad", "transmission error: root mean square of what the angle misses"),
            Column("transmission_error_range", "rad", "transmission error: from its smallest to its largest"),
            Column("engagement_impulse", "N s", "mean impulse of a roller's first touch, over 2 pi sqrt(m/K)"),
        ),
    ),
    Group(
        "chain",
        (
            Column("damage_per_hour_max", "1/h", "Miner damage of the worst link an hour"),
            Column("damage_per_hour_mean", "1/h", "Miner damage of the mean link an hour"),
            Column("tension_equivalent_range", "N", "range that does the worst link's damage, once a chain revolution"),
        ),
    ),
)
"""Columns of recorded variants only (`results.objectives`)."""
REPORTED = (
    Group(
        "strand",
        (Column("slack_time", "1", "share of time that its middle carries no tension"),),
    ),
    Group(
        "sprocket",
        (
            Column("phase_mean", "rad", "mean phase error, in angle of the driver; below 0 where it lags"),
            Column("phase_range", "rad", "phase error from its smallest to its largest, in angle of the driver"),
            Column("jump_margin", "m", "what the roller nearest to jumping still had to climb"),
            Column("jump_margin_relative", "1", "the same over the whole climb; 0 where the chain jumps"),
        ),
    ),
    Group(
        "partner",
        (
            Column("line_load_max", "N/m", "largest mean force per length of the face"),
            Column("pv_max", "W/m", "largest mean of force times sliding speed, per length of the face"),
            Column("sliding_speed", "m/s", "mean speed of the chain along the face, weighted by force"),
            Column("off_time", "1", "share of time that no roller presses the guide"),
        ),
        where=lambda drive, index: index >= len(drive.sprockets),
    ),
    Group(
        "chain",
        (
            Column("joints.sliding_speed", "m/s", "sliding distance of a joint over time"),
            Column("joints.loaded_sliding", "W", "force times sliding speed of a joint, mean of all"),
            Column("joints.friction_each", "W", "friction power of a joint, mean of all"),
            Column("elongation_per_hour", "1/h", "elongation of the chain by wear of its joints"),
        ),
    ),
    Group(
        "probe",
        (
            Column("tension_mean", "N", "mean tension of the chain that passes"),
            Column("tension_max", "N", "its largest tension"),
            Column("speed_mean", "m/s", "mean speed of the chain along itself"),
            Column("displacement_mean", "m", "mean place of the chain, to the left of the probe"),
            Column("displacement_std", "m", "its standard deviation"),
        ),
    ),
)
"""Columns of recorded variants by `results.engineering_report`, and of reports."""

MEASURED = (
    (CHAIN,),
    (STRAND_TENSION, STRAND_DISPLACEMENT),
    (SPROCKET, MOUNT, BEARING, SLIP),
    (CONTACT, FRICTION, TOUCHES, MISSED),
    (ARM, PIVOT),
    (TENSIONER, OIL, RELIEF, VENT, DRAINED),
    (SHAFT, MOTOR),
    (COUPLING, SLIPPING),
    (GEAR,),
    (VALVE,),
    (JOINTS,),
)
"""Columns formed of the window's sums. Groups in one tuple go thing by thing: all of one, then all of the next."""
DESIGN = (
    (Group("chain", (PEAK_FACTOR,)),),
    (RUBBED,),
    (Group("strand", (PEAK_FACTOR, VIBRATION)),),
    (Group("partner", (PER_REVOLUTION,)),),
    (Group("chain", (PER_REVOLUTION,)),),
    (Group("sprocket", (NOISE,)),),
    *((group,) for group in RESOLVED),
)
"""Columns that designs are judged by, formed from the other metrics."""

Blocks = tuple[tuple[Group, ...], ...]
METRICS: Blocks = (*MEASURED, (STEADY,), (BALANCE,), *DESIGN, (ENGAGED,), (SETTLING,))
"""The metrics of a variant that ran to its end, in the table's order."""
OF_MODES = (
    Column("frequency", "Hz", "natural frequency of a mode of the base drive, found again by its shape"),
    Column("damping_ratio", "1", "damping ratio of that mode"),
)
"""Columns of modes that studies can ask for (`modes.NAME.frequency`)."""
COLUMNS = {c.name: c for groups in (REPORTED, *METRICS, (RUN,), RECORDED) for group in groups for c in group.columns}
COLUMNS |= {c.name: c for c in OF_MODES}
"""Every column by its own name."""


def of_drive(drive: Drive, blocks: Blocks = METRICS) -> Iterator[tuple[str, int, Group]]:
    """The groups that a drive has, in order: what stands before their names, the thing's index, the group."""
    for groups in blocks:
        for index, prefix in enumerate(THINGS[groups[0].of](drive)):
            for group in groups:
                if group.where is None or group.where(drive, index):
                    yield prefix, index, group


OF_A_CHAIN = ("chain", "strand")
"""Things whose metrics begin with their chain's name where there are several."""
OF_LINKS = ("links.dissipated",)
"""Columns of the energy balance that chains have, too."""

SOME = tuple(group for groups in METRICS for group in groups if group.where is not None)
"""The groups that only some things have."""


def _kind(drive: Drive) -> Hashable:
    """A key of the columns that a drive has, of the terms of its energy balance, and of the sprocket that drives."""
    if drive.chains:
        return tuple((ring.name, _kind(ring.drive)) for ring in rings_of(drive))
    has = (group.where(drive, i) for group in SOME for i in range(len(THINGS[group.of](drive))) if group.where)
    sprockets = ((sprocket.name, is_free(drive, s)) for s, sprocket in enumerate(drive.sprockets))
    trains = (part.name for parts in (drive.shafts, drive.couplings, drive.gears, drive.valves) for part in parts)
    bodies = (*(arm.name for arm in drive.arms), None, *(tensioner.name for tensioner in drive.tensioners))
    names = (*sprockets, None, *(guide.name for guide in drive.guides), None, *bodies, None, *trains)
    return (drive.driver, *names, None, *has)


def same_columns(drives: Sequence[Drive], stacks: Sequence[Stack] | None = None) -> list[NDArray[np.int64]]:
    """Numbers of the drives that have the same columns, formed alike, kind by kind; a stack's all have the same.

    Args:
        drives: the drives.
        stacks: them sorted into stacks, where they are.
    """
    kinds: dict[Hashable, list[NDArray[np.int64]]] = {}
    for stack in stacks_of(drives) if stacks is None else stacks:
        kinds.setdefault(_kind(drives[int(stack.members[0])]), []).append(stack.members)
    return [np.sort(np.concatenate(numbers)) for numbers in kinds.values()]


def metric_names(drive: Drive) -> list[str]:
    """Names of the metrics that a drive has."""
    if drive.chains:
        return _names_of_chains(drive)
    return [prefix + column.name for prefix, _, group in of_drive(drive) for column in group.columns]


def table_names(drive: Drive) -> list[str]:
    """Names of all columns of the metrics of a run of a drive, in the table's order."""
    return [*(column.name for column in RUN.columns), *metric_names(drive)]


def _names_of_chains(drive: Drive) -> list[str]:
    """Names of the metrics of a drive with several chains (`results.metrics.metrics_of_chains`)."""
    found = []
    for ring in rings_of(drive):
        for prefix, _, group in of_drive(ring.drive):
            before = f"{ring.name}.{prefix}" if group.of in OF_A_CHAIN else prefix
            columns = [c for c in group.columns if group is not BALANCE or c.name in OF_LINKS]
            found += [before + column.name for column in columns]
    return [*found, *(column.name for column in BALANCE.columns), "steady"]


def column_of(name: str) -> Column | None:
    """The registry's row of a table's column, None for a column of other origin."""
    return COLUMNS.get(name) or COLUMNS.get(name.rsplit(".", 1)[-1])


def unit_of(name: str) -> str:
    """Unit of a metric's column, "1" for a count, ratio or flag."""
    column = column_of(name)
    return column.unit if column else "1"


def title_of(name: str) -> str:
    """A metric's column in words: "camshaft: mean angular velocity"; its name for a column of other origin."""
    column = column_of(name)
    if column is None:
        return name
    prefix = name.removesuffix(column.name).removesuffix(".")
    return f"{prefix}: {column.title}" if prefix else column.title
