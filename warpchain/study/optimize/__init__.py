"""Decisions out of studies: objectives, limits, rounds of rows, designs to recommend."""

from warpchain.study.analysis.pareto import Goals, goals_of_study
from warpchain.study.optimize.design_search import SearchResult, optimize
from warpchain.study.optimize.optimizer import Optimizer
from warpchain.study.optimize.recommend import RecommendedDesign, recommend
from warpchain.study.optimize.study_session import StudySession, open_study

__all__ = [
    "Goals",
    "Optimizer",
    "RecommendedDesign",
    "SearchResult",
    "StudySession",
    "goals_of_study",
    "open_study",
    "optimize",
    "recommend",
]
