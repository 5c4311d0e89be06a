"""The CPU kernels: one Warp thread a variant."""
