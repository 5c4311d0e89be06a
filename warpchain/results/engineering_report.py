"""Engineering report of a recorded variant: its metrics, and the signals that figures are drawn from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpchain.argument_checks import PositiveNumber, check_arguments
from warpchain.drive.body_ties import rotation_owners
from warpchain.errors import SimulationError
from warpchain.model.power_rating import WEAR_COEFFICIENT
from warpchain.results.guide_load import GuideContacts, GuideLoad, guide_loads, recorded_guide_contacts
from warpchain.results.joint_wear import JointWear, elongation_rate, joint_wear
from warpchain.results.losses import friction_power
from warpchain.results.run import Run, Trajectory
from warpchain.results.shaft_signals import PhaseError, hub_forces, phase_error_in_window
from warpchain.results.signals import ProbeSignals, probe_signals, strand_tension
from warpchain.results.tooth_jump import JumpMargin, tooth_jump_margin

Array = NDArray[np.float64]


@check_arguments(SimulationError, "wear.")
@dataclass(frozen=True)
class Wear:
    """Wear law of a chain's joints, for reports."""

    coefficient: PositiveNumber = WEAR_COEFFICIENT  # k of Archard's law [m^2/N]
    bearing_area: PositiveNumber | None = None  # of a joint [m^2]; None is the size's


def trajectory_in_window(trajectory: Trajectory, start: float, end: float) -> Trajectory:
    """Trajectory of the frames in a window [s].

    Raises:
        SimulationError: fewer than three of them.
    """
    inside = (trajectory.time >= start - 1e-12) & (trajectory.time <= end + 1e-12)
    if inside.sum() < 3:
        raise SimulationError(f"{int(inside.sum())} frames from {start:g} to {end:g} s, at least 3 are needed")
    return trajectory.at(inside)


class EngineeringReport:
    """Engineering report of a recorded variant, computed as asked for.

    Args:
        trajectory: the whole recording.
        start, end: window of means and extremes [s]; the latter half by default.
        alike: sprockets that turn as another part.

    Attributes:
        whole, part: the recording, and its frames in the window.

    Raises:
        SimulationError: by what needs channels that were not recorded.
    """

    def __init__(
        self,
        trajectory: Trajectory,
        start: float | None = None,
        end: float | None = None,
        wear: Wear | None = None,
        alike: Mapping[str, str] | None = None,
    ) -> None:
        self.wear_law = wear or Wear()
        self.start = 0.5 * float(trajectory.time[-1]) if start is None else start
        self.end = float(trajectory.time[-1]) if end is None else end
        self.whole = replace(trajectory, window=(self.start, self.end))
        self.part = trajectory_in_window(trajectory, self.start, self.end)
        self.model = trajectory.model
        self.alike = rotation_owners(self.model) if alike is None else alike

    @cached_property
    def guide_contacts(self) -> list[GuideContacts]:
        """Contacts of rollers with each guide."""
        return recorded_guide_contacts(self.part)

    @cached_property
    def guide_loads(self) -> list[GuideLoad]:
        """Load of each guide over its length."""
        return guide_loads(self.part, self.guide_contacts)

    @cached_property
    def hub_forces(self) -> Array:
        """Forces (F, S, 2) [N] of the chain on sprockets."""
        return hub_forces(self.part)

    @cached_property
    def phase_errors(self) -> dict[int, PhaseError]:
        """Phase error of each driven sprocket with teeth."""
        inside = (self.whole.time >= self.start - 1e-12) & (self.whole.time <= self.end + 1e-12)
        driver = self.model.driver
        others = [s for s, sprocket in enumerate(self.model.sprockets) if s != driver and not sprocket.is_end]
        return {s: phase_error_in_window(self.whole, s, inside) for s in others}

    @cached_property
    def friction_power(self) -> dict[str, Array]:
        """Friction power (F,) [W] by part that rubs."""
        return friction_power(self.whole)

    @cached_property
    def jump_margins(self) -> list[JumpMargin]:
        """Margin to tooth jump of each sprocket."""
        return [tooth_jump_margin(self.part, s) for s in range(len(self.model.sprockets))]

    @cached_property
    def probe_signals(self) -> dict[str, ProbeSignals]:
        """Signals of each probe, by name."""
        pitch = self.model.chain.pitch
        return {probe.name: probe_signals(self.whole, probe.at, probe.radius or pitch) for probe in self.model.probes}

    @cached_property
    def joint_wear(self) -> JointWear | None:
        """Sliding of the chain's joints, or None."""
        return joint_wear(self.part)

    @cached_property
    def joint_area(self) -> float | None:
        """Bearing area of a joint [m^2], or None."""
        own = self.wear_law.bearing_area
        return self.model.chain.joint_area if own is None else own

    @property
    def elongation_rate(self) -> float | None:
        """Rate at which wear elongates the chain [1/s], or None."""
        if self.joint_wear is None or self.joint_area is None:
            return None
        return elongation_rate(self.model, self.joint_wear, self.wear_law.coefficient, self.joint_area)

    def metrics(self) -> dict[str, float]:
        """Metrics of the report that recorded channels allow."""
        return dict(self._finite_metrics)

    @cached_property
    def _finite_metrics(self) -> dict[str, float]:
        """Finite metrics of the report, by name."""
        found: dict[str, float] = {}
        for rows in (_strand_metrics, _sprocket_metrics, _guide_metrics, _joint_metrics, _probe_metrics):
            found |= rows(self)
        return {name: value for name, value in found.items() if np.isfinite(value)}


def _has_channels(report: EngineeringReport, *channels: str) -> bool:
    """Whether a report's recording has channels."""
    return all(getattr(report.whole, channel) is not None for channel in channels)


def _strand_metrics(report: EngineeringReport) -> dict[str, float]:
    """Metrics of strands in a report, by name."""
    if not _has_channels(report, "position", "tension"):
        return {}
    names = enumerate(report.model.strand_names)
    return {f"{name}.slack_time": float((strand_tension(report.part, k) <= 0.0).mean()) for k, name in names}


def _sprocket_metrics(report: EngineeringReport) -> dict[str, float]:
    """Metrics of sprockets in a report, by name."""
    found: dict[str, float] = {}
    if _has_channels(report, "sprocket_angle"):
        for s, phase in report.phase_errors.items():
            name = report.model.sprockets[s].name
            found |= {f"{name}.phase_mean": phase.shift, f"{name}.phase_range": phase.high - phase.low}
    if _has_channels(report, "position", "sprocket_center"):
        for sprocket, jump in zip(report.model.sprockets, report.jump_margins, strict=True):
            least = float(np.nanmin(jump.margin)) if np.isfinite(jump.margin).any() else np.nan
            found[f"{sprocket.name}.jump_margin"] = least
            found[f"{sprocket.name}.jump_margin_relative"] = least / jump.height
    return found


def _guide_metrics(report: EngineeringReport) -> dict[str, float]:
    """Metrics of guides in a report, by name."""
    if not report.model.guides or not _has_channels(report, "position", "guide_force"):
        return {}
    found: dict[str, float] = {}
    for guide, load, contacts in zip(report.model.guides, report.guide_loads, report.guide_contacts, strict=True):
        total = float(contacts.force.sum())
        found[f"{guide.name}.line_load_max"] = float(load.mean.max())
        found[f"{guide.name}.off_time"] = 1.0 - load.touching
        if _has_channels(report, "velocity"):
            found[f"{guide.name}.pv_max"] = float(load.pv.max())
            work = float((contacts.force * np.abs(contacts.speed)).sum())
            found[f"{guide.name}.sliding_speed"] = work / total if total > 0.0 else np.nan
    return found


def _joint_metrics(report: EngineeringReport) -> dict[str, float]:
    """Metrics of joints in a report, by name."""
    if not _has_channels(report, "position", "tension") or report.joint_wear is None:
        return {}
    wear, seconds = report.joint_wear, report.joint_wear.seconds
    found = {
        "joints.sliding_speed": float(wear.distance.mean()) / seconds,
        "joints.loaded_sliding": float(wear.loaded.mean()) / seconds,
        "joints.friction_each": float(wear.work.mean()) / seconds,
    }
    return found if report.elongation_rate is None else found | {"elongation_per_hour": 3600.0 * report.elongation_rate}


def _probe_metrics(report: EngineeringReport) -> dict[str, float]:
    """Metrics of probes in a report, by name."""
    if not report.model.probes or not _has_channels(report, "position", "velocity", "tension"):
        return {}
    inside = report.whole.time >= report.start - 1e-12
    found: dict[str, float] = {}
    for name, seen in report.probe_signals.items():
        here = inside & (seen.link >= 0)
        if here.any():
            found |= {
                f"{name}.tension_mean": float(seen.tension[here].mean()),
                f"{name}.tension_max": float(seen.tension[here].max()),
                f"{name}.speed_mean": float(seen.speed[here].mean()),
                f"{name}.displacement_mean": float(seen.displacement[here].mean()),
                f"{name}.displacement_std": float(seen.displacement[here].std()),
            }
    return found


def metrics_window(row: Mapping[str, Any], trajectory: Trajectory) -> tuple[float, float]:
    """Window [s] of a metrics row within the recording."""
    end = float(trajectory.time[-1])
    start, stop = row.get("window_start"), row.get("window_end")
    if row.get("input_work") is None or start is None or stop is None or start >= end:
        return 0.5 * end, end
    return float(start), min(float(stop), end)


def engineering_report(run: Run, variant: int | None = None, wear: Wear | None = None) -> EngineeringReport:
    """Engineering report of a run's recorded variant.

    Raises:
        SimulationError: a variant that was not recorded.
    """
    index = run.first if variant is None else variant
    trajectory = run[index]
    return EngineeringReport(trajectory, *metrics_window(run.metrics.to_pylist()[run.row_of(index)], trajectory), wear)
