"""Channels of plug-ins: functions of recorded channels, for metrics and exports (docs/plugins.md)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from warpchain.argument_checks import check_arguments
from warpchain.drive.plugins import add_to_registry, function_code, load_installed_plugins
from warpchain.errors import PluginError
from warpchain.results.channels import CHANNEL_BY_NAME, CHANNEL_NAMES, CHANNEL_UNITS, Channel, PartCounts, PartKind
from warpchain.results.run import Trajectory

ChannelFunction = Callable[[Trajectory], Any]


@dataclass(frozen=True)
class OwnChannel:
    """Channel of a plug-in: its function, and channels needed."""

    function: ChannelFunction
    channels: tuple[str, ...]
    channel: Channel

    def values(self, trajectory: Trajectory) -> NDArray[np.float64]:
        """Values (F, N) of the plug-in's channel for N parts.

        Raises:
            PluginError: what the function raises, or values of another shape.
        """
        shape = (len(trajectory.time), *self.channel.shape(PartCounts.of_drive(trajectory.parts)))
        with function_code(self.function, f"channel {self.channel.name!r}"):
            found = np.array(self.function(trajectory), dtype=float)
            if found.shape != shape:
                raise PluginError(f"gives an array of shape {found.shape}; must be {shape}")
        return found


OWN_CHANNELS: dict[str, OwnChannel] = {}


@check_arguments(PluginError)
def channel(
    name: str, *, unit: str = "1", title: str, per: str, channels: Sequence[str]
) -> Callable[[ChannelFunction], ChannelFunction]:
    """Decorator that makes a plug-in's function the channel `name` of recorded trajectories.

    The function takes a `Trajectory` with the channels that it asks for, and returns a number for each frame and part,
    (F, N). Metrics ask for the channel by name, and `warpchain export` writes it.

    Args:
        unit: SI unit, "1" for a ratio.
        title: what the channel is, in words.
        per: kind of its parts, such as "link" or "sprocket".
        channels: recorded channels that it needs.

    Raises:
        PluginError: a name that is taken or not allowed, an unknown channel or kind of part, or no function.
    """
    kinds = get_args(PartKind)
    if per not in kinds:
        raise PluginError(f"channel {name!r}: per = {per!r}: must be one of {', '.join(kinds)}")
    for needed in channels:
        if needed not in CHANNEL_NAMES:
            raise PluginError(f"channel {name!r}: no channel {needed!r}; allowed are {', '.join(CHANNEL_NAMES)}")

    def add_channel(function: ChannelFunction) -> ChannelFunction:
        """Registers the plug-in's channel; returns its function."""
        if not hasattr(function, "__code__"):
            raise PluginError(f"channel {name!r}: must be a function")
        file, own = function.__code__.co_filename, Channel(name, unit, per, title)  # type: ignore[arg-type]
        add_to_registry(CHANNEL_BY_NAME, "channel", name, own, file)
        add_to_registry(CHANNEL_UNITS, "channel", name, unit, file)
        add_to_registry(OWN_CHANNELS, "channel", name, OwnChannel(function, tuple(channels), own), file)
        return function

    return add_channel


def recorded_names(names: Iterable[str]) -> tuple[str, ...]:
    """Names of recorded channels that channels need, in order."""
    wanted = {needed for name in names for needed in (OWN_CHANNELS[name].channels if name in OWN_CHANNELS else (name,))}
    return tuple(name for name in CHANNEL_NAMES if name in wanted)


def channels_with_own(trajectory: Trajectory) -> dict[str, NDArray[np.floating]]:
    """Channels of a trajectory by name, with those of plug-ins.

    Raises:
        PluginError: a plug-in's channel that fails.
    """
    load_installed_plugins()
    held = trajectory.channels()
    own = {name: of for name, of in OWN_CHANNELS.items() if held.keys() >= set(of.channels)}
    return held | {name: of.values(trajectory) for name, of in own.items()}
