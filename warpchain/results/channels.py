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
    per: Literal["roller", "link", "sprocket"]
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
    def of_sprocket(self) -> bool:
        """Whether there is one for each sprocket, not for each roller or link."""
        return self.per == "sprocket"

    def shape(self, rollers: int, sprockets: int) -> tuple[int, ...]:
        """Its shape in one frame."""
        count = sprockets if self.of_sprocket else rollers
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
)
"""Every channel that a trajectory can hold beside its time. New ones go last: archives number them in this order."""

NAMES = tuple(channel.name for channel in CHANNELS)
"""Names of the channels, in the table's order."""
DEFAULT = tuple(channel.name for channel in CHANNELS if not channel.on_request)
"""Names of those that are recorded unless others are asked for."""
CHANNEL = {channel.name: channel for channel in CHANNELS}
"""The channels by name."""
OF_ROLLERS = tuple(channel for channel in CHANNELS if not channel.of_sprocket)
"""The channels of rollers and of links."""
OF_SPROCKETS = tuple(channel for channel in CHANNELS if channel.of_sprocket)
"""The channels of sprockets."""
UNITS = {"time": "s"} | {channel.name: channel.unit for channel in CHANNELS}
"""Unit of a trajectory's time and of each channel."""
AXES = ("x", "y")
"""Labels of the dimension `axis`."""


@dataclass(frozen=True)
class FrameLayout:
    """How the values of one frame lie in a row of memory.

    First come the values of rollers and links, in rows of one value a roller; then those of the sprockets, one sprocket
    after the other. With N rollers, component k of a channel is at

        (place + k) N + i                                         of roller or link i
        roller_values N + sprocket_values s + place + k           of sprocket s

    Kernels take these numbers from it as constants (`kernels/frames.py`).

    Attributes:
        channels: what a frame holds.
    """

    channels: tuple[Channel, ...]

    @cached_property
    def _places(self) -> dict[str, int]:
        places, ends = {}, {True: 0, False: 0}
        for channel in self.channels:
            places[channel.name] = ends[channel.of_sprocket]
            ends[channel.of_sprocket] += len(channel.fields)
        return places

    def holds(self, name: str) -> bool:
        """Whether a frame has that channel."""
        return name in self._places

    def place(self, name: str) -> int:
        """A channel's first row among those of the rollers, or its first value among a sprocket's."""
        return self._places[name]

    @property
    def roller_values(self) -> int:
        """Values of a frame per roller."""
        return sum(len(channel.fields) for channel in self.channels if not channel.of_sprocket)

    @property
    def sprocket_values(self) -> int:
        """Values of a frame per sprocket."""
        return sum(len(channel.fields) for channel in self.channels if channel.of_sprocket)

    def width(self, rollers: int, sprockets: int) -> int:
        """Number of values of one frame."""
        return self.roller_values * rollers + self.sprocket_values * sprockets

    def split(self, frames: NDArray[Any], rollers: int, sprockets: int) -> dict[str, NDArray[Any]]:
        """The channels of frames (F, `width`) by name, as views: (F, N), (F, S), or (F, ..., 2) for vectors."""
        end = self.roller_values * rollers
        rows = frames[:, :end].reshape(len(frames), self.roller_values, rollers).transpose(0, 2, 1)
        values = frames[:, end:].reshape(len(frames), sprockets, self.sprocket_values)
        found = {}
        for channel in self.channels:
            first = self.place(channel.name)
            held = (values if channel.of_sprocket else rows)[:, :, first : first + len(channel.fields)]
            found[channel.name] = held if channel.components else held[:, :, 0]
        return found


FRAME = FrameLayout(tuple(CHANNEL[name] for name in DEFAULT))
"""How the kernels' frames lie where nothing else is asked for."""


def frame_of(channels: Iterable[str]) -> FrameLayout:
    """How frames lie that hold, beside what all of them do, those of these channels that are on request."""
    asked = set(channels)
    return FrameLayout(tuple(channel for channel in CHANNELS if not channel.on_request or channel.name in asked))


def frame_width(drive: Drive, frame: FrameLayout = FRAME) -> int:
    """Number of values of one frame of a drive."""
    return frame.width(drive.chain.links, len(drive.sprockets))
