"""Runs studies: their folders, shards and merging."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from warpchain.study.run.join import join_studies
    from warpchain.study.run.runner import merge_study, run_study
    from warpchain.study.run.study_folder import study_status

_HOME = {"join_studies": "join", "merge_study": "runner", "run_study": "runner", "study_status": "study_folder"}

__all__ = ["join_studies", "merge_study", "run_study", "study_status"]


def __getattr__(name: str) -> Any:
    """Imports a public name of `study.run` when first used."""
    if name in _HOME:
        return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
