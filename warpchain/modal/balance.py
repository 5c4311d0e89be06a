"""The last digits of a standing state, by Newton's method.

Relaxation leaves a millionth of the chain's tension unbalanced, which moves slack strands by micrometers. Each step
goes as far along K^-1 F as lowers the energy: to where the forces no longer work along it. A state in which contacts
are about to open or close has no stiffness of its own, and steps there lead back and forth; the best one is taken.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from warpchain.engine.probe import Probe, States
from warpchain.modal.coordinates import Coordinates
from warpchain.modal.matrices import stiffness

STEPS = 8
SHARES = 0.5 ** np.arange(8.0)
"""Of a step, tried at once."""
FAINT = 1e-10
"""Of the tension of a link: forces below this are rounding."""


def balanced(
    probe: Probe, at: Coordinates, state: States, pitch: float, tension: float
) -> tuple[States, sp.csc_array, float]:
    """The standing state nearest to a relaxed one, K there, and its largest force, of the tension.

    Args:
        state: one copy.
        tension: of a link, for comparison [N].
    """
    force = at.forces(probe, state)[0]
    best, least = state, float(np.abs(force).max())
    for _ in range(STEPS):
        if least < FAINT * tension:
            break
        try:
            step = splu(stiffness(probe, at, state, pitch)).solve(force)
        except RuntimeError:  # a motion that nothing restores
            break
        new = at.forces(probe, at.moved(state, SHARES[:, None] * step))
        along = np.abs(new @ step) < 0.9 * abs(float(force @ step))
        if not along.any():
            break
        k = int(np.argmax(along))
        state, force = at.moved(state, SHARES[k] * step[None]), new[k]
        if np.abs(force).max() < least:
            best, least = state, float(np.abs(force).max())
    return best, stiffness(probe, at, best, pitch), least / tension
