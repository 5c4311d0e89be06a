"""The path of a drive's chain, its arms in balance."""

from __future__ import annotations

from typing import TYPE_CHECKING

from warpchain.assembly.arms import Balance
from warpchain.assembly.path import ChainPath, Plan

if TYPE_CHECKING:
    from warpchain.drive import Drive


def chain_path(drive: Drive) -> ChainPath:
    """The path of the drive's chain; its number of links need not fit (see `check_fit`). Arms stand in balance.

    Raises:
        DriveError: as `path_at`; or an arm that finds no balance.
    """
    return chain_paths(drive)[0]


def chain_paths(drive: Drive) -> ChainPath:
    """`chain_path` of a stack, with its first axis.

    Raises:
        DriveError: as `chain_path`, of the first such variant.
        Unlike: a stack of which some go around other arcs of guides.
    """
    return Balance(drive).path() if drive.arms else Plan(drive).path(())
