"""Walks over the bodies of one variant that the CPU and blocks share: over arrays of either, body by body."""
