"""Decisions out of studies: objectives, limits, rounds of rows, designs to recommend."""

from warpchain.study.analysis.pareto import Goals, goals_of_study
from warpchain.study.optimize.bench import Bench, open_study
from warpchain.study.optimize.campaign import Found, optimize
from warpchain.study.optimize.optimizer import Optimizer
from warpchain.study.optimize.recommend import Recommended, recommend

__all__ = [
    "Bench",
    "Found",
    "Goals",
    "Optimizer",
    "Recommended",
    "goals_of_study",
    "open_study",
    "optimize",
    "recommend",
]
