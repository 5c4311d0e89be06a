"""Rigid rotation of bodies and chains that turn freely, taken out of the stiffness matrix (docs/modes.md)."""

from __future__ import annotations

import math

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from warpchain.drive.body_ties import part_of_body, ratios_with_chains
from warpchain.drive.schema import node_value
from warpchain.modal.matrices import Array
from warpchain.modal.small_motion import DriveMotion
from warpchain.model import Model
from warpchain.model.trains import is_free_body


def free_rotations(found: DriveMotion) -> list[list[float]]:
    """Ratios of turns (B,) of bodies in each freely turning group."""
    drive = found.drive
    tied, _ = ratios_with_chains(drive)
    held = {
        tied.root[b]
        for b in range(len(drive.sprockets) + len(drive.shafts))
        if not is_free_body(drive, b) or node_value(part_of_body(drive, b), "balance_wheel") is not None
    }
    return [
        [float(ratio) * (root == free) for ratio, root in zip(tied.ratio, tied.root, strict=True)]
        for free in sorted(set(tied.root) - held)
    ]


def stiffness_without_rotation(found: DriveMotion, groups: list[list[float]], small: float) -> sp.csc_array:
    """Stiffness matrix (n, n) of a drive without rigid rotation.

    Args:
        small: [1/s^2], times mass holds what nothing else does.
    """
    stiffness = found.stiffness
    for turns in groups:
        r, of_sprockets = _rotation_vector(found, turns)
        angles, rest = np.flatnonzero(of_sprockets != 0), np.flatnonzero(of_sprockets == 0)
        if not (of_sprockets > 0).any():
            continue
        held = (stiffness + small * found.mass)[rest][:, rest]
        r[rest] -= splu(sp.csc_array(held)).solve((stiffness @ r)[rest])
        g, w = np.zeros_like(r), np.where(of_sprockets > 0, r, 0.0)
        g[angles] = (stiffness @ r)[angles]
        g, w = sp.csc_array(g[:, None]), sp.csc_array(w[:, None])
        along, work = float((w.T @ r)[0]), float((g.T @ r)[0])
        stiffness = stiffness - (g @ w.T + w @ g.T) / along + (work / along**2) * (w @ w.T)
    return sp.csc_array(stiffness)


def _rotation_vector(found: DriveMotion, turns: list[float]) -> tuple[Array, Array]:
    """Rigid rotation (n,), and marks (n,) of sprockets' angles."""
    drive, size = found.drive, found.mass.shape[0]
    model, turning = Model(drive), len(drive.sprockets) + len(drive.shafts)
    above, below, angles = np.zeros(size), np.zeros(size), np.zeros(size)
    passing = turns[turning:]
    for part, tie, chain, passed in zip(found.parts, found.ties, found.chains, passing, strict=True):
        place = part.state.position[0]
        along = np.roll(place, -1, axis=0) - np.roll(place, 1, axis=0)
        straight = passed * part.model.chain.pitch * along / np.hypot(*along.T)[:, None]
        turned = np.zeros_like(part.state.bodies[0])
        for k, b in enumerate(model.bodies_of_chain(chain)):
            place_of = part.at.turning_coordinate(k)
            if b < turning and turns[b] and place_of is not None:
                turned[k, 2] = math.tau * turns[b]
                column = tie[[place_of[0]]].nonzero()[1]
                angles[column] = 1.0 if b < len(drive.sprockets) else np.where(angles[column] > 0, 1.0, -1.0)
        above += tie.T @ part.at.coordinate_vector(straight[None], turned[None])[0]
        below += tie.multiply(tie).sum(axis=0)
    return above / np.maximum(below, 1e-300), angles
