"""The GPU kernels: one block of threads a variant."""
