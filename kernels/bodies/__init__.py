"""Functions on one variant's bodies that the CPU and blocks share, over arrays of either."""
