"""Force of the chain on every shaft, from recorded frames: the sum of the contact forces of the sprocket's rollers.

The frames hold the normal forces of the contacts; tooth friction, a few hundredths of them, is in the metrics
`SPROCKET.hub_force_*` only, which the kernels add up at watched steps.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from warpchain.results.run import Trajectory, need
from warpchain.results.scene import nearest_sprocket, sprocket_normals

Array = NDArray[np.float64]


def hub_forces(trajectory: Trajectory) -> Array:
    """Force of the chain on each sprocket (F, S, 2) [N], without tooth friction.

    Raises:
        SimulationError: recorded without positions, sprocket forces, angles or centers.
    """
    need(trajectory, "position", "sprocket_force", "sprocket_angle", "sprocket_center")
    assert trajectory.sprocket_force is not None
    frames, sprockets = len(trajectory.time), len(trajectory.drive.sprockets)
    near = nearest_sprocket(trajectory)
    found = np.zeros((frames, sprockets, 2))
    for s in range(sprockets):
        frame, roller = np.nonzero((trajectory.sprocket_force > 0.0) & (near == s))
        size = np.asarray(trajectory.sprocket_force, dtype=float)[frame, roller]
        push = -size[:, None] * sprocket_normals(trajectory, s, frame, roller)
        for k in range(2):
            found[:, s, k] = np.bincount(frame, push[:, k], minlength=frames)
    return found
