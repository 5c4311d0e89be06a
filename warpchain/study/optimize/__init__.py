"""Decisions out of studies: objectives, limits, rounds of rows."""
