"""Recorded variants for pictures, found in runs and archives, checked and labeled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from warpchain.errors import SimulationError
from warpchain.results.chains import chain_trajectories
from warpchain.results.engineering_report import metrics_window
from warpchain.results.run import Run, Trajectory, require_channels

DRIVE_CHANNELS = (
    "position",
    "tension",
    "sprocket_force",
    "guide_force",
    "sprocket_angle",
    "sprocket_center",
)
"""Channels that a picture of the drive in motion needs."""

RunSource = Run | str | Path


@dataclass(frozen=True)
class RecordedVariant:
    """Recorded variant, or its one chain `chain`, to draw with a label."""

    run: Run
    index: int
    trajectory: Trajectory
    label: str
    chain: str = ""


def recorded_variant(source: RunSource, variant: int | None, needed: Sequence[str] = DRIVE_CHANNELS) -> RecordedVariant:
    """Recorded variant of a run or archive, to draw; None takes the first.

    Raises:
        ArchiveError: an archive that cannot be read.
        SimulationError: nothing recorded, a variant or channel that was not, or fewer than two frames.
    """
    from warpchain.archive import read_archive

    run = source if isinstance(source, Run) else read_archive(source)
    index = run.first if variant is None else variant
    trajectory = run[index]
    require_channels(trajectory, *needed, name=f"variant {index}")
    if len(trajectory.time) < 2:
        raise SimulationError(f"variant {index} has {len(trajectory.time)} frames, at least 2 are needed")
    (row,) = run.metrics.slice(run.row_of(index), 1).to_pylist()
    return RecordedVariant(run, index, replace(trajectory, window=metrics_window(row, trajectory)), f"variant {index}")


def variants_by_chain(one: RecordedVariant) -> list[RecordedVariant]:
    """Chains of a recorded variant, each to draw as one."""
    chains = chain_trajectories(one.trajectory).items()
    return [replace(one, trajectory=chain, label=f"{one.label} {name}".rstrip(), chain=name) for name, chain in chains]


def compared_variants(
    source: RunSource,
    variant: int | None,
    others: Sequence[str | int | Run | Path],
    needed: Sequence[str] = DRIVE_CHANNELS,
) -> list[RecordedVariant]:
    """Recorded variants to compare in a picture, each once, with labels.

    `others` are numbers in `source`, other runs or archives, or "ARCHIVE:NUMBER"; raises as `recorded_variant`.
    """
    first = recorded_variant(source, variant, needed)
    home = "" if isinstance(source, Run) else Path(source).stem
    found = [(home, first)]
    runs: dict[str, Run] = {}
    for other in others:
        name, number = _variant_address(other)
        where: RunSource = first.run if name is None else name
        if isinstance(where, str):
            from warpchain.archive import read_archive

            if where not in runs:
                runs[where] = read_archive(where)
            found.append((Path(where).stem, recorded_variant(runs[where], number, needed)))
        else:
            found.append((home if name is None else "", recorded_variant(where, number, needed)))
    single: dict[tuple[int, int], tuple[str, RecordedVariant]] = {}
    for stem, one in found:
        single.setdefault((id(one.run), one.index), (stem, one))
    shown_runs = {id(one.run) for _, one in single.values()}
    stems = [stem for stem, _ in single.values()]
    shown: list[RecordedVariant] = []
    for k, (stem, one) in enumerate(single.values()):
        label = one.label
        if len(shown_runs) > 1:
            origin = stem or f"run {k + 1}"
            label = f"{origin} {one.index}" if stems.count(stem) > 1 or len(one.run) > 1 else origin
        if label in {other.label for other in shown}:
            label = f"{label} ({k + 1})"
        shown.append(RecordedVariant(one.run, one.index, one.trajectory, label))
    return shown


def _variant_address(word: str | int | Run | Path) -> tuple[Run | str | None, int | None]:
    """Run or path, or None, and number of a variant to compare."""
    if isinstance(word, int):
        return None, word
    if isinstance(word, Run):
        return word, None
    text = str(word)
    if text.isdecimal() and not Path(text).exists():
        return None, int(text)
    path, mark, number = text.rpartition(":")
    if mark and number.isdecimal() and not Path(text).exists():
        return path, int(number)
    return text, None


def varied_inputs(run: Run) -> dict[str, np.ndarray]:
    """Numbers (V,) of the drive that vary in a run, by key path."""
    flat = [_numbers_by_path(drive.as_read.model_dump()) for drive in run.drives]
    names: dict[str, None] = {}
    for values in flat:
        names |= dict.fromkeys(values)
    columns = {name: np.array([values.get(name, np.nan) for values in flat]) for name in names}
    return {name: column for name, column in columns.items() if len(np.unique(column)) > 1}


def _numbers_by_path(node: object, path: str = "") -> dict[str, float]:
    """Numbers in a variant's nested tables and lists, by key path."""
    if isinstance(node, bool) or node is None or isinstance(node, str):
        return {}
    if isinstance(node, (int, float)):
        return {path: float(node)}
    if isinstance(node, dict):
        parts = [(str(key), value) for key, value in node.items()]
    elif isinstance(node, (list, tuple)):
        parts = [(str(v.get("name", k)) if isinstance(v, dict) else str(k), v) for k, v in enumerate(node)]
    else:
        return {}
    found: dict[str, float] = {}
    for key, value in parts:
        found |= _numbers_by_path(value, f"{path}.{key}" if path else key)
    return found


def legend_titles(shown: Sequence[RecordedVariant]) -> list[str]:
    """Legends' words for recorded variants and chains, "" of an only one."""
    single = len({(id(one.run), one.index) for one in shown}) == 1
    return [one.chain if single else one.label for one in shown]
