"""Kernels of tests, all in one module of Warp, which is compiled once for them."""

import warp as wp

kernel = wp.kernel(enable_backward=False, module=wp.get_module("tests"))
"""Makes a function a kernel of a test; those made while tests run want a module of their own instead."""
