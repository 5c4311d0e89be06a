"""Pictures of runs: playback in Rerun, figures as files."""
