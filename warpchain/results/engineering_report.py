"""Engineering report of a recorded variant, analyzed once: metrics, and what figures are drawn from.

Each part is made when it is first asked for and kept; a part whose channels were not recorded raises a
`SimulationError` that names them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpchain.argument_checks import PositiveNumber, check_arguments
from warpchain.drive.transmission import turn_alike
from warpchain.errors import SimulationError
from warpchain.results.guide_load import GuideContacts, GuideLoad, guide_contacts, guide_loads
from warpchain.results.joint_wear import WEAR_COEFFICIENT, JointWear, elongation_rate, joint_wear
from warpchain.results.losses import friction_power
from warpchain.results.run import Run, Trajectory
from warpchain.results.shaft_signals import Phase, hub_forces, phase_of
from warpchain.results.signals import Seen, seen_at, strand_tension
from warpchain.results.tooth_jump import JumpMargin, jump_margin

Array = NDArray[np.float64]


@check_arguments(SimulationError, "wear.")
@dataclass(frozen=True)
class Wear:
    """Wear law of the joints.

    Attributes:
        coefficient: k of Archard's law, volume lost over force times sliding distance [m^2/N].
        bearing_area: of a joint [m^2]; None is the size's.

    Raises:
        SimulationError: a value that is not positive.
    """

    coefficient: PositiveNumber = WEAR_COEFFICIENT
    bearing_area: PositiveNumber | None = None


def windowed(trajectory: Trajectory, start: float, end: float) -> Trajectory:
    """The frames of a window [s], both ends included.

    Raises:
        SimulationError: fewer than three of them.
    """
    inside = (trajectory.time >= start - 1e-12) & (trajectory.time <= end + 1e-12)
    if inside.sum() < 3:
        raise SimulationError(f"{int(inside.sum())} frames from {start:g} to {end:g} s, at least 3 are needed")
    return trajectory.at(inside)


class HandedIn:
    """Analysis of one recorded variant for an engineering report.

    Args:
        trajectory: the whole recording.
        start, end: the window that means and extremes are taken over [s]; the recording's latter half by default.
        wear: how the joints wear.
        alike: sprockets that turn as another part (`transmission.turn_alike`), where the recording is of one of several
            chains.

    Attributes:
        whole, part: the recording, and its frames in the window.
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
        self.part = windowed(trajectory, self.start, self.end)
        self.drive = trajectory.drive
        self.alike = turn_alike(self.drive) if alike is None else alike

    @cached_property
    def contacts(self) -> list[GuideContacts]:
        """Rollers that press each guide, in the window."""
        return guide_contacts(self.part)

    @cached_property
    def guides(self) -> list[GuideLoad]:
        """Load of each guide over its length, in the window."""
        return guide_loads(self.part, self.contacts)

    @cached_property
    def hubs(self) -> Array:
        """Force on each shaft (F, S, 2) [N], in the window."""
        return hub_forces(self.part)

    @cached_property
    def phases(self) -> dict[int, Phase]:
        """Phase error of each sprocket but the driver, over the window, from where the whole recording began."""
        inside = (self.whole.time >= self.start - 1e-12) & (self.whole.time <= self.end + 1e-12)
        others = [s for s in range(len(self.drive.sprockets)) if s != self.drive.driver]
        return {s: phase_of(self.whole, s, inside) for s in others}

    @cached_property
    def power(self) -> dict[str, Array]:
        """Friction power (F,) [W] by what rubs, of the whole recording."""
        return friction_power(self.whole)

    @cached_property
    def jumps(self) -> list[JumpMargin]:
        """Margin to tooth jump of each sprocket, in the window."""
        return [jump_margin(self.part, s) for s in range(len(self.drive.sprockets))]

    @cached_property
    def probes(self) -> dict[str, Seen]:
        """Signals of each probe, in the whole recording."""
        pitch = self.drive.chain.pitch
        return {probe.name: seen_at(self.whole, probe.at, probe.radius or pitch) for probe in self.drive.probes}

    @cached_property
    def wear(self) -> JointWear | None:
        """Sliding of the joints in the window; None without a pin radius."""
        return joint_wear(self.part)

    @cached_property
    def area(self) -> float | None:
        """Bearing area of a joint [m^2]; None where it is neither given nor known."""
        own = self.wear_law.bearing_area
        return self.drive.chain.joint_area if own is None else own

    @property
    def elongation(self) -> float | None:
        """Elongation of the chain by wear per second [1/s]; None without pins or bearing area."""
        if self.wear is None or self.area is None:
            return None
        return elongation_rate(self.drive, self.wear, self.wear_law.coefficient, self.area)

    def metrics(self) -> dict[str, float]:
        """The metrics (`results.metric_columns.REPORTED`) that the recorded channels allow, by name."""
        return dict(self._metrics)

    @cached_property
    def _metrics(self) -> dict[str, float]:
        found: dict[str, float] = {}
        for rows in (_of_strands, _of_sprockets, _of_guides, _of_joints, _of_probes):
            found |= rows(self)
        return {name: value for name, value in found.items() if np.isfinite(value)}


def _held(of: HandedIn, *channels: str) -> bool:
    return all(getattr(of.whole, channel) is not None for channel in channels)


def _of_strands(of: HandedIn) -> dict[str, float]:
    if not _held(of, "position", "tension"):
        return {}
    names = enumerate(of.drive.strand_names)
    return {f"{name}.slack_time": float((strand_tension(of.part, k) <= 0.0).mean()) for k, name in names}


def _of_sprockets(of: HandedIn) -> dict[str, float]:
    found: dict[str, float] = {}
    if _held(of, "sprocket_angle"):
        for s, phase in of.phases.items():
            name = of.drive.sprockets[s].name
            found |= {f"{name}.phase_mean": phase.shift, f"{name}.phase_range": phase.high - phase.low}
    if _held(of, "position", "sprocket_center"):
        for sprocket, jump in zip(of.drive.sprockets, of.jumps, strict=True):
            least = float(np.nanmin(jump.margin)) if np.isfinite(jump.margin).any() else np.nan
            found[f"{sprocket.name}.jump_margin"] = least
            found[f"{sprocket.name}.jump_margin_relative"] = least / jump.height
    return found


def _of_guides(of: HandedIn) -> dict[str, float]:
    if not of.drive.guides or not _held(of, "position", "guide_force"):
        return {}
    found: dict[str, float] = {}
    for guide, load, contacts in zip(of.drive.guides, of.guides, of.contacts, strict=True):
        total = float(contacts.force.sum())
        found[f"{guide.name}.line_load_max"] = float(load.mean.max())
        found[f"{guide.name}.off_time"] = 1.0 - load.touching
        if _held(of, "velocity"):
            found[f"{guide.name}.pv_max"] = float(load.pv.max())
            work = float((contacts.force * np.abs(contacts.speed)).sum())
            found[f"{guide.name}.sliding_speed"] = work / total if total > 0.0 else np.nan
    return found


def _of_joints(of: HandedIn) -> dict[str, float]:
    if not _held(of, "position", "tension") or of.wear is None:
        return {}
    wear, seconds = of.wear, of.wear.seconds
    found = {
        "joints.sliding_speed": float(wear.distance.mean()) / seconds,
        "joints.loaded_sliding": float(wear.loaded.mean()) / seconds,
        "joints.friction_each": float(wear.work.mean()) / seconds,
    }
    return found if of.elongation is None else found | {"elongation_per_hour": 3600.0 * of.elongation}


def _of_probes(of: HandedIn) -> dict[str, float]:
    if not of.drive.probes or not _held(of, "position", "velocity", "tension"):
        return {}
    inside = of.whole.time >= of.start - 1e-12
    found: dict[str, float] = {}
    for name, seen in of.probes.items():
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


def window_of(row: Mapping[str, Any], trajectory: Trajectory) -> tuple[float, float]:
    """The window of a row of metrics [s], within what was recorded; the latter half where it was not reached."""
    end = float(trajectory.time[-1])
    start, stop = row.get("window_start"), row.get("window_end")
    if row.get("input_work") is None or start is None or stop is None or start >= end:
        return 0.5 * end, end
    return float(start), min(float(stop), end)


def handed_in(run: Run, variant: int | None = None, wear: Wear | None = None) -> HandedIn:
    """The report of a recorded variant over the window of its metrics; of the first recorded one for None.

    Raises:
        SimulationError: a variant that was not recorded.
    """
    index = run.first if variant is None else variant
    trajectory = run[index]
    return HandedIn(trajectory, *window_of(run.metrics.to_pylist()[run.row_of(index)], trajectory), wear)
