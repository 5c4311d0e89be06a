"""Warp code of the solver: physics (`physics`), and kernels that call it.

`cpu` runs one variant a thread, `gpu` one a block of threads.
"""
