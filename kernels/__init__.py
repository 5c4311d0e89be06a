"""Warp code of the solver: the physics as small functions (`link`, `tooth`, `guide`, `impact`, `motion`), then the
kernels that call it.

Nothing here knows of the package above it. `serial` runs one variant a thread (CPU); `block` one variant a block of
threads (GPU), so far the bare time loop, which `simulate` does not use yet.
"""
