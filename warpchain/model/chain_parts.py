"""Parts of a drive that belong to each chain."""

from __future__ import annotations

from collections.abc import Callable, Set
from typing import Any

from warpchain.drive.arms import Arm
from warpchain.drive.sprocket import ArmMount

CHAIN_PARTS = ("sprockets", "guides", "arms", "tensioners", "probes")
"""Lists of parts of one chain."""
GROUP_PARTS = ("gears", "couplings", "valves")
"""Lists of parts of one group of bodies."""
TRAIN_PARTS = ("shafts", *GROUP_PARTS)
"""Lists of parts that turn with sprockets."""


def chain_part_places(drive: Any, name: str) -> dict[str, tuple[int, ...]]:
    """Indices of a chain's parts in the drive, by list."""
    naming = ("sprockets", "guides", "probes")
    own = {kind: {i for i, part in enumerate(getattr(drive, kind)) if part.chain == name} for kind in naming}
    own["arms"] = {a for a, arm in enumerate(drive.arms) if chain_of_arm(drive, arm) == name}
    bodies = {drive.sprockets[s].name for s in own["sprockets"]} | {drive.arms[a].name for a in own["arms"]}
    own["tensioners"] = {t for t, tensioner in enumerate(drive.tensioners) if tensioner.on in bodies}
    return {kind: tuple(sorted(own[kind])) for kind in CHAIN_PARTS}


def chain_of_arm(drive: Any, arm: Arm) -> str | None:
    """Name of an arm's chain, by what its row of arms carries."""
    first = arm.arm or arm.name
    row = {first} | {other.name for other in drive.arms if other.arm == first}
    guides = [guide.chain for guide in drive.guides if guide.arm in row]
    carried = [s.chain for s in drive.sprockets if isinstance(s.mount, ArmMount) and s.mount.arm in row]
    return next(iter(guides + carried), drive.chains[0].name)


def motion_by_own_angle(motion: Any, names: Set[str], ratio: Callable[[str], float]) -> Any:
    """A motion, load or motor over angles within its chain.

    Args:
        names: of the chain's shafts.
        ratio: of a shaft's speed to its own.
    """
    changes: dict[str, Any] = {}
    if getattr(motion, "harmonics", ()):
        changes["harmonics"] = tuple(
            h if h.shaft is None or h.shaft in names
            else h.model_copy(update={"order": h.order * ratio(h.shaft), "shaft": None})
            for h in motion.harmonics
        )  # fmt: skip
    table = motion.table
    if table is not None and table.shaft is not None and table.shaft not in names:
        angle = tuple(x / ratio(table.shaft) for x in table.angle)
        changes["table"] = table.model_copy(update={"angle": angle, "shaft": None})
    return motion.model_copy(update=changes) if changes else motion
