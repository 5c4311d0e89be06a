"""Outlines of a drive for Foxglove: teeth, pitch circles and guides."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpchain.archive.archive_format import body_frame_name, message_class, varint_bytes
from warpchain.archive.chunk_layout import FrameContent
from warpchain.drive import Drive
from warpchain.model import ChainModel, Model
from warpchain.results.outlines import guide_outline, tooth_outline

DRIVE_FRAME = "drive"
CIRCLE_POINTS = 96
TEETH_COLOR = {"r": 0.55, "g": 0.58, "b": 0.62, "a": 1.0}
PITCH_COLOR = {"r": 0.35, "g": 0.40, "b": 0.48, "a": 0.6}
GUIDE_COLOR = {"r": 0.75, "g": 0.55, "b": 0.30, "a": 1.0}
LINE_WIDTH = 2.0
POINT_DTYPE = np.dtype(
    [
        ("head", "u1", (3,)),
        ("x", "<f8"),
        ("y_tag", "u1"),
        ("y", "<f8"),
        ("z_tag", "u1"),
        ("z", "<f8"),
    ]
)
"""Dtype of a LinePrimitive's field 5, a point."""


def scene_update_bytes(content: FrameContent, drive: Drive) -> bytes:
    """Serialized `foxglove.SceneUpdate` of a drive's outlines: `sprocket/NAME` and `guide/NAME`.

    Each is in the coordinate frame of its body where frames hold its pose, else in the drive's.
    """
    entities = [entity for chain in Model(drive).chains for entity in _chain_entities(content, chain)]
    return b"".join(_field_bytes(2, entity) for entity in entities)


def _chain_entities(content: FrameContent, model: ChainModel) -> list[bytes]:
    """Serialized Foxglove entities of a chain's sprockets and guides."""
    entities = []
    turn = np.linspace(0.0, 2.0 * math.pi, CIRCLE_POINTS, endpoint=False)
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    for s, sprocket in enumerate(model.sprockets):
        center = np.zeros(2) if content.has_sprocket_poses else np.asarray(sprocket.center, dtype=float)
        frame = body_frame_name(content.variant, sprocket.name) if content.has_sprocket_poses else DRIVE_FRAME
        teeth, pitch = tooth_outline(model, s)[:-1] + center, circle * model.pitch_radius(s) + center
        facts = {"teeth": str(sprocket.teeth), "pitch_radius": repr(model.pitch_radius(s))}
        lines = [_line_bytes("LINE_LOOP", teeth, TEETH_COLOR), _line_bytes("LINE_LOOP", pitch, PITCH_COLOR)]
        entities.append(_entity_bytes(frame, f"sprocket/{sprocket.name}", facts, lines))
    for g, guide in enumerate(model.guides):
        outline, frame = guide_outline(model, g), DRIVE_FRAME
        if guide.arm in content.turning_bodies[len(content.sprockets) :] and content.has_sprocket_poses:
            assert guide.arm is not None
            frame = body_frame_name(content.variant, guide.arm)
            outline = outline - np.asarray(next(arm.pivot for arm in model.arms if arm.name == guide.arm))
        entities.append(
            _entity_bytes(frame, f"guide/{guide.name}", {}, [_line_bytes("LINE_STRIP", outline, GUIDE_COLOR)])
        )
    return entities


def _field_bytes(number: int, data: bytes) -> bytes:
    """Length-delimited protobuf field of a Foxglove message."""
    return varint_bytes(number << 3 | 2) + varint_bytes(len(data)) + data


def _entity_bytes(frame: str, name: str, facts: dict[str, str], lines: list[bytes]) -> bytes:
    """Serialized Foxglove SceneEntity with metadata and lines."""
    entity: Any = message_class("foxglove.SceneEntity")(frame_id=frame, id=name)
    for key, value in facts.items():
        entity.metadata.add(key=key, value=value)
    return bytes(entity.SerializeToString()) + b"".join(_field_bytes(11, line) for line in lines)


def _line_bytes(kind: str, points: NDArray[np.floating], color: dict[str, float]) -> bytes:
    """Serialized Foxglove LinePrimitive through points (P, 2) [m]."""
    line: Any = message_class("foxglove.LinePrimitive")(thickness=LINE_WIDTH, scale_invariant=True, color=color)
    line.type = line.Type.Value(kind)
    line.pose.orientation.w = 1.0
    packed = np.zeros(len(points), dtype=POINT_DTYPE)
    packed["head"] = (5 << 3 | 2, POINT_DTYPE.itemsize - 2, 0x09)
    packed["y_tag"], packed["z_tag"] = 0x11, 0x19
    packed["x"], packed["y"] = points[:, 0], points[:, 1]
    return bytes(line.SerializeToString()) + packed.tobytes()
