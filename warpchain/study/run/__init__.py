"""Runs studies: their folders, shards and merging."""

from warpchain.study.run.join import join_studies
from warpchain.study.run.merge import merge_study, study_status
from warpchain.study.run.runner import run_study

__all__ = ["join_studies", "merge_study", "run_study", "study_status"]
