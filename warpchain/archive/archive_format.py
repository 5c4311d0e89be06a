"""Format of an archive: protobuf messages, topics, attachments, metadata, packed rollers, JointState.

Names, numbers and types of Foxglove's messages are its published ones. The types live in a descriptor pool of their
own, so that they never collide with another package's copies of them.

`docs/archive.md` describes the same layout in words.
"""

from __future__ import annotations

import functools
import json
import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from warpchain.files import parse_json
from warpchain.results.channels import OF_BODIES, OF_ROLLERS

if TYPE_CHECKING:
    from google.protobuf.descriptor_pb2 import DescriptorProto, FileDescriptorProto
    from google.protobuf.message import Message

MESSAGES = {
    "foxglove.Color": "double r, double g, double b, double a",
    "foxglove.Point3": "double x, double y, double z",
    "foxglove.Vector3": "double x, double y, double z",
    "foxglove.Quaternion": "double x, double y, double z, double w",
    "foxglove.KeyValuePair": "string key, string value",
    "foxglove.Pose": "Vector3 position, Quaternion orientation",
    "foxglove.PackedElementField": "string name, fixed32 offset, enum NumericType type",
    "foxglove.PointCloud": "Timestamp timestamp, string frame_id, Pose pose, fixed32 point_stride, "
    "repeated PackedElementField fields, bytes data",
    "foxglove.FrameTransform": "Timestamp timestamp, string parent_frame_id, string child_frame_id, "
    "Vector3 translation, Quaternion rotation",
    "foxglove.FrameTransforms": "repeated FrameTransform transforms",
    "foxglove.ArrowPrimitive": "Pose pose, double shaft_length, double shaft_diameter, double head_length, "
    "double head_diameter, Color color",
    "foxglove.CubePrimitive": "Pose pose, Vector3 size, Color color",
    "foxglove.SpherePrimitive": "Pose pose, Vector3 size, Color color",
    "foxglove.CylinderPrimitive": "Pose pose, Vector3 size, double bottom_scale, double top_scale, Color color",
    "foxglove.LinePrimitive": "enum Type type, Pose pose, double thickness, bool scale_invariant, "
    "repeated Point3 points, Color color, repeated Color colors, repeated fixed32 indices",
    "foxglove.TriangleListPrimitive": "Pose pose, repeated Point3 points, Color color, repeated Color colors, "
    "repeated fixed32 indices",
    "foxglove.TextPrimitive": "Pose pose, bool billboard, double font_size, bool scale_invariant, Color color, "
    "string text",
    "foxglove.ModelPrimitive": "Pose pose, Vector3 scale, Color color, bool override_color, string url, "
    "string media_type, bytes data",
    "foxglove.SceneEntity": "Timestamp timestamp, string frame_id, string id, Duration lifetime, bool frame_locked, "
    "repeated KeyValuePair metadata, repeated ArrowPrimitive arrows, repeated CubePrimitive cubes, "
    "repeated SpherePrimitive spheres, repeated CylinderPrimitive cylinders, repeated LinePrimitive lines, "
    "repeated TriangleListPrimitive triangles, repeated TextPrimitive texts, repeated ModelPrimitive models",
    "foxglove.SceneEntityDeletion": "Timestamp timestamp, enum Type type, string id",
    "foxglove.SceneUpdate": "repeated SceneEntityDeletion deletions, repeated SceneEntity entities",
    "warpchain.State": ", ".join(["double time", *(f"repeated double {channel.name}" for channel in OF_BODIES)]),
    "warpchain.Positions": "Timestamp timestamp, repeated double position",
}
"""Fields of each message, numbered from 1 in the order given; a message stands after those that it uses."""
ENUMS = {
    "PackedElementField.NumericType": "UNKNOWN UINT8 INT8 UINT16 INT16 UINT32 INT32 FLOAT32 FLOAT64",
    "LinePrimitive.Type": "LINE_STRIP LINE_LOOP LINE_LIST",
    "SceneEntityDeletion.Type": "MATCHING_ID ALL",
}
"""Values of each enumeration, numbered from 0."""
SCALARS = ("bool", "bytes", "double", "fixed32", "string")


def message_type(name: str) -> type[Any]:
    """The protobuf class of a full message name, such as "foxglove.PointCloud"."""
    return _message_types()[name]


def schema_bytes(message: type[Message]) -> bytes:
    """The message's full FileDescriptorSet, as MCAP's "protobuf" schema encoding asks for."""
    from google.protobuf.descriptor_pb2 import FileDescriptorSet

    files: dict[str, Any] = {}

    def visit(file: Any) -> None:
        if file.name not in files:
            for dependency in file.dependencies:
                visit(dependency)
            files[file.name] = file

    visit(message.DESCRIPTOR.file)
    result = FileDescriptorSet()
    for file in files.values():
        file.CopyToProto(result.file.add())
    return result.SerializeToString()


@functools.cache
def _message_types() -> dict[str, type[Any]]:
    from google.protobuf import descriptor_pool, duration_pb2, message_factory, timestamp_pb2

    pool = descriptor_pool.DescriptorPool()
    for known in (timestamp_pb2, duration_pb2):
        pool.AddSerializedFile(known.DESCRIPTOR.serialized_pb)
    for name in MESSAGES:
        pool.AddSerializedFile(_file(name).SerializeToString())
    return {name: message_factory.GetMessageClass(pool.FindMessageTypeByName(name)) for name in MESSAGES}


def _file(full_name: str) -> FileDescriptorProto:
    """The .proto file of one message."""
    from google.protobuf.descriptor_pb2 import FileDescriptorProto

    package, message = full_name.split(".")
    file = FileDescriptorProto(name=f"{package}/{message}.proto", package=package, syntax="proto3")
    described = file.message_type.add(name=message)
    for number, declared in enumerate(MESSAGES[full_name].split(", "), start=1):
        for needed in _field(described, number, package, message, declared.split()):
            if needed not in file.dependency:
                file.dependency.append(needed)
    return file


def _field(described: DescriptorProto, number: int, package: str, message: str, words: list[str]) -> list[str]:
    """Adds a field; returns the files that it needs."""
    from google.protobuf.descriptor_pb2 import FieldDescriptorProto as Field

    field = described.field.add(name=words[-1], number=number, label=Field.LABEL_OPTIONAL)
    if words[0] == "repeated":
        field.label = Field.LABEL_REPEATED
        words = words[1:]
    kind = words[-2]
    if words[0] == "enum":
        field.type, field.type_name = Field.TYPE_ENUM, f".{package}.{message}.{kind}"
        values = described.enum_type.add(name=kind)
        for value, name in enumerate(ENUMS[f"{message}.{kind}"].split()):
            values.value.add(name=name, number=value)
        return []
    if kind in SCALARS:
        field.type = Field.Type.Value(f"TYPE_{kind.upper()}")
        return []
    home = "google.protobuf" if kind in ("Timestamp", "Duration") else package
    field.type, field.type_name = Field.TYPE_MESSAGE, f".{home}.{kind}"
    file = kind.lower() if home != package else kind
    return [f"{home.replace('.', '/')}/{file}.proto"]


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
    return {str(name): str(value) for name, value in parse_json(end.get("run", "{}")).items()}


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


def drive_copy(variant: int) -> str:
    """Name of the attachment with the same text again, for where a bit of the first has changed."""
    return f"drives/{variant:05d}.copy.toml"


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
