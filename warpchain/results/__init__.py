"""Results of runs: trajectories, metrics, objectives, and figures for engineers."""
