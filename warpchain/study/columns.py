"""Columns of a study's table that are neither a factor nor a metric."""

from __future__ import annotations

from warpchain.results.columns import RUN, SETTLING
from warpchain.study.reasons import OUTCOME

ARCHIVED = ("archive", "archive_variant")
"""File of a recorded variant in the study's folder, and its number there."""
ADJUSTED = ("adjusted_links", "adjusted_travel")
"""What was adjusted so that the chain fits: number of links, travel of the sprocket [m]."""
RUN_COLUMNS = tuple(column.name for column in RUN.columns if column.name not in ("variant", *OUTCOME))
"""How far a variant ran and which window its metrics are of."""
SETTLING_COLUMNS = tuple(column.name for column in SETTLING.columns)
"""How the start was settled, where it was."""
BOOKKEEPING = ("variant", *OUTCOME, *ARCHIVED, *ADJUSTED, *RUN_COLUMNS, *SETTLING_COLUMNS)
"""All of them."""
