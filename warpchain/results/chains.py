"""Trajectories and metrics of drives, joined from and split into those of each chain."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpchain.drive import Drive
from warpchain.model import ChainModel, Model
from warpchain.model.parts_between_chains import SprocketShaft
from warpchain.results.channels import CHANNEL_BY_NAME, CHANNEL_NAMES, PartKind
from warpchain.results.run import Trajectory


def _channel_places(chains: Sequence[ChainModel], kind: PartKind) -> list[NDArray[np.int64]]:
    """Indices in the drive's channels of each chain's parts."""
    if kind in ("roller", "link"):
        ends = np.cumsum([chain.links for chain in chains])
        return [np.arange(end - chain.links, end) for end, chain in zip(ends, chains, strict=True)]
    return [np.array(chain.places[f"{kind}s"], dtype=np.int64) for chain in chains]


def trajectory_of_chains(drive: Drive, parts: Sequence[Trajectory]) -> Trajectory:
    """Trajectory of a drive, joined from its chains'."""
    if len(parts) == 1:
        return replace(parts[0], drive=drive, chain=None)
    chains = [part.model for part in parts]
    channels: dict[str, Any] = {}
    for name in dict.fromkeys(name for part in parts for name in part.channels()):
        places = _channel_places(chains, CHANNEL_BY_NAME[name].per)
        held = [part.channels().get(name) for part in parts]
        like = next(values for values in held if values is not None)
        whole = np.zeros((len(like), sum(map(len, places)), *like.shape[2:]), dtype=like.dtype)
        for at, values in zip(places, held, strict=True):
            if values is not None:
                whole[:, at] = values[:, : len(at)]  # without shafts that are other chains' sprockets
        channels[name] = whole
    return Trajectory(drive, parts[0].time, **channels)


def chain_trajectories(trajectory: Trajectory) -> Mapping[str, Trajectory]:
    """Trajectories of a drive's chains, by name."""
    chains = Model(trajectory.drive).chains if trajectory.chain is None else [trajectory.chain]
    if len(chains) == 1:
        return {"": replace(trajectory, chain=chains[0])}
    found = {}
    for k, chain in enumerate(chains):
        held = {name: values[:, _channel_places(chains, CHANNEL_BY_NAME[name].per)[k]]
                for name, values in trajectory.channels().items()}  # fmt: skip
        held |= _shaft_channels(trajectory, chain, held)
        own: dict[str, Any] = {name: values if values is not None and values.shape[1] else None
               for name, values in ((name, held.get(name)) for name in CHANNEL_NAMES)}  # fmt: skip
        found[chain.name] = replace(trajectory, **own, chain=chain)
    return found


def _shaft_channels(trajectory: Trajectory, chain: ChainModel, held: Mapping[str, Any]) -> dict[str, Any]:
    """Channels of the shafts of a chain, sprockets among them."""
    names = [sprocket.name for sprocket in trajectory.drive.sprockets]
    others = [names.index(shaft.name) for shaft in chain.shafts if isinstance(shaft, SprocketShaft)]
    angle, speed = trajectory.sprocket_angle, trajectory.sprocket_speed
    found = {}
    if others and angle is not None and "shaft_angle" in held:
        found["shaft_angle"] = np.concatenate([held["shaft_angle"], angle[:, others] - angle[:1, others]], axis=1)
    if others and speed is not None and "shaft_speed" in held:
        found["shaft_speed"] = np.concatenate([held["shaft_speed"], speed[:, others]], axis=1)
    return found


def chain_metrics_row(row: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Metrics row of one chain, without its prefix."""
    if not name:
        return dict(row)
    before = f"{name}."
    own = {column.removeprefix(before): value for column, value in row.items() if column.startswith(before)}
    return own | {column: value for column, value in row.items() if column not in own and not column.startswith(before)}
