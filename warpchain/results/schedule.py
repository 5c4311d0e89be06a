"""When a variant steps, is sampled, and is measured."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Schedule:
    """When a variant steps, samples and measures; counts of steps of `step` seconds."""

    step: float
    steps: int
    window_start: int
    window_end: int
    sample_every: int  # 0: not recorded

    @property
    def frames(self) -> int:
        """Number of frames of the whole run, the one at t = 0 among them."""
        return self.steps // self.sample_every + 1 if self.sample_every else 0
