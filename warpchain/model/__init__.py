"""Model of a drive: chains, bodies, trains; stacks of drives."""

from warpchain.model.chain_model import ChainModel
from warpchain.model.model import Model, chains_of, single_chain

__all__ = ["ChainModel", "Model", "chains_of", "single_chain"]
