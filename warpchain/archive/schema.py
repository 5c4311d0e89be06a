"""Names and layouts of an archive: topics, attachments, metadata, packed rollers, JointState.

`docs/archive.md` describes the same layout in words.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping

import numpy as np

from warpchain.archive.proto import message_type, schema_bytes
from warpchain.results.channels import OF_ROLLERS

FORMAT_VERSION = "2"
"""Version of the archive layout; a reader refuses a version that it does not know."""

RUN_METADATA = "warpchain"
"""Metadata record at the file's start: format_version, version, device, precision, created, variants, recorded."""
END_METADATA = "warpchain.end"
"""Metadata record at the file's end: ended, wall_time, run."""
METRICS_ATTACHMENT = "metrics.arrow"
"""Attachment: the metrics table as an Arrow IPC file."""

COLOR_FIELDS = ("red", "green", "blue", "alpha")
NUMERIC_TYPES = {"u1": 1, "f4": 7, "f8": 8}
"""numpy's codes of the values of foxglove.PackedElementField.NumericType that occur."""

JOINT_STATE = """std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
"""ROS 2 definition of sensor_msgs/msg/JointState: position [rad], velocity [rad/s], effort [N m]."""


TOPICS = {
    "rollers": "foxglove.PointCloud",
    "state": "warpchain.State",
    "sprockets": "sensor_msgs/msg/JointState",
    "positions": "warpchain.Positions",
    "scene": "foxglove.SceneUpdate",
    "transforms": "foxglove.FrameTransforms",
}
"""Schema of each topic that a recorded variant can have."""
MOST_VARIANTS = 65535 // len(TOPICS)
"""Recorded variants in one file at most: MCAP numbers its channels with 16 bits."""


def with_head(end: Mapping[str, str], head: Mapping[str, str]) -> dict[str, str]:
    """The metadata record at the file's end, with a copy of the one at its start."""
    return {**end, "run": json.dumps(dict(head))}


def head_of(end: Mapping[str, str]) -> dict[str, str]:
    """The copy of the start's metadata in those of the end, empty in archives of earlier versions."""
    return {str(name): str(value) for name, value in json.loads(end.get("run", "{}")).items()}


def topic_path(variant: int, topic: str) -> str:
    """Full name of a variant's topic."""
    return f"/variant/{variant:05d}/{topic}"


def variant_of(path: str) -> tuple[int, str] | None:
    """Variant and topic of a full name, or None for a foreign one."""
    words = path.split("/")
    if len(words) == 4 and words[1] == "variant" and words[3] in TOPICS and re.fullmatch(r"[0-9]{5,9}", words[2]):
        return int(words[2]), words[3]
    return None


def channel_numbers(place: int) -> dict[str, int]:
    """MCAP channel of each topic of the variant in the given place of its file, from 0."""
    return {topic: 1 + place * len(TOPICS) + k for k, topic in enumerate(TOPICS)}


def schema_of(name: str) -> tuple[str, bytes]:
    """MCAP encoding and bytes of a schema of `TOPICS`."""
    if name == "sensor_msgs/msg/JointState":
        return "ros2msg", JOINT_STATE.encode()
    return "protobuf", schema_bytes(message_type(name))


def sprocket_frame(variant: int, name: str) -> str:
    """Coordinate frame that turns with a sprocket."""
    return f"variant/{variant:05d}/{name}"


def drive_attachment(variant: int) -> str:
    """Name of the attachment that holds a variant's drive file."""
    return f"drives/{variant:05d}.toml"


def roller_layout(channels: frozenset[str], precision: str) -> np.dtype[np.void]:
    """Packed little-endian layout of one roller: the recorded channels' values, then the color.

    With positions there is also z, always 0, which viewers ask for.
    """
    code = "<f8" if precision == "float64" else "<f4"
    names: list[str] = []
    for channel in OF_ROLLERS:
        if channel.name in channels:
            names += [*channel.fields, "z"] if channel.name == "position" else channel.fields
    return np.dtype([(name, code) for name in names] + [(name, "u1") for name in COLOR_FIELDS])


def point_cloud_constant(layout: np.dtype[np.void]) -> bytes:
    """The part of a serialized PointCloud that all frames share: frame id, pose, stride and fields."""
    cloud = message_type("foxglove.PointCloud")(frame_id="drive", point_stride=layout.itemsize)
    cloud.pose.orientation.w = 1.0
    for name, (kind, offset, *_) in (layout.fields or {}).items():
        cloud.fields.add(name=name, offset=offset, type=NUMERIC_TYPES[kind.str[1:]])
    return cloud.SerializeToString()


def varint(value: int) -> bytes:
    """protobuf's variable-length integer."""
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def joint_state_template(names: list[str], arrays: list[str]) -> tuple[bytes, dict[str, int], int]:
    """A CDR JointState with everything but its numbers.

    Args:
        names: sprocket names.
        arrays: which of "position", "velocity", "effort" are filled; the others are empty sequences.

    Returns:
        The bytes, the offset of each filled array's first double, and the offset of the stamp.
    """
    out = bytearray(b"\x00\x01\x00\x00")  # encapsulation: CDR, little-endian; alignment counts from here

    def align(size: int) -> None:
        out.extend(bytes(-(len(out) - 4) % size))

    def word(value: int) -> None:
        align(4)
        out.extend(value.to_bytes(4, "little"))

    def text(value: str) -> None:
        data = value.encode() + b"\0"
        word(len(data))
        out.extend(data)

    stamp = len(out)
    out.extend(bytes(8))
    text("drive")
    word(len(names))
    for name in names:
        text(name)
    offsets: dict[str, int] = {}
    for array in ("position", "velocity", "effort"):
        word(len(names) if array in arrays else 0)
        if array in arrays:
            align(8)
            offsets[array] = len(out)
            out.extend(bytes(8 * len(names)))
    return bytes(out), offsets, stamp
