"""Square roots of lengths: on CUDA from the reciprocal root, which is one instruction and a few corrections there,
where a root and a division are subroutines; elsewhere as written.
"""

import warp as wp


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return rsqrt(square);
#else
    return 1.0 / sqrt(square);
#endif
""")
def inverse_root(square: wp.float64) -> wp.float64:
    """1 / sqrt(square), square > 0."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return rsqrtf(square);
#else
    return 1.0f / sqrt(square);
#endif
""")
def inverse_root(square: wp.float32) -> wp.float32:
    """1 / sqrt(square), square > 0."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return square * rsqrt(square);
#else
    return sqrt(square);
#endif
""")
def root(square: wp.float64) -> wp.float64:
    """sqrt(square), square > 0."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return square * rsqrtf(square);
#else
    return sqrt(square);
#endif
""")
def root(square: wp.float32) -> wp.float32:
    """sqrt(square), square > 0."""
    ...
