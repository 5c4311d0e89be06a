"""Designs of experiments: the rows of a study."""

from warpchain.study.design.design_table import (
    make_design,
)

__all__ = [
    "make_design",
]
