"""Registry of metrics: every column of a metrics table, with its unit, title and formula."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from operator import attrgetter
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpchain.drive.plugins import load_installed_plugins
from warpchain.model import Model
from warpchain.model.friction_coefficients import has_partner_friction
from warpchain.model.mounts import has_moving_center
from warpchain.model.power_rating import size_rating
from warpchain.model.stacks import Stack, stacks_of_drives
from warpchain.model.trains import is_free_body
from warpchain.results.metric_formulas import (
    Column,
    VariantValues,
    chamber_filling_time,
    contact_energy_per_revolution,
    deviation_of,
    displacement_std,
    flow_of,
    impact_impulse,
    mean_of,
    peak_factor,
    rated_use,
    rms_of,
    standard_error_of,
    sum_of,
    tension_quantile_of,
    tension_share_below_value,
    total_friction_power,
)
from warpchain.results.step_resolution import is_ramped, joint_give, joint_resolution, partner_resolution
from warpchain.results.window_statistics import ERROR_SUFFIX

if TYPE_CHECKING:
    from warpchain.drive import Drive
    from warpchain.model import ChainModel


PART_LISTS = {
    "sprocket": ("sprockets",),
    "partner": ("sprockets", "guides"),
    "arm": ("arms",),
    "tensioner": ("tensioners",),
    "shaft": ("own_shafts",),
    "coupling": ("couplings",),
    "gear": ("gears",),
    "valve": ("valves",),
    "probe": ("probes",),
}
"""Lists of a chain model that hold the parts of a kind."""


def part_prefixes(model: ChainModel, part: str) -> list[str]:
    """Prefixes of a chain's metrics by its parts of a kind: "" of the "chain", else names and dots."""
    if part == "chain":
        return [""]
    if part == "strand":
        return [f"{name}." for name in model.strand_names]
    return [f"{of.name}." for parts in PART_LISTS[part] for of in getattr(model, parts)]


@dataclass(frozen=True)
class MetricGroup:
    """Metric columns of one kind of part."""

    part: str  # "chain", "strand", or a key of `PART_LISTS`
    columns: tuple[Column, ...]
    source: str = ""  # field of `kernels.structs.Sums`
    weight: Callable[[Any, VariantValues, VariantValues], VariantValues] = lambda sums, duration, rollers: duration
    applies_to: Callable[[ChainModel, int], bool] | None = None


TENSION_QUANTILE_SHARES = {"q001": 0.001, "q01": 0.01, "q50": 0.5, "q99": 0.99, "q999": 0.999}


@cache
def standard_error_column(column: Column) -> Column:
    """Metric column of the standard error of a mean."""
    assert column.value is not None
    title = f"standard error of the {column.title}"
    return Column(f"{column.name}{ERROR_SUFFIX}", column.unit, title, standard_error_of(column.value), is_aside=True)


def columns_with_errors(*columns: Column) -> tuple[Column, ...]:
    """Metric columns, each mean followed by its standard error."""
    found: list[Column] = []
    for column in columns:
        found += [column, standard_error_column(column)] if column.name.endswith("_mean") else [column]
    return tuple(found)


TENSION_MIN = Column("tension_min", "N", "smallest link tension", sum_of("tension_min"))
TENSION_MAX = Column("tension_max", "N", "largest link tension", sum_of("tension_max"))
TENSION_MEAN = Column("tension_mean", "N", "mean link tension", mean_of("tension"))
TENSION_STD = Column("tension_std", "N", "standard deviation of link tension", deviation_of("tension"))
TENSION_QUANTILES = tuple(
    Column(
        f"tension_{name}",
        "N",
        f"tension that {100.0 * share:g} % of links and instants are below",
        tension_quantile_of(share),
        is_aside=name not in ("q001", "q999"),
    )
    for name, share in TENSION_QUANTILE_SHARES.items()
)
TENSION_SLACK = Column(
    "slack", "1", "share of links and instants without tension", tension_share_below_value(0.0), is_aside=True
)

MOMENT_MEAN = Column("moment_mean", "N m", "mean moment of the contact forces, counter-clockwise", mean_of("moment"))
FORCE_MAX = Column(
    "force_max", "N", "largest contact force on a roller or pin; of a tensioner, its largest", sum_of("force_max")
)
DAMPING_LOSS = Column("damping_loss", "J", "energy that its dampers and stops take", sum_of("dissipated"))

CHAIN_TENSION_METRICS = MetricGroup(
    "chain",
    columns_with_errors(TENSION_MIN, TENSION_MAX, TENSION_MEAN, TENSION_STD, *TENSION_QUANTILES, TENSION_SLACK),
    source="chain",
    weight=lambda sums, duration, rollers: sums["samples"] * rollers,
)
STRAND_TENSION_METRICS = MetricGroup(
    "strand",
    columns_with_errors(TENSION_MIN, TENSION_MEAN, TENSION_MAX, TENSION_STD, *TENSION_QUANTILES, TENSION_SLACK),
    source="strand",
    weight=lambda sums, duration, rollers: sums["links"],
)
STRAND_DISPLACEMENT_METRICS = MetricGroup(
    "strand",
    columns_with_errors(
        Column("displacement_min", "m", "smallest mid-strand displacement, left positive", sum_of("displacement_min")),
        Column("displacement_mean", "m", "mean mid-strand displacement", mean_of("displacement")),
        Column("displacement_max", "m", "largest mid-strand displacement", sum_of("displacement_max")),
        Column("displacement_rms", "m", "root mean square of the mid-strand displacement", rms_of("displacement")),
    ),
    source="strand",
    weight=lambda sums, duration, rollers: sums["samples"],
)
SPROCKET_METRICS = MetricGroup(
    "sprocket",
    columns_with_errors(
        Column("speed_min", "rad/s", "smallest angular velocity, counter-clockwise", sum_of("speed_min")),
        Column("speed_mean", "rad/s", "mean angular velocity", mean_of("speed")),
        Column("speed_max", "rad/s", "largest angular velocity", sum_of("speed_max")),
        Column("speed_std", "rad/s", "standard deviation of the angular velocity", deviation_of("speed")),
        MOMENT_MEAN,
        Column("hub_force_x_mean", "N", "mean force of the chain on the sprocket to the right", mean_of("force", 0)),
        Column("hub_force_y_mean", "N", "mean force of the chain on the sprocket upward", mean_of("force", 1)),
        Column("hub_force_max", "N", "largest force of the chain on the sprocket", sum_of("force_max")),
    ),
    source="sprocket",
)
MOUNT_METRICS = MetricGroup(
    "sprocket",
    columns_with_errors(
        Column("travel_x_mean", "m", "mean displacement of the center to the right", mean_of("travel", 0)),
        Column("travel_y_mean", "m", "mean displacement of the center upward", mean_of("travel", 1)),
        Column("travel_max", "m", "largest distance of the center from where it is stated", sum_of("travel_max")),
        Column("mount_force_mean", "N", "mean magnitude of what holds the center", mean_of("force")),
        Column("mount_dissipated", "J", "energy dissipated in the mount's damper", sum_of("dissipated")),
    ),
    source="mount",
    applies_to=lambda model, index: has_moving_center(model.sprockets[index]),
)
BEARING_METRICS = MetricGroup(
    "sprocket",
    (Column("bearing_friction", "J", "energy dissipated by friction in its bearing", sum_of("friction")),),
    source="mount",
    applies_to=lambda model, index: model.sprockets[index].bearing is not None,
)
SLIP_METRICS = MetricGroup(
    "sprocket",
    (Column("slips", "1", "teeth that the chain jumped", sum_of("slips"), kind=int),),
    source="slip",
)
CONTACT_METRICS = MetricGroup(
    "partner",
    (
        FORCE_MAX,
        Column("impacts", "1", "contacts that began", sum_of("impacts"), kind=int),
        Column("impulse", "N s", "time integral of the contact forces", sum_of("impulse")),
        Column("dissipated", "J", "energy dissipated in the contacts", sum_of("dissipated")),
    ),
    source="contact",
)
CONTACT_FRICTION_METRICS = MetricGroup(
    "partner",
    (Column("friction", "J", "energy dissipated by friction in the contacts", sum_of("friction")),),
    source="contact",
    applies_to=has_partner_friction,
)
TOOTH_CONTACT_METRICS = MetricGroup(
    "partner",
    (
        Column(
            "contacts",
            "1",
            "rollers that came into contact for the first time in their pass",
            sum_of("contacts"),
            kind=int,
        ),
    ),
    source="contact",
    applies_to=lambda model, index: index < len(model.sprockets),
)
MISSED_ROLLER_METRICS = MetricGroup(
    "partner",
    (Column("missed", "1", "rollers in the bar that did not come through its face", sum_of("missed"), kind=int),),
    source="contact",
    applies_to=lambda model, index: index >= len(model.sprockets),
)
ARM_METRICS = MetricGroup(
    "arm",
    (
        Column("angle_min", "rad", "smallest angle, counter-clockwise from the drawing", sum_of("angle_min")),
        Column("angle_mean", "rad", "mean angle", mean_of("angle")),
        Column("angle_max", "rad", "largest angle", sum_of("angle_max")),
        Column("angle_std", "rad", "standard deviation of the angle", deviation_of("angle")),
        MOMENT_MEAN,
        DAMPING_LOSS,
    ),
    source="arm",
)
PIVOT_METRICS = MetricGroup(
    "arm",
    (Column("pivot_work", "J", "work done on it by what leads its pivot", sum_of("work")),),
    source="arm",
    applies_to=lambda model, index: model.arms[index].pivot_table is not None,
)
TENSIONER_METRICS = MetricGroup(
    "tensioner",
    (
        Column("force_min", "N", "smallest force on its body", sum_of("force_min")),
        Column("force_mean", "N", "mean force on its body", mean_of("force")),
        FORCE_MAX,
        Column("extension_min", "m", "smallest extension, from the drawing", sum_of("extension_min")),
        Column("extension_mean", "m", "mean extension", mean_of("extension")),
        Column("extension_max", "m", "largest extension", sum_of("extension_max")),
        DAMPING_LOSS,
    ),
    source="tensioner",
)
OIL_METRICS = MetricGroup(
    "tensioner",
    (
        Column("pressure_min", "Pa", "smallest absolute pressure in the chamber", sum_of("pressure_min")),
        Column("pressure_mean", "Pa", "mean absolute pressure in the chamber", mean_of("pressure")),
        Column("pressure_max", "Pa", "largest absolute pressure in the chamber", sum_of("pressure_max")),
        Column("leaked", "m^3", "oil that leaked through the gap", flow_of("leaked")),
        Column("supplied", "m^3", "oil that came in through the check valve", flow_of("supplied")),
        Column("oil_loss", "J", "energy that gap and valves take", flow_of("leak_loss", "valve_loss")),
        Column("supply_work", "J", "work of the oil supply", flow_of("supply_work")),
        Column(
            "suction_work",
            "J",
            "work on its plunger where oil and spring would draw it back; one that stayed behind would have none",
            sum_of("suction_work"),
        ),
    ),
    source="tensioner",
    applies_to=lambda model, index: model.tensioners[index].hydraulic,
)
RELIEF_METRICS = MetricGroup(
    "tensioner",
    (Column("relieved", "m^3", "oil that its relief valve let out", flow_of("relieved")),),
    source="tensioner",
    applies_to=lambda model, index: model.tensioners[index].relief is not None,
)
FILLING_METRICS = MetricGroup(
    "tensioner",
    (
        Column(
            "filling_time", "s", "time until oil had filled its chamber; none where it has not", chamber_filling_time
        ),
    ),
    source="tensioner",
    applies_to=lambda model, index: model.tensioners[index].is_drained,
)
VENT_METRICS = MetricGroup(
    "tensioner",
    (Column("vented", "m^3", "oil that went out through its vent", flow_of("vented")),),
    source="tensioner",
    applies_to=lambda model, index: model.tensioners[index].vent is not None,
)
SHAFT_SPEED_NAMES = ("speed_min", "speed_mean", "speed_max", "speed_std")
SHAFT_METRICS = MetricGroup(
    "shaft",
    tuple(column for column in SPROCKET_METRICS.columns if column.name in SHAFT_SPEED_NAMES),
    source="shaft",
)
MOTOR_METRICS = MetricGroup(
    "shaft",
    (
        Column("motor_moment_mean", "N m", "mean moment of its motor, counter-clockwise", mean_of("motor")),
        Column("motor_moment_max", "N m", "largest magnitude of that", sum_of("motor_max")),
        Column("motor_work", "J", "work of its motor", sum_of("motor_work")),
    ),
    source="shaft",
    applies_to=lambda model, index: model.shafts[index].motor is not None,
)
TORQUE_MEAN = Column("torque_mean", "N m", "mean moment that it passes on to its second shaft", mean_of("moment"))
COUPLING_METRICS = MetricGroup(
    "coupling",
    (
        Column("twist_min", "rad", "smallest twist", sum_of("twist_min")),
        Column("twist_mean", "rad", "mean twist", mean_of("twist")),
        Column("twist_max", "rad", "largest twist", sum_of("twist_max")),
        Column("torque_min", "N m", "smallest moment that it passes on", sum_of("moment_min")),
        TORQUE_MEAN,
        Column("torque_max", "N m", "largest moment that it passes on", sum_of("moment_max")),
        DAMPING_LOSS,
    ),
    source="coupling",
)
COUPLING_SLIP_METRICS = MetricGroup(
    "coupling",
    (Column("slip_loss", "J", "energy lost as its clutch slips and its ratio changes", sum_of("slip_loss")),),
    source="coupling",
    applies_to=lambda model, index: model.couplings[index].slips,
)
GEAR_METRICS = MetricGroup(
    "gear",
    (
        TORQUE_MEAN,
        Column("tooth_force_mean", "N", "mean magnitude of the force between its teeth", mean_of("force")),
        Column("tooth_force_max", "N", "largest magnitude of the force between its teeth", sum_of("force_max")),
    ),
    source="gear",
)
VALVE_METRICS = MetricGroup(
    "valve",
    (
        Column("cam_torque_min", "N m", "smallest moment against forward rotation", sum_of("torque_min")),
        Column("cam_torque_mean", "N m", "mean moment against forward rotation", mean_of("torque")),
        Column("cam_torque_max", "N m", "largest moment against forward rotation", sum_of("torque_max")),
        Column("cam_force_min", "N", "smallest force of a cam on its follower", sum_of("force_min")),
        Column("valve_float", "1", "share of time for which a follower would lift off its cam", mean_of("afloat")),
    ),
    source="valve",
)
JOINT_METRICS = MetricGroup(
    "chain",
    (Column("joints.friction", "J", "energy dissipated by friction in the joints", sum_of("friction")),),
    source="chain",
    applies_to=lambda model, index: model.chain.has_friction,
)
GOODS_METRICS = MetricGroup(
    "chain",
    (Column("goods.work", "J", "work done on the goods of a strand", lambda of: -of.sums["goods_work"]),),
    source="chain",
    applies_to=lambda model, index: model.chain.load is not None,
)
BALANCE_METRICS = MetricGroup(
    "chain",
    (
        Column("input_work", "J", "work of what prescribes angles and centers", attrgetter("input")),
        Column("output_work", "J", "work against the loads, and on goods", attrgetter("output")),
        Column(
            "efficiency",
            "1",
            "output work over itself and the losses",
            attrgetter("efficiency"),
        ),
        Column("links.dissipated", "J", "energy dissipated in the links", attrgetter("links")),
        Column("energy_change", "J", "change of the mechanical energy", attrgetter("change")),
        Column("energy_change_relative", "1", "that change over the losses", attrgetter("relative_change")),
        Column("energy_residual", "J", "what the energy balance misses", attrgetter("residual")),
        Column(
            "energy_residual_relative",
            "1",
            "residual over the energy turned over",
            attrgetter("relative_residual"),
        ),
    ),
)
STEADY_METRICS = MetricGroup(
    "chain",
    (
        Column(
            "tension_drift",
            "N",
            "change of the mean tension over the window",
            attrgetter("tension_change"),
            is_aside=True,
        ),
        Column(
            "tension_drift_p",
            "1",
            "probability of such a change by chance",
            attrgetter("tension_change_chance"),
            is_aside=True,
        ),
        Column("steady", "1", "whether neither tension nor speeds drift", attrgetter("is_steady"), bool, is_aside=True),
    ),
)
PEAK_FACTOR = Column("peak_factor", "1", "largest over mean tension", peak_factor)
CONTACT_ENERGY_PER_REVOLUTION = Column(
    "contact_energy_per_revolution",
    "J",
    "wear index: energy that contacts dissipate in a revolution of the driver",
    contact_energy_per_revolution,
)
DISPLACEMENT_STD = Column(
    "displacement_std", "m", "vibration: deviation of the displacement from its mean", displacement_std
)
RATING_METRICS = MetricGroup(
    "chain",
    (Column("rated_use", "1", "mean power of the driver over that which standards rate the chain for", rated_use),),
    applies_to=lambda model, index: size_rating(model.chain.size) is not None and not model.chain.is_open,
)
IMPACT_IMPULSE = Column(
    "impact_impulse",
    "N s",
    "noise proxy: sqrt(2 m E), the blow that would lose the energy E which a tooth passing loses",
    impact_impulse,
)
RESOLUTION_METRICS = (
    MetricGroup(
        "chain",
        (
            Column(
                "joints.resolution",
                "1",
                "steps in which friction bends a joint by a tooth",
                joint_resolution,
                is_aside=True,
            ),
        ),
        applies_to=lambda model, index: model.chain.has_friction,
    ),
    MetricGroup(
        "strand",
        (
            Column(
                "joint_give",
                "1",
                "tension that the give of joints that stick stands for, over `tension_q999`",
                joint_give,
                is_aside=True,
            ),
        ),
        applies_to=lambda model, index: model.chain.has_friction,
    ),
    MetricGroup(
        "partner",
        (
            Column(
                "resolution",
                "1",
                "steps in which friction moves a roller by a pitch, or in its ramp, where these are fewer",
                partner_resolution,
                is_aside=True,
            ),
        ),
        applies_to=lambda model, index: has_partner_friction(model, index) or is_ramped(model, index),
    ),
)
FRICTION_POWER_METRICS = MetricGroup(
    "chain",
    (
        Column(
            "friction_power",
            "W",
            "power that friction takes in joints, on teeth and on guide-bars",
            total_friction_power,
        ),
    ),
    applies_to=lambda model, index: (
        model.chain.has_friction
        or any(has_partner_friction(model, k) for k in range(len(model.sprockets) + len(model.guides)))
    ),
)
RUN_METRICS = MetricGroup(
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
ENGAGED_METRICS = MetricGroup(
    "sprocket",
    (Column("engaged", "1", "rollers on its teeth at the end of the run, over those at assembly"),),
)
SETTLING_METRICS = MetricGroup(
    "chain",
    (
        Column("settle_steps", "1", "steps that settling took", kind=int),
        Column("settle_residual", "1", "largest net force left on a roller or pin over the largest link force"),
        Column("settle_force", "N", "largest net force left on a roller or pin"),
    ),
    applies_to=lambda model, index: model.run.settle,
)
RECORDED_METRICS = (
    MetricGroup(
        "sprocket",
        (
            Column("transmission_error_rms", "rad", "transmission error: root mean square of what the angle misses"),
            Column("transmission_error_range", "rad", "transmission error: from its smallest to its largest"),
            Column("engagement_impulse", "N s", "mean impulse of a roller's first touch, over 2 pi sqrt(m/K)"),
        ),
    ),
    MetricGroup(
        "chain",
        (
            Column("damage_per_hour_max", "1/h", "Miner damage of the worst link an hour"),
            Column("damage_per_hour_mean", "1/h", "Miner damage of the mean link an hour"),
            Column("tension_equivalent_range", "N", "range that does the worst link's damage, once a chain revolution"),
        ),
    ),
)
REPORT_METRICS = (
    MetricGroup(
        "strand",
        (Column("slack_time", "1", "share of time that its middle carries no tension"),),
    ),
    MetricGroup(
        "sprocket",
        (
            Column("phase_mean", "rad", "mean phase error, in angle of the driver; below 0 where it lags"),
            Column("phase_range", "rad", "phase error from its smallest to its largest, in angle of the driver"),
            Column("jump_margin", "m", "what the roller nearest to jumping still had to climb"),
            Column("jump_margin_relative", "1", "the same over the whole climb; 0 where the chain jumps"),
        ),
    ),
    MetricGroup(
        "partner",
        (
            Column("line_load_max", "N/m", "largest mean force per length of the face"),
            Column("pv_max", "W/m", "largest mean of force times sliding speed, per length of the face"),
            Column("sliding_speed", "m/s", "mean speed of the chain along the face, weighted by force"),
            Column("off_time", "1", "share of time that no roller presses the guide"),
        ),
        applies_to=lambda model, index: index >= len(model.sprockets),
    ),
    MetricGroup(
        "chain",
        (
            Column("joints.sliding_speed", "m/s", "sliding distance of a joint over time"),
            Column("joints.loaded_sliding", "W", "force times sliding speed of a joint, mean of all"),
            Column("joints.friction_each", "W", "friction power of a joint, mean of all"),
            Column("elongation_per_hour", "1/h", "elongation of the chain by wear of its joints"),
        ),
    ),
    MetricGroup(
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

WINDOW_METRICS = (
    (CHAIN_TENSION_METRICS,),
    (STRAND_TENSION_METRICS, STRAND_DISPLACEMENT_METRICS),
    (SPROCKET_METRICS, MOUNT_METRICS, BEARING_METRICS, SLIP_METRICS),
    (CONTACT_METRICS, CONTACT_FRICTION_METRICS, TOOTH_CONTACT_METRICS, MISSED_ROLLER_METRICS),
    (ARM_METRICS, PIVOT_METRICS),
    (TENSIONER_METRICS, OIL_METRICS, RELIEF_METRICS, VENT_METRICS, FILLING_METRICS),
    (SHAFT_METRICS, MOTOR_METRICS),
    (COUPLING_METRICS, COUPLING_SLIP_METRICS),
    (GEAR_METRICS,),
    (VALVE_METRICS,),
    (JOINT_METRICS, GOODS_METRICS),
)
DESIGN_METRICS = (
    (MetricGroup("chain", (PEAK_FACTOR,)),),
    (FRICTION_POWER_METRICS,),
    (RATING_METRICS,),
    (MetricGroup("strand", (PEAK_FACTOR, DISPLACEMENT_STD)),),
    (MetricGroup("partner", (CONTACT_ENERGY_PER_REVOLUTION,)),),
    (MetricGroup("chain", (CONTACT_ENERGY_PER_REVOLUTION,)),),
    (MetricGroup("sprocket", (IMPACT_IMPULSE,)),),
    *((group,) for group in RESOLUTION_METRICS),
)

GroupBlocks = tuple[tuple[MetricGroup, ...], ...]
ALL_METRICS: GroupBlocks = (
    *WINDOW_METRICS,
    (STEADY_METRICS,),
    (BALANCE_METRICS,),
    *DESIGN_METRICS,
    (ENGAGED_METRICS,),
    (SETTLING_METRICS,),
)
MODE_METRICS = (
    Column("frequency", "Hz", "natural frequency of a mode of the base drive, found again by its shape"),
    Column("damping_ratio", "1", "damping ratio of that mode"),
)
COLUMN_BY_NAME = {
    c.name: c
    for groups in (REPORT_METRICS, *ALL_METRICS, (RUN_METRICS,), RECORDED_METRICS)
    for group in groups
    for c in group.columns
}
COLUMN_BY_NAME |= {c.name: c for c in MODE_METRICS}
OWN_COLUMNS: dict[str, Column] = {}


def groups_of_drive(model: ChainModel, blocks: GroupBlocks = ALL_METRICS) -> list[tuple[str, int, MetricGroup]]:
    """Metric groups of a chain's parts, with prefix and index."""
    return [
        (prefix, index, group)
        for groups in blocks
        for index, prefix in enumerate(part_prefixes(model, groups[0].part))
        for group in groups
        if group.applies_to is None or group.applies_to(model, index)
    ]


CHAIN_PARTS = ("chain", "strand")
"""Parts whose metrics begin with the chain's name."""
CHAIN_BALANCE_NAMES = ("links.dissipated",)


def _columns_key(model: ChainModel) -> Hashable:
    """Key of a chain's columns, its energy balance's terms and its driver."""
    groups = tuple((prefix, id(group)) for prefix, _, group in groups_of_drive(model))
    bodies = (*(is_free_body(model, s) for s in range(len(model.sprockets))), *(shaft.name for shaft in model.shafts))
    return model.name, model.driver, bodies, groups


def variants_by_columns(
    drives: Sequence[Drive], stacks: Sequence[Stack[Drive]] | None = None
) -> list[NDArray[np.int64]]:
    """Numbers of drives, in groups of equal metric columns."""
    kinds: dict[Hashable, list[NDArray[np.int64]]] = {}
    for stack in stacks_of_drives(drives) if stacks is None else stacks:
        key = tuple(map(_columns_key, Model(drives[int(stack.members[0])]).chains))
        kinds.setdefault(key, []).append(stack.members)
    return [np.sort(np.concatenate(numbers)) for numbers in kinds.values()]


def metric_names(drive: Drive) -> list[str]:
    """Names of a drive's metrics, those of plug-ins last."""
    load_installed_plugins()
    chains, found = Model(drive).chains, []
    if len(chains) == 1:
        groups = groups_of_drive(chains[0])
        return [*(prefix + column.name for prefix, _, group in groups for column in group.columns), *OWN_COLUMNS]
    for chain in chains:
        for prefix, _, group in groups_of_drive(chain):
            before = f"{chain.name}.{prefix}" if group.part in CHAIN_PARTS else prefix
            columns = [c for c in group.columns if group is not BALANCE_METRICS or c.name in CHAIN_BALANCE_NAMES]
            found += [before + column.name for column in columns]
    return [*found, *(column.name for column in BALANCE_METRICS.columns), "steady", *OWN_COLUMNS]


def metric_table_names(drive: Drive) -> list[str]:
    """Names of a drive's metrics table's columns, in order."""
    return [*(column.name for column in RUN_METRICS.columns), *metric_names(drive)]


def column_of_metric(name: str) -> Column | None:
    """Registered column of a metric's name, with any prefix, or None."""
    parts = name.split(".")
    tails = (".".join(parts[k:]) for k in range(len(parts)))
    return next((COLUMN_BY_NAME[tail] for tail in tails if tail in COLUMN_BY_NAME), None)


def columns_of_metrics(names: Iterable[str]) -> dict[str, Column]:
    """Registered columns of metrics by name, or plain ones."""
    return {name: column_of_metric(name) or Column(name, "1", name) for name in names}


def unit_of_metric(name: str) -> str:
    """Unit of a metric, by name."""
    return columns_of_metrics([name])[name].unit


def title_of_metric(name: str) -> str:
    """Title of a metric, by name: "camshaft: mean angular velocity"."""
    column = column_of_metric(name)
    if column is None:
        return name
    prefix = name.removesuffix(column.name).removesuffix(".")
    return f"{prefix}: {column.title}" if prefix else column.title
