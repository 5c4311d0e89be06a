"""The CPU kernels: one Warp thread a variant; functions for a type `Real` and scratch rows of `capacity` values."""
