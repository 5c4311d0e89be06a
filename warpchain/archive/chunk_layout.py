"""Layout of a variant's frames in a chunk: every message of a frame has a fixed size, so a chunk is an array of frames.

The bytes are ordinary MCAP message records with ordinary protobuf and CDR payloads. Two things make their sizes fixed:
numbers that protobuf would drop when zero are always written, and the timestamps' varints are padded to five bytes,
which every protobuf reader accepts. Frames are then written and read as numpy arrays of a structured dtype.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpchain.archive import archive_format
from warpchain.drive import Drive
from warpchain.results.channels import CHANNEL, NAMES, OF_BODIES, OF_ROLLERS, Sizes
from warpchain.results.pivots import pivots
from warpchain.results.run import Trajectory
from warpchain.results.tension_colors import tension_color

MESSAGE = 0x05
"""Opcode of a message record."""
HEADER = np.dtype(
    [
        ("opcode", "u1"),
        ("length", "<u8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log_time", "<u8"),
        ("publish_time", "<u8"),
    ]
)
"""Head of a message record; `length` counts what follows it."""
LENGTH_STARTS = 9
"""Where a record's length begins to count."""
JOINT_ARRAYS = {"position": "sprocket_angle", "velocity": "sprocket_speed", "effort": "sprocket_moment"}
"""Channel of a trajectory that each array of a JointState carries."""
COLOR_STEPS = 1024


class _Parts:
    """Builds a structured dtype and its template from constant bytes and named values."""

    def __init__(self) -> None:
        self.template = bytearray()
        self.fields: dict[str, tuple[Any, int]] = {}

    def constant(self, data: bytes) -> None:
        self.template += data

    def value(self, name: str, kind: Any) -> None:
        self.fields[name] = (np.dtype(kind), len(self.template))
        self.template += bytes(np.dtype(kind).itemsize)

    def tagged(self, number: int, name: str, kind: Any) -> None:
        """A length-delimited protobuf field of fixed size."""
        self.constant(archive_format.varint(number << 3 | 2) + archive_format.varint(np.dtype(kind).itemsize))
        self.value(name, kind)

    def stamp(self, mark: str = "") -> None:
        """Field 1, a google.protobuf.Timestamp with both numbers padded to five bytes."""
        self.constant(b"\x0a\x0c\x08")
        self.value(f"seconds{mark}", ("u1", (5,)))
        self.constant(b"\x10")
        self.value(f"nanoseconds{mark}", ("u1", (5,)))

    def dtype(self) -> np.dtype[np.void]:
        names = list(self.fields)
        kinds, offsets = [self.fields[n][0] for n in names], [self.fields[n][1] for n in names]
        form = {"names": names, "formats": kinds, "offsets": offsets, "itemsize": len(self.template)}
        return np.dtype(form)  # type: ignore[call-overload]


@dataclass(frozen=True)
class Form:
    """The description that fixes the layout of a variant's frames.

    Attributes:
        links: number of rollers and links N.
        sprockets: names of the sprockets.
        channels: the recorded channels.
        precision: of the run, "float64" or "float32".
        values: of the rollers' packed values, "float64" or "float32".
        exact: whether positions also come as float64 on a topic of their own.
        variant: number of the variant, which names the frames that turn with its sprockets and arms.
        arms: names of the arms.
        tensioners, shafts, couplings, valves: numbers of these.
    """

    links: int
    sprockets: tuple[str, ...]
    channels: tuple[str, ...]
    precision: str
    values: str
    exact: bool
    variant: int
    arms: tuple[str, ...] = ()
    tensioners: int = 0
    shafts: int = 0
    couplings: int = 0
    valves: int = 0

    @classmethod
    def of(cls, variant: int, trajectory: Trajectory, values: str | None, exact: bool) -> Form:
        """The layout of a variant's trajectory; `values` None keeps its own precision."""
        held = trajectory.channels()
        precision = str(next(iter(held.values())).dtype) if held else "float64"
        drive = trajectory.drive
        packed = values or precision
        exact = exact and "position" in held and packed == "float32" and precision == "float64"
        return cls.made(drive, tuple(n for n in NAMES if n in held), precision, packed, exact, variant)

    @classmethod
    def made(
        cls, drive: Drive, channels: tuple[str, ...], precision: str, values: str, exact: bool, variant: int
    ) -> Form:
        """The layout of frames of a drive."""
        names = tuple(sprocket.name for sprocket in drive.sprockets)
        arms = tuple(arm.name for arm in drive.arms)
        sizes = Sizes.of(drive)
        counts = sizes.tensioners, sizes.shafts, sizes.couplings, sizes.valves
        return cls(drive.links, names, channels, precision, values, exact, variant, arms, *counts)

    @property
    def topics(self) -> tuple[str, ...]:
        """Names of the topics that carry frames, in the order of a frame's messages."""
        joints = ("sprockets",) if any(name in self.channels for name in JOINT_ARRAYS.values()) else ()
        exact = ("positions",) if self.exact else ()
        return ("rollers", "state", *joints, *exact, *(("transforms",) if self.turns else ()))

    @property
    def turning(self) -> tuple[str, ...]:
        """Names of the bodies whose frames turn: the sprockets, then the arms where frames hold how they lie."""
        return self.sprockets + (self.arms if "arm_angle" in self.channels else ())

    @property
    def turns(self) -> bool:
        """Whether each frame holds how the sprockets lie, so that their outlines turn."""
        return {"sprocket_angle", "sprocket_center"} <= set(self.channels)

    def kind(self, channel: str) -> str:
        """numpy's name of a channel's type as it is read back."""
        if channel == "position" and self.exact:
            return "float64"
        return self.values if CHANNEL[channel].of_rollers else self.precision

    def shape(self, channel: str) -> tuple[int, ...]:
        """A channel's shape in one frame."""
        return CHANNEL[channel].shape(self.sizes)

    @property
    def sizes(self) -> Sizes:
        """Numbers of the things that channels are of."""
        bodies = len(self.sprockets), len(self.arms), self.tensioners, self.shafts, self.couplings, self.valves
        return Sizes(self.links, *bodies)


@dataclass(frozen=True)
class FrameLayout:
    """A frame as bytes.

    Attributes:
        dtype: one field a topic; each has the fields `head` (`HEADER`) and `body` (the payload).
        template: a frame with everything but its numbers.
    """

    form: Form
    dtype: np.dtype[np.void]
    template: bytes

    @property
    def size(self) -> int:
        """Bytes of a frame."""
        return len(self.template)

    def offset(self, topic: str) -> int:
        """Where a topic's message begins in a frame."""
        return offset_of(self.dtype, topic)

    def encode(self, chunks: Sequence[Trajectory], first: int, channels: Sequence[int], full_scale: float) -> Any:
        """Frames as messages.

        Args:
            chunks: consecutive frames.
            first: number of the first frame; the messages' `sequence`.
            channels: MCAP channel of each topic.
            full_scale: tension where the color scale ends [N].

        Returns:
            (frames,) array of `dtype`.
        """
        count = sum(len(chunk.time) for chunk in chunks)
        raw = np.empty((count, self.size), dtype=np.uint8)
        raw[:] = np.frombuffer(self.template, dtype=np.uint8)
        frames = raw.view(self.dtype)[:, 0]
        time = np.concatenate([chunk.time for chunk in chunks])
        stamps = np.rint(time * 1e9).astype(np.uint64)
        for topic, channel in zip(self.form.topics, channels, strict=True):
            head, body = frames[topic]["head"], frames[topic]["body"]
            head["channel"] = channel
            head["sequence"] = np.arange(first, first + count, dtype=np.uint32)
            head["log_time"] = head["publish_time"] = stamps
            if topic in ("rollers", "positions"):
                _padded(body["seconds"], stamps // 10**9)
                _padded(body["nanoseconds"], stamps % 10**9)
            elif topic == "transforms":
                for s in range(len(self.form.turning)):
                    _padded(body[f"seconds_{s}"], stamps // 10**9)
                    _padded(body[f"nanoseconds_{s}"], stamps % 10**9)
            elif topic == "sprockets":
                body["sec"], body["nanosec"] = stamps // 10**9, stamps % 10**9
        frames["state"]["body"]["time"] = time
        start = 0
        for chunk in chunks:
            part = frames[start : start + len(chunk.time)]
            self._fill(part, chunk, full_scale)
            start += len(part)
        return frames

    def _fill(self, frames: Any, chunk: Trajectory, full_scale: float) -> None:
        """Puts a trajectory's values into their places."""
        points = frames["rollers"]["body"]["data"]
        for channel, values in chunk.channels().items():
            if CHANNEL[channel].of_rollers:
                points[channel] = values
            else:
                frames["state"]["body"][channel] = values
        points["color"] = _color_table().take(_color_index(chunk, points.shape, full_scale))
        if self.form.exact:
            frames["positions"]["body"]["position"] = chunk.position
        if "sprockets" in self.form.topics:
            for name, channel in JOINT_ARRAYS.items():
                values = getattr(chunk, channel)
                if values is not None:
                    frames["sprockets"]["body"][name] = values

        if self.form.turns:
            body = frames["transforms"]["body"]
            for s in range(len(self.form.sprockets)):
                angle, center = chunk.sprocket_angle[:, s], chunk.sprocket_center[:, s]  # type: ignore[index]
                body[f"x_{s}"], body[f"y_{s}"] = center[:, 0], center[:, 1]
                body[f"sine_{s}"], body[f"cosine_{s}"] = np.sin(0.5 * angle), np.cos(0.5 * angle)
            carrying = range(len(chunk.drive.arms)) if "arm_angle" in self.form.channels else ()
            pivot = pivots(chunk.drive, chunk.time, chunk.arm_angle)
            for a in carrying:
                angle, s = chunk.arm_angle[:, a], len(self.form.sprockets) + a  # type: ignore[index]
                body[f"x_{s}"], body[f"y_{s}"] = pivot[:, a, 0], pivot[:, a, 1]
                body[f"sine_{s}"], body[f"cosine_{s}"] = np.sin(0.5 * angle), np.cos(0.5 * angle)

    def views(self, frames: Any) -> dict[str, NDArray[Any]]:
        """`time` and every channel of frames, as views of their bytes."""
        held = {"time": frames["state"]["body"]["time"]}
        for channel in self.form.channels:
            if channel == "position" and self.form.exact:
                held[channel] = frames["positions"]["body"]["position"]
            elif CHANNEL[channel].of_rollers:
                held[channel] = frames["rollers"]["body"]["data"][channel]
            else:
                held[channel] = frames["state"]["body"][channel]
        return held


@functools.lru_cache(maxsize=256)
def frame_layout(form: Form) -> FrameLayout:
    """The layout of frames of a form."""
    build = {"state": _state, "sprockets": _joints, "positions": _positions, "transforms": _transforms}
    frame = _Parts()
    for topic in form.topics:
        body = build.get(topic, _rollers)(form)
        message = np.dtype([("head", HEADER), ("body", body.dtype())])
        frame.value(topic, message)
        frame.template[-message.itemsize :] = message_record(0, 0, 0, bytes(body.template))
    return FrameLayout(form, frame.dtype(), bytes(frame.template))


def _rollers(form: Form) -> _Parts:
    layout = archive_format.roller_layout(frozenset(form.channels), form.values)
    code = np.dtype(form.values).newbyteorder("<")
    point = _Parts()
    point.template += bytes(layout.itemsize)
    for channel in OF_ROLLERS:
        if channel.name in form.channels:
            kind = np.dtype((code, (len(channel.components),))) if channel.components else code
            point.fields[channel.name] = (kind, offset_of(layout, channel.fields[0]))
    point.fields["color"] = (np.dtype("<u4"), offset_of(layout, archive_format.COLOR_FIELDS[0]))
    body = _Parts()
    body.stamp()
    body.constant(archive_format.point_cloud_constant(layout))
    body.tagged(6, "data", (point.dtype(), (form.links,)))
    return body


def _state(form: Form) -> _Parts:
    body = _Parts()
    body.constant(b"\x09")
    body.value("time", "<f8")
    for number, channel in enumerate(OF_BODIES, start=2):
        if channel.name in form.channels:
            body.tagged(number, channel.name, ("<f8", channel.shape(form.sizes)))
    return body


def _joints(form: Form) -> _Parts:
    arrays = [name for name, channel in JOINT_ARRAYS.items() if channel in form.channels]
    template, offsets, stamp = archive_format.joint_state_template(list(form.sprockets), arrays)
    body = _Parts()
    body.template += template
    body.fields |= {"sec": (np.dtype("<i4"), stamp), "nanosec": (np.dtype("<u4"), stamp + 4)}
    body.fields |= {name: (np.dtype(("<f8", (len(form.sprockets),))), at) for name, at in offsets.items()}
    return body


def _positions(form: Form) -> _Parts:
    body = _Parts()
    body.stamp()
    body.tagged(2, "position", ("<f8", (form.links, 2)))
    return body


def message_record(channel: int, sequence: int, stamp: int, body: bytes) -> bytes:
    """A message record."""
    head = np.zeros((), dtype=HEADER)
    head["opcode"], head["length"] = MESSAGE, HEADER.itemsize - LENGTH_STARTS + len(body)
    head["channel"], head["sequence"], head["log_time"], head["publish_time"] = channel, sequence, stamp, stamp
    return head.tobytes() + body


def _transforms(form: Form) -> _Parts:
    """One FrameTransform a sprocket or arm: its center or pivot, and the quaternion of its angle about z."""
    body = _Parts()
    for s, name in enumerate(form.turning):
        one = _Parts()
        one.stamp(f"_{s}")
        for number, text in ((2, "drive"), (3, archive_format.sprocket_frame(form.variant, name))):
            one.constant(
                archive_format.varint(number << 3 | 2) + archive_format.varint(len(text.encode())) + text.encode()
            )
        one.constant(b"\x22\x12\x09")
        one.value(f"x_{s}", "<f8")
        one.constant(b"\x11")
        one.value(f"y_{s}", "<f8")
        one.constant(b"\x2a\x12\x19")
        one.value(f"sine_{s}", "<f8")
        one.constant(b"\x21")
        one.value(f"cosine_{s}", "<f8")
        body.constant(b"\x0a" + archive_format.varint(len(one.template)))
        start = len(body.template)
        body.constant(bytes(one.template))
        body.fields |= {name: (kind, start + at) for name, (kind, at) in one.fields.items()}
    return body


def offset_of(dtype: np.dtype[np.void], name: str) -> int:
    """Where a field begins [bytes]."""
    fields: Any = dtype.fields
    return int(fields[name][1])


def _padded(out: Any, values: NDArray[np.uint64]) -> None:
    """Varints padded to five bytes, (frames, 5)."""
    for k in range(5):
        more = 0x80 if k < 4 else 0
        out[:, k] = (values >> np.uint64(7 * k)).astype(np.uint8) & 0x7F | more


@functools.cache
def _color_table() -> NDArray[np.uint32]:
    """Packed colors from 0 to the scale's end, and at last that of an unknown tension."""
    share = np.append(np.linspace(0.0, 1.0, COLOR_STEPS), np.nan)
    return tension_color(share, 1.0).view("<u4")[:, 0]


def _color_index(chunk: Trajectory, shape: tuple[int, ...], full_scale: float) -> NDArray[np.intp]:
    if chunk.tension is None:
        return np.full(shape, COLOR_STEPS)
    share = np.clip(chunk.tension * ((COLOR_STEPS - 1) / full_scale), 0.0, COLOR_STEPS - 1)
    return np.where(np.isfinite(share), share, COLOR_STEPS).astype(np.intp)
