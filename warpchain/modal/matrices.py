r"""Stiffness and damping matrix of a drive by central differences of its own forces.

With f(q, v) the generalized forces, d and e small steps:

    K_ij = -(f_i(q + d e_j, 0) - f_i(q - d e_j, 0)) / 2 d,    C_ij = -(f_i(q, e e_j) - f_i(q, -e e_j)) / 2 e.

A roller feels its two neighbors and the bodies only. So rollers three or more apart are moved in one copy, which takes
6 to 10 columns' worth of copies however long the chain is; each body's coordinate takes a copy of its own. What a
moved roller does to the bodies is the transpose of what a moved body does to the roller: the forces between them are
opposite and equal, elastic ones have a potential, and those of dampers a dissipation function.

Steps are powers of two, so that places are moved by exactly them.

What leaks out of a tensioner's chamber, eq. (a) of `coordinates`, comes from the tensioner's own numbers: forces do not
show flows.
"""

from __future__ import annotations

import math

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from warpchain.engine.probe import Probe, States
from warpchain.modal.coordinates import Array, Coordinates

STEP = 1e-7
"""Displacement, of a pitch: rounding leaves 1e-9 of a link's stiffness, and contacts stay as closed or open as they are
but for those that 1e-9 m or so would open."""
SPEED = 2.0**-17
"""Velocity step [m/s]; far below the floors of impact speeds."""


def colors(rollers: int) -> list[NDArray[np.int64]]:
    """Sets of rollers of a closed chain, any two of a set at least three apart; together all rollers once."""
    whole = rollers - rollers % 3
    sets = [np.arange(first, whole, 3) for first in range(3)]
    return sets + [np.array([i]) for i in range(whole, rollers)]


def stiffness(probe: Probe, at: Coordinates, base: States, pitch: float) -> sp.csc_array:
    """(n, n) K [N/m, N/rad, N m/rad] about a state at rest."""
    step = 2.0 ** math.floor(math.log2(STEP * pitch))
    steps = np.full(at.count, step)
    widest = float(probe.base.sprockets["exact_radius"].max(initial=pitch))
    steps[2 * at.rollers : at.solid][at.turning] = 2.0 ** math.floor(math.log2(step / widest))
    return _differences(probe, at, steps, lambda change: at.moved(base, change))


def damping(probe: Probe, at: Coordinates, base: States, conductance: Array | None = None) -> sp.csc_array:
    """(n, n) C [N s/m, ...] about a state at rest; with what leaks where `conductance` is given, as of `leakage`."""
    own = _differences(probe, at, np.full(at.count, SPEED), lambda change: at.moving(base, change))
    return own if conductance is None else sp.csc_array(own + leakage(probe, at, conductance))


def leakage(probe: Probe, at: Coordinates, conductance: Array) -> sp.csc_array:
    """(n, n) what the oil that leaves the chambers of hydraulic tensioners adds to C: A^2 / G, and -(A d / G) x'.

    Args:
        conductance: (w,) G of each chamber [m^3/(s Pa)].
    """
    of = probe.base.tensioners[at.chambers]
    places = at.solid + np.arange(len(of))
    gap = np.zeros((len(of), at.count))
    gap[np.arange(len(of)), places] = of["area"] ** 2 / conductance
    gap -= (of["area"] * of["drag"] / conductance)[:, None] * at.strokes[at.chambers]
    above = sp.csc_array((at.solid, at.count))
    return sp.csc_array(sp.vstack([above, sp.csc_array(gap)]))


def _differences(probe, at: Coordinates, steps: Array, states) -> sp.csc_array:  # type: ignore[no-untyped-def]
    """Minus the derivative of the forces by central differences; symmetric."""
    own, n = 2 * at.rollers, at.count
    sets = [2 * some + axis for some in colors(at.rollers) for axis in (0, 1)]
    sets += [np.array([k]) for k in range(own, n)]
    change = np.zeros((len(sets), n))
    for row, some in zip(change, sets, strict=True):
        row[some] = steps[some]
    both = at.forces(probe, states(np.concatenate([change, -change])))
    slope = -0.5 * (both[: len(sets)] - both[len(sets) :])
    rows, columns, values = [], [], []
    near = np.arange(-2, 4)  # a roller's neighbors' coordinates, from its own x
    for some, answer in zip(sets, slope, strict=True):
        if some[0] < own:
            felt = (some - some % 2)[:, None] + near
            felt %= own
            columns.append(np.repeat(some, len(near)))
            rows.append(felt.ravel())
            values.append((answer[felt] / steps[some][:, None]).ravel())
        else:
            column = answer / steps[some]
            felt = np.flatnonzero(column)
            rollers = felt[felt < own]
            rows += [felt, np.full(len(rollers), some[0])]
            columns += [np.full(len(felt), some[0]), rollers]
            values += [column[felt], column[rollers]]
    place = (np.concatenate(rows), np.concatenate(columns))
    matrix = sp.coo_array((np.concatenate(values), place), shape=(n, n)).tocsc()
    return sp.csc_array(0.5 * (matrix + matrix.T))
