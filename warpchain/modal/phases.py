"""Modes over a tooth pitch: a drive that runs is at all phases of engagement in turn.

Where a roller is about to seat, a strand is a link longer or shorter than where it just has, and the rollers of an arc
carry otherwise. So the modes of a drive at rest depend on the phase at which it stands, those of short strands and of
turning sprockets by some percent. What a run shows is in the middle: the root of the mean of omega^2.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from warpchain.arguments import Count, NonNegativeNumber, checked
from warpchain.drive import Drive
from warpchain.errors import SimulationError
from warpchain.modal.campbell import SPARE, Campbell, campbell, matched
from warpchain.modal.matrices import Array
from warpchain.modal.system import system


@checked(SimulationError)
def over_a_pitch(
    drive: Drive,
    speeds: Sequence[NonNegativeNumber],
    count: Count,
    phases: Count = 4,
    report: Callable[[int, int], None] | None = None,
) -> tuple[Campbell, Array]:
    """Modes over speed, their frequencies and damping ratios averaged over a tooth pitch.

    Args:
        speeds: of the driver [rad/s], at least two, ascending from 0 or more.
        count: modes, the lowest at the first speed.
        phases: in equal steps; modes of the others are those of phase 0 whose shapes they are most alike to.
        report: called with (done, all) phases.

    Returns:
        The diagram, with the modes of phase 0, and (phases, P, K) all frequencies [Hz], NaN where one was not found.

    Raises:
        DriveError: a chain that does not fit.
        SimulationError: as of `campbell`; one line.
    """
    first = campbell(drive.with_values({"run.phase": 0.0}), speeds, count)
    at = system(first.drive, float(speeds[0]))
    frequency, ratio = [first.frequency], [first.damping_ratio]
    for k in range(1, phases):
        phase = k / phases - float(2 * k > phases)
        other = campbell(drive.with_values({"run.phase": phase}), speeds, count + SPARE)
        which = matched(first.modes[0].first(count), other.modes[0].first(count + SPARE), at)
        for values, own in ((frequency, other.frequency), (ratio, other.damping_ratio)):
            values.append(np.where(which >= 0, own[:, which], np.nan))
        if report is not None:
            report(k + 1, phases)
    both = np.ma.masked_invalid(np.stack(frequency)), np.ma.masked_invalid(np.stack(ratio))
    mean = np.sqrt((both[0] ** 2).mean(axis=0)).filled(np.nan)
    found = replace(first, frequency=mean, damping_ratio=both[1].mean(axis=0).filled(np.nan))
    return found, np.stack(frequency)
