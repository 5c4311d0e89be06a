"""Set-up help: the place of a guide that presses a strand in by a wanted depth.

With n across the common tangent of two pitch circles from a, from the guide to the chain, p the points of the guide's
face and h the height of rollers' centers over it, the depth, negative where it stays away, is

    d = max (p - a) n + h.                                                                                (a)
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from warpchain.argument_checks import check_arguments
from warpchain.assembly.fitting import paths_as_drawn
from warpchain.drive.thermal import expansion_factor
from warpchain.errors import DriveError
from warpchain.model import Model

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from warpchain.drive import Drive
    from warpchain.model import ChainModel

_SPACING = 2e-5  # between the points at which (a) is looked for [m]: 1e-10 m of an arc's top, of a radius of 0.5 m
_DIGITS = 10


@check_arguments(DriveError)
def fit_indentation(drive: Drive, guide: str, indentation: float) -> Drive:
    """Moves a guide across its nearest strand until it presses that in by a depth, eq. (a).

    Links need not fit then (`fit_links`). A guide on an arm moves in the arm's drawing.

    Args:
        drive: arms as drawn; its chain need not fit.
        guide: its name; no measured profile.
        indentation: depth [m], within half the strand's length; negative is how far it stays away.

    Returns:
        The drive with the guide moved; rounded to 1e-10 m.

    Raises:
        DriveError: an unknown name, a profile, a depth that is not allowed, or a path that cannot be drawn.
    """
    names = [one.name for one in drive.guides]
    if guide not in names:
        raise DriveError(f'guide "{guide}": no such name; allowed are {", ".join(names) or "none"}')
    if drive.guides[names.index(guide)].profile is not None:
        raise DriveError(f"guides.{guide}.profile: is measured; only start and end, points or arcs can be moved")
    own = next(model for model in Model(drive).chains if guide in [one.name for one in model.guides])
    depth, normal, length = _guide_indentation(own, [one.name for one in own.guides].index(guide))
    if not abs(indentation) <= 0.5 * length:
        raise DriveError(f"indentation = {indentation:g}: must be within {0.5 * length:.4g} m, half of the strand")
    way = (indentation - depth) * normal / expansion_factor(drive, "block")
    return drive.with_values(_moved_guide_values(drive, names.index(guide), way))


def _guide_indentation(model: ChainModel, g: int) -> tuple[float, NDArray[np.float64], float]:
    """Indentation d (a) by guide g [m], normal n, and the strand's length [m]."""
    (path,) = paths_as_drawn([replace(model, guides=())])
    if isinstance(path, DriveError):
        raise path
    profile = model.profile(g)
    points = profile.points(_SPACING, caps=False)
    middle = points[len(points) // 2]
    begin, along = path.strand_start, path.strand_end - path.strand_start
    share = np.clip(((middle - begin) * along).sum(axis=1) / (along**2).sum(axis=1), 0.0, 1.0)
    k = int(np.argmin(np.hypot(*(begin + share[:, None] * along - middle).T)))
    length = float(np.hypot(*along[k]))
    normal = np.array([-along[k, 1], along[k, 0]]) / length
    heading = points[-1] - points[0]
    normal = normal * math.copysign(1.0, float(normal @ [-heading[1], heading[0]]))  # the chain is on the left
    return float(((points - begin[k]) @ normal).max()) + model.guide_offset(g), normal, length


def _moved_guide_values(drive: Drive, g: int, way: NDArray[np.float64]) -> dict[str, object]:
    """Keys and values of guide g's place, moved by `way` (2,) [m]."""
    guide, values = drive.as_read.guides[g], dict[str, object]()

    def moved_point(point: tuple[float, float]) -> list[float]:
        """A guide's point, moved and rounded [m]."""
        return [round(float(part + step), _DIGITS) for part, step in zip(point, way, strict=True)]

    for key in ("start", "end"):
        if (point := getattr(guide, key)) is not None:
            values[f"guides.{g}.{key}"] = moved_point(point)
    for key in ("points", "bolts"):
        if getattr(guide, key):
            values[f"guides.{g}.{key}"] = [moved_point(point) for point in getattr(guide, key)]
    for i, arc in enumerate(guide.arcs or ()):
        values[f"guides.{g}.arcs.{i}.center"] = moved_point(arc.center)
    return values
