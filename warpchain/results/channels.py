"""The table of recorded channels, and what follows from it: names, units, dimensions, and how a frame lies in memory.

A new channel is a row of `CHANNELS` here and the line of `kernels/frames.py` that writes its value. Kernels, recorder,
trajectories, tables, archives and the table in `docs/archive.md` go by the row.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

from numpy.typing import NDArray

if TYPE_CHECKING:
    from warpchain.drive import Drive


Kind = Literal["roller", "link", "sprocket", "arm", "tensioner", "shaft", "coupling", "valve"]
"""Kinds of things that channels are of."""


@dataclass(frozen=True)
class Sizes:
    """Numbers of the things that channels are of; as many links as rollers."""

    rollers: int
    sprockets: int
    arms: int = 0
    tensioners: int = 0
    shafts: int = 0
    couplings: int = 0
    valves: int = 0

    @classmethod
    def of(cls, drive: Drive) -> Sizes:
        """Those of a drive; shafts of several chains without gears, couplings and motors have their sprockets' channels
        only.
        """
        from warpchain.drive.transmission import is_geared

        shafts = () if drive.chains and not is_geared(drive) else drive.shafts
        turned = shafts, drive.couplings, drive.valves
        return cls(drive.links, *map(len, (drive.sprockets, drive.arms, drive.tensioners, *turned)))

    def count(self, kind: Kind) -> int:
        """Number of things of a kind."""
        return self.rollers if kind in ("roller", "link") else int(getattr(self, f"{kind}s"))


@dataclass(frozen=True)
class Channel:
    """A quantity that is recorded.

    Attributes:
        name: as in `Trajectory` and `Record.channels`.
        unit: SI unit.
        per: what it is recorded of; link i is the one after roller i.
        description: what it is, in a few words.
        components: names of a vector's components; of a channel of rollers or links its fields in an archive, so that
            no two of those share one. Empty for a number.
        on_request: whether frames hold it only where it is asked for by name (`Record.channels`).
    """

    name: str
    unit: str
    per: Kind
    description: str
    components: tuple[str, ...] = ()
    on_request: bool = False

    @property
    def fields(self) -> tuple[str, ...]:
        """Name of each of its values."""
        return self.components or (self.name,)

    @property
    def dimensions(self) -> tuple[str, ...]:
        """Names of its dimensions over a trajectory: time, then what it is of, then `axis` for a vector."""
        return ("time", self.per, *(("axis",) if self.components else ()))

    @property
    def of_rollers(self) -> bool:
        """Whether there is one for each roller or link, not for each sprocket, arm or tensioner."""
        return self.per in ("roller", "link")

    def shape(self, sizes: Sizes) -> tuple[int, ...]:
        """Its shape in one frame."""
        count = sizes.count(self.per)
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
"""Every channel that a trajectory can hold beside its time. New ones go last: archives number them in this order."""

NAMES = tuple(channel.name for channel in CHANNELS)
"""Names of the channels, in the table's order."""
DEFAULT = tuple(channel.name for channel in CHANNELS if not channel.on_request)
"""Names of those that are recorded unless others are asked for."""
CHANNEL = {channel.name: channel for channel in CHANNELS}
"""The channels by name."""
OF_ROLLERS = tuple(channel for channel in CHANNELS if channel.of_rollers)
"""The channels of rollers and of links."""
OF_BODIES = tuple(channel for channel in CHANNELS if not channel.of_rollers)
"""The channels of sprockets, arms, tensioners, shafts, couplings and valves."""
UNITS = {"time": "s"} | {channel.name: channel.unit for channel in CHANNELS}
"""Unit of a trajectory's time and of each channel."""
AXES = ("x", "y")
"""Labels of the dimension `axis`."""


@dataclass(frozen=True)
class FrameLayout:
    """Layout of one frame's values in a row of memory.

    First come the values of rollers and links, in rows of one value a roller; then those of the sprockets, one sprocket
    after the other, those of the arms, tensioners, shafts, couplings and valves likewise. With N rollers and S
    sprockets, component k of a channel is at

        (place + k) N + i                                         of roller or link i
        values(roller) N + values(sprocket) s + place + k         of sprocket s
        values(roller) N + values(sprocket) S + values(arm) a + place + k   of arm a, and so on

    Kernels take these numbers from it as constants (`kernels/frames.py`).

    Attributes:
        channels: what a frame holds.
    """

    channels: tuple[Channel, ...]

    @cached_property
    def _places(self) -> dict[str, int]:
        places: dict[str, int] = {}
        ends = dict.fromkeys(BLOCKS, 0)
        for channel in self.channels:
            block = _block(channel.per)
            places[channel.name] = ends[block]
            ends[block] += len(channel.fields)
        return places

    def holds(self, name: str) -> bool:
        """Whether a frame has that channel."""
        return name in self._places

    def place(self, name: str) -> int:
        """A channel's first row among those of the rollers, or its first value among those of a sprocket and so on."""
        return self._places[name]

    def values(self, kind: Kind) -> int:
        """Values of a frame per roller (with its link), sprocket, arm or tensioner."""
        return sum(len(channel.fields) for channel in self.channels if _block(channel.per) == _block(kind))

    def width(self, sizes: Sizes) -> int:
        """Number of values of one frame."""
        return sum(self.values(kind) * sizes.count(kind) for kind in BLOCKS)

    def split(self, frames: NDArray[Any], sizes: Sizes) -> dict[str, NDArray[Any]]:
        """The channels of frames (F, `width`) by name, as views: (F, N), (F, S), or (F, ..., 2) for vectors."""
        blocks, end = {}, 0
        for kind in BLOCKS:
            count, values = sizes.count(kind), self.values(kind)
            held, end = frames[:, end : end + count * values], end + count * values
            shape = (len(frames), values, count) if kind == "roller" else (len(frames), count, values)
            blocks[kind] = held.reshape(shape).transpose(0, 2, 1) if kind == "roller" else held.reshape(shape)
        found = {}
        for channel in self.channels:
            first = self.place(channel.name)
            held = blocks[_block(channel.per)][:, :, first : first + len(channel.fields)]
            found[channel.name] = held if channel.components else held[:, :, 0]
        return found


BLOCKS: tuple[Kind, ...] = ("roller", "sprocket", "arm", "tensioner", "shaft", "coupling", "valve")
"""The kinds whose values stand together in a frame, in order; those of links with those of rollers."""


def _block(kind: Kind) -> Kind:
    return "roller" if kind == "link" else kind


FRAME = FrameLayout(tuple(CHANNEL[name] for name in DEFAULT))
"""Layout of the kernels' frames where nothing else is asked for."""

WHOLE_FRAME = FrameLayout(CHANNELS)
"""Layout of frames that hold every channel, which the CPU's kernel writes: it is then one, whatever is recorded."""


def frame_of(channels: Iterable[str]) -> FrameLayout:
    """Layout of frames that hold, beside what all do, those of these channels that are on request."""
    asked = set(channels)
    return FrameLayout(tuple(channel for channel in CHANNELS if not channel.on_request or channel.name in asked))


def frame_width(drive: Drive, frame: FrameLayout = FRAME) -> int:
    """Number of values of one frame of a drive."""
    return frame.width(Sizes.of(drive))


def channels_of(drive: Drive, names: Iterable[str]) -> tuple[str, ...]:
    """Those of these channels that a drive has anything of."""
    sizes = Sizes.of(drive)
    return tuple(name for name in names if sizes.count(CHANNEL[name].per) > 0)
