"""Output ports of a stepped run: places of values in a buffer of a frame a row."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpchain.drive import Drive
from warpchain.engine.chain_rows import ChainRows
from warpchain.engine.packed_ensemble import PackedEnsemble
from warpchain.errors import SimulationError
from warpchain.results.chains import trajectory_of_chains
from warpchain.results.channels import CHANNEL_BY_NAME, PartCounts, channels_of_drive, drive_frame_width
from warpchain.results.run import Trajectory


@dataclass(frozen=True)
class OutputPort:
    """Output port of V variants.

    Attributes:
        name: CHANNEL or PART.CHANNEL.
        places: (V, ...) of values in the buffer.
    """

    name: str
    places: NDArray[np.int64]


def lay_out_frames(rows: ChainRows, packed: PackedEnsemble) -> int:
    """Lays out a buffer of a frame a row, for output ports; returns its length."""
    widths = np.array([drive_frame_width(model, packed.frame) for model in rows.models], dtype=np.int64)
    packed.drives["first_value"] = np.cumsum(widths) - widths
    packed.drives["frame_interval"] = 1
    return int(widths.sum())


def make_outputs(names: Sequence[str], rows: ChainRows, packed: PackedEnsemble) -> dict[str, OutputPort]:
    """Output ports by name, of a laid-out buffer.

    Raises:
        SimulationError: a variant lacks the part, or numbers of parts differ.
    """
    wanted = {name: name.rpartition(".") for name in names}
    places: dict[str, list[NDArray[np.int64]]] = {name: [] for name in names}
    for v, drive in enumerate(rows.drives):
        found = _channel_places(v, rows, packed, {channel for _, _, channel in wanted.values()})
        for name, (part, _, channel) in wanted.items():
            if channel not in found:
                raise SimulationError(f"outputs: {name!r}: variant {v} has no {CHANNEL_BY_NAME[channel].per}")
            mine = found[channel]
            places[name].append(mine[_part_number(name, part, channel, drive, v)] if part else mine)
    for name, each in places.items():
        if len({of.shape for of in each}) > 1:
            raise SimulationError(
                f"outputs: {name!r}: variants differ in their number of parts; name one part, such as driven.{name}"
            )
    return {name: OutputPort(name, np.stack(each)) for name, each in places.items()}


def _channel_places(
    v: int, rows: ChainRows, packed: PackedEnsemble, wanted: set[str]
) -> Mapping[str, NDArray[np.int64]]:
    """Places (parts, ...) of variant v's channels in the buffer."""
    chains = []
    for r in range(int(rows.first_rows[v]), int(rows.first_rows[v + 1])):
        model = rows.models[r]
        width, first = drive_frame_width(model, packed.frame), int(packed.drives["first_value"][r])
        held = packed.frame.split_frames(np.arange(first, first + width)[None, :], PartCounts.of_drive(model))
        own = {name: held[name] for name in channels_of_drive(model, held) if name in wanted}
        chains.append(Trajectory(rows.drives[v], np.zeros(1), **own, chain=model))
    return {name: values[0] for name, values in trajectory_of_chains(rows.drives[v], chains).channels().items()}


def _part_number(name: str, part: str, channel: str, drive: Drive, v: int) -> int:
    """Number of the part that an output port names."""
    kind = CHANNEL_BY_NAME[channel].per
    if kind in ("roller", "link"):
        raise SimulationError(f"outputs: {name!r}: {channel} is of each {kind}; name it without a part")
    names = [each.name for each in getattr(drive, f"{kind}s")]
    if part not in names:
        raise SimulationError(
            f"outputs: {name!r}: there is no {kind} {part!r} in variant {v}; allowed are {', '.join(names)}"
        )
    return names.index(part)
