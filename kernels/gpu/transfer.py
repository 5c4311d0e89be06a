"""Copies between a GPU and pinned memory of the host by a kernel, which a graph makes sooner than copy engines do."""

import warp as wp


@wp.kernel(enable_backward=False)
def copy_words(source: wp.array[wp.uint32], target: wp.array[wp.uint32]):
    """Copies words of four bytes, one a thread."""
    i = wp.tid()
    target[i] = source[i]


@wp.kernel(enable_backward=False)
def copy_words_at(places: wp.array[wp.int32], source: wp.array[wp.uint32], target: wp.array[wp.uint32]):
    """Copies the words at some places to the same places, one a thread."""
    i = places[wp.tid()]
    target[i] = source[i]
