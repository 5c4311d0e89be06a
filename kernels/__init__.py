"""Warp code of the solver: the physics as small functions (`physics`), and kernels that call it.

Nothing here knows of the package above it. `cpu` runs one variant a thread, `gpu` one variant a block of threads.
"""
