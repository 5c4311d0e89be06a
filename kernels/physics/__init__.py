"""The physics, once, as small functions that the CPU's and the GPU's kernels both call."""
