"""The protobuf messages of an archive, as descriptors that travel in the file.

Names, numbers and types of Foxglove's messages are its published ones. The types live in a descriptor pool of their
own, so that they never collide with another package's copies of them.
"""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Any

from warpchain.results.channels import OF_BODIES

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
