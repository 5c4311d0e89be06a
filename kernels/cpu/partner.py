"""A partner of the chain, a sprocket or a guide, as the CPU kernel's passes see it."""

from functools import cache
from typing import Any

import warp as wp

from ..structs import Pose, types


@cache
def partner_type(Real: type) -> Any:
    """The struct of a partner for values of type `Real`."""
    kinds = types(Real)

    @wp.struct
    class Partner:
        """A sprocket, or a guide where `teeth` is 0, and the body that carries it."""

        teeth: wp.int32
        body: wp.int32  # of the drive, or `GROUND`
        pose: Pose
        sprocket: kinds.Sprocket
        guide: kinds.Guide

    return Partner
