"""Message types of an archive: what is on each topic, as protobuf descriptors, JointState text and packed layouts.

The protobuf types live in a descriptor pool of their own, so that they never collide with another package's copies
of the Foxglove messages. `docs/archive.md` describes the same layout in words.
"""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from google.protobuf.descriptor_pb2 import FileDescriptorProto
    from google.protobuf.message import Message

FORMAT_VERSION = "1"
"""Version of the archive layout; a reader refuses a version that it does not know."""

RUN_METADATA = "warpchain"
"""Metadata record at the file's start: format_version, version, device, precision, created, variants, recorded."""
END_METADATA = "warpchain.end"
"""Metadata record at the file's end: ended, wall_time."""
METRICS_ATTACHMENT = "metrics.arrow"
"""Attachment: the metrics table as an Arrow IPC file."""

ROLLER_FIELDS = {
    "position": ("x", "y"),
    "velocity": ("vx", "vy"),
    "tension": ("tension",),
    "sprocket_force": ("sprocket_force",),
    "guide_force": ("guide_force",),
}
"""Fields of a packed roller for each channel of a trajectory."""
COLOR_FIELDS = ("red", "green", "blue", "alpha")
NUMERIC_TYPES = {"u1": 1, "f4": 7, "f8": 8}
"""numpy's codes of the values of foxglove.PackedElementField.NumericType that occur."""

COLOR_ANCHORS = np.array([(45, 85, 215), (0, 170, 220), (70, 195, 95), (245, 205, 50), (225, 45, 40)], dtype=np.float64)
"""Colors (RGB) at 0, 1/4, 1/2, 3/4 and all of the color scale, linear between: blue, cyan, green, yellow, red."""
COLOR_UNKNOWN = (150, 150, 150)
"""Color where the tension is not recorded or not finite."""

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


class Topics(NamedTuple):
    """Topics of one recorded variant."""

    rollers: str
    sprockets: str
    state: str


def variant_topics(variant: int) -> Topics:
    """Topics of variant `variant`."""
    stem = f"/variant/{variant:05d}"
    return Topics(f"{stem}/rollers", f"{stem}/sprockets", f"{stem}/state")


def variant_metadata(variant: int) -> str:
    """Name of a recorded variant's metadata record: frames, channels, precision, color_tension_max."""
    return f"variant/{variant:05d}"


def drive_attachment(variant: int) -> str:
    """Name of the attachment that holds a variant's drive file."""
    return f"drives/{variant:05d}.toml"


def tension_color(tension: NDArray[np.floating], full_scale: float) -> NDArray[np.uint8]:
    """Colors of link tensions.

    Args:
        tension: (...) link tensions [N].
        full_scale: tension at the scale's red end [N]; its blue end is 0 N. Values beyond are clamped.

    Returns:
        (..., 4) red, green, blue, alpha.
    """
    share = np.clip(np.asarray(tension, dtype=np.float64) / full_scale, 0.0, 1.0) * (len(COLOR_ANCHORS) - 1)
    known = np.isfinite(share)
    share = np.where(known, share, 0.0)
    left = np.minimum(share.astype(np.intp), len(COLOR_ANCHORS) - 2)
    weight = (share - left)[..., None]
    rgb = COLOR_ANCHORS[left] * (1.0 - weight) + COLOR_ANCHORS[left + 1] * weight
    rgb[~known] = COLOR_UNKNOWN
    colors = np.full((*share.shape, 4), 255, dtype=np.uint8)
    colors[..., :3] = np.rint(rgb)
    return colors


def roller_layout(channels: frozenset[str], precision: str) -> np.dtype[np.void]:
    """Packed little-endian layout of one roller: the recorded channels' values, then the color.

    With positions there is also z, always 0, which viewers ask for.
    """
    code = "<f8" if precision == "float64" else "<f4"
    names: list[str] = []
    for channel, parts in ROLLER_FIELDS.items():
        if channel in channels:
            names += [*parts, "z"] if channel == "position" else parts
    return np.dtype([(name, code) for name in names] + [(name, "u1") for name in COLOR_FIELDS])


def point_cloud_constant(layout: np.dtype[np.void]) -> bytes:
    """The part of a serialized PointCloud that all frames share: frame id, pose, stride and fields."""
    cloud = message_type("foxglove.PointCloud")(frame_id="drive", point_stride=layout.itemsize)
    cloud.pose.orientation.w = 1.0
    for name, (kind, offset, *_) in (layout.fields or {}).items():
        cloud.fields.add(name=name, offset=offset, type=NUMERIC_TYPES[kind.str[1:]])
    return cloud.SerializeToString()


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def timestamp_bytes(stamp: int) -> bytes:
    """The timestamp field (1) of a serialized PointCloud, from nanoseconds."""
    seconds, nanoseconds = divmod(stamp, 10**9)
    body = (b"\x08" + _varint(seconds) if seconds else b"") + (b"\x10" + _varint(nanoseconds) if nanoseconds else b"")
    return b"\x0a" + _varint(len(body)) + body


def data_bytes(data: bytes) -> bytes:
    """The data field (6) of a serialized PointCloud, the last on the wire."""
    return b"\x32" + _varint(len(data)) + data


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
    from google.protobuf import descriptor_pool, message_factory, timestamp_pb2

    pool = descriptor_pool.DescriptorPool()
    pool.AddSerializedFile(timestamp_pb2.DESCRIPTOR.serialized_pb)
    for file in _files():
        pool.AddSerializedFile(file.SerializeToString())
    names = ("foxglove.PointCloud", "warpchain.State")
    return {name: message_factory.GetMessageClass(pool.FindMessageTypeByName(name)) for name in names}


def _files() -> list[FileDescriptorProto]:
    """The .proto files, in order of dependency. Numbers and types of Foxglove's fields are its published ones."""
    vector, quaternion, pose = "foxglove/Vector3.proto", "foxglove/Quaternion.proto", "foxglove/Pose.proto"
    element, stamp = "foxglove/PackedElementField.proto", "google/protobuf/timestamp.proto"
    element_file = _file(element, "PackedElementField", {"name": "string", "offset": "fixed32", "type": "enum"})
    fields = element_file.message_type[0]
    fields.field[2].type_name = ".foxglove.PackedElementField.NumericType"
    numeric = fields.enum_type.add(name="NumericType")
    for number, name in enumerate(
        ["UNKNOWN", "UINT8", "INT8", "UINT16", "INT16", "UINT32", "INT32", "FLOAT32", "FLOAT64"]
    ):
        numeric.value.add(name=name, number=number)
    cloud = {
        "timestamp": ".google.protobuf.Timestamp",
        "frame_id": "string",
        "pose": ".foxglove.Pose",
        "point_stride": "fixed32",
        "fields": "repeated .foxglove.PackedElementField",
        "data": "bytes",
    }
    state = {
        "time": "double",
        "sprocket_angle": "repeated double",
        "sprocket_speed": "repeated double",
        "sprocket_moment": "repeated double",
        "sprocket_center_x": "repeated double",
        "sprocket_center_y": "repeated double",
    }
    return [
        _file(vector, "Vector3", dict.fromkeys("xyz", "double")),
        _file(quaternion, "Quaternion", dict.fromkeys("xyzw", "double")),
        _file(
            pose,
            "Pose",
            {"position": ".foxglove.Vector3", "orientation": ".foxglove.Quaternion"},
            (vector, quaternion),
        ),
        element_file,
        _file("foxglove/PointCloud.proto", "PointCloud", cloud, (element, pose, stamp)),
        _file("warpchain/State.proto", "State", state),
    ]


def _file(path: str, message: str, fields: dict[str, str], imports: tuple[str, ...] = ()) -> FileDescriptorProto:
    """One .proto file with one message, whose fields are numbered from 1 in the order given."""
    from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorProto

    file = FileDescriptorProto(name=path, package=path.split("/")[0], syntax="proto3", dependency=imports)
    described = file.message_type.add(name=message)
    for number, (name, declared) in enumerate(fields.items(), start=1):
        repeated, kind = declared.startswith("repeated "), declared.removeprefix("repeated ")
        field = described.field.add(name=name, number=number)
        field.label = FieldDescriptorProto.LABEL_REPEATED if repeated else FieldDescriptorProto.LABEL_OPTIONAL
        if kind.startswith("."):
            field.type, field.type_name = FieldDescriptorProto.TYPE_MESSAGE, kind
        else:
            field.type = FieldDescriptorProto.Type.Value(f"TYPE_{kind.upper()}")
    return file
