"""Moments that turn the bodies of trains, on the CPU and blocks alike (`physics.train`, `physics.valve`).

`motions`, `cams` and `moments` are by body; a train's bodies are among `count` from `first` on.
"""

from typing import Any

import warp as wp

from ..native import quotient
from ..physics.valve import add_geared_cam


@wp.func
def train_cam(motions: Any, cams: Any, first: int, count: int, b: int):
    """Inertia and moment, on body `b`, of its train's valves."""
    own, cam = motions[b], type(cams[b])()
    for other in range(first, first + count):
        motion = motions[other]
        if motion.train == own.train:
            cam = add_geared_cam(cam, cams[other], quotient(motion.ratio, own.ratio))
    return cam


@wp.func
def train_moment(motions: Any, moments: Any, first: int, count: int, b: int):
    """Moment [N m] that turns body `b` as if it turned alone (`physics.train`, (a)), from `moments` on each body."""
    own, total = motions[b], type(moments[b])(0.0)
    for other in range(first, first + count):
        motion = motions[other]
        if motion.train == own.train:
            total = total + motion.ratio * moments[other]
    return quotient(total, own.ratio)
