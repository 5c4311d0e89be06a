"""Studies: designs of experiments over a drive, their runs, analysis, search and reports."""
