"""What the benchmarks' scripts have in common."""
