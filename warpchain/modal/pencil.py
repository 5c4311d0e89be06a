r"""Eigenvalues of small motion about a standing or steadily running drive.

    (s^2 M + s (C + G) + K) x = 0,    s = -zeta omega +- i omega sqrt(1 - zeta^2),

K the stiffness, that of a running chain with the bending that its running takes off (`engine.standing`, (a)), C the
damping, and G what makes strands travel: a roller that hangs at a place of its own moves on to the next f times a
second, so its acceleration has the part 2 f (x_{i+1} - x_{i-1}) / 2 beside the m f^2 D2 x that is in K. With T the
tension, m_l the mass of a length and v the speed the whole is a travelling string's m_l w'' + 2 v m_l D1 w' -
(T - m_l v^2) D2 w at the chain's own spacing. On sprockets rollers keep their places.

Small pencils are solved whole; of large ones the eigenvalues nearest to zero, by Arnoldi's method on the inverse, whose
matrix is banded but for the bodies' columns. Coordinates without mass (oil in tensioners) have one finite eigenvalue
each and one at infinity, which is left out.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import LinearOperator, eigs, splu

from warpchain.modal.coordinates import Array

WHOLE = 120
"""Coordinates up to which a pencil is solved whole."""
SHIFT = 1e-2
"""Where eigenvalues are sought nearest to, of the unit of time; not at zero, which may be one of them."""
INFINITE = 1e-9
"""Its inverse is an eigenvalue, of the unit of time, that is none: rounding makes it of one at infinity."""


def travelling(rollers: int, mass: float, rate: float, links: NDArray[np.bool_], count: int) -> sp.csc_array:
    """(n, n) G [N s/m] of a chain that passes `rate` rollers a second, on these links (N,); skew.

    Args:
        mass: of a roller [kg].
        count: n.
    """
    i = np.flatnonzero(links)
    j = (i + 1) % rollers
    value = np.full(len(i), mass * rate)
    ring = sp.coo_array((np.append(value, -value), (np.append(i, j), np.append(j, i))), shape=(rollers, rollers))
    both = sp.kron(ring.tocsc(), sp.eye_array(2))
    return sp.csc_array(sp.block_diag([both, sp.csc_array((count - 2 * rollers,) * 2)]))


def eigenpairs(
    mass: sp.csc_array, damping: sp.csc_array, stiffness: sp.csc_array, wanted: int, unit: float
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """The `wanted` eigenvalues nearest to zero with Im s >= 0, and more if they come, by size.

    Args:
        unit: a frequency of the size of those sought [rad/s]; it scales the time.

    Returns:
        (K,) s [1/s], and (n, K) their vectors.
    """
    n = mass.shape[0]
    m, c, k = mass, damping / unit, stiffness / unit**2
    if n <= WHOLE:
        above = np.hstack([np.zeros((n, n)), np.eye(n)])
        below = np.hstack([-k.toarray(), -c.toarray()])
        right = scipy.linalg.block_diag(np.eye(n), m.toarray())
        (top, bottom), vector = scipy.linalg.eig(np.vstack([above, below]), right, homogeneous_eigvals=True)
        finite = np.abs(bottom) > INFINITE * np.abs(top)
        value, vector = top[finite] / bottom[finite], vector[:, finite]
    else:
        value, vector = _nearest(m, c, k, min(2 * wanted + 8, n))
    upper = np.flatnonzero(value.imag >= 0.0)
    upper = upper[np.argsort(np.abs(value[upper]))]
    return unit * value[upper], vector[:n, upper]


def _nearest(m: sp.csc_array, c: sp.csc_array, k: sp.csc_array, count: int) -> tuple[Array, Array]:
    """Eigenvalues of the linearized pencil nearest to the shift."""
    n = m.shape[0]
    factor = splu((k + SHIFT * c + SHIFT**2 * m).tocsc())
    drag = (c + SHIFT * m).tocsr()

    def apply(vector: Array) -> Array:
        first, second = vector[:n], m @ vector[n:]
        x = -factor.solve(second + drag @ first)
        return np.concatenate([x, first + SHIFT * x])

    inverse = LinearOperator((2 * n, 2 * n), matvec=apply, dtype=np.float64)
    start = np.random.default_rng(0).standard_normal(2 * n)
    value, vector = eigs(inverse, k=count, v0=start, ncv=min(2 * n - 1, max(3 * count, 60)), maxiter=2000)
    return SHIFT + 1.0 / value, vector
