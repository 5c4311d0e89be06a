"""Assembly of all chains of a drive, and the check for crossings."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from warpchain.assembly.assembly import Assembly, assemble_chain
from warpchain.assembly.path import ChainPath
from warpchain.drive.parts_by_chain import shaft_of_sprocket
from warpchain.errors import DriveError
from warpchain.model import ChainModel, Model


def assemble_chains(model: Model) -> list[Assembly]:
    """Initial states of a drive's chains, checked for crossings.

    Raises:
        DriveError: a chain that does not fit, or chains of one plane that cross.
    """
    found = []
    for chain in model.chains:
        try:
            found.append(assemble_chain(chain))
        except DriveError as error:
            raise DriveError(f'chain "{chain.name}": {error}' if chain.name else str(error)) from None
    check_planes(model, [assembly.path for assembly in found])
    return found


def check_planes(model: Model, paths: Sequence[ChainPath]) -> None:
    """Raises a DriveError where two chains of one plane, on no common shaft, cross."""
    drive, chains = model.drive, model.chains
    shafts = [{shaft_of_sprocket(drive.sprockets[s]) for s in chain.places["sprockets"]} for chain in chains]
    for i, k in combinations(range(len(chains)), 2):
        one, other = drive.chains[i], drive.chains[k]
        if one.plane != other.plane or shafts[i] & shafts[k]:
            continue
        place = _common_point(chain_outline(chains[i], paths[i]), chain_outline(chains[k], paths[k]))
        if place is not None:
            where = f"[{place[0]:.4g}, {place[1]:.4g}]"
            raise DriveError(
                f'chains "{one.name}" and "{other.name}" cross near {where} m in one plane; name another plane of one '
                f"of them (chains.{other.name}.plane), or move its sprockets"
            )


def chain_outline(chain: ChainModel, path: ChainPath) -> NDArray[np.float64]:
    """Corners (K, 2) of a chain's loop, with arcs every 5 degrees [m]."""
    points, count = [], len(chain.sprockets)
    for s, sprocket in enumerate(chain.sprockets):
        center, sign = np.array(sprocket.center), sprocket.sign
        begin, end = (np.asarray(of, dtype=float) for of in (path.strand_end[(s - 1) % count], path.strand_start[s]))
        first, last = (np.arctan2(*(at - center)[::-1]) for at in (begin, end))
        turn = sign * np.mod(sign * (last - first), 2.0 * np.pi)
        angles = first + turn * np.linspace(0.0, 1.0, max(2, int(abs(turn) / np.radians(5.0)) + 2))
        radius = np.hypot(*(begin - center))
        points.append(center + radius * np.column_stack([np.cos(angles), np.sin(angles)]))
    return np.concatenate(points)


def _common_point(one: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Point where two chains' loops of corners (K, 2) cross [m], or None."""
    a, b = one[:, None], np.roll(one, -1, axis=0)[:, None] - one[:, None]
    c, d = other[None], np.roll(other, -1, axis=0)[None] - other[None]
    turn = b[..., 0] * d[..., 1] - b[..., 1] * d[..., 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        here = ((c - a)[..., 0] * d[..., 1] - (c - a)[..., 1] * d[..., 0]) / turn
        there = ((c - a)[..., 0] * b[..., 1] - (c - a)[..., 1] * b[..., 0]) / turn
    both = np.argwhere((here >= 0.0) & (here < 1.0) & (there >= 0.0) & (there < 1.0))
    if not len(both):
        return None
    i, k = both[0]
    return np.asarray(a[i, 0] + here[i, k] * b[i, 0])
