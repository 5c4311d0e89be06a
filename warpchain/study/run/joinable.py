"""Which studies can be joined, and what the joined one is: the same drive, factors and run settings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from warpchain.drive import Drive
from warpchain.drive.toml import value_text
from warpchain.errors import StudyError
from warpchain.study.run.folder import Folder
from warpchain.study.spec import Study
from warpchain.study.spec.factor import Factor
from warpchain.study.spec.parts import Design

BEGINNINGS: Mapping[str, Any] = {"phase": 0.0}
"""Keys of `run` that say how a drive begins, and what stands for none; they become hidden factors."""
FREE = ("shard", "device", "keep_states")
"""Run settings that may differ."""
WANTED = ("objectives", "bounds", "optimize")
"""Fields of a study that no run depends on."""
SPREAD = ("range", "levels", "choice", "points", "distribution", "mean", "std", "group")
"""Keys of a factor that say how its values are spread, not what they do."""


def joined_study(opened: Sequence[Folder], rows: str) -> Study:
    """The joined study, without what follows from its rows.

    Args:
        rows: file of its design.

    Raises:
        StudyError: one line for each key in which they differ.
    """
    first = opened[0]
    lines = [line for other in opened[1:] for line in _differences(first, other)]
    if lines:
        raise StudyError("\n".join(dict.fromkeys(lines)))
    study = first.study
    wanted = {name: next((getattr(f.study, name) for f in opened if getattr(f.study, name)), getattr(study, name))
              for name in WANTED}  # fmt: skip
    factors = [_widened([_factor(f.study, factor.name) for f in opened]) for factor in study.factors]
    copies = max(f.copies for f in opened)
    ways = [f.study.design.replicate_by for f in opened if f.copies > 1]
    replicates, way = (copies, next(iter(ways))) if copies > 1 else (None, None)
    changed = {
        "study": study.study.model_copy(update={"drive": "drive.toml"}),
        "design": Design(kind="table", file=rows, replicates=replicates, replicate_by=way),
        "factors": (*(factor for factor in factors if factor is not None), *_beginnings(opened)),
    }
    return study.model_copy(update={**changed, **wanted})


def _factor(study: Study, name: str) -> Factor:
    return next(factor for factor in study.factors if factor.name == name)


def _differences(first: Folder, other: Folder) -> Iterator[str]:
    """What keeps two folders from being joined, a line each."""
    ours, theirs = _fixed(first), _fixed(other)
    if first.copies > 1 and other.copies > 1:
        for folder, fixed in ((first, ours), (other, theirs)):
            fixed["design"] = {"replicate_by": folder.study.design.replicate_by or "phase"}
    for path, here, there in _unlike(ours, theirs):
        yield (
            f"{other.path}: {path} = {_shown(there)}, but {_shown(here)} in {first.path}; only studies that run the "
            "same can be merged"
        )
    for name in WANTED:
        wanted = [getattr(folder.study, name) for folder in (first, other)]
        if all(wanted) and wanted[0] != wanted[1]:
            said = "limits" if name == "bounds" else name
            yield f"{other.path}: {said}: not those of {first.path}; only studies that want the same can be merged"
    names = {factor.name for factor in other.study.factors}
    for factor in first.study.factors:
        if factor.name in names and _widened([factor, _factor(other.study, factor.name)]) is None:
            yield (
                f"{other.path}: factors.{factor.name}: not distributed as in {first.path}; only ranges, levels and "
                "choices can be put together"
            )


def _fixed(folder: Folder) -> dict[str, Any]:
    """What of a study must be the same, by key."""
    found = folder.study.model_dump(mode="json", exclude={"study", "design", *WANTED})
    found["factors"] = {f.name: f.model_dump(mode="json", exclude=set(SPREAD)) for f in folder.study.factors}
    found["run"] = {key: value for key, value in found["run"].items() if key not in FREE}
    found["record"].pop("variants")
    own = folder.drive
    found["drive"] = own.model_copy(update={"run": own.run.model_copy(update=dict.fromkeys(BEGINNINGS))}).model_dump(
        mode="json"
    )
    return found


def _unlike(ours: Any, theirs: Any, path: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Key paths in which two nested values differ, and both values."""
    if isinstance(ours, dict) and isinstance(theirs, dict):
        for key in dict.fromkeys([*ours, *theirs]):
            yield from _unlike(ours.get(key), theirs.get(key), f"{path}.{key}" if path else str(key))
    elif isinstance(ours, list) and isinstance(theirs, list) and len(ours) == len(theirs):
        for k, (one, two) in enumerate(zip(ours, theirs, strict=True)):
            yield from _unlike(one, two, f"{path}.{one.get('name', k) if isinstance(one, dict) else k}")
    elif ours != theirs:
        yield path, ours, theirs


def _shown(value: Any) -> str:
    """A value for a message."""
    text = "nothing" if value is None else "a table" if isinstance(value, dict) else value_text(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _widened(factors: Sequence[Factor]) -> Factor | None:
    """A factor whose range, levels or choice take in those of all; None if there is none."""
    first = factors[0].model_copy(update={"points": None})
    if all(factor.model_copy(update={"points": None}) == first for factor in factors):
        return first
    kinds, changed = {factor.kind for factor in factors}, dict[str, Any]()
    if kinds in ({"uniform"}, {"log-uniform"}):
        ends = [end for factor in factors for end in factor.range or ()]
        changed["range"] = (min(ends), max(ends))
    elif kinds == {"levels"}:
        changed["levels"] = tuple(sorted({value for factor in factors for value in factor.levels or ()}))
    elif kinds == {"choice"}:
        changed["choice"] = tuple(dict.fromkeys(value for factor in factors for value in factor.choice or ()))
    return first.model_copy(update={"group": None, **changed}) if changed else None


def _beginnings(opened: Sequence[Folder]) -> Iterator[Factor]:
    """Hidden factors for what the drives differ in of how they begin."""
    for name in BEGINNINGS:
        if len({start_of(folder.drive, name) for folder in opened}) > 1:
            yield Factor(name=name, path=f"run.{name}", hidden=True)


def start_of(drive: Drive, name: str) -> Any:
    """How a drive begins."""
    value = getattr(drive.run, name)
    return BEGINNINGS[name] if value is None else value
