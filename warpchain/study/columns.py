"""Columns of a study's table that are neither a factor nor a metric."""

from __future__ import annotations

from warpchain.results.metrics import RUN_COLUMNS, SETTLING_COLUMNS

OUTCOME = ("status", "reason")
"""How a variant ended, and why where that is not "ok"."""
ARCHIVED = ("archive", "archive_variant")
"""File of a recorded variant in the study's folder, and its number there."""
ADJUSTED = ("adjusted_links", "adjusted_travel")
"""What was adjusted so that the chain fits: number of links, travel of the sprocket [m]."""
BOOKKEEPING = ("variant", *OUTCOME, *ARCHIVED, *ADJUSTED, *RUN_COLUMNS, *SETTLING_COLUMNS)
"""All of them."""
