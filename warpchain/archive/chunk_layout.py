"""Byte layout of a variant's frames in an MCAP chunk, which is an array of frames of one size.

Zeros, which protobuf would drop, are written; varints of timestamps have five bytes.
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
from warpchain.results.arm_pivots import arm_pivots
from warpchain.results.channels import BODY_CHANNELS, CHANNEL_BY_NAME, CHANNEL_NAMES, ROLLER_CHANNELS, PartCounts
from warpchain.results.run import Trajectory
from warpchain.results.tension_colors import tension_colors

MESSAGE_OPCODE = 0x05
MESSAGE_HEADER = np.dtype(
    [
        ("opcode", "u1"),
        ("length", "<u8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log_time", "<u8"),
        ("publish_time", "<u8"),
    ]
)
RECORD_HEAD_BYTES = 9
JOINT_STATE_CHANNELS = {"position": "sprocket_angle", "velocity": "sprocket_speed", "effort": "sprocket_moment"}
COLOR_STEPS = 1024


class _BodyBuilder:
    """Builder of an archived message body: dtype and template."""

    def __init__(self) -> None:
        self.template = bytearray()
        self.fields: dict[str, tuple[Any, int]] = {}

    def add_bytes(self, data: bytes) -> None:
        """Appends constant bytes to a message body."""
        self.template += data

    def add_value(self, name: str, kind: Any) -> None:
        """Appends a named value to a message body."""
        self.fields[name] = (np.dtype(kind), len(self.template))
        self.template += bytes(np.dtype(kind).itemsize)

    def add_message_field(self, number: int, name: str, kind: Any) -> None:
        """Appends a length-delimited protobuf field of fixed size."""
        self.add_bytes(
            archive_format.varint_bytes(number << 3 | 2) + archive_format.varint_bytes(np.dtype(kind).itemsize)
        )
        self.add_value(name, kind)

    def add_timestamp(self, mark: str = "") -> None:
        """Appends field 1, a protobuf Timestamp of padded numbers."""
        self.add_bytes(b"\x0a\x0c\x08")
        self.add_value(f"seconds{mark}", ("u1", (5,)))
        self.add_bytes(b"\x10")
        self.add_value(f"nanoseconds{mark}", ("u1", (5,)))

    def dtype(self) -> np.dtype[np.void]:
        """Structured dtype of a message body."""
        names = list(self.fields)
        kinds, offsets = [self.fields[n][0] for n in names], [self.fields[n][1] for n in names]
        spec = {"names": names, "formats": kinds, "offsets": offsets, "itemsize": len(self.template)}
        return np.dtype(spec)  # type: ignore[call-overload]


@dataclass(frozen=True)
class FrameContent:
    """Content of an archived variant's frames, which fixes their layout.

    Attributes:
        links: N, as of rollers.
        sprockets, arms: names.
        precision, values: "float64" or "float32", of the run and of packed rollers.
        has_exact_positions: whether positions also come as float64.
        variant: number that names coordinate frames.
    """

    links: int
    sprockets: tuple[str, ...]
    channels: tuple[str, ...]
    precision: str
    values: str
    has_exact_positions: bool
    variant: int
    arms: tuple[str, ...] = ()
    tensioners: int = 0
    shafts: int = 0
    couplings: int = 0
    valves: int = 0

    @classmethod
    def from_trajectory(cls, variant: int, trajectory: Trajectory, values: str | None, exact: bool) -> FrameContent:
        """Content of a trajectory's frames; `values` None keeps its precision."""
        held = trajectory.channels()
        precision = str(next(iter(held.values())).dtype) if held else "float64"
        drive = trajectory.drive
        packed = values or precision
        exact = exact and "position" in held and packed == "float32" and precision == "float64"
        return cls.from_drive(drive, tuple(n for n in CHANNEL_NAMES if n in held), precision, packed, exact, variant)

    @classmethod
    def from_drive(
        cls, drive: Drive, channels: tuple[str, ...], precision: str, values: str, exact: bool, variant: int
    ) -> FrameContent:
        """Content of a drive's frames with these channels."""
        names = tuple(sprocket.name for sprocket in drive.sprockets)
        arms = tuple(arm.name for arm in drive.arms)
        sizes = PartCounts.of_drive(drive)
        counts = sizes.tensioners, sizes.shafts, sizes.couplings, sizes.valves
        return cls(drive.links, names, channels, precision, values, exact, variant, arms, *counts)

    @property
    def topics(self) -> tuple[str, ...]:
        """Topics in a chunk's frame, in order."""
        joints = ("sprockets",) if any(name in self.channels for name in JOINT_STATE_CHANNELS.values()) else ()
        exact = ("positions",) if self.has_exact_positions else ()
        return ("rollers", "state", *joints, *exact, *(("transforms",) if self.has_sprocket_poses else ()))

    @property
    def turning_bodies(self) -> tuple[str, ...]:
        """Names of bodies whose Foxglove frame turns."""
        return self.sprockets + (self.arms if "arm_angle" in self.channels else ())

    @property
    def has_sprocket_poses(self) -> bool:
        """Whether a chunk's frames hold angles and centers of sprockets."""
        return {"sprocket_angle", "sprocket_center"} <= set(self.channels)

    def channel_type(self, channel: str) -> str:
        """Numpy type name of an archived channel as it is read back."""
        if channel == "position" and self.has_exact_positions:
            return "float64"
        return self.values if CHANNEL_BY_NAME[channel].is_of_rollers else self.precision

    def channel_shape(self, channel: str) -> tuple[int, ...]:
        """Shape of a channel in a chunk's frame."""
        return CHANNEL_BY_NAME[channel].shape(self.part_counts)

    @property
    def part_counts(self) -> PartCounts:
        """Numbers of the parts that an archive's channels are of."""
        bodies = len(self.sprockets), len(self.arms), self.tensioners, self.shafts, self.couplings, self.valves
        return PartCounts(self.links, *bodies)


@dataclass(frozen=True)
class ChunkLayout:
    """Byte layout of a frame in an MCAP chunk: `dtype`, a field a topic, and `template`."""

    content: FrameContent
    dtype: np.dtype[np.void]
    template: bytes

    @property
    def frame_bytes(self) -> int:
        """Bytes of a frame in a chunk."""
        return len(self.template)

    def topic_offset(self, topic: str) -> int:
        """Offset of a topic's message in a frame [bytes]."""
        return field_offset(self.dtype, topic)

    def encode_frames(
        self, chunks: Sequence[Trajectory], first: int, channels: Sequence[int], full_scale: float
    ) -> Any:
        """Frames as an array (frames,) of `dtype`, the bytes of an MCAP chunk.

        `first` numbers the first frame; tension colors end at `full_scale` [N].
        """
        count = sum(len(chunk.time) for chunk in chunks)
        raw = np.empty((count, self.frame_bytes), dtype=np.uint8)
        raw[:] = np.frombuffer(self.template, dtype=np.uint8)
        frames = raw.view(self.dtype)[:, 0]
        time = np.concatenate([chunk.time for chunk in chunks])
        stamps = np.rint(time * 1e9).astype(np.uint64)
        for topic, channel in zip(self.content.topics, channels, strict=True):
            head, body = frames[topic]["head"], frames[topic]["body"]
            head["channel"] = channel
            head["sequence"] = np.arange(first, first + count, dtype=np.uint32)
            head["log_time"] = head["publish_time"] = stamps
            if topic in ("rollers", "positions"):
                _write_padded_varints(body["seconds"], stamps // 10**9)
                _write_padded_varints(body["nanoseconds"], stamps % 10**9)
            elif topic == "transforms":
                for s in range(len(self.content.turning_bodies)):
                    _write_padded_varints(body[f"seconds_{s}"], stamps // 10**9)
                    _write_padded_varints(body[f"nanoseconds_{s}"], stamps % 10**9)
            elif topic == "sprockets":
                body["sec"], body["nanosec"] = stamps // 10**9, stamps % 10**9
        frames["state"]["body"]["time"] = time
        start = 0
        for chunk in chunks:
            part = frames[start : start + len(chunk.time)]
            self._write_values(part, chunk, full_scale)
            start += len(part)
        return frames

    def _write_values(self, frames: Any, chunk: Trajectory, full_scale: float) -> None:
        """Writes a trajectory's values and colors into a chunk's frames."""
        points = frames["rollers"]["body"]["data"]
        for channel, values in chunk.channels().items():
            if CHANNEL_BY_NAME[channel].is_of_rollers:
                points[channel] = values
            else:
                frames["state"]["body"][channel] = values
        points["color"] = _color_table().take(_color_indices(chunk, points.shape, full_scale))
        if self.content.has_exact_positions:
            frames["positions"]["body"]["position"] = chunk.position
        if "sprockets" in self.content.topics:
            for name, channel in JOINT_STATE_CHANNELS.items():
                values = getattr(chunk, channel)
                if values is not None:
                    frames["sprockets"]["body"][name] = values

        if self.content.has_sprocket_poses:
            body = frames["transforms"]["body"]
            for s in range(len(self.content.sprockets)):
                angle, center = chunk.sprocket_angle[:, s], chunk.sprocket_center[:, s]  # type: ignore[index]
                body[f"x_{s}"], body[f"y_{s}"] = center[:, 0], center[:, 1]
                body[f"sine_{s}"], body[f"cosine_{s}"] = np.sin(0.5 * angle), np.cos(0.5 * angle)
            carrying = range(len(chunk.drive.arms)) if "arm_angle" in self.content.channels else ()
            pivot = arm_pivots(chunk.drive, chunk.time, chunk.arm_angle)
            for a in carrying:
                angle, s = chunk.arm_angle[:, a], len(self.content.sprockets) + a  # type: ignore[index]
                body[f"x_{s}"], body[f"y_{s}"] = pivot[:, a, 0], pivot[:, a, 1]
                body[f"sine_{s}"], body[f"cosine_{s}"] = np.sin(0.5 * angle), np.cos(0.5 * angle)

    def channel_views(self, frames: Any) -> dict[str, NDArray[Any]]:
        """Time and channels by name, views of archived frames' bytes."""
        held = {"time": frames["state"]["body"]["time"]}
        for channel in self.content.channels:
            if channel == "position" and self.content.has_exact_positions:
                held[channel] = frames["positions"]["body"]["position"]
            elif CHANNEL_BY_NAME[channel].is_of_rollers:
                held[channel] = frames["rollers"]["body"]["data"][channel]
            else:
                held[channel] = frames["state"]["body"][channel]
        return held


@functools.lru_cache(maxsize=256)
def layout_of_content(content: FrameContent) -> ChunkLayout:
    """Byte layout of a chunk's frames with this content."""
    build = {
        "state": _state_body,
        "sprockets": _joint_state_body,
        "positions": _positions_body,
        "transforms": _transforms_body,
    }
    frame = _BodyBuilder()
    for topic in content.topics:
        body = build.get(topic, _roller_cloud_body)(content)
        message = np.dtype([("head", MESSAGE_HEADER), ("body", body.dtype())])
        frame.add_value(topic, message)
        frame.template[-message.itemsize :] = message_record(0, 0, 0, bytes(body.template))
    return ChunkLayout(content, frame.dtype(), bytes(frame.template))


def _roller_cloud_body(content: FrameContent) -> _BodyBuilder:
    """Chunk's body of topic "rollers": a PointCloud of packed rollers."""
    layout = archive_format.roller_dtype(frozenset(content.channels), content.values)
    code = np.dtype(content.values).newbyteorder("<")
    point = _BodyBuilder()
    point.template += bytes(layout.itemsize)
    for channel in ROLLER_CHANNELS:
        if channel.name in content.channels:
            kind = np.dtype((code, (len(channel.components),))) if channel.components else code
            point.fields[channel.name] = (kind, field_offset(layout, channel.value_names[0]))
    point.fields["color"] = (np.dtype("<u4"), field_offset(layout, archive_format.COLOR_FIELDS[0]))
    body = _BodyBuilder()
    body.add_timestamp()
    body.add_bytes(archive_format.constant_point_cloud_bytes(layout))
    body.add_message_field(6, "data", (point.dtype(), (content.links,)))
    return body


def _state_body(content: FrameContent) -> _BodyBuilder:
    """Chunk's body of topic "state": time, and channels of bodies."""
    body = _BodyBuilder()
    body.add_bytes(b"\x09")
    body.add_value("time", "<f8")
    for number, channel in enumerate(BODY_CHANNELS, start=2):
        if channel.name in content.channels:
            body.add_message_field(number, channel.name, ("<f8", channel.shape(content.part_counts)))
    return body


def _joint_state_body(content: FrameContent) -> _BodyBuilder:
    """Chunk's body of topic "sprockets": a CDR JointState."""
    arrays = [name for name, channel in JOINT_STATE_CHANNELS.items() if channel in content.channels]
    template, offsets, stamp = archive_format.joint_state_template(list(content.sprockets), arrays)
    body = _BodyBuilder()
    body.template += template
    body.fields |= {"sec": (np.dtype("<i4"), stamp), "nanosec": (np.dtype("<u4"), stamp + 4)}
    body.fields |= {name: (np.dtype(("<f8", (len(content.sprockets),))), at) for name, at in offsets.items()}
    return body


def _positions_body(content: FrameContent) -> _BodyBuilder:
    """Chunk's body of topic "positions": roller positions as float64."""
    body = _BodyBuilder()
    body.add_timestamp()
    body.add_message_field(2, "position", ("<f8", (content.links, 2)))
    return body


def message_record(channel: int, sequence: int, stamp: int, body: bytes) -> bytes:
    """Bytes of an MCAP message record."""
    head = np.zeros((), dtype=MESSAGE_HEADER)
    head["opcode"], head["length"] = MESSAGE_OPCODE, MESSAGE_HEADER.itemsize - RECORD_HEAD_BYTES + len(body)
    head["channel"], head["sequence"], head["log_time"], head["publish_time"] = channel, sequence, stamp, stamp
    return head.tobytes() + body


def _transforms_body(content: FrameContent) -> _BodyBuilder:
    """Chunk's body of topic "transforms": a FrameTransform a sprocket or arm."""
    body = _BodyBuilder()
    for s, name in enumerate(content.turning_bodies):
        one = _BodyBuilder()
        one.add_timestamp(f"_{s}")
        for number, text in ((2, "drive"), (3, archive_format.body_frame_name(content.variant, name))):
            one.add_bytes(
                archive_format.varint_bytes(number << 3 | 2)
                + archive_format.varint_bytes(len(text.encode()))
                + text.encode()
            )
        one.add_bytes(b"\x22\x12\x09")
        one.add_value(f"x_{s}", "<f8")
        one.add_bytes(b"\x11")
        one.add_value(f"y_{s}", "<f8")
        one.add_bytes(b"\x2a\x12\x19")
        one.add_value(f"sine_{s}", "<f8")
        one.add_bytes(b"\x21")
        one.add_value(f"cosine_{s}", "<f8")
        body.add_bytes(b"\x0a" + archive_format.varint_bytes(len(one.template)))
        start = len(body.template)
        body.add_bytes(bytes(one.template))
        body.fields |= {name: (kind, start + at) for name, (kind, at) in one.fields.items()}
    return body


def field_offset(dtype: np.dtype[np.void], name: str) -> int:
    """Offset [bytes] of a field in a frame's dtype."""
    fields: Any = dtype.fields
    return int(fields[name][1])


def _write_padded_varints(out: Any, values: NDArray[np.uint64]) -> None:
    """Writes protobuf varints padded to five bytes (frames, 5)."""
    for k in range(5):
        more = 0x80 if k < 4 else 0
        out[:, k] = (values >> np.uint64(7 * k)).astype(np.uint8) & 0x7F | more


@functools.cache
def _color_table() -> NDArray[np.uint32]:
    """Packed colors of archived tensions, the last of an unknown one."""
    share = np.append(np.linspace(0.0, 1.0, COLOR_STEPS), np.nan)
    return tension_colors(share, 1.0).view("<u4")[:, 0]


def _color_indices(chunk: Trajectory, shape: tuple[int, ...], full_scale: float) -> NDArray[np.intp]:
    """Color table's index of each roller's link tension."""
    if chunk.tension is None:
        return np.full(shape, COLOR_STEPS)
    share = np.clip(chunk.tension * ((COLOR_STEPS - 1) / full_scale), 0.0, COLOR_STEPS - 1)
    return np.where(np.isfinite(share), share, COLOR_STEPS).astype(np.intp)
