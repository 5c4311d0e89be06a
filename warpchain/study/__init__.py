"""Studies: designs of experiments over a drive, their results and what they say."""
