"""Format of an archive (`docs/archive.md`): protobuf messages, topics, attachments, metadata, packed rollers."""

from __future__ import annotations

import functools
import json
import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from warpchain.files import parse_json
from warpchain.results.channels import BODY_CHANNELS, ROLLER_CHANNELS

if TYPE_CHECKING:
    from google.protobuf.descriptor_pb2 import DescriptorProto, FileDescriptorProto
    from google.protobuf.message import Message

MESSAGE_FIELDS = {
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
    "warpchain.State": ", ".join(["double time", *(f"repeated double {channel.name}" for channel in BODY_CHANNELS)]),
    "warpchain.Positions": "Timestamp timestamp, repeated double position",
}
"""Fields of archived protobuf messages, numbered from 1."""
ENUM_VALUES = {
    "PackedElementField.NumericType": "UNKNOWN UINT8 INT8 UINT16 INT16 UINT32 INT32 FLOAT32 FLOAT64",
    "LinePrimitive.Type": "LINE_STRIP LINE_LOOP LINE_LIST",
    "SceneEntityDeletion.Type": "MATCHING_ID ALL",
}
SCALAR_TYPES = ("bool", "bytes", "double", "fixed32", "string")


def message_class(name: str) -> type[Any]:
    """Protobuf class of an archived message, by full name."""
    return _message_classes()[name]


def descriptor_set_bytes(message: type[Message]) -> bytes:
    """FileDescriptorSet bytes of a protobuf message, its MCAP schema."""
    from google.protobuf.descriptor_pb2 import FileDescriptorSet

    files: dict[str, Any] = {}

    def add_with_dependencies(file: Any) -> None:
        """Adds a .proto file after those that it imports."""
        if file.name not in files:
            for dependency in file.dependencies:
                add_with_dependencies(dependency)
            files[file.name] = file

    add_with_dependencies(message.DESCRIPTOR.file)
    result = FileDescriptorSet()
    for file in files.values():
        file.CopyToProto(result.file.add())
    return result.SerializeToString()


@functools.cache
def _message_classes() -> dict[str, type[Any]]:
    """Protobuf classes of all archived messages, by full name."""
    from google.protobuf import descriptor_pool, duration_pb2, message_factory, timestamp_pb2

    pool = descriptor_pool.DescriptorPool()
    for known in (timestamp_pb2, duration_pb2):
        pool.AddSerializedFile(known.DESCRIPTOR.serialized_pb)
    for name in MESSAGE_FIELDS:
        pool.AddSerializedFile(_proto_file(name).SerializeToString())
    return {name: message_factory.GetMessageClass(pool.FindMessageTypeByName(name)) for name in MESSAGE_FIELDS}


def _proto_file(full_name: str) -> FileDescriptorProto:
    """Descriptor of an archived message's .proto file."""
    from google.protobuf.descriptor_pb2 import FileDescriptorProto

    package, message = full_name.split(".")
    file = FileDescriptorProto(name=f"{package}/{message}.proto", package=package, syntax="proto3")
    described = file.message_type.add(name=message)
    for number, declared in enumerate(MESSAGE_FIELDS[full_name].split(", "), start=1):
        for needed in _add_proto_field(described, number, package, message, declared.split()):
            if needed not in file.dependency:
                file.dependency.append(needed)
    return file


def _add_proto_field(
    described: DescriptorProto, number: int, package: str, message: str, words: list[str]
) -> list[str]:
    """Adds a field to a protobuf message; returns its type's .proto files."""
    from google.protobuf.descriptor_pb2 import FieldDescriptorProto as Field

    field = described.field.add(name=words[-1], number=number, label=Field.LABEL_OPTIONAL)
    if words[0] == "repeated":
        field.label = Field.LABEL_REPEATED
        words = words[1:]
    kind = words[-2]
    if words[0] == "enum":
        field.type, field.type_name = Field.TYPE_ENUM, f".{package}.{message}.{kind}"
        values = described.enum_type.add(name=kind)
        for value, name in enumerate(ENUM_VALUES[f"{message}.{kind}"].split()):
            values.value.add(name=name, number=value)
        return []
    if kind in SCALAR_TYPES:
        field.type = Field.Type.Value(f"TYPE_{kind.upper()}")
        return []
    home = "google.protobuf" if kind in ("Timestamp", "Duration") else package
    field.type, field.type_name = Field.TYPE_MESSAGE, f".{home}.{kind}"
    file = kind.lower() if home != package else kind
    return [f"{home.replace('.', '/')}/{file}.proto"]


FORMAT_VERSION = "2"
"""Version of the format; readers refuse any other."""

RUN_METADATA = "warpchain"
"""Metadata record at a file's start."""
END_METADATA = "warpchain.end"
"""Metadata record at a file's end."""
METRICS_ATTACHMENT = "metrics.arrow"

COLOR_FIELDS = ("red", "green", "blue", "alpha")
NUMERIC_TYPE_CODES = {"u1": 1, "f4": 7, "f8": 8}
"""foxglove.PackedElementField.NumericType by numpy's type."""

JOINT_STATE_DEFINITION = """std_msgs/Header header
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
"""ROS 2 definition of sensor_msgs/msg/JointState [rad, rad/s, N m]."""


TOPICS = {
    "rollers": "foxglove.PointCloud",
    "state": "warpchain.State",
    "sprockets": "sensor_msgs/msg/JointState",
    "positions": "warpchain.Positions",
    "scene": "foxglove.SceneUpdate",
    "transforms": "foxglove.FrameTransforms",
}
"""Schema of each topic of a recorded variant."""
MOST_VARIANTS = 65535 // len(TOPICS)
"""Most recorded variants in a file, by MCAP's channel numbers."""


def end_with_start_copy(end: Mapping[str, str], start: Mapping[str, str]) -> dict[str, str]:
    """Metadata of an archive file's end, with its start's copied."""
    return {**end, "run": json.dumps(dict(start))}


def start_copy_of_end(end: Mapping[str, str]) -> dict[str, str]:
    """Start's metadata copied at an archive file's end, or {}."""
    return {str(name): str(value) for name, value in parse_json(end.get("run", "{}")).items()}


def topic_path(variant: int, topic: str) -> str:
    """Full name of a variant's topic: /variant/00003/rollers."""
    return f"/variant/{variant:05d}/{topic}"


def variant_and_topic(path: str) -> tuple[int, str] | None:
    """Variant and topic of a topic's full name, or None."""
    words = path.split("/")
    if len(words) == 4 and words[1] == "variant" and words[3] in TOPICS and re.fullmatch(r"[0-9]{5,9}", words[2]):
        return int(words[2]), words[3]
    return None


def channel_numbers(place: int) -> dict[str, int]:
    """MCAP channel number of each topic of a variant."""
    return {topic: 1 + place * len(TOPICS) + k for k, topic in enumerate(TOPICS)}


def topic_schema(name: str) -> tuple[str, bytes]:
    """MCAP encoding and bytes of a topic's schema, by name."""
    if name == "sensor_msgs/msg/JointState":
        return "ros2msg", JOINT_STATE_DEFINITION.encode()
    return "protobuf", descriptor_set_bytes(message_class(name))


def body_frame_name(variant: int, name: str) -> str:
    """Name of the coordinate frame that turns with a sprocket or arm."""
    return f"variant/{variant:05d}/{name}"


def drive_attachment_name(variant: int) -> str:
    """Name of the attachment with a variant's drive file."""
    return f"drives/{variant:05d}.toml"


def drive_copy_name(variant: int) -> str:
    """Name of the attachment with a drive file's copy."""
    return f"drives/{variant:05d}.copy.toml"


def roller_dtype(channels: frozenset[str], precision: str) -> np.dtype[np.void]:
    """Packed dtype of an archived roller: channels, z = 0, color."""
    code = "<f8" if precision == "float64" else "<f4"
    names: list[str] = []
    for channel in ROLLER_CHANNELS:
        if channel.name in channels:
            names += [*channel.value_names, "z"] if channel.name == "position" else channel.value_names
    return np.dtype([(name, code) for name in names] + [(name, "u1") for name in COLOR_FIELDS])


def constant_point_cloud_bytes(layout: np.dtype[np.void]) -> bytes:
    """Bytes that all archived PointClouds of a variant share."""
    cloud = message_class("foxglove.PointCloud")(frame_id="drive", point_stride=layout.itemsize)
    cloud.pose.orientation.w = 1.0
    for name, (kind, offset, *_) in (layout.fields or {}).items():
        cloud.fields.add(name=name, offset=offset, type=NUMERIC_TYPE_CODES[kind.str[1:]])
    return cloud.SerializeToString()


def varint_bytes(value: int) -> bytes:
    """Protobuf's varint of an integer."""
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def joint_state_template(names: list[str], arrays: list[str]) -> tuple[bytes, dict[str, int], int]:
    """CDR bytes of an archived JointState, offsets of `arrays`, and of its stamp."""
    out = bytearray(b"\x00\x01\x00\x00")  # encapsulation: CDR, little-endian; alignment counts from here

    def append_padding(size: int) -> None:
        """Pads CDR bytes to a multiple of a size."""
        out.extend(bytes(-(len(out) - 4) % size))

    def append_word(value: int) -> None:
        """Appends an aligned 32-bit number to CDR bytes."""
        append_padding(4)
        out.extend(value.to_bytes(4, "little"))

    def append_text(value: str) -> None:
        """Appends a string to CDR bytes."""
        data = value.encode() + b"\0"
        append_word(len(data))
        out.extend(data)

    stamp = len(out)
    out.extend(bytes(8))
    append_text("drive")
    append_word(len(names))
    for name in names:
        append_text(name)
    offsets: dict[str, int] = {}
    for array in ("position", "velocity", "effort"):
        append_word(len(names) if array in arrays else 0)
        if array in arrays:
            append_padding(8)
            offsets[array] = len(out)
            out.extend(bytes(8 * len(names)))
    return bytes(out), offsets, stamp
