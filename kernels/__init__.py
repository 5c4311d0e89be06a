"""Warp code of the solver: the physics (`physics`), and kernels that call it.

`cpu` runs one variant a thread, `gpu` one variant a block of threads.
"""
