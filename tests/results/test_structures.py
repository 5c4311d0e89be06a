"""Every metric of drives of unlike structures is, in a run of all, what it is of each alone."""

import contextlib
from collections.abc import Iterator
from itertools import islice, pairwise
from typing import Any

import pytest
from drives import LARGE, but, example

from warpchain import Drive, Record, simulate
from warpchain.drive.examples import example_names
from warpchain.errors import DriveError, WarpchainError
from warpchain.results import metrics

PARTS = ("sprockets", "guides", "arms", "tensioners", "shafts", "gears", "couplings", "valves", "chains")
MOTIONS = ("prescribed", "motor", "initial_speed", "load")
FEW = 2
"""Of each sort of change: so many that change what drives, and so many that do not."""


def places(drive: Drive, *kinds: str) -> list[tuple[str, Any]]:
    """Parts by their paths, such as "sprockets.0"."""
    return [(f"{kind}.{i}", part) for kind in kinds for i, part in enumerate(getattr(drive, kind))]


def other_ties(drive: Drive) -> Iterator[dict[str, Any]]:
    """Each reference to a part led to each other one, or to none; pairs turned around; sprockets put on shafts."""
    names = [part.name for _, part in places(drive, *PARTS)]
    for path in drive.paths():
        now = drive.get_value(path)
        if now in names and not path.endswith(".name"):
            yield from ({path: name} for name in (*names, None) if name != now)
            if path.endswith("between.0"):
                other = f"{path[:-1]}1"
                yield {path: drive.get_value(other), other: now}
    yield from ({f"{path}.shaft": shaft.name} for path, _ in places(drive, "sprockets") for shaft in drive.shafts)


def other_motions(drive: Drive) -> Iterator[dict[str, Any]]:
    """Each motion, motor, speed at the start and load given to each other body in place of its own, or to none."""
    bodies = places(drive, "sprockets", "shafts")
    for key in MOTIONS:
        for path, part in bodies:
            given = getattr(part, key, None)
            if given is not None:
                gone = {f"{path}.{key}": None} | ({} if part.inertia else {f"{path}.inertia": 0.01})
                yield from (gone | {f"{other}.{key}": given} for other, _ in bodies if other != path)
                yield gone


def other_names(drive: Drive) -> Iterator[dict[str, Any]]:
    """Two parts of a kind with each other's names; and each part of another name, wherever it is named."""
    held = {path: drive.get_value(path) for path in drive.paths()}
    for kind in PARTS:
        parts = places(drive, kind)
        for (path, part), (other, beside) in pairwise(parts):
            yield {f"{path}.name": beside.name, f"{other}.name": part.name}
        yield from ({at: "other" for at, value in held.items() if value == part.name} for _, part in parts)


def structures(drive: Drive) -> list[Drive]:
    """The drive and copies of another structure, of each sort some that drive elsewhere and some that do not."""
    found = [drive]
    for changes in (other_ties, other_motions, other_names):
        made = list(accepted(drive, changes(drive)))
        for elsewhere in (True, False):
            found += islice(filter(runs, (of for of in made if (of.driver != drive.driver) == elsewhere)), FEW)
    return found


def accepted(drive: Drive, changes: Iterator[dict[str, Any]]) -> Iterator[Drive]:
    """Changed copies that keep the rules of drive files."""
    for values in changes:
        with contextlib.suppress(DriveError):
            yield drive.with_values(values)


def runs(drive: Drive) -> bool:
    """Whether its chains fit and lie in planes of their own."""
    try:
        simulate(drive, **SHORT | {"duration": 1e-5, "window": (0.0, 1e-5)})
    except WarpchainError:
        return False
    return True


SHORT = {"device": "cpu", "record": Record(variants="none"), "duration": 3.5e-3, "window": (0.0, 3.5e-3)}


@pytest.mark.parametrize("name", but(example_names(), LARGE))
@pytest.mark.filterwarnings("ignore")
def test_each_has_the_metrics_that_it_has_alone(name, monkeypatch):
    """To the last bit: formulas, batches of the window and initial states, whatever stands first."""
    monkeypatch.setattr(metrics, "LEAST_CHAIN_TURNS", 1e-6)  # standard errors, though the window is short
    drives = structures(example(name).with_values({"run.settle": False}))
    alone = [simulate(drive, **SHORT).metrics.to_pylist()[0] for drive in drives]
    for sense in (1, -1):
        rows = simulate(drives[::sense], **SHORT).metrics.to_pylist()
        for row, own in zip(rows, alone[::sense], strict=True):
            held = {key: value for key, value in row.items() if value is not None and key != "variant"}
            assert held == {key: own[key] for key in own if own[key] is not None and key != "variant"}
