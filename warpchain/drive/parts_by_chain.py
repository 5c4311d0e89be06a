"""The chain and the shaft that a sprocket, guide or probe belongs to."""

from __future__ import annotations

from typing import Any

from warpchain.drive.chain import Chain, NamedChain
from warpchain.drive.schema import node_list, node_value, valid_part

Path = tuple[str | int, ...]
"""A key path of a drive file."""


def chain_nodes(drive: Any) -> list[tuple[Path, Any]]:
    """Key path and values of each chain of a drive, one or more."""
    listed: list[tuple[Path, Any]] = [(("chains", c), chain) for c, chain in enumerate(node_list(drive, "chains"))]
    return listed or [(("chain",), node_value(drive, "chain"))]


def chain_of_part(drive: Any, part: Any) -> Chain | None:
    """Chain of a sprocket, guide or probe of a drive, or None."""
    chains = node_list(drive, "chains")
    if not chains:
        return valid_part(Chain, node_value(drive, "chain"))
    own = next((chain for chain in chains if node_value(chain, "name") == node_value(part, "chain")), None)
    return None if own is None else valid_part(NamedChain, own)


def shaft_of_sprocket(sprocket: Any) -> str:
    """Name of a sprocket's shaft, or text that is no name."""
    shaft = node_value(sprocket, "shaft")
    return shaft if shaft is not None else f"{node_value(sprocket, 'name')}="
