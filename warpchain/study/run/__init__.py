"""Runs studies: their folders, shards and merging."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from warpchain.study.run.join import join_studies
    from warpchain.study.run.merge import merge_study
    from warpchain.study.run.runner import run_study
    from warpchain.study.run.status import study_status

_HOME = {"join_studies": "join", "merge_study": "merge", "run_study": "runner", "study_status": "status"}

__all__ = ["join_studies", "merge_study", "run_study", "study_status"]


def __getattr__(name: str) -> Any:
    """Imports a name when it is first used, so that telling how a study stands loads nothing heavy."""
    if name in _HOME:
        return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
