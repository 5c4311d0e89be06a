"""Table of recorded channels, and what follows from it: names, units, dimensions, layout of a frame in memory."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

from numpy.typing import NDArray

from warpchain.drive import Drive

if TYPE_CHECKING:
    from warpchain.model import ChainModel


PartKind = Literal["roller", "link", "sprocket", "arm", "tensioner", "shaft", "coupling", "valve"]


@dataclass(frozen=True)
class PartCounts:
    """Numbers of a drive's parts that have channels."""

    rollers: int
    sprockets: int
    arms: int = 0
    tensioners: int = 0
    shafts: int = 0
    couplings: int = 0
    valves: int = 0

    @classmethod
    def of_drive(cls, parts: Drive | ChainModel) -> PartCounts:
        """Numbers of a drive's parts that have channels."""
        turned = parts.shafts, parts.couplings, parts.valves
        return cls(parts.links, *map(len, (parts.sprockets, parts.arms, parts.tensioners, *turned)))

    def count_of(self, kind: PartKind) -> int:
        """Number of a drive's parts of a kind."""
        return self.rollers if kind in ("roller", "link") else int(getattr(self, f"{kind}s"))


@dataclass(frozen=True)
class Channel:
    """Recorded channel: name, unit, kind of part, components."""

    name: str  # as in `Trajectory` and `Record.channels`
    unit: str  # SI
    per: PartKind  # kind of part; link i is the one after roller i
    description: str
    components: tuple[str, ...] = ()  # of a vector, fields in an archive; empty for a number
    on_request: bool = False  # whether frames hold it only where named

    @property
    def value_names(self) -> tuple[str, ...]:
        """Names of the channel's components, or its own."""
        return self.components or (self.name,)

    @property
    def dimensions(self) -> tuple[str, ...]:
        """Names of the channel's dimensions: time, part, `axis`."""
        return ("time", self.per, *(("axis",) if self.components else ()))

    @property
    def is_of_rollers(self) -> bool:
        """Whether the channel is of rollers or links."""
        return self.per in ("roller", "link")

    def shape(self, sizes: PartCounts) -> tuple[int, ...]:
        """Shape of the channel in one frame."""
        count = sizes.count_of(self.per)
        return (count, len(self.components)) if self.components else (count,)


CHANNELS = (
    Channel("position", "m", "roller", "roller center", ("x", "y")),
    Channel("velocity", "m/s", "roller", "roller velocity", ("vx", "vy")),
    Channel("tension", "N", "link", "tension of the link from this roller to the next, positive in tension"),
    Channel("sprocket_force", "N", "roller", "magnitude of the sprockets' contact force on the roller"),
    Channel("guide_force", "N", "roller", "magnitude of the guide-bars' contact force on the roller"),
    Channel("sprocket_angle", "rad", "sprocket", "angle, counter-clockwise"),
    Channel("sprocket_speed", "rad/s", "sprocket", "angular velocity, counter-clockwise"),
    Channel("sprocket_moment", "N m", "sprocket", "moment of the contact forces, counter-clockwise"),
    Channel("sprocket_center", "m", "sprocket", "center", ("x", "y")),
    Channel("joint_friction_power", "W", "roller", "power that the joint at this roller dissipates", on_request=True),
    Channel("arm_angle", "rad", "arm", "angle from the drawing, counter-clockwise"),
    Channel("arm_speed", "rad/s", "arm", "angular velocity, counter-clockwise"),
    Channel("arm_moment", "N m", "arm", "moment of the contact forces about its pivot, counter-clockwise"),
    Channel("tensioner_extension", "m", "tensioner", "extension from the drawing, outward positive"),
    Channel("tensioner_force", "N", "tensioner", "force on the body that it pushes"),
    Channel("chamber_pressure", "Pa", "tensioner", "absolute pressure in the chamber; without oil the ambient one"),
    Channel("shaft_angle", "rad", "shaft", "angle since the start, counter-clockwise"),
    Channel("shaft_speed", "rad/s", "shaft", "angular velocity, counter-clockwise"),
    Channel("coupling_twist", "rad", "coupling", "angle of its first shaft less its ratio times that of its second"),
    Channel("coupling_torque", "N m", "coupling", "moment that it takes from its first shaft, counter-clockwise"),
    Channel("hub_force", "N", "sprocket", "force of the chain, friction and all", ("x", "y"), on_request=True),
    Channel("valve_torque", "N m", "valve", "torque of a group of valves against forward rotation of its shaft"),
    Channel("valve_force", "N", "valve", "least force of a cam of the group on its follower"),
)
"""Channels in archives' order; new ones last."""

CHANNEL_NAMES = tuple(channel.name for channel in CHANNELS)
DEFAULT_CHANNELS = tuple(channel.name for channel in CHANNELS if not channel.on_request)
CHANNEL_BY_NAME = {channel.name: channel for channel in CHANNELS}
ROLLER_CHANNELS = tuple(channel for channel in CHANNELS if channel.is_of_rollers)
BODY_CHANNELS = tuple(channel for channel in CHANNELS if not channel.is_of_rollers)
CHANNEL_UNITS = {"time": "s"} | {channel.name: channel.unit for channel in CHANNELS}
AXIS_LABELS = ("x", "y")


@dataclass(frozen=True)
class FrameLayout:
    """Layout of a recorded frame in memory, for kernels.

    Of N rollers and S sprockets, component k of a channel is at

        (place + k) N + i                                         of roller or link i
        values(roller) N + values(sprocket) s + place + k         of sprocket s
        values(roller) N + values(sprocket) S + values(arm) a + place + k   of arm a, and so on
    """

    channels: tuple[Channel, ...]

    @cached_property
    def _places_by_name(self) -> dict[str, int]:
        """Place of each channel among its part's values, by name."""
        places: dict[str, int] = {}
        ends = dict.fromkeys(FRAME_BLOCKS, 0)
        for channel in self.channels:
            block = _frame_block(channel.per)
            places[channel.name] = ends[block]
            ends[block] += len(channel.value_names)
        return places

    def holds(self, name: str) -> bool:
        """Whether a frame holds a channel."""
        return name in self._places_by_name

    def place(self, name: str) -> int:
        """Place of a channel among its part's values in a frame."""
        return self._places_by_name[name]

    def values(self, kind: PartKind) -> int:
        """Number of a part's values in a frame."""
        return sum(
            len(channel.value_names) for channel in self.channels if _frame_block(channel.per) == _frame_block(kind)
        )

    def frame_width(self, sizes: PartCounts) -> int:
        """Number of all values in a frame."""
        return sum(self.values(kind) * sizes.count_of(kind) for kind in FRAME_BLOCKS)

    def split_frames(self, frames: NDArray[Any], sizes: PartCounts) -> dict[str, NDArray[Any]]:
        """Channels by name, as views of frames (F, `frame_width`)."""
        blocks, end = {}, 0
        for kind in FRAME_BLOCKS:
            count, values = sizes.count_of(kind), self.values(kind)
            held, end = frames[:, end : end + count * values], end + count * values
            shape = (len(frames), values, count) if kind == "roller" else (len(frames), count, values)
            blocks[kind] = held.reshape(shape).transpose(0, 2, 1) if kind == "roller" else held.reshape(shape)
        found = {}
        for channel in self.channels:
            first = self.place(channel.name)
            held = blocks[_frame_block(channel.per)][:, :, first : first + len(channel.value_names)]
            found[channel.name] = held if channel.components else held[:, :, 0]
        return found


FRAME_BLOCKS: tuple[PartKind, ...] = ("roller", "sprocket", "arm", "tensioner", "shaft", "coupling", "valve")


def _frame_block(kind: PartKind) -> PartKind:
    """Kind of part in whose block of a frame a kind's values are."""
    return "roller" if kind == "link" else kind


DEFAULT_FRAME = FrameLayout(tuple(CHANNEL_BY_NAME[name] for name in DEFAULT_CHANNELS))

WHOLE_FRAME = FrameLayout(CHANNELS)


def frame_with_channels(channels: Iterable[str]) -> FrameLayout:
    """Layout of frames with the default channels and others."""
    asked = set(channels)
    return FrameLayout(tuple(channel for channel in CHANNELS if not channel.on_request or channel.name in asked))


def drive_frame_width(parts: Drive | ChainModel, frame: FrameLayout = DEFAULT_FRAME) -> int:
    """Number of values in a frame of a drive."""
    return frame.frame_width(PartCounts.of_drive(parts))


def channels_of_drive(parts: Drive | ChainModel, names: Iterable[str]) -> tuple[str, ...]:
    """Names of channels whose parts a drive has."""
    sizes = PartCounts.of_drive(parts)
    return tuple(name for name in names if sizes.count_of(CHANNEL_BY_NAME[name].per) > 0)
