"""Tensions of `check` beside runs."""

import argparse
from collections.abc import Iterator
from typing import Any

import numpy as np
from common.cases import Line, case, case_option
from common.drives import example_drive, without_friction

from warpchain import Record, simulate
from warpchain.assembly.arm_balance import chain_path
from warpchain.assembly.statics import at_work
from warpchain.assembly.timestep import automatic_step
from warpchain.model import Model

DURATION = {"engine": 0.2, "industrial": 1.0, "marine": 2.0, "motorcycle": 0.3}
"""Of the runs [s], whose second half counts."""
MARINE: dict[str, dict[str, Any]] = {
    "as it is": {},
    "joints rub twice as much": {"chain.joint.friction": 0.14},
    "crankshaft at 1 rad/s": {"sprockets.crankshaft.prescribed.speed": 1.0},
    "nothing rubs, no guide-bar": {
        "chain.joint": None,
        "contact.sprocket.friction": 0.0,
        "contact.guide": None,
        "guides": (),
    },
}


def bent_length(trajectory: Any, frames: Any) -> tuple[float, float]:
    """Length of all strands beyond straight ones in frames of a run [m]: whole, and what is not standing.

    Half of the slopes' squares along the strand; the mean slope at each place, a pitch long, stands.
    """
    drive, path = trajectory.drive, chain_path(Model(trajectory.drive).chain)
    x = trajectory.position[frames].astype(float)
    whole, waves = 0.0, 0.0
    for begin, end in zip(path.strand_start, path.strand_end, strict=True):
        length = float(np.hypot(*(end - begin)))
        u = (end - begin) / length
        along, off = (x - begin) @ u, (x - begin) @ np.array([-u[1], u[0]])
        next_along, next_off = np.roll(along, -1, axis=1), np.roll(off, -1, axis=1)
        on = (along > 0.0) & (next_along < length) & (np.abs(off) < 3.0 * drive.chain.pitch)
        step = (next_along - along)[on]
        slope, place = (next_off - off)[on] / step, (along[on] / drive.chain.pitch).astype(int)
        standing = np.bincount(place, slope) / np.maximum(np.bincount(place), 1)
        whole += 0.5 * float(slope**2 @ step) / len(x)
        waves += 0.5 * float((slope - standing[place]) ** 2 @ step) / len(x)
    return whole, waves


@case(case_option("--marine", action="store_true", help="the second table instead"))
def check(asked: argparse.Namespace) -> Iterator[Line]:
    """The tables of docs/solving.md: mean strand tensions that `warpchain check` prints, and those of runs.

    python scripts/figures.py check
    python scripts/figures.py check --marine

    The second: the marine drive, by how much its run is above `check`, and how much longer its bent strands are.
    """
    if asked.marine:
        yield ("marine", "runs above `check` by", "strands' way longer than straight", "of it waves")
        drives = [example_drive("marine", changes) for changes in MARINE.values()]
        run = simulate(drives, record=Record(channels=("position",), rate=1000.0))
        for k, (name, row) in enumerate(zip(MARINE, run.metrics.to_pylist(), strict=True)):
            found = np.array([row[f"{strand}.tension_mean"] for strand in drives[0].strand_names])
            above, late = 1e-3 * (found - at_work(Model(drives[k]).chain).tension), run[k].time >= 0.5 * run[k].time[-1]
            whole, waves = bent_length(run[k], late)
            yield (name, f"{above.min():.1f} to {above.max():.1f} kN", f"{1e3 * whole:.2f} mm", f"{1e3 * waves:.2f} mm")
        return
    yield ("strand", "`check`", "a run", "off, of the tightest")
    for name, duration in DURATION.items():
        drive = example_drive(name)
        (row,) = simulate(drive, record=Record("none"), duration=duration).metrics.to_pylist()
        found = np.array([row[f"{strand}.tension_mean"] for strand in drive.strand_names])
        for strand, said, seen in zip(drive.strand_names, at_work(Model(drive).chain).tension, found, strict=True):
            off = 100.0 * (said - seen) / found.max()
            yield (f"{name}: {strand}", f"{said:.4g} N", f"{seen:.4g} N", f"{off:+.1f} %")


SPELL, SPELLS = 4.0, 10
"""Seconds of a row of `marine_waves`, and how many."""


@case()
def marine_waves(asked: argparse.Namespace) -> Iterator[Line]:
    """The marine drive without friction over many turns: its mean tension grows with the waves of its strands.

    python scripts/figures.py marine-waves

    Waves lengthen strands by dL, which stretches the N links by k dL / N. The last column has half the automatic step.
    """
    drive = without_friction(example_drive("marine"))
    step, per_length = automatic_step(drive), drive.chain.mean_stiffness / drive.chain.links
    record = Record(channels=("position", "tension"), rate=200.0)
    run, fine = (simulate(drive, duration=SPELL * SPELLS, step=step / n, record=record)[0] for n in (1, 2))
    yield ("time [s]", "tension [kN]", "waves [mm]", "k waves / N [kN]", "the rest [kN]", "tension, half the step [kN]")
    assert run.tension is not None and fine.tension is not None
    for k in range(SPELLS):
        own, other = ((of.time >= SPELL * k) & (of.time < SPELL * (k + 1)) for of in (run, fine))
        tension, again = 1e-3 * run.tension[own].mean(), 1e-3 * fine.tension[other].mean()
        longer = bent_length(run, own)[1]
        pull = 1e-3 * per_length * longer
        numbers = tension, 1e3 * longer, pull, tension - pull, again
        yield (f"{SPELL * k:.0f} to {SPELL * (k + 1):.0f}", *(f"{number:.2f}" for number in numbers))
